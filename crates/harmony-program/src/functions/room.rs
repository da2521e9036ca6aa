//! Anchors to the room: its surfaces, and rays of the photo's camera.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec2, DVec3};
use harmony_scene::{Extents, Ray};

use super::arrays::{affine, place};
use crate::bounds::Bounds;
use crate::call::{COORDINATE, Call, Function, Outcome};
use crate::error::Complaint;
use crate::inputs::Surface;
use crate::numbers::number;
use crate::thing::{Kind, Thing};

/// A wall, the floor or the ceiling, in the program's frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Frame {
    /// Corner where u = v = 0.
    pub origin: DVec3,
    /// Unit direction of u.
    pub u: DVec3,
    /// Unit direction of v.
    pub v: DVec3,
    /// Unit direction into the room, `u x v`.
    pub normal: DVec3,
    /// Lengths along u and v, metres.
    pub size: [f64; 2],
}

impl Frame {
    /// A surface of a room, in the room's frame. Walls: u to the right as seen from inside, v up. Floor: u right, v away
    /// from the viewer. Ceiling: u right, v towards the viewer from the back wall. The normal looks into the room.
    pub fn of(surface: Surface, room: &Extents) -> Self {
        let Extents { width, height, depth } = *room;
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        let (origin, u, v, size) = match surface {
            Surface::Back => (DVec3::ZERO, x, y, [width, height]),
            Surface::Front => (DVec3::new(width, 0.0, depth), -x, y, [width, height]),
            Surface::Left => (DVec3::new(0.0, 0.0, depth), -z, y, [depth, height]),
            Surface::Right => (DVec3::new(width, 0.0, 0.0), z, y, [depth, height]),
            Surface::Floor => (DVec3::new(0.0, 0.0, depth), x, -z, [width, depth]),
            Surface::Ceiling => (DVec3::new(0.0, height, 0.0), x, z, [width, depth]),
        };
        Self { origin, u, v, normal: u.cross(v), size }
    }

    /// The map from (u, v, out) to the frame that this one lies in.
    pub fn map(&self) -> DAffine3 {
        DAffine3 { matrix3: DMat3::from_cols(self.u, self.v, self.normal), translation: self.origin }
    }

    fn mapped(&self, by: &DAffine3) -> Self {
        let turn = |d: DVec3| (by.matrix3 * d).normalize_or_zero();
        Self {
            origin: by.transform_point3(self.origin),
            u: turn(self.u),
            v: turn(self.v),
            normal: turn(self.normal),
            size: self.size,
        }
    }
}

const WALLS: [(&str, Surface); 4] =
    [("back", Surface::Back), ("left", Surface::Left), ("right", Surface::Right), ("front", Surface::Front)];

pub(crate) fn functions() -> Vec<Function> {
    vec![
        Function::new("wall(name)", |c| {
            let surface = c.choice("name", &WALLS, None)?;
            frame(c, surface)
        }),
        Function::new("floor()", |c| frame(c, Surface::Floor)),
        Function::new("ceiling()", |c| frame(c, Surface::Ceiling)),
        Function::new("pixel(x, y, on)", pixel),
    ]
}

pub(crate) fn methods() -> Vec<Function> {
    vec![
        Function::new("at(u, v, out=0)", |c| {
            let at = DVec3::new(
                c.need_number("u", COORDINATE)?,
                c.need_number("v", COORDINATE)?,
                c.number("out", 0.0, COORDINATE)?,
            );
            let point = own(c)?.map().transform_point3(at);
            c.value(Kind::Vector(point))
        }),
        Function::new("out(d)", |c| {
            let mut frame = (*own(c)?).clone();
            frame.origin += frame.normal * c.need_number("d", COORDINATE)?;
            c.value(Kind::Frame(Arc::new(frame)))
        }),
        // A standing part (its back at -z) with its back to the surface: x along u, y along v, z into the room.
        Function::new("place(part, u=0, v=0, out=0)", |c| {
            let shift = DVec3::new(
                c.number("u", 0.0, COORDINATE)?,
                c.number("v", 0.0, COORDINATE)?,
                c.number("out", 0.0, COORDINATE)?,
            );
            let id = place(c, c.part("part")?, own(c)?.map() * DAffine3::from_translation(shift))?;
            c.part_value(id)
        }),
    ]
}

fn own(c: &Call<'_, '_>) -> Result<Arc<Frame>, Complaint> {
    match &c.receiver {
        Some(Kind::Frame(frame)) => Ok(frame.clone()),
        _ => Err(Complaint::new("no frame")),
    }
}

/// The map from the room to the program's frame.
fn program_from_room(c: &Call<'_, '_>) -> DAffine3 {
    c.session.inputs.room_from_program.as_ref().map_or(DAffine3::IDENTITY, |columns| affine(columns).inverse())
}

fn frame<'v>(c: &mut Call<'v, '_>, surface: Surface) -> Outcome<'v> {
    let Some(room) = &c.session.inputs.room else {
        let complaint =
            Complaint::new("this program is not given the room: wall(), floor() and ceiling() are for room features");
        return Err(complaint.with_hint("build the object about its own origin; its size comes as w, h, d").into());
    };
    let frame = Frame::of(surface, room).mapped(&program_from_room(c));
    c.value(Kind::Frame(Arc::new(frame)))
}

/// Where the ray through a point of the photo (thousandths of its width and height) meets a frame, a part's bounds, or
/// a depth along the camera's axis.
fn pixel<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let Some(camera) = &c.session.inputs.camera else {
        let complaint = Complaint::new("this program is not given the camera: pixel() is for room features");
        return Err(complaint.with_hint("give positions in metres instead").into());
    };
    let at = DVec2::new(c.need_number("x", -500.0..=1500.0)?, c.need_number("y", -500.0..=1500.0)?);
    let px = at / 1000.0 * DVec2::new(f64::from(camera.size.width), f64::from(camera.size.height));
    let to_program = program_from_room(c);
    let value = c.need("on")?;
    if number(value).is_some() {
        let depth = c.need_number("on", 0.05..=100.0)?;
        return c.value(Kind::Vector(to_program.transform_point3(camera.unproject(px, depth))));
    }
    let ray = camera.ray(px);
    let origin = to_program.transform_point3(ray.origin);
    let direction = (to_program.matrix3 * ray.direction).normalize_or(DVec3::NEG_Z);
    let ray = Ray { origin, direction };
    let miss = |what: &str| {
        Complaint::new(format!("pixel({}, {}): the ray does not meet {what}", at.x, at.y)).with_hint(
            "x and y are thousandths of the photo's width and height from its top left; check the surface's name",
        )
    };
    let point = match Thing::from_value(value).map(|t| &t.kind) {
        Some(Kind::Frame(frame)) => {
            let towards = ray.direction.dot(frame.normal);
            let k = (frame.origin - ray.origin).dot(frame.normal) / towards;
            (towards.abs() > 1e-6 && k > 0.0 && k < 100.0).then(|| ray.at(k)).ok_or_else(|| miss("that surface"))?
        }
        Some(Kind::Part(_, Some(bounds))) => meets(&ray, bounds).ok_or_else(|| miss("that part"))?,
        Some(Kind::Part(id, None)) => {
            let is = c.session.describe(*id);
            return Err(Complaint::new(format!("pixel(): where a {is} lies is not known before it is meshed")).into());
        }
        _ => return Err(c.refuse("on", value, "wall(...), floor(), ceiling(), a part or a depth in metres").into()),
    };
    c.value(Kind::Vector(point))
}

/// Nearest point of a ray in a box (slabs).
fn meets(ray: &Ray, bounds: &Bounds) -> Option<DVec3> {
    let (mut near, mut far) = (0.0_f64, f64::INFINITY);
    for i in 0..3 {
        let (o, d) = (ray.origin[i], ray.direction[i]);
        if d.abs() < 1e-12 {
            if o < bounds.min[i] || o > bounds.max[i] {
                return None;
            }
            continue;
        }
        let (a, b) = ((bounds.min[i] - o) / d, (bounds.max[i] - o) / d);
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    (near <= far && near < 100.0).then(|| ray.at(near))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROOM: Extents = Extents { width: 4.0, height: 2.5, depth: 5.0 };

    #[test]
    fn frames_look_into_the_room_and_end_at_its_corners() {
        for surface in Surface::ALL {
            let f = Frame::of(surface, &ROOM);
            let middle = f.map().transform_point3(DVec3::new(f.size[0] / 2.0, f.size[1] / 2.0, 0.1));
            let inside = middle.cmpgt(DVec3::ZERO).all() && middle.cmplt(DVec3::new(4.0, 2.5, 5.0)).all();
            assert!(inside, "{surface:?} {middle}");
            let far = f.map().transform_point3(DVec3::new(f.size[0], f.size[1], 0.0));
            for (x, most) in far.to_array().into_iter().zip([4.0, 2.5, 5.0]) {
                assert!(x.abs() <= 1e-12 || (x - most).abs() <= 1e-12, "{surface:?} {far}");
            }
        }
    }

    #[test]
    fn a_ray_meets_the_near_side_of_a_box() {
        let ray = Ray { origin: DVec3::new(0.0, 0.5, 5.0), direction: DVec3::NEG_Z };
        let hit = meets(&ray, &Bounds::standing([1.0; 3])).unwrap();
        assert!((hit - DVec3::new(0.0, 0.5, 0.5)).length() <= 1e-12);
        assert!(meets(&ray, &Bounds::standing([1.0; 3]).moved(DVec3::X * 3.0)).is_none());
    }
}
