//! A described pattern fitted to pixels.
//!
//! Somebody (a language model, a person) says what a surface is: planks about 14 cm wide, a chequered floor. What pixels
//! can tell is refined: widths and phase by the repeat of edges and joints (harmonics of a period against everything
//! that changes along an axis), colours by trimmed means over the pieces, joints, and the spread of tone between pieces.
//! Where the pixels do not speak (fewer than two repeats, a repeat that explains little) the description stays.

mod comb;
mod prints;
mod view;

use image::RgbaImage;

use super::color::{bytes_of, hex, linear_hex, luminance};
use super::plan::{self, SIGMA_OF_TONE};
use super::space::Rgb;
use super::{Pattern, PatternKind as K};
use comb::{Repeat, find};
use view::{Signal, View};

/// Share of a profile's change that a repeat must explain to be believed.
const MIN_EXPLAINED: f64 = 0.28;
/// Fewest pieces whose tones make a spread.
const MIN_PIECES: usize = 10;
/// Fewest seen pixels.
const MIN_PIXELS: usize = 400;

/// A fitted pattern and how it was found.
#[derive(Debug, Clone, PartialEq)]
pub struct PatternFit {
    /// The pattern.
    pub pattern: Pattern,
    /// Share of the change along the pattern's u that its repeat explains; `None` where it was not believed or not asked.
    pub along_u: Option<f64>,
    /// The same along v.
    pub along_v: Option<f64>,
    /// Whether colours were measured.
    pub colors: bool,
}

/// Fits a pattern to what is seen of its surface.
///
/// `seen` is rectified in the surface's plane, u to the right and v down, its top left corner the surface's origin, light
/// taken out as far as can be; alpha above one half marks what is seen. Refined are: `width`, `length`, `offset`,
/// `colors`, `tone`, each only where the pixels speak.
pub fn fit_evidence(hint: &Pattern, seen: &RgbaImage, px_per_m: f64) -> PatternFit {
    let mut fit = PatternFit { pattern: hint.clone(), along_u: None, along_v: None, colors: false };
    if !(px_per_m.is_finite() && px_per_m > 0.0) {
        return fit;
    }
    let view = View::new(seen, px_per_m);
    if view.pixels().count() < MIN_PIXELS {
        return fit;
    }
    match hint.kind {
        K::Planks | K::Parquet | K::Tiles | K::Brick | K::Quilting => pieces(&mut fit, &view),
        K::Checks => prints::checks(&mut fit, &view),
        K::Stripes => prints::stripes(&mut fit, &view),
        K::Corrugated => prints::waves(&mut fit, &view),
        // Patterns of patterns: what lies below is what most pixels show.
        K::Over => {
            if let Some(below) = hint.below() {
                let lower = fit_evidence(below, seen, px_per_m);
                let at = (fit.pattern.layers.len() - 1).min(1);
                fit.pattern.layers[at] = lower.pattern.clone();
                return PatternFit { pattern: fit.pattern, ..lower };
            }
        }
        // Dirt is what the rest of the surface is not.
        K::Grime => return fit,
        _ => {}
    }
    if !fit.colors {
        whole_color(&mut fit, &view);
    }
    fit
}

/// A pattern's axes in the image, turned by `extra` degrees more.
fn axes(p: &Pattern, extra: f64) -> ([f64; 2], [f64; 2]) {
    let a = (p.turn_deg + extra).to_radians();
    let (s, c) = (libm::sin(a), libm::cos(a));
    ([c, s], [-s, c])
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// The better of the repeats of steps and of lines across an axis.
fn edges(
    view: &View,
    axis: [f64; 2],
    expected: f64,
    shifts: &[f64],
    class: &dyn Fn([f64; 2]) -> Option<usize>,
) -> Option<Repeat> {
    let of = |signal: Signal, signed: bool| {
        let profiles = view.profiles(axis, signal, 0.75 * expected, shifts.len(), class);
        find(&profiles, shifts, expected, MIN_EXPLAINED, signed)
    };
    let (steps, lines) = (of(Signal::Step, true), of(Signal::Line, false));
    match (steps, lines) {
        (Some(a), Some(b)) => Some(if a.explained >= b.explained { a } else { b }),
        (a, b) => a.or(b),
    }
}

/// Planks, parquet, tiles, bricks.
fn pieces(fit: &mut PatternFit, view: &View) {
    let hint = fit.pattern.clone();
    let (w, l) = (plan::width(&hint), plan::length(&hint));
    let all = |_: [f64; 2]| Some(0);
    let variant = hint.variant.as_str();
    // A lattice standing on its corner, and blocks that lie on one.
    let corner = match hint.kind {
        K::Tiles => variant == "diagonal",
        K::Parquet => !matches!(variant, "chevron" | "basket" | "mosaic" | "squares"),
        K::Quilting => variant == "diamond",
        _ => false,
    };
    if matches!(variant, "hex" | "chevron") || (hint.kind == K::Quilting && corner) {
        return;
    }
    let (u, v) = axes(&hint, if corner { 45.0 } else { 0.0 });
    if corner {
        let (a, b) = (edges(view, u, w, &[0.0], &all), edges(view, v, w, &[0.0], &all));
        (fit.along_u, fit.along_v) = (a.map(|r| r.explained), b.map(|r| r.explained));
        if let (Some(a), Some(b)) = (a, b) {
            let width = weighted(a, b);
            fit.pattern.length = l * width / w;
            fit.pattern.width = width;
            let root = std::f64::consts::SQRT_2;
            fit.pattern.offset = [(a.phase - b.phase) / root, (a.phase + b.phase) / root];
            if hint.kind == K::Tiles {
                piece_colors(fit, view, width, width, [a.phase, b.phase], (u, v), None);
            }
        }
        return;
    }
    // Rows first.
    let row = match hint.kind {
        K::Planks | K::Parquet => w,
        _ => l,
    };
    let Some(rows) = edges(view, v, row, &[0.0], &all) else { return };
    fit.along_v = Some(rows.explained);
    fit.pattern.offset[1] = rows.phase;
    let row = rows.period;
    match hint.kind {
        K::Planks | K::Parquet => fit.pattern.width = row,
        _ => fit.pattern.length = row,
    }
    let shift: Option<f64> = match (hint.kind, variant.replace("painted", "").trim()) {
        (K::Brick, "" | "running") | (K::Tiles, "running" | "metro") | (K::Planks, "half" | "brick" | "running") => {
            Some(0.5)
        }
        (_, "third") => Some(1.0 / 3.0),
        (K::Brick | K::Tiles | K::Planks, "stack") | (K::Tiles, "" | "checkerboard") | (K::Quilting, "" | "box") => {
            Some(0.0)
        }
        _ => None,
    };
    let along = if hint.kind == K::Planks { l } else { w };
    let mut columns = None;
    if let Some(shift) = shift {
        let classes = if shift == 0.0 { 1 } else { (1.0 / shift).round() as usize };
        let shifts: Vec<f64> = (0..classes).map(|c| c as f64 * shift).collect();
        let margin = 0.18 * row;
        let class = |p: [f64; 2]| {
            let t = (dot(p, v) - rows.phase).rem_euclid(row * classes as f64);
            // Rows' own joints are no columns' joints.
            let within = t.rem_euclid(row);
            (within > margin && within < row - margin).then_some(((t / row) as usize).min(classes - 1))
        };
        columns = edges(view, u, along, &shifts, &class);
    }
    if let Some(c) = columns {
        fit.along_u = Some(c.explained);
        fit.pattern.offset[0] = c.phase;
        match hint.kind {
            K::Planks => fit.pattern.length = c.period,
            _ => fit.pattern.width = c.period,
        }
    }
    // Without end joints tones are compared over half a length.
    let (cell, at) = columns.map_or((along / 2.0, 0.0), |c| (c.period, c.phase));
    piece_colors(fit, view, cell, row, [at, rows.phase], (u, v), shift.filter(|_| columns.is_some()));
}

fn weighted(a: Repeat, b: Repeat) -> f64 {
    (a.period * a.explained + b.period * b.explained) / (a.explained + b.explained)
}

/// Colours of pieces and joints and the spread of tone, on a fitted lattice.
fn piece_colors(
    fit: &mut PatternFit,
    view: &View,
    cell: f64,
    row: f64,
    at: [f64; 2],
    (u, v): ([f64; 2], [f64; 2]),
    shift: Option<f64>,
) {
    let p = fit.pattern.clone();
    let masonry = matches!(p.kind, K::Tiles | K::Brick);
    let joint = if masonry { plan::masonry_joint(&p) } else { p.joint.max(0.0015) };
    let texel = 1.0 / view.px_per_m;
    // Column, row, and distances to the lattice's lines.
    let locate = |q: [f64; 2]| {
        let t = (dot(q, v) - at[1]) / row;
        let j = t.floor();
        let s = (dot(q, u) - at[0]) / cell - shift.map_or(0.0, |s| (j * s).rem_euclid(1.0));
        let i = s.floor();
        let near = |f: f64, side: f64| f.min(1.0 - f) * side;
        (i as i64, j as i64, near(s - i, cell), near(t - j, row))
    };
    let known = shift.is_some() || p.variant == "diagonal";
    let clear = joint / 2.0 + 1.2 * texel;
    let interior = |q: [f64; 2]| {
        let (.., a, b) = locate(q);
        b > clear && (!known || a > clear)
    };
    let Some((face, _)) = view.mean_color(interior) else { return };
    let joint_px = joint / texel;
    let line = view.mean_color(|q| {
        let (.., a, b) = locate(q);
        // The middle of joints, away from crossings.
        let reach = (0.25 * joint).max(0.5 * texel);
        b < reach || (known && a < reach)
    });
    let cover = joint_px.min(1.0);
    let measured_joint = line
        .filter(|_| masonry && cover >= 0.3)
        .map(|(c, _)| -> Rgb { std::array::from_fn(|k| ((c[k] - (1.0 - cover) * face[k]) / cover).clamp(0.0, 1.0)) });
    let last = plan::has_joint_color(&p);
    let main = p.colors.len() - usize::from(last);
    if p.variant == "checkerboard" {
        let class = |odd: i64| {
            view.mean_color(|q| {
                let (i, j, a, b) = locate(q);
                (i + j).rem_euclid(2) == odd && a > clear && b > clear
            })
        };
        if let (Some((even, _)), Some((odd, _)), true) = (class(0), class(1), known) {
            let first = p.colors.first().map_or([1.0; 3], |c| linear_hex(c));
            let mut pair = [even, odd];
            if p.colors.len() < 2 && luminance(odd) > luminance(even)
                || p.colors.len() >= 2 && far(odd, first) < far(even, first)
            {
                pair.reverse();
                fit.pattern.offset[0] += cell;
            }
            let joint = measured_joint.map(text).or_else(|| last.then(|| p.colors[p.colors.len() - 1].clone()));
            fit.pattern.colors = pair.iter().map(|c| text(*c)).chain(joint).collect();
            fit.colors = true;
        }
    } else if main <= 1 {
        let joint = measured_joint.map(text).or_else(|| last.then(|| p.colors[p.colors.len() - 1].clone()));
        fit.pattern.colors = if masonry {
            std::iter::once(text(face)).chain(joint).collect()
        } else {
            // Grooves belong to the mean of boards.
            view.mean_color(|_| true).map(|(c, _)| text(c)).into_iter().collect()
        };
        fit.colors = true;
    } else {
        // Several colours in turn: their relation stays, their mean is measured.
        let mut mean = [0.0; 3];
        for c in &p.colors[..main] {
            for (m, c) in mean.iter_mut().zip(linear_hex(c)) {
                *m += c / main as f64;
            }
        }
        let scaled = |c: &String| {
            let c = linear_hex(c);
            text(std::array::from_fn(|k| c[k] * ((face[k] + 1e-4) / (mean[k] + 1e-4)).clamp(0.2, 5.0)))
        };
        fit.pattern.colors[..main].clone_from_slice(&p.colors[..main].iter().map(scaled).collect::<Vec<_>>());
        if let (Some(j), true) = (measured_joint, last) {
            fit.pattern.colors[main] = text(j);
        }
        fit.colors = true;
    }
    if p.variant != "checkerboard"
        && main <= 1
        && let Some(tone) = tone_spread(view, &|q| {
            let (i, j, ..) = locate(q);
            interior(q).then_some((i, j))
        })
    {
        fit.pattern.tone = tone;
    }
}

/// Spread of the pieces' tone as a pattern's `tone`, slow changes over the surface taken out as a plane.
fn tone_spread(view: &View, piece: &dyn Fn([f64; 2]) -> Option<(i64, i64)>) -> Option<f64> {
    let mut cells: std::collections::BTreeMap<(i64, i64), Vec<f64>> = std::collections::BTreeMap::new();
    let mut centre: std::collections::BTreeMap<(i64, i64), [f64; 3]> = std::collections::BTreeMap::new();
    for k in view.pixels() {
        let q = view.place(k);
        if let Some(id) = piece(q) {
            cells.entry(id).or_default().push(libm::log(luminance(view.color[k]) + 1e-3));
            let c = centre.entry(id).or_default();
            *c = [c[0] + q[0], c[1] + q[1], c[2] + 1.0];
        }
    }
    let most = cells.values().map(Vec::len).max()?;
    let tones: Vec<[f64; 3]> = cells
        .into_iter()
        .filter(|(_, c)| 2 * c.len() >= most)
        .map(|(id, mut c)| {
            c.sort_by(f64::total_cmp);
            let at = centre[&id];
            [at[0] / at[2], at[1] / at[2], c[c.len() / 2]]
        })
        .collect();
    let n = tones.len() as f64;
    if tones.len() < MIN_PIECES {
        return None;
    }
    let mean: Rgb = std::array::from_fn(|k| tones.iter().map(|t| t[k]).sum::<f64>() / n);
    let moment = |a: usize, b: usize| tones.iter().map(|t| (t[a] - mean[a]) * (t[b] - mean[b])).sum::<f64>() / n;
    let (xx, xy, yy, xt, yt, tt) = (moment(0, 0), moment(0, 1), moment(1, 1), moment(0, 2), moment(1, 2), moment(2, 2));
    let det = xx * yy - xy * xy;
    let explained = if det > 1e-9 { (yy * xt * xt - 2.0 * xy * xt * yt + xx * yt * yt) / det } else { 0.0 };
    let sigma = ((tt - explained).max(0.0) * n / (n - 3.0)).sqrt();
    Some((sigma / SIGMA_OF_TONE).clamp(0.02, 1.0))
}

fn text(c: Rgb) -> String {
    hex(bytes_of(c))
}

fn far(a: Rgb, b: Rgb) -> f64 {
    let (a, b) = (a.map(super::color::encoded), b.map(super::color::encoded));
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// The mean of everything seen: the one colour of a pattern, or what several are moved to together.
fn whole_color(fit: &mut PatternFit, view: &View) {
    let Some((seen, _)) = view.mean_color(|_| true) else { return };
    let p = &mut fit.pattern;
    match p.colors.len() {
        0 | 1 => p.colors = vec![text(seen)],
        _ => {
            let Some(mean) = plan::mean(p, seen) else { return };
            for c in &mut p.colors {
                let own = linear_hex(c);
                *c = text(std::array::from_fn(|k| own[k] * ((seen[k] + 1e-4) / (mean[k] + 1e-4)).clamp(0.2, 5.0)));
            }
        }
    }
    fit.colors = true;
}
