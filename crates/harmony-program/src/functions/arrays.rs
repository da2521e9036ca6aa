//! Copies, and how things are moved.

use std::f64::consts::TAU;

use glam::{DAffine3, DMat3, DVec3};
use harmony_shape::tree::{Kind, MAX_COORDINATE, NodeId};

use super::maths::Dice;
use crate::call::{ANGLE, COORDINATE, Call, Function, LENGTH0, Outcome, SHARE};
use crate::curves;
use crate::error::Complaint;
use crate::numbers::number;

type Columns = [[f64; 3]; 4];

/// Most copies of one call.
const COPIES: u32 = 20_000;

pub(crate) fn functions() -> Vec<Function> {
    vec![
        Function::new("row(part, n, step=None, to=None, ...)", row),
        Function::new("grid(part, n, span, ...)", grid),
        Function::new("ring(part, n, r, face_out=True, ...)", |c| {
            let parts = c.parts("part")?;
            let (n, r) = (c.need_count("n", 1..=COPIES)?, c.need_number("r", LENGTH0)?);
            let out = c.flag("face_out", true)?;
            let places = (0..n).map(|i| {
                let angle = TAU * f64::from(i) / f64::from(n);
                let at = DVec3::new(r * libm::sin(angle), 0.0, r * libm::cos(angle));
                DAffine3 { matrix3: if out { turn_y(angle) } else { DMat3::IDENTITY }, translation: at }
            });
            copies(c, &parts, &places.collect::<Vec<_>>())
        }),
        Function::new("along(curve, part, n=None, spacing=None, start=0, hang=False, jitter=0, seed=None, ...)", along),
        Function::new("scatter(parts, on, n, gap=0, seed=None, ...)", |c| {
            let count = c.need_count("n", 1..=5000)?;
            c.session.charge_places(u64::from(count))?;
            c.make(Kind::Scatter {
                children: c.parts("parts")?,
                on: c.part("on")?,
                count,
                gap: c.number("gap", 0.0, LENGTH0)?,
                seed: c.seed()?,
            })
        }),
        Function::new("mirror(part, axis=\"x\", about=(0, 0, 0), ...)", |c| {
            let parts = c.parts("part")?;
            let about = c.vector("about", Some(DVec3::ZERO))?;
            let axes = c.word("axis", &["x", "y", "z", "xz", "xy", "yz", "zx"], "x")?;
            let mut places = vec![DAffine3::IDENTITY];
            for axis in axes.chars() {
                let i = "xyz".find(axis).unwrap_or(0);
                let mut scale = DVec3::ONE;
                scale[i] = -1.0;
                let mut shift = DVec3::ZERO;
                shift[i] = 2.0 * about[i];
                let flip = DAffine3 { matrix3: DMat3::from_diagonal(scale), translation: shift };
                let flipped: Vec<DAffine3> = places.iter().map(|p| flip * *p).collect();
                places.extend(flipped);
            }
            copies(c, &parts, &places)
        }),
        Function::new("jitter(part, move=0, turn=0, scale=0, seed=None, ...)", jitter),
    ]
}

/// A turn about +y, from +z towards +x.
pub(crate) fn turn_y(angle: f64) -> DMat3 {
    let (s, k) = (libm::sin(angle), libm::cos(angle));
    DMat3::from_cols(DVec3::new(k, 0.0, -s), DVec3::Y, DVec3::new(s, 0.0, k))
}

/// Turns about x, then y, then z, degrees.
pub(crate) fn turn_xyz(degrees: DVec3) -> DMat3 {
    let pair = |a: f64| {
        let a = a.to_radians();
        (libm::sin(a), libm::cos(a))
    };
    let (sx, kx) = pair(degrees.x);
    let (sz, kz) = pair(degrees.z);
    let x = DMat3::from_cols(DVec3::X, DVec3::new(0.0, kx, sx), DVec3::new(0.0, -sx, kx));
    let z = DMat3::from_cols(DVec3::new(kz, sz, 0.0), DVec3::new(-sz, kz, 0.0), DVec3::Z);
    z * turn_y(degrees.y.to_radians()) * x
}

/// The columns that a node stores.
pub(crate) fn columns(map: &DAffine3) -> Columns {
    let m = map.matrix3;
    [m.x_axis.to_array(), m.y_axis.to_array(), m.z_axis.to_array(), map.translation.to_array()]
}

/// The map of columns.
pub(crate) fn affine(columns: &Columns) -> DAffine3 {
    let [x, y, z, at] = columns.map(DVec3::from);
    DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: at }
}

/// Moves a node. What was only moved (and has neither a name nor a look of its own since) is moved once, not twice.
pub(crate) fn place(c: &Call<'_, '_>, id: NodeId, map: DAffine3) -> Result<NodeId, Complaint> {
    let before = c.session.with_node(id, |node| match &node.kind {
        Kind::Placed { child, columns } if node.name.is_none() && node.material.is_none() => {
            Some((*child, affine(columns)))
        }
        _ => None,
    });
    let (child, map) = before.map_or((id, map), |(child, inner)| (child, map * inner));
    let columns = columns(&map);
    if columns.iter().flatten().any(|x| !x.is_finite() || x.abs() > MAX_COORDINATE) {
        return Err(Complaint::new("the part is moved or scaled beyond 100 m"));
    }
    c.add(Kind::Placed { child, columns }, None)
}

/// Copies of parts in turn: the first at the first place, the second at the second, and so on.
fn copies<'v>(c: &mut Call<'v, '_>, parts: &[NodeId], places: &[DAffine3]) -> Outcome<'v> {
    c.session.charge_places(places.len() as u64)?;
    let bad = |m: &DAffine3| columns(m).iter().flatten().any(|x| !x.is_finite() || x.abs() > MAX_COORDINATE);
    if places.iter().any(bad) {
        return Err(Complaint::new("a copy lies beyond 100 m").into());
    }
    if let [child] = parts {
        return c.make(Kind::Copies { child: *child, places: places.iter().map(columns).collect() });
    }
    let mut children = Vec::new();
    for (k, &child) in parts.iter().enumerate() {
        let own: Vec<Columns> = places.iter().skip(k).step_by(parts.len()).map(columns).collect();
        if !own.is_empty() {
            children.push(c.add(Kind::Copies { child, places: own }, None)?);
        }
    }
    c.make(Kind::Group { children })
}

fn row<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let parts = c.parts("part")?;
    let n = c.need_count("n", 1..=COPIES)?;
    // A number is a distance along x.
    let along = |c: &Call<'v, '_>, name: &str| match c.given(name).and_then(number) {
        Some(_) => c.need_number(name, COORDINATE).map(|x| DVec3::new(x, 0.0, 0.0)),
        None => c.vector(name, None),
    };
    let step = match (c.given("step"), c.given("to")) {
        (Some(_), None) => along(c, "step")?,
        (None, Some(_)) => along(c, "to")? / f64::from(n.max(2) - 1),
        (Some(_), Some(_)) => return Err(Complaint::new("row() takes step or to, not both").into()),
        (None, None) => {
            // Side by side.
            let width = parts.iter().map(|id| c.session.bounds(*id).map(|b| b.size().x)).collect::<Option<Vec<_>>>();
            let width = width.and_then(|w| w.into_iter().reduce(f64::max));
            let Some(width) = width else {
                return Err(Complaint::new(
                    "row() needs step or to: the width of the part is not known before it is meshed",
                )
                .into());
            };
            DVec3::new(width, 0.0, 0.0)
        }
    };
    let places: Vec<DAffine3> = (0..n).map(|i| DAffine3::from_translation(step * f64::from(i))).collect();
    copies(c, &parts, &places)
}

/// `n` by `n` by `n` copies, centred in x and z and from y = 0 upwards, the outer ones `span` apart.
fn grid<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let parts = c.parts("part")?;
    let [nx, ny, nz] = c.list::<3>("n", None, 1.0..=f64::from(COPIES))?.map(f64::trunc);
    let span = c.list::<3>("span", None, LENGTH0)?;
    if nx * ny * nz > f64::from(COPIES) {
        return Err(Complaint::limit(format!("grid() of {} copies; at most {COPIES} are allowed", nx * ny * nz)).into());
    }
    let step = |n: f64, i: u32, span: f64| if n > 1.0 { span * (f64::from(i) / (n - 1.0)) } else { 0.0 };
    let middle = |n: f64, i: u32, span: f64| if n > 1.0 { step(n, i, span) - span / 2.0 } else { 0.0 };
    let mut places = Vec::new();
    for iy in 0..ny as u32 {
        for iz in 0..nz as u32 {
            for ix in 0..nx as u32 {
                let at = DVec3::new(middle(nx, ix, span[0]), step(ny, iy, span[1]), middle(nz, iz, span[2]));
                places.push(DAffine3::from_translation(at));
            }
        }
    }
    copies(c, &parts, &places)
}

fn along<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let curve = c.curve("curve")?;
    let parts = c.parts("part")?;
    let length = curves::length(&curve);
    let start = c.number("start", 0.0, LENGTH0)?;
    let hang = c.flag("hang", false)?;
    let (jitter, seed) = (c.number("jitter", 0.0, SHARE)?, c.seed()?);
    let spots: Vec<f64> = match (c.given("n"), c.given("spacing")) {
        (Some(_), None) => {
            let n = c.need_count("n", 1..=COPIES)?;
            let left = (length - start).max(0.0);
            // A closed curve's end is its start.
            let gaps = if curve.closed { n } else { n.max(2) - 1 };
            (0..n).map(|i| start + left * f64::from(i) / f64::from(gaps)).collect()
        }
        (None, Some(_)) => {
            let spacing = c.need_number("spacing", 1e-4..=MAX_COORDINATE)?;
            let n = ((length - start).max(0.0) / spacing + 1e-9).floor() + 1.0;
            if n > f64::from(COPIES) {
                return Err(
                    Complaint::limit(format!("along() would make {n} copies; at most {COPIES} are allowed")).into()
                );
            }
            let n = if curve.closed { n - 1.0 } else { n }.max(1.0) as u32;
            (0..n).map(|i| start + spacing * f64::from(i)).collect()
        }
        _ => return Err(Complaint::new("along() needs n or spacing, one of them").into()),
    };
    // Finding each spot walks the curve.
    let steps = spots.len() * curve.points.len();
    if steps > 20_000_000 {
        return Err(Complaint::limit("along(): too many copies on a curve of too many points").into());
    }
    let mut dice = Dice::new(seed);
    let each = if spots.len() > 1 { spots[1] - spots[0] } else { 0.0 };
    let places = spots.into_iter().map(|s| {
        let shift = if jitter > 0.0 { jitter * each * (dice.unit() - 0.5) } else { 0.0 };
        let spun = if jitter > 0.0 { turn_y(TAU * jitter * (dice.unit() - 0.5)) } else { DMat3::IDENTITY };
        let (at, direction) = curves::at(&curve, if length > 0.0 { (s + shift) / length } else { 0.0 });
        let turn = if hang { DMat3::IDENTITY } else { curves::frame_along(direction) };
        DAffine3 { matrix3: turn * spun, translation: at }
    });
    let places: Vec<DAffine3> = places.collect();
    copies(c, &parts, &places)
}

/// A little disorder: each part (each copy, for copies) is moved by up to `move` metres, turned by up to `turn` degrees
/// (mostly about y) and scaled by up to the share `scale`.
fn jitter<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let parts = c.parts("part")?;
    let range = match c.given("move").and_then(number) {
        Some(_) => DVec3::splat(c.need_number("move", LENGTH0)?) * DVec3::new(1.0, 0.0, 1.0),
        None => c.vector("move", Some(DVec3::ZERO))?,
    };
    let turn = match c.given("turn").and_then(number) {
        Some(_) => DVec3::new(0.1, 1.0, 0.1) * c.need_number("turn", ANGLE)?,
        None => c.vector("turn", Some(DVec3::ZERO))?,
    };
    let scale = c.number("scale", 0.0, 0.0..=0.9)?;
    let mut dice = Dice::new(c.seed()?);
    let mut shake = |centre: DVec3| {
        let mut signed = || 2.0 * dice.unit() - 1.0;
        let by = DVec3::new(signed(), signed(), signed()) * range;
        let turn = turn_xyz(DVec3::new(signed(), signed(), signed()) * turn) * (1.0 + scale * signed());
        DAffine3 { matrix3: turn, translation: by + centre - turn * centre }
    };
    // Turned about its foot, so that it does not leave its place.
    let foot = |id: NodeId| c.session.bounds(id).map_or(DVec3::ZERO, |b| b.centre().with_y(b.min.y));
    let mut out = Vec::new();
    for id in parts {
        let spread = c.session.with_node(id, |n| match &n.kind {
            Kind::Copies { child, places } => Some((*child, places.clone())),
            _ => None,
        });
        let (child, places) = spread.unwrap_or((id, Vec::new()));
        if places.is_empty() {
            let map = shake(foot(id));
            out.push(place(c, id, map)?);
        } else {
            c.session.charge_places(places.len() as u64)?;
            let inner = foot(child);
            let shaken = places.iter().map(|p| columns(&(affine(p) * shake(inner)))).collect();
            out.push(c.add(Kind::Copies { child, places: shaken }, None)?);
        }
    }
    match out[..] {
        [one] if c.given("mat").is_none() && c.given("name").is_none() => c.part_value(one),
        _ => c.make(Kind::Group { children: out }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_about_x_then_y_then_z() {
        let close = |a: DVec3, b: DVec3| assert!((a - b).length() <= 1e-12, "{a} {b}");
        close(turn_y(TAU / 4.0) * DVec3::Z, DVec3::X);
        close(turn_xyz(DVec3::new(90.0, 0.0, 0.0)) * DVec3::Y, DVec3::Z);
        close(turn_xyz(DVec3::new(0.0, 0.0, 90.0)) * DVec3::X, DVec3::Y);
        // z -(x: -90)-> y -(z: 90)-> -x.
        close(turn_xyz(DVec3::new(-90.0, 0.0, 90.0)) * DVec3::Z, DVec3::NEG_X);
    }
}
