//! The photo's own lines along the room's edges.
//!
//! Who pins a room edge, a person or a model, is off by a percent of the image; the edge itself is most often a line
//! of the photo, known to a pixel. Once camera and room are about right, the segments near the image of a pinned edge
//! that lie on one line stand in for the pins. The line nearest to where the edge is expected wins, weighed by its
//! length; but of two that are as far apart as the edges of a skirting board (or of a cornice) the outer one is the
//! room's.

use harmony_scene::{Mat3, Vec2, Vec3};

use crate::room_box::pins::Pin;
use crate::room_box::solved::CameraBox;
use crate::{LineSegment, RoomEdge};

/// Shortest segment that counts, and the least length of all on one line, shares of the image's longer side.
const SHORTEST: f64 = 0.02;
const MIN_TOTAL: f64 = 0.07;
/// Segments on one line differ by less than this share.
const SAME_LINE: f64 = 0.0018;
/// Heights of skirting boards and cornices, metres, and the weight of their outer edge against the inner one's from
/// which it is believed.
const BOARD: [f64; 2] = [0.03, 0.16];
const OUTER_SHARE: f64 = 0.15;
const BOARD_STEP: f64 = 0.05;
/// How far an edge's image may lie beyond the edge's own ends, share of the room's size.
const BEYOND: f64 = 0.05;

/// How far to look, and how surely what is found holds, pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    /// Farthest offset from the expected image of the edge.
    pub(super) px: f64,
    /// One sigma of the pins that come out.
    pub(super) sigma_px: f64,
    /// The image's longer side.
    pub(super) side_px: f64,
}

/// A line of the photo on the image of an edge.
pub(super) struct EdgeLine {
    /// Both ends of its segments.
    pub(super) pins: Vec<Pin>,
    /// By how much it outweighs the next best line beside it, pixels.
    pub(super) margin: f64,
}

/// The line among the segments that lies on the image of an edge; segments are relative to the principal point.
pub(super) fn line_on_edge(
    solved: &CameraBox,
    segments: &[LineSegment],
    edge: RoomEdge,
    group: usize,
    reach: Reach,
) -> Option<EdgeLine> {
    let rotation = solved.rotation();
    let off = |p: Vec2| solved.distance_to_edge(&rotation, edge, p);
    // Offset of the middle, length, segment.
    let near: Vec<(f64, f64, &LineSegment)> = segments
        .iter()
        .filter(|s| s.length() >= SHORTEST * reach.side_px)
        .filter(|s| off(s.start).abs() <= reach.px && off(s.end).abs() <= reach.px)
        .filter(|s| on_edge(solved, &rotation, edge, s.middle()))
        .map(|s| (off(s.middle()), s.length(), s))
        .collect();
    let same = SAME_LINE * reach.side_px;
    let on_line = |at: f64| near.iter().filter(move |(o, _, _)| (o - at).abs() <= same);
    let weight = |at: f64| {
        let total: f64 = on_line(at).map(|(_, length, _)| length).sum();
        if total < MIN_TOTAL * reach.side_px { 0.0 } else { total * (-2.0 * (at / reach.px).powi(2)).exp() }
    };
    let heaviest = |among: &dyn Fn(f64) -> bool| {
        near.iter().map(|(o, _, _)| *o).filter(|o| among(*o)).max_by(|a, b| weight(*a).total_cmp(&weight(*b)))
    };
    let first = heaviest(&|_| true).filter(|o| weight(*o) > 0.0)?;
    let best = offset_of_board(solved, &rotation, edge, near.iter().map(|(_, _, s)| s.middle()))
        .and_then(|per_metre| {
            let outer = |o: f64| (BOARD[0]..=BOARD[1]).contains(&((first - o) / per_metre));
            heaviest(&|o| outer(o) && weight(o) >= OUTER_SHARE * weight(first))
        })
        .unwrap_or(first);
    let margin = weight(best) - heaviest(&|o| (o - best).abs() > 2.0 * same).map_or(0.0, weight);
    let points: Vec<Vec2> = on_line(best).flat_map(|(_, _, s)| [s.start, s.end]).collect();
    // Many points of one line are not many measurements.
    let sigma = reach.sigma_px * (points.len() as f64 / 2.0).sqrt();
    let pins = points.into_iter().map(|point| Pin { edge, point, sigma, group, given: false }).collect();
    Some(EdgeLine { pins, margin })
}

/// By how many pixels a line one metre inside of an edge along its wall (above the floor, below the ceiling) is off, in
/// the mean over some pixels; `None` for vertical edges.
fn offset_of_board(
    solved: &CameraBox,
    rotation: &Mat3,
    edge: RoomEdge,
    pixels: impl Iterator<Item = Vec2>,
) -> Option<f64> {
    let inward = match edge {
        RoomEdge::FloorBack | RoomEdge::FloorLeft | RoomEdge::FloorRight => 1.0,
        RoomEdge::CeilingBack | RoomEdge::CeilingLeft | RoomEdge::CeilingRight => -1.0,
        RoomEdge::BackLeft | RoomEdge::BackRight => return None,
    };
    let offsets: Vec<f64> = pixels
        .filter_map(|pixel| {
            let q = *rotation * (nearest_on_edge(solved, rotation, edge, pixel)? + Vec3::Y * (inward * BOARD_STEP));
            (q.z > 0.05).then(|| {
                let at = Vec2::new(q.x, q.y) * solved.focal / q.z;
                solved.distance_to_edge(rotation, edge, at) / BOARD_STEP
            })
        })
        .collect();
    (!offsets.is_empty()).then(|| offsets.iter().sum::<f64>() / offsets.len() as f64)
}

/// The point of an edge's line (from the camera, room axes) nearest to the ray of a pixel.
fn nearest_on_edge(solved: &CameraBox, rotation: &Mat3, edge: RoomEdge, pixel: Vec2) -> Option<Vec3> {
    let (p, d) = solved.edge(edge);
    let ray = rotation.transpose() * pixel.extend(solved.focal);
    let (a, b, c) = (d.dot(d), d.dot(ray), ray.dot(ray));
    let det = a * c - b * b;
    (det >= 1e-9 * a * c).then(|| p + d * ((b * ray.dot(p) - c * d.dot(p)) / det))
}

/// Whether a pixel beside the image of an edge's line is beside the edge itself: in front, between its two ends.
fn on_edge(solved: &CameraBox, rotation: &Mat3, edge: RoomEdge, pixel: Vec2) -> bool {
    let Some(q) = nearest_on_edge(solved, rotation, edge, pixel) else { return false };
    let ray = rotation.transpose() * pixel.extend(solved.focal);
    let (width, height) = (solved.left + solved.right, solved.floor + solved.ceiling);
    let within = |v: f64, low: f64, high: f64, size: f64| v >= low - BEYOND * size && v <= high + BEYOND * size;
    ray.dot(q) > 0.0
        && within(q.x, -solved.left, solved.right, width)
        && within(q.y, -solved.floor, solved.ceiling, height)
        && q.z >= -(1.0 + BEYOND) * solved.back
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room() -> CameraBox {
        CameraBox {
            focal: 800.0,
            yaw: 0.1,
            tilt: 0.05,
            roll: 0.0,
            left: 2.0,
            right: 2.5,
            floor: 1.5,
            ceiling: 1.1,
            back: 4.0,
            shift: 0.0,
        }
    }

    /// A piece of the image of an edge, moved across by some pixels.
    fn piece(room: &CameraBox, edge: RoomEdge, from: f64, to: f64, across: f64) -> LineSegment {
        let (p, d) = room.edge(edge);
        let image = |t: f64| {
            let c = room.rotation() * (p + d * t);
            Vec2::new(c.x, c.y) * room.focal / c.z
        };
        let (start, end) = (image(from), image(to));
        let normal = (end - start).perp().normalize_or_zero() * across;
        LineSegment { start: start + normal, end: end + normal, strength: 0.1 }
    }

    #[test]
    fn the_line_on_the_edge_is_taken_and_its_neighbours_are_not() {
        let room = room();
        let edge = RoomEdge::FloorBack;
        let segments = [
            piece(&room, edge, -1.5, -0.4, 2.0),
            piece(&room, edge, 0.3, 1.6, 2.0),
            // On the line, but beyond the corner.
            piece(&room, edge, 3.2, 3.9, 2.0),
            // Across it.
            LineSegment { start: Vec2::new(0.0, -300.0), end: Vec2::new(5.0, 300.0), strength: 1.0 },
        ];
        let reach = Reach { px: 9.0, sigma_px: 1.0, side_px: 1000.0 };
        assert!(line_on_edge(&room, &segments, RoomEdge::BackLeft, 6, reach).is_none());
        let line = line_on_edge(&room, &segments, edge, 5, reach).unwrap();
        assert!(line.margin > 0.0);
        let pins = line.pins;
        assert_eq!(pins.len(), 4, "{pins:?}");
        for pin in &pins {
            let off = room.distance_to_edge(&room.rotation(), edge, pin.point).abs();
            assert!((off - 2.0).abs() < 0.1 && pin.group == 5, "{pin:?} {off}");
        }
    }

    #[test]
    fn of_the_edges_of_a_skirting_board_the_lower_is_the_floors() {
        let room = room();
        let edge = RoomEdge::FloorBack;
        let board = |height: f64| {
            let at = |x: f64| {
                let c = room.rotation() * Vec3::new(x, height - room.floor, -room.back);
                Vec2::new(c.x, c.y) * room.focal / c.z
            };
            LineSegment { start: at(-1.5), end: at(1.6), strength: 0.1 }
        };
        let reach = Reach { px: 18.0, sigma_px: 1.0, side_px: 1000.0 };
        // The room is expected 5 cm too high: the board's upper edge is nearer.
        let expected = CameraBox { floor: room.floor - 0.05, ..room };
        let found = |segments: &[LineSegment]| {
            let pins = line_on_edge(&expected, segments, edge, 0, reach).unwrap().pins;
            assert_eq!(pins.len(), 2);
            room.distance_to_edge(&room.rotation(), edge, pins[0].point).abs()
        };
        assert!(found(&[board(0.0), board(0.07)]) < 0.1);
        // Alone it is all there is.
        assert!(found(&[board(0.07)]) > 5.0);
    }

    #[test]
    fn a_short_line_is_no_edge() {
        let room = room();
        let segments = [piece(&room, RoomEdge::BackLeft, 0.0, 0.2, 1.0)];
        let reach = Reach { px: 9.0, sigma_px: 1.0, side_px: 1000.0 };
        assert!(line_on_edge(&room, &segments, RoomEdge::BackLeft, 0, reach).is_none());
    }
}
