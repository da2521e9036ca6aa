//! How bright lampshades are in the photo: what is lit from within has no reflectance to be fitted, its picture is its light.

use harmony_imaging::color::linear_from_rgb8;
use harmony_lighting::is_shade;
use harmony_mesh::Mesh;
use harmony_render::{Glass, Instance, Lighting as Look, RenderOptions, render_depth_ids};
use harmony_scene::Light;

use super::grain::numbered;
use crate::state::SceneState;
use crate::views;

/// Share of the photo's pixels that a shade must fill to be measured.
const FEWEST: f64 = 5e-5;

/// Puts the mean colour that the photo shows of its shade into each lamp's light.
pub fn measure(state: &SceneState, lights: &mut [Light]) {
    for light in lights.iter_mut() {
        light.shade = None;
    }
    let placed = &state.partial.placed;
    let owners: Vec<Option<usize>> = lights
        .iter()
        .map(|light| placed.iter().position(|p| light.on && Some(&p.item.id) == light.object.as_ref()))
        .collect();
    // The number of a lamp's shade in the frame is its light's, from 2; 1 is everything else.
    let mut pieces: Vec<(usize, u32, Mesh)> = Vec::new();
    for (k, placed) in placed.iter().enumerate() {
        let Some(mesh) = state.mesh_of(&placed.item.id) else { continue };
        let light = owners.iter().position(|owner| *owner == Some(k));
        let number = |m: usize| {
            light.filter(|_| mesh.materials.get(m).is_some_and(is_shade)).map_or(1, |light| light as u32 + 2)
        };
        pieces.extend(numbered(mesh, number).into_iter().map(|(n, mesh)| (k, n, mesh)));
    }
    if pieces.iter().all(|(_, number, _)| *number == 1) {
        return;
    }
    let shell = views::shell(state, Vec::new());
    let posed = pieces.iter().map(|(k, number, mesh)| Instance::posed(mesh, &placed[*k].pose, *number));
    let instances: Vec<Instance<'_>> = std::iter::once(Instance::in_room(&shell, 1)).chain(posed).collect();
    let options = RenderOptions { lighting: Look::Unlit, glass: Glass::Solid, ..RenderOptions::default() };
    let ids = render_depth_ids(&state.partial.camera, &instances, &options).ids;
    for (i, (light, owner)) in lights.iter_mut().zip(&owners).enumerate() {
        let mask = owner.and_then(|k| Some(&state.objects.get(&placed[k].item.id)?.mask));
        let Some(mask) = mask else { continue };
        let (mut sum, mut n) = ([0.0; 3], 0.0);
        for ((pixel, id), seen) in state.photo.pixels().zip(&ids).zip(mask.bits()) {
            if *seen && *id == i as u32 + 2 {
                sum.iter_mut().zip(linear_from_rgb8(pixel.0)).for_each(|(s, v)| *s += f64::from(v));
                n += 1.0;
            }
        }
        if n >= FEWEST * ids.len() as f64 {
            light.shade = Some(sum.map(|s| s / n));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;
    use harmony_imaging::color::linear_from_srgb;
    use harmony_lighting::{Emitter, lights_from_scene};
    use harmony_mesh::Material;
    use harmony_scene::{Level, Support};
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::testing::{add, empty_room};

    #[test]
    fn a_shade_is_as_bright_as_in_the_photo_and_only_where_there_is_one() {
        let mut state = empty_room();
        let (w, h) = state.photo.dimensions();
        let size = DVec3::new(0.3, 0.5, 0.3);
        let lamp = add(&mut state, "table_lamp_01", Level::Decoration, size, DVec3::new(1.2, 0.0, 2.0), Support::Floor);
        let bare = add(&mut state, "table_lamp_02", Level::Decoration, size, DVec3::new(2.8, 0.0, 2.0), Support::Floor);
        let model = state.objects.get_mut(&lamp).unwrap().model.as_mut().unwrap();
        let mut mesh = Mesh::clone(&model.mesh);
        // One that a program lets emit is seen as the photo has it, too.
        let emissive = [0.9, 0.8, 0.6];
        mesh.materials[0] = Material { name: "linen shade".to_owned(), emissive, ..mesh.materials[0].clone() };
        model.mesh = Arc::new(mesh);
        let mask = Arc::clone(&state.objects[&lamp].mask);
        state.photo = Arc::new(RgbImage::from_fn(w, h, |x, y| {
            Rgb(if mask.bits()[(y * w + x) as usize] { [200, 150, 100] } else { [30; 3] })
        }));
        let objects = crate::outputs::scene_objects(&state);
        let mut lights = lights_from_scene(&state.partial.room, &objects, |_| Emitter::default()).lights;
        measure(&state, &mut lights);
        let of = |id: &harmony_scene::ObjectId| lights.iter().find(|l| l.object.as_ref() == Some(id)).unwrap().shade;
        let shade = of(&lamp).unwrap();
        for (seen, byte) in shade.into_iter().zip([200.0, 150.0, 100.0]) {
            assert!((seen - f64::from(linear_from_srgb(byte / 255.0))).abs() < 1e-3, "{shade:?}");
        }
        assert_eq!(of(&bare), None, "nothing of it is called a shade");
        for light in &mut lights {
            (light.on, light.shade) = (false, None);
        }
        measure(&state, &mut lights);
        assert_eq!(lights.iter().filter(|light| light.shade.is_some()).count(), 0, "what is off does not shine");
    }
}
