"""Base colours of the imported materials: finding them, and the gain that makes reflectances of them."""

import re

import bpy
import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
# A base colour never reflects more than this: multiple bounces would not end.
MAX_ALBEDO = 0.9


def name_in_file(material):
    """The material's name in the GLB: Blender numbers those that share one."""
    return re.sub(r"\.\d{3,}$", "", material.name)


def principled(material):
    if not material or not material.node_tree:
        return None
    return next((n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED"), None)


def base_image(shader):
    """The image behind a Principled node's base colour, and its node."""
    seen, queue = set(), [link.from_node for link in shader.inputs["Base Color"].links]
    while queue:
        node = queue.pop(0)
        if node in seen:
            continue
        seen.add(node)
        if node.type == "TEX_IMAGE" and node.image:
            return node
        queue += [link.from_node for socket in node.inputs for link in socket.links]
    return None


def decode(v):
    return np.where(v <= 0.04045, v / 12.92, ((np.maximum(v, 0.0) + 0.055) / 1.055) ** 2.4)


def encode(v):
    return np.where(v <= 0.0031308, v * 12.92, 1.055 * np.maximum(v, 0.0) ** (1 / 2.4) - 0.055)


def material_areas():
    """Surface area in the room by material name."""
    areas = {}
    for obj in [o for o in bpy.data.objects if o.type == "MESH"]:
        mesh = obj.data
        count = len(mesh.polygons)
        if count == 0 or not obj.material_slots:
            continue
        area, index = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.int32)
        mesh.polygons.foreach_get("area", area)
        mesh.polygons.foreach_get("material_index", index)
        scale = abs(obj.matrix_world.to_3x3().determinant()) ** (2 / 3)
        for i, slot in enumerate(obj.material_slots):
            if slot.material:
                areas[slot.material.name] = areas.get(slot.material.name, 0.0) + float(area[index == i].sum()) * scale
    return areas


def bright_gain(options, spared, true):
    """The one gain on all base colours that brings the scene's bright end to `bright_albedo`.

    Textures cut from the photo hold its light: their level says nothing about reflectance, but something in a room
    is nearly white. `spared`: images that are pictures of light (panes, shades), which do not count, nor do the materials
    `true`, whose colours come from no photo.
    """
    samples, weights, images = [], [], {}
    areas = material_areas()
    for material in bpy.data.materials:
        shader, area = principled(material), areas.get(material.name, 0.0)
        if shader is None or area <= 0.0 or material.name in true:
            continue
        node = base_image(shader)
        if node is not None and node.image.name in spared:
            continue
        if node is not None:
            images.setdefault(node.image.name, [node.image, 0.0])[1] += area
        elif not shader.inputs["Base Color"].links:
            samples.append(np.array([np.dot(np.array(shader.inputs["Base Color"].default_value[:3]), LUMINANCE)]))
            weights.append(np.array([area]))
    for image, area in images.values():
        width, height = image.size
        if width == 0 or height == 0:
            continue
        pixels = np.empty(width * height * 4, dtype=np.float32)
        image.pixels.foreach_get(pixels)
        pixels = pixels.reshape(-1, 4)[:: max(1, width * height // 4096)]
        rgb = decode(pixels[:, :3])
        # Unused texture space (alpha 0 or pure black) says nothing about light.
        values = (rgb @ LUMINANCE)[(pixels[:, 3] > 0.5) & (rgb.max(axis=1) > 1e-4)]
        samples.append(values)
        weights.append(np.full(len(values), area / max(1, len(values))))
    if not samples or sum(len(s) for s in samples) == 0:
        return 1.0
    samples, weights = np.concatenate(samples), np.concatenate(weights)
    order = np.argsort(samples, kind="stable")
    share = np.cumsum(weights[order]) / weights.sum()
    bright = float(samples[order][min(np.searchsorted(share, 0.95), len(order) - 1)])
    return float(np.clip(options["bright_albedo"] / max(bright, 1e-3), 1 / options["max_gain"], options["max_gain"]))
