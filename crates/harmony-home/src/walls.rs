//! What of a home is solid: walls of real thickness between and around rooms, as blocks of one large room.
//!
//! # Idea
//! A home is a room whose box is the smallest around all rooms' free space, less its blocks. On the grid of all rooms'
//! and doors' coordinates every cell is free over ranges of height (rooms from floor to ceiling, doors to their tops); what
//! is left is solid, and cells alike are joined. So walls are there once, with doors cut through them once.

use glam::{DVec2, DVec3};
use harmony_scene::Block;

use crate::frame::Rect;

/// A piece of free space: a rectangle over a range of height, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Free {
    /// Home x and z.
    pub rect: Rect,
    /// Bottom and top.
    pub y: [f64; 2],
}

/// Lengths below this are none, metres.
const EPS: f64 = 1e-6;

/// The coordinates of rectangles along an axis, each once.
fn lines(rects: impl Iterator<Item = Rect>, axis: usize) -> Vec<f64> {
    let mut all: Vec<f64> = rects.flat_map(|r| [r.min[axis], r.max[axis]]).collect();
    all.sort_by(f64::total_cmp);
    all.dedup_by(|a, b| (*a - *b).abs() < EPS);
    all
}

/// What is solid between 0 and a height, as ranges; `free` is sorted out here.
fn solid(free: impl Iterator<Item = [f64; 2]>, height: f64) -> Vec<[f64; 2]> {
    let mut free: Vec<[f64; 2]> = free.collect();
    free.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut out = Vec::new();
    let mut at = 0.0;
    for [low, high] in free {
        if low > at + EPS {
            out.push([at, low]);
        }
        at = f64::max(at, high);
    }
    if height > at + EPS {
        out.push([at, height]);
    }
    out
}

/// The solid parts of a box with free space in it, along with those of it that are outer walls only: `wall` metres around
/// rooms are walls, what lies farther is outside.
///
/// Coordinates are those of `bounds`; `free` must lie in it.
pub fn blocks(bounds: &Rect, height: f64, free: &[Free], wall: f64) -> Vec<Block> {
    let near: Vec<Rect> = free.iter().map(|f| f.rect.grown(wall)).collect();
    let clipped = near.iter().filter_map(|r| r.meet(bounds));
    let all = || free.iter().map(|f| f.rect).chain(clipped.clone()).chain([*bounds]);
    let (xs, zs) = (lines(all(), 0), lines(all(), 1));
    // Rows of cells alike along x, then rows alike joined along z.
    let mut done: Vec<(Rect, Vec<[f64; 2]>, bool)> = Vec::new();
    let mut open: Vec<(Rect, Vec<[f64; 2]>, bool)> = Vec::new();
    for z in zs.windows(2) {
        let mut row: Vec<(Rect, Vec<[f64; 2]>, bool)> = Vec::new();
        for x in xs.windows(2) {
            let cell = Rect { min: DVec2::new(x[0], z[0]), max: DVec2::new(x[1], z[1]) };
            let middle = cell.centre();
            let here = free.iter().filter(|f| f.rect.contains(middle, 0.0)).map(|f| f.y);
            let ranges = solid(here, height);
            let is_wall = near.iter().any(|r| r.contains(middle, 0.0));
            match row.last_mut() {
                Some((rect, r, w)) if *r == ranges && *w == is_wall && rect.max.x == cell.min.x => {
                    rect.max.x = cell.max.x;
                }
                _ => row.push((cell, ranges, is_wall)),
            }
        }
        let mut next = Vec::new();
        for (rect, ranges, is_wall) in row {
            let above = open.iter().position(|(o, r, w)| {
                o.min.x == rect.min.x && o.max.x == rect.max.x && *r == ranges && *w == is_wall && o.max.y == rect.min.y
            });
            match above {
                Some(k) => {
                    let (mut joined, ranges, is_wall) = open.swap_remove(k);
                    joined.max.y = rect.max.y;
                    next.push((joined, ranges, is_wall));
                }
                None => next.push((rect, ranges, is_wall)),
            }
        }
        done.append(&mut open);
        open = next;
    }
    done.append(&mut open);
    let mut out: Vec<Block> = done
        .into_iter()
        .flat_map(|(rect, ranges, is_wall)| {
            ranges.into_iter().map(move |[low, high]| Block {
                kind: if is_wall { "wall" } else { "outside" }.to_owned(),
                min: DVec3::new(rect.min.x, low, rect.min.y),
                max: DVec3::new(rect.max.x, high, rect.max.y),
            })
        })
        .collect();
    out.sort_by(|a, b| {
        let key = |b: &Block| [b.min.z, b.min.x, b.min.y];
        key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal)
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use harmony_scene::{Extents, Room, RoomShape};

    fn rect(min: [f64; 2], max: [f64; 2]) -> Rect {
        Rect { min: DVec2::from_array(min), max: DVec2::from_array(max) }
    }

    /// Two rooms of different heights and depths side by side, a door between them.
    fn two() -> (Rect, Vec<Free>) {
        let free = vec![
            Free { rect: rect([0.0, 0.0], [3.0, 4.0]), y: [0.0, 2.5] },
            Free { rect: rect([3.2, 0.0], [6.0, 3.0]), y: [0.0, 2.4] },
            Free { rect: rect([3.0, 1.0], [3.2, 1.9]), y: [0.0, 2.0] },
        ];
        (rect([0.0, 0.0], [6.0, 4.0]), free)
    }

    #[test]
    fn solid_and_free_space_make_up_the_box() {
        let (bounds, free) = two();
        let blocks = blocks(&bounds, 2.5, &free, 0.2);
        let volume = |b: &Block| (b.max - b.min).element_product();
        let solid: f64 = blocks.iter().map(volume).sum();
        let air: f64 = free.iter().map(|f| f.rect.area() * (f.y[1] - f.y[0])).sum();
        assert!((solid + air - 6.0 * 4.0 * 2.5).abs() < 1e-9, "{solid} and {air}");
        for (k, a) in blocks.iter().enumerate() {
            assert!(blocks[k + 1..].iter().all(|b| (a.max.min(b.max) - a.min.max(b.min)).min_element() <= 1e-9));
        }
        let outside: f64 = blocks.iter().filter(|b| b.kind == "outside").map(volume).sum();
        // Behind the second room, less its own wall and that of the first.
        assert!((outside - (2.8 * 0.8 * 2.5)).abs() < 1e-9, "{outside}");
    }

    #[test]
    fn one_walks_from_room_to_room_through_the_door_alone() {
        let (bounds, free) = two();
        let room = Room {
            room_type: "home".into(),
            extents: Extents { width: 6.0, height: 2.5, depth: 4.0 },
            shape: RoomShape { blocks: blocks(&bounds, 2.5, &free, 0.2), ..RoomShape::default() },
            seen: vec![],
            openings: vec![],
            floor_texture: None,
            wall_texture: None,
        };
        let is_free = |x: f64, y: f64, z: f64| room.is_free(DVec3::new(x, y, z));
        assert!(is_free(3.1, 1.0, 1.5), "the door");
        assert!(!is_free(3.1, 2.2, 1.5), "the wall above it");
        assert!(!is_free(3.1, 1.0, 0.5), "the wall beside it");
        assert!(is_free(1.0, 2.45, 3.5) && !is_free(5.0, 2.45, 1.0), "each room has its own height");
    }
}
