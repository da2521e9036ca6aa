//! Outlines in a plane.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::{DVec2, DVec3};
use harmony_shape::tree::Outline;

use crate::bounds::of_outline;
use crate::call::{ANGLE, COORDINATE, Call, Function, LENGTH, LENGTH0, Outcome};
use crate::curves;
use crate::error::Complaint;
use crate::outlines;
use crate::thing::Kind;

/// Most letters of a text.
const LETTERS: usize = 200;

pub(crate) fn functions() -> Vec<Function> {
    vec![
        Function::new("rect(w, h, r=0)", |c| {
            let (w, h) = (c.need_number("w", LENGTH)?, c.need_number("h", LENGTH)?);
            let r = c.number("r", 0.0, LENGTH0)?.min(w.min(h) / 2.0);
            simple(c, rounded_rect(w, h, r))
        }),
        Function::new("circle(r, r2=None)", |c| {
            let r = c.need_number("r", LENGTH)?;
            let r2 = c.number("r2", r, LENGTH)?;
            simple(c, ring(48, |_| 1.0).into_iter().map(|[x, y]| [x * r, y * r2]).collect())
        }),
        Function::new("ngon(n, r, star=0)", |c| {
            let (n, r) = (c.need_count("n", 3..=200)?, c.need_number("r", LENGTH)?);
            let star = c.number("star", 0.0, LENGTH0)?;
            if star >= r {
                let why = format!(
                    "star is the radius of the inner corners in metres, less than r: {star} is not less than {r}"
                );
                return Err(Complaint::new(&why).into());
            }
            let points = if star > 0.0 { ring(2 * n, |i| if i % 2 == 0 { r } else { star }) } else { ring(n, |_| r) };
            // A corner on top.
            simple(c, points.into_iter().map(|[x, y]| [-y, x]).collect())
        }),
        Function::new("polygon(points, smooth=False)", |c| {
            let mut points = c.points2("points")?;
            if points.len() > 3 && points.first() == points.last() {
                points.pop();
            }
            if points.len() < 3 {
                return Err(Complaint::new("a polygon needs three points at least").into());
            }
            if c.flag("smooth", false)? {
                c.session.charge_points(12 * points.len())?;
                let around: Vec<DVec3> = points.iter().map(|p| DVec3::new(p[0], p[1], 0.0)).collect();
                points = curves::spline(&around, true).into_iter().map(|[x, y, _]| [x, y]).collect();
            }
            if outlines::area2(&points).abs() < 1e-12 {
                return Err(Complaint::new("the polygon has no area").into());
            }
            simple(c, points)
        }),
        Function::new("heart(w)", |c| {
            let w = c.need_number("w", LENGTH)?;
            // x = 16 sin^3 t, y = 13 cos t - 5 cos 2t - 2 cos 3t - cos 4t: 32 wide, from -17 to about 12.
            let k = w / 32.0;
            let points = (0..56).map(|i| {
                let t = TAU * f64::from(i) / 56.0;
                let s = libm::sin(t);
                let y = 13.0 * libm::cos(t) - 5.0 * libm::cos(2.0 * t) - 2.0 * libm::cos(3.0 * t) - libm::cos(4.0 * t);
                [-16.0 * s * s * s * k, (y + 2.5) * k]
            });
            simple(c, points.collect())
        }),
        Function::new("text(s, size, weight=0.14)", |c| {
            let text = c.text("s")?.unwrap_or_default();
            if text.chars().count() > LETTERS {
                return Err(Complaint::limit(format!("a text of more than {LETTERS} letters")).into());
            }
            let (size, weight) = (c.need_number("size", LENGTH)?, c.number("weight", 0.14, 0.03..=0.4)?);
            c.session.charge_points(60 * text.len())?;
            let outline = outlines::text(text, size, weight);
            finish(c, outline.ok_or_else(|| Complaint::new("text() has nothing to draw"))?)
        }),
    ]
}

pub(crate) fn methods() -> Vec<Function> {
    vec![
        Function::new("hole(o)", |c| {
            let hole = c.outline("o")?;
            let left = outlines::difference(&own(c), &hole);
            finish(c, left.ok_or_else(|| Complaint::new("the hole leaves nothing of the outline"))?)
        }),
        Function::new("minus(o)", |c| {
            let hole = c.outline("o")?;
            let left = outlines::difference(&own(c), &hole);
            finish(c, left.ok_or_else(|| Complaint::new("minus() leaves nothing of the outline"))?)
        }),
        Function::new("plus(o)", |c| {
            let other = c.outline("o")?;
            let both = outlines::union(&own(c), &other);
            finish(c, both.ok_or_else(|| Complaint::new("plus() gives nothing"))?)
        }),
        Function::new("offset(d)", |c| {
            let d = c.need_number("d", COORDINATE)?;
            c.session.charge_points(20 * own(c).points.len())?;
            let moved = outlines::offset(&own(c), d);
            finish(c, moved.ok_or_else(|| Complaint::new(format!("offset({d}) leaves nothing of the outline")))?)
        }),
        Function::new("at(x=0, y=0)", |c| {
            let by = DVec2::new(c.number("x", 0.0, COORDINATE)?, c.number("y", 0.0, COORDINATE)?);
            mapped(c, &|p| p + by)
        }),
        Function::new("turn(a)", |c| {
            let angle = c.need_number("a", ANGLE)?.to_radians();
            let (s, k) = (libm::sin(angle), libm::cos(angle));
            mapped(c, &|p| DVec2::new(k * p.x - s * p.y, s * p.x + k * p.y))
        }),
        Function::new("scale(s, sy=None)", |c| {
            let s = c.need_number("s", LENGTH)?;
            let sy = c.number("sy", s, LENGTH)?;
            mapped(c, &|p| DVec2::new(p.x * s, p.y * sy))
        }),
    ]
}

fn ring(n: u32, radius: impl Fn(u32) -> f64) -> Vec<[f64; 2]> {
    (0..n)
        .map(|i| {
            let angle = TAU * f64::from(i) / f64::from(n);
            [radius(i) * libm::cos(angle), radius(i) * libm::sin(angle)]
        })
        .collect()
}

/// A rectangle about the origin with round corners.
pub(crate) fn rounded_rect(w: f64, h: f64, r: f64) -> Vec<[f64; 2]> {
    let (x, y) = (w / 2.0, h / 2.0);
    if r <= 0.0 {
        return vec![[-x, -y], [x, -y], [x, y], [-x, y]];
    }
    let corners = [(x - r, y - r), (r - x, y - r), (r - x, r - y), (x - r, r - y)];
    let mut points = Vec::new();
    for (q, (cx, cy)) in corners.into_iter().enumerate() {
        for i in 0..=6 {
            let angle = (q as f64 + f64::from(i) / 6.0) * TAU / 4.0;
            points.push([cx + r * libm::cos(angle), cy + r * libm::sin(angle)]);
        }
    }
    points.dedup_by(|a, b| DVec2::from(*a).distance(DVec2::from(*b)) < 1e-9);
    points
}

fn own(c: &Call<'_, '_>) -> Arc<Outline> {
    match &c.receiver {
        Some(Kind::Outline(outline)) => outline.clone(),
        _ => Arc::default(),
    }
}

fn apply(outline: &Outline, map: &dyn Fn(DVec2) -> DVec2) -> Outline {
    let each = |l: &Vec<[f64; 2]>| l.iter().map(|p| map((*p).into()).to_array()).collect();
    Outline {
        points: each(&outline.points),
        holes: outline.holes.iter().map(each).collect(),
        islands: outline.islands.iter().map(|i| apply(i, map)).collect(),
    }
}

fn mapped<'v>(c: &Call<'v, '_>, map: &dyn Fn(DVec2) -> DVec2) -> Outcome<'v> {
    finish(c, apply(&own(c), map))
}

/// An outline moved upwards until nothing of it is below y = 0.
pub(crate) fn standing(outline: &Outline) -> Outline {
    let low = of_outline(outline).map_or(0.0, |[min, _]| min[1]).min(0.0);
    apply(outline, &|p| p - DVec2::new(0.0, low))
}

fn simple<'v>(c: &Call<'v, '_>, points: Vec<[f64; 2]>) -> Outcome<'v> {
    finish(c, Outline { points: outlines::anticlockwise(points), ..Outline::default() })
}

fn finish<'v>(c: &Call<'v, '_>, outline: Outline) -> Outcome<'v> {
    c.session.charge_points(count(&outline))?;
    match of_outline(&outline) {
        Some([min, max]) if min.iter().chain(&max).all(|x| x.is_finite() && x.abs() <= *COORDINATE.end()) => {
            c.value(Kind::Outline(Arc::new(outline)))
        }
        _ => Err(Complaint::new("the outline leaves the space of 100 m").into()),
    }
}

fn count(outline: &Outline) -> usize {
    outline.points.len()
        + outline.holes.iter().map(Vec::len).sum::<usize>()
        + outline.islands.iter().map(count).sum::<usize>()
}
