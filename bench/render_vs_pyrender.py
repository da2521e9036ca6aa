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
    lines = re.finditer(r"^(\w+) ([\d.]+) ([\d.]+) ([\d.]+)$", text, re.M)
    return {m[1]: tuple(float(v) for v in m.groups()[1:]) for m in lines}


def show(name, lows, middles, processor):
    print(f"{name:30s} wall min {min(lows):7.4f} s  median {statistics.median(middles):7.4f} s"
          f"   processor {statistics.median(processor):7.4f} s")


def ratio(name, peer, mine):
    (wall, processor), (lows, middles, cpu) = peer, zip(*mine)
    print(f"{name:30s} wall {min(wall) / min(lows):5.1f} (min / min)  "
          f"{statistics.median(wall) / statistics.median(middles):5.1f} (median / median)"
          f"   processor {statistics.median(processor) / statistics.median(cpu):5.1f}")


def main():
    folder, program = Path(sys.argv[1]), sys.argv[2]
    rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 5
    scene, nodes, width, height = load(folder)
    renderer = pyrender.OffscreenRenderer(width, height)
    flat = pyrender.RenderFlags.FLAT
    renderer.render(scene, flags=flat)  # uploads meshes and textures, compiles shaders
    renderer.render(scene, flags=pyrender.RenderFlags.SEG, seg_node_map=nodes)

    modes = {"color_depth": flat, "lit_color_depth": 0, "ids": pyrender.RenderFlags.SEG}
    peer = {name: ([], []) for name in modes}
    mine = {}
    for _ in range(rounds):
        for name, flags in modes.items():
            start, spent = time.perf_counter(), time.process_time()
            first, second = renderer.render(scene, flags=flags, seg_node_map=nodes)
            peer[name][0].append(time.perf_counter() - start)
            peer[name][1].append(time.process_time() - spent)
            if name == "color_depth":
                color, depth = first, second
            elif name == "ids":
                seg = first
        for name, values in ours(program, 9).items():
            mine.setdefault(name, []).append(values)

    def both(a, b):
        return tuple([x + y for x, y in zip(p, q)] for p, q in zip(peer[a], peer[b]))

    peer["color_depth + ids"] = both("color_depth", "ids")
    peer["lit_color_depth + ids"] = both("lit_color_depth", "ids")
    print("pyrender", pyrender.__version__, "on OSMesa; load", os.getloadavg())
    for name, (wall, processor) in peer.items():
        show(name, wall, wall, processor)
    print("\nours")
    for name, values in mine.items():
        show(name, *zip(*values))
    print("\npeer / ours")
    ratio("colour + depth + ids, unlit", peer["color_depth + ids"], mine["color_depth_ids"])
    ratio("colour + depth + ids, lit", peer["lit_color_depth + ids"], mine["lit_color_depth_ids"])
    ratio("depth + ids", peer["ids"], mine["depth_ids"])

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
