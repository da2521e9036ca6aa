//! How strongly a pattern shows: a program says two or three near tones of wool, wood or plaster, and the photo has more
//! between them.
//!
//! Within small squares of the image that one material fills, the spread of brightness that the photo has, its noise
//! taken off, is held against that of the scene as it was said; a pattern that is too faint is made stronger. Light and
//! folds do not count: in each square the best plane is taken out first.

use std::sync::Arc;

use harmony_imaging::color::{linear_from_rgb8, rgb8_from_linear};
use harmony_mesh::{Mesh, Tile};
use harmony_render::{Glass, Instance, Lighting, RenderOptions, Stands, render};
use harmony_scene::Camera;
use image::{RgbImage, Rgba, RgbaImage};

/// Side of the squares, pixels.
const SIDE: u32 = 8;
/// Fewest squares that a material must fill.
const FEWEST: usize = 12;
/// Factor on a pattern below which nothing is changed, and the largest.
const FACTORS: [f64; 2] = [1.2, 3.0];
/// Share of a pattern's own variance that must be left within the squares: of checks as large as these nothing is.
const LEFT: f64 = 0.03;
/// Largest standard deviation that a pattern is given, of the logarithm of luminance: what is finer than the photo's pixels
/// would be dots from nearby.
const STRONGEST: f64 = 0.3;
/// Of all squares of a photo, the share that has no more spread than its noise.
const STILL: f64 = 0.1;
/// Linear luminance between which noise is measured.
const EXPOSED: [f64; 2] = [0.03, 0.8];

/// Meshes whose patterns are made as strong as the photo shows them; `None` where nothing changes.
pub fn as_seen(shell: &Mesh, stands: &[Stands<'_>], camera: &Camera, photo: &RgbImage) -> Vec<Option<Arc<Mesh>>> {
    let patterned = |s: &Stands<'_>, m: usize| {
        s.visible.is_some() && s.plain.get(m) == Some(&true) && s.mesh.materials[m].tile.is_some()
    };
    // The number of a material in the frame of ids, from 2; 1 is everything else.
    let mut slots = Vec::new();
    for (k, stand) in stands.iter().enumerate() {
        slots.extend((0..stand.mesh.materials.len()).filter(|m| patterned(stand, *m)).map(|m| (k, m)));
    }
    let mut made: Vec<Option<Arc<Mesh>>> = vec![None; stands.len()];
    if slots.is_empty() {
        return made;
    }
    let number = |k: usize, m: usize| slots.iter().position(|slot| *slot == (k, m)).map_or(1, |i| i as u32 + 2);
    let pieces: Vec<(usize, u32, Mesh)> = (stands.iter().enumerate())
        .flat_map(|(k, stand)| numbered(stand.mesh, |m| number(k, m)).into_iter().map(move |(n, mesh)| (k, n, mesh)))
        .collect();
    let posed = pieces.iter().map(|(k, n, mesh)| Instance::posed(mesh, &stands[*k].pose, *n));
    let instances: Vec<Instance<'_>> = std::iter::once(Instance::in_room(shell, 1)).chain(posed).collect();
    let options =
        RenderOptions { lighting: Lighting::Unlit, multisample: true, glass: Glass::Solid, ..RenderOptions::default() };
    let frame = render(camera, &instances, &options);
    let noise = noise(photo);
    let blocks = squares(photo.dimensions());
    for (i, (k, m)) in slots.iter().enumerate() {
        let Some(visible) = stands[*k].visible else { continue };
        let width = photo.width() as usize;
        let shows = |[x0, y0]: &[u32; 2]| {
            (*y0..y0 + SIDE).all(|y| {
                let row = y as usize * width + *x0 as usize;
                let (ids, seen) =
                    (frame.ids.get(row..row + SIDE as usize), visible.bits().get(row..row + SIDE as usize));
                ids.is_some_and(|ids| ids.iter().all(|id| *id == i as u32 + 2))
                    && seen.is_some_and(|s| !s.contains(&false))
            })
        };
        let own: Vec<[u32; 2]> = blocks.iter().filter(|at| shows(at)).copied().collect();
        let middle = |spread: &dyn Fn([u32; 2]) -> f64| median(own.iter().map(|at| spread(*at)).collect());
        let seen = middle(&|at| spread(at, |x, y| linear_from_rgb8(photo.get_pixel(x, y).0)));
        let said = middle(&|at| spread(at, |x, y| linear_from_rgb8(rgb(*frame.color.get_pixel(x, y)))));
        let Some(tile) = &stands[*k].mesh.materials[*m].tile else { continue };
        let (Some(seen), Some(said)) = (seen, said) else { continue };
        let own_spread = whole(&tile.color);
        if own.len() < FEWEST || said < LEFT * own_spread || said <= 0.0 {
            continue;
        }
        let most = FACTORS[1].min(STRONGEST / own_spread.sqrt());
        let factor = ((seen - noise).max(0.0) / said).sqrt().min(most);
        if factor > FACTORS[0] {
            let mesh = made[*k].get_or_insert_with(|| Arc::new(stands[*k].mesh.clone()));
            let color = Arc::new(stronger(&tile.color, factor as f32));
            Arc::make_mut(mesh).materials[*m].tile = Some(Arc::new(Tile { color, ..Tile::clone(tile) }));
        }
    }
    made
}

/// A mesh taken apart by the numbers of its materials, without light on it: what frames of ids tell apart.
pub(super) fn numbered(mesh: &Mesh, number: impl Fn(usize) -> u32) -> Vec<(u32, Mesh)> {
    let mut numbers: Vec<u32> = mesh.groups.iter().map(|group| number(group.material)).collect();
    numbers.sort_unstable();
    numbers.dedup();
    let part = |n: u32| {
        let groups = mesh.groups.iter().filter(|group| number(group.material) == n).cloned().collect();
        (n, Mesh { groups, colors: Vec::new(), ..mesh.clone() })
    };
    numbers.into_iter().map(part).collect()
}

/// Upper left corners of the squares of an image.
fn squares((width, height): (u32, u32)) -> Vec<[u32; 2]> {
    let rows = 0..height / SIDE;
    rows.flat_map(|y| (0..width / SIDE).map(move |x| [x * SIDE, y * SIDE])).collect()
}

/// Variance of a photo's noise, of the logarithm of luminance.
fn noise(photo: &RgbImage) -> f64 {
    let at = |x: u32, y: u32| linear_from_rgb8(photo.get_pixel(x, y).0);
    let exposed = |[x, y]: &[u32; 2]| (EXPOSED[0]..=EXPOSED[1]).contains(&luminance(at(x + SIDE / 2, y + SIDE / 2)));
    let mut spreads: Vec<f64> =
        squares(photo.dimensions()).into_iter().filter(exposed).map(|square| spread(square, at)).collect();
    let still = (STILL * spreads.len() as f64) as usize;
    if still >= spreads.len() { 0.0 } else { *spreads.select_nth_unstable_by(still, f64::total_cmp).1 }
}

/// Variance of the logarithm of luminance in a square round its best plane.
fn spread([x0, y0]: [u32; 2], at: impl Fn(u32, u32) -> [f32; 3]) -> f64 {
    let (n, half) = (f64::from(SIDE * SIDE), f64::from(SIDE - 1) / 2.0);
    let (mut sum, mut squares, mut along) = (0.0, 0.0, [0.0; 2]);
    for (i, j) in (0..SIDE).flat_map(|i| (0..SIDE).map(move |j| (i, j))) {
        let v = (luminance(at(x0 + i, y0 + j)) + 2e-3).ln();
        sum += v;
        squares += v * v;
        along[0] += v * (f64::from(i) - half);
        along[1] += v * (f64::from(j) - half);
    }
    // Each axis has the sum of squares n (SIDE^2 - 1) / 12.
    let axis = n * (f64::from(SIDE * SIDE) - 1.0) / 12.0;
    ((squares - sum * sum / n - (along[0] * along[0] + along[1] * along[1]) / axis) / n).max(0.0)
}

/// The same of a whole picture, without a plane.
fn whole(picture: &RgbaImage) -> f64 {
    let logs = picture.pixels().map(|p| (luminance(linear_from_rgb8(rgb(*p))) + 2e-3).ln());
    let (n, sum, squares) = logs.fold((0.0, 0.0, 0.0), |(n, sum, squares), v| (n + 1.0, sum + v, squares + v * v));
    if n > 0.0 { (squares / n - (sum / n) * (sum / n)).max(0.0) } else { 0.0 }
}

/// A picture whose colours are farther from their mean by a factor.
fn stronger(picture: &RgbaImage, factor: f32) -> RgbaImage {
    let mut mean = [0.0f64; 3];
    for p in picture.pixels() {
        mean.iter_mut().zip(linear_from_rgb8(rgb(*p))).for_each(|(m, v)| *m += f64::from(v));
    }
    let n = f64::from(picture.width()) * f64::from(picture.height());
    let mean = mean.map(|m| (m / n.max(1.0)) as f32);
    let mut made = picture.clone();
    for p in made.pixels_mut() {
        let old = linear_from_rgb8(rgb(*p));
        // No texel is darker than a tenth of the mean: fibres, not holes.
        let [r, g, b] =
            rgb8_from_linear([0, 1, 2].map(|c| (mean[c] + (old[c] - mean[c]) * factor).clamp(0.1 * mean[c], 1.0)));
        *p = Rgba([r, g, b, p.0[3]]);
    }
    made
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

fn luminance([r, g, b]: [f32; 3]) -> f64 {
    f64::from(0.2126 * r + 0.7152 * g + 0.0722 * b)
}

fn rgb(Rgba([r, g, b, _]): Rgba<u8>) -> [u8; 3] {
    [r, g, b]
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec2, Vec3};
    use harmony_mesh::{Group, Material};
    use harmony_scene::{ImageSize, Intrinsics, Mask, Pose};

    use super::*;

    /// Noise of two tones, one texel each, by a small generator.
    fn fleck(low: u8, high: u8) -> RgbaImage {
        let mut state = 7u32;
        RgbaImage::from_fn(64, 64, |_, _| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let v = if state >> 31 == 1 { high } else { low };
            Rgba([v, v, v, 255])
        })
    }

    /// A square metre that faces the camera from two metres, with a tile of 64 texels on `across` metres.
    fn sheet(color: RgbaImage, across: f32) -> Mesh {
        let corners = [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 1.0, 0.0], [-0.5, 1.0, 0.0]];
        let mut material = Material::plain("wool", [1.0; 3]);
        material.tile =
            Some(Arc::new(Tile { size: [across; 2], turn: 0.0, color: Arc::new(color), normal: None, surface: None }));
        let mut mesh = Mesh {
            positions: corners.map(Vec3::from).to_vec(),
            uvs: corners.map(|c| Vec2::new(c[0] + 0.5, 1.0 - c[1])).to_vec(),
            metric_uvs: corners.map(|c| Vec2::new(c[0] + 0.5, 1.0 - c[1])).to_vec(),
            groups: vec![Group { material: 0, triangles: vec![[0, 1, 2], [0, 2, 3]] }],
            materials: vec![material],
            ..Mesh::default()
        };
        mesh.recompute_normals();
        mesh
    }

    fn camera() -> Camera {
        let size = ImageSize::new(160, 160);
        Camera::looking(size, Intrinsics::from_horizontal_fov(size, 0.6), DVec3::new(0.0, 0.5, 2.0), DVec3::NEG_Z)
    }

    fn spread_of(mesh: &Mesh) -> f64 {
        whole(&mesh.materials[0].tile.as_ref().unwrap().color).sqrt()
    }

    /// What becomes of a sheet in front of a photo of another.
    fn seen(said: &Mesh, real: &Mesh) -> Option<Arc<Mesh>> {
        let (camera, pose) = (camera(), Pose::new(DVec3::ZERO, 0.0, 1.0));
        let shot = render(&camera, &[Instance::posed(real, &pose, 2)], &RenderOptions::default());
        // A smooth wall behind it.
        let photo = RgbImage::from_fn(160, 160, |x, y| {
            let shown = shot.ids[(y * 160 + x) as usize] == 2;
            image::Rgb(if shown { rgb(*shot.color.get_pixel(x, y)) } else { [150; 3] })
        });
        let visible = Mask::from_fn(camera.size, |_, _| true);
        let stands = [Stands { mesh: said, pose, visible: Some(&visible), plain: &[true] }];
        as_seen(&Mesh::default(), &stands, &camera, &photo).remove(0)
    }

    #[test]
    fn a_faint_pattern_becomes_as_strong_as_the_photos() {
        let (faint, strong) = (sheet(fleck(140, 150), 0.5), sheet(fleck(130, 160), 0.5));
        let made = seen(&faint, &strong).expect("it is changed");
        assert!((spread_of(&made) / spread_of(&strong) - 1.0).abs() < 0.2, "{}", spread_of(&made));
        let mean = |mesh: &Mesh| {
            let tile = mesh.materials[0].tile.as_ref().unwrap();
            tile.color.pixels().map(|p| f64::from(p.0[0])).sum::<f64>() / 4096.0
        };
        assert!((mean(&made) - mean(&faint)).abs() < 1.5, "the colour stays");
        assert!(seen(&strong, &faint).is_none(), "what the photo hardly shows may be too fine for it");
        assert!(seen(&strong, &strong).is_none());
    }

    #[test]
    fn large_checks_are_no_grain() {
        let checks = RgbaImage::from_fn(64, 64, |x, y| {
            let v = if (x / 32 + y / 32).is_multiple_of(2) { 120 } else { 160 };
            Rgba([v, v, v, 255])
        });
        assert!(seen(&sheet(checks, 1.0), &sheet(fleck(110, 170), 0.5)).is_none());
    }
}
