//! The metric scale of a point map.
//!
//! Where floor and ceiling are both measured, the told height over the length of the anchor edge is the scale (paper
//! Sec. 3.1). Without one of them it is the mean of what is left, camera height, width, distance to the back wall,
//! weighted by their sigmas (logarithms). A metric map keeps its own, and says how far the told height was off. Metres
//! a unit of the map. Where the ceiling is not seen it is known to a tenth or so; later, sizes of objects correct it.

use harmony_scene::{PointMapKind, Surface, Vec3};

use super::complete::PointRange;
use super::{Measured, hint};
use crate::LayoutPrior;
use crate::room_box::USUAL_CAMERA_HEIGHT;

/// One sigma of the logarithm of what a prior says.
const SIGMA_HINTED_HEIGHT: f64 = 0.12;
const SIGMA_USUAL_HEIGHT: f64 = 0.2;
const SIGMA_DISTANCE: f64 = 0.2;
const SIGMA_WIDTH: f64 = 0.2;
const SIGMA_LOWEST_POINT: f64 = 0.35;

/// The scale, and where it is from.
pub(super) struct Scale {
    pub value: f64,
    pub source: String,
    /// Measured room height over the prior's, with a metric map that sees floor and ceiling.
    pub height_ratio: Option<f64>,
    pub notes: Vec<String>,
}

/// The metric scale (key `cam.scale`): `s = H_room / |X_c - X_f|` where floor and ceiling are seen.
///
/// `camera` and `range` are coordinates along the axes, unit of the map.
pub(super) fn metric_scale(
    kind: PointMapKind,
    prior: &LayoutPrior,
    m: &Measured,
    camera: Vec3,
    range: &PointRange,
    median_depth: f64,
) -> Scale {
    let height = prior.extents.height;
    let edge = m.offset(Surface::Floor).zip(m.offset(Surface::Ceiling)).map(|(f, c)| c - f);
    if kind == PointMapKind::Metric {
        let ratio = edge.map(|e| e / height);
        let notes = ratio
            .filter(|r| !(0.85..=1.18).contains(r))
            .map(|r| format!("the room measures {:.2} m in height, the prior says {height:.2} m", r * height))
            .into_iter()
            .collect();
        return Scale { value: 1.0, source: "the map is metric".into(), height_ratio: ratio, notes };
    }
    if let Some(edge) = edge.filter(|e| *e > 0.0) {
        return Scale {
            value: height / edge,
            source: "room height over the anchor edge".into(),
            height_ratio: None,
            notes: vec![],
        };
    }
    from_cues(prior, m, camera, range, median_depth)
}

/// One way to the scale: `length` in the map is `metres` in the room.
struct Cue {
    log: f64,
    sigma: f64,
    name: &'static str,
}

fn from_cues(prior: &LayoutPrior, m: &Measured, camera: Vec3, range: &PointRange, median_depth: f64) -> Scale {
    let room_height = prior.extents.height;
    let hinted = hint(prior.camera.height_m, 0.1, 0.98 * room_height);
    let camera_height = hinted.unwrap_or(USUAL_CAMERA_HEIGHT.min(0.7 * room_height));
    let sigma_height = if hinted.is_some() { SIGMA_HINTED_HEIGHT } else { SIGMA_USUAL_HEIGHT };
    let mut cues: Vec<Cue> = Vec::new();
    let cue = |cues: &mut Vec<Cue>, metres: f64, length: f64, sigma: f64, name| {
        if metres > 0.0 && length > 1e-6 * median_depth {
            cues.push(Cue { log: (metres / length).ln(), sigma, name });
        }
    };
    if let Some(floor) = m.offset(Surface::Floor) {
        cue(&mut cues, camera_height, camera.y - floor, sigma_height, "camera height");
    } else if let Some(ceiling) = m.offset(Surface::Ceiling) {
        cue(&mut cues, room_height - camera_height, ceiling - camera.y, 1.5 * sigma_height, "camera to ceiling");
    } else {
        cue(
            &mut cues,
            camera_height,
            camera.y - range.low.y,
            SIGMA_LOWEST_POINT,
            "camera height over the lowest points",
        );
    }
    if let (Some(left), Some(right)) = (m.offset(Surface::Left), m.offset(Surface::Right)) {
        cue(&mut cues, prior.extents.width, right - left, SIGMA_WIDTH, "room width");
    }
    if let (Some(back), Some(distance)) = (m.offset(Surface::Back), hint(prior.camera.dist_to_back_m, 0.2, 40.0)) {
        cue(&mut cues, distance, camera.z - back, SIGMA_DISTANCE, "distance to the back wall");
    }
    if cues.is_empty() {
        cue(&mut cues, 0.6 * prior.extents.depth, median_depth, 0.5, "typical distance");
    }
    let total: f64 = cues.iter().map(|c| c.sigma.powi(-2)).sum();
    let log = cues.iter().map(|c| c.log * c.sigma.powi(-2)).sum::<f64>() / total;
    let mut value = log.exp();
    let names: Vec<&str> = cues.iter().map(|c| c.name).collect();
    let source = names.join(", ");
    let mut notes = vec![format!("floor and ceiling are not both seen: scale from {source}")];

    // What is seen of the room above its floor is no higher than the room.
    if let Some(floor) = m.offset(Surface::Floor) {
        let visible = range.high.y - floor;
        if visible * value > room_height {
            notes.push(format!("points reach {:.2} m high by that scale: the room height bounds it", visible * value));
            value = room_height / visible;
        }
    }
    Scale { value, source, height_ratio: None, notes }
}
