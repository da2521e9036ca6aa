//! The silhouette step, the depth step, and the floor contact that stands in where there is no depth.
//!
//! The paper's coupled steps (Sec. 3.3): the mask's free edges give the lateral place and the angular size, the map's
//! front surface the depth and with it the size, by the formulas of [`super::formulas`]. All moves are in the room
//! along the camera's axes (metres) and end on the support. Factors on a size are bounded, so that one wrong silhouette
//! throws nothing out of reach. A step is a proposal: the local solve keeps it when the energy falls.

use harmony_scene::{Pose, Vec2, Vec3};

use super::formulas::{angular_size, corrected_depth, front_surface_depth, lateral_shift, metric_scale};
use crate::observe::Window;
use crate::scene::attachment::{Attachment, PoseConstraint};

/// One step changes a size by at most this factor: a wrong silhouette must not throw the object out of reach.
const LARGEST_FACTOR: f64 = 1.6;

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
pub(crate) fn silhouette_step(constraint: &PoseConstraint, window: &Window, pose: &Pose) -> Pose {
    let camera = &constraint.scene.camera;
    let Some(outline) = window.outline.box_of(camera, &constraint.item.shape, pose) else { return *pose };
    let b = &window.mask_box;
    let f = window.free;
    let (du, wide) = axis((b.x0, b.x1), (outline.x0, outline.x1), (f[0], f[2]));
    let (dv, high) = axis((b.y0, b.y1), (outline.y0, outline.y1), (f[1], f[3]));
    let depth = camera.depth(pose.position).max(0.1);
    let k = camera.intrinsics;
    let mut next = *pose;
    if let Some(du) = du {
        next.position += camera.right() * lateral_shift(du, depth, k.fx);
    }
    if matches!(constraint.attachment, Attachment::OnWall(_))
        && let Some(dv) = dv
    {
        next.position += camera.down() * lateral_shift(dv, depth, k.fy);
    }
    if !constraint.item.traits.heavily_occluded {
        resize(constraint, pose, &mut next, wide, high);
    }
    constraint.settle(&next)
}

/// Brings the angular size to the mask's, at the depth the object has.
fn resize(constraint: &PoseConstraint, pose: &Pose, next: &mut Pose, wide: Option<f64>, high: Option<f64>) {
    if constraint.item.traits.may_stretch || constraint.item.traits.planar {
        if let Some(high) = high {
            next.stretch.y *= bounded(high);
        }
        if let Some(wide) = wide {
            // The outline's width is made of width and depth; who shows more of it takes more of the change.
            let right = constraint.scene.camera.right();
            let across = pose.linear() * Vec3::X;
            let share = across.normalize_or(Vec3::X).dot(right).powi(2);
            let share = if constraint.item.traits.as_wide_as_deep { 1.0 } else { share };
            next.stretch.x *= bounded(wide).powf(share);
            if !matches!(constraint.attachment, Attachment::OnWall(_)) {
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
        next.scale = rescaled(constraint, pose, ratio);
    }
}

/// The scale whose angular size is `ratio` times the present one: `s = α Z / w_obj` with `α = ratio * s w_obj / Z`.
fn rescaled(constraint: &PoseConstraint, pose: &Pose, ratio: f64) -> f64 {
    let camera = &constraint.scene.camera;
    let (fx, depth) = (camera.intrinsics.fx, camera.depth(pose.position).max(0.1));
    let canonical_width = constraint.item.shape.extent().x;
    let width_px = bounded(ratio) * fx * pose.scale * canonical_width / depth;
    metric_scale(angular_size(width_px, fx), depth, canonical_width)
}

/// Moves along a direction and keeps the angular size.
fn moved(constraint: &PoseConstraint, pose: &Pose, by: Vec3) -> Pose {
    let camera = &constraint.scene.camera;
    let before = camera.depth(pose.position).max(0.1);
    let mut next = *pose;
    next.position += by;
    let after = camera.depth(next.position).max(0.1);
    next.scale *= bounded(after / before);
    constraint.settle(&next)
}

/// Depth-space alignment on a dense point map: `Z'` from the front-surface means, then `s`. Paper: Sec. 3.3.
pub(crate) fn depth_step(constraint: &PoseConstraint, window: &Window, pose: &Pose) -> Option<Pose> {
    let (reference, rendered) = window.front_depths(&constraint.item.shape, pose)?;
    let camera = &constraint.scene.camera;
    let depth = camera.depth(pose.position);
    let after = corrected_depth(depth, front_surface_depth(&reference)?, front_surface_depth(&rendered)?);
    let forward = camera.forward();
    Some(moved(constraint, pose, forward * (after - depth)))
}

/// Height of the plane on which an object's base stands (or from which it hangs), when it is level.
fn contact_plane(constraint: &PoseConstraint, pose: &Pose) -> Option<(f64, bool)> {
    match constraint.attachment {
        Attachment::Floor => Some((0.0, false)),
        Attachment::OnHost { .. } | Attachment::OnLedge(_) => Some((pose.position.y, false)),
        Attachment::Ceiling => Some((constraint.scene.room.ceiling_over(pose.position), true)),
        Attachment::AgainstWall(_) | Attachment::OnWall(_) => None,
    }
}

/// Depth from contact: the mask's lowest (under the ceiling: highest) free edge lies where the base meets its plane.
///
/// Not in the paper, which has a point map always; this is what makes a photo alone enough.
pub(crate) fn contact_step(constraint: &PoseConstraint, window: &Window, pose: &Pose) -> Option<Pose> {
    let (height, above) = contact_plane(constraint, pose)?;
    if !window.free[if above { 1 } else { 3 }] {
        return None;
    }
    let camera = &constraint.scene.camera;
    let outline = window.outline.box_of(camera, &constraint.item.shape, pose)?;
    let b = &window.mask_box;
    let u = outline.centre().x;
    let (wanted, drawn) = if above { (b.y0, outline.y0) } else { (b.y1, outline.y1) };
    let there = constraint.plane_hit(Vec2::new(u, wanted), height)?;
    let here = constraint.plane_hit(Vec2::new(u, drawn), height)?;
    let mut by = there - here;
    by.y = 0.0;
    let limit = 0.5 * camera.depth(pose.position).max(0.2);
    if by.length() > limit {
        by *= limit / by.length();
    }
    Some(moved(constraint, pose, by))
}
