//! Bodies, colliders and their materials (UsdPhysics).

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use harmony_physics::{Bodies, Body, Hull, Motion};

use super::text::{Text, schemas, tuple};
use crate::moving::PartBody;
use crate::text::num;
use crate::world::{Jointed, wxyz, z_up, z_up_rotation};

/// Friction of the room's faces: dry wood on wood, as the objects' friction is told against wood.
pub(super) const ROOM_FRICTION: f64 = 0.4;

/// Physics materials by what they say, and their names.
#[derive(Debug, Default)]
pub(super) struct Frictions {
    names: BTreeMap<(u64, u64), String>,
}

fn thousandths(v: f64) -> u64 {
    (v.clamp(0.0, 10.0) * 1000.0).round() as u64
}

impl Frictions {
    pub fn of(bodies: &Bodies) -> Self {
        let mut out = Self::default();
        for (friction, restitution) in
            bodies.objects.iter().map(|b| (b.friction, b.restitution)).chain([(ROOM_FRICTION, 0.0)])
        {
            let key = (thousandths(friction), thousandths(restitution));
            out.names.entry(key).or_insert_with(|| format!("physics_{:04}_{:04}", key.0, key.1));
        }
        out
    }

    pub fn path(&self, friction: f64, restitution: f64) -> String {
        let key = (thousandths(friction), thousandths(restitution));
        format!("/World/Looks/{}", self.names.get(&key).map_or("physics", String::as_str))
    }

    pub fn write(&self, text: &mut Text) {
        for ((friction, restitution), name) in &self.names {
            let (f, r) = (num(*friction as f64 / 1000.0, 3), num(*restitution as f64 / 1000.0, 3));
            text.prim("Material", name, &[schemas(&["PhysicsMaterialAPI"])], |t| {
                t.line(&format!("float physics:staticFriction = {f}"));
                t.line(&format!("float physics:dynamicFriction = {f}"));
                t.line(&format!("float physics:restitution = {r}"));
            });
        }
    }
}

/// Schemas of an object's prim.
pub(super) fn body_schemas(body: &Body) -> Vec<&'static str> {
    match body.motion {
        Motion::Dynamic => vec!["PhysicsRigidBodyAPI", "PhysicsMassAPI"],
        Motion::Static => Vec::new(),
    }
}

/// Mass, its centre and its inertia.
///
/// `share` is what of the mass stays with the body when parts of it open.
pub(super) fn body(text: &mut Text, body: &Body, share: f64) {
    if body.motion == Motion::Static {
        return;
    }
    text.line("bool physics:rigidBodyEnabled = 1");
    text.line(&format!("float physics:mass = {}", num(body.mass_kg * share, 6)));
    text.line(&format!("point3f physics:centerOfMass = {}", tuple(&z_up(body.centre_of_mass).to_array(), 6)));
    let (moments, axes) = principal(&body.inertia_matrix());
    text.line(&format!("float3 physics:diagonalInertia = {}", tuple(&(moments * share).to_array(), 9)));
    text.line(&format!("quatf physics:principalAxes = {}", tuple(&wxyz(z_up_rotation(axes)), 7)));
}

/// Mass of a part that opens.
pub(super) fn part(text: &mut Text, part: &PartBody<'_>) {
    text.line("bool physics:rigidBodyEnabled = 1");
    text.line(&format!("float physics:mass = {}", num(part.mass_kg, 6)));
    text.line(&format!("point3f physics:centerOfMass = {}", tuple(&z_up(part.centre).to_array(), 6)));
    let i = part.inertia;
    text.line(&format!("float3 physics:diagonalInertia = {}", tuple(&[i.x, i.z, i.y], 9)));
    text.line("quatf physics:principalAxes = (1, 0, 0, 0)");
}

/// The joint between a part and its object's body, closed at 0.
pub(super) fn joint(text: &mut Text, object: &str, part: &PartBody<'_>) {
    let (kind, axis, at) = match part.part.joint {
        Jointed::Hinge { axis, pivot } => ("PhysicsRevoluteJoint", z_up(axis), z_up(pivot)),
        Jointed::Slide { axis } => ("PhysicsPrismaticJoint", z_up(axis), z_up(part.centre)),
    };
    // Axes are named without a sign: one that points the other way has its limits turned round.
    let name = ["X", "Y", "Z"][(0..3).max_by(|a, b| axis[*a].abs().total_cmp(&axis[*b].abs())).unwrap_or(2)];
    let turned = axis.to_array().iter().sum::<f64>() < 0.0;
    let [low, high] = part.part.range;
    let [low, high] = if turned { [-high, -low] } else { [low, high] };
    let unit = |v: f64| if kind == "PhysicsRevoluteJoint" { v.to_degrees() } else { v };
    text.prim(kind, &format!("{}_joint", part.part.name), &[], |t| {
        t.line(&format!("rel physics:body0 = <{object}/body>"));
        t.line(&format!("rel physics:body1 = <{object}/{}>", part.part.name));
        t.line(&format!("uniform token physics:axis = \"{name}\""));
        for side in ["0", "1"] {
            t.line(&format!("point3f physics:localPos{side} = {}", tuple(&at.to_array(), 6)));
            t.line(&format!("quatf physics:localRot{side} = (1, 0, 0, 0)"));
        }
        t.line(&format!("float physics:lowerLimit = {}", num(unit(low), 5)));
        t.line(&format!("float physics:upperLimit = {}", num(unit(high), 5)));
        t.line("bool physics:collisionEnabled = 0");
    });
}

/// Convex colliders, drawn only when guides are.
pub(super) fn colliders(text: &mut Text, hulls: &[Hull], material: &str) {
    for (k, hull) in hulls.iter().enumerate() {
        let metadata = [schemas(&["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI", "MaterialBindingAPI"])];
        text.prim("Mesh", &format!("hull_{k:03}"), &metadata, |t| {
            let points = || hull.vertices.iter().map(|v| z_up(*v).to_array());
            let (low, high) = points().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| {
                (l.min(DVec3::from_array(p)), h.max(DVec3::from_array(p)))
            });
            t.tuples("float3[] extent", [low.to_array(), high.to_array()].into_iter(), 6, "");
            t.whole("int[] faceVertexCounts", hull.faces.iter().map(|_| 3));
            t.whole("int[] faceVertexIndices", hull.faces.iter().flatten().map(|i| *i as usize));
            t.tuples("point3f[] points", points(), 6, "");
            t.line("uniform token subdivisionScheme = \"none\"");
            t.line("uniform token purpose = \"guide\"");
            t.line("uniform token physics:approximation = \"convexHull\"");
            t.line("bool physics:collisionEnabled = 1");
            t.line(&format!("rel material:binding:physics = <{material}>"));
        });
    }
}

/// Principal moments and axes of a symmetric matrix, a right-handed set (Jacobi's rotations).
pub(crate) fn principal(matrix: &DMat3) -> (DVec3, DMat3) {
    let mut a = *matrix;
    let mut axes = DMat3::IDENTITY;
    for _ in 0..40 {
        let off =
            [(0, 1), (0, 2), (1, 2)].into_iter().max_by(|x, y| a.col(x.1)[x.0].abs().total_cmp(&a.col(y.1)[y.0].abs()));
        let Some((p, q)) = off else { break };
        let apq = a.col(q)[p];
        if apq.abs() < 1e-15 * (a.x_axis.x.abs() + a.y_axis.y.abs() + a.z_axis.z.abs()).max(1e-30) {
            break;
        }
        let theta = (a.col(q)[q] - a.col(p)[p]) / (2.0 * apq);
        let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
        let t = if theta == 0.0 { 1.0 } else { t };
        let c = 1.0 / (t * t + 1.0).sqrt();
        let s = t * c;
        let mut r = DMat3::IDENTITY;
        r.col_mut(p)[p] = c;
        r.col_mut(q)[q] = c;
        r.col_mut(q)[p] = s;
        r.col_mut(p)[q] = -s;
        a = r.transpose() * a * r;
        axes *= r;
    }
    if axes.determinant() < 0.0 {
        axes.z_axis = -axes.z_axis;
    }
    (DVec3::new(a.x_axis.x, a.y_axis.y, a.z_axis.z).max(DVec3::splat(1e-9)), axes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn principal_axes_bring_the_matrix_back() {
        let turn = DMat3::from_rotation_x(0.4) * DMat3::from_rotation_z(1.1);
        let m = turn * DMat3::from_diagonal(DVec3::new(0.5, 2.0, 1.2)) * turn.transpose();
        let (d, axes) = principal(&m);
        assert!((axes.determinant() - 1.0).abs() < 1e-12);
        let again = axes * DMat3::from_diagonal(d) * axes.transpose();
        assert!((again - m).to_cols_array().into_iter().all(|v| v.abs() < 1e-12));
        let mut sorted = d.to_array();
        sorted.sort_by(f64::total_cmp);
        assert!((sorted[0] - 0.5).abs() < 1e-12 && (sorted[2] - 2.0).abs() < 1e-12);
    }
}
