"""Base colours of the imported materials: finding them, and taking some of the photo's own light out of them."""

import bpy
import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
# A base colour never reflects more than this: multiple bounces would not end.
MAX_ALBEDO = 0.9


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


def cells(values, count):
    """Block means of a 2-D array on at most count x count cells."""
    rows = np.array_split(np.arange(values.shape[0]), min(count, values.shape[0]))
    columns = np.array_split(np.arange(values.shape[1]), min(count, values.shape[1]))
    starts = [r[0] for r in rows], [c[0] for c in columns]
    sums = np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)
    return sums / (np.array([len(r) for r in rows])[:, None] * np.array([len(c) for c in columns])[None, :])


def stretch(small, shape):
    """Bilinear enlargement with clamped borders."""
    def axis(n, m):
        at = np.clip((np.arange(m) + 0.5) * n / m - 0.5, 0, n - 1)
        low = np.floor(at).astype(int)
        return low, np.minimum(low + 1, n - 1), (at - low).astype(np.float32)

    r0, r1, rk = axis(small.shape[0], shape[0])
    c0, c1, ck = axis(small.shape[1], shape[1])
    wide = small[:, c0] * (1 - ck) + small[:, c1] * ck
    return wide[r0] * (1 - rk)[:, None] + wide[r1] * rk[:, None]


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


def delight(options, spared):
    """Flattens textures, then one gain for all base colours; returns the gain. `spared`: images left alone."""
    areas = material_areas()
    images, plain, samples, weights = {}, [], [], []
    for material in bpy.data.materials:
        shader, area = principled(material), areas.get(material.name, 0.0)
        if shader is None or area <= 0.0:
            continue
        node = base_image(shader)
        if node is None:
            socket = shader.inputs["Base Color"]
            if not socket.links:
                plain.append(socket)
                samples.append(np.array([np.dot(np.array(socket.default_value[:3]), LUMINANCE)]))
                weights.append(np.array([area]))
            continue
        if node.image.name in spared:
            continue
        images.setdefault(node.image.name, [node.image, 0.0])[1] += area
    loaded = []
    for image, area in images.values():
        width, height = image.size
        if width == 0 or height == 0:
            continue
        pixels = np.empty(width * height * 4, dtype=np.float32)
        image.pixels.foreach_get(pixels)
        pixels = pixels.reshape(height, width, 4)
        rgb = decode(pixels[..., :3]).astype(np.float32)
        # Unused texture space (alpha 0 or pure black) says nothing about light.
        used = ((pixels[..., 3] > 0.5) & (rgb.max(axis=2) > 1e-4)).astype(np.float32)
        lum = rgb @ LUMINANCE
        share = cells(used, 6)
        smooth = cells(lum * used, 6) / np.maximum(share, 1e-3)
        total = float(used.sum())
        if total < 1:
            continue
        mean = float((lum * used).sum()) / total
        smooth = np.where(share > 0.05, smooth, mean)
        ratio = np.clip(mean / np.maximum(smooth, 1e-3), 0.25, 4.0) ** options["flatten"]
        rgb *= stretch(ratio.astype(np.float32), lum.shape)[..., None]
        loaded.append((image, pixels, rgb))
        values = (rgb @ LUMINANCE)[used > 0.5]
        values = values[:: max(1, len(values) // 4096)]
        samples.append(values)
        weights.append(np.full(len(values), area / max(1, len(values))))
    if not samples:
        return 1.0
    samples, weights = np.concatenate(samples), np.concatenate(weights)
    order = np.argsort(samples, kind="stable")
    share = np.cumsum(weights[order]) / weights.sum()
    bright = float(samples[order][min(np.searchsorted(share, 0.95), len(order) - 1)])
    gain = float(np.clip(options["bright_albedo"] / max(bright, 1e-3), 1 / options["max_gain"], options["max_gain"]))
    for image, pixels, rgb in loaded:
        pixels[..., :3] = encode(np.minimum(rgb * gain, MAX_ALBEDO))
        image.pixels.foreach_set(pixels.ravel())
        image.update()
    for socket in plain:
        value = np.array(socket.default_value[:3]) * gain
        socket.default_value = (*(value * min(1.0, MAX_ALBEDO / max(value.max(), 1e-6))), 1.0)
    return gain
