"""Times pyrender on OSMesa on the scene that `bench_scene` wrote, and compares its images with ours.

Usage: render_vs_pyrender.py SCENE_FOLDER BENCH_SCENE_PROGRAM [ROUNDS]

Both programs run in turns within one run of this script, so that both see the same load. The peer's work is what the
placement loop would ask of it: a flat-shaded colour pass (which gives depth, too) and a segmentation pass for ids.
"""

import os
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path

os.environ["PYOPENGL_PLATFORM"] = "osmesa"

import numpy as np
import pyrender
from PIL import Image


def load(folder):
    lines = (folder / "scene.txt").read_text().splitlines()
    width, height, fx, fy, cx, cy = (float(v) for v in lines[0].split())
    pose = np.eye(4)
    values = np.array(lines[1].split(), float)
    pose[:3, :3] = values[:9].reshape(3, 3).T @ np.diag([1, -1, -1])  # OpenGL cameras look along -z, y up
    pose[:3, 3] = values[9:]
    scene = pyrender.Scene(ambient_light=[1.0, 1.0, 1.0], bg_color=[0, 0, 0, 0])
    camera = pyrender.IntrinsicsCamera(fx, fy, cx, cy, znear=0.05, zfar=100.0)
    scene.add(camera, pose=pose)
    nodes = {}
    for i, line in enumerate(lines[2:]):
        read = lambda name, kind, columns: np.fromfile(folder / f"{i}.{name}", kind).reshape(-1, columns)
        texture = pyrender.Texture(source=Image.open(folder / f"{i}.png").convert("RGB"), source_channels="RGB")
        material = pyrender.MetallicRoughnessMaterial(
            baseColorTexture=texture, metallicFactor=0.0, roughnessFactor=1.0, doubleSided=False
        )
        primitive = pyrender.Primitive(
            positions=read("positions", "<f4", 3),
            normals=read("normals", "<f4", 3),
            texcoord_0=read("uvs", "<f4", 2) * [1, -1] + [0, 1],  # pyrender puts v = 0 at the bottom
            indices=read("indices", "<u4", 3),
            material=material,
        )
        values = np.array(line.split(), float)
        place = np.eye(4)
        place[:3, :3] = values[:9].reshape(3, 3).T
        place[:3, 3] = values[9:]
        node = scene.add(pyrender.Mesh([primitive]), pose=place)
        number = i + 1
        nodes[node] = (number & 255, number >> 8, 0)
    return scene, nodes, int(width), int(height)


def ours(program, rounds):
    text = subprocess.run([program, "--rounds", str(rounds)], check=True, capture_output=True, text=True).stdout
    return {m[1]: (float(m[2]), float(m[3])) for m in re.finditer(r"^(\w+) ([\d.]+) ([\d.]+)$", text, re.M)}


def show(name, seconds):
    print(f"{name:34s} min {min(seconds):7.4f} s   median {statistics.median(seconds):7.4f} s")


def main():
    folder, program = Path(sys.argv[1]), sys.argv[2]
    rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 5
    scene, nodes, width, height = load(folder)
    renderer = pyrender.OffscreenRenderer(width, height)
    flat = pyrender.RenderFlags.FLAT
    renderer.render(scene, flags=flat)  # uploads meshes and textures, compiles shaders
    renderer.render(scene, flags=pyrender.RenderFlags.SEG, seg_node_map=nodes)

    passes = {"color_and_depth": [], "shaded_color_and_depth": [], "ids": []}
    mine = {}
    for _ in range(rounds):
        for name, flags in (("color_and_depth", flat), ("shaded_color_and_depth", 0), ("ids", pyrender.RenderFlags.SEG)):
            start = time.perf_counter()
            first, second = renderer.render(scene, flags=flags, seg_node_map=nodes)
            passes[name].append(time.perf_counter() - start)
            if name == "color_and_depth":
                color, depth = first, second
            elif name == "ids":
                seg = first
        for name, (low, middle) in ours(program, 5).items():
            mine.setdefault(name, []).append((low, middle))

    print("pyrender", pyrender.__version__, "on OSMesa")
    for name, seconds in passes.items():
        show(name, seconds)
    both = [a + b for a, b in zip(passes["color_and_depth"], passes["ids"])]
    show("color_and_depth + ids", both)
    print("\nours (five frames a turn)")
    for name, values in mine.items():
        if name not in ("triangles", "window"):
            show(name, [v[0] for v in values] if name.startswith("cold") else [v[1] for v in values])
    lows, middles = zip(*mine["color_depth_ids"])
    print(f"\nratio, colour + depth + ids, unlit: {min(both) / min(lows):.1f} (min / min), "
          f"{statistics.median(both) / statistics.median(middles):.1f} (median / median)")
    lows, middles = zip(*mine["lit_color_depth_ids"])
    both = [a + b for a, b in zip(passes["shaded_color_and_depth"], passes["ids"])]
    print(f"ratio, colour + depth + ids, lit:   {min(both) / min(lows):.1f} (min / min), "
          f"{statistics.median(both) / statistics.median(middles):.1f} (median / median)")
    lows, middles = zip(*mine["depth_ids"])
    print(f"ratio, ids with depth alone:        {min(passes['ids']) / min(lows):.1f} (min / min), "
          f"{statistics.median(passes['ids']) / statistics.median(middles):.1f} (median / median)")

    # Do both draw the same thing?
    our_depth = np.fromfile(folder / "ours.depth", "<f4").reshape(height, width)
    our_ids = np.fromfile(folder / "ours.ids", "<u4").reshape(height, width)
    our_color = np.asarray(Image.open(folder / "ours.png").convert("RGB"), int)
    ids = seg[..., 0].astype(int) + 256 * seg[..., 1].astype(int)
    same = (ids == our_ids) & (ids > 0)
    drawn = (ids > 0) | (our_ids > 0)
    error = np.abs(depth - our_depth)[same]
    print(f"\nids agree on {100 * same.sum() / drawn.sum():.3f} % of {drawn.sum()} drawn pixels; depth differs by "
          f"{1000 * np.median(error):.4f} mm (median), {1000 * np.percentile(error, 99):.3f} mm (99 %)")
    difference = np.abs(color[..., :3].astype(int) - our_color)[same]
    print(f"colour differs by {difference.mean():.2f} of 255 on average (other texture filtering)")
    Image.fromarray(np.ascontiguousarray(color)).save(folder / "peer.png")


if __name__ == "__main__":
    main()
