//! The joined room: its size and openings, and the textures of its faces from the photos that see each place best.
//!
//! Key `join.surfaces` of `docs/paper-map.md`.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec2, DVec3};
use harmony_imaging::color::{linear_from_rgb8, srgb_from_linear};
use harmony_mesh::{Trim, Trims};
use harmony_scene::{Opening, Room, Surface};
use image::RgbaImage;
use rayon::prelude::*;
use serde_json::Value;

use crate::merge::Thing;
use crate::solve::Joint;
use crate::source::Source;

/// Longest side of a face's texture, texels, and the finest grain, texels a metre.
const LONGEST_PX: f64 = 1536.0;
const FINEST: f64 = 250.0;
/// How sharply one photo's texels give way to another's: their weights are powers of how well each sees a place.
const SHARPNESS: i32 = 8;
/// Texels that two photos show by which their exposures are compared, at least.
const COMMON_TEXELS: usize = 400;
/// Largest factor between two photos' exposures that is believed.
const MOST_GAIN: f32 = 3.0;

/// The room with the openings that its windows and doors cut.
pub fn room(sources: &[Source], joint: &Joint, things: &[Thing]) -> Room {
    let first = &sources[0].scene.room;
    let mut room = first.clone();
    room.shape.fitted(&first.extents, &joint.extents, 0.0);
    room.extents = joint.extents;
    room.seen = Surface::ALL
        .into_iter()
        .filter(|s| {
            sources.iter().zip(&joint.placings).any(|(run, placing)| run.saw(placing.turn.inverse().surface(*s)))
        })
        .collect();
    room.openings = things.iter().filter_map(|t| opening(sources, joint, t)).collect();
    room
}

/// The opening of a window or door as its best run has it, moved to where the thing is.
fn opening(sources: &[Source], joint: &Joint, t: &Thing) -> Option<Opening> {
    let (run, at) = t.from;
    let (source, placing) = (&sources[run], &joint.placings[run]);
    let own = &source.objects[at];
    let found = source.scene.room.openings.iter().find(|o| o.object.as_ref() == Some(&own.object.id))?;
    let wall = placing.turn.wall(found.wall);
    let by = t.object.size.as_vec() / own.object.size.as_vec().max(DVec3::splat(1e-3));
    let centre = wall.coordinates(t.object.pose.position);
    let along = |u: f64| u - found.wall.coordinates(own.place()).x;
    let half = (along(found.u[1]) - along(found.u[0])) / 2.0 * by.x;
    let length = wall.length(&joint.extents);
    let u = [(centre.x - half).max(0.02), (centre.x + half).min(length - 0.02)];
    let rise = |y: f64| centre.y + (y - own.place().y) * by.y;
    let y = if found.y[0] <= 0.0 { [0.0, rise(found.y[1])] } else { [rise(found.y[0]), rise(found.y[1])] };
    let y = [y[0].max(0.0), y[1].min(joint.extents.height - 0.02)];
    (u[1] - u[0] > 0.1 && y[1] - y[0] > 0.1).then(|| Opening {
        kind: found.kind,
        wall,
        u,
        y,
        inset: found.inset * placing.ln_scale.exp(),
        rise: found.rise * placing.ln_scale.exp(),
        object: Some(t.object.id.clone()),
    })
}

/// A run's pictures of its room's faces.
struct Faces {
    whole: BTreeMap<Surface, RgbaImage>,
    seen: BTreeMap<Surface, RgbaImage>,
}

impl Faces {
    fn read(source: &Source) -> Self {
        let read = |folder: &str| {
            let one = |s: Surface| {
                let path = source.folder.join("1_layout").join(folder).join(format!("{}.png", s.name()));
                Some((s, harmony_io::picture::read(&path).ok()?.into_rgba8()))
            };
            Surface::ALL.into_iter().filter_map(one).collect()
        };
        Self { whole: read("textures"), seen: read("textures/seen") }
    }
}

/// What a run says of a place on a face.
#[derive(Clone, Copy)]
struct Texel {
    /// Linear colour.
    color: [f32; 3],
    /// How well its photo shows it (solid angle of a square metre, more or less); 0 where it does not.
    sight: f64,
}

/// How each face was made.
#[derive(Debug, Clone, serde::Serialize)]
pub struct FaceReport {
    /// Which.
    pub surface: Surface,
    /// Share of its texels that some photo shows bare.
    pub seen: f64,
    /// The same by run.
    pub by_run: Vec<f64>,
}

/// The joined faces' textures and how they were made; faces of which no run has a picture are left out.
pub fn textures(sources: &[Source], joint: &Joint) -> (BTreeMap<Surface, Arc<RgbaImage>>, Vec<FaceReport>) {
    let faces: Vec<Faces> = sources.par_iter().map(Faces::read).collect();
    let read: Vec<Vec<Vec<Option<Texel>>>> = Surface::ALL
        .par_iter()
        .map(|surface| (0..sources.len()).map(|run| texels(&sources[run], &faces[run], joint, run, *surface)).collect())
        .collect();
    let gains = gains(&read, sources.len());
    let mut out = BTreeMap::new();
    let mut reports = Vec::new();
    for (surface, runs) in Surface::ALL.into_iter().zip(&read) {
        let size = grid(surface, joint);
        let texel_count = size[0] as usize * size[1] as usize;
        let shown = |run: &[Option<Texel>]| run.iter().flatten().filter(|t| t.sight > 0.0).count();
        let by_run: Vec<f64> = runs.iter().map(|r| shown(r) as f64 / texel_count as f64).collect();
        if runs.iter().all(|r| r.iter().all(Option::is_none)) {
            continue;
        }
        // Where nobody sees the face, whoever sees most of it says how it goes on; the first of equals.
        let fallback = (0..runs.len()).rev().max_by(|a, b| by_run[*a].total_cmp(&by_run[*b])).unwrap_or(0);
        let mut seen = 0;
        let image = RgbaImage::from_fn(size[0], size[1], |x, y| {
            let at = (y * size[0] + x) as usize;
            let here = |run: usize| runs[run][at].map(|t| (t, gains[run]));
            let best = (0..runs.len()).filter_map(|r| Some(here(r)?.0.sight)).fold(0.0, f64::max);
            seen += usize::from(best > 0.0);
            let mut sum = [0.0_f32; 3];
            let mut weights = 0.0_f32;
            for run in 0..runs.len() {
                let Some((texel, gain)) = here(run) else { continue };
                let weight = if best > 0.0 {
                    (texel.sight / best).powi(SHARPNESS) as f32
                } else {
                    f32::from(u8::from(run == fallback || runs[fallback][at].is_none()))
                };
                weights += weight;
                (0..3).for_each(|c| sum[c] += weight * texel.color[c] * gain[c]);
            }
            let color = sum.map(|v| (srgb_from_linear(v / weights.max(1e-6)) * 255.0).round() as u8);
            image::Rgba([color[0], color[1], color[2], 255])
        });
        reports.push(FaceReport { surface, seen: f64::from(seen as u32) / texel_count as f64, by_run });
        out.insert(surface, Arc::new(image));
    }
    (out, reports)
}

/// Texels of a face, along u and v.
fn grid(surface: Surface, joint: &Joint) -> [u32; 2] {
    let size = surface.size(&joint.extents);
    let grain = FINEST.min(LONGEST_PX / joint.extents.as_vec().max_element().max(0.1));
    [size.x, size.y].map(|m| ((m * grain).round() as u32).max(2))
}

/// A face as a run has it, on the joined face's grid.
fn texels(source: &Source, faces: &Faces, joint: &Joint, run: usize, surface: Surface) -> Vec<Option<Texel>> {
    let placing = &joint.placings[run];
    let own = placing.turn.inverse().surface(surface);
    let [width, height] = grid(surface, joint);
    let Some(whole) = faces.whole.get(&own) else { return vec![None; width as usize * height as usize] };
    let seen = faces.seen.get(&own);
    let back = placing.inverse();
    let (extents, eye) = (&source.scene.room.extents, source.camera.centre());
    let size = surface.size(&joint.extents);
    let walls = surface.wall().is_some();
    let mut out = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height {
        for x in 0..width {
            let (s, t) = ((f64::from(x) + 0.5) / f64::from(width), (f64::from(y) + 0.5) / f64::from(height));
            let uv = DVec2::new(s, if walls { 1.0 - t } else { t }) * size;
            let place = back.point(surface.point(&joint.extents, uv));
            let at = own.coordinates(place) / own.size(extents);
            let at = DVec2::new(at.x, if walls { 1.0 - at.y } else { at.y }).clamp(DVec2::ZERO, DVec2::splat(0.9999));
            let pixel = |image: &RgbaImage| {
                let (w, h) = image.dimensions();
                image.get_pixel((at.x * f64::from(w)) as u32, (at.y * f64::from(h)) as u32).0
            };
            let [r, g, b, _] = pixel(whole);
            let bare = seen.is_some_and(|image| pixel(image)[3] > 127);
            let way = place - eye;
            let facing = (-way.dot(own.normal())).max(0.0);
            let sight = if bare { facing / way.length().max(0.3).powi(3) } else { 0.0 };
            out.push(Some(Texel { color: linear_from_rgb8([r, g, b]), sight }));
        }
    }
    out
}

/// Factors by channel that bring each run's colours to the first one's, from places that two photos show.
fn gains(read: &[Vec<Vec<Option<Texel>>>], runs: usize) -> Vec<[f32; 3]> {
    let mut gains: Vec<Option<[f32; 3]>> = vec![None; runs];
    gains[0] = Some([1.0; 3]);
    loop {
        let mut best: Option<(usize, usize, [f32; 3])> = None;
        for run in (0..runs).filter(|r| gains[*r].is_none()) {
            for (known, gain) in gains.iter().enumerate().filter_map(|(k, g)| Some((k, (*g)?))) {
                if let Some((count, ratio)) = ratio(read, known, run)
                    && best.is_none_or(|b| count > b.1)
                {
                    best = Some((run, count, [0, 1, 2].map(|c| gain[c] * ratio[c])));
                }
            }
        }
        let Some((run, _, gain)) = best else { break };
        gains[run] = Some(gain.map(|g| g.clamp(1.0 / MOST_GAIN, MOST_GAIN)));
    }
    gains.into_iter().map(|g| g.unwrap_or([1.0; 3])).collect()
}

/// Median ratio of two runs' colours where both photos show a place, and how many such places there are.
fn ratio(read: &[Vec<Vec<Option<Texel>>>], known: usize, run: usize) -> Option<(usize, [f32; 3])> {
    let mut ratios: [Vec<f32>; 3] = Default::default();
    for face in read {
        for (a, b) in face[known].iter().zip(&face[run]) {
            if let (Some(a), Some(b)) = (a, b)
                && a.sight > 0.0
                && b.sight > 0.0
            {
                (0..3).for_each(|c| ratios[c].push(a.color[c].max(0.01) / b.color[c].max(0.01)));
            }
        }
    }
    let count = ratios[0].len();
    if count < COMMON_TEXELS {
        return None;
    }
    Some((count, ratios.map(|mut r| *r.select_nth_unstable_by(count / 2, f32::total_cmp).1)))
}

/// The boards along the walls, as the first run that has any says.
pub fn trims(sources: &[Source], joint: &Joint) -> Trims {
    let board = |v: &Value, scale: f64| {
        let color = v["linear_color"].as_array()?;
        let channel = |i: usize| color.get(i).and_then(Value::as_f64).map(|c| c as f32);
        Some(Trim {
            height: v["height_m"].as_f64()? * scale,
            depth: v["depth_m"].as_f64()? * scale,
            color: [channel(0)?, channel(1)?, channel(2)?],
        })
    };
    let of = |run: usize| {
        let file: Value = harmony_io::read_json(&sources[run].folder.join("1_layout/surfaces.json")).ok()?;
        let scale = joint.placings[run].ln_scale.exp();
        let [skirting, cornice, casing] = ["skirting", "cornice", "casing"].map(|name| board(&file[name], scale));
        (skirting.is_some() || cornice.is_some() || casing.is_some()).then_some(Trims { skirting, cornice, casing })
    };
    (0..sources.len()).find_map(of).unwrap_or_default()
}
