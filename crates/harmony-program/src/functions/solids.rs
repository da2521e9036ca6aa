//! Solids and sheets.

use harmony_shape::tree::{Axis, Boolean, Face, Kind, LoftSection, NodeId, Outline, Section};
use starlark::values::Value;

use super::planes::standing;
use crate::call::{ANGLE, COORDINATE, Call, FACES, Function, LENGTH, LENGTH0, Outcome};
use crate::error::{Complaint, Failure};
use crate::numbers::{items, number, numbers, vector};

/// Most points or faces of `mesh()`.
const MESH: usize = 20_000;
/// Most points a side of `surf()`.
const SURF: u32 = 400;

const AXES: [(&str, Axis); 3] = [("x", Axis::X), ("y", Axis::Y), ("z", Axis::Z)];

pub(crate) fn functions() -> Vec<Function> {
    vec![
        Function::new("box(size, bevel=0, seg=2, taper=(1, 1), shear=(0, 0), ...)", |c| {
            let size = c.list("size", None, LENGTH)?;
            let most = size.into_iter().fold(f64::INFINITY, f64::min) / 2.0;
            c.make(Kind::Box {
                size,
                bevel: c.number("bevel", 0.0, LENGTH0)?.min(most),
                segments: c.count("seg", 2, 1..=8)?,
                taper: pair(c, "taper", [1.0; 2], 0.0..=20.0)?,
                shear: pair(c, "shear", [0.0; 2], COORDINATE)?,
            })
        }),
        Function::new("cylinder(r, h, r2=None, bevel=0, sides=0, wall=0, ...)", |c| {
            let radius = c.need_number("r", LENGTH0)?;
            let top_radius = c.number("r2", radius, LENGTH0)?;
            if radius.max(top_radius) <= 0.0 {
                return Err(Complaint::new("cylinder() needs a radius above 0 at one end").into());
            }
            let sides = c.count("sides", 0, 0..=200)?;
            c.make(Kind::Cylinder {
                radius,
                height: c.need_number("h", LENGTH)?,
                top_radius,
                bevel: c.number("bevel", 0.0, LENGTH0)?,
                sides: if sides < 3 { 0 } else { sides },
                wall: c.number("wall", 0.0, LENGTH0)?,
            })
        }),
        Function::new("sphere(r, ...)", |c| {
            let value = c.need("r")?;
            let radii =
                if number(value).is_some() { [c.need_number("r", LENGTH)?; 3] } else { c.list("r", None, LENGTH)? };
            c.make(Kind::Sphere { radii })
        }),
        Function::new("lathe(profile, smooth=40, wall=0, oval=1, lobes=0, ...)", lathe),
        Function::new("extrude(outline, depth, axis=\"z\", bevel=0, bend=0, twist=0, ...)", |c| {
            let outline = c.outline("outline")?;
            let axis = c.choice("axis", &AXES, Some(Axis::Z))?;
            let outline = if axis == Axis::Y { (*outline).clone() } else { standing(&outline) };
            c.make(Kind::Extrude {
                outline,
                depth: c.need_number("depth", LENGTH)?,
                axis,
                bevel: c.number("bevel", 0.0, LENGTH0)?,
                bend_deg: c.number("bend", 0.0, -360.0..=360.0)?,
                twist_deg: c.number("twist", 0.0, ANGLE)?,
            })
        }),
        Function::new("sweep(curve, r, taper=1, twist=0, rings=(0, 0), caps=\"round\", ...)", |c| {
            let curve = (*c.curve("curve")?).clone();
            let value = c.need("r")?;
            let section = match number(value) {
                Some(_) => Section::Round(c.need_number("r", LENGTH)?),
                None => Section::Outline(outline_or_points(c, "r")?),
            };
            c.make(Kind::Sweep {
                curve,
                section,
                taper: c.number("taper", 1.0, 0.0..=20.0)?,
                twist_deg: c.number("twist", 0.0, ANGLE)?,
                rings: c.list("rings", Some([0.0; 2]), LENGTH0)?,
                round_caps: c.word("caps", &["round", "flat"], "round")? == "round",
            })
        }),
        Function::new("loft(sections, closed=False, ...)", loft),
        Function::new("bent_sheet(profile, width, thick=0.002, axis=\"x\", smooth=False, ...)", bent_sheet),
        Function::new("surf(fn, nu=24, nv=24, thick=0, closed_u=False, ...)", surf),
        Function::new("mesh(points, faces, ...)", mesh),
        Function::new("blend(parts, k=0.02, ...)", |c| {
            let children = c.parts("parts")?;
            if children.len() > 60 {
                return Err(Complaint::limit("blend() of more than 60 parts").into());
            }
            for &id in &children {
                closed(c, id)?;
            }
            c.make(Kind::Blend { children, radius: c.number("k", 0.02, 1e-4..=1.0)? })
        }),
        Function::new("cut(a, b, ...)", |c| boolean(c, Boolean::Cut)),
        Function::new("join(a, b, ...)", |c| boolean(c, Boolean::Join)),
        Function::new("common(a, b, ...)", |c| boolean(c, Boolean::Common)),
        Function::new("shell(part, wall, open=\"top\", ...)", |c| {
            let child = c.part("part")?;
            closed(c, child)?;
            let mut faces: Vec<(&str, Option<Face>)> = FACES.iter().map(|(n, f)| (*n, Some(*f))).collect();
            faces.push(("none", None));
            c.make(Kind::Shell {
                child,
                wall: c.need_number("wall", LENGTH)?,
                open: c.choice("open", &faces, Some(Some(Face::Top)))?,
            })
        }),
    ]
}

/// Two numbers; one stands for both.
fn pair(
    c: &Call<'_, '_>,
    name: &str,
    default: [f64; 2],
    range: std::ops::RangeInclusive<f64>,
) -> Result<[f64; 2], Complaint> {
    match c.given(name).and_then(number) {
        Some(_) => Ok([c.need_number(name, range)?; 2]),
        None => c.list(name, Some(default), range),
    }
}

/// An outline, or a list of points as one.
fn outline_or_points(c: &Call<'_, '_>, name: &str) -> Result<Outline, Complaint> {
    let value = c.need(name)?;
    if items(value).is_some() {
        let points = c.points2(name)?;
        if points.len() < 3 {
            return Err(c.refuse(name, value, "an outline of three points at least"));
        }
        return Ok(Outline { points: crate::outlines::anticlockwise(points), ..Outline::default() });
    }
    c.outline(name).map(|o| (*o).clone())
}

fn lathe<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let profile = c.points2("profile")?;
    if profile.len() < 2 {
        return Err(Complaint::new("lathe() needs a profile of two points at least")
            .with_hint("[(radius, height), ...]")
            .into());
    }
    if let Some([radius, ..]) = profile.iter().find(|p| p[0] < 0.0) {
        let complaint = Complaint::new(format!("lathe(): a profile point has the radius {radius}"));
        return Err(complaint.with_hint("points are (radius, height), the radius not below 0").into());
    }
    let (lobes, lobe_depth) = match c.given("lobes") {
        Some(v) if items(v).is_some() => {
            let [n, depth] = c.list("lobes", None, 0.0..=200.0)?;
            (n as u32, depth.min(0.5))
        }
        _ => (c.count("lobes", 0, 0..=200)?, 0.08),
    };
    c.make(Kind::Lathe {
        profile,
        smooth_deg: c.number_or_flag("smooth", 40.0, [0.0, 180.0], 0.0..=180.0)?,
        wall: c.number("wall", 0.0, LENGTH0)?,
        oval: c.number("oval", 1.0, 0.01..=20.0)?,
        lobes,
        lobe_depth: if lobes > 0 { lobe_depth } else { 0.0 },
    })
}

fn loft<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let mut sections = Vec::new();
    for &item in c.elements("sections")? {
        let say = || c.refuse("sections", item, "tuples (outline, at) or (outline, at, turn)");
        let parts = items(item).ok_or_else(say)?;
        let (outline, at, turn) = match parts {
            [outline, at] => (outline, at, None),
            [outline, at, turn] => (outline, at, Some(turn)),
            _ => return Err(say().into()),
        };
        let at = match number(*at) {
            Some(y) => [0.0, y, 0.0],
            None => c.point("sections", *at)?.to_array(),
        };
        let turn_deg = match turn {
            None => [0.0; 3],
            Some(t) => match (number(*t), vector(*t)) {
                (Some(y), _) if ANGLE.contains(&y) => [0.0, y, 0.0],
                (_, Some(v)) if v.abs().max_element() <= *ANGLE.end() => v.to_array(),
                _ => return Err(say().into()),
            },
        };
        sections.push(LoftSection { outline: (*c.one_outline("sections", *outline)?).clone(), at, turn_deg });
    }
    if sections.len() < 2 {
        return Err(Complaint::new("loft() needs two sections at least").into());
    }
    c.make(Kind::Loft { sections, closed: c.flag("closed", false)? })
}

/// `axis` may also be "u" or "v": in the frame of a wall, floor or ceiling (u = x, v = y, out = z), pulled along u from
/// 0, the profile being (v, out); or along v, the profile being (u, out).
fn bent_sheet<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    #[derive(Clone, Copy)]
    enum Pull {
        Own(Axis),
        U,
        V,
    }
    let profile = c.points2("profile")?;
    if profile.len() < 2 {
        return Err(Complaint::new("bent_sheet() needs a profile of two points at least").into());
    }
    let axes = [
        ("x", Pull::Own(Axis::X)),
        ("y", Pull::Own(Axis::Y)),
        ("z", Pull::Own(Axis::Z)),
        ("u", Pull::U),
        ("v", Pull::V),
    ];
    let (width, thick) = (c.need_number("width", LENGTH)?, c.number("thick", 0.002, LENGTH0)?);
    let smooth = c.flag("smooth", false)?;
    match c.choice("axis", &axes, Some(Pull::Own(Axis::X)))? {
        Pull::Own(axis) => c.make(Kind::BentSheet { profile, width, thick, smooth, axis }),
        Pull::U => {
            // The sheet has (z, y) = profile: turned about x so that y becomes out and -z becomes v.
            let profile = profile.into_iter().map(|[v, out]| [-v, out]).collect();
            let child = c.add(Kind::BentSheet { profile, width, thick, smooth, axis: Axis::X }, None)?;
            let columns = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [width / 2.0, 0.0, 0.0]];
            c.make(Kind::Placed { child, columns })
        }
        Pull::V => {
            let child = c.add(Kind::BentSheet { profile, width, thick, smooth, axis: Axis::X }, None)?;
            // x -> v, y -> out, z -> u.
            let columns = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, width / 2.0, 0.0]];
            c.make(Kind::Placed { child, columns })
        }
    }
}

fn surf<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let f = c.need("fn")?;
    let (nu, nv) = (c.count("nu", 24, 2..=SURF)?, c.count("nv", 24, 2..=SURF)?);
    let closed_u = c.flag("closed_u", false)?;
    c.session.charge_cells(u64::from(nu) * u64::from(nv))?;
    let mut points = Vec::with_capacity((nu * nv) as usize);
    // A closed row does not repeat its first point.
    let last_u = if closed_u { nu } else { nu - 1 };
    for j in 0..nv {
        for i in 0..nu {
            let (u, v) = (f64::from(i) / f64::from(last_u), f64::from(j) / f64::from(nv - 1));
            let with: [Value<'v>; 2] = [c.heap.alloc(u), c.heap.alloc(v)];
            let point = c.call_back(f, &with).map_err(Failure::Engine)?;
            points.push(c.point("fn", point)?.to_array());
        }
    }
    c.make(Kind::Surf { points, nu, thick: c.number("thick", 0.0, LENGTH0)?, closed_u })
}

fn mesh<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let points = c.points("points")?;
    let faces = c.elements("faces")?;
    if points.len() > MESH || faces.len() > MESH {
        return Err(Complaint::limit(format!("mesh() of more than {MESH} points or faces")).into());
    }
    let mut polygons = Vec::with_capacity(faces.len());
    let mut corners = 0;
    for &face in faces {
        let list = numbers(face).filter(|l| l.len() >= 3 && l.len() <= 64);
        let list = list.ok_or_else(|| c.refuse("faces", face, "lists of 3 to 64 point numbers"))?;
        let mut polygon = Vec::with_capacity(list.len());
        for x in list {
            if x.fract() != 0.0 || x < 0.0 || x >= points.len() as f64 {
                let complaint = Complaint::new(format!("mesh(): a face names point {x} of {}", points.len()));
                return Err(complaint.with_hint("points are counted from 0").into());
            }
            polygon.push(x as u32);
        }
        corners += polygon.len();
        polygons.push(polygon);
    }
    c.session.charge_points(corners)?;
    if polygons.is_empty() {
        return Err(Complaint::new("mesh() without faces").into());
    }
    c.make(Kind::Mesh { points, faces: polygons })
}

/// Refuses what is not made of closed solids.
fn closed(c: &Call<'_, '_>, id: NodeId) -> Result<(), Complaint> {
    match c.session.open_part(id) {
        None => Ok(()),
        Some(part) => Err(Complaint::new(format!("closed solids only: {part} is not one"))
            .with_hint("box, cylinder, sphere, lathe, extrude, sweep, loft, cushion and what is made of them")),
    }
}

fn boolean<'v>(c: &mut Call<'v, '_>, op: Boolean) -> Outcome<'v> {
    let (a, b) = (c.part("a")?, c.part("b")?);
    closed(c, a)?;
    closed(c, b)?;
    c.make(Kind::Boolean { op, a, b })
}
