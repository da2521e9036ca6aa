//! Curves.

use std::sync::Arc;

use glam::DVec3;
use harmony_shape::tree::Curve;
use starlark::values::Value;

use crate::call::{ANGLE, COORDINATE, Call, Function, LENGTH, LENGTH0, Outcome};
use crate::curves;
use crate::error::Complaint;
use crate::numbers::items;
use crate::thing::{Kind, Thing};

pub(crate) fn functions() -> Vec<Function> {
    vec![
        Function::new("line(points, closed=False)", |c| {
            let points = c.points("points")?;
            finish(c, points, c.flag("closed", false)?)
        }),
        Function::new("spline(points, closed=False)", |c| {
            let points: Vec<DVec3> = c.points("points")?.into_iter().map(DVec3::from).collect();
            let closed = c.flag("closed", false)?;
            c.session.charge_points(12 * points.len())?;
            finish(c, curves::spline(&points, closed), closed)
        }),
        Function::new("arc(c, r, a0, a1, axis=\"y\")", |c| {
            let axis = c.axis_vector("axis", DVec3::Y)?;
            let (centre, r) = (c.vector("c", None)?, c.need_number("r", LENGTH)?);
            let turn = -3600.0..=3600.0;
            let points = curves::arc(centre, r, c.need_number("a0", turn.clone())?, c.need_number("a1", turn)?, axis);
            finish(c, points, false)
        }),
        Function::new("helix(r, pitch, turns, r2=None)", |c| {
            let r = c.need_number("r", LENGTH0)?;
            let r2 = c.number("r2", r, LENGTH0)?;
            let points =
                curves::helix(r, r2, c.need_number("pitch", COORDINATE)?, c.need_number("turns", 0.01..=200.0)?);
            finish(c, points, false)
        }),
        Function::new("catenary(a, b, slack=1.03, sag=None)", |c| {
            let (a, b) = (c.vector("a", None)?, c.vector("b", None)?);
            let mut slack = c.number("slack", 1.03, 1.0..=20.0)?;
            if c.given("sag").is_some() {
                slack = curves::slack_for_sag(a, b, c.need_number("sag", 0.0..=20.0)?);
            }
            finish(c, curves::catenary(a, b, slack), false)
        }),
        Function::new("join_curves(curves, closed=False)", |c| {
            let value = c.need("curves")?;
            let mut points: Vec<[f64; 3]> = Vec::new();
            for &item in items(value).ok_or_else(|| c.refuse("curves", value, "a list of curves"))? {
                let Some(Kind::Curve(curve)) = Thing::from_value(item).map(|t| &t.kind) else {
                    return Err(c.refuse("curves", item, "a list of curves").into());
                };
                c.session.charge_points(curve.points.len())?;
                for p in &curve.points {
                    if points.last().is_none_or(|q| DVec3::from(*q).distance((*p).into()) > 1e-6) {
                        points.push(*p);
                    }
                }
            }
            finish(c, points, c.flag("closed", false)?)
        }),
    ]
}

pub(crate) fn methods() -> Vec<Function> {
    vec![
        Function::new("at(t)", |c| {
            let curve = own(c);
            let (point, _) = curves::at(&curve, c.need_number("t", -1e-6..=1.0 + 1e-6)?);
            c.value(Kind::Vector(point))
        }),
        Function::new("tangent(t)", |c| {
            let curve = own(c);
            let (_, direction) = curves::at(&curve, c.need_number("t", -1e-6..=1.0 + 1e-6)?);
            c.value(Kind::Vector(direction))
        }),
        Function::new("offset(d)", |c| {
            let curve = own(c);
            c.session.charge_points(curve.points.len())?;
            let moved = curves::offset(&curve, c.need_number("d", COORDINATE)?);
            c.value(Kind::Curve(Arc::new(moved)))
        }),
        Function::new("move(x=0, y=0, z=0)", |c| {
            let by = c.position()?;
            mapped(c, |p| p + by)
        }),
        Function::new("reversed()", |c| {
            let mut curve = (*own(c)).clone();
            c.session.charge_points(curve.points.len())?;
            curve.points.reverse();
            c.value(Kind::Curve(Arc::new(curve)))
        }),
    ]
}

fn mapped<'v>(c: &Call<'v, '_>, map: impl Fn(DVec3) -> DVec3) -> Outcome<'v> {
    let curve = own(c);
    let points = curve.points.iter().map(|p| map((*p).into()).to_array()).collect();
    finish(c, points, curve.closed)
}

fn own(c: &Call<'_, '_>) -> Arc<Curve> {
    match &c.receiver {
        Some(Kind::Curve(curve)) => curve.clone(),
        _ => Arc::default(),
    }
}

fn finish<'v>(c: &Call<'v, '_>, points: Vec<[f64; 3]>, closed: bool) -> Outcome<'v> {
    c.session.charge_points(points.len())?;
    if points.len() < 2 {
        return Err(Complaint::new("a curve needs two points at least").into());
    }
    if let Some(p) = points.iter().find(|p| p.iter().any(|x| !x.is_finite() || x.abs() > *COORDINATE.end())) {
        return Err(Complaint::new(format!("the curve leaves the space of 100 m at {p:?}")).into());
    }
    c.value(Kind::Curve(Arc::new(Curve { points, closed })))
}

impl<'v> Call<'v, '_> {
    /// A direction by name ("x", "y", "z") or as a vector.
    pub fn axis_vector(&self, name: &str, default: DVec3) -> Result<DVec3, Complaint> {
        let Some(value) = self.given(name) else { return Ok(default) };
        let named = match value.unpack_str() {
            Some("x" | "+x") => Some(DVec3::X),
            Some("y" | "+y") => Some(DVec3::Y),
            Some("z" | "+z") => Some(DVec3::Z),
            Some("-x") => Some(DVec3::NEG_X),
            Some("-y") => Some(DVec3::NEG_Y),
            Some("-z") => Some(DVec3::NEG_Z),
            Some(_) => return Err(self.refuse(name, value, "\"x\", \"y\", \"z\" or a direction (x, y, z)")),
            None => self.point(name, value)?.try_normalize(),
        };
        named.ok_or_else(|| self.refuse(name, value, "\"x\", \"y\", \"z\" or a direction that is not (0, 0, 0)"))
    }

    /// Arguments `x, y, z`, or one point in place of `x`.
    pub fn position(&self) -> Result<DVec3, Complaint> {
        if let Some(value) = self.given("x")
            && (items(value).is_some() || Thing::from_value(value).is_some())
        {
            return self.point("x", value);
        }
        Ok(DVec3::new(
            self.number("x", 0.0, COORDINATE)?,
            self.number("y", 0.0, COORDINATE)?,
            self.number("z", 0.0, COORDINATE)?,
        ))
    }

    /// Arguments `x, y, z` as angles, degrees.
    pub fn angles(&self) -> Result<DVec3, Complaint> {
        Ok(DVec3::new(self.number("x", 0.0, ANGLE)?, self.number("y", 0.0, ANGLE)?, self.number("z", 0.0, ANGLE)?))
    }

    /// Elements of a list argument.
    pub fn elements(&self, name: &str) -> Result<&'v [Value<'v>], Complaint> {
        let value = self.need(name)?;
        items(value).ok_or_else(|| self.refuse(name, value, "a list"))
    }
}
