"""Renders one HARMONY scene with Blender Cycles.

Fed with a JSON job file (last argument) and the GLB it names, nothing else; writes the images and a result file next to
the job. Runs in `python` with the bpy module or in `blender --background --python`. Written for bpy 4.2 to 5.0.

Frames: the job speaks room coordinates (x right, y up, z to the viewer) and an OpenCV camera; Blender is Z up, so that
room (x, y, z) is Blender (x, -z, y), which is also what the glTF importer does.
"""

import ctypes
import json
import logging
import math
import os
import resource
import sys
import time

try:
    # Linux: end with the program that started this, however that ends (PR_SET_PDEATHSIG, SIGKILL).
    ctypes.CDLL(None).prctl(1, 9)
except (OSError, AttributeError):
    pass

STARTED = time.time()
with open(sys.argv[-1], encoding="utf-8") as handle:
    JOB = json.load(handle)
if JOB["memory_limit_mb"]:
    LIMIT = JOB["memory_limit_mb"] << 20
    resource.setrlimit(resource.RLIMIT_AS, (LIMIT, LIMIT))

import bpy  # noqa: E402  (the memory limit comes first)
import numpy as np  # noqa: E402
from mathutils import Matrix, Vector  # noqa: E402

sys.path.insert(0, JOB["folder"])
# These lie beside the job.
from albedo import apply_albedo  # noqa: E402
from apart import apart  # noqa: E402
from textures import base_image, bright_gain, decode, encode, name_in_file, principled  # noqa: E402
from views import sample_response, sample_views, set_view  # noqa: E402

NOTES = []
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
EMITTER_WORDS = ("shade", "bulb", "globe", "diffuser", "emit", "glow", "flame")
# Transmission from which a material is clear.
CLEAR = 0.4
PANE_WORDS = ("glass", "pane", "glazing", "view", "screen", "display")
# The node above the room's faces, and what names of materials begin with that show what is seen through passages.
ROOM = "room"
BEYOND = "beyond_"
# Luminance, display-linear, that the bright part of a shining lampshade has at least.
GLOW = 0.6
# The same of what emits by its material, a globe or a strip: it is the source itself, not a cloth around it.
EMITTED = 0.88
# Share of a shade's light that comes from the bulb itself, by the square of the distance; the rest has been thrown about
# within the shade and is even.
FROM_BULB = 0.6
# Share of the light that falls through hair on the hair behind it: each is thin and pale light is thrown on by many.
THROUGH_HAIR = 0.9


def to_blender(v):
    return Vector((v[0], -v[2], v[1]))


# ---------------------------------------------------------------- scene and nodes


def load_scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    logging.disable(logging.INFO)  # the importer names every mesh
    bpy.ops.import_scene.gltf(filepath=JOB["glb"])
    for obj in list(bpy.data.objects):
        if obj.type in {"LIGHT", "CAMERA"}:
            bpy.data.objects.remove(obj, do_unlink=True)
    for material in bpy.data.materials:
        # What a scene's file glows by for viewers without ambient light (`ambient_glow`) is no light of the room.
        if "ambient_glow" in material and principled(material):
            principled(material).inputs["Emission Strength"].default_value = 0.0
        if "harmony" in material and material["harmony"].get("hairy"):
            let_shadow_rays_through(material, part=THROUGH_HAIR)
    bpy.context.view_layer.update()
    part_faces(all_meshes())
    return bpy.context.scene


def faces_in_room(obj):
    """Vertices and face normals of a mesh in the room's frame, the vertices of all faces' corners, and each face's first."""
    mesh = obj.data
    corners, starts = np.empty(len(mesh.loops), np.int32), np.empty(len(mesh.polygons), np.int32)
    places, normals = np.empty(3 * len(mesh.vertices), np.float32), np.empty(3 * len(mesh.polygons), np.float32)
    mesh.loops.foreach_get("vertex_index", corners)
    mesh.polygons.foreach_get("loop_start", starts)
    mesh.vertices.foreach_get("co", places)
    mesh.polygons.foreach_get("normal", normals)
    turn = np.array(obj.matrix_world, np.float64)
    places = places.reshape(-1, 3).astype(np.float64) @ turn[:3, :3].T + turn[:3, 3]
    normals = normals.reshape(-1, 3).astype(np.float64) @ np.linalg.pinv(turn[:3, :3])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return places, normals, corners, starts


def part_faces(objects):
    """Moves faces that lie on one another a little apart, within a mesh and between meshes (a window's frame and the hole
    that it fills): Cycles draws coincident faces black."""
    objects = [obj for obj in objects if obj.data.polygons]
    if not objects:
        return
    faces = [faces_in_room(obj) for obj in objects]
    vertices = np.cumsum([0] + [len(places) for places, *_ in faces])
    loops = np.cumsum([0] + [len(corners) for _, _, corners, _ in faces])
    places = np.concatenate([f[0] for f in faces])
    moved = apart(
        places,
        np.concatenate([f[1] for f in faces]),
        np.concatenate([f[2] + first for f, first in zip(faces, vertices)]),
        np.concatenate([f[3] + first for f, first in zip(faces, loops)]),
    )
    for obj, first, end in zip(objects, vertices, vertices[1:]):
        changed = (moved[first:end] != places[first:end]).any(axis=1)
        if not changed.any():
            continue
        if obj.data.users > 1:
            obj.data = obj.data.copy()
        own = np.empty(3 * (end - first), np.float32)
        obj.data.vertices.foreach_get("co", own)
        back = np.array(obj.matrix_world.inverted_safe(), np.float64)
        own = own.reshape(-1, 3)
        own[changed] = moved[first:end][changed] @ back[:3, :3].T + back[:3, 3]
        obj.data.vertices.foreach_set("co", own.ravel())
        obj.data.update()


def meshes_below(name):
    """Mesh objects of a named node and its descendants."""
    root = bpy.data.objects.get(name)
    if root is None:
        return []
    return [o for o in [root, *root.children_recursive] if o.type == "MESH"]


def all_meshes():
    return [o for o in bpy.data.objects if o.type == "MESH"]


def part_of(name):
    """Mesh objects and material of a part: a node's name, or `node/material` for one material of it."""
    node, _, material = name.partition("/")
    return meshes_below(node), material


def hide_from_camera():
    for name in JOB["hidden_nodes"]:
        found = meshes_below(name)
        if not found:
            NOTES.append(f"no node {name} to hide")
        # Sides of a face's niches, strips in them and blocks that hang go with it (`harmony_mesh::is_left_out`).
        found += [o for o in all_meshes() if o.name.startswith((f"{name}_niche_", f"{name}_block_"))]
        for obj in found:
            obj.visible_camera = False
    if JOB["hidden_nodes"]:
        # From outside, what is left of the hidden walls (boards, tops of blocks) would be seen from behind, black.
        for _, material in own_materials(meshes_below(ROOM)):
            hide_back(material)


# No board stands farther out of its wall, metres.
BOARD_DEPTH = 0.2


def hide_boards():
    """The camera sees through boards along walls that are hidden: they are pieces of one mesh with those along the others."""
    if not JOB["hidden_nodes"] or not JOB["room"]:
        return
    width, _, depth = JOB["room"]
    # Axis in Blender, place of the wall on it, and the sign of the direction out of the room.
    walls = {
        "wall_left": (0, 0.0, -1.0),
        "wall_right": (0, width, 1.0),
        "wall_back": (1, 0.0, 1.0),
        "wall_front": (1, -depth, -1.0),
    }
    boards = [o for name in ("skirting", "cornice", "casing") for o in meshes_below(name)]
    for board, (axis, place, outward) in [(b, w) for b in boards for n, w in walls.items() if n in JOB["hidden_nodes"]]:
        inward = [(place - (board.matrix_world @ v.co)[axis]) * outward for v in board.data.vertices]
        reach = max((d for d in inward if d < BOARD_DEPTH), default=0.0) + 1e-3

        def beside(tree):
            geometry, path = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeLightPath")
            split, near, both = (tree.nodes.new(f"ShaderNode{k}") for k in ("SeparateXYZ", "Math", "Math"))
            near.operation, both.operation = "GREATER_THAN" if outward > 0.0 else "LESS_THAN", "MULTIPLY"
            near.inputs[1].default_value = place - outward * reach
            tree.links.new(geometry.outputs["Position"], split.inputs[0])
            tree.links.new(split.outputs[axis], near.inputs[0])
            tree.links.new(path.outputs["Is Camera Ray"], both.inputs[0])
            tree.links.new(near.outputs[0], both.inputs[1])
            return both.outputs[0]

        # With the floor below it, which no light reaches.
        for _, material in own_materials([board, *meshes_below("floor")]):
            clear_for(material, beside)


# What ends this close below the ceiling gets no light on its top, metres.
UNDER_CEILING = 0.15


def show_tops(response):
    """Without the ceiling the camera sees tops that no light reaches: of tall cupboards, cornices, lamps' roses.

    They show their own colour, a little shaded, to the camera alone.
    """
    if not JOB["hidden_nodes"] or not JOB["room"]:
        return
    level = JOB["room"][1] - UNDER_CEILING
    tall = [o for o in all_meshes() if o.visible_camera and max((o.matrix_world @ Vector(c)).z for c in o.bound_box) > level]
    strength = 0.7 * float(light_of(response, 0.5)) / float(decode(np.float32(0.5)))
    for _, material in own_materials(tall):
        shader = principled(material)
        if shader is None:
            continue

        def on_top(tree):
            geometry, path = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeLightPath")
            share = path.outputs["Is Camera Ray"]
            for name, least in (("Position", level), ("True Normal", 0.5)):
                split, above, both = (tree.nodes.new(f"ShaderNode{k}") for k in ("SeparateXYZ", "Math", "Math"))
                above.operation, both.operation = "GREATER_THAN", "MULTIPLY"
                above.inputs[1].default_value = least
                tree.links.new(geometry.outputs[name], split.inputs[0])
                tree.links.new(split.outputs["Z"], above.inputs[0])
                tree.links.new(share, both.inputs[0])
                tree.links.new(above.outputs[0], both.inputs[1])
                share = both.outputs[0]
            return share

        tree = material.node_tree
        emission = tree.nodes.new("ShaderNodeEmission")
        emission.inputs["Strength"].default_value = strength
        colour = shader.inputs["Base Color"]
        emission.inputs["Color"].default_value = colour.default_value[:]
        if colour.links:
            tree.links.new(colour.links[0].from_socket, emission.inputs["Color"])
        mix_in(material, on_top, emission)


# ---------------------------------------------------------------- camera


def set_camera(scene):
    """OpenCV K, R, t to a Blender camera; the centre of the top-left pixel is (0.5, 0.5) on both sides."""
    camera = JOB["camera"]
    width, height = camera["width"], camera["height"]
    fx, fy, cx, cy = (camera[k] for k in ("fx", "fy", "cx", "cy"))
    right, down, forward = (to_blender(row) for row in camera["rotation"])
    pose = Matrix((right, -down, -forward)).transposed().to_4x4()
    pose.translation = to_blender(camera["centre"])
    data = bpy.data.cameras.new("photo")
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = 36.0
    data.lens = fx * data.sensor_width / width
    data.clip_start, data.clip_end = 0.02, 1000.0
    scene.render.pixel_aspect_x = max(fy / fx, 1.0)
    scene.render.pixel_aspect_y = max(fx / fy, 1.0)
    data.shift_x = (width / 2 - cx) / width
    data.shift_y = (cy - height / 2) / width * fx / fy
    obj = bpy.data.objects.new("photo", data)
    obj.matrix_world = pose
    scene.collection.objects.link(obj)
    scene.camera = obj
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100


# ---------------------------------------------------------------- view transform


def light_of(response, display):
    """Scene-linear light, before exposure, that shows as a display value (sRGB encoded, a number or an array)."""
    light, shown = response
    return np.interp(display, shown, light) / 2.0 ** JOB["lighting"]["exposure"]


def shown_as(node, response, least=0.0, mean=None):
    """A copy of a texture node whose image, emitted, displays as the texture is; its bright end at least `least`, or
    its mean as said.

    `least` is display-linear luminance of the brightest tenth, `mean` a display-linear colour.
    """
    width, height = node.image.size
    pixels = np.empty(width * height * 4, dtype=np.float32)
    node.image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(-1, 4)
    rgb = pixels[:, :3]
    used = pixels[:, 3] > 0.5
    if mean is not None and used.any():
        linear = decode(rgb)
        rgb = encode(np.minimum(linear * (np.array(mean) / np.maximum(linear[used].mean(axis=0), 0.02)), 1.0))
    elif least > 0.0:
        linear = decode(rgb)
        bright = float(np.percentile((linear @ LUMINANCE)[used], 90)) if used.any() else 0.0
        if bright < least:
            rgb = encode(np.minimum(linear * (least / max(bright, 0.02)), 1.0))
    pixels[:, :3] = light_of(response, rgb)
    image = bpy.data.images.new(node.image.name + "_shown", width, height, alpha=True, float_buffer=True)
    image.colorspace_settings.name = "Linear Rec.709"
    image.pixels.foreach_set(pixels.ravel().astype(np.float32))
    image.pack()
    tree = node.id_data
    copy = tree.nodes.new("ShaderNodeTexImage")
    copy.image, copy.extension, copy.interpolation = image, node.extension, node.interpolation
    if node.inputs["Vector"].links:
        tree.links.new(node.inputs["Vector"].links[0].from_socket, copy.inputs["Vector"])
    return copy


# ---------------------------------------------------------------- materials


def own_materials(objects, only=""):
    """Gives objects materials (and meshes) of their own, and returns them; `only`: those of that name."""
    found = {}
    for obj in objects:
        if obj.data.users > 1:
            obj.data = obj.data.copy()
        for slot in obj.material_slots:
            if slot.material and (not only or name_in_file(slot.material) == only):
                if slot.material.name not in found:
                    found[slot.material.name] = slot.material.copy()
                slot.material = found[slot.material.name]
    return list(found.items())


def surface_socket(material):
    """The shader socket that feeds the surface output, and the output's input."""
    output = next((n for n in material.node_tree.nodes if n.type == "OUTPUT_MATERIAL" and n.is_active_output), None)
    if output is None or not output.inputs["Surface"].links:
        return None, None
    return output.inputs["Surface"].links[0].from_socket, output.inputs["Surface"]


def clear_for(material, share_of, colour=(1.0, 1.0, 1.0, 1.0)):
    """Mixes transparency into a surface; `share_of` makes the socket that says how much, in the material's tree."""
    clear = material.node_tree.nodes.new("ShaderNodeBsdfTransparent")
    clear.inputs["Color"].default_value = colour
    mix_in(material, share_of, clear)


def mix_in(material, share_of, node):
    """Mixes another shader into a surface; `share_of` makes the socket that says how much."""
    tree = material.node_tree
    shader, surface = surface_socket(material)
    if shader is None:
        return
    mix = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(share_of(tree), mix.inputs["Fac"])
    tree.links.new(shader, mix.inputs[1])
    tree.links.new(node.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], surface)


def hide_back(material):
    """The camera sees through the side that faces away from the room."""

    def seen_from_behind(tree):
        share = tree.nodes.new("ShaderNodeMath")
        share.operation = "MULTIPLY"
        tree.links.new(tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"], share.inputs[0])
        tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], share.inputs[1])
        return share.outputs[0]

    clear_for(material, seen_from_behind)


def let_shadow_rays_through(material, colour=(1.0, 1.0, 1.0, 1.0), part=1.0):
    def share(tree):
        shadow = tree.nodes.new("ShaderNodeLightPath").outputs["Is Shadow Ray"]
        return shadow if part >= 1.0 else math_node(tree, "MULTIPLY", shadow, part)

    clear_for(material, share, colour)


def math_node(tree, operation, a, b):
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, (a, b)):
        if isinstance(value, float):
            socket.default_value = value
        else:
            tree.links.new(value, socket)
    return node.outputs[0]


def show_emission(material, colour, strength, image_node=None, centre=None, radius=0.0, radiance=None, bulb=None):
    """Makes a surface look luminous to the camera; it lights the room by `radiance` (linear RGB), or not at all, where a
    light beside it does.

    With a centre only what lies around it glows: a lamp that is one piece. With a bulb (its place, and the mean of the
    inverse square of the distance from it) what is near it is brighter.
    """
    tree = material.node_tree
    shader, surface = surface_socket(material)
    if shader is None:
        return
    if radiance is not None:
        light, both = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeAddShader")
        top = max(max(radiance), 1e-9)
        light.inputs["Color"].default_value = (*(float(v) / top for v in radiance), 1.0)
        light.inputs["Strength"].default_value = top
        tree.links.new(shader, both.inputs[0])
        tree.links.new(light.outputs[0], both.inputs[1])
        shader = both.outputs[0]
        material.cycles.emission_sampling = "FRONT_BACK"
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (*colour, 1.0)
    emission.inputs["Strength"].default_value = strength
    if image_node is not None:
        tree.links.new(image_node.outputs["Color"], emission.inputs["Color"])
    path = tree.nodes.new("ShaderNodeLightPath")
    share = path.outputs["Is Camera Ray"]

    def distance_to(place):
        geometry = tree.nodes.new("ShaderNodeNewGeometry")
        distance = tree.nodes.new("ShaderNodeVectorMath")
        distance.operation = "DISTANCE"
        distance.inputs[1].default_value = place
        tree.links.new(geometry.outputs["Position"], distance.inputs[0])
        return distance.outputs["Value"]

    if bulb is not None:
        place, mean = bulb
        inverse = math_node(tree, "POWER", distance_to(place), -2.0)
        near = math_node(tree, "MULTIPLY", inverse, strength * FROM_BULB / mean)
        level = math_node(tree, "ADD", near, strength * (1.0 - FROM_BULB))
        tree.links.new(math_node(tree, "MINIMUM", level, 2.0 * strength), emission.inputs["Strength"])
    if centre is not None:
        fade = tree.nodes.new("ShaderNodeMapRange")
        fade.interpolation_type = "SMOOTHSTEP"
        for name, value in (("From Min", 0.5 * radius), ("From Max", radius), ("To Min", 1.0), ("To Max", 0.0)):
            fade.inputs[name].default_value = value
        tree.links.new(distance_to(centre), fade.inputs["Value"])
        share = math_node(tree, "MULTIPLY", share, fade.outputs["Result"])
    join = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(share, join.inputs["Fac"])
    tree.links.new(shader, join.inputs[1])
    tree.links.new(emission.outputs[0], join.inputs[2])
    tree.links.new(join.outputs[0], surface)


# Roughness from which what is see-through is cloth, not glass.
CLOTH = 0.5


def spread_in_cloth():
    """See-through cloth scatters: half of what it stops leaves it at the other side, so that a sheer glows before its window.

    How opaque it is was said of how much of it one sees, its glow included: what passes straight through a weave is less,
    and a pane behind it, many times as bright as white, would show as sharply as without it.
    """
    for material in list(bpy.data.materials):
        shader = principled(material)
        if shader is None or material.surface_render_method != "BLENDED":
            continue
        alpha, colour = shader.inputs["Alpha"], shader.inputs["Base Color"]
        if alpha.default_value > 0.98 and not alpha.links:
            continue
        if shader.inputs["Roughness"].default_value < CLOTH and not shader.inputs["Roughness"].links:
            continue
        if shader.inputs["Transmission Weight"].default_value >= CLEAR:
            continue
        tree = material.node_tree
        straight = math_node(tree, "SUBTRACT", 1.0, alpha.links[0].from_socket if alpha.links else float(alpha.default_value))
        share = math_node(tree, "POWER", straight, 2.0)
        for link in list(alpha.links):
            tree.links.remove(link)
        alpha.default_value = 1.0
        shader.inputs["Transmission Weight"].default_value = 0.0
        through = tree.nodes.new("ShaderNodeBsdfTranslucent")
        through.inputs["Color"].default_value = colour.default_value[:]
        if colour.links:
            tree.links.new(colour.links[0].from_socket, through.inputs["Color"])
        mix_in(material, lambda tree: math_node(tree, "ADD", 0.5, 0.0), through)
        clear_for(material, lambda tree: share)


def clear_glass():
    """Light goes straight through glass: real refraction would need caustics, which a path tracer hardly finds."""
    for material in list(bpy.data.materials):
        shader = principled(material)
        if shader and shader.inputs["Transmission Weight"].default_value >= CLEAR:
            colour = shader.inputs["Base Color"].default_value[:]
            let_shadow_rays_through(material, colour)


# ---------------------------------------------------------------- lights


def add_light(scene, name, kind, position, energy, colour, group):
    data = bpy.data.lights.new(name, kind)
    data.energy = energy
    data.color = colour
    obj = bpy.data.objects.new(name, data)
    obj.location = to_blender(position)
    obj.visible_camera = False
    obj.lightgroup = group
    scene.collection.objects.link(obj)
    return obj


def aim(obj, direction):
    """Turns a light's -Z along a room direction, its Y as far up as that allows."""
    back = -to_blender(direction).normalized()
    if abs(back.z) > 0.999:
        across = Vector((1.0, 0.0, 0.0))
    else:
        across = Vector((0.0, 0.0, 1.0)).cross(back).normalized()
    obj.rotation_euler = Matrix((across, back.cross(across), back)).transposed().to_euler()


def add_rectangle(scene, name, position, direction, size, energy, colour, group):
    obj = add_light(scene, name, "AREA", position, energy, colour, group)
    obj.data.shape = "RECTANGLE"
    obj.data.size, obj.data.size_y = size
    aim(obj, direction)
    return obj


def keep_off(light, objects):
    """A window's own frame and bars are lit by what its pane shows: the rectangle of daylight lies within them, and what is
    nearly in its plane would be burnt white along every edge."""
    if not objects:
        return
    receivers = bpy.data.collections.new(f"{light.name}_receivers")
    for obj in objects:
        receivers.objects.link(obj)
    for linked in receivers.collection_objects:
        linked.light_linking.link_state = "EXCLUDE"
    light.light_linking.receiver_collection = receivers


def add_ambient(scene, group, response):
    """Uniform light from the six faces of the room box, unseen by camera and mirrors; the world's in no room."""
    lighting = JOB["lighting"]
    world = bpy.data.worlds.new("ambient")
    scene.world = world
    world.lightgroup = group
    tree = nodes_of(world)
    output = tree.nodes.new("ShaderNodeOutputWorld")
    mix = tree.nodes.new("ShaderNodeMixShader")
    path = tree.nodes.new("ShaderNodeLightPath")
    ambient, seen = tree.nodes.new("ShaderNodeBackground"), tree.nodes.new("ShaderNodeBackground")
    colour, level = lighting["ambient_color"], lighting["ambient_intensity"]
    ambient.inputs["Color"].default_value = (*colour, 1.0)
    ambient.inputs["Strength"].default_value = 0.0 if JOB["room"] else level
    outside = [float(v) for v in light_of(response, JOB["background"])] if JOB["background"] else colour
    seen.inputs["Color"].default_value = (*outside, 1.0)
    seen.inputs["Strength"].default_value = 1.0 if JOB["background"] else level
    tree.links.new(path.outputs["Is Camera Ray"], mix.inputs["Fac"])
    tree.links.new(ambient.outputs[0], mix.inputs[1])
    tree.links.new(seen.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    if not JOB["room"] or level <= 0.0:
        return
    w, h, d = JOB["room"]
    gap = 0.002
    for name, position, direction, size in (
        ("floor", (w / 2, gap, d / 2), (0, 1, 0), (w, d)),
        ("ceiling", (w / 2, h - gap, d / 2), (0, -1, 0), (w, d)),
        ("back", (w / 2, h / 2, gap), (0, 0, 1), (w, h)),
        ("front", (w / 2, h / 2, d - gap), (0, 0, -1), (w, h)),
        ("left", (gap, h / 2, d / 2), (1, 0, 0), (d, h)),
        ("right", (w - gap, h / 2, d / 2), (-1, 0, 0), (d, h)),
    ):
        # A rectangle of P watts has radiance P / (pi * area).
        watts = level * math.pi * size[0] * size[1]
        obj = add_rectangle(scene, f"ambient_{name}", position, direction, size, watts, colour, group)
        obj.visible_glossy = False


def panes_of(owned):
    """The materials of a window or screen that show a picture of light."""
    def clear(material):
        shader = principled(material)
        return shader is not None and shader.inputs["Transmission Weight"].default_value >= 0.3

    panes = [m for name, m in owned if any(w in name.lower() for w in PANE_WORDS) or clear(m)]
    if not panes and len(owned) == 1:
        panes = [owned[0][1]]
    return panes or [m for _, m in owned if principled(m) and base_image(principled(m))]


def bright_pane(light, response):
    """Scene-linear colour of a pane that the photo gives no picture of: nearly white in its brightest channel, and in the
    others as far as its light is bright enough."""
    colour = np.array(light["color"])
    area = max(light["size_m"][0] * light["size_m"][1], 1e-4)
    radiance = light["intensity"] / (math.pi * area)
    most = float(light_of(response, 0.93))
    return np.clip(colour * radiance, colour * most, most)


# Share of a pane's picture above such a display value from which it is burnt out: how bright the sky is, it does not tell.
BURNT = (0.94, 0.05)


def is_burnt(image):
    """Whether a texture is too bright to tell how bright what it shows is."""
    pixels = np.empty(image.size[0] * image.size[1] * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(-1, 4)
    shown = pixels[pixels[:, 3] > 0.5][:, :3]
    return not len(shown) or float((shown @ LUMINANCE > BURNT[0]).mean()) > BURNT[1]


def dress_window(light, objects, response):
    """The pane shows what the photo shows in it, at the photo's brightness; light passes it.

    Returns the images that are shown so, and whether one tells how bright the sky is.
    """
    panes = panes_of(own_materials(objects))
    spared, tells = set(), False
    for material in panes:
        shader = principled(material)
        node = base_image(shader) if shader else None
        if node is not None:
            tells = tells or not is_burnt(node.image)
            spared.add(node.image.name)
            show_emission(material, (1, 1, 1), 1.0, shown_as(node, response))
        elif light["on"]:
            level = bright_pane(light, response)
            show_emission(material, tuple(float(v) / max(level) for v in level), float(max(level)))
        let_shadow_rays_through(material)
    return spared, tells


def emits(material):
    shader = principled(material)
    if shader is None or shader.inputs["Emission Strength"].default_value <= 0.0:
        return False
    colour = shader.inputs["Emission Color"]
    return max(colour.default_value[:3]) > 0.0 or bool(colour.links)


def is_strip(objects):
    """A strip or a luminous field glows as a lamp does; a window or a screen shows a picture."""
    owned = own_materials(objects)
    shows = any(any(w in name.lower() for w in PANE_WORDS) for name, _ in owned)
    return not shows and any(emits(material) for _, material in owned)


def faces_of(objects, materials):
    """Middles and areas (square metres) of the triangles of these materials."""
    middles, areas = [np.empty((0, 3), np.float32)], [np.empty(0, np.float32)]
    for obj in objects:
        slots = [i for i, slot in enumerate(obj.material_slots) if slot.material in materials]
        if not slots:
            continue
        places = np.empty(3 * len(obj.data.vertices), np.float32)
        obj.data.vertices.foreach_get("co", places)
        turn = np.array(obj.matrix_world, np.float32)
        places = places.reshape(-1, 3) @ turn[:3, :3].T + turn[:3, 3]
        obj.data.calc_loop_triangles()
        corners = np.empty(3 * len(obj.data.loop_triangles), np.int32)
        obj.data.loop_triangles.foreach_get("vertices", corners)
        of = np.empty(len(obj.data.loop_triangles), np.int32)
        obj.data.loop_triangles.foreach_get("material_index", of)
        a, b, c = places[corners.reshape(-1, 3)[np.isin(of, slots)]].transpose(1, 0, 2)
        middles.append((a + b + c) / 3.0)
        areas.append(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))
    return np.concatenate(middles), np.concatenate(areas)


def area_of(objects, materials):
    """Area of the faces of these materials, square metres."""
    return float(faces_of(objects, materials)[1].sum())


def bulb_within(light, objects, shades):
    """Where a lamp's bulb is, and the mean over its shade of the inverse square of the distance from it."""
    place = to_blender(light["position"])
    middles, areas = faces_of(objects, shades)
    if not len(areas) or areas.sum() <= 0.0:
        return None
    squares = ((middles - np.array(place, np.float32)) ** 2).sum(axis=1)
    return place, float((areas / np.maximum(squares, 1e-4)).sum() / areas.sum())


def dress_lamp(light, objects, response):
    """The shade glows as the photo shows it, at least so that it looks lit, and lets the bulb's light out.

    What emits by its material gives the lamp's light itself, from where it is: a cove up to the ceiling, a strip along its
    wall, each globe of a chandelier. The second value says whether it does.
    """
    owned = own_materials(objects)
    emitting = [material for _, material in owned if emits(material)]
    area = area_of(objects, emitting)
    radiance = None
    if area > 0.0:
        # A face of P watts has radiance P / (pi * area).
        radiance = [float(c) * light["intensity"] / (math.pi * area) for c in light["color"]]
    shining = []
    for name, material in owned:
        shader = principled(material)
        if shader is None:
            continue
        if material in emitting or any(w in name.lower() for w in EMITTER_WORDS):
            shining.append(material)
        # The bulb gives the light; an emissive slot would give it twice.
        shader.inputs["Emission Strength"].default_value = 0.0
    if not light["on"]:
        return set(), False
    spared = set()
    radius = 4.0 * light.get("radius_m", 0.05) + 0.05
    centre = None if shining else to_blender(light["position"])
    shades = [m for m in shining if m not in emitting]
    # As `is_shade` in sources.rs: what the photo tells the brightness of.
    called_so = {material for name, material in owned if "shade" in name.lower()}
    bulb = bulb_within(light, objects, shades)
    for material in shining or [m for _, m in owned]:
        shader = principled(material)
        node = base_image(shader) if shader else None
        is_shade = material in shades
        seen = light.get("shade") if is_shade or material in called_so else None
        around = bulb if is_shade else None
        if node is not None:
            if shining:
                spared.add(node.image.name)
            shown = shown_as(node, response, GLOW, seen)
            own = radiance if material in emitting else None
            show_emission(material, (1, 1, 1), 1.0, shown, centre, radius * 1.6, own, around)
        elif seen is not None:
            level = light_of(response, encode(np.array(seen)))
            top = max(float(level.max()), 1e-6)
            own = radiance if material in emitting else None
            show_emission(material, tuple(float(v) / top for v in level), top, None, None, 0.0, own, around)
        else:
            tint = np.array(light["color"])
            if shader is not None and shining:
                tint = tint * np.array(shader.inputs["Base Color"].default_value[:3])
            # What is so bright is paler in a photo than its light is.
            tint = np.sqrt(np.maximum(tint / max(float(tint.max()), 1e-6), 0.05))
            wanted = EMITTED if material in emitting else GLOW
            level = light_of(response, encode(np.minimum(tint * min(wanted / float(tint @ LUMINANCE), 1.0 / tint.max()), 1.0)))
            top = max(float(level.max()), 1e-6)
            own = radiance if material in emitting else None
            show_emission(material, tuple(float(v) / top for v in level), top, None, centre, radius * 1.6, own, around)
        if material not in emitting or radiance is None:
            let_shadow_rays_through(material)
    return spared, radiance is not None


def dress_passages(response):
    """What the photo shows through passages, and windows that are no objects, is there at the photo's brightness: the room's
    light does not reach it. What comes in from there is a light of its own."""
    spared = set()
    for material in bpy.data.materials:
        shader = principled(material)
        node = base_image(shader) if shader and material.name.startswith(BEYOND) else None
        if node is not None:
            spared.add(node.image.name)
            show_emission(material, (1, 1, 1), 1.0, shown_as(node, response))
            let_shadow_rays_through(material)
    return spared


def add_lights(scene, response, groups):
    spared = dress_passages(response)
    for index, light in enumerate(JOB["lighting"]["lights"]):
        # The room's own coves are nodes of their light's name.
        node = light["object"] or (light["id"] if light["id"].endswith("_glow") else None)
        objects = meshes_below(node) if node else []
        if light["object"] and not objects:
            NOTES.append(f"no node {light['object']} for the light {light['id']}")
        shines = tells = False
        if light["kind"] == "point" or is_strip(objects):
            own, shines = dress_lamp(light, objects, response)
            spared |= own
        elif light["kind"] == "area":
            shown, tells = dress_window(light, objects, response)
            spared |= shown
        if not light["on"]:
            continue
        group = ""
        if groups is not None:
            group = f"light_{index}"
            groups.append(group)
            for obj in objects:
                obj.lightgroup = group
        if shines:
            continue
        args = light["position"], light["intensity"], light["color"], group
        if light["kind"] == "area":
            obj = add_rectangle(scene, f"light_{index}", args[0], light["direction"], light["size_m"], *args[1:])
            if not is_strip(objects):
                keep_off(obj, objects)
            # What mirrors and polished floors show of such a window is its picture.
            obj.visible_glossy = not tells
        elif light["kind"] == "point":
            obj = add_light(scene, f"light_{index}", "POINT", *args)
            obj.data.shadow_soft_size = light["radius_m"]
            # Rays that leave a surface by chance meet the shade, not the bulb: sample the bulb alone.
            obj.data.cycles.use_multiple_importance_sampling = not objects
        else:
            obj = add_light(scene, f"light_{index}", "SUN", *args)
            obj.data.angle = math.radians(0.53)
            aim(obj, light["direction"])
    return spared


# ---------------------------------------------------------------- rendering


def set_engine(scene):
    scene.render.engine = "CYCLES"
    scene.render.dither_intensity = 0.0
    scene.render.film_transparent = False
    scene.render.use_compositing = False
    scene.render.use_sequencer = False
    if JOB["threads"]:
        scene.render.threads_mode, scene.render.threads = "FIXED", JOB["threads"]
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.seed = JOB["seed"]
    cycles.samples = JOB["samples"]
    cycles.use_adaptive_sampling = JOB["mode"] == "lit"
    cycles.adaptive_threshold = 0.05
    cycles.use_denoising = JOB["denoise"] and JOB["mode"] == "lit"
    if cycles.use_denoising:
        cycles.denoiser = "OPENIMAGEDENOISE"
        cycles.denoising_use_gpu = False
        # Albedo and normals are free of noise here (no depth of field, no motion): filtering them first is wasted.
        cycles.denoising_prefilter = "FAST"
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 8, 4, 3
    cycles.transmission_bounces, cycles.transparent_max_bounces = 6, 12
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_indirect = 10.0
    cycles.sample_clamp_direct = 0.0
    scene.display_settings.display_device = "sRGB"
    set_view(scene, JOB["view"])
    scene.view_settings.exposure = JOB["lighting"]["exposure"]
    scene.view_settings.gamma = 1.0


def nodes_of(owner):
    """The empty node tree of a new material or world (`use_nodes` is on by default, and going, in newer versions)."""
    if owner.node_tree is None:
        owner.use_nodes = True
    owner.node_tree.nodes.clear()
    return owner.node_tree


def give_ids():
    """Object index by node; material index by `node/material`, where a part is one material of a node."""
    for name, index in JOB["node_ids"].items():
        found, wanted = part_of(name)
        if not found:
            NOTES.append(f"no node {name} to give the id {index}")
        if not wanted:
            for obj in found:
                obj.pass_index = index
            continue
        for _, material in own_materials(found, wanted):
            material.pass_index = index


def render_ids(scene):
    """Every object as a flat emitter of its id, one sample at the pixel centre."""
    material = bpy.data.materials.new("ids")
    tree = nodes_of(material)
    info, emission = tree.nodes.new("ShaderNodeObjectInfo"), tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(info.outputs["Object Index"], emission.inputs["Strength"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    give_ids()
    scene.view_layers[0].material_override = material
    cycles = scene.cycles
    cycles.samples, cycles.pixel_filter_type, cycles.filter_width = 1, "BOX", 0.01
    cycles.max_bounces = 0
    world = bpy.data.worlds.new("nothing")
    nodes_of(world)
    scene.world = world
    write_exr(scene, "ids.exr", "OPEN_EXR")


def write_exr(scene, name, kind):
    settings = scene.render.image_settings
    if kind == "OPEN_EXR_MULTILAYER" and hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = kind
    settings.color_depth = "32"
    settings.exr_codec = "ZIP"
    if hasattr(settings, "use_exr_interleave"):
        # One part: files of several parts fail to open when pixels are not square.
        settings.use_exr_interleave = True
    if kind == "OPEN_EXR":
        settings.color_mode = "RGB"
    render_to(scene, name)


def report_progress(stats, *_):
    """Blender's own status line, such as `Mem: 12M | Sample 3/64`, for the program that waits."""
    if isinstance(stats, str) and "Sample " in stats:
        print("HARMONY sample " + stats.split("Sample ", 1)[1].split(" ")[0].rstrip(","), flush=True)


def render_to(scene, name):
    scene.render.filepath = os.path.join(JOB["folder"], name)
    scene.render.use_file_extension = False
    bpy.context.view_layer.update()
    if hasattr(bpy.app.handlers, "render_stats"):
        bpy.app.handlers.render_stats.append(report_progress)
    bpy.ops.render.render(write_still=True)


def main():
    scene = load_scene()
    set_engine(scene)
    set_camera(scene)
    hide_from_camera()
    triangles = sum(len(o.data.loops) - 2 * len(o.data.polygons) for o in all_meshes())
    if triangles == 0:
        raise SystemExit("the scene has no triangles")
    response, gain = ([], []), 1.0
    groups = [] if JOB["mode"] == "per_light" else None
    if JOB["mode"] != "ids":
        response = sample_response(scene, JOB["folder"])
        spared = add_lights(scene, response, groups)
        add_ambient(scene, "ambient" if groups is not None else "", response)
        true = {m.name for n in JOB["true_colors"] for _, m in own_materials(meshes_below(n))}
        if JOB["delight"]:
            gain = bright_gain(JOB["delight"], spared, true)
        if JOB["delight"] or JOB["albedo"]:
            apply_albedo(gain, JOB["albedo"], {n: part_of(n) for n in (JOB["albedo"] or {}).get("nodes", {})}, true)
        spread_in_cloth()
        clear_glass()
        show_tops(response)
        hide_boards()
    loaded = time.time()
    if JOB["mode"] == "ids":
        render_ids(scene)
    elif JOB["mode"] == "per_light":
        layer = scene.view_layers[0]
        for group in [*groups, "ambient"]:
            layer.lightgroups.add(name=group)
        give_ids()
        layer.use_pass_object_index = layer.use_pass_material_index = layer.use_pass_diffuse_color = True
        sample_views(scene, JOB["folder"], JOB["views"])
        set_view(scene, JOB["view"])
        write_exr(scene, "lights.exr", "OPEN_EXR_MULTILAYER")
    else:
        settings = scene.render.image_settings
        settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGB", "8"
        render_to(scene, "lit.png")
    result = {
        "version": bpy.app.version_string,
        "load_s": loaded - STARTED,
        "render_s": time.time() - loaded,
        "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
        "triangles": triangles,
        "albedo_gain": gain,
        "response_light": [float(v) for v in response[0]],
        "response_display": [float(v) for v in response[1]],
        "notes": NOTES,
    }
    path = os.path.join(JOB["folder"], "result.json")
    with open(path + ".part", "w", encoding="utf-8") as handle:
        json.dump(result, handle)
    os.replace(path + ".part", path)


main()
