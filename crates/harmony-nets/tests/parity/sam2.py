"""SAM 2.1 image predictor against facebookresearch/sam2 (commit 2b90b9f5), with seeded random weights.

Usage: sam2.py small OUT.safetensors          the little arrays of tests/sam2.rs
       sam2.py full SIZE FOLDER               SIZE = tiny, small, base_plus, large: weights (.pt), input and outputs
       sam2.py bf16 SIZE                      relative L2 errors of PyTorch itself under bf16 autocast on the CPU
       sam2.py turns SIZE FOLDER              the image encoder on two threads, once for each line on stdin
       sam2.py resize OUT.safetensors         the predictor's resize and normalisation

Environment: SAM2_REPO = a checkout of facebookresearch/sam2. Packages: torch torchvision hydra-core iopath safetensors.
"""

import os
import sys

import numpy as np
import torch

import seeded

sys.path.insert(0, os.environ.get("SAM2_REPO", "."))
CONFIGS = {"tiny": "t", "small": "s", "base_plus": "b+", "large": "l"}

# The small configuration: every branch of the real ones (windows that do not divide the map, pooled windows, a global
# block, a first block of a stage with the window of the stage before), in sizes for a test.
SMALL = {
    "model.image_size": 128,
    "model.image_encoder.trunk.embed_dim": 8,
    "model.image_encoder.trunk.num_heads": 1,
    "model.image_encoder.trunk.stages": [1, 2, 3, 2],
    "model.image_encoder.trunk.global_att_blocks": [4],
    "model.image_encoder.trunk.window_pos_embed_bkg_spatial_size": [7, 7],
    "model.image_encoder.trunk.window_spec": [8, 4, 6, 3],
    "model.image_encoder.neck.d_model": 32,
    "model.image_encoder.neck.backbone_channel_list": [64, 32, 16, 8],
}


def build(size, overrides=()):
    from sam2.build_sam import build_sam2

    model = build_sam2(
        f"configs/sam2.1/sam2.1_hiera_{CONFIGS[size]}.yaml", None, device="cpu",
        hydra_overrides_extra=[f"++{k}={v}" for k, v in overrides],
    )
    return model


def special(model):
    """Weights that are not as large as their layer's inputs say.

    Positions, tokens and the Fourier matrix: up to one half. The ends of the trunk's branches are damped to a fifth, so
    that 48 blocks keep activations near one and attention in the decoder does not pick single cells. The object score,
    a single number, is kept away from zero.
    """
    keys = {}
    for key, value in model.state_dict().items():
        shape = tuple(value.shape)
        if key.endswith(("_token.weight", "mask_tokens.weight", "embed.weight")) or any(
            part in key for part in ("pos_embed", "point_embeddings", "no_mem_embed", "gaussian")
        ):
            keys[key] = np.float32(0.5) * seeded.uniform(key, shape)
        elif ".trunk.blocks." in key and key.endswith(("attn.proj.weight", "mlp.layers.1.weight")):
            keys[key] = seeded.tensor(key, shape, 0.2)
        elif key.endswith("pred_obj_score_head.layers.2.bias"):
            keys[key] = np.float32(1) + np.float32(0.1) * seeded.uniform(key, shape)
    return keys


def predictor_of(model):
    from sam2.sam2_image_predictor import SAM2ImagePredictor

    predictor = SAM2ImagePredictor(model)
    cell = model.image_size // 4
    predictor._bb_feat_sizes = [(cell, cell), (cell // 2, cell // 2), (cell // 4, cell // 4)]
    return predictor


def photo(width, height):
    """A smooth 8-bit picture that both programs can make: see tests/image_nets/seeded.rs."""
    x, y = np.meshgrid(np.arange(width, dtype=np.int64), np.arange(height, dtype=np.int64))
    channels = [(x * x * 3 + y * 5) // 7 % 256, (x * 2 + y * y) // 5 % 256, (x * y) // 11 % 256]
    return np.stack(channels, -1).astype(np.uint8)


BOX = np.array([11.0, 7.5, 60.25, 40.0])
POINTS = np.array([[20.0, 21.0], [70.5, 8.0]])
LABELS = np.array([1, 0])


def record(model, image, taps):
    predictor = predictor_of(model)
    kept = {}
    hooks = []
    if taps:
        trunk = model.image_encoder.trunk
        for i, block in enumerate(trunk.blocks):
            hooks.append(block.register_forward_hook(lambda _m, _i, out, i=i: kept.__setitem__(f"block{i}", out[0].clone())))
    predictor.set_image(image)
    for hook in hooks:
        hook.remove()
    kept["image_embed"] = predictor._features["image_embed"][0].permute(1, 2, 0)
    for i, feat in enumerate(predictor._features["high_res_feats"]):
        kept[f"high_res{i}"] = feat[0].permute(1, 2, 0)
    scale = image.shape[1] / 96.0
    prompts = {
        "box": dict(box=BOX * scale),
        "points": dict(point_coords=POINTS * scale, point_labels=LABELS),
        "both": dict(box=BOX * scale, point_coords=POINTS * scale, point_labels=LABELS),
    }
    for name, prompt in prompts.items():
        for multi in (False, True):
            masks, ious, low = predictor.predict(**prompt, multimask_output=multi, return_logits=True)
            tag = f"{name}.{'multi' if multi else 'best'}"
            kept[f"{tag}.iou"] = ious
            kept[f"{tag}.low"] = low
            if name == "box" and (taps or not multi):
                kept[f"{tag}.masks"] = masks
    # A mask of an earlier round as a prompt.
    refined = predictor.predict(**prompts["box"], mask_input=low[:1], multimask_output=False, return_logits=True)
    kept["refined.iou"], kept["refined.low"] = refined[1], refined[2]
    # All four masks before the choice, and the object score.
    with torch.no_grad():
        coords = torch.as_tensor(BOX * scale, dtype=torch.float, device=model.device).reshape(1, 2, 2)
        coords = predictor._transforms.transform_coords(coords, normalize=True, orig_hw=image.shape[:2])
        sparse, dense = model.sam_prompt_encoder((coords, torch.tensor([[2, 3]], dtype=torch.int, device=model.device)), None, None)
        all_masks, all_ious, _, score = model.sam_mask_decoder.predict_masks(
            predictor._features["image_embed"], model.sam_prompt_encoder.get_dense_pe(), sparse, dense, False,
            predictor._features["high_res_feats"],
        )
    kept["all.masks"], kept["all.iou"], kept["all.score"] = all_masks[0], all_ious[0], score[0]
    return {k: np.ascontiguousarray(torch.as_tensor(v).float().cpu().numpy()) for k, v in kept.items()}


def save(path, arrays):
    import safetensors
    import safetensors.numpy
    import torchvision

    safetensors.numpy.save_file(arrays, path, metadata=seeded.versions(torch, torchvision, safetensors))


def main():
    torch.manual_seed(0)
    torch.set_num_threads(2)
    mode = sys.argv[1]
    if mode == "small":
        model = build("tiny", SMALL.items())
        seeded.fill(model, special=special(model))
        arrays = record(model, photo(96, 64), True)
        for key in list(arrays):
            if key.startswith("block") and key not in ("block0", "block3", "block4", "block7"):
                del arrays[key]
            if key.startswith(("points", "both")) and ".low" in key:
                arrays[key] = np.ascontiguousarray(arrays[key][:, ::4, ::4])
        del arrays["box.multi.masks"]
        save(sys.argv[2], arrays)
    elif mode == "full":
        size, folder = sys.argv[2], sys.argv[3]
        model = build(size)
        state = seeded.fill(model, special=special(model))
        os.makedirs(folder, exist_ok=True)
        torch.save({"model": state}, f"{folder}/sam2.1_hiera_{size}.pt")
        save(f"{folder}/sam2_{size}.safetensors", record(model, photo(480, 320), False))
    elif mode == "bf16":
        model = build(sys.argv[2])
        seeded.fill(model, special=special(model))
        wanted = record(model, photo(480, 320), False)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            found = record(model, photo(480, 320), False)
        for name, value in wanted.items():
            off = np.linalg.norm(found[name].astype(np.float64) - value) / np.linalg.norm(value.astype(np.float64))
            print(f"{name}: {value.min():.3f} to {value.max():.3f}, rms {np.sqrt(np.mean(value**2)):.3f}, bf16 error {off:.1e}")
    elif mode == "turns":
        model = build(sys.argv[2])
        model.load_state_dict(torch.load(f"{sys.argv[3]}/sam2.1_hiera_{sys.argv[2]}.pt", mmap=True)["model"], assign=True)
        pixels = predictor_of(model)._transforms(photo(1280, 960))[None]

        def encode():
            _, features, _, _ = model._prepare_backbone_features(model.forward_image(pixels))
            return features[-1] + model.no_mem_embed

        seeded.turns(encode)
    elif mode == "resize":
        from sam2.utils.transforms import SAM2Transforms

        arrays = {}
        for name, (w, h, side) in {"shrink": (97, 61, 32), "grow": (20, 13, 32), "mixed": (20, 61, 32)}.items():
            out = SAM2Transforms(side, 0.0)(photo(w, h))
            arrays[name] = np.ascontiguousarray(out.permute(1, 2, 0).numpy())
        save(sys.argv[2], arrays)
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main()
