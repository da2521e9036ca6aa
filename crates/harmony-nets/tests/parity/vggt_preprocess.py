"""What the authors' load_and_preprocess_images makes of small noisy pictures, for tests/it/vggt.rs.

    python vggt_preprocess.py REFERENCE OUT.json

REFERENCE is a checkout of facebookresearch/vggt. The pictures are made by the hash of make_vggt.py, mode `crop` for those that
are not higher than wide, `pad` for the others, as our player does it. Outputs are too large to keep: their CRC-32 (8-bit
values, row-major RGB) is, with some values to look at.

The file kept was made with Pillow 12.0.0. Pillow 13 resizes along y first in some cases, by a rule of its own, which
changes single values of one of these pictures by a few 255ths; up to 12 it is always x first.
"""

import json
import platform
import sys
import tempfile
import zlib
from pathlib import Path

import numpy as np

SEED = 2026

SIZES = [(60, 40), (64, 64), (97, 61), (700, 300), (640, 523), (40, 60), (300, 700), (600, 601)]


def picture(width, height):
    x = np.arange(height * width * 3, dtype=np.uint32)
    x *= np.uint32(2654435761)
    x += np.uint32((zlib.crc32(f"picture {width}x{height}".encode()) ^ SEED) & 0xFFFFFFFF)
    x ^= x >> np.uint32(16)
    x *= np.uint32(0x7FEB352D)
    x ^= x >> np.uint32(15)
    x *= np.uint32(0x846CA68B)
    x ^= x >> np.uint32(16)
    u = (x >> np.uint32(8)).astype(np.float32) * np.float32(2.0**-23) - np.float32(1)
    return ((u + np.float32(1)) * np.float32(128)).astype(np.uint8).reshape(height, width, 3)


def main(reference, out):
    sys.path.insert(0, reference)
    import PIL
    import torch
    from PIL import Image
    from vggt.utils.load_fn import load_and_preprocess_images

    cases = []
    with tempfile.TemporaryDirectory() as folder:
        for width, height in SIZES:
            path = str(Path(folder) / "picture.png")
            Image.fromarray(picture(width, height)).save(path)
            mode = "crop" if round(height * (518 / width) / 14) * 14 <= 518 else "pad"
            tensor = load_and_preprocess_images([path], mode=mode)[0]
            values = (tensor.permute(1, 2, 0).numpy() * 255).round()
            assert np.abs(tensor.permute(1, 2, 0).numpy() * 255 - values).max() < 1e-4
            values = np.ascontiguousarray(values.astype(np.uint8))
            middle = values[values.shape[0] // 2, values.shape[1] // 2 :][:4].ravel()
            cases.append(
                {
                    "size": [width, height],
                    "mode": mode,
                    "result": [values.shape[1], values.shape[0]],
                    "crc32": zlib.crc32(values.tobytes()),
                    "middle": middle.tolist(),
                }
            )
    found = {m.__name__: m.__version__ for m in (np, torch, PIL)}
    versions = {"python": platform.python_version(), "seed": SEED, **found}
    Path(out).write_text(json.dumps({"versions": versions, "cases": cases}, indent=1) + "\n")


main(*sys.argv[1:])
