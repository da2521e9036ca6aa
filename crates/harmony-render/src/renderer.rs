//! The rasteriser's front door.

use std::fmt;
use std::sync::{LazyLock, Mutex, PoisonError};

use harmony_scene::{Camera, PixelBox};
use image::RgbaImage;
use rayon::prelude::*;

use crate::assemble::{Layout, Piece, Projected, assemble, project};
use crate::glass::{self, opaque_pieces};
use crate::mips::MipCache;
use crate::prepare::Draw;
use crate::raster::Band;
use crate::resolve;
use crate::{DepthFrame, Frame, Glass, Instance, RenderOptions, Window, WindowFrame};

/// Draws frames, and keeps the texture pyramids and buffers that the next frame needs again.
///
/// One value can be shared by threads. Textures are recognised by their `Arc`, and let go at the end of a pass when
/// nobody else holds them.
#[derive(Default)]
pub struct Renderer {
    textures: MipCache,
    scratch: Mutex<Vec<Scratch>>,
}

impl fmt::Debug for Renderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Renderer").field("textures", &self.textures).finish_non_exhaustive()
    }
}

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

    fn draw(&self, camera: &Camera, instances: &[Instance], options: &RenderOptions, window: Window) -> Frame {
        let draw = Draw::new(camera, instances, options.near, window, &self.textures);
        // Pyramids are made here, in parallel, so that no band waits for another band's texture.
        draw.runs.par_iter().filter_map(|r| r.texture.as_ref()).for_each(|t| t.build());
        let n = window.size.pixels();
        let (mut depth, mut ids) = (vec![0.0; n], vec![0; n]);
        let mut color = options.background.repeat(n);
        self.pass(&draw, &mut depth, &mut ids, Some(&mut color), options);
        drop(draw);
        self.textures.sweep();
        let color = RgbaImage::from_raw(window.size.width, window.size.height, color)
            .expect("the buffer was made with four bytes a pixel of this size");
        Frame { size: window.size, color, depth, ids }
    }

    fn draw_depth(
        &self,
        camera: &Camera,
        instances: &[Instance],
        options: &RenderOptions,
        window: Window,
    ) -> DepthFrame {
        let draw = Draw::new(camera, instances, options.near, window, &self.textures);
        let n = window.size.pixels();
        let (mut depth, mut ids) = (vec![0.0; n], vec![0; n]);
        self.pass(&draw, &mut depth, &mut ids, None, options);
        drop(draw);
        self.textures.sweep();
        DepthFrame { window, depth, ids }
    }

    /// Assembles all triangles into bands of rows, then draws and shades each band by itself.
    ///
    /// `depth` and `ids` hold reciprocal depth and triangle number until their band is finished.
    fn pass(
        &self,
        draw: &Draw,
        depth: &mut [f32],
        ids: &mut [u32],
        color: Option<&mut Vec<u8>>,
        options: &RenderOptions,
    ) {
        if draw.triangles == 0 || depth.is_empty() {
            return;
        }
        let mut scratch = self.scratch.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
        let coloured = color.is_some();
        let multisample = coloured && options.multisample;
        let layout = scratch.assemble(draw, multisample);
        let window = draw.view.window;
        let width = window.size.width as usize;
        let band_pixels = width << layout.band_shift;
        let mut empty = Vec::new();
        let color = color.unwrap_or(&mut empty);
        let colors: Vec<&mut [u8]> = if coloured {
            color.chunks_mut(band_pixels * 4).collect()
        } else {
            (0..layout.bands).map(|_| Default::default()).collect()
        };
        let pieces = &scratch.pieces;
        depth.par_chunks_mut(band_pixels).zip(ids.par_chunks_mut(band_pixels)).zip(colors).enumerate().for_each(
            |(i, ((depth, ids), color))| {
                let mine = || pieces.iter().skip(i).step_by(layout.bands).map(Vec::as_slice);
                let (x0, y0) = (window.x0 as i32, window.y0 as i32 + (i << layout.band_shift) as i32);
                let height = depth.len() / width;
                let mut band = Band { x0, y0, width, height, offset: [0, 0], inverse_depth: depth, triangle: ids };
                band.clear();
                mine().for_each(|p| band.draw(draw, &p[..opaque_pieces(draw, p)]));
                let clear = draw.opaque < draw.triangles;
                if coloured {
                    let mut samples = if multisample {
                        resolve::multisampled(draw, options, x0, y0, width, &mine(), color)
                    } else {
                        resolve::single(draw, options, &band, color);
                        if clear { vec![([0, 0], band.inverse_depth.to_vec())] } else { Vec::new() }
                    };
                    if clear {
                        glass::blend(draw, options, [x0, y0], width, &mut samples, &mine(), color);
                    }
                }
                if clear {
                    let rest = mine().map(|p| &p[opaque_pieces(draw, p)..]);
                    match options.glass {
                        Glass::Solid => rest.for_each(|p| band.draw(draw, p)),
                        Glass::Clear { backdrop } => glass::claim(draw, &mut band, backdrop, &rest.collect::<Vec<_>>()),
                    }
                }
                resolve::finish(draw, &mut band);
            },
        );
        self.scratch.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    }
}

/// Buffers that are kept between passes.
#[derive(Default)]
struct Scratch {
    projected: Vec<Projected>,
    /// Pieces by task and band, bands fastest.
    pieces: Vec<Vec<Piece>>,
}

impl Scratch {
    fn assemble(&mut self, draw: &Draw, multisample: bool) -> Layout {
        project(draw, &mut self.projected);
        // How the work is cut does not change the result, only the time.
        let threads = rayon::current_num_threads() as u32;
        let rows = draw.view.window.size.height;
        let band_shift = (rows / (8 * threads)).clamp(8, 64).ilog2();
        let bands = rows.div_ceil(1 << band_shift) as usize;
        let layout = Layout { band_shift, bands, spread: if multisample { resolve::SPREAD } else { 0 } };
        let share = (draw.triangles / (4 * threads)).clamp(4096, 65_536);
        let tasks = draw.triangles.div_ceil(share) as usize;
        self.pieces.resize_with(tasks * bands, Vec::new);
        let projected = &self.projected;
        self.pieces.par_chunks_mut(bands).enumerate().for_each(|(task, bands)| {
            bands.iter_mut().for_each(Vec::clear);
            let from = task as u32 * share;
            assemble(draw, projected, from, from.saturating_add(share).min(draw.triangles), layout, bands);
        });
        layout
    }
}

/// The renderer behind the free functions: buffers and texture pyramids carry over between calls anywhere in the
/// process; textures that nobody holds any more are forgotten at the end of each call.
fn shared() -> &'static Renderer {
    static SHARED: LazyLock<Renderer> = LazyLock::new(Renderer::new);
    &SHARED
}

/// [`Renderer::render`] of a renderer that the whole process shares.
pub fn render(camera: &Camera, instances: &[Instance], options: &RenderOptions) -> Frame {
    shared().render(camera, instances, options)
}

/// [`Renderer::render_window`] of a renderer that the whole process shares.
pub fn render_window(
    camera: &Camera,
    instances: &[Instance],
    options: &RenderOptions,
    window: PixelBox,
) -> WindowFrame {
    shared().render_window(camera, instances, options, window)
}

/// [`Renderer::render_depth_ids`] of a renderer that the whole process shares.
pub fn render_depth_ids(camera: &Camera, instances: &[Instance], options: &RenderOptions) -> DepthFrame {
    shared().render_depth_ids(camera, instances, options)
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
        if c.z.is_nan() || c.z < near {
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
