//! The joined room: its size and openings, and the textures of its faces from the photos that see each place best.
//!
//! Key `join.surfaces` of `docs/paper-map.md`.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec2, DVec3};
use harmony_imaging::color::{linear_from_rgb8, srgb_from_linear};
use harmony_mesh::{Trim, Trims};
use harmony_pipeline::Beyond;
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
/// Side of the cells in which the light of two photos on one face is compared, metres.
const LIGHT_CELL_M: f64 = 0.25;
/// Largest factor between two photos' exposures that is believed.
const MAX_GAIN: f32 = 3.0;

/// The room with the openings that its windows and doors cut and the passages that its runs have, and what is seen through
/// these.
pub fn room(sources: &[Source], joint: &Joint, things: &[Thing]) -> (Room, Vec<Beyond>) {
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
    let mut panes = Vec::new();
    let mut found: Vec<Passage> = (0..sources.len()).flat_map(|run| passages(sources, joint, run)).collect();
    // What is seen through it counts before how large it is seen.
    found.sort_by(|a, b| b.picture.is_some().cmp(&a.picture.is_some()).then(b.sight.total_cmp(&a.sight)));
    for Passage { opening, picture, .. } in found {
        if room.openings.iter().any(|other| in_one_place(other, &opening)) {
            continue;
        }
        panes.extend(picture.map(|picture| Beyond { opening: opening.clone(), picture }));
        room.openings.push(opening);
    }
    (room, panes)
}

/// A passage of a run in the joined room.
struct Passage {
    opening: Opening,
    picture: Option<Arc<RgbaImage>>,
    /// How large the run's photo shows it (solid angle, more or less).
    sight: f64,
}

fn passages(sources: &[Source], joint: &Joint, run: usize) -> Vec<Passage> {
    let (source, placing) = (&sources[run], &joint.placings[run]);
    let (e, scale) = (&source.scene.room.extents, placing.ln_scale.exp());
    let moved = |(found, picture): &(Opening, Option<Arc<RgbaImage>>)| {
        let wall = placing.turn.wall(found.wall);
        let along = |u: f64| wall.coordinates(placing.point(found.wall.point(e, u, 0.0))).x;
        let ends = found.u.map(along);
        let mirrored = ends[0] > ends[1];
        let length = wall.length(&joint.extents);
        let u = [ends[0].min(ends[1]).max(0.02), ends[0].max(ends[1]).min(length - 0.02)];
        let y = [(found.y[0] * scale).max(0.0), (found.y[1] * scale).min(joint.extents.height - 0.02)];
        let way = found.wall.point(e, f64::midpoint(found.u[0], found.u[1]), f64::midpoint(found.y[0], found.y[1]))
            - source.camera.centre();
        let facing = (-way.dot(found.wall.normal())).max(0.0);
        let sight = (u[1] - u[0]) * (y[1] - y[0]) * facing / way.length().max(0.3).powi(3);
        let turned = |image: &Arc<RgbaImage>| {
            if mirrored { Arc::new(image::imageops::flip_horizontal(&**image)) } else { Arc::clone(image) }
        };
        (u[1] - u[0] > 0.1 && y[1] - y[0] > 0.1).then(|| Passage {
            opening: Opening { wall, u, y, inset: found.inset * scale, rise: found.rise * scale, ..found.clone() },
            picture: picture.as_ref().map(turned),
            sight,
        })
    };
    source.passages.iter().filter_map(moved).collect()
}

/// Whether two openings are in one wall and share a good part of the smaller one.
fn in_one_place(a: &Opening, b: &Opening) -> bool {
    let shared = |p: [f64; 2], q: [f64; 2]| {
        let both = (p[1].min(q[1]) - p[0].max(q[0])).max(0.0);
        both / (p[1] - p[0]).min(q[1] - q[0]).max(1e-6)
    };
    a.wall == b.wall && shared(a.u, b.u) * shared(a.y, b.y) > 0.2
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
        // Whoever sees most of it gives the face its light, the first of equals: the others' is brought to it.
        let base = (0..runs.len()).rev().max_by(|a, b| by_run[*a].total_cmp(&by_run[*b])).unwrap_or(0);
        let lights: Vec<Option<LightField>> = (0..runs.len())
            .map(|run| {
                (run != base).then(|| {
                    LightField::new(
                        &runs[base],
                        &runs[run],
                        [gains[base], gains[run]],
                        size,
                        surface.size(&joint.extents),
                    )
                })?
            })
            .collect();
        // Where nobody sees the face it goes on as in the runs whose seen part is near.
        let away: Vec<Vec<f32>> = runs.iter().map(|run| to_seen(run, size)).collect();
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
                    (1.0 + away[run][at]).powi(-SHARPNESS / 2)
                };
                weights += weight;
                let light = lights[run].as_ref().map_or([1.0; 3], |field| field.at(x, y));
                (0..3).for_each(|c| sum[c] += weight * texel.color[c] * gain[c] * light[c]);
            }
            let color = sum.map(|v| (srgb_from_linear(v / weights.max(f32::MIN_POSITIVE)) * 255.0).round() as u8);
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

/// How far each texel is from the nearest one that a run's photo shows, texels, by steps to the eight neighbours; where it
/// shows none, farther than any.
fn to_seen(run: &[Option<Texel>], grid: [u32; 2]) -> Vec<f32> {
    let [width, height] = grid.map(|n| n as usize);
    let farthest = (width + height) as f32 * 2.0;
    let mut away: Vec<f32> =
        run.iter().map(|t| if t.is_some_and(|t| t.sight > 0.0) { 0.0 } else { farthest }).collect();
    let mut step = |x: usize, y: usize, neighbours: [(i64, i64, f32); 4]| {
        for (dx, dy, length) in neighbours {
            let (x0, y0) = (x as i64 + dx, y as i64 + dy);
            if (0..width as i64).contains(&x0) && (0..height as i64).contains(&y0) {
                let there = away[y0 as usize * width + x0 as usize] + length;
                let here = &mut away[y * width + x];
                *here = here.min(there);
            }
        }
    };
    let diagonal = std::f32::consts::SQRT_2;
    for y in 0..height {
        for x in 0..width {
            step(x, y, [(-1, 0, 1.0), (0, -1, 1.0), (-1, -1, diagonal), (1, -1, diagonal)]);
        }
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            step(x, y, [(1, 0, 1.0), (0, 1, 1.0), (1, 1, diagonal), (-1, 1, diagonal)]);
        }
    }
    away
}

/// Factors that bring one run's colours on a face to another one's, smooth over the face: two photos show one wall in
/// different light, and where one gives way to the other an edge would show.
struct LightField {
    /// Logarithms by cell.
    cells: Vec<[f32; 3]>,
    columns: usize,
    rows: usize,
    /// Texels a cell.
    side: [f32; 2],
}

impl LightField {
    /// From texels that both photos show; `None` where these are too few. `grid` in texels, `size` in metres.
    fn new(
        base: &[Option<Texel>],
        own: &[Option<Texel>],
        gains: [[f32; 3]; 2],
        grid: [u32; 2],
        size: DVec2,
    ) -> Option<Self> {
        let [columns, rows] = [size.x, size.y].map(|m| (m / LIGHT_CELL_M).ceil().max(1.0) as usize);
        let side = [grid[0] as f32 / columns as f32, grid[1] as f32 / rows as f32];
        let mut sums = vec![([0.0_f64; 3], 0.0_f64); columns * rows];
        let mut common = 0;
        for (k, (a, b)) in base.iter().zip(own).enumerate() {
            let (Some(a), Some(b)) = (a, b) else { continue };
            if a.sight <= 0.0 || b.sight <= 0.0 {
                continue;
            }
            common += 1;
            let (x, y) = (k % grid[0] as usize, k / grid[0] as usize);
            let cell = ((x as f32 / side[0]) as usize).min(columns - 1)
                + ((y as f32 / side[1]) as usize).min(rows - 1) * columns;
            let logs = [0, 1, 2].map(|c| {
                let ratio = (a.color[c] * gains[0][c]).max(0.01) / (b.color[c] * gains[1][c]).max(0.01);
                f64::from(ratio.clamp(1.0 / MAX_GAIN, MAX_GAIN).ln())
            });
            (0..3).for_each(|c| sums[cell].0[c] += logs[c]);
            sums[cell].1 += 1.0;
        }
        if common < COMMON_TEXELS {
            return None;
        }
        // Each cell takes the mean of all, the nearer ones more.
        let known: Vec<(usize, &([f64; 3], f64))> = sums.iter().enumerate().filter(|(_, s)| s.1 > 0.0).collect();
        let cells = (0..columns * rows).map(|cell| {
            let (mut sum, mut weights) = ([0.0; 3], 0.0);
            for (other, (logs, count)) in &known {
                let (dx, dy) = ((cell % columns).abs_diff(other % columns), (cell / columns).abs_diff(other / columns));
                let near = 1.0 / (1.0 + (dx * dx + dy * dy) as f64).powi(2);
                (0..3).for_each(|c| sum[c] += near * logs[c]);
                weights += near * count;
            }
            sum.map(|v| (v / weights) as f32)
        });
        Some(Self { cells: cells.collect(), columns, rows, side })
    }

    /// Factors at a texel, linear between the cells' middles.
    fn at(&self, x: u32, y: u32) -> [f32; 3] {
        let place = |v: u32, side: f32, count: usize| {
            let at = ((v as f32 + 0.5) / side - 0.5).clamp(0.0, (count - 1) as f32);
            let low = (at as usize).min(count.saturating_sub(2));
            (low, (low + 1).min(count - 1), at - low as f32)
        };
        let (x0, x1, s) = place(x, self.side[0], self.columns);
        let (y0, y1, t) = place(y, self.side[1], self.rows);
        let cell = |x: usize, y: usize| self.cells[x + y * self.columns];
        let (a, b, c, d) = (cell(x0, y0), cell(x1, y0), cell(x0, y1), cell(x1, y1));
        [0, 1, 2].map(|k| ((1.0 - t) * ((1.0 - s) * a[k] + s * b[k]) + t * ((1.0 - s) * c[k] + s * d[k])).exp())
    }
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
        gains[run] = Some(gain.map(|g| g.clamp(1.0 / MAX_GAIN, MAX_GAIN)));
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

#[cfg(test)]
mod tests {
    use harmony_scene::{OpeningKind, QuarterTurn, Wall};

    use super::*;
    use crate::placing::Placing;
    use crate::testing::{ROOM, furnished, source};

    /// A face of which only columns before `until` are shown, all of one grey.
    fn face(grid: [u32; 2], shown: std::ops::Range<u32>, grey: f32) -> Vec<Option<Texel>> {
        let texel = |k: u32| Texel { color: [grey; 3], sight: if shown.contains(&(k % grid[0])) { 1.0 } else { 0.0 } };
        (0..grid[0] * grid[1]).map(|k| Some(texel(k))).collect()
    }

    #[test]
    fn the_nearest_shown_texel_is_found_around_corners() {
        let away = to_seen(&face([20, 10], 0..3, 0.5), [20, 10]);
        assert_eq!(away[5 * 20 + 2], 0.0);
        assert_eq!(away[5 * 20 + 12], 10.0);
        assert!(to_seen(&face([20, 10], 0..0, 0.5), [20, 10]).iter().all(|d| *d > 30.0));
    }

    #[test]
    fn a_passage_of_two_runs_is_there_once_with_what_is_seen_through_it_the_right_way_round() {
        let picture = RgbaImage::from_fn(4, 4, |x, _| image::Rgba([if x < 2 { 90 } else { 200 }, 0, 0, 255]));
        let passage =
            |wall, u| Opening { kind: OpeningKind::Door, wall, u, y: [0.0, 2.0], inset: 0.0, rise: 0.0, object: None };
        // One room, the second photo from the other side: the way in the front wall is in its back wall.
        let things = furnished();
        let mut first = source("a", ROOM, &things, QuarterTurn::ALL[0], 1.0, &[]);
        let mut second = source("b", ROOM, &things, QuarterTurn::ALL[2], 1.0, &[]);
        let (w, d) = (ROOM.width, ROOM.depth);
        first.passages = vec![(passage(Wall::Front, [0.5, 1.4]), None)];
        second.passages = vec![(passage(Wall::Back, [w - 1.4, w - 0.5]), Some(Arc::new(picture)))];
        let turned = Placing { turn: QuarterTurn::ALL[2], yaw: 0.0, ln_scale: 0.0, x: w, z: d };
        let joint = Joint {
            placings: vec![Placing::FIRST, turned],
            extents: ROOM,
            places: vec![],
            sigmas: vec![],
            energy: 0.0,
        };
        let (room, panes) = room(&[first, second], &joint, &[]);
        let [opening] = room.openings.as_slice() else { panic!("{:?}", room.openings) };
        assert_eq!(opening.wall, Wall::Front);
        assert!((opening.u[0] - 0.5).abs() < 1e-9 && (opening.u[1] - 1.4).abs() < 1e-9, "{opening:?}");
        // The first photo shows nothing through it; the second's left is the first's right.
        assert_eq!(panes.len(), 1);
        assert_eq!([panes[0].picture.get_pixel(0, 0).0[0], panes[0].picture.get_pixel(3, 0).0[0]], [200, 90]);
    }

    #[test]
    fn light_of_two_photos_is_brought_together_where_both_show_a_face_and_beyond() {
        let grid = [80, 40];
        let (base, own) = (face(grid, 0..50, 0.6), face(grid, 20..80, 0.3));
        let field = LightField::new(&base, &own, [[1.0; 3]; 2], grid, DVec2::new(4.0, 2.0)).unwrap();
        for x in [0, 30, 79] {
            assert!(field.at(x, 20).iter().all(|f| (f - 2.0).abs() < 1e-3), "{:?}", field.at(x, 20));
        }
        // Nothing in common says nothing.
        let apart = face(grid, 60..80, 0.3);
        assert!(LightField::new(&base, &apart, [[1.0; 3]; 2], grid, DVec2::new(4.0, 2.0)).is_none());
    }
}
