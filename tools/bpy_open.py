"""Opens a GLB in Blender (as a Python module) and checks what it finds there.

    <venv>/bin/python tools/bpy_open.py FILE.glb [--extents W,H,D] [--nodes a,b,c]
        [--camera camera.json] [--ids ids.png --scene scene.json] [--min-iou 0.95] [--render OUT.png]

Checks (ends with 1 when one fails):
  * the nodes are there by name, with finite boxes; the room (node "room", else everything) stands on y = 0 and has
    the extents within 2 cm (width and depth by its node "floor", when there is one). Blender turns glTF's +Y up into +Z up; everything here is told in the room's frame;
  * --camera: the file's camera projects points where K, R, t of camera.json project them (0.01 px);
  * --ids: object by object, the silhouette seen by Blender's ray casts through camera.json against our own id image
    (8 or 16 bit PNG, values = "index" in scene.json); the mean IoU must reach --min-iou.
"""

import argparse
import json
import struct
import sys
import zlib

import bpy
import numpy as np
from mathutils import Vector


def parse():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("glb")
    p.add_argument("--extents")
    p.add_argument("--nodes", default="")
    p.add_argument("--camera")
    p.add_argument("--ids")
    p.add_argument("--scene")
    p.add_argument("--min-iou", type=float, default=0.95)
    p.add_argument("--render")
    p.add_argument("--samples", type=int, default=16)
    return p.parse_args()


def blender_from_room(v):
    """+Y up to +Z up."""
    return Vector((v[0], -v[2], v[1]))


def room_from_blender(v):
    return np.array([v[0], v[2], -v[1]])


def load_camera(path):
    """K, R, t and the image size, from camera.json or from scene.json's camera."""
    with open(path) as f:
        c = json.load(f)
    c = c.get("camera", c)
    if "K" in c:
        return np.array(c["K"], float), np.array(c["R"], float), np.array(c["t"], float), (c["width"], c["height"])
    k = c["intrinsics"]
    K = np.array([[k["fx"], 0, k["cx"]], [0, k["fy"], k["cy"]], [0, 0, 1]], float)
    return K, np.array(c["rotation"], float), np.array(c["translation"], float), (c["size"]["width"], c["size"]["height"])


def tree_box(obj):
    """Box of an object and its children, in the room's frame."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for o in [obj, *obj.children_recursive]:
        if o.type == "MESH" and o.data.vertices:
            v = np.empty(len(o.data.vertices) * 3, np.float32)
            o.data.vertices.foreach_get("co", v)
            m = np.array(o.matrix_world)
            w = v.reshape(-1, 3) @ m[:3, :3].T + m[:3, 3]
            w = np.stack([w[:, 0], w[:, 2], -w[:, 1]], axis=1)
            low, high = np.minimum(low, w.min(0)), np.maximum(high, w.max(0))
    return low, high


def check_camera(camera, failures):
    """The imported camera against K, R, t."""
    K, R, t, (w, h) = camera
    cams = [o for o in bpy.context.scene.objects if o.type == "CAMERA"]
    if not cams:
        failures.append("the file has no camera")
        return
    cam = cams[0]
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = w, h
    scene.render.resolution_percentage = 100
    # Unequal focal lengths are pixels that are not square.
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = 1.0, 1.0
    centre = -R.T @ t
    worst = 0.0
    depsgraph = bpy.context.evaluated_depsgraph_get()
    projection = cam.calc_matrix_camera(depsgraph, x=w, y=h)
    view = cam.matrix_world.inverted()
    for dx, dy in [(-0.3, -0.2), (0.25, 0.1), (0.0, 0.3)]:
        point = R.T @ np.array([dx, dy, 1.0]) * 2.0 + centre
        q = K @ (R @ point + t)
        # A pinhole of the file has its principal point in the middle and one focal length each way.
        expected = np.array([q[0] / q[2] - K[0, 2] + w / 2, q[1] / q[2] - K[1, 2] + h / 2])
        p = projection @ (view @ blender_from_room(point).to_4d())
        got = np.array([(p.x / p.w + 1) / 2 * w, (1 - p.y / p.w) / 2 * h])
        if abs(K[0, 0] - K[1, 1]) / K[0, 0] < 1e-6:
            worst = max(worst, float(np.abs(got - expected).max()))
    print(f"     camera: off by at most {worst:.5f} px")
    if worst > 0.01:
        failures.append(f"the file's camera is off by {worst:.3f} px")


def load_ids(path):
    """A grey PNG of 8 or 16 bits, exactly: Blender's own reader would bring 16 bits through colour management."""
    with open(path, "rb") as f:
        data = f.read()
    assert data[:8] == b"\x89PNG\r\n\x1a\n", "not a PNG file"
    at, packed, header = 8, b"", None
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            header = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            packed += body
        at += 12 + length
    w, h, bits, color, _, _, interlaced = header
    if color != 0 or bits not in (8, 16) or interlaced:
        raise SystemExit("the id image must be a grey PNG of 8 or 16 bits")
    step = bits // 8
    raw = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(h, 1 + w * step)
    rows = np.zeros((h + 1, w * step), np.uint8)
    for y in range(h):
        mode, line, up = raw[y, 0], raw[y, 1:], rows[y]
        if mode == 0:
            rows[y + 1] = line
        elif mode == 2:
            rows[y + 1] = line + up
        else:
            out = bytearray(w * step)
            for x in range(w * step):
                left = out[x - step] if x >= step else 0
                corner = int(up[x - step]) if x >= step else 0
                above = int(up[x])
                if mode == 1:
                    guess = left
                elif mode == 3:
                    guess = (left + above) // 2
                else:
                    p = left + above - corner
                    guess = min((abs(p - left), 0, left), (abs(p - above), 1, above), (abs(p - corner), 2, corner))[2]
                out[x] = (int(line[x]) + guess) & 255
            rows[y + 1] = np.frombuffer(bytes(out), np.uint8)
    grid = rows[1:].reshape(h, w, step).astype(int)
    return grid[:, :, 0] if step == 1 else grid[:, :, 0] * 256 + grid[:, :, 1]


def silhouettes(camera, ids, index_of, failures, min_iou):
    """Mean IoU of the objects' visible pixels, on every n-th pixel so that the ray casts stay quick."""
    K, R, t, (w, h) = camera
    if ids.shape != (h, w):
        failures.append(f"the id image is {ids.shape[1]} x {ids.shape[0]}, the camera's {w} x {h}")
        return
    step = max(1, round((w * h / 180_000) ** 0.5))
    origin = blender_from_room(-R.T @ t)
    scene = bpy.context.scene
    depsgraph = bpy.context.evaluated_depsgraph_get()

    def owner(obj):
        while obj is not None:
            if obj.name in index_of:
                return index_of[obj.name]
            obj = obj.parent
        return 0

    owners = {o.name: owner(o) for o in scene.objects}

    def culled(obj, face, direction, normal):
        if direction.dot(normal) <= 0:
            return False
        slots = obj.material_slots
        material = slots[obj.data.polygons[face].material_index].material if slots else None
        return bool(material and material.use_backface_culling)

    ours = ids[step // 2 :: step, step // 2 :: step]
    theirs = np.zeros_like(ours)
    for row in range(ours.shape[0]):
        for col in range(ours.shape[1]):
            u, v = col * step + step // 2 + 0.5, row * step + step // 2 + 0.5
            d = R.T @ np.array([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], 1.0])
            direction = blender_from_room(d).normalized()
            start = origin
            for _ in range(12):
                hit, place, normal, face, obj, matrix = scene.ray_cast(depsgraph, start, direction)
                if not hit:
                    break
                if not culled(obj, face, direction, normal):
                    theirs[row, col] = owners.get(obj.name, 0)
                    break
                start = place + direction * 1e-4
    results = []
    for name, index in sorted(index_of.items()):
        a, b = ours == index, theirs == index
        union = int((a | b).sum())
        if union >= 30:
            results.append((int((a & b).sum()) / union, name, int(a.sum()), int(b.sum())))
    if not results:
        failures.append("no object is visible in both images")
        return
    mean = sum(r[0] for r in results) / len(results)
    worst = min(results)
    print(f"     silhouettes: mean IoU {mean:.4f} over {len(results)} objects; worst {worst[1]} {worst[0]:.4f}")
    if mean < min_iou:
        failures.append(f"mean IoU {mean:.4f} is below {min_iou}")
        for iou, name, a, b in sorted(results)[:8]:
            failures.append(f"  {name}: IoU {iou:.3f}, {a} and {b} pixels")


def main():
    args = parse()
    failures = []
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=args.glb)
    # World matrices are stale until the view layer was updated.
    bpy.context.view_layer.update()
    objects = bpy.context.scene.objects
    roots = {o.name: o for o in objects if o.parent is None}
    for name in filter(None, args.nodes.split(",")):
        low, high = tree_box(roots[name]) if name in roots else (np.full(3, np.nan),) * 2
        if not np.isfinite(low).all() or not np.isfinite(high).all():
            failures.append(f"node {name} is missing or empty")
    boxes = [tree_box(o) for o in ([roots["room"]] if "room" in roots else roots.values())]
    low = np.min([b[0] for b in boxes], axis=0)
    high = np.max([b[1] for b in boxes], axis=0)
    floor = next((o for o in objects if o.name == "floor"), None)
    if floor is not None:
        # Jambs of windows and doors reach outward; the floor has the room's width and depth.
        box = tree_box(floor)
        low[[0, 2]], high[[0, 2]] = box[0][[0, 2]], box[1][[0, 2]]
    size = high - low
    if abs(low[1]) > 0.02:
        failures.append(f"the floor is at y = {low[1]:.3f}, not 0")
    if args.extents:
        for axis, expected in zip("xyz", map(float, args.extents.split(","))):
            got = size["xyz".index(axis)]
            if not abs(got - expected) <= 0.02:
                failures.append(f"extent {axis} is {got:.3f} m, expected {expected} m")
    camera = load_camera(args.camera) if args.camera else None
    if camera:
        check_camera(camera, failures)
    if args.ids:
        with open(args.scene) as f:
            index_of = {o["id"]: o["index"] for o in json.load(f)["objects"]}
        silhouettes(camera, load_ids(args.ids), index_of, failures, args.min_iou)
    if args.render:
        scene = bpy.context.scene
        scene.camera = next(o for o in objects if o.type == "CAMERA")
        scene.render.engine = "CYCLES"
        scene.cycles.samples = args.samples
        scene.cycles.use_denoising = True
        world = bpy.data.worlds.new("world")
        scene.world = world
        world.use_nodes = True
        world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.4
        if camera:
            scene.render.resolution_x, scene.render.resolution_y = camera[3]
        scene.render.filepath = args.render
        bpy.ops.render.render(write_still=True)
    shown = " x ".join(f"{v:.3f}" for v in size)
    print(f"{'FAIL' if failures else 'ok  '} {args.glb}: {len(roots)} root nodes, {shown} m (width, height, depth)")
    for f in failures:
        print("    ", f)
    sys.stdout.flush()
    sys.exit(1 if failures else 0)


main()
