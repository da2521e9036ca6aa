//! Phase 1, the empty room and the camera. Paper Sec. 3.1, App. B.2 and App. C "Layout Generation".

use std::collections::BTreeMap;
use std::sync::Arc;

use futures::future::try_join;
use harmony_geometry::{
    Calibration, CalibrationSettings, CameraHints, FocalPrior, GrayImage, LayoutPins, LayoutPrior, MapInRoom,
    OpeningHint, PinnedEdge, RoomBox, RoomEdge, RoomPosterior, ShapeHint, ShapeKind, WallSide, calibrate_with_photo,
    estimate_room_box, estimate_view, measure_openings, measure_shape, room_unknowns,
};
use harmony_imaging::border::Border;
use harmony_imaging::color::linear_from_srgb;
use harmony_imaging::polygon::filled;
use harmony_imaging::sheet::grid_overlay;
use harmony_io::Photo;
use harmony_placement::{PartialScene, RoomPoints};
use harmony_prompts::{
    BackWallSide, KnownDepth, LayoutAnswer, LayoutFeature, LayoutFeatureKind, LayoutOpening, LayoutOpeningKind,
    LayoutQuestion, LayoutReach, PinKind, UnaidedRoom,
};
use harmony_roles::{GeometryAnswer, GeometryRequest, Picture};
use harmony_scene::{
    Camera, Extents, ImageSize, Mask, Opening, OpeningKind, PointMap, Room, RoomShape, Similarity, Surface,
    SurfaceTexture, Wall, WarningKind,
};
use image::RgbImage;
use serde_json::{Value, json};

use crate::ctx::{PhaseCtx, PhaseError};
use crate::state::{Layout, SceneState, ToldLight};
use crate::steps::surfaces::{self, EditedRoom};
use crate::views::Gallery;

/// Typical lens of a phone or a real-estate photo, as a fraction of the longer side; used when nothing else is known.
const TYPICAL_FOCAL: f64 = 0.82;

/// One sigma of a focal length that EXIF tells, of its logarithm: lenses breathe, and files round to whole millimetres.
const EXIF_SIGMA: f64 = 0.03;

/// Share of a wall's height from which on the photo shows it up to the ceiling.
const WHOLE_WALL: f64 = 0.95;

/// Recovers room and camera.
///
/// # Errors
/// Fatal role errors and unwritable files only: geometry that does not hold falls back, and says so.
pub async fn run(ctx: &PhaseCtx<'_>, photo: &Photo, working: Arc<RgbImage>) -> Result<SceneState, PhaseError> {
    // An image editor empties the room meanwhile: it needs the photo alone.
    let found = Box::pin(room_and_camera(ctx, photo, Arc::clone(&working)));
    let (mut state, emptied) = try_join(found, surfaces::emptied(ctx, &working)).await?;
    if let Some(emptied) = emptied {
        ctx.step("the empty room in its textures");
        state.edited.emptied = Some(emptied);
        surfaces::all(ctx, &mut state).await?;
    }
    Ok(state)
}

async fn room_and_camera(ctx: &PhaseCtx<'_>, photo: &Photo, working: Arc<RgbImage>) -> Result<SceneState, PhaseError> {
    let size = ImageSize::new(working.width(), working.height());
    let exif_focal = photo.focal_px.map(|f| f * f64::from(size.width) / f64::from(photo.image.width()));

    ctx.step("geometry");
    let request = GeometryRequest { name: ctx.call("geometry"), image: working.clone(), exif_focal_px: exif_focal };
    let geometry = ctx.calls.estimate(&request).await?;
    let gray = GrayImage::from_rgb8(size, working.as_raw()).map_err(|e| PhaseError::internal(ctx.phase, &e))?;
    let focal = match &geometry {
        GeometryAnswer::Points(map) => {
            let k = map.intrinsics.resized(map.size, size);
            FocalPrior { focal_px: f64::midpoint(k.fx, k.fy), sigma: 0.02 }
        }
        GeometryAnswer::NoDepth { .. } => match exif_focal {
            Some(focal_px) => FocalPrior { focal_px, sigma: EXIF_SIGMA },
            None => FocalPrior { focal_px: TYPICAL_FOCAL * f64::from(size.width.max(size.height)), sigma: 0.25 },
        },
    };
    let view = estimate_view(&gray, Some(focal));
    let unaided = estimate_room_box(&gray, &view, &LayoutPrior::unknown(size));

    ctx.step("asking about room and camera");
    let answer = ask(ctx, &working, &geometry, &unaided).await?;
    let prior = layout_prior(&answer, size);
    let by_box = || from_box(ctx, estimate_room_box(&gray, &view, &prior));
    let found = match &geometry {
        GeometryAnswer::Points(map) if ctx.settings.camera_calibration => {
            match calibrate_with_photo(map, &prior, &view, &CalibrationSettings::default()) {
                Ok((calibration, map)) => from_points(ctx, calibration, map, size),
                Err(error) => {
                    let message = format!(
                        "the point map could not be calibrated ({error}); the room comes from the photo's lines"
                    );
                    ctx.warn(WarningKind::Fallback, None, message);
                    by_box()
                }
            }
        }
        GeometryAnswer::Points(_) | GeometryAnswer::NoDepth { .. } => by_box(),
    };
    let (found, shape) = shaped(ctx, found, &answer, size);
    let Found { camera, extents, seen, anchor, points, posterior, evidence, method, confidence, because } = found;
    if let Some(message) = exif_focal.and_then(|told| other_lens(told, camera.intrinsics.fx)) {
        ctx.warn(WarningKind::LowConfidence, None, message);
    }
    let mut room = Room {
        room_type: tidy(&answer.room.room_type),
        extents,
        shape,
        seen,
        openings: Vec::new(),
        floor_texture: Some(SurfaceTexture {
            material: answer.floor_texture.material.clone(),
            color: answer.floor_texture.color.clone(),
            pattern: answer.floor_texture.pattern.clone(),
            tile_size_m: answer.floor_texture.tile_size_m.clamp(0.05, 5.0),
        }),
        wall_texture: Some(SurfaceTexture {
            material: answer.wall_texture.material.clone(),
            color: answer.wall_texture.color.clone(),
            pattern: answer.wall_texture.finish.clone(),
            tile_size_m: answer.wall_texture.tile_size_m.clamp(0.05, 5.0),
        }),
    };
    let (openings, notes) = openings(&answer, &camera, &room);
    for note in notes {
        ctx.warn(WarningKind::Fallback, None, format!("the room's openings: {note}"));
    }
    room.openings = openings;
    let room_points = points.as_ref().map(|(map, similarity)| RoomPoints::new(map, similarity));
    if let Some((map, _)) = &points {
        harmony_io::save_point_map(&ctx.file("points.npz")?, map)?;
    }
    let mut partial = PartialScene::new(room, camera, room_points, Some(anchor));
    partial.posterior = posterior;
    let nobodys = Border::of(&working).mask(camera.size).or(&ignored(&answer.ignore, camera.size));
    let nobodys = Arc::new(nobodys);
    partial.nobodys = nobodys.bounds().is_some().then(|| Arc::clone(&nobodys));
    let layout = Layout { answer, evidence, method, confidence, because };
    let trims = surfaces::named_trims(&layout.answer, &partial.room.extents);
    let mut state = SceneState {
        photo_frame: nobodys,
        photo: working,
        layout,
        partial,
        objects: BTreeMap::new(),
        surfaces: BTreeMap::new(),
        even_surfaces: BTreeMap::new(),
        edited: EditedRoom::default(),
        roughness: BTreeMap::new(),
        beyond: Vec::new(),
        refused: Vec::new(),
        trims,
        features: Vec::new(),
        rejected: Vec::new(),
        left: Vec::new(),
        looks: Vec::new(),
        summaries: Vec::new(),
        lighting: None,
        told_light: ToldLight::default(),
        unseen_openings: Vec::new(),
        next_index: 10,
        drawn: Gallery::default(),
    };
    state.beyond = surfaces::beyond(&state);
    write_files(ctx, &state)?;
    Ok(state)
}

/// The pixels within outlines in thousandths of the photo, with what their edges mix in.
fn ignored(outlines: &[Vec<[f64; 2]>], size: ImageSize) -> Mask {
    /// Outlines by hand are a little off, share of the width.
    const MARGIN: f64 = 0.004;
    let scale = [f64::from(size.width) / 1000.0, f64::from(size.height) / 1000.0];
    let all = outlines.iter().fold(Mask::empty(size), |all, outline| {
        let corners: Vec<[f64; 2]> = outline.iter().map(|p| [p[0] * scale[0], p[1] * scale[1]]).collect();
        all.or(&filled(&corners, size))
    });
    all.dilated((MARGIN * f64::from(size.width)).ceil() as i32)
}

/// Room and camera, and what speaks for them.
struct Found {
    /// Working size.
    camera: Camera,
    extents: Extents,
    seen: Vec<Surface>,
    /// Deepest floor corner.
    anchor: glam::DVec3,
    /// The point map with its way into the room.
    points: Option<(PointMap, Similarity)>,
    posterior: Option<RoomPosterior>,
    evidence: Value,
    method: String,
    confidence: Option<f64>,
    because: String,
}

/// What is told when a calibration has another lens than EXIF, by more than its sigma: focal lengths in pixels.
fn other_lens(told: f64, found: f64) -> Option<String> {
    let off = (found / told).ln();
    (off.abs() > EXIF_SIGMA).then(|| {
        format!(
            "the calibration has a focal length of {found:.0} pixels, EXIF tells {told:.0}: {:+.0} %, a cropped photo or \
             wrong corners",
            100.0 * (found / told - 1.0)
        )
    })
}

fn from_points(ctx: &PhaseCtx<'_>, c: Calibration, map: PointMap, size: ImageSize) -> Found {
    for fallback in &c.evidence.fallbacks {
        ctx.warn(WarningKind::Fallback, None, fallback.clone());
    }
    let because = format!(
        "{:.0} % of the surface normals agree with the Manhattan frame, axis agreement {:.2} deg, anchor: {}",
        c.evidence.axis_support * 100.0,
        c.evidence.axis_agreement_deg,
        words(&json!(c.evidence.anchor_kind)),
    );
    let confidence = c.confidence();
    Found {
        camera: c.camera.resized(size),
        extents: c.extents,
        seen: c.seen,
        anchor: c.anchor,
        points: Some((map, c.room_from_points)),
        posterior: c.posterior,
        evidence: json!(c.evidence),
        method: format!("closed form from the point map ({})", words(&json!(c.evidence.method))),
        confidence,
        because,
    }
}

fn from_box(ctx: &PhaseCtx<'_>, found: RoomBox) -> Found {
    for fallback in &found.evidence.fallbacks {
        ctx.warn(WarningKind::Fallback, None, fallback.clone());
    }
    if found.confidence < 0.35 {
        let confidence = found.confidence;
        let message =
            format!("room and camera are a guess (confidence {confidence:.2}): little in the photo fixes them");
        ctx.warn(WarningKind::LowConfidence, None, message);
    }
    let e = &found.evidence;
    let because = if e.pins_used > 0 {
        format!(
            "{} of {} pinned points, {:.1} px RMS; vanishing points {:.2}",
            e.pins_used, e.pins_given, e.pin_rms_px, e.view_confidence
        )
    } else {
        format!(
            "{:.0} % of the box's edges lie on image lines; vanishing points {:.2}",
            e.edge_support * 100.0,
            e.view_confidence
        )
    };
    Found {
        camera: found.camera,
        extents: found.extents,
        seen: found.seen,
        anchor: found.anchor,
        points: None,
        posterior: found.posterior,
        method: format!("room box from {}", words(&json!(e.method))),
        evidence: json!(found.evidence),
        confidence: Some(found.confidence),
        because,
    }
}

/// What makes the room other than its box, measured; the box with the walls that had to move for it.
fn shaped(ctx: &PhaseCtx<'_>, mut found: Found, answer: &LayoutAnswer, size: ImageSize) -> (Found, RoomShape) {
    let hints = shape_hints(answer, size);
    if hints.is_empty() {
        return (found, RoomShape::default());
    }
    let in_room = found.points.as_ref().map(|(map, similarity)| RoomPoints::new(map, similarity));
    let map = in_room.as_ref().filter(|p| p.is_dense()).map(|p| MapInRoom { size: p.size, xyz: &p.xyz });
    let measured = measure_shape(&hints, &found.camera, &found.extents, map);
    for note in &measured.notes {
        ctx.warn(WarningKind::Fallback, None, format!("the room's shape: {note}"));
    }
    let (extents, shift) = measured.box_after(&found.extents);
    found.camera.translation -= found.camera.rotation * shift;
    found.anchor += shift;
    if let Some((_, similarity)) = &mut found.points {
        similarity.translation += shift;
    }
    if let Some(posterior) = &mut found.posterior {
        let scale = posterior.mean[9];
        posterior.mean = room_unknowns(&found.camera, &extents, 1.0);
        posterior.mean[9] = scale;
    }
    found.extents = extents;
    found.evidence["shape"] = json!({
        "moved_walls_m": measured.moved.iter().map(|(wall, by)| json!({ "wall": wall, "outward": by })).collect::<Vec<_>>(),
        "notes": measured.notes,
    });
    (found, measured.shape)
}

/// The shape of a layout answer in the words of the geometry, pixels of an image of this size.
fn shape_hints(answer: &LayoutAnswer, size: ImageSize) -> Vec<ShapeHint> {
    let reaches = |f: &LayoutFeature| {
        [LayoutReach::Floor, LayoutReach::Ceiling, LayoutReach::LeftEnd, LayoutReach::RightEnd]
            .map(|r| f.reaches.contains(&r))
    };
    let hint = |f: &LayoutFeature| ShapeHint {
        kind: match f.kind {
            LayoutFeatureKind::Block => ShapeKind::Block,
            LayoutFeatureKind::Niche => ShapeKind::Niche,
            LayoutFeatureKind::Slope => ShapeKind::Slope,
            LayoutFeatureKind::Tray => ShapeKind::Tray,
            LayoutFeatureKind::Vault => ShapeKind::Vault,
        },
        what: f.what.chars().take(60).collect(),
        wall: f.wall,
        face: f.face.iter().map(|p| pixel_of(p, size)).collect(),
        depth: f.depth_m,
        reaches: reaches(f),
        low: f.low_m.unwrap_or_default(),
        glow: f.glow().map(|rgb| rgb.map(|c| linear_from_srgb(f32::from(c) / 255.0))),
    };
    answer.shape.iter().map(hint).collect()
}

/// The passages and windows that a layout answer outlines in a room, and what was not believed of them.
pub(crate) fn openings(answer: &LayoutAnswer, camera: &Camera, room: &Room) -> (Vec<Opening>, Vec<String>) {
    measure_openings(&opening_hints(answer, camera.size), camera, room)
}

/// The outlined passages and windows of a layout answer in the words of the geometry, pixels of an image of this size.
fn opening_hints(answer: &LayoutAnswer, size: ImageSize) -> Vec<OpeningHint> {
    let hint = |wall: Wall, o: &LayoutOpening| {
        let kind = match o.kind {
            LayoutOpeningKind::Passage => OpeningKind::Door,
            LayoutOpeningKind::Window if !o.face.is_empty() => OpeningKind::Window,
            // What closes them is painted on the wall, or an object.
            LayoutOpeningKind::Window | LayoutOpeningKind::Door => return None,
        };
        Some(OpeningHint {
            kind,
            wall,
            face: o.face.iter().map(|p| pixel_of(p, size)).collect(),
            rise: o.arch_m.unwrap_or_default(),
            size: glam::DVec2::new(o.width_m, o.height_m),
        })
    };
    answer.walls.iter().flat_map(|w| w.openings.iter().filter_map(move |o| hint(w.orientation, o))).collect()
}

/// A place in thousandths as a pixel of an image of this size.
fn pixel_of(p: &[f64; 2], size: ImageSize) -> glam::DVec2 {
    glam::DVec2::new(p[0] * f64::from(size.width) / 1000.0, p[1] * f64::from(size.height) / 1000.0)
}

async fn ask(
    ctx: &PhaseCtx<'_>,
    photo: &Arc<RgbImage>,
    geometry: &GeometryAnswer,
    unaided: &RoomBox,
) -> Result<LayoutAnswer, PhaseError> {
    let depth = match geometry {
        GeometryAnswer::Points(map) if map.kind == harmony_scene::PointMapKind::Metric => KnownDepth::Metric,
        GeometryAnswer::Points(_) => KnownDepth::UpToScale,
        GeometryAnswer::NoDepth { .. } => KnownDepth::None,
    };
    let (centre, forward) = (unaided.camera.centre(), unaided.camera.forward());
    let question = LayoutQuestion {
        photo: ImageSize::new(photo.width(), photo.height()),
        depth,
        unaided: Some(UnaidedRoom {
            extents: unaided.extents,
            camera_height_m: centre.y,
            tilt_deg: (-forward.y).clamp(-1.0, 1.0).asin().to_degrees(),
            yaw_deg: (-forward.x).atan2(-forward.z).to_degrees(),
            dist_to_back_m: centre.z,
            confidence: unaided.confidence,
        }),
    };
    let pictures = vec![
        Picture { caption: "IMAGE 1: the photograph".into(), image: photo.clone() },
        Picture {
            caption: "IMAGE 2: the photograph with a coordinate grid (thousandths)".into(),
            image: Arc::new(grid_overlay(photo, 50).picture),
        },
    ];
    ctx.ask("layout", question, pictures).await
}

/// The layout answer in the words of the calibration, pixels of an image of this size.
pub fn layout_prior(answer: &LayoutAnswer, size: ImageSize) -> LayoutPrior {
    let pixel = |p: &[f64; 2]| pixel_of(p, size);
    let c = &answer.camera;
    let edges = answer
        .pins
        .iter()
        .map(|pin| PinnedEdge {
            edge: match pin.edge {
                PinKind::FloorBack => RoomEdge::FloorBack,
                PinKind::FloorLeft => RoomEdge::FloorLeft,
                PinKind::FloorRight => RoomEdge::FloorRight,
                PinKind::CeilingBack => RoomEdge::CeilingBack,
                PinKind::CeilingLeft => RoomEdge::CeilingLeft,
                PinKind::CeilingRight => RoomEdge::CeilingRight,
                PinKind::BackLeft => RoomEdge::BackLeft,
                PinKind::BackRight => RoomEdge::BackRight,
            },
            points: pin.points.iter().map(pixel).collect(),
        })
        .collect();
    let ceiling = [PinKind::CeilingBack, PinKind::CeilingLeft, PinKind::CeilingRight];
    let whole_walls = c.visible_wall_height_m > WHOLE_WALL * answer.room.ceiling_height_m;
    LayoutPrior {
        photo: size,
        ceiling_seen: whole_walls || answer.pins.iter().any(|pin| ceiling.contains(&pin.edge)),
        extents: Extents {
            width: answer.room.floor_width_m,
            height: answer.room.ceiling_height_m,
            depth: answer.room.floor_depth_m,
        },
        camera: CameraHints {
            height_m: Some(c.height_m),
            tilt_deg: Some(c.tilt_deg),
            yaw_deg: Some(c.yaw_deg),
            dist_to_back_m: Some(c.dist_to_back_m),
            corner_px: c.corner_px.as_ref().map(|p| pixel(p).to_array()),
            back_wall_side: Some(match c.back_wall_side {
                BackWallSide::Left => WallSide::Left,
                BackWallSide::Right => WallSide::Right,
                BackWallSide::Both => WallSide::Both,
            }),
            floor_junction_y_frac: Some(c.floor_junction_y_frac),
        },
        pins: LayoutPins { edges },
        passages: opening_hints(answer, size).into_iter().map(|hint| hint.face).collect(),
    }
}

fn tidy(text: &str) -> String {
    text.trim().to_lowercase().replace(' ', "_").chars().take(60).collect()
}

fn words(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), |s| s.replace('_', " "))
}

fn write_files(ctx: &PhaseCtx<'_>, state: &SceneState) -> Result<(), PhaseError> {
    ctx.write_json("room.json", &state.partial.room)?;
    ctx.write_json("layout_answer.json", &state.layout.answer)?;
    ctx.write_json(
        "camera.json",
        &json!({
            "camera": harmony_scene::SceneCamera::from(&state.partial.camera),
            "method": state.layout.method,
            "confidence": state.layout.confidence,
            "because": state.layout.because,
        }),
    )?;
    ctx.write_json("manhattan.json", &state.layout.evidence)?;
    ctx.write_picture("layout_overlay.png", &crate::views::layout_overlay(state))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Phase;
    use crate::testing::{Desk, photo};

    #[test]
    fn a_lens_that_calibration_changes_by_more_than_its_sigma_is_told() {
        assert_eq!(other_lens(1000.0, 1029.0), None);
        assert_eq!(other_lens(1000.0, 972.0), None);
        assert!(other_lens(1000.0, 1040.0).is_some_and(|told| told.contains("+4 %")));
        assert!(other_lens(1000.0, 900.0).is_some_and(|told| told.contains("-10 %")));
    }

    #[test]
    fn what_is_not_in_the_room_is_nobodys() {
        let size = ImageSize::new(200, 100);
        let notch = vec![[100.0, 100.0], [900.0, 100.0], [900.0, 900.0], [500.0, 500.0], [100.0, 900.0]];
        let mask = ignored(&[notch], size);
        assert!(mask.get(30, 30) && mask.get(170, 60) && !mask.get(100, 80) && !mask.get(5, 5));
        assert_eq!(ignored(&[], size).count(), 0);
    }

    #[tokio::test]
    async fn a_photo_that_shows_hardly_anything_gives_a_room_that_is_said_to_be_a_guess() {
        let desk = Desk::new();
        let mut photo = photo();
        photo.image = RgbImage::from_pixel(256, 192, image::Rgb([128; 3]));
        let working = Arc::new(photo.image.clone());
        let state = run(&desk.ctx(Phase::Layout), &photo, working).await.unwrap();
        let guess = desk.warnings.sorted().into_iter().find(|w| w.kind == WarningKind::LowConfidence).unwrap();
        assert!(guess.message.contains("are a guess"), "{}", guess.message);
        let sure = state.layout.confidence.unwrap();
        assert!(sure < 0.35, "{sure}");
        assert!(state.partial.points.is_none() && state.partial.room.extents.height > 1.0);
        let folder = Phase::Layout.folder();
        let camera = desk.json(&format!("{folder}/camera.json"));
        assert_eq!(camera["confidence"].as_f64(), Some(sure));
        for file in ["room.json", "layout_answer.json", "manhattan.json"] {
            assert!(!desk.json(&format!("{folder}/{file}")).is_null(), "{file}");
        }
    }

    #[test]
    fn pins_are_pixels_of_the_photo_and_a_ceiling_is_seen_by_its_pins_or_whole_walls() {
        let mut answer = LayoutAnswer::example();
        answer.pins.retain(|pin| pin.edge == PinKind::FloorBack);
        answer
            .pins
            .push(harmony_prompts::LayoutPin { edge: PinKind::FloorBack, points: vec![[0.0, 500.0], [1000.0, 250.0]] });
        answer.room.ceiling_height_m = 2.5;
        answer.camera.visible_wall_height_m = 2.0;
        let size = ImageSize::new(400, 200);
        let prior = layout_prior(&answer, size);
        let last = prior.pins.edges.last().unwrap();
        assert_eq!(last.edge, RoomEdge::FloorBack);
        assert_eq!(last.points, [glam::DVec2::new(0.0, 100.0), glam::DVec2::new(400.0, 50.0)]);
        assert!(!prior.ceiling_seen);
        answer.camera.visible_wall_height_m = 2.5;
        assert!(layout_prior(&answer, size).ceiling_seen, "the whole wall is seen");
        answer.camera.visible_wall_height_m = 2.0;
        answer.pins[0].edge = PinKind::CeilingBack;
        assert!(layout_prior(&answer, size).ceiling_seen, "its edge is pinned");
    }
}
