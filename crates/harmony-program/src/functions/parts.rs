//! Methods of parts: moving, resting, painting.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};
use harmony_shape::tree::Kind;

use super::arrays::{place, turn_xyz};
use crate::call::{Call, FACES, Function, LENGTH, Outcome, SHARE};
use crate::error::Complaint;
use crate::numbers::number;
use crate::thing;

pub(crate) fn methods() -> Vec<Function> {
    vec![
        Function::new("at(x=0, y=0, z=0)", |c| {
            let map = DAffine3::from_translation(c.position()?);
            moved(c, map)
        }),
        Function::new("turn(x=0, y=0, z=0)", |c| {
            let map = DAffine3::from_mat3(turn_xyz(c.angles()?));
            moved(c, map)
        }),
        Function::new("aim(axis, dir)", |c| {
            c.need("axis")?;
            let (from, to) = (c.axis_vector("axis", DVec3::Y)?, c.vector("dir", None)?);
            let to = to.try_normalize().ok_or_else(|| Complaint::new("aim(): dir is (0, 0, 0)"))?;
            moved(c, DAffine3::from_mat3(between(from, to)))
        }),
        Function::new("scale(s)", |c| {
            let value = c.need("s")?;
            let s = match number(value) {
                Some(_) => DVec3::splat(c.need_number("s", LENGTH)?),
                None => c.list::<3>("s", None, LENGTH)?.into(),
            };
            moved(c, DAffine3::from_mat3(DMat3::from_diagonal(s)))
        }),
        Function::new("on(other, u=0.5, v=0.5)", |c| {
            let (u, v) = (c.number("u", 0.5, SHARE)?, c.number("v", 0.5, SHARE)?);
            let other = c.part("other")?;
            let id = c.add(Kind::On { child: c.own_part(), other, u, v }, None)?;
            c.part_value(id)
        }),
        Function::new("against(other, side=\"front\")", |c| {
            let side = c.choice("side", &FACES, Some(harmony_shape::tree::Face::Front))?;
            let other = c.part("other")?;
            let id = c.add(Kind::Against { child: c.own_part(), other, side }, None)?;
            c.part_value(id)
        }),
        Function::new("hem(side=\"all\")", hem),
        Function::new("paint(face, mat)", |c| {
            let face = c.choice("face", &FACES, None)?;
            let with = c.material("mat")?.ok_or_else(|| Complaint::new("paint() needs a mat"))?;
            let id = c.add(Kind::Paint { child: c.own_part(), face, with }, None)?;
            c.part_value(id)
        }),
        Function::new("named(name)", |c| {
            let name = c.text("name")?.unwrap_or_default().to_owned();
            let id = super::assembly::named(c, c.own_part(), &name)?;
            c.part_value(id)
        }),
    ]
}

fn moved<'v>(c: &mut Call<'v, '_>, map: DAffine3) -> Outcome<'v> {
    let id = place(c, c.own_part(), map)?;
    c.part_value(id)
}

/// The shortest turn that brings one direction onto another.
fn between(from: DVec3, to: DVec3) -> DMat3 {
    let (cos, axis) = (from.dot(to), from.cross(to));
    if axis.length() < 1e-9 {
        if cos > 0.0 {
            return DMat3::IDENTITY;
        }
        // Half a turn about anything across.
        let across = from.any_orthonormal_vector();
        return DMat3::from_cols(
            2.0 * across.x * across - DVec3::X,
            2.0 * across.y * across - DVec3::Y,
            2.0 * across.z * across - DVec3::Z,
        );
    }
    // Rodrigues' formula with the sine in the axis: I + K + K^2 / (1 + cos).
    let k = DMat3::from_cols(
        DVec3::new(0.0, axis.z, -axis.y),
        DVec3::new(-axis.z, 0.0, axis.x),
        DVec3::new(axis.y, -axis.x, 0.0),
    );
    DMat3::IDENTITY + k + k * k * (1.0 / (1.0 + cos))
}

fn hem<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let id = c.own_part();
    let cloth = c.session.with_node(id, |n| {
        matches!(n.kind, Kind::Drape { .. } | Kind::Hang { .. } | Kind::BentSheet { .. } | Kind::Folded { .. })
            || matches!(n.kind, Kind::Placed { .. })
    });
    if !cloth {
        let is = c.session.describe(id);
        return Err(Complaint::new(format!("hem() of a {is}")).with_hint("drape() and hang() have hems").into());
    }
    let side = c.word("side", &["head", "foot", "left", "right", "top", "bottom", "all"], "all")?;
    c.value(thing::Kind::Hem(id, Arc::from(side)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn aiming_brings_the_axis_onto_the_direction_and_keeps_lengths() {
        let to = DVec3::new(1.0, -2.0, 0.5).normalize();
        for from in [DVec3::X, DVec3::Y, DVec3::Z, to, -to] {
            let m = between(from, to);
            assert!((m * from - to).length() <= 1e-12);
            assert!((m.determinant() - 1.0).abs() <= 1e-12);
        }
    }
}
