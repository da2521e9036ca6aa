//! The rasteriser's front door.

use harmony_scene::{Camera, PixelBox};
use image::RgbaImage;

use crate::{DepthFrame, Frame, Instance, RenderOptions, Window, WindowFrame};

/// Draws frames, and keeps the texture pyramids and buffers that the next frame needs again.
///
/// One value can be shared by threads. Textures are recognised by their `Arc`; drop the renderer to free them.
#[derive(Debug, Default)]
pub struct Renderer {}

impl Renderer {
    /// With nothing cached.
    pub fn new() -> Self {
        Self::default()
    }

    /// Colour, depth and ids of the whole image.
    pub fn render(&self, camera: &Camera, instances: &[Instance], options: &RenderOptions) -> Frame {
        self.draw(camera, instances, options, Window::full(camera.size))
    }

    /// The same of a part of the image; every pixel equals that of [`Renderer::render`].
    pub fn render_window(
        &self,
        camera: &Camera,
        instances: &[Instance],
        options: &RenderOptions,
        window: PixelBox,
    ) -> WindowFrame {
        let window = Window::covering(camera.size, &window);
        WindowFrame { window, frame: self.draw(camera, instances, options, window) }
    }

    /// Depth and ids only, the fast path.
    pub fn render_depth_ids(&self, camera: &Camera, instances: &[Instance], options: &RenderOptions) -> DepthFrame {
        self.draw_depth(camera, instances, options, Window::full(camera.size))
    }

    /// Depth and ids of a part of the image.
    pub fn render_depth_ids_window(
        &self,
        camera: &Camera,
        instances: &[Instance],
        options: &RenderOptions,
        window: PixelBox,
    ) -> DepthFrame {
        self.draw_depth(camera, instances, options, Window::covering(camera.size, &window))
    }

    fn draw(&self, _camera: &Camera, _instances: &[Instance], options: &RenderOptions, window: Window) -> Frame {
        let n = window.size.pixels();
        let color = RgbaImage::from_pixel(window.size.width, window.size.height, image::Rgba(options.background));
        Frame { size: window.size, color, depth: vec![0.0; n], ids: vec![0; n] }
    }

    fn draw_depth(
        &self,
        _camera: &Camera,
        _instances: &[Instance],
        _options: &RenderOptions,
        window: Window,
    ) -> DepthFrame {
        let n = window.size.pixels();
        DepthFrame { window, depth: vec![0.0; n], ids: vec![0; n] }
    }
}

/// [`Renderer::render`] with nothing cached.
pub fn render(camera: &Camera, instances: &[Instance], options: &RenderOptions) -> Frame {
    Renderer::new().render(camera, instances, options)
}

/// [`Renderer::render_window`] with nothing cached.
pub fn render_window(
    camera: &Camera,
    instances: &[Instance],
    options: &RenderOptions,
    window: PixelBox,
) -> WindowFrame {
    Renderer::new().render_window(camera, instances, options, window)
}

/// [`Renderer::render_depth_ids`] with nothing cached.
pub fn render_depth_ids(camera: &Camera, instances: &[Instance], options: &RenderOptions) -> DepthFrame {
    Renderer::new().render_depth_ids(camera, instances, options)
}

/// The box of the image that an instance can touch, cut to the image, or `None` when it is not in view.
///
/// From the projected vertices; the whole image when a part of the mesh is nearer than `near` metres.
pub fn projected_window(camera: &Camera, instance: &Instance, near: f64) -> Option<PixelBox> {
    let mut b: Option<PixelBox> = None;
    let (mut behind, mut front) = (false, false);
    for p in &instance.mesh.positions {
        let room = instance.linear * p.as_dvec3() + instance.translation;
        let c = camera.to_camera(room);
        if !(c.z >= near) {
            behind = true;
            continue;
        }
        front = true;
        let k = &camera.intrinsics;
        let (x, y) = (k.fx * c.x / c.z + k.cx, k.fy * c.y / c.z + k.cy);
        let o = b.get_or_insert(PixelBox { x0: x, y0: y, x1: x, y1: y });
        *o = PixelBox { x0: o.x0.min(x), y0: o.y0.min(y), x1: o.x1.max(x), y1: o.y1.max(y) };
    }
    if !front {
        return None;
    }
    let whole = Window::full(camera.size).pixel_box();
    let cut = if behind { whole } else { b?.clamped(camera.size) };
    (cut.area() > 0.0).then_some(cut)
}
