//! From a point map to the camera in the room (paper Sec. 3.1, App. B.2, Algorithm 1).
//!
//! Algorithm 1 runs first: normals, Manhattan frame, six planes, deepest floor corner, one similarity. Then
//! photo and map are refined together ([`joint`], decision 0010), from which the posterior of camera and room comes.
//! From the `points` frame (free unit) to the `room` frame (metres). It fails only on maps that are none: without a
//! frame or a plane the prior's camera stands in, and `evidence.fallbacks` says so.

mod complete;
mod creases;
mod edge_lines;
mod fallback;
mod joint;
mod lens;
mod posterior;
mod scale;
mod types;

use harmony_scene::{Camera, Extents, Mat3, PointMap, PointMapKind, Surface, Vec2, Vec3};

pub(crate) use joint::TOLD_HEIGHT_SIGMA;
use joint::{DepthCells, Refinement, refine_jointly};
pub use joint::{JointEvidence, room_from_unknowns, room_unknowns};
use lens::Lens;
pub use posterior::{RIGHT_POSITION_M, RIGHT_ROTATION_DEG, RoomPosterior};
pub use types::{
    AnchorKind, Calibration, CalibrationError, CalibrationEvidence, CalibrationMethod, CalibrationSettings,
    PlaneEvidence,
};

use crate::align::{VerticalEdge, camera_in_room, room_from_points};
use crate::manhattan::{ManhattanAxes, ManhattanFrame, manhattan_frame};
use crate::planes::{AxisBox, FacePlane, axis_of, fit_faces, polish_axes};
use crate::surfels::{Surfels, surfels};
use crate::{CameraHints, LayoutPrior, LineSegment, ViewEstimate};

/// Usable points below which nothing is tried.
const MIN_POINTS: usize = 100;
/// Share of agreeing normals below which there is no Manhattan frame. Random normals reach 0.1.
const MIN_SUPPORT: f64 = 0.22;
/// A measured room side beyond these times the prior's is absurd.
const ABSURD_RATIO: f64 = 4.0;
/// A floor nearer to the camera than this share of the prior's camera height is furniture.
const LOWEST_FLOOR: f64 = 0.6;
/// Beyond this yaw the other horizontal axis is never the depth axis, degrees.
const WIDEST_YAW_DEG: f64 = 56.0;

/// Calibrates the photo's camera in the room from a point map.
///
/// Normals -> Manhattan frame -> six planes -> deepest visible floor corner -> one similarity -> camera
/// (keys `cam.manhattan`, `cam.histogram`, `cam.extend`, `cam.corner`, `cam.rotation`, `cam.scale`,
/// `cam.translation`, `cam.pose`).
///
/// # Departures from the paper
/// * The axes are oriented before the planes are fitted, so that every plane has a name; the result is the same.
/// * After the first planes the frame is turned onto them ([`polish_axes`]).
/// * `H_room` is the metric reference only where floor *and* ceiling are seen. Without one of them the scale is the
///   weighted mean of what is left: camera height, distance to the back wall, width.
/// * A metric map keeps its scale (1): a sensor knows metres better than a model does. The height is then measured,
///   and `evidence.height_ratio` says how far the prior was off.
/// * Faces that aren't seen come from the prior, but the box always holds the camera and nearly all points.
///
/// When no frame or no plane holds, the prior's camera refined by its pins stands in, and the points are scaled to it.
///
/// # Errors
/// [`CalibrationError::TooFewPoints`], [`CalibrationError::BadMap`] and [`CalibrationError::BadPrior`]; everything
/// else has a fallback, named in `evidence.fallbacks`.
pub fn calibrate(
    points: &PointMap,
    prior: &LayoutPrior,
    settings: &CalibrationSettings,
) -> Result<Calibration, CalibrationError> {
    Ok(calibrate_along(points, prior, settings, None)?.0)
}

/// Confidence of a view whose lines are believed where the map has no frame.
const SURE_VIEW: f64 = 0.4;
/// A map's frame that leaves the photo's lines unexplained, to less than this share of what their own frame explains, is
/// not believed.
const OVERRULED: f64 = 0.8;
/// Lines that hold such a view while the pins are solved for the box.
const HOLDING_LINES: usize = 120;

/// Algorithm 1, then the same once more along the axes that the photo's lines give, refined by everything together.
///
/// The second value is the map seen by the refined camera: its points keep their depth and lie on the rays of the new
/// focal length. Where the photo cannot refine anything, both come back as Algorithm 1 leaves them.
///
/// # Errors
/// Those of [`calibrate`].
pub fn calibrate_with_photo(
    points: &PointMap,
    prior: &LayoutPrior,
    view: &ViewEstimate,
    settings: &CalibrationSettings,
) -> Result<(Calibration, PointMap), CalibrationError> {
    if prior.passages.is_empty() {
        return calibrate_room(points, prior, view, settings);
    }
    let (calibration, map) = calibrate_room(&without_other_rooms(points, prior), prior, view, settings)?;
    // Things that stand before a passage keep their depth.
    Ok((calibration, PointMap { confidence: points.confidence.clone(), ..map }))
}

/// The map without confidence where the photo shows another room.
fn without_other_rooms(points: &PointMap, prior: &LayoutPrior) -> PointMap {
    let (width, height) = (points.size.width, points.size.height);
    let to_photo = Vec2::new(
        f64::from(prior.photo.width) / f64::from(width.max(1)),
        f64::from(prior.photo.height) / f64::from(height.max(1)),
    );
    let mut out = points.clone();
    for (i, confidence) in out.confidence.iter_mut().enumerate() {
        let at = Vec2::new(f64::from(i as u32 % width) + 0.5, f64::from(i as u32 / width) + 0.5) * to_photo;
        if prior.passages.iter().any(|outline| crate::room_shape::inside(outline, at)) {
            *confidence = 0.0;
        }
    }
    out
}

/// [`calibrate_with_photo`] by a map that shows no other room.
fn calibrate_room(
    points: &PointMap,
    prior: &LayoutPrior,
    view: &ViewEstimate,
    settings: &CalibrationSettings,
) -> Result<(Calibration, PointMap), CalibrationError> {
    let (first, frame) = calibrate_along(points, prior, settings, None)?;
    let lens = Lens::of(points, prior.photo);
    let (view, centred) = (&lens.centred_view(view), &lens.centred_prior(prior));
    let sure = view.confidence >= SURE_VIEW;
    let by_lines = |reason: &str| {
        let mut first = fallback::calibrate_by_prior(points, centred, reason, &longest(view));
        first.evidence.fallbacks.push("directions from the photo's lines".to_owned());
        refine_with_photo(first, None, points, (prior, centred), view, settings)
    };
    if first.evidence.method != CalibrationMethod::Manhattan && sure {
        // Without a frame from the map the photo's lines know the directions better than hints.
        return by_lines(first.evidence.fallbacks.first().map_or("", String::as_str));
    }
    let refined = refine_with_photo(first, frame, points, (prior, centred), view, settings)?;
    let explained = |c: &Calibration| {
        let camera = c.camera.resized(view.size);
        view.explained_by(&camera.rotation, camera.intrinsics.fx)
    };
    if sure && explained(&refined.0) < OVERRULED * view.support.iter().sum::<f64>() {
        let note = "the map's frame is not that of the photo's lines, which are believed";
        let (mut other, map) = by_lines(note)?;
        if explained(&other) > explained(&refined.0) {
            // Along the lines' axes the map may show its surfaces after all; then the note is not there.
            if !other.evidence.fallbacks.iter().any(|f| f == note) {
                other.evidence.fallbacks.insert(0, note.to_owned());
            }
            return Ok((other, map));
        }
    }
    Ok(refined)
}

/// A calibration along the axes that the photo's lines give, refined by everything together; `frame` is that of the map.
/// The view and the second prior are as the centred camera has them ([`Lens`]).
/// The second value is the map as that camera sees it.
fn refine_with_photo(
    first: Calibration,
    frame: Option<ManhattanFrame>,
    points: &PointMap,
    (prior, centred): (&LayoutPrior, &LayoutPrior),
    view: &ViewEstimate,
    settings: &CalibrationSettings,
) -> Result<(Calibration, PointMap), CalibrationError> {
    let depths = DepthCells::new(points, Lens::of(points, prior.photo));
    let refined = |before: &Calibration, map: &PointMap, until| {
        let (calibration, evidence) = refine_jointly(before, (map, &depths), view, centred, until);
        let map = evidence.map(|e| map.with_focal(map.intrinsics.fx * e.focal_ratio));
        map.map(|map| (calibration, map))
    };
    let alone = |first: Calibration| match refined(&first, points, Refinement::Full) {
        Some(refined) => Ok(refined),
        None => Ok((first, points.clone())),
    };
    let Some((along, map)) = refined(&first, points, Refinement::Axes) else { return Ok((first, points.clone())) };
    // With the right axes other faces may turn out to be the room's.
    let known = Known { camera_from_room: along.camera.rotation, frame };
    let (second, _) = calibrate_along(&map, prior, settings, Some(known))?;
    if second.evidence.method != CalibrationMethod::Manhattan {
        return alone(first);
    }
    let Some((mut calibration, map)) = refined(&second, &map, Refinement::Full) else { return alone(first) };
    let focal_ratio = map.intrinsics.fx / points.intrinsics.fx;
    calibration.evidence.joint = calibration
        .evidence
        .joint
        .map(|joint| JointEvidence { focal_ratio, ..joint }.against(&first.camera, &calibration.camera));
    Ok((calibration, map))
}

/// The view with its longest lines only: enough to hold its directions.
fn longest(view: &ViewEstimate) -> ViewEstimate {
    let mut segments = view.segments.clone();
    let length = |s: &LineSegment| s.start.distance(s.end);
    segments.sort_by(|a, b| length(&b.0).total_cmp(&length(&a.0)));
    segments.truncate(HOLDING_LINES);
    ViewEstimate { segments, ..view.clone() }
}

/// What an earlier calibration knows of the axes.
struct Known {
    /// The axes, which are neither searched for nor polished.
    camera_from_room: Mat3,
    /// How the normals agree with the frame that was found first.
    frame: Option<ManhattanFrame>,
}

/// [`calibrate`], along axes that are known if they are; with the frame that the normals have.
fn calibrate_along(
    points: &PointMap,
    prior: &LayoutPrior,
    settings: &CalibrationSettings,
    known: Option<Known>,
) -> Result<(Calibration, Option<ManhattanFrame>), CalibrationError> {
    check(points, prior)?;
    let surfels = surfels(points);
    if surfels.usable_points < MIN_POINTS {
        return Err(CalibrationError::TooFewPoints { got: surfels.usable_points, min: MIN_POINTS });
    }
    let camera_from_room = known.as_ref().map(|k| k.camera_from_room);
    let measured = measure(points, &surfels, prior, settings, known);
    match measured.and_then(|m| Ok((solve(points, &surfels, prior, &m)?, Some(m.frame)))) {
        Ok(calibrated) => Ok(calibrated),
        Err(NoBox { reason, camera_from_room: found }) => {
            tracing::debug!(reason, "no Manhattan calibration, the prior's camera stands in");
            let view = fallback::view_of(points, prior, camera_from_room.or(found));
            Ok((fallback::calibrate_by_prior(points, prior, &reason, &view), None))
        }
    }
}

fn check(points: &PointMap, prior: &LayoutPrior) -> Result<(), CalibrationError> {
    let pixels = points.size.pixels();
    if points.xyz.len() != pixels || points.confidence.len() != pixels {
        return Err(CalibrationError::BadMap {
            width: points.size.width,
            height: points.size.height,
            points: points.xyz.len(),
            confidences: points.confidence.len(),
        });
    }
    let Extents { width, height, depth } = prior.extents;
    if [width, height, depth].iter().all(|v| (0.3..=200.0).contains(v)) {
        Ok(())
    } else {
        Err(CalibrationError::BadPrior { width, height, depth })
    }
}

/// Why there is no box around the points, and the axes if those are known.
struct NoBox {
    reason: String,
    camera_from_room: Option<Mat3>,
}

impl From<String> for NoBox {
    fn from(reason: String) -> Self {
        Self { reason, camera_from_room: None }
    }
}

/// Frame and planes, before the scale is known.
struct Measured {
    frame: ManhattanFrame,
    /// Oriented and polished.
    axes: ManhattanAxes,
    /// In the order of [`Surface::ALL`].
    faces: [Option<FacePlane>; 6],
    notes: Vec<String>,
}

impl Measured {
    fn face(&self, surface: Surface) -> Option<&FacePlane> {
        self.faces.iter().flatten().find(|f| f.surface == surface && f.measured)
    }

    fn offset(&self, surface: Surface) -> Option<f64> {
        self.face(surface).map(|f| f.offset)
    }
}

fn measure(
    points: &PointMap,
    surfels: &Surfels,
    prior: &LayoutPrior,
    settings: &CalibrationSettings,
    known: Option<Known>,
) -> Result<Measured, NoBox> {
    let tilt = hint(prior.camera.tilt_deg, -80.0, 80.0).unwrap_or(0.0).to_radians();
    let camera_from_room = known.as_ref().map(|k| k.camera_from_room);
    let frame = known
        .and_then(|k| k.frame)
        .or_else(|| manhattan_frame(surfels, points.rotation, tilt))
        .ok_or_else(|| NoBox::from("the point map has hardly any smooth surface".to_owned()))?;
    if frame.support < MIN_SUPPORT {
        return Err(format!("only {:.0} % of the normals agree with a Manhattan frame", frame.support * 100.0).into());
    }
    let points_from_camera = points.rotation.transpose();
    let (up, forward) = (points_from_camera * Vec3::NEG_Y, points_from_camera * Vec3::Z);
    let mut notes = Vec::new();
    let mut axes = frame.axes.oriented(up, forward);
    if let Some(turned) = prefer_quarter_turn(&axes, forward, &prior.camera) {
        notes.push("the view is near a corner: back and side wall named as the prior names them".to_owned());
        axes = turned;
    }
    if let Some(camera_from_room) = camera_from_room {
        axes = ManhattanAxes::from_r_align((points_from_camera * camera_from_room).transpose());
    }
    let mut faces = fit_faces(surfels, &axes, settings);
    for _ in 0..if camera_from_room.is_some() { 0 } else { 2 } {
        // Polishing keeps the orientation: it turns by a few degrees at most.
        axes = polish_axes(surfels, &axes, &faces);
        faces = fit_faces(surfels, &axes, settings);
    }
    reject_raised_floor(points, prior, &axes, &mut faces, &mut notes);
    // The camera is inside the room, so a plane on its wrong side is furniture or a reflection.
    let camera = axes.r_align() * points.camera_centre();
    for face in faces.iter_mut().flatten() {
        let (axis, sign) = axis_of(face.surface);
        let inside = (camera[axis] - face.offset) * sign;
        if face.measured && inside < 0.02 * surfels.median_depth {
            face.measured = false;
            notes.push(format!("the {} plane found is not on its side of the camera", face.surface.name()));
        }
    }
    if faces.iter().flatten().all(|f| !f.measured) {
        return Err(NoBox {
            reason: "no wall, floor or ceiling holds enough points".to_owned(),
            camera_from_room: Some(points.rotation * axes.r_align().transpose()),
        });
    }
    Ok(Measured { frame, axes, faces, notes })
}

/// A "floor" much nearer below the camera than the prior's camera height is a table or a bed.
///
/// It needs the metric scale: the map's own, or the one that floor and ceiling would give.
fn reject_raised_floor(
    points: &PointMap,
    prior: &LayoutPrior,
    axes: &ManhattanAxes,
    faces: &mut [Option<FacePlane>; 6],
    notes: &mut Vec<String>,
) {
    let Some(hinted) = hint(prior.camera.height_m, 0.3, 0.95 * prior.extents.height) else { return };
    let offset = |surface| faces.iter().flatten().find(|f| f.surface == surface && f.measured).map(|f| f.offset);
    let Some(floor) = offset(Surface::Floor) else { return };
    let scale = match (points.kind, offset(Surface::Ceiling)) {
        (PointMapKind::Metric, _) => 1.0,
        (_, Some(ceiling)) => prior.extents.height / (ceiling - floor),
        (_, None) => return,
    };
    let height = (axes.r_align() * points.camera_centre()).y - floor;
    if height > 0.0 && height * scale < LOWEST_FLOOR * hinted {
        notes.push(format!(
            "a level plane {:.2} m below the camera is no floor: the camera is about {hinted:.2} m high",
            height * scale
        ));
        for face in faces.iter_mut().flatten().filter(|f| f.surface == Surface::Floor) {
            face.measured = false;
        }
    }
}

/// Near 45 degrees both horizontal axes could be the depth axis; then the prior's yaw decides.
fn prefer_quarter_turn(axes: &ManhattanAxes, forward: Vec3, hints: &CameraHints) -> Option<ManhattanAxes> {
    let hinted = hint(hints.yaw_deg, -90.0, 90.0)?;
    let yaw_of = |a: &ManhattanAxes| {
        let f = a.r_align() * forward;
        (-f.x).atan2(-f.z).to_degrees()
    };
    let turned = axes.quarter_turned(forward);
    let (now, other) = (yaw_of(axes), yaw_of(&turned));
    (other.abs() <= WIDEST_YAW_DEG && (other - hinted).abs() + 20.0 < (now - hinted).abs()).then_some(turned)
}

fn solve(points: &PointMap, surfels: &Surfels, prior: &LayoutPrior, m: &Measured) -> Result<Calibration, String> {
    let r_align = m.axes.r_align();
    let centre = points.camera_centre();
    let camera_on_axes = r_align * centre;
    let spread = complete::point_range(surfels, r_align);
    let scale = scale::metric_scale(points.kind, prior, m, camera_on_axes, &spread, surfels.median_depth);
    let mut fallbacks = m.notes.clone();
    fallbacks.extend(scale.notes.clone());

    let (axis_box, more) = complete::complete(m, prior, scale.value, camera_on_axes, &spread);
    fallbacks.extend(more);
    let size = (axis_box.high - axis_box.low) * scale.value;
    absurd(m, prior, size)?;

    let anchor = deepest_corner(points, m, r_align, &axis_box);
    if anchor.kind != AnchorKind::FloorCorner {
        fallbacks.push(match anchor.kind {
            AnchorKind::WallEnd => {
                "no floor corner of two measured walls is in the image: the farthest wall end anchors".into()
            }
            _ => "no measured wall reaches a corner: a corner of the completed box anchors".into(),
        });
    }
    let points_from_axes = r_align.transpose();
    let top = Vec3::new(anchor.on_axes.x, axis_box.high.y, anchor.on_axes.z);
    let edge = VerticalEdge { floor: points_from_axes * anchor.on_axes, ceiling: points_from_axes * top };
    let floor_in_room = (anchor.on_axes - axis_box.low) * scale.value;
    let in_room = VerticalEdge { floor: floor_in_room, ceiling: floor_in_room + Vec3::Y * size.y };
    let similarity = room_from_points(&m.axes, centre, &edge, &in_room).map_err(|e| e.to_string())?;
    let camera = camera_in_room(points.size, points.intrinsics, points.rotation, centre, &similarity);
    let extents = Extents { width: size.x, height: size.y, depth: size.z };

    let evidence = CalibrationEvidence {
        method: CalibrationMethod::Manhattan,
        manhattan: [m.axes.width, m.axes.vertical, m.axes.depth].map(|a| a.to_array()),
        planes: plane_evidence(m, scale.value, camera_on_axes),
        anchor_kind: anchor.kind,
        anchor: floor_in_room,
        anchor_px: anchor.pixel.map(|p| p.to_array()),
        corner_reprojection_px: reprojection(&camera, floor_in_room, prior),
        axis_agreement_deg: m.frame.agreement_deg,
        axis_support: m.frame.support,
        iterations: m.frame.iterations,
        joint: None,
        scale_source: scale.source.clone(),
        height_ratio: scale.height_ratio,
        fallbacks,
    };
    let seen = Surface::ALL.into_iter().filter(|s| m.face(*s).is_some()).collect();
    Ok(Calibration {
        camera,
        room_from_points: similarity,
        extents,
        seen,
        anchor: floor_in_room,
        evidence,
        posterior: None,
    })
}

/// Refuses a box whose measured sides have nothing to do with the prior's.
fn absurd(m: &Measured, prior: &LayoutPrior, size: Vec3) -> Result<(), String> {
    let wanted = prior.extents.as_vec();
    let pairs = [(0, Surface::Left, Surface::Right, "wide"), (1, Surface::Floor, Surface::Ceiling, "high")];
    for (axis, low, high, word) in pairs {
        if m.face(low).is_some() && m.face(high).is_some() {
            let ratio = size[axis] / wanted[axis];
            if !(1.0 / ABSURD_RATIO..=ABSURD_RATIO).contains(&ratio) {
                return Err(format!(
                    "the measured room is {:.2} m {word}, the prior says {:.2} m",
                    size[axis], wanted[axis]
                ));
            }
        }
    }
    Ok(())
}

struct Anchor {
    kind: AnchorKind,
    /// Coordinates along the axes, unit of the map.
    on_axes: Vec3,
    pixel: Option<Vec2>,
}

/// The deepest visible floor corner (key `cam.corner`; Alg. 1): of the floor corners of two measured walls in front
/// of the camera and projecting into the image the one with the largest depth; else the farthest end of a measured
/// wall; else the farthest corner.
fn deepest_corner(points: &PointMap, m: &Measured, r_align: Mat3, axis_box: &AxisBox) -> Anchor {
    let own = Camera {
        size: points.size,
        intrinsics: points.intrinsics,
        rotation: points.rotation,
        translation: points.translation,
    };
    let points_from_axes = r_align.transpose();
    let walls = [
        [Surface::Back, Surface::Left],
        [Surface::Back, Surface::Right],
        [Surface::Front, Surface::Left],
        [Surface::Front, Surface::Right],
    ];
    let candidates = axis_box.floor_corners().into_iter().zip(walls).map(|(corner, sides)| {
        let point = points_from_axes * corner;
        let pixel = own.project(point);
        let measured = sides.iter().filter(|s| m.face(**s).is_some()).count();
        let visible = pixel.is_some_and(|p| own.contains(p));
        let kind = match measured {
            2 if visible => AnchorKind::FloorCorner,
            0 => AnchorKind::Prior,
            _ => AnchorKind::WallEnd,
        };
        (Anchor { kind, on_axes: corner, pixel }, visible, own.depth(point))
    });
    let rank = |kind: AnchorKind| match kind {
        AnchorKind::FloorCorner => 2,
        AnchorKind::WallEnd => 1,
        AnchorKind::Prior => 0,
    };
    candidates
        .max_by(|(a, a_visible, a_depth), (b, b_visible, b_depth)| {
            (rank(a.kind), a_visible).cmp(&(rank(b.kind), b_visible)).then(a_depth.total_cmp(b_depth))
        })
        .map_or(Anchor { kind: AnchorKind::Prior, on_axes: axis_box.low, pixel: None }, |(anchor, ..)| anchor)
}

fn plane_evidence(m: &Measured, scale: f64, camera_on_axes: Vec3) -> Vec<PlaneEvidence> {
    m.faces
        .iter()
        .flatten()
        .map(|f| PlaneEvidence {
            surface: f.surface,
            measured: f.measured,
            distance_m: (camera_on_axes[axis_of(f.surface).0] - f.offset).abs() * scale,
            rms_m: f.rms * scale,
            inliers: f.inliers,
            share: f.share,
        })
        .collect()
}

/// Distance, in photo pixels, between the anchor's projection and the prior's corner.
fn reprojection(camera: &Camera, anchor: Vec3, prior: &LayoutPrior) -> Option<f64> {
    let hinted = Vec2::from_array(prior.camera.corner_px?);
    let seen = camera.resized(prior.photo).project(anchor)?;
    Some(seen.distance(hinted)).filter(|d| d.is_finite())
}

/// A hint that is a number in range.
fn hint(value: Option<f64>, low: f64, high: f64) -> Option<f64> {
    value.filter(|v| (low..=high).contains(v))
}

#[cfg(test)]
mod tests {
    use harmony_scene::{ImageSize, Intrinsics, PointMapKind};

    use super::*;

    #[test]
    fn another_room_has_no_say_where_it_is_outlined_in_pixels_of_the_photo() {
        let size = ImageSize::new(4, 2);
        let lens = Intrinsics { fx: 3.0, fy: 3.0, cx: 2.0, cy: 1.0 };
        let map = PointMap::from_depth(PointMapKind::Metric, size, lens, &[2.0; 8]);
        let outline = [(0.0, 0.0), (200.0, 0.0), (200.0, 200.0), (0.0, 200.0)].map(|(x, y)| Vec2::new(x, y));
        let prior = LayoutPrior { passages: vec![outline.to_vec()], ..LayoutPrior::unknown(ImageSize::new(400, 200)) };
        let left = without_other_rooms(&map, &prior);
        assert_eq!(left.confidence, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0]);
        assert_eq!(left.xyz, map.xyz);
    }
}
