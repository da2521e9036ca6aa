//! The silhouette step, the depth step, and the floor contact that stands in where there is no depth.

use harmony_scene::{Pose, Vec2, Vec3};

use crate::anchoring::{Anchoring, Frame};
use crate::formulas::{angular_size, corrected_depth, front_surface_depth, lateral_shift, metric_scale};
use crate::view::View;

/// One step changes a size by at most this factor: a wrong silhouette must not throw the object out of reach.
const LARGEST_FACTOR: f64 = 1.6;

/// Fewest pixels on either side for a front-surface mean.
pub(crate) const FEWEST_DEPTHS: usize = 12;

fn bounded(factor: f64) -> f64 {
    if factor.is_finite() { factor.clamp(1.0 / LARGEST_FACTOR, LARGEST_FACTOR) } else { 1.0 }
}

/// Offset of the outline's centre to the mask's along one axis and the ratio of their extents, from the free edges.
fn axis(mask: (f64, f64), outline: (f64, f64), free: (bool, bool)) -> (Option<f64>, Option<f64>) {
    match free {
        (true, true) => {
            let size = outline.1 - outline.0;
            let ratio = if size > 0.5 { Some((mask.1 - mask.0) / size) } else { None };
            (Some((mask.0 + mask.1 - outline.0 - outline.1) / 2.0), ratio)
        }
        (true, false) => (Some(mask.0 - outline.0), None),
        (false, true) => (Some(mask.1 - outline.1), None),
        (false, false) => (None, None),
    }
}

/// Image-space alignment: lateral position, and the angular size at the present depth. Paper: Sec. 3.3.
///
/// Departs from the paper in two ways. Only free edges of the mask speak: one that is cut by the image border or
/// by another object says nothing. The height joins the width, and gives the vertical position of what hangs.
pub(crate) fn silhouette_step(frame: &Frame, view: &View, pose: &Pose) -> Pose {
    let camera = &frame.scene.camera;
    let proxy = frame.item.shape.proxy();
    let Some(outline) = view.compare(proxy, pose).outline else { return *pose };
    let b = &view.mask_box;
    let f = view.free;
    let (du, wide) = axis((b.x0, b.x1), (outline.x0, outline.x1), (f[0], f[2]));
    let (dv, high) = axis((b.y0, b.y1), (outline.y0, outline.y1), (f[1], f[3]));
    let depth = camera.depth(pose.position).max(0.1);
    let k = camera.intrinsics;
    let mut next = *pose;
    if let Some(du) = du {
        next.position += camera.right() * lateral_shift(du, depth, k.fx);
    }
    if matches!(frame.anchoring, Anchoring::OnWall(_))
        && let Some(dv) = dv
    {
        next.position += camera.down() * lateral_shift(dv, depth, k.fy);
    }
    if !frame.item.traits.heavily_occluded {
        resize(frame, pose, &mut next, wide, high);
    }
    frame.settle(&next)
}

/// Brings the angular size to the mask's, at the depth the object has.
fn resize(frame: &Frame, pose: &Pose, next: &mut Pose, wide: Option<f64>, high: Option<f64>) {
    if frame.item.traits.may_stretch || frame.item.traits.planar {
        if let Some(high) = high {
            next.stretch.y *= bounded(high);
        }
        if let Some(wide) = wide {
            // The outline's width is made of width and depth; who shows more of it takes more of the change.
            let right = frame.scene.camera.right();
            let across = pose.linear() * Vec3::X;
            let share = across.normalize_or(Vec3::X).dot(right).powi(2);
            let share = if frame.item.traits.as_wide_as_deep { 1.0 } else { share };
            next.stretch.x *= bounded(wide).powf(share);
            if !matches!(frame.anchoring, Anchoring::OnWall(_)) {
                next.stretch.z *= bounded(wide).powf(1.0 - share);
            }
        }
        return;
    }
    let ratio = match (wide, high) {
        (Some(w), Some(h)) if w > 0.0 && h > 0.0 => Some((w * h).sqrt()),
        (Some(r), _) | (None, Some(r)) => Some(r),
        (None, None) => None,
    };
    if let Some(ratio) = ratio {
        next.scale = rescaled(frame, pose, ratio);
    }
}

/// The scale whose angular size is `ratio` times the present one: `s = α Z / w_obj` with `α = ratio * s w_obj / Z`.
fn rescaled(frame: &Frame, pose: &Pose, ratio: f64) -> f64 {
    let camera = &frame.scene.camera;
    let (fx, depth) = (camera.intrinsics.fx, camera.depth(pose.position).max(0.1));
    let canonical_width = frame.item.shape.extent().x;
    let width_px = bounded(ratio) * fx * pose.scale * canonical_width / depth;
    metric_scale(angular_size(width_px, fx), depth, canonical_width)
}

/// Moves along a direction and keeps the angular size.
fn moved(frame: &Frame, pose: &Pose, by: Vec3) -> Pose {
    let camera = &frame.scene.camera;
    let before = camera.depth(pose.position).max(0.1);
    let mut next = *pose;
    next.position += by;
    let after = camera.depth(next.position).max(0.1);
    next.scale *= bounded(after / before);
    frame.settle(&next)
}

/// Depth-space alignment on a dense point map: `Z'` from the front-surface means, then `s`. Paper: Sec. 3.3.
pub(crate) fn depth_step(frame: &Frame, view: &View, pose: &Pose) -> Option<Pose> {
    let (reference, rendered) = view.front_depths(frame.item.shape.proxy(), pose);
    if reference.len() < FEWEST_DEPTHS || rendered.len() < FEWEST_DEPTHS {
        return None;
    }
    let camera = &frame.scene.camera;
    let depth = camera.depth(pose.position);
    let after = corrected_depth(depth, front_surface_depth(&reference)?, front_surface_depth(&rendered)?);
    let forward = camera.forward();
    Some(moved(frame, pose, forward * (after - depth)))
}

/// Height of the plane on which an object's base stands (or from which it hangs), when it is level.
fn contact_plane(frame: &Frame, pose: &Pose) -> Option<(f64, bool)> {
    match frame.anchoring {
        Anchoring::Floor => Some((0.0, false)),
        Anchoring::OnHost { .. } => Some((pose.position.y, false)),
        Anchoring::Ceiling => Some((frame.scene.room.extents.height, true)),
        Anchoring::AgainstWall(_) | Anchoring::OnWall(_) => None,
    }
}

/// Depth from contact: the mask's lowest (under the ceiling: highest) free edge lies where the base meets its plane.
///
/// Not in the paper, which has a point map always; this is what makes a photo alone enough.
pub(crate) fn contact_step(frame: &Frame, view: &View, pose: &Pose) -> Option<Pose> {
    let (height, above) = contact_plane(frame, pose)?;
    if !view.free[if above { 1 } else { 3 }] {
        return None;
    }
    let camera = &frame.scene.camera;
    let outline = view.compare(frame.item.shape.proxy(), pose).outline?;
    let b = &view.mask_box;
    let u = outline.centre().x;
    let (wanted, drawn) = if above { (b.y0, outline.y0) } else { (b.y1, outline.y1) };
    let there = plane_hit(frame, Vec2::new(u, wanted), height)?;
    let here = plane_hit(frame, Vec2::new(u, drawn), height)?;
    let mut by = there - here;
    by.y = 0.0;
    let limit = 0.5 * camera.depth(pose.position).max(0.2);
    if by.length() > limit {
        by *= limit / by.length();
    }
    Some(moved(frame, pose, by))
}

/// Where the ray of a pixel meets a level plane, within reach of the room.
pub(crate) fn plane_hit(frame: &Frame, pixel: Vec2, height: f64) -> Option<Vec3> {
    let ray = frame.scene.camera.ray(pixel);
    let k = (height - ray.origin.y) / ray.direction.y;
    let reach = 2.0 * frame.scene.room.extents.as_vec().length();
    (k.is_finite() && k > 0.05 && k < reach).then(|| ray.at(k))
}
