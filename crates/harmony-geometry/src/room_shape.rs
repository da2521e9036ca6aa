//! Blocks, niches, slopes, trays and vaults of a room, measured: what a layout answer points at, fitted to the point map and the photo.
//!
//! The answer names the wall and outlines the face in the photo. The face's plane is where the map's points of the outline
//! agree (or where the outline meets the floor, or else the depth that was told); the outline's rays on that plane give
//! its sides. When the plane turns out to be the one that calibration took for the wall, the box's wall is moved to where
//! the wall really is. Beyond the paper, whose rooms are boxes. Key `layout.shape`.

use harmony_scene::{Block, Camera, Extents, ImageSize, Niche, RoomShape, Slope, Vec2, Vec3, Wall};

use crate::stats::{median, median_absolute_deviation};

mod tray;

/// What a hint says that there is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShapeKind {
    /// Solid, standing out of a wall.
    Block,
    /// Free, behind a wall's face.
    Niche,
    /// A ceiling that comes down towards a wall.
    Slope,
    /// A recess in the ceiling.
    Tray,
    /// An arched ceiling that springs from a wall and from the one across.
    Vault,
}

/// A feature of the room as a layout answer gives it.
#[derive(Debug, Clone, PartialEq)]
pub struct ShapeHint {
    /// What it is.
    pub kind: ShapeKind,
    /// In a word or two.
    pub what: String,
    /// The wall concerned; none is of a tray.
    pub wall: Wall,
    /// Outline of its face, pixels of the camera's image.
    pub face: Vec<Vec2>,
    /// How far it stands out of the wall, goes behind it, reaches into the room, or goes up, metres.
    pub depth: f64,
    /// Whether the face goes on to floor, ceiling, and the walls at its left and right end in the photo.
    pub reaches: [bool; 4],
    /// Height of a slope at its wall, of a vault where it springs, metres.
    pub low: f64,
    /// Linear colour of the light hidden behind a tray's edge.
    pub glow: Option<[f32; 3]>,
}

/// A point map in the room frame.
#[derive(Debug, Clone, Copy)]
pub struct MapInRoom<'a> {
    /// Grid size; covers the whole image.
    pub size: ImageSize,
    /// Room positions, metres; NaN where there is none.
    pub xyz: &'a [Vec3],
}

/// What was measured.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MeasuredShape {
    /// In the box whose walls moved as `moved` says.
    pub shape: RoomShape,
    /// Walls of the box that go outward, metres (inward: negative): calibration had taken a block's face for the wall.
    pub moved: Vec<(Wall, f64)>,
    /// What could not be measured, or was not believed, in words.
    pub notes: Vec<String>,
}

/// Points of a map that a plane needs.
const MIN_POINTS: usize = 60;
/// Points this near to each other along a normal are of one plane, metres.
const PLANE: f64 = 0.05;
/// Share of a face's points that its plane has at least; the others are furniture before it.
const MIN_SHARE: f64 = 0.15;
/// A face is one with the box's wall when it is nearer to it than this, metres and as a share of what was told.
const SAME: (f64, f64) = (0.10, 0.35);
/// An end this near to floor, ceiling or a wall reaches it, metres.
const SNAP: f64 = 0.07;
/// A face thinner than this is none, metres.
const THINNEST: f64 = 0.04;
/// Beyond this share of the way from what is behind to a face's plane a pixel shows the face.
const JUMP: f64 = 0.65;
/// More pixels than this share on the wrong side of an edge: it is not clear.
const UNCLEAR: f64 = 0.2;
/// Corners this near to the outermost are of the same side, metres.
const SAME_SIDE: f64 = 0.2;
/// A measured side lies this near to the outlined one, metres.
const SIDE: f64 = 0.15;

/// Measures what a layout answer says of the room's shape.
pub fn measure_shape(hints: &[ShapeHint], camera: &Camera, extents: &Extents, map: Option<MapInRoom>) -> MeasuredShape {
    let mut out = MeasuredShape::default();
    let view = View { camera, extents, map };
    let uprights: Vec<&ShapeHint> =
        hints.iter().filter(|h| matches!(h.kind, ShapeKind::Block | ShapeKind::Niche)).collect();
    // Walls first: what one feature says of its wall holds for all on it.
    for wall in Wall::ALL {
        let moves: Vec<f64> =
            uprights.iter().filter(|h| h.wall == wall).filter_map(|h| view.wall_behind(h, hints)).collect();
        if let Some(by) = median(&moves) {
            out.moved.push((wall, by));
        }
    }
    for hint in uprights {
        view.upright(hint, &mut out);
    }
    for hint in hints.iter().filter(|h| h.kind == ShapeKind::Slope) {
        let (slope, note) = view.slope(hint);
        out.notes.extend(note);
        out.shape.slopes.extend(slope);
    }
    // One vault from wall to wall, however often it is told of.
    if let Some(hint) = hints.iter().find(|h| h.kind == ShapeKind::Vault) {
        let (planes, note) = view.vault(hint);
        out.notes.extend(note);
        out.shape.slopes.extend(planes);
    }
    for hint in hints.iter().filter(|h| h.kind == ShapeKind::Tray) {
        view.tray(hint, &mut out);
    }
    out.shape_in_moved_box(extents);
    out
}

impl MeasuredShape {
    /// The box with its moved walls, and how far everything goes along x and z with the box's origin.
    pub fn box_after(&self, extents: &Extents) -> (Extents, Vec3) {
        let (mut after, mut shift) = (*extents, Vec3::ZERO);
        for (wall, by) in &self.moved {
            match wall {
                Wall::Back | Wall::Front => after.depth += by,
                Wall::Left | Wall::Right => after.width += by,
            }
            match wall {
                Wall::Back => shift.z += by,
                Wall::Left => shift.x += by,
                Wall::Front | Wall::Right => {}
            }
        }
        (after, shift)
    }

    /// Coordinates were in the old box: the origin moves with the back and the left wall.
    fn shape_in_moved_box(&mut self, old: &Extents) {
        let (_, shift) = self.box_after(old);
        for block in &mut self.shape.blocks {
            block.min += shift;
            block.max += shift;
        }
        for slope in &mut self.shape.slopes {
            // The same plane, from where its wall is now.
            let outward = self.moved.iter().find(|(w, _)| *w == slope.wall).map_or(0.0, |m| m.1);
            let rise = (old.height - slope.low) / slope.run;
            slope.low -= rise * outward;
            slope.run += outward;
        }
        for niche in &mut self.shape.niches {
            niche.min += shift;
            niche.max += shift;
        }
    }
}

/// Where a face's plane is and what lies behind it, from the box's wall, metres.
#[derive(Debug, Clone, Copy)]
struct Depths {
    /// Where the outline lies.
    plane: f64,
    /// Where the map has that.
    front: f64,
    /// Where the map has what is behind.
    behind: f64,
}

/// Which ends of a face are meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Along {
    Wall,
    Height,
}

struct View<'a> {
    camera: &'a Camera,
    extents: &'a Extents,
    map: Option<MapInRoom<'a>>,
}

impl View<'_> {
    /// Points of the map inside an outline.
    fn points(&self, outline: &[Vec2]) -> Vec<Vec3> {
        self.points_in(outline, &[])
    }

    /// Points of the map inside one outline and outside another.
    fn points_in(&self, outline: &[Vec2], without: &[Vec2]) -> Vec<Vec3> {
        let Some(map) = self.map else { return Vec::new() };
        let (w, h) = (map.size.width as usize, map.size.height as usize);
        let image = self.camera.size;
        (0..(w * h).min(map.xyz.len()))
            .filter(|i| {
                let at = Vec2::new(
                    ((i % w) as f64 + 0.5) * f64::from(image.width) / w as f64,
                    ((i / w) as f64 + 0.5) * f64::from(image.height) / h as f64,
                );
                map.xyz[*i].is_finite() && inside(outline, at) && !inside(without, at)
            })
            .map(|i| map.xyz[i])
            .collect()
    }

    /// How far before the box's wall a hint's face is, metres (behind: negative), as measured; `None` without evidence.
    fn offset(&self, hint: &ShapeHint) -> Option<f64> {
        let expected = if hint.kind == ShapeKind::Niche { -hint.depth } else { hint.depth };
        let away: Vec<f64> = self.points(&hint.face).iter().map(|p| hint.wall.distance(self.extents, *p)).collect();
        // Of a niche, the bottom is behind the opening: both planes are in the outline.
        plane_of(&away, expected).or_else(|| self.offset_by_floor(hint))
    }

    /// The same from where the lower edge of the outline meets the floor, or its upper edge the ceiling.
    fn offset_by_floor(&self, hint: &ShapeHint) -> Option<f64> {
        let (floor, ceiling) = (hint.reaches[0], hint.reaches[1]);
        if hint.kind == ShapeKind::Niche || !(floor || ceiling) {
            return None;
        }
        let middle = hint.face.iter().map(|p| p.y).sum::<f64>() / hint.face.len() as f64;
        let border = |p: &Vec2| {
            let s = self.camera.size;
            p.x > 2.0 && p.y > 2.0 && p.x < f64::from(s.width) - 2.0 && p.y < f64::from(s.height) - 2.0
        };
        let met: Vec<f64> = hint
            .face
            .iter()
            .filter(|p| border(p))
            .filter_map(|p| {
                let height = if p.y > middle { floor.then_some(0.0) } else { ceiling.then_some(self.extents.height) }?;
                let ray = self.camera.ray(*p);
                let k = (height - ray.origin.y) / ray.direction.y;
                (k.is_finite() && k > 0.1).then(|| hint.wall.distance(self.extents, ray.at(k)))
            })
            .collect();
        median(&met).filter(|d| *d > 0.0)
    }

    /// Where the map has the wall just around a niche, metres before the box's wall: a map is off by more over a room than
    /// over a niche.
    fn wall_beside(&self, hint: &ShapeHint) -> Option<f64> {
        if hint.kind != ShapeKind::Niche {
            return None;
        }
        let middle = hint.face.iter().sum::<Vec2>() / hint.face.len() as f64;
        let grown = |by: f64| hint.face.iter().map(|p| middle + (*p - middle) * by).collect::<Vec<_>>();
        let near = self.points_in(&grown(1.5), &grown(1.1));
        let away: Vec<f64> = near.iter().map(|p| hint.wall.distance(self.extents, *p)).collect();
        plane_of(&away, 0.0).filter(|d| d.abs() < 0.5 * hint.depth)
    }

    /// How far the box's wall must go outward because calibration took the face of a block for it, or inward because it
    /// took the bottom of a niche; `None` where it did not.
    fn wall_behind(&self, hint: &ShapeHint, hints: &[ShapeHint]) -> Option<f64> {
        let offset = self.offset(hint)?;
        let told = if hint.kind == ShapeKind::Niche { -hint.depth } else { hint.depth };
        if offset.abs() > SAME.0.max(SAME.1 * hint.depth) {
            return None;
        }
        // Is there a plane where the wall should be then, outside of what was outlined on it?
        let map = self.map?;
        let (w, image) = (map.size.width as usize, self.camera.size);
        let away: Vec<f64> = map
            .xyz
            .iter()
            .enumerate()
            .filter(|(_, p)| p.is_finite() && p.y > 0.05 && p.y < self.extents.height - 0.05)
            .filter(|(i, _)| {
                let at = Vec2::new(
                    ((i % w) as f64 + 0.5) * f64::from(image.width) / w as f64,
                    ((i / w) as f64 + 0.5) * f64::from(image.height) / f64::from(map.size.height),
                );
                !hints.iter().any(|h| h.wall == hint.wall && inside(&h.face, at))
            })
            .map(|(_, p)| hint.wall.distance(self.extents, *p) + told)
            .filter(|d| d.abs() < 0.5 * hint.depth)
            .collect();
        let behind = plane_of(&away, 0.0)? - told;
        (behind.abs() > THINNEST).then_some(-behind)
    }

    /// A block or niche, in coordinates of the box as it was.
    fn upright(&self, hint: &ShapeHint, out: &mut MeasuredShape) {
        let outward = out.moved.iter().find(|(w, _)| *w == hint.wall).map_or(0.0, |m| m.1);
        let told = if hint.kind == ShapeKind::Niche { -hint.depth } else { hint.depth };
        // From the wall's place after the move, along its normal.
        let beside = if outward == 0.0 { self.wall_beside(hint).unwrap_or(0.0) } else { 0.0 };
        let measured = self.offset(hint).map(|d| d + outward - beside);
        let believed = |d: &f64| d * told > 0.0 && d.abs() > THINNEST && (d / told).ln().abs() < 1.2;
        let inset = measured.filter(believed).unwrap_or(told);
        if measured.is_none() {
            out.notes.push(format!("{}: its depth of {:.2} m is as told, nothing measures it", hint.what, hint.depth));
        } else if measured != Some(inset) {
            let found = measured.unwrap_or_default();
            out.notes
                .push(format!("{}: told as {told:+.2} m from its wall, measured as {found:+.2} m; as told", hint.what));
        }
        // The outline lies on the block's face, or on the wall's plane that a niche opens.
        let plane = if hint.kind == ShapeKind::Niche { -outward } else { inset - outward };
        let Some([mut u, y]) = self.spans(hint, plane, outward, inset) else {
            out.notes.push(format!("{}: its outline is not on the {:?} wall; left out", hint.what, hint.wall));
            return;
        };
        // What reaches the wall at its end goes on to where that is now.
        let [first, last] = match hint.wall {
            Wall::Back | Wall::Front => [Wall::Left, Wall::Right],
            Wall::Left | Wall::Right => [Wall::Back, Wall::Front],
        };
        let moved = |wall: Wall| out.moved.iter().find(|(w, _)| *w == wall).map_or(0.0, |m| m.1);
        if u[0] <= 0.0 {
            u[0] -= moved(first);
        }
        if u[1] >= hint.wall.length(self.extents) {
            u[1] += moved(last);
        }
        let (from, to) = (inset.min(0.0) - outward, inset.max(0.0) - outward);
        let corner = |u: f64, y: f64, d: f64| hint.wall.point(self.extents, u, y) + hint.wall.normal() * d;
        let (a, b) = (corner(u[0], y[0], from), corner(u[1], y[1], to));
        let (min, max) = (a.min(b), a.max(b));
        if (max - min).min_element() < THINNEST {
            out.notes.push(format!("{}: nothing is left of it where it was measured; left out", hint.what));
            return;
        }
        let kind = hint.what.clone();
        match hint.kind {
            ShapeKind::Niche => {
                let surface = hint.wall.surface();
                out.shape.niches.push(Niche { kind, surface, sides: None, glow: None, min, max });
            }
            _ => out.shape.blocks.push(Block { kind, min, max }),
        }
    }

    /// From where to where a face reaches along its wall and in height.
    fn spans(&self, hint: &ShapeHint, plane: f64, outward: f64, inset: f64) -> Option<[[f64; 2]; 2]> {
        let (wall, e) = (hint.wall, self.extents);
        let on_plane = |pixel: Vec2| {
            let ray = self.camera.ray(pixel);
            let k = (wall.distance(e, ray.origin) - plane) / -ray.direction.dot(wall.normal());
            (k.is_finite() && k > 0.05).then(|| wall.coordinates(ray.at(k)))
        };
        let corners: Vec<Vec2> = hint.face.iter().filter_map(|p| on_plane(*p)).collect();
        if corners.len() < 3 {
            return None;
        }
        let low_is_left = wall.runs_to_the_right();
        let [floor, ceiling, left, right] = hint.reaches;
        let ends = if low_is_left { [left, right] } else { [right, left] };
        let length = wall.length(e);
        let mut u = span(&corners.iter().map(|c| c.x).collect::<Vec<_>>());
        let mut y = span(&corners.iter().map(|c| c.y).collect::<Vec<_>>());
        let (beside, niche) = (self.wall_beside(hint).unwrap_or(-outward), hint.kind == ShapeKind::Niche);
        let [front, behind] = if niche { [beside, inset + beside] } else { [plane, -outward] };
        let depths = Depths { plane, front, behind };
        for (k, reaches) in ends.into_iter().enumerate() {
            if !reaches {
                let side = (hint.kind == ShapeKind::Block).then(|| self.side(hint, [-outward, plane], u[k])).flatten();
                u[k] = side.or_else(|| self.edge(hint, depths, Along::Wall, k, [u, y])).unwrap_or(u[k]);
            }
        }
        for (k, reaches) in [floor, ceiling].into_iter().enumerate() {
            if !reaches {
                y[k] = self.edge(hint, depths, Along::Height, k, [u, y]).unwrap_or(y[k]);
            }
        }
        for (range, most, reaches) in [(&mut u, length, ends), (&mut y, e.height, [floor, ceiling])] {
            if reaches[0] || range[0] < SNAP {
                range[0] = 0.0;
            }
            if reaches[1] || range[1] > most - SNAP {
                range[1] = most;
            }
            *range = range.map(|v| v.clamp(0.0, most));
        }
        Some([u, y])
    }

    /// One end of a face where the map jumps from it to what is behind, or from before a niche into it: of the places near
    /// the outlined end, the one that parts the pixels of the two best, on the face's plane.
    fn edge(&self, hint: &ShapeHint, depths: Depths, along: Along, end: usize, spans: [[f64; 2]; 2]) -> Option<f64> {
        let map = self.map?;
        let (w, h, image) = (map.size.width as usize, f64::from(map.size.height), self.camera.size);
        let own = usize::from(along == Along::Height);
        let across = spans[1 - own];
        let inner = [across[0] + 0.15 * (across[1] - across[0]), across[1] - 0.15 * (across[1] - across[0])];
        let told = spans[own][end];
        let mut pixels: Vec<(f64, bool)> = Vec::new();
        for (i, p) in map.xyz.iter().enumerate().filter(|(_, p)| p.is_finite()) {
            let at = Vec2::new(
                ((i % w) as f64 + 0.5) * f64::from(image.width) / w as f64,
                ((i / w) as f64 + 0.5) * f64::from(image.height) / h,
            );
            let ray = self.camera.ray(at);
            let k =
                (hint.wall.distance(self.extents, ray.origin) - depths.plane) / -ray.direction.dot(hint.wall.normal());
            if !(k.is_finite() && k > 0.05) {
                continue;
            }
            let on = hint.wall.coordinates(ray.at(k));
            let (here, other) = if own == 0 { (on.x, on.y) } else { (on.y, on.x) };
            if (here - told).abs() < SIDE && other > inner[0] && other < inner[1] {
                let share = (hint.wall.distance(self.extents, *p) - depths.behind) / (depths.front - depths.behind);
                // What stands before the face tells nothing.
                if share < 1.5 {
                    // A niche is what lies behind its plane, a block what does not.
                    let inside = if hint.kind == ShapeKind::Niche { share < JUMP } else { share > JUMP };
                    pixels.push((if end == 0 { here } else { -here }, inside));
                }
            }
        }
        pixels.sort_by(|a, b| a.0.total_cmp(&b.0));
        let total = pixels.iter().filter(|p| p.1).count();
        if total < MIN_POINTS || pixels.len() - total < MIN_POINTS {
            return None;
        }
        // Pixels on the wrong side of a cut: inside ones before it, others after it.
        let mut wrong = pixels.len() - total;
        let mut best = (wrong, pixels[0].0);
        for pair in pixels.windows(2) {
            wrong = if pair[0].1 { wrong + 1 } else { wrong - 1 };
            if wrong < best.0 {
                best = (wrong, f64::midpoint(pair[0].0, pair[1].0));
            }
        }
        let clear = (best.0 as f64) < UNCLEAR * pixels.len() as f64;
        let cut = if end == 0 { best.1 } else { -best.1 };
        clear.then(|| self.without_side(hint, depths, own, end, cut))
    }

    /// A cut moved to the edge itself where the side beyond it is seen, too: on that the pixels part not at the edge but a
    /// little behind it.
    fn without_side(&self, hint: &ShapeHint, depths: Depths, own: usize, end: usize, cut: f64) -> f64 {
        let eye = self.camera.centre();
        let (to_plane, c) = (hint.wall.distance(self.extents, eye) - depths.plane, hint.wall.coordinates(eye));
        let from = if own == 0 { c.x } else { c.y };
        let seen_from_inside = if end == 0 { from > cut } else { from < cut };
        if seen_from_inside != (hint.kind == ShapeKind::Niche) || to_plane <= 0.0 {
            return cut;
        }
        let behind = (1.0 - JUMP) * (depths.front - depths.behind).abs();
        from + (cut - from) * (to_plane + behind) / to_plane
    }

    /// A block's side as the map has it, near to where the outline ends.
    fn side(&self, hint: &ShapeHint, [from, to]: [f64; 2], end: f64) -> Option<f64> {
        let map = self.map?;
        let near: Vec<f64> = map
            .xyz
            .iter()
            .filter(|p| p.is_finite())
            .filter(|p| {
                let share = (hint.wall.distance(self.extents, **p) - from) / (to - from);
                share > 0.1 && share < 0.9 && p.y > 0.1 && p.y < self.extents.height - 0.1
            })
            .map(|p| hint.wall.coordinates(*p).x)
            .filter(|u| (u - end).abs() < SIDE)
            .collect();
        if near.len() < MIN_POINTS {
            return None;
        }
        let (middle, spread) = median_absolute_deviation(&near)?;
        (spread < PLANE).then_some(middle)
    }

    /// A slope: height and run from the map's points in its outline, or as told.
    fn slope(&self, hint: &ShapeHint) -> (Option<Slope>, Option<String>) {
        let e = self.extents;
        let told = Slope { wall: hint.wall, low: hint.low.min(e.height - THINNEST), run: hint.depth };
        let mut points: Vec<(f64, f64)> =
            self.points(&hint.face).iter().map(|p| (hint.wall.distance(e, *p), p.y)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let sane = |s: &Slope| s.low >= 0.0 && s.low < e.height - THINNEST && s.run > 0.1 && s.run < 20.0;
        let fitted = line(&points).filter(|(_, rise)| *rise > 0.05).map(|(low, rise)| Slope {
            wall: hint.wall,
            low,
            run: (e.height - low) / rise,
        });
        if let Some(slope) = fitted.filter(sane) {
            return (Some(slope), None);
        }
        let seen = self.slope_by_outline(hint, told);
        let note = (seen == told).then(|| format!("{}: as told, nothing measures it", hint.what));
        if sane(&seen) { (Some(seen), note) } else { (Some(told).filter(sane), note) }
    }
}

/// Planes on each side of a vault's crown, which the ceiling is.
const VAULT_PLANES: u32 = 4;
/// A crown that is told this far from the middle, as shares of the span, is not midway; nearer it is the told length's error,
/// and farther no vault.
const OFF_MIDDLE: std::ops::RangeInclusive<f64> = 0.1..=0.35;
/// Points nearer to the crown than this, as a share of the rise, say little of where a vault springs.
const CROWN: f64 = 0.85;

impl View<'_> {
    /// A vault: half an ellipse from wall to wall whose crown is the box's ceiling, or a quarter of one from either wall where the
    /// crown is told off the middle; as planes that touch it from outside. Where it springs is measured by the map's points in
    /// its outline, or as told.
    fn vault(&self, hint: &ShapeHint) -> (Vec<Slope>, Option<String>) {
        let e = self.extents;
        let span = if hint.wall.normal().x.abs() > 0.5 { e.width } else { e.depth };
        let is_aside = OFF_MIDDLE.contains(&(hint.depth / span - 0.5).abs());
        let crown = if is_aside { hint.depth } else { span / 2.0 };
        // Height above the springing as a share of the rise, so far from the wall.
        let share = |d: f64| {
            let half = if d < crown { crown } else { span - crown };
            (1.0 - ((d - crown) / half).powi(2)).max(0.0).sqrt()
        };
        let points = self.points(&hint.face);
        let springs: Vec<f64> = points
            .iter()
            .map(|p| (share(hint.wall.distance(e, *p)), p.y))
            .filter(|(share, _)| *share < CROWN)
            .map(|(share, y)| (y - e.height * share) / (1.0 - share))
            .collect();
        let sane = |low: &f64| *low >= 0.0 && *low < e.height - THINNEST;
        let measured = median(&springs).filter(|_| springs.len() >= MIN_POINTS).filter(sane);
        let note = measured.is_none().then(|| format!("{}: as told, nothing measures it", hint.what));
        let low = measured.unwrap_or_else(|| hint.low.clamp(0.0, e.height - THINNEST));
        let rise = e.height - low;
        let touching = |wall: Wall| {
            let half = if wall == hint.wall { crown } else { span - crown };
            (1..=VAULT_PLANES).map(move |k| {
                let angle = f64::from(k) * std::f64::consts::FRAC_PI_2 / f64::from(VAULT_PLANES + 1);
                let steep = rise / half / angle.tan();
                let at_wall = low + rise * (angle / 2.0).tan();
                Slope { wall, low: at_wall, run: (e.height - at_wall) / steep }
            })
        };
        ([hint.wall, hint.wall.opposite()].into_iter().flat_map(touching).collect(), note)
    }

    /// A slope whose outline's corners lie on its wall and on the level ceiling, where they are in the picture.
    fn slope_by_outline(&self, hint: &ShapeHint, told: Slope) -> Slope {
        let (e, size) = (self.extents, self.camera.size);
        let inner = |p: &&Vec2| {
            let margin = 0.004 * f64::from(size.width);
            p.x > margin
                && p.y > margin
                && p.x < f64::from(size.width) - margin
                && p.y < f64::from(size.height) - margin
        };
        let rays: Vec<harmony_scene::Ray> = hint.face.iter().filter(inner).map(|p| self.camera.ray(*p)).collect();
        let near = |told: f64| move |v: &f64| (v - told).abs() < NEAR_TOLD * told.max(0.5);
        let lows: Vec<f64> = rays
            .iter()
            .filter_map(|ray| {
                let towards = -ray.direction.dot(hint.wall.normal());
                let k = hint.wall.distance(e, ray.origin) / towards;
                (towards > 0.05 && k.is_finite() && k > 0.1).then(|| ray.at(k).y)
            })
            .filter(near(told.low))
            .collect();
        let runs: Vec<f64> = rays
            .iter()
            .filter_map(|ray| {
                let k = (e.height - ray.origin.y) / ray.direction.y;
                (k.is_finite() && k > 0.1).then(|| hint.wall.distance(e, ray.at(k)))
            })
            .filter(near(told.run))
            .collect();
        Slope { wall: hint.wall, low: median(&lows).unwrap_or(told.low), run: median(&runs).unwrap_or(told.run) }
    }
}

/// A corner of a slope's outline counts as on its wall, or on the ceiling, when that is this near to what was told.
const NEAR_TOLD: f64 = 0.3;

/// The plane that values along a normal agree on: the best-filled stretch of them, the nearer to the expected the better.
fn plane_of(values: &[f64], expected: f64) -> Option<f64> {
    if values.len() < MIN_POINTS {
        return None;
    }
    let mut sorted: Vec<f64> = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let least = ((sorted.len() as f64 * MIN_SHARE) as usize).max(MIN_POINTS);
    let mut best: Option<(f64, f64)> = None;
    let mut to = 0;
    for from in 0..sorted.len() {
        while to < sorted.len() && sorted[to] - sorted[from] <= 2.0 * PLANE {
            to += 1;
        }
        let count = to - from;
        if count < least {
            continue;
        }
        let middle = sorted[usize::midpoint(from, to)];
        let off = (middle - expected).abs() / (0.3 * expected.abs()).max(0.3);
        let score = count as f64 / (1.0 + off * off);
        if best.is_none_or(|(b, _)| score > b) {
            best = Some((score, middle));
        }
    }
    best.map(|(_, middle)| middle)
}

/// Straight line through points `(x, y)` sorted by x, robust: intercept and rise, by the median of slopes over pairs.
fn line(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let half = points.len() / 2;
    if half < MIN_POINTS {
        return None;
    }
    let rises: Vec<f64> = (0..half)
        .map(|i| (points[i], points[i + half]))
        .filter(|(a, b)| b.0 - a.0 > 0.05)
        .map(|(a, b)| (b.1 - a.1) / (b.0 - a.0))
        .collect();
    let rise = median(&rises)?;
    let low = median(&points.iter().map(|p| p.1 - rise * p.0).collect::<Vec<_>>())?;
    Some((low, rise))
}

/// The two sides of an outline from its corners: the mean of those near the outermost, which alone would be the one with
/// the largest error outward.
fn span(values: &[f64]) -> [f64; 2] {
    let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
    let near = SAME_SIDE.min((high - low) / 3.0);
    let mean = |end: f64| {
        let own: Vec<f64> = values.iter().copied().filter(|v| (v - end).abs() <= near).collect();
        own.iter().sum::<f64>() / own.len().max(1) as f64
    };
    [mean(low), mean(high)]
}

/// Whether a point lies in a polygon (even-odd).
pub(crate) fn inside(polygon: &[Vec2], at: Vec2) -> bool {
    let n = polygon.len();
    (0..n).fold(false, |within, i| {
        let (a, b) = (polygon[i], polygon[(i + 1) % n]);
        let crosses = (a.y > at.y) != (b.y > at.y) && at.x < a.x + (b.x - a.x) * (at.y - a.y) / (b.y - a.y);
        within != crosses
    })
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Intrinsics, Room, Surface};

    use super::*;

    pub(super) fn room(shape: RoomShape) -> Room {
        Room {
            room_type: "room".into(),
            extents: Extents { width: 5.0, height: 2.6, depth: 5.0 },
            shape,
            seen: vec![],
            openings: vec![],
            floor_texture: None,
            wall_texture: None,
        }
    }

    pub(super) fn camera() -> Camera {
        let size = ImageSize::new(320, 240);
        let lens = Intrinsics::from_horizontal_fov(size, 1.3);
        Camera::looking(size, lens, Vec3::new(1.6, 1.5, 4.8), Vec3::new(0.12, -0.08, -1.0))
    }

    /// The map that a camera sees of an empty room, in the frame of a box whose origin lies at `origin`.
    pub(super) fn map(room: &Room, camera: &Camera, origin: Vec3) -> Vec<Vec3> {
        let faces = room.faces();
        let size = camera.size;
        (0..size.pixels())
            .map(|i| {
                let (x, y) = (i % size.width as usize, i / size.width as usize);
                let ray = camera.ray(Vec2::new(x as f64 + 0.5, y as f64 + 0.5));
                faces.exit(&ray).map_or(Vec3::NAN, |e| e.point - origin)
            })
            .collect()
    }

    fn outline(camera: &Camera, corners: &[[f64; 3]]) -> Vec<Vec2> {
        corners.iter().filter_map(|p| camera.project(Vec3::from(*p))).collect()
    }

    fn corner() -> RoomShape {
        let block = Block { kind: "corner".into(), min: Vec3::new(3.0, 0.0, 0.0), max: Vec3::new(5.0, 2.6, 1.9) };
        RoomShape { blocks: vec![block], ..RoomShape::default() }
    }

    pub(super) fn hint(kind: ShapeKind, face: Vec<Vec2>, depth: f64, reaches: [bool; 4]) -> ShapeHint {
        ShapeHint { kind, what: "it".into(), wall: Wall::Back, face, depth, reaches, low: 0.0, glow: None }
    }

    #[test]
    fn the_corner_of_an_l_is_measured_with_and_without_a_map() {
        let (room, camera) = (room(corner()), camera());
        let face = outline(&camera, &[[3.02, 0.02, 1.9], [4.6, 0.02, 1.9], [4.6, 2.58, 1.9], [3.02, 2.58, 1.9]]);
        let hints = [hint(ShapeKind::Block, face, 1.6, [true, true, false, true])];
        let xyz = map(&room, &camera, Vec3::ZERO);
        let seen = MapInRoom { size: camera.size, xyz: &xyz };
        for (map, within) in [(Some(seen), 0.01), (None, 0.06)] {
            let found = measure_shape(&hints, &camera, &room.extents, map);
            assert!(found.moved.is_empty());
            let block = &found.shape.blocks[0];
            assert!((block.min - Vec3::new(3.0, 0.0, 0.0)).length() < within, "{block:?}");
            assert!((block.max - Vec3::new(5.0, 2.6, 1.9)).length() < within, "{block:?}");
        }
    }

    #[test]
    fn a_wall_that_was_taken_from_the_blocks_face_moves_back() {
        let (room, camera) = (room(corner()), camera());
        let face = outline(&camera, &[[3.02, 0.02, 1.9], [4.6, 0.02, 1.9], [4.6, 2.58, 1.9], [3.02, 2.58, 1.9]]);
        let hints = [hint(ShapeKind::Block, face, 1.7, [true, true, false, true])];
        // Calibration's box begins at the block's face.
        let origin = Vec3::new(0.0, 0.0, 1.9);
        let taken = Extents { depth: 3.1, ..room.extents };
        let mut moved_camera = camera;
        moved_camera.translation += moved_camera.rotation * origin;
        let xyz = map(&room, &camera, origin);
        let found = measure_shape(&hints, &moved_camera, &taken, Some(MapInRoom { size: camera.size, xyz: &xyz }));
        assert_eq!(found.moved.len(), 1);
        assert!((found.moved[0].1 - 1.9).abs() < 0.02, "{:?}", found.moved);
        let (after, shift) = found.box_after(&taken);
        assert!((after.depth - 5.0).abs() < 0.02 && (shift.z - 1.9).abs() < 0.02);
        let block = &found.shape.blocks[0];
        assert!((block.max - Vec3::new(5.0, 2.6, 1.9)).length() < 0.03 && block.min.z.abs() < 1e-9, "{block:?}");
    }

    #[test]
    fn an_outline_that_is_off_is_put_right_by_the_map() {
        let niche = Niche {
            kind: "niche".into(),
            surface: Surface::Back,
            sides: None,
            glow: None,
            min: Vec3::new(3.0, 0.8, -0.3),
            max: Vec3::new(4.1, 1.9, 0.0),
        };
        let block =
            Block { kind: "chimney breast".into(), min: Vec3::new(0.6, 0.0, 0.0), max: Vec3::new(1.8, 2.6, 0.4) };
        let shape = RoomShape { niches: vec![niche], blocks: vec![block], ..RoomShape::default() };
        let (room, camera) = (room(shape), camera());
        // Corners up to 10 cm off, each in its own way.
        let opening = outline(&camera, &[[2.93, 0.86, 0.0], [4.17, 0.74, 0.0], [4.04, 1.97, 0.0], [3.05, 1.83, 0.0]]);
        let face = outline(&camera, &[[0.52, 0.05, 0.4], [1.88, 0.02, 0.4], [1.74, 2.55, 0.4], [0.66, 2.55, 0.4]]);
        let hints = [
            hint(ShapeKind::Niche, opening, 0.35, [false; 4]),
            hint(ShapeKind::Block, face, 0.45, [true, true, false, false]),
        ];
        let xyz = map(&room, &camera, Vec3::ZERO);
        let found = measure_shape(&hints, &camera, &room.extents, Some(MapInRoom { size: camera.size, xyz: &xyz }));
        // A pixel of the map covers 2 cm of the wall.
        let (got, block) = (&found.shape.niches[0], &found.shape.blocks[0]);
        assert!((got.min - Vec3::new(3.0, 0.8, -0.3)).abs().max_element() < 0.02, "{got:?}");
        assert!((got.max - Vec3::new(4.1, 1.9, 0.0)).abs().max_element() < 0.02, "{got:?}");
        assert!((block.min - Vec3::new(0.6, 0.0, 0.0)).abs().max_element() < 0.02, "{block:?}");
        assert!((block.max - Vec3::new(1.8, 2.6, 0.4)).abs().max_element() < 0.02, "{block:?}");
    }

    #[test]
    fn recesses_and_slopes_are_measured() {
        let niche = Niche {
            kind: "recess".into(),
            surface: Surface::Back,
            sides: None,
            glow: None,
            min: Vec3::new(2.0, 0.5, -0.3),
            max: Vec3::new(3.4, 2.1, 0.0),
        };
        let slope = Slope { wall: Wall::Left, low: 1.2, run: 1.5 };
        let (room, camera) =
            (room(RoomShape { niches: vec![niche], slopes: vec![slope], ..RoomShape::default() }), camera());
        let opening = outline(&camera, &[[2.0, 0.5, 0.0], [3.4, 0.5, 0.0], [3.4, 2.1, 0.0], [2.0, 2.1, 0.0]]);
        let plane = outline(&camera, &[[0.05, 1.25, 0.0], [1.45, 2.55, 0.0], [1.45, 2.55, 2.5], [0.05, 1.25, 2.5]]);
        let hints = [
            hint(ShapeKind::Niche, opening, 0.4, [false; 4]),
            ShapeHint { wall: Wall::Left, low: 1.0, ..hint(ShapeKind::Slope, plane, 1.2, [false; 4]) },
        ];
        let xyz = map(&room, &camera, Vec3::ZERO);
        let found = measure_shape(&hints, &camera, &room.extents, Some(MapInRoom { size: camera.size, xyz: &xyz }));
        let got = &found.shape.niches[0];
        // A pixel of the map covers 2 cm of the wall.
        assert!((got.min - Vec3::new(2.0, 0.5, -0.3)).abs().max_element() < 0.02, "{got:?}");
        assert!((got.max - Vec3::new(3.4, 2.1, 0.0)).abs().max_element() < 0.02, "{got:?}");
        let got = found.shape.slopes[0];
        assert!((got.low - 1.2).abs() < 0.02 && (got.run - 1.5).abs() < 0.03, "{got:?}");
        // Without a map the outline's corners tell, which lie five centimetres inside the slope; the depth is as told.
        let outlined = measure_shape(&hints, &camera, &room.extents, None);
        let got = outlined.shape.slopes[0];
        assert!((got.low - 1.2).abs() < 0.1 && (got.run - 1.5).abs() < 0.1, "{got:?}");
        assert_eq!(outlined.notes.len(), 1, "{:?}", outlined.notes);
    }
    #[test]
    fn a_vault_is_planes_that_touch_its_arch() {
        // Springs at 1.8 m from the left and the right wall of a room of 5 m, crown at 2.6 m.
        let camera = camera();
        let plain = room(RoomShape::default());
        let arch = |x: f64| 1.8 + 0.8 * (1.0 - ((x - 2.5) / 2.5).powi(2)).sqrt();
        let points: Vec<Vec3> = (0..camera.size.pixels())
            .map(|i| {
                let (x, y) = (i % 320, i / 320);
                let ray = camera.ray(Vec2::new(x as f64 + 0.5, y as f64 + 0.5));
                // Along the ray until the arch is met.
                let met = (1..4000).map(|k| ray.at(f64::from(k) * 0.002)).find(|p| p.y > arch(p.x.clamp(0.0, 5.0)));
                met.filter(|p| (0.0..5.0).contains(&p.x) && p.z > 0.0).unwrap_or(Vec3::NAN)
            })
            .collect();
        let face = outline(&camera, &[[0.1, arch(0.1), 0.0], [2.5, 2.6, 0.0], [4.9, arch(4.9), 0.0], [2.5, 2.6, 3.0]]);
        let told = ShapeHint { wall: Wall::Left, low: 1.5, ..hint(ShapeKind::Vault, face, 2.5, [false; 4]) };
        let hints = [told.clone(), ShapeHint { wall: Wall::Right, ..told }];
        for (map, low) in [(Some(MapInRoom { size: camera.size, xyz: &points }), 1.8), (None, 1.5)] {
            let found = measure_shape(&hints, &camera, &plain.extents, map);
            assert_eq!(found.shape.slopes.len(), 8, "told from both walls, and made once");
            assert_eq!(found.notes.len(), usize::from(map.is_none()));
            let below = |x: f64, y: f64| {
                let p = Vec3::new(x, y, 2.5);
                found.shape.slopes.iter().all(|s| s.below(&plain.extents, p) >= 0.0)
            };
            let arch = |x: f64| low + (2.6 - low) * (1.0 - ((x - 2.5) / 2.5_f64).powi(2)).sqrt();
            for x in [0.02, 0.3, 0.9, 1.7, 2.5, 3.6, 4.4, 4.9] {
                assert!(below(x, arch(x) - 0.02), "the arch is free at {x}");
                assert!(!below(x, arch(x) + 0.12) || arch(x) + 0.12 > 2.6, "above it is no room at {x}");
            }
        }
        // A crown that is told a third of the way across: a quarter of an ellipse on either side of it.
        let aside = ShapeHint { depth: 1.7, ..hints[0].clone() };
        let found = measure_shape(&[aside], &camera, &plain.extents, None);
        let arch = |x: f64| {
            let half: f64 = if x < 1.7 { 1.7 } else { 3.3 };
            1.5 + 1.1 * (1.0 - ((x - 1.7) / half).powi(2)).sqrt()
        };
        for x in [0.3, 0.9, 1.7, 2.6, 3.6, 4.6] {
            let is_room =
                |y: f64| found.shape.slopes.iter().all(|s| s.below(&plain.extents, Vec3::new(x, y, 2.5)) >= 0.0);
            assert!(is_room(arch(x) - 0.02), "the arch is free at {x}");
            assert!(!is_room(arch(x) + 0.12) || arch(x) + 0.12 > 2.6, "above it is no room at {x}");
        }
    }
}
