//! Parts that open: doors and drawers of furniture, leaves of room doors.
//!
//! # Idea
//! Part models name their slots, and the catalogue says which parts of a kind move and how. A connected part in a slot for
//! fronts, with the handle that lies on it, is one moving part. A front with its handle near one side is a door, hinged at
//! the other side; with its handle in the middle it is a drawer. All stand closed, as the photo is taken to have them.
//!
//! # Frames
//! The body frame of [`super::Item`]: metres, +Y up, front +Z. A hinge turns by the right hand about its axis.
//!
//! What a program models says its joints itself ([`MovingPart`]); then they are taken as they are.
//!
//! # Limits
//! Fronts are panels without a box behind them: a drawer slides out as its front. Windows, lids, chairs and all meshes
//! without named parts stay rigid; [`opens`] says why.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use harmony_catalogue::{Axis, Joint, Motion as KindMotion, kind};
use harmony_mesh::{Mesh, connected};
use harmony_scene::{Motion, MovingPart};

/// Slots whose parts are fronts, and slots of what is on them.
const FRONTS: [&str; 3] = ["fronts", "doors", "leaf"];
const HANDLES: [&str; 3] = ["handles", "handle", "knobs"];
/// A front is thinner than this, metres.
const THICKEST: f64 = 0.12;
/// How far a handle is from the middle of its front, share of the width, when it is a door's.
const ASIDE: f64 = 0.2;
/// How far doors open, radians, and drawers, share of the depth.
const DOOR: f64 = 1.745;
const FLAP: f64 = 1.571;
const DRAWER: f64 = 0.7;
/// Fronts whose upper edges are this near are one row, metres.
const ROW_M: f64 = 0.02;
/// More fronts than this are no furniture.
const MOST: usize = 40;
/// A room door that is wider has two leaves, which its template draws as one, metres.
const DOUBLE_M: f64 = 1.25;

/// A joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Jointed {
    /// Turns about an axis through a point.
    Hinge {
        /// Unit vector.
        axis: DVec3,
        /// A point of it.
        pivot: DVec3,
    },
    /// Slides along an axis.
    Slide {
        /// Unit vector.
        axis: DVec3,
    },
}

/// A part that moves against the body.
#[derive(Debug, Clone, PartialEq)]
pub struct Opens {
    /// `<id>_door_01`, `<id>_drawer_02`.
    pub name: String,
    /// How it moves.
    pub joint: Jointed,
    /// Radians or metres; closed at 0.
    pub range: [f64; 2],
    /// By group of the mesh: which of its triangles move.
    pub moving: Vec<Vec<bool>>,
    /// Bounds of its panel.
    pub low: DVec3,
    /// The other corner.
    pub high: DVec3,
    /// Share of the object's surface.
    pub share: f64,
}

/// A connected part of the mesh.
struct Part {
    slot: Slot,
    triangles: Vec<(usize, usize)>,
    low: DVec3,
    high: DVec3,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Slot {
    Front,
    Handle,
}

/// The moving parts of an object, or why it has none although its kind has.
pub(super) fn opens(id: &str, label: &str, mesh: &Mesh, scale: DVec3) -> Result<Vec<Opens>, String> {
    let Some(kind) = kind(label) else { return Ok(Vec::new()) };
    let of_door = kind.opening == Some(harmony_scene::OpeningKind::Door);
    let door = [Joint { part: "door".to_owned(), motion: KindMotion::Hinge, axis: Axis::Y }];
    let joints: &[Joint] = if of_door && kind.joints.is_empty() { &door } else { &kind.joints };
    if joints.is_empty() {
        return Ok(Vec::new());
    }
    let place = |p: Vec3| p.as_dvec3() * scale;
    let parts = parts(mesh, &place);
    let mut fronts: Vec<&Part> = parts.iter().filter(|p| p.slot == Slot::Front).collect();
    let names: Vec<&str> = joints.iter().map(|j| j.part.as_str()).collect();
    if fronts.is_empty() {
        return Err(format!("its mesh has no {} of its own", names.join(" or ")));
    }
    let handles: Vec<&Part> = parts.iter().filter(|p| p.slot == Slot::Handle).collect();
    let whole = surface(mesh, &place, |_, _| true);
    let bounds = |all: &[&Part]| {
        all.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p.low), h.max(p.high)))
    };
    // A room door's leaf is a board with mouldings: one part.
    let groups: Vec<(Vec<&Part>, (DVec3, DVec3))> = if of_door {
        let all = bounds(&fronts);
        if all.1.x - all.0.x > DOUBLE_M {
            return Err("its two leaves are one part of its mesh".to_owned());
        }
        vec![(fronts.iter().chain(&handles).copied().collect(), all)]
    } else {
        fronts.retain(|f| f.high.z - f.low.z <= THICKEST);
        if fronts.is_empty() || fronts.len() > MOST {
            return Err(format!("{} fronts of its mesh are no panels", fronts.len()));
        }
        // Row by row from the top, so that numbers are what a person would give.
        let row = |p: &Part| -(p.high.y / ROW_M).round() as i64;
        fronts.sort_by(|a, b| row(a).cmp(&row(b)).then(a.low.x.total_cmp(&b.low.x)));
        fronts
            .iter()
            .map(|f| {
                let on = |h: &&&Part| {
                    let c = (h.low + h.high) / 2.0;
                    c.x > f.low.x && c.x < f.high.x && c.y > f.low.y && c.y < f.high.y
                };
                (std::iter::once(*f).chain(handles.iter().filter(on).copied()).collect(), (f.low, f.high))
            })
            .collect()
    };
    let (object_low, object_high) = bounds_of(mesh, &place);
    let mut count: BTreeMap<&str, usize> = BTreeMap::new();
    let mut out = Vec::new();
    for (members, (low, high)) in groups {
        let handle: Vec<&Part> = members.iter().filter(|p| p.slot == Slot::Handle).copied().collect();
        let aside = (!handle.is_empty()).then(|| {
            let (l, h) = bounds(&handle);
            ((l.x + h.x) - (low.x + high.x)) / 2.0 / (high.x - low.x).max(1e-6)
        });
        let wants = |motion: KindMotion| joints.iter().find(|j| j.motion == motion);
        let joint = match (wants(KindMotion::Slide), wants(KindMotion::Hinge), aside) {
            (Some(slide), Some(hinge), Some(aside)) => {
                if aside.abs() > ASIDE {
                    hinge
                } else {
                    slide
                }
            }
            (Some(slide), None, _) => slide,
            (None, Some(hinge), _) => hinge,
            _ => continue,
        };
        let (jointed, range) = match (joint.motion, joint.axis) {
            (KindMotion::Slide, _) => {
                (Jointed::Slide { axis: DVec3::Z }, [0.0, DRAWER * (object_high.z - object_low.z)])
            }
            (KindMotion::Hinge, Axis::X) => {
                let pivot = DVec3::new(f64::midpoint(low.x, high.x), low.y, low.z);
                (Jointed::Hinge { axis: DVec3::X, pivot }, [0.0, FLAP])
            }
            (KindMotion::Hinge, _) => {
                // Hinged across from its handle; without one, at the side that is nearer to the object's own.
                let middle = f64::midpoint(object_low.x, object_high.x);
                let left = aside.map_or(f64::midpoint(low.x, high.x) <= middle, |a| a > 0.0);
                let pivot = DVec3::new(if left { low.x } else { high.x }, low.y, if of_door { high.z } else { low.z });
                (Jointed::Hinge { axis: DVec3::Y, pivot }, if left { [-DOOR, 0.0] } else { [0.0, DOOR] })
            }
        };
        let number = count.entry(if joint.motion == KindMotion::Slide { "drawer" } else { "door" }).or_insert(0);
        *number += 1;
        let word = if joint.motion == KindMotion::Slide { "drawer" } else { "door" };
        let mut moving: Vec<Vec<bool>> = mesh.groups.iter().map(|g| vec![false; g.triangles.len()]).collect();
        for (g, t) in members.iter().flat_map(|p| &p.triangles) {
            moving[*g][*t] = true;
        }
        let share = surface(mesh, &place, |g, t| moving[g][t]) / whole.max(1e-9);
        out.push(Opens { name: format!("{id}_{word}_{number:02}"), joint: jointed, range, moving, low, high, share });
    }
    if out.is_empty() { Err("no front of its mesh can be told to be a door or a drawer".to_owned()) } else { Ok(out) }
}

/// Farthest that a triangle may be outside of the box of a moving piece, in the mesh's units: faces in one plane were
/// moved apart by less.
const BOX_SLACK: f64 = 1.5e-3;
/// A part that is more than this share of the surface is the object.
const WHOLE: f64 = 0.98;

/// The moving parts as a program says them.
///
/// A door that was said to open into its own object opens the other way: hinges of a pair are easily given one range.
pub(super) fn said(id: &str, mesh: &Mesh, scale: DVec3, moving: &[MovingPart]) -> Vec<Opens> {
    let place = |p: Vec3| p.as_dvec3() * scale;
    let whole = surface(mesh, &place, |_, _| true);
    let (low, high) = bounds_of(mesh, &place);
    let middle = low.midpoint(high);
    let mut out: Vec<Opens> = Vec::new();
    for part in moving {
        let within = |i: &u32| {
            let p = mesh.positions[*i as usize].as_dvec3();
            move |b: &[DVec3; 2]| p.cmpge(b[0] - BOX_SLACK).all() && p.cmple(b[1] + BOX_SLACK).all()
        };
        let moves = |t: &[u32; 3]| part.boxes.iter().any(|b| t.iter().all(|i| within(i)(b)));
        let flags: Vec<Vec<bool>> = mesh.groups.iter().map(|g| g.triangles.iter().map(moves).collect()).collect();
        let share = surface(mesh, &place, |g, t| flags[g][t]) / whole.max(1e-9);
        if !(1e-4..WHOLE).contains(&share) || part.range[0] >= part.range[1] {
            continue;
        }
        let corners = mesh.groups.iter().zip(&flags).flat_map(|(g, f)| g.triangles.iter().zip(f).filter(|(_, f)| **f));
        let (low, high) = corners
            .flat_map(|(t, _)| t.iter())
            .map(|i| place(mesh.positions[*i as usize]))
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        let along = part.axis * scale;
        let Some(axis) = along.try_normalize() else { continue };
        let pivot = part.pivot * scale;
        let (joint, mut range, word) = match part.motion {
            Motion::Hinge => (Jointed::Hinge { axis, pivot }, part.range.map(f64::to_radians), "door"),
            Motion::Slide => (Jointed::Slide { axis }, part.range.map(|v| v * along.length()), "drawer"),
        };
        // Outward of a panel is across it, away from the object's middle.
        let (own, size) = (low.midpoint(high), high - low);
        let across = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().min_by(|a, b| size.dot(*a).total_cmp(&size.dot(*b)));
        let outward = across.map_or(DVec3::Z, |n| n * (own - middle).dot(n).signum());
        let way = match joint {
            Jointed::Hinge { axis, pivot } => axis.cross(own - pivot),
            Jointed::Slide { axis } => axis,
        };
        // A swivel goes both ways; what opens goes one way.
        let [less, more] = range.map(f64::abs);
        let into = way.dot(outward) * (range[0] + range[1]) < 0.0;
        if into && less.min(more) < 0.2 * less.max(more) {
            range = [-range[1], -range[0]];
        }
        let words: String =
            part.name.to_lowercase().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        let words = if words.trim_matches('_').is_empty() { word.to_owned() } else { words };
        let mut name = format!("{id}_{words}");
        let taken = out.iter().filter(|o| o.name.starts_with(&name)).count();
        if taken > 0 || words == word {
            name = format!("{name}_{:02}", taken + 1);
        }
        out.push(Opens { name, joint, range, moving: flags, low, high, share });
    }
    out
}

fn bounds_of(mesh: &Mesh, place: &dyn Fn(Vec3) -> DVec3) -> (DVec3, DVec3) {
    mesh.positions
        .iter()
        .map(|p| place(*p))
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)))
}

fn surface(mesh: &Mesh, place: &dyn Fn(Vec3) -> DVec3, takes: impl Fn(usize, usize) -> bool) -> f64 {
    let mut sum = 0.0;
    for (g, group) in mesh.groups.iter().enumerate() {
        for (t, triangle) in group.triangles.iter().enumerate() {
            if takes(g, t) {
                let [a, b, c] = triangle.map(|i| place(mesh.positions[i as usize]));
                sum += (b - a).cross(c - a).length() / 2.0;
            }
        }
    }
    sum
}

/// Connected parts in the slots of fronts and handles.
fn parts(mesh: &Mesh, place: &dyn Fn(Vec3) -> DVec3) -> Vec<Part> {
    let slot_of = |g: usize| {
        let name = mesh.materials.get(mesh.groups[g].material).map_or("", |m| m.name.as_str());
        if FRONTS.contains(&name) {
            Some(Slot::Front)
        } else if HANDLES.contains(&name) {
            Some(Slot::Handle)
        } else {
            None
        }
    };
    let wanted: Vec<(usize, Slot)> = (0..mesh.groups.len()).filter_map(|g| Some((g, slot_of(g)?))).collect();
    let part_of = connected(mesh, &|g| wanted.iter().any(|(w, _)| *w == g));
    let mut out: BTreeMap<(usize, u32), Part> = BTreeMap::new();
    for (g, slot) in wanted {
        for (n, t) in mesh.groups[g].triangles.iter().enumerate() {
            let part = out.entry((g, part_of[t[0] as usize])).or_insert_with(|| Part {
                slot,
                triangles: Vec::new(),
                low: DVec3::INFINITY,
                high: DVec3::NEG_INFINITY,
            });
            part.triangles.push((g, n));
            for i in t {
                let p = place(mesh.positions[*i as usize]);
                (part.low, part.high) = (part.low.min(p), part.high.max(p));
            }
        }
    }
    out.into_values().collect()
}

#[cfg(test)]
mod tests {
    use harmony_mesh::{TemplateParams, template};
    use harmony_scene::Size;

    use super::*;

    #[expect(clippy::needless_pass_by_value, reason = "a helper of tests")]
    fn of(label: &str, size: [f64; 3], params: TemplateParams) -> Result<Vec<Opens>, String> {
        let size = Size { width: size[0], height: size[1], depth: size[2] };
        let mesh = template(label, &params, size).build(size).unwrap().mesh;
        opens("x_01", label, &mesh, DVec3::ONE)
    }

    /// A box between two corners, added to a mesh of one group.
    fn add(mesh: &mut Mesh, low: [f32; 3], high: [f32; 3]) {
        let base = mesh.positions.len() as u32;
        let corner = |i: u32| {
            let pick = |k: usize| if i >> k & 1 == 0 { low[k] } else { high[k] };
            Vec3::new(pick(0), pick(1), pick(2))
        };
        mesh.positions.extend((0..8).map(corner));
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        for q in quads.map(|q: [u32; 4]| q.map(|i| base + i)) {
            mesh.groups[0].triangles.extend([[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
        }
    }

    #[test]
    fn what_a_program_says_moves_as_it_says_and_a_pair_of_doors_opens_outward() {
        let mut mesh = Mesh { groups: vec![harmony_mesh::Group::default()], ..Mesh::default() };
        let doors = [([-0.4, 0.1, 0.2], [-0.001, 0.6, 0.22]), ([0.001, 0.1, 0.2], [0.4, 0.6, 0.22])];
        add(&mut mesh, [-0.41, 0.0, -0.2], [0.41, 0.62, 0.199]);
        for (low, high) in doors {
            add(&mut mesh, low, high);
        }
        let part = |k: usize, name: &str, x: f64, motion, range| MovingPart {
            name: name.into(),
            motion,
            axis: if motion == Motion::Hinge { DVec3::Y } else { DVec3::Z },
            pivot: DVec3::new(x, 0.1, 0.2),
            range,
            boxes: vec![[doors[k].0, doors[k].1].map(|c| Vec3::from_array(c).as_dvec3())],
        };
        // Both were given the range of the right one.
        let pair = [
            part(0, "Door left", -0.4, Motion::Hinge, [0.0, 100.0]),
            part(1, "Door right", 0.4, Motion::Hinge, [0.0, 100.0]),
        ];
        let scale = DVec3::new(2.0, 1.0, 1.0);
        let all = said("x_01", &mesh, scale, &pair);
        let names: Vec<&str> = all.iter().map(|o| o.name.as_str()).collect();
        assert_eq!(names, ["x_01_door_left", "x_01_door_right"]);
        for (opens, range) in all.iter().zip([[-100.0, 0.0], [0.0, 100.0_f64]]) {
            assert!(opens.range.iter().zip(range).all(|(a, b)| (a.to_degrees() - b).abs() < 1e-9), "{:?}", opens.range);
            assert_eq!(opens.moving[0].iter().filter(|m| **m).count(), 12);
            let Jointed::Hinge { axis, pivot } = opens.joint else { panic!("{opens:?}") };
            assert!(axis == DVec3::Y && (pivot.x.abs() - 0.8).abs() < 1e-9);
        }
        let drawers = said("x_01", &mesh, DVec3::splat(2.0), &[part(0, "", 0.0, Motion::Slide, [0.0, 0.3])]);
        assert_eq!((drawers[0].name.as_str(), drawers[0].range), ("x_01_drawer_01", [0.0, 0.6]));
        let swivel = said("x_01", &mesh, scale, &[part(0, "seat", 0.0, Motion::Hinge, [-180.0, 180.0])]);
        assert!((swivel[0].range[0] + std::f64::consts::PI).abs() < 1e-9);
        let nothing = MovingPart { boxes: vec![[DVec3::splat(5.0), DVec3::splat(6.0)]], ..pair[0].clone() };
        assert!(said("x_01", &mesh, scale, &[nothing]).is_empty());
    }

    #[test]
    fn a_cabinet_of_two_doors_opens_outward_at_its_sides() {
        let params = TemplateParams { doors: Some(2), ..TemplateParams::default() };
        let all = of("cabinet", [1.0, 0.9, 0.4], params).unwrap();
        assert_eq!(all.len(), 2);
        for (part, left) in all.iter().zip([true, false]) {
            let Jointed::Hinge { axis, pivot } = part.joint else { panic!("{part:?}") };
            assert_eq!(axis, DVec3::Y);
            assert_eq!(pivot.x < 0.0, left, "{pivot}");
            // Half open, the free edge has come to the front.
            let open = if part.range[0] < 0.0 { part.range[0] } else { part.range[1] } / 2.0;
            let free = DVec3::new(if left { part.high.x } else { part.low.x }, pivot.y, part.high.z);
            let turned = pivot + glam::DMat3::from_rotation_y(open) * (free - pivot);
            assert!(turned.z > free.z + 0.1, "{turned} and {free}");
            assert!(part.share > 0.02 && part.share < 0.4, "{}", part.share);
        }
    }

    #[test]
    fn a_dresser_has_as_many_drawers_as_it_was_made_with() {
        let params = TemplateParams { drawers: Some(4), ..TemplateParams::default() };
        let all = of("dresser", [0.8, 1.1, 0.45], params).unwrap();
        assert_eq!(all.len(), 4);
        assert!(all.iter().all(|p| p.joint == Jointed::Slide { axis: DVec3::Z } && p.range[1] > 0.2));
        assert_eq!(all[0].name, "x_01_drawer_01");
        assert!(all[0].low.y > all[3].low.y, "numbered from the top");
    }

    #[test]
    fn a_room_door_swings_into_the_room_and_a_chair_does_not_open() {
        let all = of("door", [0.9, 2.05, 0.08], TemplateParams::default()).unwrap();
        assert_eq!(all.len(), 1);
        let Jointed::Hinge { pivot, .. } = all[0].joint else { panic!() };
        assert!(pivot.x < -0.3, "across from the handle, seen from inside on the left: {pivot}");
        assert!(of("chair", [0.45, 0.9, 0.5], TemplateParams::default()).unwrap().is_empty());
        let sphere = Mesh::default();
        assert!(opens("x_01", "cabinet", &sphere, DVec3::ONE).unwrap_err().contains("door"));
    }
}
