//! The light sources that a furnished room has.
//!
//! A window opening is a rectangle of daylight just inside its pane and behind its bars, a lamp is a bulb at the centre of its shade, the
//! room has a little ambient light. Powers are radiant watts as Cycles understands them and typical values only: the
//! model's specification, the fit and the reflective loop set them by the photo.

use std::collections::BTreeMap;

use glam::DVec3;
use harmony_catalogue::{Emission, emission};
use harmony_mesh::{Bounds, Material, Mesh, connected};
use harmony_scene::{
    Camera, Extents, Level, Light, LightKind, Lighting, ObjectId, Opening, OpeningKind, Ray, Room, SceneObject,
    ViewTransform, Wall, WallPlane,
};

use crate::delta::bounds;

/// Daylight through one square metre of window, watts: an overcast day, exposed for the room.
pub const WINDOW_WATTS_PER_M2: f64 = 26.0;
/// Colour of daylight from the sky, linear RGB.
pub const DAYLIGHT: [f64; 3] = [0.86, 0.93, 1.0];
/// Colour of household bulbs (about 2900 K), linear RGB.
pub const WARM_BULB: [f64; 3] = [1.0, 0.78, 0.56];
/// Colour of ceiling fixtures (about 3500 K), linear RGB.
pub const CEILING_BULB: [f64; 3] = [1.0, 0.87, 0.72];
/// Power of a table or wall lamp, watts.
pub const TABLE_LAMP_WATTS: f64 = 12.0;
/// Power of a floor lamp, watts.
pub const FLOOR_LAMP_WATTS: f64 = 25.0;
/// Power of a ceiling fixture, watts.
pub const CEILING_WATTS: f64 = 45.0;
/// Light of a switched-on screen, watts a square metre.
pub const SCREEN_WATTS_PER_M2: f64 = 5.0;
/// Colour of a screen's white.
const SCREEN_WHITE: [f64; 3] = [0.9, 0.95, 1.0];
/// Power of a fire that burns, watts, and its colour.
const FIRE_WATTS: f64 = 15.0;
const FIRE: [f64; 3] = [1.0, 0.5, 0.18];
/// Ambient radiance of a room with windows.
pub const AMBIENT_RADIANCE: f64 = 0.06;
/// Distance of the daylight rectangle from the wall plane, metres, where no window object says more; half of it, from a pane.
pub const PANE_GAP_M: f64 = 0.02;
/// A window object sticks out of its wall by at most this much; more is a wrong bound (a curtain in the mesh).
const MAX_PANE_GAP_M: f64 = 0.2;

/// A stretch of wall outside of the photo, shorter than this, gets no window, metres.
const UNSEEN_M: f64 = 1.2;
/// What hangs on a wall stands out of it by at most this much, metres.
const MAX_OFF_M: f64 = 0.4;
/// Step along a wall at which it is asked whether the photo shows it, metres.
const UNSEEN_STEP_M: f64 = 0.05;
/// Height of the middle of a window that the photo does not show, share of the room's.
const UNSEEN_MIDDLE: f64 = 0.6;
/// Its size: share of the stretch and of the room's height, and the most of each, metres.
const UNSEEN_SIZE: [(f64, f64); 2] = [(0.6, 2.4), (0.5, 1.4)];
/// Ids of their lights begin with it.
const UNSEEN: &str = "daylight_";

/// Ids of the light that comes through passages begin with it; what it is of daylight through a window of that size.
const PASSAGE: &str = "passage_";
const PASSAGE_SHARE: f64 = 0.5;

/// Slots of part models, and material names, that shine.
const EMITTER_WORDS: [&str; 8] = ["shade", "bulb", "globe", "diffuser", "lampshade", "emit", "glow", "flame"];

/// Material names of panes, and the transmission from which a material is one.
const PANE_WORDS: [&str; 4] = ["glass", "pane", "glazing", "view"];
const CLEAR: f32 = 0.3;

/// Bounds of the part of a mesh whose material emits, in the mesh's own frame.
fn emissive_bounds(mesh: &Mesh) -> Option<Bounds> {
    group_bounds(mesh, |m| mesh.materials.get(m).is_some_and(emits))
}

fn emits(material: &Material) -> bool {
    material.emissive.iter().any(|e| *e > 0.0)
}

/// Size of each connected part that emits, in the mesh's own frame.
fn emissive_parts(mesh: &Mesh) -> Vec<DVec3> {
    let takes = |g: usize| mesh.materials.get(mesh.groups[g].material).is_some_and(emits);
    let part_of = connected(mesh, &takes);
    let mut parts: BTreeMap<u32, (DVec3, DVec3)> = BTreeMap::new();
    let taken = mesh.groups.iter().enumerate().filter(|(g, _)| takes(*g));
    for i in taken.flat_map(|(_, group)| group.triangles.iter().flatten()) {
        let p = mesh.positions[*i as usize].as_dvec3();
        let (low, high) = parts.entry(part_of[*i as usize]).or_insert((p, p));
        (*low, *high) = (low.min(p), high.max(p));
    }
    parts.into_values().map(|(low, high)| high - low).collect()
}

/// Bounds of the part of a mesh that shines, in the mesh's own frame: emissive materials, else slots named so.
pub fn emitter_bounds(mesh: &Mesh) -> Option<Bounds> {
    let named = |m: usize| mesh.materials.get(m).is_some_and(|m| is_named_so(&m.name));
    emissive_bounds(mesh).or_else(|| group_bounds(mesh, named))
}

fn is_named_so(material: &str) -> bool {
    let name = material.to_lowercase();
    EMITTER_WORDS.iter().any(|w| name.contains(w))
}

/// Whether light shines through a material of a lamp: the shade round its bulb. What emits by itself is one only where it is
/// called a shade: how bright it looks is then the photo's to tell, too.
pub fn is_shade(material: &Material) -> bool {
    is_named_so(&material.name) && (!emits(material) || material.name.to_lowercase().contains("shade"))
}

/// Bounds of a window's panes, in the mesh's own frame: what is clear, else slots named so.
fn pane_bounds(mesh: &Mesh) -> Option<Bounds> {
    let of = |is: fn(&Material) -> bool| group_bounds(mesh, |m| mesh.materials.get(m).is_some_and(is));
    of(|m| m.transmission >= CLEAR).or_else(|| of(|m| is_pane_name(&m.name)))
}

/// Whether a material's name is one that the path tracer takes for a pane, whatever is painted on it.
pub fn is_pane_name(material: &str) -> bool {
    let name = material.to_lowercase();
    PANE_WORDS.iter().any(|w| name.contains(w))
}

fn group_bounds(mesh: &Mesh, wanted: impl Fn(usize) -> bool) -> Option<Bounds> {
    let mut found: Option<Bounds> = None;
    for group in mesh.groups.iter().filter(|g| wanted(g.material)) {
        for p in group.triangles.iter().flatten().filter_map(|i| mesh.positions.get(*i as usize)) {
            let p = p.as_dvec3();
            let b = found.get_or_insert(Bounds { min: p, max: p });
            b.min = b.min.min(p);
            b.max = b.max.max(p);
        }
    }
    found
}

/// What is known of an object that may shine.
#[derive(Debug, Clone, Copy, Default)]
pub struct Emitter<'m> {
    /// Its canonical mesh.
    pub mesh: Option<&'m Mesh>,
    /// Where its light comes from, in the mesh's frame, where its program says.
    pub bulb: Option<DVec3>,
}

/// The lights of a room before anybody has looked at the photo: all windows and lamps on, at typical powers.
///
/// Without a mesh or a bulb that was said the label decides where in the object's box the bulb is. Passages let light in. Openings without an object shine too; of doors those of glass. Screens shine from their front; a
/// fireplace is listed unlit. Ids are the objects', or `window_<n>` for openings without one.
pub fn lights_from_scene<'m>(
    room: &Room,
    objects: &[SceneObject],
    emitter: impl Fn(&ObjectId) -> Emitter<'m>,
) -> Lighting {
    let mesh_of = |id: &ObjectId| emitter(id).mesh;
    let mut lights = Vec::new();
    for (i, opening) in room.openings.iter().enumerate() {
        if opening.is_passage() {
            let light = window_light(room, opening, None, None, format!("{PASSAGE}{:02}", i + 1));
            lights.extend(light.map(|light| Light { intensity: PASSAGE_SHARE * light.intensity, ..light }));
            continue;
        }
        let object = opening.object.as_ref().and_then(|id| objects.iter().find(|o| o.id == *id));
        if opening.kind != OpeningKind::Window && !object.is_some_and(|o| harmony_catalogue::lets_daylight_in(&o.label))
        {
            continue;
        }
        let mut id = opening.object.as_ref().map_or_else(|| format!("window_{:02}", i + 1), ToString::to_string);
        if lights.iter().any(|l: &Light| l.id == id) {
            id = format!("{id}_{}", i + 1);
        }
        let mesh = object.and_then(|o| mesh_of(&o.id));
        if let Some(light) = window_light(room, opening, object, mesh, id) {
            lights.push(light);
        }
    }
    let emitting = |wanted: &'static [Emission]| {
        objects.iter().filter(move |o| emission(&o.label).is_some_and(|own| wanted.contains(&own)))
    };
    for object in emitting(&[Emission::Lamp, Emission::Candle]) {
        lights.push(lamp_light(room, object, emitter(&object.id)));
    }
    for object in emitting(&[Emission::Screen]) {
        lights.extend(screen_light(object, mesh_of(&object.id)));
    }
    for object in emitting(&[Emission::Fire]) {
        let place = object_bounds(object, mesh_of(&object.id));
        let low = DVec3::new(place.centre().x, place.min.y + 0.2 * place.size().y, place.centre().z);
        lights.push(Light {
            id: object.id.to_string(),
            kind: LightKind::Point { radius_m: 0.1 },
            position: object.pose.point(low).to_array(),
            color: FIRE,
            intensity: FIRE_WATTS,
            on: false,
            object: Some(object.id.clone()),
            shade: None,
        });
    }
    // What shines by its material, though its kind need not: strips, coves, a pane behind a curtain.
    for object in objects.iter().filter(|o| emission(&o.label).is_none()) {
        let of_an_opening = room.openings.iter().any(|o| o.object.as_ref() == Some(&object.id));
        if of_an_opening {
            continue;
        }
        let known = emitter(&object.id);
        let strip = known.mesh.and_then(|mesh| strip_light(room, object, mesh));
        lights.extend(strip.or_else(|| known.bulb.map(|_| lamp_light(room, object, known))));
    }
    lights.extend(coves(room));
    Lighting {
        lights,
        ambient_color: [1.0; 3],
        ambient_intensity: AMBIENT_RADIANCE,
        exposure: 0.0,
        view: ViewTransform::Standard,
    }
}

/// The lights hidden in the room's own trays. For formats that know no glowing mesh each is a rectangle as large as its
/// field, below it; the path tracer has the strip itself.
fn coves(room: &Room) -> Vec<Light> {
    let own = room.shape.niches.iter().enumerate().filter_map(|(k, niche)| Some((k, niche, niche.glow?)));
    own.map(|(k, niche, glow)| {
        let size = niche.max - niche.min;
        let middle = niche.min.midpoint(niche.max).with_y(niche.max.y - PANE_GAP_M);
        let kind = LightKind::Area { direction: DVec3::NEG_Y.to_array(), size_m: [size.x, size.z] };
        let most = glow.iter().copied().fold(1e-6, f32::max);
        Light {
            id: harmony_mesh::cove_name(niche.surface, k),
            intensity: bounds::intensity(&kind, STRIP_WATTS_PER_M * size.x.max(size.z)),
            kind,
            position: middle.to_array(),
            color: glow.map(|c| f64::from(c / most)),
            on: true,
            object: None,
            shade: None,
        }
    })
    .collect()
}

/// Whether a light is one that is hidden in a tray of the room.
pub fn is_cove(light: &Light) -> bool {
    light.object.is_none() && harmony_mesh::is_cove_name(&light.id)
}

/// Windows that a photo may be lit by without showing them: one in the longest stretch of each wall outside of the
/// picture. Whether there is any is for the fit to say ([`is_unseen_window`]). `hanging` are the bounds of what hangs on
/// walls, in the room's frame: a light within a curtain would burn it, so that it is before it.
pub fn unseen_windows(room: &Room, camera: &Camera, hanging: &[Bounds]) -> Vec<Light> {
    let faces = room.faces();
    let e = room.extents;
    let within = |p: DVec3| p.max(DVec3::splat(0.1)).min((e.as_vec() - 0.1).max(DVec3::splat(0.1)));
    let walls = [Wall::Front, Wall::Left, Wall::Right, Wall::Back];
    walls
        .into_iter()
        .filter_map(|wall| {
            let (from, to) = unseen_stretch(room, camera, wall);
            let [width, height] = [(to - from, UNSEEN_SIZE[0]), (e.height, UNSEEN_SIZE[1])]
                .map(|(all, (share, most))| (share * all).min(most));
            let middle = wall.point(&e, f64::midpoint(from, to), UNSEEN_MIDDLE * e.height);
            let position = middle + wall.normal() * (off_wall(wall, &e, middle, [width, height], hanging) + PANE_GAP_M);
            let eye = within(camera.centre());
            let way = position - eye;
            let ray = Ray { origin: eye, direction: way.try_normalize()? };
            let free = faces.exit(&ray).is_none_or(|exit| exit.point.distance(eye) >= way.length() - 0.1);
            let kind = LightKind::Area { direction: wall.normal().to_array(), size_m: [width, height] };
            (to - from >= UNSEEN_M && free).then(|| Light {
                id: format!("{UNSEEN}{}", wall.surface().name()),
                intensity: bounds::intensity(&kind, WINDOW_WATTS_PER_M2 * width * height),
                kind,
                position: position.to_array(),
                color: DAYLIGHT,
                on: true,
                object: None,
                shade: None,
            })
        })
        .collect()
}

/// How far what hangs over a rectangle on a wall stands out of the wall, metres; 0 where nothing does.
fn off_wall(wall: Wall, room: &Extents, middle: DVec3, [width, height]: [f64; 2], hanging: &[Bounds]) -> f64 {
    let normal = wall.normal();
    let half = DVec3::new(width, height, width) / 2.0 * (DVec3::ONE - normal.abs());
    let over = |b: &&Bounds| {
        let near = wall.distance(room, b.min).min(wall.distance(room, b.max));
        near < MAX_OFF_M
            && (0..3).all(|k| normal[k] != 0.0 || (b.min[k] < middle[k] + half[k] && b.max[k] > middle[k] - half[k]))
    };
    let reach = |b: &Bounds| wall.distance(room, b.min).max(wall.distance(room, b.max));
    hanging.iter().filter(over).map(reach).filter(|reach| *reach <= MAX_OFF_M).fold(0.0, f64::max)
}

/// Whether a light is what comes through a passage, from another room or from outside; how much that is, if anything, is
/// for the fit to say.
pub fn is_passage_light(light: &Light) -> bool {
    light.object.is_none() && light.id.starts_with(PASSAGE)
}

/// Whether a light is one of [`unseen_windows`].
pub fn is_unseen_window(light: &Light) -> bool {
    light.object.is_none() && is_unseen_id(&light.id)
}

/// The same by its id.
pub(crate) fn is_unseen_id(id: &str) -> bool {
    id.starts_with(UNSEEN)
}

/// The longest stretch of a wall that the photo does not show, at the height of windows, metres along it.
fn unseen_stretch(room: &Room, camera: &Camera, wall: Wall) -> (f64, f64) {
    let length = wall.length(&room.extents);
    let y = UNSEEN_MIDDLE * room.extents.height;
    let steps = (length / UNSEEN_STEP_M) as usize;
    let (mut best, mut now) = ((0.0, 0.0), (0.0, 0.0));
    for k in 0..=steps {
        let u = k as f64 * UNSEEN_STEP_M;
        let seen = camera.project(wall.point(&room.extents, u, y)).is_some_and(|p| camera.contains(p));
        now = if seen { (u, u) } else { (now.0, u) };
        if now.1 - now.0 > best.1 - best.0 {
            best = now;
        }
    }
    best
}

fn window_light(
    room: &Room,
    opening: &Opening,
    object: Option<&SceneObject>,
    mesh: Option<&Mesh>,
    id: String,
) -> Option<Light> {
    let size = [opening.u[1] - opening.u[0], opening.y[1] - opening.y[0]];
    if !size.iter().all(|s| s.is_finite() && *s > 0.01) {
        return None;
    }
    let normal = opening.wall.normal();
    let own = WallPlane { wall: opening.wall, inset: opening.inset };
    let plane = own.point(&room.extents, 0.0, 0.0).dot(normal);
    let reach = |o: &SceneObject, b: &Bounds| corners(o, b).map(|p| p.dot(normal) - plane).fold(f64::MIN, f64::max);
    let gap = object.map_or(PANE_GAP_M, |o| {
        // Behind frame and sill, where there is a pane: in front of them it burns the cloth beside the window.
        if let Some(pane) = mesh.and_then(pane_bounds).map(|b| reach(o, &b)).filter(|g| g.abs() <= MAX_PANE_GAP_M) {
            return pane + 0.5 * PANE_GAP_M;
        }
        let reach = reach(o, &object_bounds(o, mesh));
        if reach <= MAX_PANE_GAP_M { (reach.max(0.0) + 0.5 * PANE_GAP_M).max(PANE_GAP_M) } else { PANE_GAP_M }
    });
    let centre =
        own.point(&room.extents, f64::midpoint(opening.u[0], opening.u[1]), f64::midpoint(opening.y[0], opening.y[1]));
    let kind = LightKind::Area { direction: normal.to_array(), size_m: size };
    Some(Light {
        id,
        intensity: bounds::intensity(&kind, WINDOW_WATTS_PER_M2 * size[0] * size[1]),
        kind,
        position: (centre + normal * gap).to_array(),
        color: DAYLIGHT,
        on: true,
        object: object.map(|o| o.id.clone()),
        shade: None,
    })
}

/// The light of a screen, from its canonical front.
fn screen_light(object: &SceneObject, mesh: Option<&Mesh>) -> Option<Light> {
    let place = object_bounds(object, mesh);
    let scale = object.pose.stretch.abs() * object.pose.scale;
    let size = [0.9 * place.size().x * scale.x, 0.8 * place.size().y * scale.y];
    let front = DVec3::new(place.centre().x, place.centre().y, place.max.z);
    let centre = object.pose.point(front);
    let ahead = object.pose.point(front + DVec3::Z) - centre;
    let direction = ahead.try_normalize()?;
    if !size.iter().all(|s| s.is_finite() && *s > 0.02) {
        return None;
    }
    let kind = LightKind::Area { direction: direction.to_array(), size_m: size };
    Some(Light {
        id: object.id.to_string(),
        intensity: bounds::intensity(&kind, SCREEN_WATTS_PER_M2 * size[0] * size[1]),
        kind,
        position: (centre + direction * PANE_GAP_M).to_array(),
        color: SCREEN_WHITE,
        on: true,
        object: Some(object.id.clone()),
        shade: None,
    })
}

/// Corners in the room of a box in an object's canonical frame.
fn corners(object: &SceneObject, b: &Bounds) -> impl Iterator<Item = DVec3> {
    let b = *b;
    let pose = object.pose;
    (0..8).map(move |i| {
        let pick = |bit: usize, axis: usize| if i >> bit & 1 == 0 { b.min[axis] } else { b.max[axis] };
        pose.point(DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2)))
    })
}

/// Bounds in canonical units: the mesh's, else from the size.
fn object_bounds(object: &SceneObject, mesh: Option<&Mesh>) -> Bounds {
    mesh.and_then(Mesh::bounds).unwrap_or_else(|| {
        let stretch = object.pose.stretch * object.pose.scale;
        let unit = DVec3::select(stretch.abs().cmpgt(DVec3::splat(1e-9)), object.size.as_vec() / stretch, DVec3::ZERO);
        Bounds {
            min: DVec3::new(-unit.x / 2.0, 0.0, -unit.z / 2.0),
            max: DVec3::new(unit.x / 2.0, unit.y, unit.z / 2.0),
        }
    })
}

/// Smallest side, metres, of a shining part that lights a room: digits of a clock don't.
const MIN_STRIP: f64 = 0.1;
/// A strip or a field is at least this long, and at most this share of it thick, to give light as a rectangle: other shapes
/// do as bulbs.
const STRIP: (f64, f64) = (0.5, 0.35);
/// Light of a strip or a field, watts a metre of its longest side.
const STRIP_WATTS_PER_M: f64 = 12.0;

/// A rectangle of light where what emits is long or wide and thin: off the wall, or down from the ceiling. Bulbs on a ring
/// are none, however wide the ring is: one part has to be long by itself.
fn rectangle(object: &SceneObject, mesh: &Mesh) -> Option<(DVec3, LightKind)> {
    let emitter = emissive_bounds(mesh)?;
    let scale = object.pose.stretch.abs() * object.pose.scale;
    if !emissive_parts(mesh).iter().any(|part| (*part * scale).max_element() >= STRIP.0) {
        return None;
    }
    let corners: Vec<DVec3> = (0..8)
        .map(|i| {
            let pick = |axis: usize| if i >> axis & 1 == 0 { emitter.min[axis] } else { emitter.max[axis] };
            object.pose.point(DVec3::new(pick(0), pick(1), pick(2)))
        })
        .collect();
    let low = corners.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = corners.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let (size, centre) = (high - low, low.midpoint(high));
    let direction = match object.level {
        Level::Ceiling => DVec3::NEG_Y,
        Level::Wall => (object.pose.point(DVec3::Z) - object.pose.point(DVec3::ZERO)).try_normalize()?,
        _ => return None,
    };
    let thick = size.dot(direction.abs());
    let size_m = match object.level {
        Level::Ceiling => [size.x, size.z],
        _ => [emitter.size().x * scale.x, size.y],
    };
    let longest = size_m[0].max(size_m[1]);
    let is_strip = size.is_finite() && longest >= STRIP.0 && thick <= STRIP.1 * longest;
    let kind = LightKind::Area { direction: direction.to_array(), size_m: size_m.map(|s| s.max(0.01)) };
    is_strip.then(|| (centre + direction * (thick / 2.0 + PANE_GAP_M), kind))
}

/// The light of something that shines by its material alone.
fn strip_light(room: &Room, object: &SceneObject, mesh: &Mesh) -> Option<Light> {
    let emitter = emissive_bounds(mesh)?;
    let size = emitter.size() * object.pose.stretch.abs() * object.pose.scale;
    let longest = size.max_element();
    if !size.is_finite() || longest < MIN_STRIP {
        return None;
    }
    let (position, kind) = rectangle(object, mesh).unwrap_or_else(|| {
        let radius_m = (size.min_element() / 4.0).clamp(0.015, 0.06);
        (object.pose.point(emitter.centre()), LightKind::Point { radius_m })
    });
    let emitted = mesh.materials.iter().map(|m| m.emissive).max_by(|a, b| a[1].total_cmp(&b[1]))?;
    let most = emitted.iter().copied().fold(1e-6, f32::max);
    let margin = DVec3::splat(0.01);
    Some(Light {
        id: object.id.to_string(),
        intensity: bounds::intensity(&kind, STRIP_WATTS_PER_M * longest),
        kind,
        position: position.max(margin).min((room.extents.as_vec() - margin).max(margin)).to_array(),
        color: emitted.map(|c| f64::from(c / most)),
        on: true,
        object: Some(object.id.clone()),
        shade: None,
    })
}

fn lamp_light(room: &Room, object: &SceneObject, known: Emitter<'_>) -> Light {
    let mesh = known.mesh;
    let bulb_at = harmony_catalogue::kind(&object.label).and_then(|k| k.bulb_at);
    let all = object_bounds(object, mesh);
    let emitter = mesh.and_then(emitter_bounds);
    let said = known.bulb.filter(|_| mesh.and_then(emissive_bounds).is_none());
    let at = |fraction: f64| DVec3::new(all.centre().x, all.min.y + fraction * all.size().y, all.centre().z);
    let by_label = || match (bulb_at, object.level) {
        (Some(share), _) => at(share),
        // A flush fixture shines from below its dish.
        (None, Level::Ceiling) => DVec3::new(all.centre().x, all.min.y, all.centre().z),
        (None, Level::Wall) => all.centre(),
        _ if all.size().y > 3.0 * all.size().x.max(all.size().z) => at(0.88),
        _ => at(0.72),
    };
    let canonical = said.or_else(|| emitter.map(|b| b.centre())).unwrap_or_else(by_label);
    let mut position = object.pose.point(canonical);
    if object.level == Level::Ceiling && emitter.is_none() && said.is_none() && bulb_at.is_none() {
        position.y -= 0.05;
    }
    let shade = emitter.unwrap_or(all).size() * object.pose.stretch.abs() * object.pose.scale;
    let radius_m = (shade.min_element() / 4.0).clamp(0.015, 0.06);
    // A bulb in a wall or above the ceiling would light nothing.
    let margin = DVec3::splat(radius_m + 0.01);
    let inside = room.extents.as_vec() - margin;
    position = position.max(margin).min(inside.max(margin));
    let (watts, color) = match object.level {
        Level::Ceiling => (CEILING_WATTS, CEILING_BULB),
        _ if emission(&object.label) == Some(Emission::Candle) => (1.0, [1.0, 0.6, 0.25]),
        _ if object.size.height > 1.0 => (FLOOR_LAMP_WATTS, WARM_BULB),
        _ => (TABLE_LAMP_WATTS, WARM_BULB),
    };
    let mut kind = LightKind::Point { radius_m };
    // A strip, a luminous field or a cove is no bulb in its middle.
    if let Some((below, field)) = mesh.and_then(|mesh| rectangle(object, mesh)) {
        (position, kind) = (below.max(margin).min(inside.max(margin)), field);
    }
    Light {
        id: object.id.to_string(),
        intensity: bounds::intensity(&kind, watts),
        kind,
        position: position.to_array(),
        color,
        on: true,
        object: Some(object.id.clone()),
        shade: None,
    }
}

#[cfg(test)]
mod tests;
