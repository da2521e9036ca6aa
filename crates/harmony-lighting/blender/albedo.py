"""Base colours become reflectances: one gain for the scene, and a field of factors for each node.

A field is a coarse image in the photo's frame: what the photo shows over what the lit scene shows, smoothed within
the node. It lies on the surfaces as the photo's camera would project it; away from the frame it fades to its mean.
"""

import bpy
import numpy as np
from mathutils import Matrix, Vector

from textures import MAX_ALBEDO, name_in_file, principled

GROUP = "photo_frame"
GLOSSES = ("Specular IOR Level", "Sheen Weight")
# Share of the frame's size over which a field fades to its mean beyond the frame.
FADE = 3.0
# By how much a channel may be above the largest base colour and is clipped alone: white walls in warm light stay white.
OVER = 1.25


def place_camera(camera):
    """An empty in the pose of the photo's camera: x right, y up, z backwards."""
    right, down, forward = (Vector((row[0], -row[2], row[1])) for row in camera["rotation"])
    pose = Matrix((right, -down, -forward)).transposed().to_4x4()
    c = camera["centre"]
    pose.translation = (c[0], -c[2], c[1])
    empty = bpy.data.objects.new("photo_frame", None)
    empty.matrix_world = pose
    bpy.context.scene.collection.objects.link(empty)
    return empty


def math(tree, operation, *values):
    """A math node; values are sockets or numbers. Returns its output."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, values):
        if isinstance(value, (int, float)):
            socket.default_value = value
        else:
            tree.links.new(value, socket)
    return node.outputs[0]


def vector(tree, operation, *values):
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = operation
    for socket, value in zip(node.inputs, values):
        if isinstance(value, tuple):
            socket.default_value = value
        else:
            tree.links.new(value, socket)
    return node.outputs[0]


def frame_group(camera):
    """Node group: where a shaded point lies in the photo (0 to 1, y up), and how far its field counts there."""
    group = bpy.data.node_groups.new(GROUP, "ShaderNodeTree")
    group.interface.new_socket("UV", in_out="OUTPUT", socket_type="NodeSocketVector")
    group.interface.new_socket("Weight", in_out="OUTPUT", socket_type="NodeSocketFloat")
    coordinates = group.nodes.new("ShaderNodeTexCoord")
    coordinates.object = place_camera(camera)
    split = group.nodes.new("ShaderNodeSeparateXYZ")
    group.links.new(coordinates.outputs["Object"], split.inputs[0])
    depth = math(group, "MAXIMUM", math(group, "MULTIPLY", split.outputs[2], -1.0), 0.05)
    w, h = camera["width"], camera["height"]
    axes = []
    for index, (focal, centre) in enumerate(((camera["fx"] / w, camera["cx"] / w), (camera["fy"] / h, 1 - camera["cy"] / h))):
        ratio = math(group, "DIVIDE", split.outputs[index], depth)
        axes.append(math(group, "MULTIPLY_ADD", ratio, focal, centre))
    weight = math(group, "LESS_THAN", split.outputs[2], -0.05)
    for axis in axes:
        out = math(group, "SUBTRACT", math(group, "ABSOLUTE", math(group, "SUBTRACT", axis, 0.5)), 0.5)
        inside = math(group, "SUBTRACT", 1.0, math(group, "MULTIPLY", math(group, "MAXIMUM", out, 0.0), FADE))
        weight = math(group, "MULTIPLY", weight, math(group, "MAXIMUM", inside, 0.0))
    join = group.nodes.new("ShaderNodeCombineXYZ")
    group.links.new(axes[0], join.inputs[0])
    group.links.new(axes[1], join.inputs[1])
    output = group.nodes.new("NodeGroupOutput")
    group.links.new(join.outputs[0], output.inputs["UV"])
    group.links.new(weight, output.inputs["Weight"])
    return group


def field_image(name, columns, rows, factors):
    image = bpy.data.images.new(f"field_{name}", columns, rows, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.ones((rows, columns, 4), dtype=np.float32)
    # Blender's rows go up.
    pixels[..., :3] = np.array(factors, dtype=np.float32).reshape(rows, columns, 3)[::-1]
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    return image


def bounded(tree, color):
    """A colour of which no channel is above MAX_ALBEDO by more than a little: all channels give way together, for a yellow that
    is clipped channel by channel turns green."""
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(color, split.inputs[0])
    largest = math(tree, "MAXIMUM", math(tree, "MAXIMUM", split.outputs[0], split.outputs[1]), split.outputs[2])
    most = OVER * MAX_ALBEDO
    share = math(tree, "DIVIDE", most, math(tree, "MAXIMUM", largest, most))
    join = tree.nodes.new("ShaderNodeCombineXYZ")
    for axis in join.inputs:
        tree.links.new(share, axis)
    return vector(tree, "MULTIPLY", color, join.outputs[0])


def scale_base(material, gain, mean, image=None, group=None, gloss=1.0):
    """base colour := min(base colour * gain * field, MAX_ALBEDO); specular reflection and sheen scaled by `gloss`."""
    shader = principled(material)
    if shader is None:
        return
    if gloss < 1.0:
        for name in GLOSSES:
            if name in shader.inputs:
                shader.inputs[name].default_value *= gloss
    tree, socket = material.node_tree, shader.inputs["Base Color"]
    factor = tuple(float(gain * m) for m in mean)
    if image is not None:
        frame = tree.nodes.new("ShaderNodeGroup")
        frame.node_tree = group
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image, texture.extension, texture.interpolation = image, "EXTEND", "Cubic"
        tree.links.new(frame.outputs["UV"], texture.inputs["Vector"])
        off = vector(tree, "SUBTRACT", texture.outputs["Color"], tuple(mean))
        wide = tree.nodes.new("ShaderNodeCombineXYZ")
        for axis in wide.inputs:
            tree.links.new(frame.outputs["Weight"], axis)
        field = vector(tree, "MULTIPLY_ADD", off, wide.outputs[0], tuple(mean))
        factor = vector(tree, "MULTIPLY", field, (gain, gain, gain))
    base = socket.links[0].from_socket if socket.links else tuple(socket.default_value[:3])
    scaled = bounded(tree, vector(tree, "MULTIPLY", base, factor))
    tree.links.new(vector(tree, "MINIMUM", scaled, (MAX_ALBEDO,) * 3), socket)


def apply_albedo(gain, albedo, parts, true):
    """Scales every base colour; `parts`: the mesh objects of each part that has a field, and its material ("" = all).

    `true`: materials that stay as they are.
    """
    done = set(true)
    if albedo:
        group = frame_group(albedo["camera"])
        # A part that is one material comes before what it is a part of.
        for name, (objects, wanted) in sorted(parts.items(), key=lambda p: ("/" not in p[0], p[0])):
            cells = albedo["nodes"][name]
            image = None
            if cells["factors"]:
                image = field_image(name, albedo["columns"], albedo["rows"], cells["factors"])
            owned = {}
            for obj in objects:
                if obj.data.users > 1:
                    obj.data = obj.data.copy()
                for slot in obj.material_slots:
                    old = slot.material
                    if old is None or old.name in done or (wanted and name_in_file(old) != wanted):
                        continue
                    if old.name not in owned:
                        owned[old.name] = old.copy()
                        scale_base(owned[old.name], gain, cells["mean"], image, group, cells["gloss"])
                        done.add(owned[old.name].name)
                    slot.material = owned[old.name]
    other = albedo["other"] if albedo else (1.0, 1.0, 1.0)
    for material in list(bpy.data.materials):
        if material.name not in done:
            scale_base(material, gain, other)
