//! What materials learn of one another: those of one thing, of alike things, of what is seen in threads or not at all.

use std::collections::BTreeMap;

use harmony_scene::AlbedoField;

use super::{Comparison, FieldNode, MIN_PIXELS, MIN_SHARE, rounded};
use crate::linear::luminance;
use crate::smooth::interior;
use crate::view::median;

/// How far the levels of one material of alike things may be from their mean, stops: they have one paint, and what is left of
/// the fit's light or of what is seen between slats is no other one.
pub(super) const TWIN_STOPS: f32 = 0.35;
/// How far the level of a material whose colour was said may be from that of the whole thing, which stands in one light: thin
/// stripes a little beside their place took the colours of their neighbours, 2.5 stops lighter.
const OWN_STOPS: f32 = 0.8;
/// How far the level of what is seen in threads may be from that of other things, stops: between leaves and slats the photo shows
/// a wall, or daylight, where the render does not.
pub(super) const MIXED_STOPS: f32 = 0.5;
/// Share of the frame below which a face of the room is seen in a scrap, and how far its hue may be from what it came with, stops.
const SCRAP: f64 = 0.02;
const SCRAP_HUE: f32 = 0.12;
/// How far an unseen material's level may be from what is usual, stops.
const UNSEEN_STOPS: f32 = 0.7;

/// A node that was seen, its level and its channels against that, log2.
pub(super) struct Found<'a> {
    pub node: &'a FieldNode,
    pub pixels: usize,
    pub level: f32,
    pub hue: [f32; 3],
}

/// Faces of the room of which the photo shows a scrap have nearly the hue that they came with, and a level near to that of what
/// is seen well: polished boards behind a rug, a pixel in two of which was the white door that they mirrored, became orange all
/// over the room.
pub(super) fn hold_scraps(field: &mut AlbedoField, found: &mut [Found<'_>], frame: usize) {
    let is_scrap = |f: &Found<'_>| f.node.kind != "object" && (f.pixels as f64) < SCRAP * frame as f64;
    let Some(usual) = mean_level(found.iter().filter(|f| !is_scrap(f))) else { return };
    for f in found.iter_mut().filter(|f| is_scrap(f)) {
        let Some(cells) = field.nodes.get_mut(&f.node.name) else { continue };
        let own = luminance(cells.mean).log2();
        let level = own.clamp(usual - MIXED_STOPS, usual + MIXED_STOPS);
        let hue = cells.mean.map(|m| m.log2() - own);
        let held = hue.map(|h| h.clamp(-SCRAP_HUE, SCRAP_HUE));
        let turned = |factor: [f32; 3]| rounded([0, 1, 2].map(|c| factor[c].log2() + level - own + held[c] - hue[c]));
        cells.mean = turned(cells.mean);
        cells.factors.iter_mut().for_each(|factor| *factor = turned(*factor));
        cells.gloss = (cells.gloss * (level - own).exp2()).min(1.0);
        (f.level, f.hue) = (level, held);
    }
}

/// Brings the materials of a thing, whose colours were said, to levels that are near to one another ([`OWN_STOPS`]).
pub(super) fn keep_to_thing(field: &mut AlbedoField, found: &mut [Found<'_>]) {
    let said = |n: &FieldNode| n.is_even && n.kind == "object";
    let levels: Vec<f32> = found
        .iter()
        .map(|f| {
            let whole = level_of(found, |n| said(n) && n.node() == f.node.node()).filter(|_| said(f.node));
            whole.map_or(f.level, |whole| f.level.clamp(whole - OWN_STOPS, whole + OWN_STOPS))
        })
        .collect();
    for (f, level) in found.iter_mut().zip(levels) {
        let by = level - f.level;
        if by == 0.0 {
            continue;
        }
        f.level = level;
        let Some(cells) = field.nodes.get_mut(&f.node.name) else { continue };
        let moved = |log: [f32; 3]| rounded(log.map(|v| v.log2() + by));
        cells.mean = moved(cells.mean);
        for factor in &mut cells.factors {
            *factor = moved(*factor);
        }
        cells.gloss = (cells.gloss * by.exp2()).min(1.0);
    }
}

/// Gives one material of several alike things, whose colour was said once, one hue, and levels that are near to one another:
/// beside a sunlit floor one chair of ten came out yellow, before a bright wall two of four a stop too light, and of two
/// worktops of one pine one olive.
pub(super) fn share_paint(field: &mut AlbedoField, found: &[Found<'_>]) {
    let mut twins: BTreeMap<(&str, Option<&str>), Vec<&Found<'_>>> = BTreeMap::new();
    for f in found.iter().filter(|f| f.node.is_even && f.node.kind == "object") {
        twins.entry(f.node.twins()).or_default().push(f);
    }
    for alike in twins.values().filter(|alike| alike.len() > 1) {
        let pixels: f32 = alike.iter().map(|f| f.pixels as f32).sum();
        let hue = [0, 1, 2].map(|c| alike.iter().map(|f| f.pixels as f32 * f.hue[c]).sum::<f32>() / pixels);
        let level = alike.iter().map(|f| f.pixels as f32 * f.level).sum::<f32>() / pixels;
        for f in alike {
            let nearer = level + (f.level - level).clamp(-TWIN_STOPS, TWIN_STOPS) - f.level;
            let Some(cells) = field.nodes.get_mut(&f.node.name) else { continue };
            let turned = |log: [f32; 3]| rounded([0, 1, 2].map(|c| log[c].log2() + hue[c] - f.hue[c] + nearer));
            cells.mean = turned(cells.mean);
            cells.factors.iter_mut().for_each(|f| *f = turned(*f));
        }
    }
}

/// Mean level of some nodes by the pixels that show them; `None` without any.
pub(super) fn level_of(found: &[Found<'_>], which: impl Fn(&FieldNode) -> bool) -> Option<f32> {
    mean_level(found.iter().filter(|f| which(f.node)))
}

fn mean_level<'f>(found: impl Iterator<Item = &'f Found<'f>>) -> Option<f32> {
    let (sum, pixels) = found.fold((0.0, 0.0), |(sum, pixels), f| {
        let own = f.pixels as f32;
        (sum + f.level * own, pixels + own)
    });
    (pixels > 0.0).then(|| sum / pixels)
}

/// The level of a material that the photo does not show: that of the same material of a twin; else that of the thing's
/// other materials, which stand in the same light, near to what is usual for colours that came the same way. One fur
/// that the render has too dark says little of the legs below it.
pub(super) fn unseen_level(node: &FieldNode, found: &[Found<'_>]) -> Option<f32> {
    let alike = |n: &FieldNode| n.kind == node.kind && n.is_even == node.is_even;
    let is_twin = |n: &FieldNode| n.design() == node.design() && n.material() == node.material();
    if let Some(level) = level_of(found, |n| alike(n) && is_twin(n)) {
        return Some(level);
    }
    let usual = level_of(found, alike).or_else(|| level_of(found, |n| n.kind == node.kind))?;
    let neighbours = level_of(found, |n| n.node() == node.node());
    Some(neighbours.map_or(usual, |level| level.clamp(usual - UNSEEN_STOPS, usual + UNSEEN_STOPS)))
}

/// Of the materials that are only seen in threads and specks between other materials of their thing, what all of these
/// together want, log2, and each one's share of the pixels: the pile of a rug, leaves.
pub(super) fn in_threads<'a>(
    nodes: &[FieldNode],
    unseen: &[&'a FieldNode],
    seen: &Comparison<'_>,
    ratio: &[[f32; 3]],
) -> Vec<(&'a FieldNode, f32, usize)> {
    let whole = wholes(nodes, seen);
    let mut things: BTreeMap<&str, Vec<&FieldNode>> = BTreeMap::new();
    unseen.iter().filter(|n| n.kind == "object").for_each(|n| things.entry(n.node()).or_default().push(n));
    let mut out = Vec::new();
    for parts in things.into_values() {
        let is_part = |id: u32| parts.iter().any(|n| nodes.get((id as usize).wrapping_sub(1)) == Some(*n));
        let shown: Vec<usize> = (0..ratio.len()).filter(|i| whole[*i] && is_part(seen.ids[*i])).collect();
        let counts = |i: &&usize| seen.weights.get(**i).copied().unwrap_or(1.0) > 0.0;
        let mut own: Vec<f64> = shown.iter().filter(counts).map(|i| f64::from(luminance(ratio[*i]))).collect();
        if own.len() < MIN_PIXELS || (own.len() as f64) < MIN_SHARE * shown.len() as f64 {
            continue;
        }
        let pixels = own.len() / parts.len();
        let off = median(&mut own) as f32;
        out.extend(parts.into_iter().map(|node| (node, off, pixels)));
    }
    out
}

/// A level that is no farther from that of the objects than [`MIXED_STOPS`].
pub(super) fn near_others(level: f32, found: &[Found<'_>]) -> f32 {
    level_of(found, |n| n.kind == "object").map_or(level, |of| level.clamp(of - MIXED_STOPS, of + MIXED_STOPS))
}

/// Pixels whose neighbours show the same thing, whichever material of it.
fn wholes(nodes: &[FieldNode], seen: &Comparison<'_>) -> Vec<bool> {
    let mut numbers: BTreeMap<&str, u32> = BTreeMap::new();
    let of = |id: &u32| {
        let node = nodes.get((*id as usize).wrapping_sub(1))?;
        let next = numbers.len() as u32 + 1;
        Some(*numbers.entry(node.node()).or_insert(next))
    };
    let things: Vec<u32> = seen.ids.iter().map(of).map(Option::unwrap_or_default).collect();
    interior(&things, seen.photo.size)
}
