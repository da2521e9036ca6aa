"""Makes a Blender file of a HARMONY scene, or tells what is in one.

Fed with a JSON job file (last argument), nothing else; written for bpy 4.2 to 5.0. Runs in `python` with the bpy module or
in `blender --background --python`.

Frames: the job speaks room coordinates (x right, y up, z to the viewer) and an OpenCV camera; Blender is +Z up, so that
room (x, y, z) is Blender (x, -z, y), which is also what the glTF importer does.
"""

import ctypes
import json
import logging
import sys

try:
    # Linux: end with the program that started this, however that ends (PR_SET_PDEATHSIG, SIGKILL).
    ctypes.CDLL(None).prctl(1, 9)
except (OSError, AttributeError):
    pass

with open(sys.argv[-1], encoding="utf-8") as handle:
    JOB = json.load(handle)

import bpy  # noqa: E402
from mathutils import Matrix, Vector  # noqa: E402


def to_blender(v):
    return Vector((v[0], -v[2], v[1]))


def collection(name):
    found = bpy.data.collections.get(name)
    if found is None:
        found = bpy.data.collections.new(name)
        bpy.context.scene.collection.children.link(found)
    return found


def move(obj, name):
    for old in list(obj.users_collection):
        old.objects.unlink(obj)
    collection(name).objects.link(obj)


def sort_objects():
    """Every node into the collection of its level; the room's faces into `room`."""
    levels = JOB["levels"]
    for obj in list(bpy.data.objects):
        name = obj.name if obj.name in levels else obj.parent.name if obj.parent else None
        move(obj, levels.get(name, "room"))


def add_camera(scene):
    camera = JOB["camera"]
    width, height = camera["width"], camera["height"]
    fx, fy, cx, cy = (camera[k] for k in ("fx", "fy", "cx", "cy"))
    right, down, forward = (to_blender(row) for row in camera["rotation"])
    pose = Matrix((right, -down, -forward)).transposed().to_4x4()
    pose.translation = to_blender(camera["centre"])
    data = bpy.data.cameras.new("camera")
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = 36.0
    data.lens = fx * data.sensor_width / width
    data.clip_start, data.clip_end = 0.02, 1000.0
    scene.render.pixel_aspect_x = max(fy / fx, 1.0)
    scene.render.pixel_aspect_y = max(fx / fy, 1.0)
    data.shift_x = (width / 2 - cx) / width
    data.shift_y = (cy - height / 2) / width * fx / fy
    obj = bpy.data.objects.new("camera", data)
    obj.matrix_world = pose
    collection("camera").objects.link(obj)
    scene.camera = obj
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100


def look_through_camera():
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "VIEW_3D":
                for space in area.spaces:
                    if space.type == "VIEW_3D" and space.region_3d is not None:
                        space.region_3d.view_perspective = "CAMERA"
                        space.shading.type = "MATERIAL"


def add_lights():
    for light in JOB["lights"]:
        kind = {"point": "POINT", "area": "AREA", "sun": "SUN"}[light["kind"]]
        data = bpy.data.lights.new(light["id"], kind)
        data.color = light["color"]
        data.energy = light["intensity"]
        obj = bpy.data.objects.new(light["id"], data)
        obj.location = to_blender(light["position"])
        if kind == "POINT":
            data.shadow_soft_size = light["radius_m"]
        if kind == "AREA":
            data.shape = "RECTANGLE"
            data.size, data.size_y = light["size_m"]
        if kind != "POINT":
            # Along its own -Z, its x level.
            back = -to_blender(light["direction"]).normalized()
            across = Vector((0, 0, 1)).cross(back)
            across = across.normalized() if across.length > 1e-6 else Vector((1, 0, 0))
            obj.rotation_euler = Matrix((across, back.cross(across), back)).transposed().to_euler()
        obj.hide_render = not light["on"]
        obj.hide_viewport = not light["on"]
        collection("lights").objects.link(obj)
        hang_on(obj, light.get("object"))


def hang_on(obj, name):
    """Lets a light follow the thing that it belongs to, from where it is."""
    parent = bpy.data.objects.get(name) if name else None
    if parent is None or parent.type == "LIGHT":
        return
    bpy.context.view_layer.update()
    obj.parent = parent
    obj.matrix_parent_inverse = parent.matrix_world.inverted()


def set_world(scene):
    world = bpy.data.worlds.new("ambient")
    world.use_nodes = True
    node = world.node_tree.nodes.get("Background")
    if node is not None:
        node.inputs["Color"].default_value = (*JOB["ambient_color"], 1.0)
        node.inputs["Strength"].default_value = JOB["ambient_intensity"]
    scene.world = world
    scene.view_settings.exposure = JOB["exposure"]
    transform, look = JOB["view"]
    try:
        scene.view_settings.view_transform = transform
        scene.view_settings.look = look
    except TypeError:
        print(f"this Blender has no view {transform} {look}")


def make():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    logging.disable(logging.INFO)
    bpy.ops.import_scene.gltf(filepath=JOB["glb"])
    scene = bpy.context.scene
    sort_objects()
    add_camera(scene)
    add_lights()
    set_world(scene)
    scene.unit_settings.system = "METRIC"
    scene.unit_settings.scale_length = 1.0
    scene.render.engine = "CYCLES"
    scene["harmony"] = JOB["generator"]
    bpy.context.view_layer.update()
    look_through_camera()
    bpy.ops.outliner.orphans_purge(do_recursive=True)
    bpy.ops.file.pack_all()
    bpy.ops.wm.save_as_mainfile(filepath=JOB["blend"], compress=True)


def part_of(obj):
    """The object that a part which opens belongs to."""
    joint = obj.get("joint")
    return joint["of"] if joint is not None and "of" in joint.keys() else None


def place_of(obj):
    """Where an object is, hidden ones too, which Blender does not evaluate."""
    own = obj.matrix_basis
    return (obj.parent.matrix_world @ obj.matrix_parent_inverse @ own if obj.parent else own).translation


def inventory():
    bpy.ops.wm.open_mainfile(filepath=JOB["blend"])
    objects = []
    for obj in bpy.data.objects:
        if obj.type != "MESH":
            continue
        places = [obj.matrix_world @ v.co for v in obj.data.vertices]
        objects.append({
            "name": obj.name,
            "of": part_of(obj),
            "collection": obj.users_collection[0].name if obj.users_collection else "",
            "triangles": sum(len(p.vertices) - 2 for p in obj.data.polygons),
            "origin": list(obj.matrix_world.translation),
            "low": [min(p[k] for p in places) for k in range(3)],
            "high": [max(p[k] for p in places) for k in range(3)],
        })
    camera = bpy.context.scene.camera
    images = [i for i in bpy.data.images if i.type == "IMAGE" and i.users > 0]
    found = {
        "objects": objects,
        "lights": [list(place_of(o)) for o in bpy.data.objects if o.type == "LIGHT"],
        "camera": list(camera.matrix_world.translation) if camera else None,
        "unpacked": [i.name for i in images if i.packed_file is None],
    }
    with open(JOB["inventory"], "w", encoding="utf-8") as handle:
        json.dump(found, handle)


if JOB["mode"] == "make":
    make()
else:
    inventory()
