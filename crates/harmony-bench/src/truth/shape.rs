//! The shape of a true room that is no box: key `shape` of `room.json`.

use glam::DVec3;
use harmony_scene::{Block, Camera, Extents, Niche, RoomShape, Slope, Surface, Wall};
use serde_json::Value;

use super::vec3;

/// A block that covers a wall as far as this is a thicker wall, metres.
const WHOLE: f64 = 0.02;

/// Fewest pixels of a wall that counts as shown.
const FEWEST_PIXELS: usize = 500;
/// Ids of the walls in the id image.
const WALL_IDS: [(Wall, u8); 4] = [(Wall::Back, 3), (Wall::Right, 4), (Wall::Front, 5), (Wall::Left, 6)];

/// The walls of the box that the photo shows: pixels with a wall's id may show a block that looks the same way.
pub(super) fn box_walls_shown(camera: &Camera, extents: &Extents, ids: &[u8], depth: &[f32]) -> Vec<Wall> {
    let width = camera.size.width as usize;
    let shown = |(wall, id): &(Wall, u8)| {
        let on_box = |i: &usize| {
            let pixel = glam::DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            wall.distance(extents, camera.unproject(pixel, f64::from(depth[*i]))).abs() < WHOLE
        };
        (0..ids.len().min(depth.len())).filter(|i| ids[*i] == *id).filter(on_box).count() >= FEWEST_PIXELS
    };
    WALL_IDS.iter().filter(|w| shown(w)).map(|(wall, _)| *wall).collect()
}

/// The shape in a frame that begins at the walls that one sees, that frame's box, and where its origin lies in the file's
/// frame: linings (blocks that cover a whole wall) move the walls of the box, and niches in them lie behind it.
pub(super) fn read(room: &Value, extents: Extents) -> (RoomShape, Extents, DVec3) {
    let shape = &room["shape"];
    let list = |key: &str| shape[key].as_array().cloned().unwrap_or_default();
    let corners = |v: &Value| Some((vec3(&v["min"])?, vec3(&v["max"])?));
    let text = |v: &Value, key: &str| v[key].as_str().unwrap_or_default().to_owned();
    let mut blocks: Vec<Block> = list("blocks")
        .iter()
        .filter_map(|v| corners(v).map(|(min, max)| Block { kind: text(v, "kind"), min, max }))
        .collect();
    let mut niches: Vec<Niche> = list("niches")
        .iter()
        .filter_map(|v| {
            let (min, max) = corners(v)?;
            let name = v["wall"].as_str()?;
            let surface = Surface::ALL.into_iter().find(|s| s.name() == name)?;
            Some(Niche { kind: text(v, "kind"), surface, sides: None, glow: None, min, max })
        })
        .collect();
    let size = extents.as_vec();
    let (mut low, mut high) = (DVec3::ZERO, size);
    blocks.retain(|b| {
        let whole = |axis: usize| b.min[axis] < WHOLE && b.max[axis] > size[axis] - WHOLE;
        if !whole(1) {
            return true;
        }
        for (axis, across) in [(2, 0), (0, 2)] {
            if whole(across) && b.min[axis] < WHOLE {
                low[axis] = low[axis].max(b.max[axis]);
                return false;
            }
            if whole(across) && b.max[axis] > size[axis] - WHOLE {
                high[axis] = high[axis].min(b.min[axis]);
                return false;
            }
        }
        true
    });
    let inner = high - low;
    let within = Extents { width: inner.x, height: inner.y, depth: inner.z };
    for block in &mut blocks {
        block.min = (block.min - low).clamp(DVec3::ZERO, inner);
        block.max = (block.max - low).clamp(DVec3::ZERO, inner);
    }
    for niche in &mut niches {
        niche.min -= low;
        niche.max -= low;
    }
    let slopes = list("ceiling").iter().filter_map(|part| slope(part, &extents, &within, low)).collect();
    (RoomShape { blocks, niches, slopes }, within, low)
}

/// A sloping part of the ceiling, from its plane `a x + b y + c z = d`.
fn slope(part: &Value, whole: &Extents, within: &Extents, origin: DVec3) -> Option<Slope> {
    let plane: Vec<f64> = part["plane"].as_array()?.iter().filter_map(Value::as_f64).collect();
    let &[a, b, c, d] = plane.as_slice() else { return None };
    if a.hypot(c) < 0.01 || b < 0.05 {
        return None;
    }
    // It comes down to the wall whose side its outward normal leans to.
    let wall = Wall::ALL.into_iter().find(|w| w.normal().dot(DVec3::new(a, 0.0, c).normalize()) < -0.999)?;
    let height_at = |p: DVec3| (d - a * p.x - c * p.z) / b;
    let foot = wall.point(within, 0.0, 0.0) + origin;
    let rise = a.hypot(c) / b;
    let low = height_at(foot);
    Some(Slope { wall, low, run: (whole.height - low) / rise })
}
