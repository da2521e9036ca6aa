"""LPIPS 0.1 (the `lpips` package, with torchvision's trunks) with seeded random trunk weights.

Usage: lpips_nets.py small OUT.safetensors   values and per-layer distances with random heads: tests/it/lpips.rs
       lpips_nets.py heads OUT.safetensors   the same with the published heads of the package
       lpips_nets.py full FOLDER             trunks as torchvision's files (.pth) and values on pictures of 512 by 384

Random weights keep the published heads' sign (never negative). Packages: torch torchvision lpips safetensors.
"""

import os
import sys

import numpy as np
import torch

import seeded
from clip import photo

NETS = {"alex": "alexnet", "vgg": "vgg16"}


def build(net, heads):
    import lpips
    import torchvision

    model = lpips.LPIPS(pretrained=heads == "published", net=net, pnet_rand=True, verbose=False)
    trunk = getattr(torchvision.models, NETS[net])(weights=None).features
    gain = lambda v: np.float32(2**0.5 if v.ndim > 1 else 1)  # half of what a ReLU gets is lost
    state = {f"features.{k}": seeded.tensor(f"{net}.features.{k}", v.shape) * gain(v) for k, v in trunk.state_dict().items()}
    at = 0
    own = model.net.state_dict()
    for key in own:  # slice2.3.weight is features.3.weight
        own[key] = torch.from_numpy(state["features." + key.split(".", 1)[1]])
        at += 1
    assert at == len(state)
    model.net.load_state_dict(own)
    lins = {k: v for k, v in model.state_dict().items() if k.startswith("lin") and not k.startswith("lins")}
    if heads != "published":
        for key, value in lins.items():
            value.copy_(torch.from_numpy(np.abs(seeded.uniform(f"{net}.{key}", tuple(value.shape)))))
    return model.eval(), {k: torch.from_numpy(v) for k, v in state.items()}


def pictures(width, height):
    a = photo(width, height)
    b = photo(width, height)[:, ::-1].copy()
    b[: height // 2] = 255 - b[: height // 2]
    return a, b


@torch.no_grad()
def record(model, a, b):
    to = lambda image: torch.from_numpy(image.astype(np.float32) / np.float32(255)).permute(2, 0, 1)[None]
    value, layers = model(to(a), to(b), retPerLayer=True, normalize=True)
    return {"value": value.reshape(1).numpy(), "layers": np.array([float(x) for x in layers], np.float32)}


def save(path, arrays):
    import safetensors
    import safetensors.numpy
    import torchvision
    from importlib.metadata import version

    metadata = seeded.versions(torch, torchvision, safetensors) | {"lpips": version("lpips")}
    safetensors.numpy.save_file({k: np.ascontiguousarray(v) for k, v in arrays.items()}, path, metadata=metadata)


def main():
    torch.set_num_threads(2)
    mode = sys.argv[1]
    arrays = {}
    if mode in ("small", "heads"):
        for net in NETS:
            model, _ = build(net, "published" if mode == "heads" else "random")
            for key, value in record(model, *pictures(96, 64)).items():
                arrays[f"{net}.{key}"] = value
        save(sys.argv[2], arrays)
    elif mode == "full":
        folder = sys.argv[2]
        os.makedirs(folder, exist_ok=True)
        for net, name in NETS.items():
            model, state = build(net, "published")
            torch.save(state, f"{folder}/{name}.pth")
            heads = {k: v for k, v in model.state_dict().items() if k.startswith("lin") and not k.startswith("lins")}
            torch.save(heads, f"{folder}/lpips_v0.1_{net}_linear.pth")
            for key, value in record(model, *pictures(512, 384)).items():
                arrays[f"{net}.{key}"] = value
        save(f"{folder}/lpips_full.safetensors", arrays)
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main()
