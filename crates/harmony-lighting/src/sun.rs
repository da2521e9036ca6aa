//! The sun, from the patches that it throws through windows and glass doors.
//!
//! For each direction of the sky that an opening lets in, the places that the sun would reach are known: a ray towards it
//! leaves through an opening and meets nothing before. The direction whose patches explain most of the photo's brightness
//! within its surfaces is the sun's, where the photo is brighter by a step at the patches' edges; a window's own daylight
//! brightens what is near it, but makes no edge. Key `light.sun`.

mod unseen;

use glam::DVec3;
use harmony_scene::{Light, LightKind, Opening, Room};
use serde::Serialize;

pub use unseen::{ToldSun, UnseenOpenings, unseen_openings};

/// Directions are tried in steps of so many degrees, then ever finer around the best ones.
const STEP_DEG: f64 = 5.0;
const FINER_DEG: [f64; 4] = [2.5, 1.2, 0.6, 0.3];
/// So many of the coarse directions are refined.
const REFINED: usize = 12;
/// Largest angle between the sun and the way straight out of an opening, degrees, and range of its height.
const ASIDE_DEG: f64 = 75.0;
const HEIGHT_DEG: [f64; 2] = [5.0, 80.0];
/// Least cosine of the sun on a surface.
const GRAZING: f64 = 0.08;
/// Distance from a surface at which a ray begins, metres.
const ABOVE: f64 = 0.02;
/// A surface with fewer places says nothing.
const MIN_PLACES: usize = 60;
/// Brightness is believed up to so far from a surface's own, stops.
const MAX_STOPS: f64 = 2.5;
/// Share of the brightness within surfaces that the patches explain at least; and where who looked at the photo says that the sun
/// falls on something: stripes and grain of what it falls on are no reason against it then.
const EXPLAINED: f64 = 0.10;
const EXPLAINED_SAID: f64 = 0.03;
/// Places on both sides of a patch's edge, in places apart; so many pairs at least, so many stops between them, that share
/// of them in the right sense, and so many times what pairs without an edge differ by.
const APART: usize = 3;
const MIN_PAIRS: usize = 24;
const MIN_STEP: f64 = 0.4;
const RIGHT_SENSE: f64 = 0.8;
const TIMES_USUAL: f64 = 2.0;
/// Share of the places that the sun reaches at least and at most.
const REACHED: [f64; 2] = [0.004, 0.6];
/// Irradiance before it is fitted, W/m2, and colour.
const IRRADIANCE: f64 = 5.0;
const SUNLIGHT: [f64; 3] = [1.0, 0.93, 0.82];
/// Id of the light.
const ID: &str = "sun_01";

/// A place that the photo shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Where it is, in the room, metres.
    pub point: DVec3,
    /// Unit normal, towards the camera.
    pub normal: DVec3,
    /// The surface that it belongs to.
    pub surface: u32,
    /// Logarithm (base 2) of the photo's luminance there.
    pub stops: f64,
}

/// Places of the photo, row by row; `None` where it shows nothing that could be compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Places {
    /// Places in a row.
    pub columns: usize,
    /// All of them.
    pub all: Vec<Option<Place>>,
}

/// A sun that the photo speaks for.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FoundSun {
    /// The light, before its strength is fitted.
    pub light: Light,
    /// By how much its patches are brighter at their edges, stops.
    #[serde(rename = "step_stops")]
    pub step: f64,
    /// Share of the brightness within surfaces that it explains.
    pub explained: f64,
}

/// Looks for the sun behind `openings`; `blocked` says whether something stands in the way of a ray within a distance, `is_said`
/// whether the sun was said to fall on something.
pub fn find_sun(
    places: &Places,
    room: &Room,
    openings: &[&Opening],
    blocked: &dyn Fn(DVec3, DVec3, f64) -> bool,
    is_said: bool,
) -> Option<FoundSun> {
    let search = Search { residual: Residual::of(places)?, places, room, openings, blocked };
    let mut tried: Vec<(f64, Sky)> = search.skies().into_iter().map(|sky| (search.explained(sky), sky)).collect();
    tried.retain(|(explained, _)| *explained > 0.0);
    tried.sort_by(|a, b| b.0.total_cmp(&a.0));
    let (explained, sky) =
        tried.into_iter().take(REFINED).map(|start| search.refined(start)).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let reached = search.reached(sky);
    let step = search.step(&reached)?;
    let least = if is_said { EXPLAINED_SAID } else { EXPLAINED };
    (explained >= least).then(|| FoundSun { light: sun_light(room, sky.towards()), step, explained })
}

/// The sun in a direction, before its strength is fitted.
pub fn sun_light(room: &Room, towards: DVec3) -> Light {
    Light {
        id: ID.to_owned(),
        kind: LightKind::Sun { direction: (-towards).to_array() },
        position: (room.extents.as_vec() / 2.0).to_array(),
        color: SUNLIGHT,
        intensity: IRRADIANCE,
        on: true,
        object: None,
        shade: None,
    }
}

/// Whether a light is one that [`find_sun`] found, or that was told ([`sun_light`]).
pub fn is_found_sun(light: &Light) -> bool {
    light.id == ID && matches!(light.kind, LightKind::Sun { .. })
}

/// A direction of the sky, degrees: azimuth from +X towards +Z, and height.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sky {
    azimuth: f64,
    height: f64,
}

impl Sky {
    /// Unit vector towards it.
    fn towards(self) -> DVec3 {
        let (sin, cos) = self.azimuth.to_radians().sin_cos();
        let (up, out) = self.height.to_radians().sin_cos();
        DVec3::new(out * cos, up, out * sin)
    }
}

struct Search<'a> {
    residual: Residual,
    places: &'a Places,
    room: &'a Room,
    openings: &'a [&'a Opening],
    blocked: &'a dyn Fn(DVec3, DVec3, f64) -> bool,
}

impl Search<'_> {
    /// Directions that some opening lets in.
    fn skies(&self) -> Vec<Sky> {
        let mut skies = Vec::new();
        let steps = |from: f64, to: f64| {
            let n = ((to - from) / STEP_DEG).floor() as usize;
            (0..=n).map(move |k| from + STEP_DEG * k as f64)
        };
        let outward: Vec<DVec3> = self.openings.iter().map(|o| -o.wall.normal()).collect();
        for azimuth in steps(0.0, 360.0 - STEP_DEG) {
            let level = Sky { azimuth, height: 0.0 }.towards();
            if outward.iter().any(|o| o.dot(level) >= ASIDE_DEG.to_radians().cos()) {
                skies.extend(steps(HEIGHT_DEG[0], HEIGHT_DEG[1]).map(|height| Sky { azimuth, height }));
            }
        }
        skies
    }

    /// Which places the sun reaches.
    fn reached(&self, sky: Sky) -> Vec<bool> {
        let towards = sky.towards();
        let reaches = |place: &Place| {
            if place.normal.dot(towards) < GRAZING {
                return false;
            }
            let from = place.point + place.normal * ABOVE;
            let way = self.openings.iter().filter_map(|o| self.way_out(o, from, towards)).reduce(f64::min);
            way.is_some_and(|way| !(self.blocked)(from, towards, way))
        };
        self.places.all.iter().map(|p| p.as_ref().is_some_and(reaches)).collect()
    }

    /// Distance to an opening along a ray that leaves through it.
    fn way_out(&self, opening: &Opening, from: DVec3, towards: DVec3) -> Option<f64> {
        let plane = harmony_scene::WallPlane { wall: opening.wall, inset: opening.inset };
        let speed = -towards.dot(plane.normal());
        if speed < 1e-3 {
            return None;
        }
        let way = plane.distance(&self.room.extents, from) / speed;
        let at = plane.coordinates(from + towards * way);
        let within = |v: f64, range: [f64; 2]| v >= range[0] && v <= range[1];
        (way > 0.0 && within(at.x, opening.u) && within(at.y, opening.y)).then_some(way)
    }

    /// Share of the brightness that a direction's patches explain; negative where they are darker.
    fn explained(&self, sky: Sky) -> f64 {
        let reached = self.reached(sky);
        let share = reached.iter().filter(|r| **r).count() as f64 / self.residual.count.max(1) as f64;
        if !(REACHED[0]..=REACHED[1]).contains(&share) {
            return 0.0;
        }
        self.residual.explained(self.places, &reached)
    }

    /// The best direction near one.
    fn refined(&self, start: (f64, Sky)) -> (f64, Sky) {
        let (mut most, mut best) = start;
        for step in FINER_DEG {
            loop {
                let around = [(step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step)];
                let next = around
                    .map(|(a, h)| Sky {
                        azimuth: best.azimuth + a,
                        height: (best.height + h).clamp(HEIGHT_DEG[0], HEIGHT_DEG[1]),
                    })
                    .map(|sky| (self.explained(sky), sky));
                let Some((explained, sky)) = next.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
                if explained <= most + 1e-9 {
                    break;
                }
                (most, best) = (explained, sky);
            }
        }
        (most, best)
    }

    /// The step in brightness at the patches' edges, stops; `None` where there is none to speak of.
    fn step(&self, reached: &[bool]) -> Option<f64> {
        let columns = self.places.columns;
        let (mut steps, mut usual) = (Vec::new(), Vec::new());
        for (i, place) in self.places.all.iter().enumerate() {
            let Some(place) = place else { continue };
            let across = (i % columns + APART < columns).then_some(i + APART);
            for j in [across, Some(i + APART * columns)].into_iter().flatten() {
                let Some(other) = self.places.all.get(j).copied().flatten() else { continue };
                if other.surface != place.surface || other.normal.dot(place.normal) < 0.95 {
                    continue;
                }
                let difference = place.stops - other.stops;
                match (reached[i], reached[j]) {
                    (true, false) => steps.push(difference),
                    (false, true) => steps.push(-difference),
                    _ => usual.push(difference.abs()),
                }
            }
        }
        if steps.len() < MIN_PAIRS || usual.is_empty() {
            return None;
        }
        let right = steps.iter().filter(|s| **s > 0.0).count() as f64 / steps.len() as f64;
        let (step, usual) = (crate::view::median(&mut steps), crate::view::median(&mut usual));
        (right >= RIGHT_SENSE && step >= MIN_STEP.max(TIMES_USUAL * usual)).then_some(step)
    }
}

/// Brightness within surfaces, a plane through each taken out.
struct Residual {
    /// By place; 0 where it does not count.
    values: Vec<f64>,
    /// Places of each surface that counts.
    surfaces: Vec<Vec<usize>>,
    squares: f64,
    count: usize,
}

impl Residual {
    fn of(places: &Places) -> Option<Self> {
        let mut by_surface: std::collections::BTreeMap<u32, Vec<usize>> = std::collections::BTreeMap::new();
        for (i, place) in places.all.iter().enumerate() {
            if let Some(place) = place {
                by_surface.entry(place.surface).or_default().push(i);
            }
        }
        let surfaces: Vec<Vec<usize>> = by_surface.into_values().filter(|s| s.len() >= MIN_PLACES).collect();
        let mut values = vec![0.0; places.all.len()];
        for surface in &surfaces {
            let mut own: Vec<f64> = surface.iter().map(|i| places.all[*i].map_or(0.0, |p| p.stops)).collect();
            let middle = crate::view::median(&mut own.clone());
            for v in &mut own {
                *v = (*v - middle).clamp(-MAX_STOPS, MAX_STOPS);
            }
            for (i, v) in surface.iter().zip(without_plane(&own, surface, places.columns)) {
                values[*i] = v;
            }
        }
        let squares: f64 = values.iter().map(|v| v * v).sum();
        let count = surfaces.iter().map(Vec::len).sum();
        (squares > 0.0).then_some(Self { values, surfaces, squares, count })
    }

    fn explained(&self, places: &Places, reached: &[bool]) -> f64 {
        let (mut both, mut own) = (0.0, 1e-9);
        for surface in &self.surfaces {
            let mask: Vec<f64> = surface.iter().map(|i| f64::from(u8::from(reached[*i]))).collect();
            let n = mask.iter().sum::<f64>();
            if n < 1.0 || n as usize == mask.len() {
                continue;
            }
            for (m, i) in without_plane(&mask, surface, places.columns).iter().zip(surface) {
                both += m * self.values[*i];
                own += m * m;
            }
        }
        both * both.abs() / (own * self.squares)
    }
}

/// Values at places without the plane through them over the picture.
fn without_plane(values: &[f64], at: &[usize], columns: usize) -> Vec<f64> {
    let n = values.len() as f64;
    let place = |i: usize| glam::DVec2::new((i % columns) as f64, (i / columns) as f64);
    let centre = at.iter().map(|i| place(*i)).sum::<glam::DVec2>() / n;
    let mean = values.iter().sum::<f64>() / n;
    let (mut xx, mut xy, mut yy, mut xv, mut yv) = (1e-6, 0.0, 1e-6, 0.0, 0.0);
    for (v, i) in values.iter().zip(at) {
        let p = place(*i) - centre;
        xx += p.x * p.x;
        xy += p.x * p.y;
        yy += p.y * p.y;
        xv += p.x * (v - mean);
        yv += p.y * (v - mean);
    }
    let det = xx * yy - xy * xy;
    let slope = if det > 1e-6 * xx * yy {
        glam::DVec2::new((yy * xv - xy * yv) / det, (xx * yv - xy * xv) / det)
    } else {
        glam::DVec2::ZERO
    };
    values.iter().zip(at).map(|(v, i)| v - mean - slope.dot(place(*i) - centre)).collect()
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Extents, OpeningKind, RoomShape, Wall};

    use super::*;

    const ROOM: Extents = Extents { width: 4.0, height: 2.6, depth: 5.0 };

    fn room(wall: Wall) -> Room {
        let opening = Opening {
            kind: OpeningKind::Window,
            wall,
            u: [1.2, 2.6],
            y: [0.8, 2.1],
            inset: 0.0,
            rise: 0.0,
            object: None,
        };
        Room {
            room_type: "bedroom".into(),
            extents: ROOM,
            shape: RoomShape::default(),
            seen: vec![],
            openings: vec![opening],
            floor_texture: None,
            wall_texture: None,
        }
    }

    /// The whole floor, 5 cm apart.
    fn floor(stops: impl Fn(DVec3) -> f64) -> Places {
        let (columns, rows) = (80, 100);
        let place = |i: usize| {
            let point = DVec3::new((i % columns) as f64 * 0.05 + 0.025, 0.0, (i / columns) as f64 * 0.05 + 0.025);
            Some(Place { point, normal: DVec3::Y, surface: 1, stops: stops(point) })
        };
        Places { columns, all: (0..columns * rows).map(place).collect() }
    }

    fn found(room: &Room, places: &Places) -> Option<FoundSun> {
        told(room, places, false)
    }

    fn told(room: &Room, places: &Places, is_said: bool) -> Option<FoundSun> {
        find_sun(places, room, &room.openings.iter().collect::<Vec<_>>(), &|_, _, _| false, is_said)
    }

    /// Grain that is the same at the same place.
    fn grain(p: DVec3) -> f64 {
        0.15 * ((p.x * 91.7).sin() + (p.z * 57.3 + p.x * 13.0).sin())
    }

    #[test]
    fn a_patch_of_sun_on_the_floor_tells_where_the_sun_is() {
        for (wall, azimuth, height) in [(Wall::Left, 200.0, 38.0), (Wall::Back, 250.0, 50.0)] {
            let room = room(wall);
            let sky = Sky { azimuth, height };
            let bare = floor(|_| 0.0);
            let openings: Vec<&Opening> = room.openings.iter().collect();
            let search = Search {
                residual: Residual { values: vec![], surfaces: vec![], squares: 1.0, count: 1 },
                places: &bare,
                room: &room,
                openings: &openings,
                blocked: &|_, _, _| false,
            };
            // The same rays that are looked for, but on a floor with grain and daylight that falls off from the window.
            let lit = search.reached(sky);
            let mut at = lit.iter();
            let mut stops = Vec::new();
            for place in bare.all.iter().flatten() {
                let near = ROOM.width - place.point.x;
                stops.push(grain(place.point) + 0.2 * near + if *at.next().unwrap() { 1.3 } else { 0.0 });
            }
            let mut at = stops.into_iter();
            let all = bare.all.iter().map(|p| p.map(|p| Place { stops: at.next().unwrap(), ..p })).collect();
            let lit_floor = Places { all, ..bare.clone() };
            let sun = found(&room, &lit_floor).expect("a sun");
            let LightKind::Sun { direction } = sun.light.kind else { panic!("no sun") };
            let off = DVec3::from_array(direction).angle_between(-sky.towards()).to_degrees();
            assert!(off < 2.0, "{wall:?}: {off} degrees off");
            assert!((0.9..1.6).contains(&sun.step), "{}", sun.step);
            // On a cloth of broad stripes that differ by more than the sun makes, it has to be said.
            let striped = |p: DVec3| if (p.x * 8.0).sin() > 0.0 { 1.6 } else { -1.6 };
            let cloth = |p: &Option<Place>| p.map(|p| Place { stops: p.stops + striped(p.point), ..p });
            let striped = Places { all: lit_floor.all.iter().map(cloth).collect(), ..bare.clone() };
            assert_eq!(found(&room, &striped), None);
            let LightKind::Sun { direction } = told(&room, &striped, true).expect("a sun").light.kind else { panic!() };
            let off = DVec3::from_array(direction).angle_between(-sky.towards()).to_degrees();
            assert!(off < 10.0, "{wall:?}: {off} degrees off");
        }
    }

    #[test]
    fn daylight_that_falls_off_from_its_window_is_no_sun() {
        let room = room(Wall::Left);
        let soft = floor(|p| {
            let away = (p - DVec3::new(0.0, 1.4, 1.9)).length();
            grain(p) - 2.0 * away.log2()
        });
        assert_eq!(found(&room, &soft), None);
        assert_eq!(told(&room, &soft, true), None);
        assert_eq!(found(&room, &floor(grain)), None);
    }

    #[test]
    fn patches_that_no_opening_throws_are_not_the_suns() {
        let room = room(Wall::Left);
        // A bright rug far from where the window's light could come from.
        let rug = floor(|p| grain(p) + if p.x > 3.2 && p.z > 4.2 { 1.5 } else { 0.0 });
        assert_eq!(found(&room, &rug), None);
    }
}
