//! The list of things: sizes, places, how sure they are.
//!
//! # Plus and minus
//! A scene says of each object with which probability its pose is within 0.15 m, 10 degrees and 12 % of the truth. One sigma
//! follows when the errors are taken as normal and each of the three as if it alone made up the rest: of the place in the
//! floor's plane `0.15 / sqrt(-2 ln(1 - p))` (Rayleigh), of the size and of the yaw by the normal distribution. Each is an
//! upper bound of what the probability says; an object without evidence (p below 0.01) has none.

use harmony_scene::{Ledge, Level, Size, Support};

use crate::World;

/// What the probability of a scene's objects speaks about: metres, radians, relative size.
const WITHIN: (f64, f64, f64) = (0.15, 10.0, 0.12);
/// A probability above this says no more than this one.
const SUREST: f64 = 0.999;
/// One below this says nothing: the sigma that follows would be wider than the room.
const LEAST: f64 = 0.01;

/// One thing of the list.
#[derive(Debug, Clone)]
pub struct Row {
    /// Number in the drawings, from 1.
    pub number: usize,
    /// Index into the world's items.
    pub item: usize,
    /// Label.
    pub label: String,
    /// Size before the turn, metres.
    pub size: Size,
    /// One sigma of the place, metres.
    pub position_pm: Option<f64>,
    /// One sigma of the size, relative.
    pub size_pm: Option<f64>,
    /// One sigma of the yaw, degrees.
    pub yaw_pm_deg: Option<f64>,
    /// Probability as in `scene.json`.
    pub confidence: f64,
}

/// The list, furniture first, then what hangs on walls and under the ceiling, then what stands on furniture.
pub fn rows(world: &World) -> Vec<Row> {
    let order = [Level::Furniture, Level::Wall, Level::Ceiling, Level::Decoration];
    let mut out = Vec::new();
    for level in order {
        for (item, of) in world.items.iter().enumerate().filter(|(_, i)| i.object.level == level) {
            let o = &of.object;
            let p = o.confidence.overall;
            out.push(Row {
                number: out.len() + 1,
                item,
                label: clean(&o.label),
                size: o.size,
                position_pm: rayleigh(p, WITHIN.0),
                size_pm: normal(p, (1.0 + WITHIN.2).ln()),
                yaw_pm_deg: normal(p, WITHIN.1),
                confidence: if p.is_finite() { p.clamp(0.0, 1.0) } else { 0.0 },
            });
        }
    }
    out
}

fn clean(label: &str) -> String {
    label.chars().filter(|c| !c.is_control()).take(60).collect()
}

fn sure(p: f64) -> Option<f64> {
    (p.is_finite() && p >= LEAST).then(|| p.min(SUREST))
}

/// Sigma of each of two normal errors whose length is below `within` with probability `p`.
fn rayleigh(p: f64, within: f64) -> Option<f64> {
    sure(p).map(|p| within / (-2.0 * (1.0 - p).ln()).sqrt())
}

/// Sigma of a normal error that is within `within` of zero with probability `p`.
fn normal(p: f64, within: f64) -> Option<f64> {
    sure(p).map(|p| within / quantile(f64::midpoint(1.0, p)))
}

/// Quantile of the standard normal distribution for 0.5 < q < 1, by halving: `erf` by its series.
fn quantile(q: f64) -> f64 {
    let below = |z: f64| {
        // Abramowitz and Stegun 7.1.5.
        let x = z / std::f64::consts::SQRT_2;
        let (mut term, mut sum) = (x, x);
        for n in 1..80 {
            term *= -x * x / f64::from(n);
            sum += term / f64::from(2 * n + 1);
        }
        0.5 + sum / std::f64::consts::PI.sqrt()
    };
    let (mut low, mut high) = (1e-6, 4.0);
    for _ in 0..60 {
        let middle = f64::midpoint(low, high);
        if below(middle) < q { low = middle } else { high = middle }
    }
    high
}

/// The list as CSV (RFC 4180), one header line.
pub fn csv(world: &World, rows: &[Row]) -> String {
    let mut out = String::from(
        "no,id,label,level,support,wall,x_m,y_m,z_m,yaw_deg,width_m,depth_m,height_m,confidence,position_pm_m,yaw_pm_deg,size_pm_percent,\
         silhouette_iou,depth_residual_m,mesh_source\r\n",
    );
    let number = |v: f64, d: usize| crate::text::num(v, d);
    let maybe = |v: Option<f64>, d: usize| v.map_or(String::new(), |v| number(v, d));
    for row in rows {
        let o = &world.items[row.item].object;
        let p = o.pose.position;
        let (support, wall) = match &o.support {
            Support::Floor => ("floor".to_owned(), String::new()),
            Support::Ceiling => ("ceiling".to_owned(), String::new()),
            Support::Wall { wall } => ("wall".to_owned(), wall.surface().name().to_owned()),
            Support::Object { id } => (id.to_string(), String::new()),
            Support::Block { block } => (Ledge::Block(*block).id().to_string(), String::new()),
            Support::Niche { niche } => (Ledge::Niche(*niche).id().to_string(), String::new()),
        };
        let wall = if wall.is_empty() {
            o.relations.wall_affinity.wall().map_or(String::new(), |w| w.surface().name().to_owned())
        } else {
            wall
        };
        let fields = [
            row.number.to_string(),
            o.id.to_string(),
            row.label.clone(),
            o.level.stage().to_owned(),
            support,
            wall,
            number(p.x, 4),
            number(p.y, 4),
            number(p.z, 4),
            number(o.pose.yaw.to_degrees(), 2),
            number(o.size.width, 4),
            number(o.size.depth, 4),
            number(o.size.height, 4),
            number(row.confidence, 4),
            maybe(row.position_pm, 3),
            maybe(row.yaw_pm_deg, 2),
            maybe(row.size_pm.map(|v| v * 100.0), 2),
            maybe(o.confidence.silhouette_iou, 4),
            maybe(o.confidence.depth_residual_m, 4),
            clean(&o.mesh_source),
        ];
        out.push_str(&fields.map(|f| quoted(&f)).join(","));
        out.push_str("\r\n");
    }
    out
}

fn quoted(field: &str) -> String {
    // A cell that begins like a formula would be run by spreadsheets; numbers begin so rightly.
    let formula = field.starts_with(['=', '+', '@']) || (field.starts_with('-') && field.parse::<f64>().is_err());
    let field = if formula { format!("'{field}") } else { field.to_owned() };
    if field.contains([',', '"', '\n', '\r']) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sigmas_follow_from_probabilities() {
        // Tables of the normal distribution: 68.27 % within one sigma, 95.45 % within two.
        assert!((normal(0.682_69, 1.0).unwrap() - 1.0).abs() < 1e-4);
        assert!((normal(0.954_50, 1.0).unwrap() - 0.5).abs() < 1e-4);
        // Rayleigh: 39.35 % within one sigma.
        assert!((rayleigh(0.393_47, 0.15).unwrap() - 0.15).abs() < 1e-4);
        assert!(normal(0.0, 1.0).is_none() && rayleigh(f64::NAN, 1.0).is_none());
        // 61 m for an object of which nothing is known.
        assert!(rayleigh(0.000_003, 0.15).is_none() && rayleigh(0.02, 0.15).unwrap() < 1.0);
        assert!(normal(1.0, 1.0).unwrap() > 0.0);
    }

    #[test]
    fn cells_are_quoted_and_no_formulas() {
        assert_eq!(quoted("a \"b\", c"), "\"a \"\"b\"\", c\"");
        assert_eq!(quoted("=1+1"), "'=1+1");
        assert_eq!(quoted("-0.5"), "-0.5");
    }
}
