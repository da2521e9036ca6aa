"""View transforms, sampled: how Blender's colour management shows scene-linear light."""

import os

import bpy
import numpy as np

TRANSFORMS = {
    "standard": ("Standard", "None"),
    "filmic": ("Filmic", "None"),
    "filmic_high_contrast": ("Filmic", "High Contrast"),
    "agx": ("AgX", "None"),
    "agx_high_contrast": ("AgX", "AgX - Medium High Contrast"),
    "agx_punchy": ("AgX", "AgX - Punchy"),
}
# Samples of a table on each axis, and the light they span: 2^LOW and 2^HIGH; see `light_at`.
GRID, LOW, HIGH = 24, -9.0, 5.0


def set_view(scene, name):
    transform, look = TRANSFORMS[name]
    settings = scene.view_settings
    settings.look = "None"
    settings.view_transform = transform
    for spelling in (look, f"{transform} - {look}"):
        try:
            settings.look = spelling
            return
        except TypeError:
            continue
    raise SystemExit(f"this Blender has no look {look} of {transform}")


def displayed(scene, light, path):
    """Display values (0 to 1, sRGB encoded) of an array of linear RGB (rows, columns, 3), at exposure 0."""
    rows, columns = light.shape[:2]
    ramp = bpy.data.images.new("ramp", columns, rows, float_buffer=True)
    ramp.colorspace_settings.name = "Linear Rec.709"
    pixels = np.ones((rows, columns, 4), dtype=np.float32)
    pixels[..., :3] = light
    ramp.pixels.foreach_set(pixels.ravel())
    exposure, scene.view_settings.exposure = scene.view_settings.exposure, 0.0
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGB", "16"
    ramp.save_render(path, scene=scene)
    settings.color_depth = "8"
    scene.view_settings.exposure = exposure
    saved = bpy.data.images.load(path)
    saved.colorspace_settings.name = "Non-Color"
    back = np.empty(rows * columns * 4, dtype=np.float32)
    saved.pixels.foreach_get(back)
    bpy.data.images.remove(saved)
    bpy.data.images.remove(ramp)
    return back.reshape(rows, columns, 4)[..., :3]


def sample_response(scene, folder):
    """Display values of grey light under the scene's view."""
    light = np.exp2(np.linspace(-11.0, 7.0, 361)).astype(np.float32)
    light[0] = 0.0
    grey = np.repeat(light[None, :, None], 3, axis=2)
    shown = displayed(scene, grey, os.path.join(folder, "ramp.png"))[0, :, 1]
    return light, np.maximum.accumulate(shown)


def light_at(s):
    """Light at a place 0 to 1 of a table's axis: logarithmic, and black at 0."""
    return np.exp2(LOW + s * (HIGH - LOW)) - 2.0**LOW


def sample_views(scene, folder, names):
    """Writes `views.f32`: for each view GRID^3 display values, red fastest, little-endian floats."""
    if not names:
        return
    axis = light_at(np.linspace(0.0, 1.0, GRID)).astype(np.float32)
    blue, green, red = np.meshgrid(axis, axis, axis, indexing="ij")
    light = np.stack([red, green, blue], axis=3).reshape(GRID * GRID, GRID, 3)
    tables = []
    for name in names:
        set_view(scene, name)
        tables.append(displayed(scene, light, os.path.join(folder, "ramp.png")).astype("<f4").ravel())
    np.concatenate(tables).tofile(os.path.join(folder, "views.f32"))
