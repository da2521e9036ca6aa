//! Which pixels of the photo show a bare face of the room.

use glam::DVec2;
use harmony_imaging::rectify::{SurfaceRect, surface_texture};
use harmony_imaging::tile::Fineness;
use harmony_placement::RoomPoints;
use harmony_scene::{Camera, Extents, ImageSize, Mask, RoomFaces, Surface};
use image::{RgbImage, Rgba, RgbaImage};

use crate::state::SceneState;
use crate::steps::features;
use crate::views;

/// Margin around what was found, as a share of the photo's width: masks end short, and edges mix colours.
const MARGIN: f64 = 1.0 / 170.0;
/// Strips between objects that are narrower than twice this share of the width show edges only.
const SLIVER: f64 = 1.0 / 300.0;
/// Those narrower than twice this share are nooks: they show the light, and shadows whose shapes are not the face's.
const NOOK: f64 = 1.0 / 90.0;
/// A point that far before a face, metres or as a share of its depth, is not on it.
const OFF_FACE: f64 = 0.08;
const OFF_FACE_SHARE: f64 = 0.03;
/// Where the points of a face lie further from it than this in the middle, they say nothing about it, metres.
const MAX_OFFSET: f64 = 0.25;
/// Points no further from a face than this may be its own, metres.
const NEAR_FACE: f64 = 0.12;
/// Points of a face that are needed to judge the others.
const MIN_POINTS: usize = 200;
/// How far the line between two faces may be off, pixels and metres.
const SEAM_PX: f64 = 1.5;
const SEAM: f64 = 0.01;

/// Pixels that show neither an object (found, left out or drawn) nor what is next to one, nor the photo's empty frame,
/// nor anything that the point map has before the room's faces; where nobody looked (`is_seen`) that is paint on them.
pub fn bare_pixels(state: &SceneState, is_seen: bool) -> Bare {
    let size = state.partial.camera.size;
    let px = |share: f64| (share * f64::from(size.width)).round() as i32;
    let margin = px(MARGIN).max(3);
    let taken = state
        .all_objects()
        .dilated(margin)
        .or(&drawn(state).dilated(margin / 2))
        .or(&state.photo_frame.dilated(margin));
    let mut bare = without_slivers(&Mask::from_fn(size, |_, _| true).minus(&taken), px(SLIVER).max(2));
    if is_seen {
        let off = before_faces(state, &bare, own_offset);
        bare = without_slivers(&bare.minus(&off.dilated(1)), px(SLIVER).max(2));
    }
    let open = without_slivers(&bare, px(NOOK).max(4));
    Bare { bare, open }
}

/// Pixels in which an object of the scene, or what is built into the room, is drawn.
fn drawn(state: &SceneState) -> Mask {
    let size = state.partial.camera.size;
    let ids = views::ids(state);
    let objects = Mask::from_fn(size, |x, y| ids[(y * size.width + x) as usize] != 0);
    features::pixels(state).iter().fold(objects, |all, mask| all.or(mask))
}

/// All pixels that show what a point map has before the room's faces; none without a map.
pub fn standing(state: &SceneState) -> Mask {
    let all = Mask::from_fn(state.partial.camera.size, |_, _| true);
    before_faces(state, &all.minus(&state.photo_frame), |distances| Some(near_offset(distances)))
}

/// Those of the pixels that show what a point map has before the room's faces, which are where `offset` of their points'
/// distances says, by so much and give or take so much; `None` for a face of which nothing shall be said.
fn before_faces(state: &SceneState, of: &Mask, offset: fn(&[f64]) -> Option<(f64, f64)>) -> Mask {
    match &state.partial.points {
        Some(points) if points.is_dense() => {
            off_faces(points, &state.partial.camera, &state.partial.room.faces(), of, offset)
        }
        _ => Mask::empty(of.size()),
    }
}

/// Those of them that are no object's.
pub fn unnamed(state: &SceneState) -> Mask {
    standing(state).minus(&state.all_objects()).minus(&drawn(state))
}

/// Pixels that show bare faces.
pub struct Bare {
    /// All of them.
    pub bare: Mask,
    /// Those of them that are not in nooks between objects.
    pub open: Mask,
}

/// A mask without what is nowhere wider than twice the radius.
fn without_slivers(mask: &Mask, radius: i32) -> Mask {
    mask.dilated(-radius).dilated(radius).and(mask)
}

/// The middle of a face's points, where most of them are bare: a face that is a little off has none of its pixels taken
/// away, and one that is far off none either.
fn own_offset(distances: &[f64]) -> Option<(f64, f64)> {
    if distances.len() < MIN_POINTS {
        return None;
    }
    let middle = median(&mut distances.to_vec());
    let spread = median(&mut distances.iter().map(|d| (d - middle).abs()).collect::<Vec<_>>());
    (middle.abs() <= MAX_OFFSET).then_some((middle, spread))
}

/// The middle of those of a face's points that are near it, where most of them may be those of things before it.
fn near_offset(distances: &[f64]) -> (f64, f64) {
    let near: Vec<f64> = distances.iter().copied().filter(|d| d.abs() < NEAR_FACE).collect();
    own_offset(&near).unwrap_or_default()
}

/// Pixels whose points lie before the face that the room has there.
fn off_faces(
    points: &RoomPoints,
    camera: &Camera,
    faces: &RoomFaces,
    of: &Mask,
    offset: fn(&[f64]) -> Option<(f64, f64)>,
) -> Mask {
    let grid = points.size;
    let photo = camera.size;
    let place = |i: usize| {
        let (x, y) = (i % grid.width as usize, i / grid.width as usize);
        DVec2::new(
            (x as f64 + 0.5) * f64::from(photo.width) / f64::from(grid.width),
            (y as f64 + 0.5) * f64::from(photo.height) / f64::from(grid.height),
        )
    };
    let measured: Vec<Option<(Surface, f64, f64)>> = (0..points.xyz.len().min(grid.pixels()))
        .map(|i| {
            let at = place(i);
            let p = points.xyz[i];
            let known = points.confidence.get(i).is_some_and(|c| *c > 0.0) && p.is_finite();
            if !known || !of.get(at.x as i64, at.y as i64) {
                return None;
            }
            let there = faces.exit(&camera.ray(at))?;
            Some((there.surface, (p - there.point).dot(there.normal), camera.depth(p).max(0.0)))
        })
        .collect();
    let mut off = vec![false; grid.pixels()];
    for surface in Surface::ALL {
        let distances: Vec<f64> = measured.iter().flatten().filter(|m| m.0 == surface).map(|m| m.1).collect();
        let Some((middle, spread)) = offset(&distances) else { continue };
        for (flag, m) in off.iter_mut().zip(&measured) {
            if let Some((_, distance, depth)) = m.filter(|m| m.0 == surface) {
                *flag |= distance - middle > OFF_FACE.max(OFF_FACE_SHARE * depth).max(4.0 * spread);
            }
        }
    }
    Mask::from_fn(grid, |x, y| off[(y * grid.width + x) as usize]).resized(photo)
}

fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Alpha of texels that tell the light only.
pub const NOOK_ALPHA: u8 = 160;

/// A face of the room as the photo shows it.
pub struct Face {
    /// Which.
    pub surface: Surface,
    /// Opaque where the bare face was seen, half opaque in nooks ([`NOOK_ALPHA`]).
    pub texture: RgbaImage,
    /// How finely the photo shows it.
    pub fineness: Fineness,
    /// Texels a metre.
    pub px_per_m: f64,
}

impl Face {
    /// The face in the photo.
    pub fn seen(
        source: &RgbImage,
        camera: &Camera,
        faces: &RoomFaces,
        surface: Surface,
        px_per_m: f64,
        Bare { bare, open }: &Bare,
    ) -> Self {
        let rect = SurfaceRect::whole(surface, faces.extents());
        let mut texture = surface_texture(source, camera, faces, &rect, px_per_m, bare);
        let kept = surface_texture(source, camera, faces, &rect, px_per_m, open);
        for (p, k) in texture.pixels_mut().zip(kept.pixels()) {
            if p.0[3] > 0 && k.0[3] == 0 {
                p.0[3] = NOOK_ALPHA;
            }
        }
        let size = ImageSize::new(texture.width(), texture.height());
        let point =
            |at: DVec2| faces.point(surface, face_point(surface, faces.extents(), size, at.x - 0.5, at.y - 0.5)).0;
        let (width, height) = (size.width as usize, size.height as usize);
        let fineness = Fineness::of(width, height, |at| camera.project(point(at)));
        Self { surface, texture, fineness, px_per_m }
    }

    /// Face coordinates of a texel's centre, metres.
    fn uv(&self, extents: &Extents, x: f64, y: f64) -> DVec2 {
        face_point(self.surface, extents, ImageSize::new(self.texture.width(), self.texture.height()), x, y)
    }

    /// Forgets the texels along the face's edges, where the line between two faces may be a little off.
    pub fn without_seams(&mut self, camera: &Camera, faces: &RoomFaces) {
        let extents = faces.extents();
        let face = self.surface.size(extents);
        let focal = camera.intrinsics.fx.max(1.0);
        let centre = camera.centre();
        let (width, height) = self.texture.dimensions();
        for y in 0..height {
            for x in 0..width {
                if self.texture.get_pixel(x, y).0[3] == 0 {
                    continue;
                }
                let uv = self.uv(extents, f64::from(x), f64::from(y));
                let edge = uv.min_element().min((face - uv).min_element());
                if edge > 0.15 {
                    continue;
                }
                let (p, normal) = faces.point(self.surface, uv);
                let slant = (p - centre).normalize_or_zero().dot(normal).abs().max(0.15);
                let limit = SEAM.max(SEAM_PX * camera.depth(p).max(0.0) / focal / slant).min(0.12);
                if edge < limit {
                    self.texture.put_pixel(x, y, Rgba([0; 4]));
                }
            }
        }
    }

    /// Forgets the texels of a wall between two heights, metres.
    pub fn without_heights(&mut self, extents: &Extents, low: f64, high: f64) {
        let (width, height) = self.texture.dimensions();
        for y in 0..height {
            let v = self.uv(extents, 0.0, f64::from(y)).y;
            if v > low && v < high {
                (0..width).for_each(|x| self.texture.put_pixel(x, y, Rgba([0; 4])));
            }
        }
    }
}

/// Face coordinates of a texel's centre.
fn face_point(surface: Surface, extents: &Extents, size: ImageSize, x: f64, y: f64) -> DVec2 {
    let face = surface.size(extents);
    let (s, t) = ((x + 0.5) / f64::from(size.width), (y + 0.5) / f64::from(size.height));
    let v = if surface.wall().is_some() { 1.0 - t } else { t };
    DVec2::new(s * face.x, v * face.y)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_scene::{Intrinsics, PointMapKind};

    use super::*;

    fn camera() -> Camera {
        let size = ImageSize::new(160, 120);
        let lens = Intrinsics::from_horizontal_fov(size, 1.2);
        Camera::looking(size, lens, DVec3::new(2.0, 1.4, 4.5), DVec3::new(0.0, -0.1, -1.0))
    }

    #[test]
    fn what_stands_before_a_wall_is_not_on_it_and_a_wall_that_is_off_loses_nothing() {
        let extents = Extents { width: 4.0, height: 2.5, depth: 5.0 };
        let camera = camera();
        let all = Mask::from_fn(camera.size, |_, _| true);
        // The walls lie 6 cm nearer than the room has them; a chest of 40 cm stands before the back wall.
        let chest = |x: u32, y: u32| (60..90).contains(&x) && (40..60).contains(&y);
        let xyz = (0..camera.size.pixels())
            .map(|i| {
                let (x, y) = (i as u32 % 160, i as u32 / 160);
                let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
                let (surface, p) = extents.exit(&ray).unwrap();
                let before = if chest(x, y) { 0.4 } else { 0.06 };
                p + surface.normal() * before
            })
            .collect();
        let points = RoomPoints {
            kind: PointMapKind::Metric,
            size: camera.size,
            xyz,
            confidence: vec![1.0; camera.size.pixels()],
        };
        let off = off_faces(&points, &camera, &extents.into(), &all, own_offset);
        for (i, flag) in off.bits().iter().enumerate() {
            assert_eq!(*flag, chest(i as u32 % 160, i as u32 / 160), "{i}");
        }
    }

    #[test]
    fn a_face_that_things_hide_for_the_most_part_is_where_its_own_points_are() {
        let distances: Vec<f64> = (0..2000).map(|i| if i % 10 < 3 { 0.03 } else { 0.6 }).collect();
        assert_eq!(near_offset(&distances), (0.03, 0.0));
        assert_eq!(own_offset(&distances), None);
        assert_eq!(near_offset(&[0.5; 1000]), (0.0, 0.0));
    }

    #[test]
    fn slivers_and_seams_are_no_evidence() {
        let size = ImageSize::new(100, 60);
        let mask = Mask::from_fn(size, |x, _| x < 40 || (60..63).contains(&x));
        let kept = without_slivers(&mask, 3);
        assert!(kept.get(10, 10) && kept.get(39, 10) && !kept.get(61, 10));

        let extents = Extents { width: 4.0, height: 2.5, depth: 5.0 };
        let camera = camera();
        let all = Mask::from_fn(camera.size, |_, _| true);
        let photo = RgbImage::from_pixel(160, 120, image::Rgb([100; 3]));
        // The whole back wall is seen, from column 28 to 132.
        let open = Mask::from_fn(camera.size, |x, _| x < 120);
        let bare = Bare { bare: all, open };
        let mut face = Face::seen(&photo, &camera, &extents.into(), Surface::Back, 100.0, &bare);
        let alphas: std::collections::BTreeSet<u8> = face.texture.pixels().map(|p| p.0[3]).collect();
        assert_eq!(alphas.into_iter().collect::<Vec<_>>(), [NOOK_ALPHA, 255]);
        let bottom = face.texture.height() - 1;
        assert_eq!(face.texture.get_pixel(200, bottom).0[3], 255);
        face.without_seams(&camera, &extents.into());
        face.without_heights(&extents, 1.0, 1.2);
        // 1.5 pixels of 117 px focal length at 4.5 m are 6 cm.
        assert_eq!(face.texture.get_pixel(200, bottom).0[3], 0);
        assert_eq!(face.texture.get_pixel(200, bottom - 4).0[3], 0);
        assert_eq!(face.texture.get_pixel(200, bottom - 20).0[3], 255);
        assert_eq!(face.texture.get_pixel(200, bottom - 110).0[3], 0);
    }
}
