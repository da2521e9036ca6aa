//! Delighting: base colours that hold the photo's light become reflectances, so that reflectance times light is the
//! photo again.
//!
//! What a lit render shows of a surface is its base colour times the light there. The ratio of photo to render, smooth
//! within each node, is what the base colour has too much or too little of: the light that was already in the texture,
//! and whatever the estimated light lacks. Multiplying it in (Barrow and Tenenbaum's intrinsic images, with the light
//! known from a path tracer instead of unknown) makes the lit picture match without touching texture detail.
//! Two passes at two widths; light that bounces changes with the reflectances, so that it is done again on a new render.
//! What materials have of one another is in `levels`.

mod levels;

use std::collections::BTreeMap;

use harmony_scene::{AlbedoCells, AlbedoField, Camera, SceneCamera};

use self::levels::Found;
use crate::LinearImage;
use crate::linear::luminance;
use crate::smooth::{interior, smoothed};
use crate::view::{median, quantile};

/// Cells of a field across the frame.
pub const COLUMNS: u32 = 48;
/// Widths of the smoothing, shares of the image width.
const SIGMAS: [f64; 2] = [0.06, 0.02];
/// The same where the texture comes without the photo's light: what is left is light that the fit lacks, and an outline of
/// it on the floor would be seen from above.
const EVEN_SIGMAS: [f64; 2] = [0.12, 0.06];
/// Largest factor of a field, and its inverse the smallest, stops.
const MAX_STOPS: f32 = 2.5;
/// A channel this near to the smallest factor, stops, wants less than the surface's gloss gives; so much of it is left
/// by each update.
const NEAR_LEAST: f32 = 0.4;
const LESS_GLOSS: f32 = 0.3;
/// Largest change of one update within a node, against its mean, stops; the second where the texture comes without the
/// photo's light.
const MAX_STEP: [f32; 2] = [1.5, 0.7];
/// Largest difference of a channel from the others within a node, against its mean, stops: light that changes its hue
/// over a surface by more is another thing's colour.
const MAX_HUE: f32 = 0.2;
/// Largest difference of a channel from the others in what a colour that was said is off, stops: what wants more is the wall
/// behind it, seen between its leaves.
const MAX_SAID_HUE: f32 = 0.3;
/// Light that lens and sensor may add anywhere in a photo, as the view takes it: what is not much brighter has no hue to
/// be learned from. Dark wood under a bluish veil came out violet once it was lit.
const VEIL: f32 = 0.02;
/// Light below which ratios are noise.
const DARK: f32 = 0.004;
/// A node has an own factor from so many counted pixels, and from such a share of those that show it: where the photo's
/// mask leaves most of it out, what is left is the edge of something else.
const MIN_PIXELS: usize = 12;
const MIN_SHARE: f64 = 0.3;
/// Mean change of the reflectances, stops, from which a render tells how the room's light goes with them; and the largest
/// such response that is believed.
const TELLING_CHANGE: f32 = 0.1;
const MAX_RESPONSE: f32 = 3.0;
/// Which of a glossy thing's ratios, in order, is that of its colour: highlights are above, by which leather was as pale as the
/// window that it mirrors; and how far its hue may be from what was said, stops, for what it mirrors has another.
const DULL: f64 = 0.3;
const MAX_GLOSSY_HUE: f32 = 0.12;
/// A node of the scene as the field sees it, or one material of a node: a bed's wood and its cover have nothing in common.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldNode {
    /// Name in the GLB, `node/material` for one material of it.
    pub name: String,
    /// What unseen nodes learn from: the nodes of the same kind (walls from walls, objects from objects).
    pub kind: &'static str,
    /// Whether its texture is one under even light, rather than the photo's.
    pub is_even: bool,
    /// The paint that was said of it, in whatever words: nodes of one paint have one reflectance.
    pub paint: Option<String>,
    /// Whether it shines, and its colour was said: what the photo has brighter on it is what it mirrors, not its colour.
    pub is_glossy: bool,
}

impl FieldNode {
    /// A node whose texture holds the photo's light.
    pub fn new(name: &str, kind: &'static str) -> Self {
        Self { name: name.to_owned(), kind, is_even: false, paint: None, is_glossy: false }
    }

    /// One material of a node.
    pub fn part(node: &str, material: &str, kind: &'static str) -> Self {
        Self::new(&format!("{node}/{material}"), kind)
    }

    /// The material, where the node is one of several of a thing.
    pub fn material(&self) -> Option<&str> {
        self.name.split_once('/').map(|(_, material)| material)
    }

    /// What has the same paint: by its own words, else the same material of things of its label.
    fn twins(&self) -> (&str, Option<&str>) {
        self.paint.as_deref().map_or_else(|| (self.design(), self.material()), |paint| (paint, None))
    }

    /// See [`design_of`].
    fn design(&self) -> &str {
        design_of(self.node())
    }

    /// The node's name in the GLB.
    pub fn node(&self) -> &str {
        self.name.split_once('/').map_or(&self.name, |(node, _)| node)
    }
}

/// What a thing shares with others of its label: its name without its number.
pub fn design_of(node: &str) -> &str {
    node.trim_end_matches(|c: char| c.is_ascii_digit())
}

/// A render in the photo's frame beside the photo; both light as the view takes it (after exposure), one value a pixel.
#[derive(Debug, Clone, Copy)]
pub struct Comparison<'a> {
    /// The photo's light.
    pub photo: &'a LinearImage,
    /// The render's.
    pub render: &'a LinearImage,
    /// Per pixel the node that is seen, 1 for the first of the list, 0 for none.
    pub ids: &'a [u32],
    /// How much a pixel counts; 0 where the scene is known to show something else than the photo.
    pub weights: &'a [f32],
}

/// A field that changes nothing.
pub fn neutral_field(camera: &Camera) -> AlbedoField {
    let rows = (COLUMNS * camera.size.height).div_ceil(camera.size.width.max(1)).max(1);
    AlbedoField { camera: SceneCamera::from(camera), columns: COLUMNS, rows, nodes: BTreeMap::new(), other: [1.0; 3] }
}

fn rounded(log: [f32; 3]) -> [f32; 3] {
    // All channels give way together: what is clipped alone has another hue.
    let over = (log.into_iter().fold(f32::MIN, f32::max) - MAX_STOPS).max(0.0);
    log.map(|v| ((v - over).clamp(-MAX_STOPS, MAX_STOPS).exp2() * 1000.0).round() / 1000.0)
}

/// By how much more than its reflectances a closed room changes, channel by channel: what is brighter lights the rest.
///
/// From the renders under two fields, in logarithms; `before` where the fields hardly differ in a channel.
pub fn bounce_response(
    before: [f32; 3],
    fields: [&AlbedoField; 2],
    renders: [&LinearImage; 2],
    nodes: &[FieldNode],
    (ids, weights): (&[u32], &[f32]),
) -> [f32; 3] {
    let mean_of = |field: &AlbedoField, node: &FieldNode| field.nodes.get(&node.name).map_or(field.other, |n| n.mean);
    let changes: Vec<[f32; 3]> = nodes
        .iter()
        .map(|node| {
            let [old, new] = fields.map(|field| mean_of(field, node));
            [0, 1, 2].map(|c| (new[c] / old[c]).log2())
        })
        .collect();
    let (mut asked, mut got) = ([0.0f32; 3], [0.0f32; 3]);
    let mut total = 0.0;
    for (i, id) in ids.iter().enumerate() {
        let Some(change) = (*id as usize).checked_sub(1).and_then(|node| changes.get(node)) else { continue };
        let weight = weights.get(i).copied().unwrap_or(1.0);
        total += weight;
        for c in 0..3 {
            let [old, new] = renders.map(|render| render.rgb[i][c] + DARK);
            asked[c] += weight * change[c];
            got[c] += weight * (new / old).log2().clamp(-4.0, 4.0);
        }
    }
    [0, 1, 2].map(|c| {
        let told = asked[c].abs() >= TELLING_CHANGE * total && total > 0.0;
        if told { (got[c] / asked[c]).clamp(1.0, MAX_RESPONSE) } else { before[c] }
    })
}

/// The field under which the scene would show the photo's light, from a render under `field`. What all surfaces want alike
/// is asked for by less, for the room's light changes with them: see [`bounce_response`], 1 where it is not known.
pub fn updated_field(
    field: &AlbedoField,
    nodes: &[FieldNode],
    seen: &Comparison<'_>,
    response: [f32; 3],
) -> AlbedoField {
    let size = seen.photo.size;
    let inside = interior(seen.ids, size);
    let ratio: Vec<[f32; 3]> = seen
        .photo
        .rgb
        .iter()
        .zip(&seen.render.rgb)
        .map(|(p, r)| [0, 1, 2].map(|c| ((p[c] + DARK) / (r[c] + DARK)).log2().clamp(-4.0, 4.0)))
        .collect();
    let mut next = AlbedoField { nodes: BTreeMap::new(), ..field.clone() };
    let mut found: Vec<Found<'_>> = Vec::new();
    let mut unseen = Vec::new();
    let mut wanted: Vec<Wanted<'_>> = Vec::new();
    for (index, node) in nodes.iter().enumerate() {
        let id = index as u32 + 1;
        let weights: Vec<f32> = (0..ratio.len())
            .map(|i| if seen.ids[i] == id && inside[i] { seen.weights.get(i).copied().unwrap_or(1.0) } else { 0.0 })
            .collect();
        let counted = weights.iter().filter(|w| **w > 0.0).count();
        let shown = (0..ratio.len()).filter(|i| seen.ids[*i] == id && inside[*i]).count();
        if counted < MIN_PIXELS || (counted as f64) < MIN_SHARE * shown as f64 {
            unseen.push(node);
            continue;
        }
        let middle = [0, 1, 2].map(|c| {
            let mut all: Vec<f64> =
                ratio.iter().zip(&weights).filter(|(_, w)| **w > 0.0).map(|(r, _)| f64::from(r[c])).collect();
            quantile(&mut all, if node.is_glossy { DULL } else { 0.5 }) as f32
        });
        wanted.push(Wanted { node, weights, counted, middle });
    }
    let all: f32 = wanted.iter().map(|w| w.counted as f32).sum();
    let common = [0, 1, 2].map(|c| wanted.iter().map(|w| w.counted as f32 * w.middle[c]).sum::<f32>() / all.max(1.0));
    for Wanted { node, weights, counted, middle: off } in wanted {
        let asked = [0, 1, 2].map(|c| off[c] - common[c] + common[c] / response[c]);
        let how = if node.is_even { (EVEN_SIGMAS, MAX_STEP[1]) } else { (SIGMAS, MAX_STEP[0]) };
        // Where it is brighter it mirrors something: no light that the fit lacks.
        let how = if node.is_glossy { (how.0, 0.0) } else { how };
        let step = local_step(&ratio, &weights, off, size, how);
        let before = field.nodes.get(&node.name);
        let old_mean = before.map_or(field.other, |b| b.mean).map(f32::log2);
        let mean = within_veil([0, 1, 2].map(|c| old_mean[c] + asked[c]), middle_light(seen.photo, &weights));
        let is_said = node.is_even && node.kind == "object";
        let most = if node.is_glossy { MAX_GLOSSY_HUE } else { MAX_SAID_HUE };
        let mean = if is_said { near_grey(mean, most) } else { mean };
        let factors = (0..field.rows * field.columns)
            .map(|cell| {
                let (x, y) = (cell % field.columns, cell / field.columns);
                let old = before.and_then(|b| b.factors.get(cell as usize)).map_or(old_mean, |f| f.map(f32::log2));
                let px = ((f64::from(x) + 0.5) / f64::from(field.columns) * f64::from(size.width)) as usize;
                let py = ((f64::from(y) + 0.5) / f64::from(field.rows) * f64::from(size.height)) as usize;
                let s = step[py.min(size.height as usize - 1) * size.width as usize + px.min(size.width as usize - 1)];
                rounded(with_hue_of(mean, [0, 1, 2].map(|c| old[c] + asked[c] + s[c])))
            })
            .collect();
        // What a blue wall needs by channel is no hint for a beige one: the others learn the level alone.
        let level = luminance(mean.map(f32::exp2)).log2();
        found.push(Found { node, pixels: counted, level, hue: mean.map(|m| m - level) });
        // What is too bright is so by both, colour and gloss: a black stove came out grey, its colour being dark already.
        let change = luminance(mean.map(f32::exp2)) / luminance(old_mean.map(f32::exp2));
        let gloss = (before.map_or(1.0, |b| b.gloss) * change).min(1.0);
        let too_glossy = mean.iter().any(|m| *m <= NEAR_LEAST - MAX_STOPS);
        let gloss = if too_glossy { gloss * LESS_GLOSS } else { gloss };
        next.nodes.insert(node.name.clone(), AlbedoCells { mean: rounded(mean), factors, gloss });
    }
    levels::hold_scraps(&mut next, &mut found, ratio.len());
    let mut threads = Vec::new();
    for (node, off, pixels) in levels::in_threads(nodes, &unseen, seen, &ratio) {
        let usual = luminance(common);
        let by = off - usual + usual / luminance(response);
        let before = field.nodes.get(&node.name);
        let old = luminance(before.map_or(field.other, |b| b.mean)).log2();
        let level = levels::near_others(old + by, &found);
        let gloss = (before.map_or(1.0, |b| b.gloss) * (level - old).exp2()).min(1.0);
        next.nodes.insert(node.name.clone(), AlbedoCells { mean: rounded([level; 3]), factors: Vec::new(), gloss });
        threads.push(Found { node, pixels, level, hue: [0.0; 3] });
    }
    found.append(&mut threads);
    unseen.retain(|n| !next.nodes.contains_key(&n.name));
    levels::keep_to_thing(&mut next, &mut found);
    levels::share_paint(&mut next, &found);
    next.other = rounded([levels::level_of(&found, |_| true).unwrap_or_else(|| luminance(field.other).log2()); 3]);
    for node in unseen {
        let level = levels::unseen_level(node, &found).map_or(next.other, |level| rounded([level; 3]));
        let gloss = luminance(level).min(1.0);
        next.nodes.insert(node.name.clone(), AlbedoCells { mean: level, factors: Vec::new(), gloss });
    }
    next
}

/// A node that was seen: what counts of it, and what the photo has more than the render, log2.
struct Wanted<'a> {
    node: &'a FieldNode,
    weights: Vec<f32>,
    counted: usize,
    middle: [f32; 3],
}

/// What a node's ratios have beside their middle, smooth.
fn local_step(
    ratio: &[[f32; 3]],
    weights: &[f32],
    middle: [f32; 3],
    size: harmony_scene::ImageSize,
    (sigmas, most): ([f64; 2], f32),
) -> Vec<[f32; 3]> {
    let mut rest: Vec<[f32; 3]> =
        ratio.iter().map(|r| [0, 1, 2].map(|c| (r[c] - middle[c]).clamp(-most, most))).collect();
    let mut step = vec![[0.0f32; 3]; ratio.len()];
    for sigma in sigmas {
        let smooth = smoothed(&rest, weights, size, (sigma * f64::from(size.width)).max(0.7));
        for ((s, r), add) in step.iter_mut().zip(&mut rest).zip(&smooth) {
            for c in 0..3 {
                s[c] += add[c];
                r[c] -= add[c];
            }
        }
    }
    step
}

/// Median luminance of what counts.
fn middle_light(photo: &LinearImage, weights: &[f32]) -> f32 {
    let own = photo.rgb.iter().zip(weights).filter(|(_, w)| **w > 0.0);
    median(&mut own.map(|(p, _)| f64::from(luminance(*p))).collect::<Vec<_>>()) as f32
}

/// A node's mean whose hue goes no farther than its light stands out of the veil.
fn within_veil(mean: [f32; 3], light: f32) -> [f32; 3] {
    near_grey(mean, (1.0 + light / VEIL).log2())
}

/// Factors, log2, whose channels differ from their level by so much at most.
fn near_grey(mean: [f32; 3], most: f32) -> [f32; 3] {
    let level = 0.2126 * mean[0] + 0.7152 * mean[1] + 0.0722 * mean[2];
    mean.map(|m| level + (m - level).clamp(-most, most))
}

/// A cell whose hue is its node's: however often a field is updated, a surface keeps one paint.
fn with_hue_of(mean: [f32; 3], cell: [f32; 3]) -> [f32; 3] {
    let off = [0, 1, 2].map(|c| cell[c] - mean[c]);
    let level = 0.2126 * off[0] + 0.7152 * off[1] + 0.0722 * off[2];
    [0, 1, 2].map(|c| mean[c] + level + (off[c] - level).clamp(-MAX_HUE, MAX_HUE))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_scene::{ImageSize, Intrinsics};

    use super::levels::{MIXED_STOPS, TWIN_STOPS};
    use super::*;

    const SIZE: ImageSize = ImageSize { width: 96, height: 72 };

    fn camera() -> Camera {
        Camera::looking(SIZE, Intrinsics::centred(SIZE, 80.0), DVec3::new(0.0, 1.5, 4.0), DVec3::NEG_Z)
    }

    /// Light on the wall: a lamp's pool on the left.
    fn shading(x: f32, y: f32) -> f32 {
        0.25 + 0.9 / (1.0 + ((x - 0.25) / 0.2).powi(2) + ((y - 0.4) / 0.3).powi(2))
    }

    fn image(f: impl Fn(f32, f32) -> [f32; 3]) -> LinearImage {
        let rgb = (0..SIZE.pixels()).map(|i| f((i % 96) as f32 / 96.0, (i / 96) as f32 / 72.0)).collect();
        LinearImage { size: SIZE, rgb }
    }

    /// A closed room whose light comes back: what is seen is its reflectance by one over what is not reflected.
    #[test]
    fn a_room_whose_walls_light_each_other_is_met_by_the_second_step_and_not_passed() {
        let ids: Vec<u32> = (0..SIZE.pixels()).map(|i| if i / 96 < 40 { 1 } else { 2 }).collect();
        let weights = vec![1.0; SIZE.pixels()];
        let nodes = &nodes()[..2];
        let base = [[0.65f32, 0.46, 0.3], [0.5, 0.35, 0.24]];
        let shown = |field: &AlbedoField| {
            let factor = |node: usize| field.nodes.get(&nodes[node].name).map_or(field.other, |n| n.mean);
            let of = |node: usize, c: usize| base[node][c] * factor(node)[c];
            let mean = |c: usize| 0.45 * of(0, c) + 0.55 * of(1, c);
            let rgb = ids.iter().map(|id| [0, 1, 2].map(|c| of(*id as usize - 1, c) * 0.5 / (1.0 - mean(c)))).collect();
            LinearImage { size: SIZE, rgb }
        };
        let photo =
            LinearImage { size: SIZE, rgb: ids.iter().map(|id| base[*id as usize - 1].map(|v| 0.6 * v)).collect() };
        let off = |render: &LinearImage| {
            let ratio = |i: usize, c: usize| (render.rgb[i][c] / photo.rgb[i][c]).log2().abs();
            (0..SIZE.pixels()).flat_map(|i| (0..3).map(move |c| (i, c))).map(|(i, c)| ratio(i, c)).fold(0.0, f32::max)
        };
        let step = |field: &AlbedoField, response: [f32; 3]| {
            let render = shown(field);
            let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
            (updated_field(field, nodes, &seen, response), render)
        };
        let neutral = neutral_field(&camera());
        let (first, as_it_was) = step(&neutral, [1.0; 3]);
        let render = shown(&first);
        let response = bounce_response([1.0; 3], [&neutral, &first], [&as_it_was, &render], nodes, (&ids, &weights));
        assert!(response[0] > response[2] && response[0] > 1.4, "{response:?}");
        let (met, _) = step(&first, response);
        let (passed, _) = step(&first, [1.0; 3]);
        assert!(off(&shown(&first)) > 0.3, "{}", off(&shown(&first)));
        assert!(off(&shown(&met)) < 0.3 * off(&shown(&passed)), "{} {}", off(&shown(&met)), off(&shown(&passed)));
        // Where nothing was changed nothing is learned.
        let same = bounce_response([1.5; 3], [&neutral, &neutral], [&render, &render], nodes, (&ids, &weights));
        assert_eq!(same, [1.5; 3]);
    }

    #[test]
    fn a_saturated_dark_cloth_loses_its_gloss_and_nothing_else_does() {
        let photo = image(|_, y| if y < 0.4 { [0.11, 0.001, 0.03] } else { [0.4; 3] });
        let render = image(|_, _| [0.25, 0.08, 0.1]);
        let ids: Vec<u32> = (0..SIZE.pixels()).map(|i| if i / 96 < 29 { 1 } else { 2 }).collect();
        let weights = vec![1.0; SIZE.pixels()];
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let once = updated_field(&neutral_field(&camera()), &nodes()[..2], &seen, [1.0; 3]);
        let twice = updated_field(&once, &nodes()[..2], &seen, [1.0; 3]);
        let gloss = |field: &AlbedoField, name: &str| field.nodes[name].gloss;
        assert!(gloss(&once, "back") < 0.5 && gloss(&twice, "back") < gloss(&once, "back"));
        assert!((gloss(&twice, "floor") - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_black_thing_loses_gloss_as_it_loses_colour_and_so_do_its_unseen_parts() {
        let photo = image(|_, y| if y < 0.4 { [0.006; 3] } else { [0.4; 3] });
        let render = image(|_, y| if y < 0.4 { [0.016; 3] } else { [0.2; 3] });
        let ids: Vec<u32> = (0..SIZE.pixels()).map(|i| if i / 96 < 29 { 1 } else { 2 }).collect();
        let weights = vec![1.0; SIZE.pixels()];
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let parts = [
            FieldNode::part("stove", "iron", "object"),
            FieldNode::new("floor", "floor"),
            FieldNode::part("stove", "knob", "object"),
        ];
        let field = updated_field(&neutral_field(&camera()), &parts, &seen, [1.0; 3]);
        // (0.006 + 0.004) / (0.016 + 0.004)
        for part in ["stove/iron", "stove/knob"] {
            let cells = &field.nodes[part];
            assert!((cells.mean[1] - 0.5).abs() < 0.01 && (cells.gloss - 0.5).abs() < 0.01, "{part} {cells:?}");
        }
        assert!(
            (field.nodes["floor"].gloss - 1.0).abs() < 1e-6,
            "what is too dark has no more gloss than it was given"
        );
    }

    #[test]
    fn a_patch_of_another_things_colour_does_not_dye_a_surface() {
        // A red cushion stands where the scene has sofa.
        let patch = |x: f32, y: f32| (0.3..0.5).contains(&x) && (0.3..0.6).contains(&y);
        let photo = image(|x, y| if patch(x, y) { [0.5, 0.03, 0.03] } else { [0.4, 0.4, 0.4] });
        let render = image(|_, _| [0.4, 0.4, 0.4]);
        let ids = vec![1; SIZE.pixels()];
        let weights = vec![1.0; SIZE.pixels()];
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let mut field = neutral_field(&camera());
        for _ in 0..3 {
            field = updated_field(&field, &nodes()[..1], &seen, [1.0; 3]);
        }
        for [r, g, b] in &field.nodes["back"].factors {
            let most = r.max(*g).max(*b) / r.min(*g).min(*b);
            assert!(most < 1.4, "updates do not add up to a dye: {r} {g} {b}");
        }
    }

    #[test]
    fn a_dark_thing_is_not_dyed_by_the_photos_veil_and_a_bright_one_may_have_any_hue() {
        // Cherry wood, drawn so; the photo has a bluish veil over it. The wall is blue where the scene has it grey.
        let photo = image(|_, y| if y < 0.4 { [0.014, 0.0075, 0.024] } else { [0.1, 0.2, 0.6] });
        let render = image(|_, y| if y < 0.4 { [0.045, 0.02, 0.012] } else { [0.2; 3] });
        let ids: Vec<u32> = (0..SIZE.pixels()).map(|i| if i / 96 < 29 { 1 } else { 2 }).collect();
        let weights = vec![1.0; SIZE.pixels()];
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let mut field = neutral_field(&camera());
        for _ in 0..3 {
            field = updated_field(&field, &nodes()[..2], &seen, [1.0; 3]);
        }
        let [r, g, b] = field.nodes["back"].mean;
        assert!(b * 0.012 < r * 0.045, "still more red than blue: {r} {g} {b}");
        let wall = updated_field(&neutral_field(&camera()), &nodes()[..2], &seen, [1.0; 3]).nodes["floor"].mean;
        assert!((wall[0] - 0.5).abs() < 0.02 && (wall[2] - 3.0).abs() < 0.1, "{wall:?}");
    }

    #[test]
    fn each_material_of_a_thing_has_its_own_factor_and_an_unseen_one_takes_its_neighbours() {
        let parts: Vec<FieldNode> = ["wood", "cover", "feet"].map(|m| FieldNode::part("bed_01", m, "object")).to_vec();
        let lamp = FieldNode::new("lamp_01", "object");
        // Above the wood, below the cover, which the render shows twice and eight times too bright; a lamp that is right.
        let photo = image(|_, _| [0.2, 0.01, 0.03]);
        let render = image(|_, y| if y < 0.4 { [0.2, 0.02, 0.06].map(|v| v + DARK) } else { [0.8, 0.1, 0.2] });
        let ids: Vec<u32> = (0..SIZE.pixels()).map(|i| if i / 96 < 29 { 1 } else { 2 }).collect();
        let weights = vec![1.0; SIZE.pixels()];
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let nodes = [parts[0].clone(), parts[1].clone(), parts[2].clone(), lamp];
        let field = updated_field(&neutral_field(&camera()), &nodes, &seen, [1.0; 3]);
        assert!((field.nodes["bed_01/wood"].mean[0] - 1.0).abs() < 0.1, "{:?}", field.nodes["bed_01/wood"].mean);
        assert!((field.nodes["bed_01/cover"].mean[0] - 0.25).abs() < 0.02, "{:?}", field.nodes["bed_01/cover"].mean);
        let [wood, cover, feet] = ["wood", "cover", "feet"].map(|m| field.nodes[&format!("bed_01/{m}")].mean[1]);
        assert!(cover < feet && feet < wood, "{cover} {feet} {wood}");
    }

    #[test]
    fn unseen_legs_are_like_those_of_a_twin_and_never_far_from_what_is_usual() {
        // Fur that the render has four times too dark, a twin's legs that are right, a table that is right.
        let names = [
            ("stool_01", "fur"),
            ("stool_02", "legs"),
            ("table_01", "top"),
            ("stool_01", "legs"),
            ("stool_01", "rail"),
        ];
        let nodes = names.map(|(node, material)| FieldNode::part(node, material, "object"));
        let row = |y: f32| ((y * 3.0) as usize).min(2);
        let photo = image(|_, _| [0.4; 3]);
        let render = image(|_, y| if row(y) == 0 { [0.1; 3] } else { [0.4; 3] });
        let ids: Vec<u32> = (0..SIZE.pixels()).map(|i| row((i / 96) as f32 / 72.0) as u32 + 1).collect();
        let weights = vec![1.0; SIZE.pixels()];
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let field = updated_field(&neutral_field(&camera()), &nodes, &seen, [1.0; 3]);
        let level = |name: &str| field.nodes[name].mean[1];
        assert!(level("stool_01/fur") > 3.5, "{}", level("stool_01/fur"));
        assert!((level("stool_01/legs") - 1.0).abs() < 0.05, "{}", level("stool_01/legs"));
        let usual = (level("stool_01/fur") * level("stool_02/legs") * level("table_01/top")).cbrt();
        let rail = level("stool_01/rail");
        assert!(rail > usual && rail < 1.7 * usual, "{rail} beside {usual}");
    }

    #[test]
    fn a_stripe_that_took_its_neighbours_colour_keeps_to_the_cloth() {
        let slot = |name: &str| FieldNode { is_even: true, ..FieldNode::part("curtain_01", name, "object") };
        let nodes = [slot("linen"), slot("stripe"), slot("hem")];
        // The hem is a twentieth of the cloth, and five times as light in the photo as it was said.
        let ids: Vec<u32> =
            (0..SIZE.pixels()).map(|i| if i % 96 < 5 { 3 } else { u32::from(i % 96 >= 50) + 1 }).collect();
        let light = |id: u32| if id == 3 { 1.0 } else { 0.2 };
        let photo = LinearImage { size: SIZE, rgb: ids.iter().map(|id| [light(*id); 3]).collect() };
        let render = LinearImage { size: SIZE, rgb: vec![[0.2; 3]; ids.len()] };
        let weights = vec![1.0; ids.len()];
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let field = updated_field(&neutral_field(&camera()), &nodes, &seen, [1.0; 3]);
        let level = |name: &str| luminance(field.nodes[name].mean).log2();
        let apart = level("curtain_01/hem") - level("curtain_01/linen");
        assert!((0.6..0.95).contains(&apart), "{apart}");
    }

    #[test]
    fn twins_have_one_hue_and_levels_near_to_one_another() {
        let even = |node: &str| FieldNode { is_even: true, ..FieldNode::part(node, "leather", "object") };
        let nodes =
            [even("chair_01"), even("chair_02"), FieldNode { is_even: true, ..FieldNode::new("table_01", "object") }];
        // The photo: the first chair with 0.7 of its red, the second one darker and of the hue that was said.
        let ids: Vec<u32> = (0..SIZE.pixels()).map(|i| (i % SIZE.width as usize / 32) as u32 + 1).collect();
        let of = |rgb: &[[f32; 3]; 3]| {
            let rgb = ids.iter().map(|id| rgb[*id as usize - 1]).collect();
            LinearImage { size: SIZE, rgb }
        };
        let photo = of(&[[0.28, 0.4, 0.4], [0.2, 0.2, 0.2], [0.1, 0.4, 0.4]]);
        let render = of(&[[0.4; 3]; 3]);
        let weights = vec![1.0; ids.len()];
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let field = updated_field(&neutral_field(&camera()), &nodes, &seen, [1.0; 3]);
        let mean = |name: &str| field.nodes[name].mean;
        let (a, b, table) = (mean("chair_01/leather"), mean("chair_02/leather"), mean("table_01"));
        let red = |m: [f32; 3]| m[0] / m[1];
        assert!((red(a) - red(b)).abs() < 0.02 && (red(a) - 0.7_f32.sqrt()).abs() < 0.03, "{a:?} {b:?}");
        // The photo has nearly twice the light on the first one.
        let apart = luminance(a) / luminance(b);
        assert!((apart.log2() - 2.0 * TWIN_STOPS).abs() < 0.02, "{a:?} {b:?}");
        // A quarter of its red is not what a table of a said colour lacks.
        assert!((0.64..0.69).contains(&red(table)), "{table:?}");
    }

    #[test]
    fn the_threads_of_a_rug_have_the_level_of_the_rug() {
        // Light and dark threads a pixel wide; the rug is half as bright in the photo.
        let ids: Vec<u32> = (0..SIZE.pixels()).map(|i| if i / 96 < 29 { 3 } else { 1 + (i as u32 % 96) % 2 }).collect();
        let of = |id: u32| if id == 1 { 0.5 } else { 0.1 };
        let render =
            LinearImage { size: SIZE, rgb: ids.iter().map(|id| [if *id == 3 { 0.4 } else { of(*id) }; 3]).collect() };
        let photo = LinearImage {
            size: SIZE,
            rgb: ids.iter().map(|id| [if *id == 3 { 0.4 } else { 0.5 * of(*id) }; 3]).collect(),
        };
        let weights = vec![1.0; ids.len()];
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let thread = |name: &str| FieldNode { is_even: true, ..FieldNode::part("rug_01", name, "object") };
        let nodes = [thread("light"), thread("dark"), FieldNode::new("floor", "floor")];
        let field = updated_field(&neutral_field(&camera()), &nodes, &seen, [1.0; 3]);
        for name in ["rug_01/light", "rug_01/dark"] {
            let level = luminance(field.nodes[name].mean).log2();
            assert!((level + 0.98).abs() < 0.05, "{name}: {level}");
        }
        // Beside a thing that is as bright as in the photo they are not believed all of it.
        let beside = [nodes[0].clone(), nodes[1].clone(), FieldNode::new("chair_01", "object")];
        let field = updated_field(&neutral_field(&camera()), &beside, &seen, [1.0; 3]);
        let level = luminance(field.nodes["rug_01/light"].mean).log2();
        assert!((level + MIXED_STOPS).abs() < 0.05, "{level}");
    }

    #[test]
    fn a_glossy_thing_has_the_colour_beside_its_highlights() {
        // Half of it mirrors a window.
        let photo = image(|x, _| if x < 0.55 { [0.4, 0.35, 0.33] } else { [0.15, 0.05, 0.02] });
        let render = image(|_, _| [0.3, 0.1, 0.04]);
        let (ids, weights) = (vec![1; SIZE.pixels()], vec![1.0; SIZE.pixels()]);
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let cells = |is_glossy: bool| {
            let leather = FieldNode { is_even: true, is_glossy, ..FieldNode::part("ottoman_01", "leather", "object") };
            let field = updated_field(&neutral_field(&camera()), &[leather], &seen, [1.0; 3]);
            field.nodes["ottoman_01/leather"].clone()
        };
        let level = |is_glossy: bool| luminance(cells(is_glossy).mean).log2();
        assert!((level(true) + 0.9).abs() < 0.15 && level(false) > 0.5, "{} {}", level(true), level(false));
        // One colour all over it.
        let glossy = cells(true);
        assert!(glossy.factors.iter().all(|f| *f == glossy.factors[0]), "{:?}", glossy.factors);
    }

    #[test]
    fn a_scrap_of_floor_that_mirrors_something_warm_does_not_dye_the_floor() {
        // The wall is right; 12 x 8 pixels of floor are two stops too dark, three for red.
        let ids: Vec<u32> =
            (0..SIZE.pixels()).map(|i| if (20..32).contains(&(i % 96)) && i / 96 >= 64 { 2 } else { 1 }).collect();
        let photo = image(|_, _| [0.4; 3]);
        let mut render = image(|_, _| [0.4; 3]);
        render.rgb.iter_mut().zip(&ids).filter(|(_, id)| **id == 2).for_each(|(c, _)| *c = [0.05, 0.1, 0.1]);
        let weights = vec![1.0; SIZE.pixels()];
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let field = updated_field(&neutral_field(&camera()), &nodes(), &seen, [1.0; 3]);
        let [r, g, b] = field.nodes["floor"].mean.map(f32::log2);
        assert!((0.3..0.7).contains(&g) && (r - b).abs() < 0.25, "{r} {g} {b}");
    }

    fn nodes() -> Vec<FieldNode> {
        [("back", "wall"), ("floor", "floor"), ("left", "wall"), ("chair_01", "object")]
            .map(|(name, kind)| FieldNode::new(name, kind))
            .to_vec()
    }

    /// A shaded wall of one paint: its texture is the photo, its light the same shading; then the reflectance must
    /// come out even, that is texture times factor is constant, and light times that is the photo.
    #[test]
    fn a_shaded_wall_of_one_paint_becomes_one_reflectance() {
        let paint = [0.6f32, 0.5, 0.4];
        let photo = image(|x, y| paint.map(|p| p * shading(x, y)));
        // The render lights the photo-lit texture again: shading twice.
        let render = image(|x, y| paint.map(|p| p * shading(x, y) * shading(x, y)));
        let ids: Vec<u32> = (0..SIZE.pixels()).map(|i| if i / 96 < 60 { 1 } else { 2 }).collect();
        let weights = vec![1.0; SIZE.pixels()];
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let field = updated_field(&neutral_field(&camera()), &nodes(), &seen, [1.0; 3]);
        let cells = &field.nodes["back"];
        for y in 2..(field.rows * 60 / 72 - 3) {
            for x in 2..field.columns - 2 {
                let (u, v) = ((x as f32 + 0.5) / field.columns as f32, (y as f32 + 0.5) / field.rows as f32);
                let factor = cells.factors[(y * field.columns + x) as usize][0];
                let reflectance = paint[0] * shading(u, v) * factor;
                assert!(
                    (reflectance / paint[0]).log2().abs() <= 0.2,
                    "at {u:.2}, {v:.2}: {reflectance} of {}",
                    paint[0]
                );
            }
        }
    }

    #[test]
    fn an_unseen_wall_learns_from_the_walls_and_an_object_from_all() {
        let photo = image(|_, _| [0.2; 3]);
        let render = image(|_, y| if y < 0.5 { [0.4; 3] } else { [0.1; 3] });
        let ids: Vec<u32> = (0..SIZE.pixels()).map(|i| if i / 96 < 36 { 1 } else { 2 }).collect();
        let weights = vec![1.0; SIZE.pixels()];
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let field = updated_field(&neutral_field(&camera()), &nodes(), &seen, [1.0; 3]);
        assert!((field.nodes["left"].mean[0] - 0.5).abs() <= 0.02, "{:?}", field.nodes["left"]);
        assert!((field.nodes["floor"].mean[0] - 2.0).abs() <= 0.08);
        assert!((field.nodes["chair_01"].mean[0] - 1.0).abs() <= 0.1, "half and half of one stop either way");
        assert!(field.nodes["left"].factors.is_empty());
        let blue = image(|_, _| [0.1, 0.2, 0.6]);
        let field = updated_field(&field, &nodes(), &Comparison { photo: &blue, ..seen }, [1.0; 3]);
        let [r, g, b] = field.nodes["left"].mean;
        assert!(r == g && g == b, "a blue wall tints no other");
    }

    #[test]
    fn what_is_masked_does_not_bend_the_field_and_factors_are_bounded() {
        let photo = image(|x, _| if x > 0.5 { [50.0; 3] } else { [0.2; 3] });
        let render = image(|_, _| [0.2; 3]);
        let ids = vec![1; SIZE.pixels()];
        let weights: Vec<f32> = (0..SIZE.pixels()).map(|i| if i % 96 < 46 { 1.0 } else { 0.0 }).collect();
        let few: Vec<f32> = (0..SIZE.pixels()).map(|i| if i % 96 > 70 { 1.0 } else { 0.0 }).collect();
        let seen = Comparison { photo: &photo, render: &render, ids: &ids, weights: &weights };
        let field = updated_field(&neutral_field(&camera()), &nodes(), &seen, [1.0; 3]);
        assert!(field.nodes["back"].factors.iter().flatten().all(|f| (f - 1.0).abs() <= 0.01));
        let mostly_hidden =
            updated_field(&neutral_field(&camera()), &nodes(), &Comparison { weights: &few, ..seen }, [1.0; 3]);
        assert!(mostly_hidden.nodes["back"].factors.is_empty(), "a quarter of it, at its edge, says nothing");
        let all = vec![1.0; SIZE.pixels()];
        let field = updated_field(&neutral_field(&camera()), &nodes(), &Comparison { weights: &all, ..seen }, [1.0; 3]);
        assert!(field.nodes["back"].factors.iter().flatten().all(|f| (0.17..=5.7).contains(f)));
    }
}
