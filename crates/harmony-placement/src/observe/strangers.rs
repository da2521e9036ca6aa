//! Pieces of a mask that lie where its object cannot be.
//!
//! Segmenters leave parts of one thing in the mask of another, and boxes, feet and outlines are read from where a mask
//! ends. A small piece whose points lie farther on the floor plan from those of the largest piece than the object is
//! wide and deep, by a factor and the map's error, is taken away (`docs/decisions/0025-sides-rows-pieces.md`). Room
//! frame, metres, heights left out. It needs a dense point map; a large piece is never taken, however far it lies.

use std::sync::Arc;

use harmony_scene::{Vec2, Vec3, components};

use crate::stats::median;
use crate::{Item, PartialScene};

/// A piece as large as this share of the largest one is never taken away.
const LARGE: f64 = 0.2;

/// How much farther than the named width and depth allow a mask may reach.
const STRETCH: f64 = 1.3;

/// Error of the point map between two parts of an object: metres, and relative to the distance from the camera.
const POINT_SLACK: (f64, f64) = (0.1, 0.05);

/// Takes from an object's mask the small pieces that stand, by the point map, farther from its largest piece than the
/// object is wide and deep: segmenters leave parts of one thing in the mask of another, and outlines and feet
/// are read from where a mask ends.
pub(crate) fn drop_strangers(scene: &PartialScene, item: &mut Item) {
    let Some(points) = scene.points.as_ref().filter(|p| p.is_dense()) else { return };
    let size = item.mask.size();
    let (labels, counts) = components(item.mask.bits(), size.width as usize, size.height as usize);
    if counts.len() <= 2 {
        return;
    }
    let mut pieces: Vec<Vec<Vec2>> = vec![Vec::new(); counts.len()];
    for (i, id) in labels.iter().enumerate().filter(|(_, id)| **id > 0) {
        let (x, y) = (i % size.width as usize, i / size.width as usize);
        let point = points.at(size, Vec2::new(x as f64 + 0.5, y as f64 + 0.5));
        pieces[*id as usize].extend(point.map(on_the_floor));
    }
    let largest = (1..counts.len()).max_by_key(|id| counts[*id]).unwrap_or(0);
    let Some(centre) = middle(&pieces[largest]) else { return };
    let mut far: Vec<f64> = pieces[largest].iter().map(|p| p.distance(centre)).collect();
    far.sort_by(f64::total_cmp);
    let reach = far[far.len() * 19 / 20];
    let named = item.size.width.hypot(item.size.depth).max(2.0 * reach);
    let slack = POINT_SLACK.0 + POINT_SLACK.1 * on_the_floor(scene.camera.centre()).distance(centre);
    let limit = STRETCH * named + slack - reach;
    let is_stranger = |id: usize| {
        let small = id > 0 && (counts[id] as f64) < LARGE * counts[largest] as f64;
        small && middle(&pieces[id]).is_some_and(|at| at.distance(centre) > limit)
    };
    let strangers: Vec<bool> = (0..counts.len()).map(is_stranger).collect();
    if strangers.contains(&true) {
        for (bit, id) in Arc::make_mut(&mut item.mask).bits_mut().iter_mut().zip(&labels) {
            *bit &= !strangers[*id as usize];
        }
    }
}

fn on_the_floor(p: Vec3) -> Vec2 {
    Vec2::new(p.x, p.z)
}

/// Median of each coordinate; `None` of nothing.
fn middle(points: &[Vec2]) -> Option<Vec2> {
    let of = |i: usize| median(&mut points.iter().map(|p| p[i]).collect::<Vec<_>>());
    (!points.is_empty()).then(|| Vec2::new(of(0), of(1)))
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Mask, PointMapKind};

    use super::*;
    use crate::RoomPoints;
    use crate::observe::raster::rasterise;
    use crate::testing::{boxed, empty_room};

    #[test]
    fn a_piece_of_what_stands_elsewhere_is_dropped_and_one_of_its_own_stays() {
        let mut scene = empty_room();
        let size = scene.camera.size;
        let plant = boxed(&scene, Vec3::new(0.5, 1.2, 0.5), Vec3::new(0.6, 0.0, 0.6), 0.0);
        let chair = boxed(&scene, Vec3::new(0.8, 0.8, 0.8), Vec3::new(2.6, 0.0, 2.8), 0.0);
        let mut depth = vec![0.0; size.pixels()];
        for (item, at) in [(&plant, Vec3::new(0.6, 0.0, 0.6)), (&chair, Vec3::new(2.6, 0.0, 2.8))] {
            rasterise(&scene.camera, item.shape.proxy(), &harmony_scene::Pose::new(at, 0.0, 1.0), &mut depth);
        }
        let point = |(i, z): (usize, &f32)| {
            let pixel = Vec2::new((i as u32 % size.width) as f64 + 0.5, (i as u32 / size.width) as f64 + 0.5);
            if *z > 0.0 { scene.camera.unproject(pixel, f64::from(*z)) } else { Vec3::NAN }
        };
        let points = RoomPoints {
            kind: PointMapKind::Relative,
            size,
            xyz: depth.iter().enumerate().map(point).collect(),
            confidence: vec![1.0; size.pixels()],
        };
        // A corner of the chair, and the plant with a gap that leaves its lowest part by itself.
        let c = chair.mask.bounds().unwrap().centre();
        let corner = Mask::from_fn(size, |x, y| {
            (f64::from(x) - c.x).abs() < 8.0 && (f64::from(y) - c.y).abs() < 8.0 && chair.mask.get(x.into(), y.into())
        });
        let foot = plant.mask.bounds().unwrap().y1 as u32 - 12;
        let gap = Mask::from_fn(size, |_, y| y == foot);
        let own = plant.mask.minus(&chair.mask).minus(&gap);
        let mut item = crate::Item { mask: Arc::new(own.or(&corner)), ..plant };
        assert_eq!(components(item.mask.bits(), size.width as usize, size.height as usize).1.len(), 4);
        drop_strangers(&scene, &mut item);
        assert_eq!(*item.mask, own.or(&corner), "without a map nothing tells");
        scene.points = Some(points);
        drop_strangers(&scene, &mut item);
        assert_eq!(*item.mask, own);
    }
}
