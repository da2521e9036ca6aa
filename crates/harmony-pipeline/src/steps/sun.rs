//! What the photo tells of the sun ([`harmony_lighting::find_sun`]): its places, and what stands in the light's way.

use glam::{DVec2, DVec3};
use harmony_imaging::color::linear_from_srgb;
use harmony_lighting::linear::luminance;
use harmony_lighting::{FoundSun, Place, Places, SunSpec, ToldSun, find_sun, sun_light, unseen_openings};
use harmony_mesh::{Bvh, Group, Mesh};
use harmony_render::{SOLID, opacity};
use harmony_scene::{ImageSize, Light, Lighting, Opening, Pose, Room};
use image::imageops::{FilterType, resize};
use rayon::prelude::*;
use serde::Serialize;

use crate::state::SceneState;

/// Places across the photo.
const COLUMNS: u32 = 200;
/// Level from which a channel is cut off, and luminance below which noise is all there is.
const BLOWN: u8 = 254;
const BLACK: f32 = 0.003;
/// Farther than any room is wide, metres.
const FAR: f64 = 100.0;

/// A sun, and the openings behind the camera that let it in.
#[derive(Debug, Clone, Serialize)]
pub struct Sun {
    /// The light, before its strength is fitted.
    pub light: Light,
    /// What the photo's brightness says for it; `None` where it was only told.
    pub found: Option<FoundSun>,
    /// Windows that the photo does not show and the patches tell of.
    pub openings: Vec<Opening>,
}

/// The sun that the photo speaks for, through what gives daylight in `lighting`, or through openings that the photo does not
/// show and that patches of sun tell of.
/// None where who looked at it says that there is none: brightness alone takes a white table under a window for it.
pub fn found(state: &SceneState, lighting: &Lighting) -> Option<Sun> {
    if state.told_light.direct_sun == Some(false) {
        return None;
    }
    let room = &state.partial.room;
    let gives_light = |o: &&Opening| {
        !o.is_passage()
            && o.object.as_ref().is_none_or(|id| lighting.lights.iter().any(|l| l.object.as_ref() == Some(id)))
    };
    let mut openings: Vec<&Opening> = room.openings.iter().filter(gives_light).collect();
    let things = things(state);
    let told = state
        .told_light
        .sun
        .as_ref()
        .and_then(|told| unseen_openings(room, &state.partial.camera, &in_room(state, told, &things)));
    let unseen: Vec<Opening> = told.iter().flat_map(|told| told.openings.clone()).collect();
    openings.extend(&unseen);
    if openings.is_empty() {
        return None;
    }
    let places = places(state, &things);
    let in_the_way: Vec<&Bvh> = things.iter().filter(|t| !t.fills_an_opening).map(|t| &t.solid).collect();
    let blocked = |from: DVec3, way: DVec3, far: f64| in_the_way.iter().any(|bvh| bvh.any_hit(from, way, far));
    let found = find_sun(&places, room, &openings, &blocked, state.told_light.direct_sun == Some(true));
    let light = match (&found, &told) {
        (Some(found), _) => found.light.clone(),
        (None, Some(told)) => sun_light(room, told.towards),
        (None, None) => return None,
    };
    Some(Sun { light, found, openings: unseen })
}

/// What was told of the sun, in the room.
fn in_room(state: &SceneState, told: &SunSpec, things: &[Thing]) -> ToldSun {
    let (camera, faces) = (&state.partial.camera, state.partial.room.faces());
    let size = DVec2::new(f64::from(camera.size.width), f64::from(camera.size.height));
    let ray_of = |p: &[f64; 2]| camera.ray(DVec2::from_array(*p) / 1000.0 * size);
    // A patch lies on the room's faces, whatever stands before its edge.
    let on_faces = |p: &[f64; 2]| faces.exit(&ray_of(p)).map(|exit| exit.point);
    let place = |p: &[f64; 2]| {
        let ray = ray_of(p);
        let hit = things.iter().filter_map(|t| t.solid.raycast(ray.origin, ray.direction, FAR));
        let nearest = hit.min_by(|a, b| a.distance.total_cmp(&b.distance)).map(|hit| hit.point);
        nearest.or_else(|| on_faces(p))
    };
    ToldSun {
        patches: told.patches.iter().map(|patch| patch.iter().filter_map(on_faces).collect()).collect(),
        shadows: told.shadows.iter().filter_map(|[tip, end]| Some((place(tip)?, on_faces(end)?))).collect(),
    }
}

struct Thing {
    index: u32,
    /// What light does not pass, in the room's frame.
    solid: Bvh,
    fills_an_opening: bool,
    mask: harmony_scene::Mask,
}

fn things(state: &SceneState) -> Vec<Thing> {
    let fills = |room: &Room, id| room.openings.iter().any(|o| o.object.as_ref() == Some(id));
    let size = small(state);
    state
        .partial
        .placed
        .par_iter()
        .filter_map(|placed| {
            let id = &placed.item.id;
            let object = state.objects.get(id)?;
            Some(Thing {
                index: placed.item.index,
                solid: Bvh::new(&solid(state.mesh_of(id)?, &placed.pose)),
                fills_an_opening: fills(&state.partial.room, id),
                mask: object.mask.resized(size),
            })
        })
        .collect()
}

/// The parts of a mesh that light does not pass, where it stands.
fn solid(mesh: &Mesh, pose: &Pose) -> Mesh {
    let is_solid = |g: &&Group| mesh.materials.get(g.material).is_none_or(|m| opacity(m) >= SOLID);
    Mesh {
        positions: mesh.positions.iter().map(|p| pose.point(p.as_dvec3()).as_vec3()).collect(),
        groups: mesh.groups.iter().filter(is_solid).map(|g| Group { material: 0, ..g.clone() }).collect(),
        ..Mesh::default()
    }
}

fn small(state: &SceneState) -> ImageSize {
    state.partial.camera.size.fit_within(COLUMNS)
}

/// The photo's places where scene and photo show the same thing.
fn places(state: &SceneState, things: &[Thing]) -> Places {
    let size = small(state);
    let camera = state.partial.camera.resized(size);
    let faces = state.partial.room.faces();
    let photo = resize(&*state.photo, size.width, size.height, FilterType::Triangle);
    let taken = state.all_objects().or(&state.photo_frame).resized(size);
    let place = |i: u32| {
        let (x, y) = (i % size.width, i / size.width);
        let pixel = photo.get_pixel(x, y).0;
        let [r, g, b] = pixel.map(|v| linear_from_srgb(f32::from(v) / 255.0));
        let luminance = luminance([r, g, b]);
        if luminance < BLACK || pixel.iter().all(|v| *v >= BLOWN) {
            return None;
        }
        let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
        let hit = things
            .iter()
            .filter_map(|t| Some((t.solid.raycast(ray.origin, ray.direction, FAR)?, t)))
            .min_by(|a, b| a.0.distance.total_cmp(&b.0.distance));
        let (px, py) = (i64::from(x), i64::from(y));
        let (point, normal, surface, own) = if let Some((hit, t)) = hit {
            (hit.point, hit.normal, 100 + t.index, t.mask.get(px, py))
        } else {
            let exit = faces.exit(&ray)?;
            (exit.point, exit.normal, exit.surface as u32, !taken.get(px, py))
        };
        let normal = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
        own.then(|| Place { point, normal, surface, stops: f64::from(luminance.log2()) })
    };
    Places { columns: size.width as usize, all: (0..size.width * size.height).into_par_iter().map(place).collect() }
}
