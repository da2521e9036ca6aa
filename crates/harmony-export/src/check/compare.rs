//! An inventory against the scene.

use glam::DVec3;
use harmony_physics::{Bodies, Motion};

use super::inventory::Inventory;
use crate::usd_level_name;
use crate::world::World;

/// How far written numbers may be off, metres: formats write five decimals or more.
const PLACE_M: f64 = 2e-4;
/// Share by which masses and friction may be off: they are written with four decimals or more.
const SHARE: f64 = 2e-3;
/// How far bounds of colliders may be from those of the mesh: metres, and share of the longest side.
const FIT: (f64, f64) = (0.03, 0.06);

/// Something that is not as in the scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// The file.
    pub file: String,
    /// The object, if it is about one.
    pub object: Option<String>,
    /// What differs, with both values.
    pub what: String,
}

impl Difference {
    pub(super) fn of_file(file: &str, what: String) -> Self {
        Self { file: file.to_owned(), object: None, what }
    }
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.object {
            Some(object) => write!(f, "{}: {object}: {}", self.file, self.what),
            None => write!(f, "{}: {}", self.file, self.what),
        }
    }
}

/// What a file is to hold.
#[derive(Debug, Clone, Default)]
#[expect(clippy::struct_excessive_bools, reason = "what a file has or has not, each by itself")]
pub struct Rules {
    /// Ids of its objects.
    objects: Vec<String>,
    /// Whether it has the room's faces.
    shell: bool,
    /// Whether it has colliders, masses, friction.
    bodies: bool,
    /// Whether things are drawn, or only listed.
    listed: bool,
    /// Whether objects stand in their body frame.
    alone: bool,
    /// Whether parts open.
    opens: bool,
}

impl Rules {
    pub(super) fn scene(world: &World) -> Self {
        Self { objects: world.items.iter().map(|i| i.name().to_owned()).collect(), shell: true, ..Self::default() }
    }

    pub(super) fn shell() -> Self {
        Self { shell: true, ..Self::default() }
    }

    pub(super) fn level(world: &World, level: &str) -> Self {
        let of = world.items.iter().filter(|i| usd_level_name(i.object.level) == level);
        Self { objects: of.map(|i| i.name().to_owned()).collect(), ..Self::default() }
    }

    pub(super) fn list(world: &World) -> Self {
        Self { listed: true, shell: false, ..Self::scene(world) }
    }

    pub(super) fn alone(id: &str) -> Self {
        Self { objects: vec![id.to_owned()], alone: true, ..Self::default() }
    }

    pub(super) fn with_bodies(self) -> Self {
        Self { bodies: true, ..self }
    }

    pub(super) fn with_joints(self) -> Self {
        Self { opens: true, ..self }
    }
}

/// All differences.
pub(super) fn compare(
    file: &str,
    world: &World,
    bodies: Option<&Bodies>,
    found: &Inventory,
    rules: &Rules,
) -> Vec<Difference> {
    let mut out = Vec::new();
    let mut differs = |object: &str, what: String| {
        out.push(Difference { file: file.to_owned(), object: Some(object.to_owned()), what });
    };
    for name in &found.twice {
        differs(name, "stands twice".to_owned());
    }
    let faces: Vec<&str> = if rules.shell { world.shell.iter().map(|f| f.name.as_str()).collect() } else { Vec::new() };
    let all = || found.objects.iter().chain(&found.faces);
    for (name, _) in all() {
        if !rules.objects.contains(name) && !faces.contains(&name.as_str()) {
            differs(name, "is not in the scene".to_owned());
        }
    }
    for name in &faces {
        let Some(seen) = all().find(|(n, _)| n == name).map(|(_, s)| s) else {
            differs(name, "is missing".to_owned());
            continue;
        };
        let Some(face) = world.shell.iter().find(|f| f.name == *name) else { continue };
        let wanted = crate::world::bounds_of(face.mesh.positions.iter().map(|p| p.as_dvec3()));
        if let Some(what) = apart(seen.low, seen.high, wanted.min, wanted.max, PLACE_M) {
            differs(name, what);
        }
    }
    for name in &rules.objects {
        let Some((item, place)) = world.items.iter().zip(0..).find(|(i, _)| i.name() == name) else { continue };
        let Some(seen) = found.objects.get(name) else {
            differs(name, "is missing".to_owned());
            continue;
        };
        let origin = if rules.alone { DVec3::ZERO } else { item.object.pose.position };
        if let Some(at) = seen.position
            && (at - origin).abs().max_element() > PLACE_M
        {
            differs(name, format!("stands at {}, in the scene at {}", metres(at), metres(origin)));
        }
        if rules.listed {
            let size = item.object.size.as_vec();
            let listed = seen.high - seen.low;
            if (listed - size).abs().max_element() > PLACE_M {
                differs(name, format!("is listed as {}, in the scene it is {}", metres(listed), metres(size)));
            }
            continue;
        }
        let wanted = if rules.alone { item.body_bounds() } else { item.room_bounds() };
        if let Some(what) = apart(seen.low, seen.high, wanted.min, wanted.max, PLACE_M) {
            differs(name, what);
        }
        let triangles: usize = world.body_pieces(item).iter().map(|p| p.triangles.len()).sum();
        // Triangles without an area may be left out by writer or reader.
        if seen.triangles.abs_diff(triangles) > triangles / 100 {
            differs(name, format!("has {} triangles, in the scene {triangles}", seen.triangles));
        }
        if rules.opens && seen.parts != item.opens.len() {
            differs(name, format!("has {} parts that open, in the scene {}", seen.parts, item.opens.len()));
        }
        let Some(body) = bodies.filter(|_| rules.bodies).and_then(|b| b.objects.get(place)) else { continue };
        if seen.hulls != body.hulls.len() {
            differs(name, format!("has {} colliders, in the scene {}", seen.hulls, body.hulls.len()));
        }
        let size = seen.high - seen.low;
        let slack = FIT.0.max(FIT.1 * size.max_element());
        // What gives way (a rug) has no colliders, and so no friction.
        let touches = !body.hulls.is_empty();
        if touches && let Some(what) = apart(seen.hull_low, seen.hull_high, seen.low, seen.high, slack) {
            differs(name, format!("colliders and mesh: {what}"));
        }
        let near = |a: f64, b: f64| (a - b).abs() <= SHARE * b.abs().max(1e-3);
        let dynamic = body.motion == Motion::Dynamic;
        if let Some(moves) = seen.moves.filter(|moves| rules.opens && *moves != dynamic) {
            differs(name, format!("{} move, in the scene it {}", can(moves), can(dynamic)));
        }
        if let Some(mass) = seen.mass
            && !near(mass, body.mass_kg)
        {
            differs(name, format!("weighs {mass} kg, in the scene {} kg", body.mass_kg));
        }
        if seen.mass.is_none() && body.motion == Motion::Dynamic {
            differs(name, format!("has no mass, in the scene {} kg", body.mass_kg));
        }
        match seen.friction {
            Some(friction) if near(friction, body.friction) => {}
            None if !touches => {}
            friction => differs(name, format!("has friction {friction:?}, in the scene {}", body.friction)),
        }
    }
    if let Some(camera) = found.camera {
        let wanted = world.camera.centre();
        if (camera - wanted).abs().max_element() > PLACE_M {
            differs("camera", format!("stands at {}, in the scene at {}", metres(camera), metres(wanted)));
        }
    }
    if let Some(lights) = &found.lights {
        let wanted = &world.scene.lighting.lights;
        if lights.len() != wanted.len() {
            differs("lights", format!("{} of them, in the scene {}", lights.len(), wanted.len()));
        }
        for light in wanted {
            let at = DVec3::from_array(light.position);
            if !lights.iter().any(|l| (*l - at).abs().max_element() <= PLACE_M) {
                differs(&light.id, format!("no light stands at {}", metres(at)));
            }
        }
    }
    out
}

fn can(moves: bool) -> &'static str {
    if moves { "can" } else { "cannot" }
}

fn metres(v: DVec3) -> String {
    format!("({:.4}, {:.4}, {:.4}) m", v.x, v.y, v.z)
}

/// How two boxes differ, if they do.
fn apart(low: DVec3, high: DVec3, wanted_low: DVec3, wanted_high: DVec3, slack: f64) -> Option<String> {
    let off = (low - wanted_low).abs().max((high - wanted_high).abs()).max_element();
    // An empty box is infinitely far off.
    (off.is_nan() || off > slack).then(|| {
        format!(
            "fills {} to {} instead of {} to {}",
            metres(low),
            metres(high),
            metres(wanted_low),
            metres(wanted_high)
        )
    })
}
