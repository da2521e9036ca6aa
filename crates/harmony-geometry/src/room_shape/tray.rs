//! Trays: recesses in the ceiling, often with a light hidden behind their edge.
//!
//! An outline on the lower ceiling gives the sides, along the room's axes; the map's points inside give the height, or
//! what was told does. Edges that the picture's border cuts are taken as symmetric to the opposite side. Room frame,
//! metres. Rectangles only, with level ceilings; a tray too short, or too near to a wall, is none.

use harmony_scene::{Niche, Surface, Vec2, Vec3};

use super::{MeasuredShape, ShapeHint, THINNEST, View, plane_of};
use crate::stats::median;

/// Height of the edge that hides a cove's strip from below, at most, metres and as a share of the tray's depth.
const LIP: (f64, f64) = (0.06, 0.4);
/// How far a cove's ledge goes back behind the edge, metres.
const LEDGE: f64 = 0.16;
/// What is left of the lower ceiling between a tray and a wall at least, metres.
const BESIDE_TRAY: f64 = 0.05;
/// A tray shorter than this is none, metres.
const SHORTEST_TRAY: f64 = 0.3;

impl View<'_> {
    /// A recess in the ceiling, in coordinates of the box as it was: its sides along the room from the outline's edges on
    /// the lower ceiling, its depth from the map's points inside or as told. What the picture cuts is as far from its wall
    /// as the side across.
    pub(super) fn tray(&self, hint: &ShapeHint, out: &mut MeasuredShape) {
        let e = self.extents;
        let on_ceiling: Vec<Option<Vec3>> = hint.face.iter().map(|p| self.on_level(*p, e.height)).collect();
        let seen: Vec<Vec3> = on_ceiling.iter().flatten().copied().collect();
        if seen.len() < 3 {
            out.notes.push(format!("{}: its outline is not on the ceiling; left out", hint.what));
            return;
        }
        let middle = seen.iter().sum::<Vec3>() / seen.len() as f64;
        let mut sides: [[Vec<f64>; 2]; 2] = Default::default();
        for i in 0..hint.face.len() {
            let k = (i + 1) % hint.face.len();
            let (Some(a), Some(b)) = (on_ceiling[i], on_ceiling[k]) else { continue };
            if self.along_border(hint.face[i], hint.face[k]) {
                continue;
            }
            let way = (b - a).abs();
            // An edge along x tells where the tray ends along z, and the other way round.
            let (axis, at) = if way.x > way.z { (1, f64::midpoint(a.z, b.z)) } else { (0, f64::midpoint(a.x, b.x)) };
            let high = usize::from(at > [middle.x, middle.z][axis]);
            sides[axis][high].push(at);
        }
        let mut assumed = false;
        let beside = BESIDE_TRAY + if hint.glow.is_some() { LEDGE } else { 0.0 };
        let mut range = |axis: usize, length: f64| {
            let [low, high] = [0, 1].map(|k| median(&sides[axis][k]));
            let ends =
                seen.iter().map(|p| [p.x, p.z][axis]).fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
            assumed |= low.is_none() || high.is_none();
            let (low, high) = match (low, high) {
                (Some(low), Some(high)) => (low, high),
                (Some(low), None) => (low, (length - low).max(ends.1)),
                (None, Some(high)) => ((length - high).min(ends.0), high),
                (None, None) => ends,
            };
            [low.max(beside), high.min(length - beside)]
        };
        let (x, z) = (range(0, e.width), range(1, e.depth));
        if (x[1] - x[0]).min(z[1] - z[0]) < SHORTEST_TRAY {
            out.notes.push(format!("{}: nothing is left of it where it was measured; left out", hint.what));
            return;
        }
        if assumed {
            out.notes.push(format!("{}: the picture cuts it; there it ends as far from the wall as across", hint.what));
        }
        let above: Vec<f64> = self.points(&hint.face).iter().map(|p| p.y - e.height).collect();
        let believed = |d: &f64| *d > THINNEST && (d / hint.depth).ln().abs() < 1.2;
        let measured = plane_of(&above, hint.depth).filter(believed);
        if measured.is_none() {
            let depth = hint.depth;
            out.notes.push(format!("{}: its depth of {depth:.2} m is as told, nothing measures it", hint.what));
        }
        let top = e.height + measured.unwrap_or(hint.depth);
        let mut niche = |glow: Option<[f32; 3]>, by: f64, from: f64, to: f64| {
            out.shape.niches.push(Niche {
                kind: hint.what.clone(),
                surface: Surface::Ceiling,
                sides: None,
                glow,
                min: Vec3::new(x[0] - by, from, z[0] - by),
                max: Vec3::new(x[1] + by, to, z[1] + by),
            });
        };
        if hint.glow.is_none() {
            niche(None, 0.0, e.height, top);
        } else {
            let lip = e.height + LIP.0.min(LIP.1 * (top - e.height));
            niche(None, 0.0, e.height, lip);
            niche(hint.glow, LEDGE, lip, top);
        }
    }

    /// Where a pixel's ray meets a height above the camera.
    fn on_level(&self, pixel: Vec2, height: f64) -> Option<Vec3> {
        let ray = self.camera.ray(pixel);
        let k = (height - ray.origin.y) / ray.direction.y;
        (k.is_finite() && k > 0.05 && k < 50.0).then(|| ray.at(k))
    }

    /// Whether an edge of an outline is one with the picture's border.
    fn along_border(&self, a: Vec2, b: Vec2) -> bool {
        let size = self.camera.size;
        let (w, h) = (f64::from(size.width), f64::from(size.height));
        let margin = BORDER * w.max(h);
        let both = |near: &dyn Fn(Vec2) -> bool| near(a) && near(b);
        both(&|p| p.x < margin) || both(&|p| p.y < margin) || both(&|p| p.x > w - margin) || both(&|p| p.y > h - margin)
    }
}

/// An edge of an outline this near to the picture's border is cut by it, share of the picture's longer side.
const BORDER: f64 = 0.006;

#[cfg(test)]
mod tests {
    use harmony_scene::RoomShape;

    use super::super::tests::{camera, hint, map, room};
    use super::super::{MapInRoom, ShapeKind, measure_shape};
    use super::*;

    #[test]
    fn a_tray_is_measured_and_goes_on_beyond_the_picture() {
        let box_of = |min: [f64; 3], max: [f64; 3]| Niche {
            kind: "it".into(),
            surface: Surface::Ceiling,
            sides: None,
            glow: None,
            min: min.into(),
            max: max.into(),
        };
        let truth = room(RoomShape { niches: vec![box_of([0.7, 2.6, 0.8], [4.4, 2.78, 4.2])], ..RoomShape::default() });
        let camera = camera();
        // What is in the picture of its opening: the camera stands under it.
        let corners = [[0.7, 0.8], [4.4, 0.8], [4.4, 4.2], [0.7, 4.2]].map(|[x, z]| Vec3::new(x, 2.6, z));
        let before = harmony_scene::clipped(&corners, |p| camera.depth(p) - 0.1);
        let flat: Vec<Vec3> = before.iter().filter_map(|p| camera.project(*p)).map(|p| p.extend(0.0)).collect();
        let size = (f64::from(camera.size.width), f64::from(camera.size.height));
        let inside = [0, 1, 2, 3].into_iter().fold(flat, |polygon, k| {
            harmony_scene::clipped(&polygon, |p| match k {
                0 => p.x,
                1 => size.0 - p.x,
                2 => p.y,
                _ => size.1 - p.y,
            })
        });
        let face: Vec<Vec2> = inside.iter().map(|p| p.truncate()).collect();
        let mut told = hint(ShapeKind::Tray, face, 0.25, [false; 4]);
        let points = map(&truth, &camera, Vec3::ZERO);
        let seen = MapInRoom { size: camera.size, xyz: &points };
        let found = measure_shape(&[told.clone()], &camera, &truth.extents, Some(seen));
        let [tray] = found.shape.niches.as_slice() else { panic!("{found:?}") };
        assert_eq!(tray.surface, Surface::Ceiling);
        assert!((tray.max.y - 2.78).abs() < 0.02, "{tray:?}");
        assert!((tray.min.x - 0.7).abs() < 0.03 && (tray.min.z - 0.8).abs() < 0.03, "{tray:?}");
        // Its front is behind the camera: as far from the front wall as its back from the back wall.
        assert!((tray.max.z - (5.0 - tray.min.z)).abs() < 1e-9, "{tray:?}");
        assert!(found.notes.iter().any(|n| n.contains("cuts")), "{:?}", found.notes);

        // A cove: the opening's edge hides a ledge, on which the light lies.
        told.glow = Some([1.0, 0.8, 0.6]);
        let found = measure_shape(&[told], &camera, &truth.extents, None);
        let [lip, cove] = found.shape.niches.as_slice() else { panic!("{found:?}") };
        assert_eq!((lip.glow, cove.glow), (None, Some([1.0, 0.8, 0.6])));
        assert!((cove.max.y - 2.85).abs() < 1e-9 && cove.min.y == lip.max.y && lip.max.y > 2.63);
        assert!(cove.min.x < lip.min.x - 0.1 && cove.max.z > lip.max.z + 0.1);
    }
}
