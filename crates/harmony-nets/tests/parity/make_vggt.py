"""Reference outputs of VGGT with seeded random weights, for the parity tests.

    python make_vggt.py small REFERENCE OUT        tiny configurations -> OUT/vggt_small.{safetensors,json}
    python make_vggt.py full REFERENCE OUT         VGGT-1B -> OUT/vggt_full_{weights,expected}.safetensors
    python make_vggt.py time REFERENCE OUT ROUNDS  times VGGT-1B on one photo, two threads, one line a round

REFERENCE is a checkout of the authors' repository (facebookresearch/vggt); nothing of it is kept here.
vggt_small was made with Python 3.11, torch 2.11.0, numpy 2.4, seed 2026.

Weights are the same numbers on both sides without being stored: a hash of the key and the index gives u in [-1, 1).
So that activations stay near one: matrices are u sqrt(3 / inputs) (variance 1 / inputs), biases 0.1 u, norm weights
1 + 0.2 u, layer scales 0.2 + 0.1 u, tokens and positions 0.5 u.
"""

import json
import math
import os
import resource
import sys
import time
import zlib

import numpy as np
import torch
from safetensors.torch import load_file, save_file

SEED = 2026


def uniform(key, count):
    """u in [-1, 1) by a hash of key and index (the mixer is Wellons' lowbias32)."""
    x = np.arange(count, dtype=np.uint32)
    x *= np.uint32(2654435761)
    x += np.uint32((zlib.crc32(key.encode()) ^ SEED) & 0xFFFFFFFF)
    x ^= x >> np.uint32(16)
    x *= np.uint32(0x7FEB352D)
    x ^= x >> np.uint32(15)
    x *= np.uint32(0x846CA68B)
    x ^= x >> np.uint32(16)
    x >>= np.uint32(8)
    return x.astype(np.float32) * np.float32(2.0**-23) - np.float32(1.0)


def value(key, shape):
    u = uniform(key, int(np.prod(shape)))
    if key.endswith("gamma"):
        u = np.float32(0.2) + np.float32(0.1) * u
    elif key.endswith("bias"):
        u = np.float32(0.1) * u
    elif key.endswith("weight") and len(shape) == 1:
        u = np.float32(1.0) + np.float32(0.2) * u
    elif key.endswith("weight"):
        transposed = ".resize_layers.0." in key or ".resize_layers.1." in key
        inputs = shape[0] if transposed else int(np.prod(shape[1:]))
        u = np.float32(math.sqrt(3.0 / inputs)) * u
    else:
        u = np.float32(0.5) * u
    return torch.from_numpy(u.reshape(tuple(shape)))


def photo(name, frames, height, width):
    """Smooth made-up photos in 0..1, [S, 3, H, W]."""
    u = uniform(name, frames * 3 * 6).reshape(frames, 3, 6).astype(np.float64)
    y, x = np.mgrid[0:height, 0:width] / max(height, width)
    out = np.zeros((frames, 3, height, width))
    for f in range(frames):
        for c in range(3):
            a = u[f, c]
            out[f, c] = 0.5 + 0.25 * np.sin(9 * a[0] * x + 7 * a[1] * y + 3 * a[2]) + 0.2 * np.cos(31 * a[3] * x * y + 40 * a[4] * y + a[5])
    return torch.from_numpy(out.clip(0, 1).astype(np.float32))


def without_init():
    """Random initialisation of 1.2 G parameters takes a minute and is overwritten."""
    for name in ("kaiming_uniform_", "uniform_", "normal_", "trunc_normal_", "xavier_uniform_"):
        setattr(torch.nn.init, name, lambda tensor, *args, **kwargs: tensor)


def fill(model):
    keys = {}
    with torch.no_grad():
        for key, tensor in model.state_dict().items():
            keys[key] = list(tensor.shape)
            tensor.copy_(value(key, tensor.shape))
    return keys


def small_model():
    from vggt.heads.camera_head import CameraHead
    from vggt.heads.dpt_head import DPTHead
    from vggt.layers.block import Block
    from vggt.layers.vision_transformer import DinoVisionTransformer
    from vggt.models.aggregator import Aggregator
    from vggt.models.vggt import VGGT

    dim = 64
    model = VGGT.__new__(VGGT)
    torch.nn.Module.__init__(model)
    model.aggregator = Aggregator(img_size=42, embed_dim=dim, depth=4, patch_embed="conv")
    model.aggregator.patch_embed = DinoVisionTransformer(
        img_size=42, patch_size=14, embed_dim=dim, depth=2, num_heads=16, mlp_ratio=4, init_values=1.0,
        block_chunks=0, num_register_tokens=4, interpolate_antialias=True, interpolate_offset=0.0, block_fn=Block)
    model.camera_head = CameraHead(dim_in=2 * dim, trunk_depth=2)
    sizes = dict(features=32, out_channels=[16, 24, 32, 40], intermediate_layer_idx=[0, 1, 2, 3])
    model.depth_head = DPTHead(dim_in=2 * dim, output_dim=2, activation="exp", conf_activation="expp1", **sizes)
    model.point_head = DPTHead(dim_in=2 * dim, output_dim=4, activation="inv_log", conf_activation="expp1", **sizes)
    model.track_head = None
    return model


def full_model():
    from vggt.models.vggt import VGGT

    without_init()
    return VGGT(enable_track=False)


def run(model, images):
    model.eval()
    with torch.inference_mode():
        p = model(images)
    names = ["pose_enc", "depth", "depth_conf", "world_points", "world_points_conf"]
    return {n: p[n][0].float().contiguous() for n in names}


def small(out):
    model = small_model()
    keys = fill(model)
    arrays = {}
    for name, (frames, h, w) in {"one": (1, 28, 42), "three": (3, 42, 56), "square": (1, 42, 42)}.items():
        images = photo(name, frames, h, w)
        arrays[f"{name}.images"] = images.permute(0, 2, 3, 1).contiguous()
        arrays.update({f"{name}.{k}": v for k, v in run(model, images).items()})
    save_file(arrays, os.path.join(out, "vggt_small.safetensors"))
    with open(os.path.join(out, "vggt_small.json"), "w") as f:
        f.write("{\n" + ",\n".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in sorted(keys.items())) + "\n}\n")


def full(out):
    model = full_model()
    weights = os.path.join(out, "vggt_full_weights.safetensors")
    if os.path.exists(weights):
        model.load_state_dict(load_file(weights), assign=True)
    else:
        fill(model)
        save_file({k: v.contiguous() for k, v in model.state_dict().items()}, weights)
    images = photo("full", 1, 392, 518)
    arrays = {"full.images": images.permute(0, 2, 3, 1).contiguous()}
    arrays.update({f"full.{k}": v for k, v in run(model, images).items()})
    save_file(arrays, os.path.join(out, "vggt_full_expected.safetensors"))


def timed(out, rounds):
    torch.set_num_threads(2)
    model = full_model()
    model.load_state_dict(load_file(os.path.join(out, "vggt_full_weights.safetensors")), assign=True)
    model.point_head = None  # the estimator runs camera and depth
    images = photo("full", 1, 392, 518)
    model.eval()
    for _ in range(rounds):
        if sys.stdin.readline() == "":
            break
        cpu, wall = time.process_time(), time.perf_counter()
        with torch.inference_mode():
            model(images)
        seconds, cpu = time.perf_counter() - wall, time.process_time() - cpu
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"torch {seconds:.2f} s, {cpu:.2f} CPU-s, peak {peak:.0f} MiB", flush=True)


if __name__ == "__main__":
    mode, reference, out = sys.argv[1:4]
    sys.path.insert(0, reference)
    torch.manual_seed(SEED)
    if mode == "small":
        small(out)
    elif mode == "full":
        full(out)
    else:
        timed(out, int(sys.argv[4]))
