//! An unwrap for any mesh: every triangle gets its own place in the texture, in its true shape and at one scale.
//!
//! Shapes are laid on shelves, highest first. It wastes half of the square and cuts every edge, but it needs nothing
//! of the mesh, which may be open, intersecting or not a surface at all.

use glam::{Vec2, Vec3};
use harmony_mesh::{Group, Mesh};

/// Empty pixels around a shape, so that no filter draws in a neighbour.
const GUTTER: f32 = 1.5;
/// Smallest side of a shape, pixels.
const SMALLEST: f32 = 1.0;

/// A triangle's place: its corners in texture pixels, in the order of the unwrapped mesh's vertices.
pub(super) type Place = [Vec2; 3];

/// A triangle laid flat: lengths in the mesh's unit.
struct Flat {
    triangle: usize,
    /// Which corner is first: the longest edge goes from it to the next.
    first: usize,
    length: f32,
    height: f32,
    /// Where along the longest edge the third corner stands.
    foot: f32,
}

fn flat(mesh: &Mesh, triangle: usize, corners: [u32; 3]) -> Flat {
    let p = corners.map(|i| mesh.positions[i as usize]);
    let edge = |k: usize| p[(k + 1) % 3] - p[k];
    let first = (0..3).max_by(|a, b| edge(*a).length().total_cmp(&edge(*b).length())).unwrap_or(0);
    let length = edge(first).length();
    let along = edge(first).normalize_or(Vec3::X);
    let third = p[(first + 2) % 3] - p[first];
    let foot = third.dot(along).clamp(0.0, length);
    Flat { triangle, first, length, height: (third - along * foot).length(), foot }
}

/// Places at a scale of `density` pixels a unit; `None` when they don't fit into `side` pixels.
fn places(order: &[Flat], count: usize, density: f32, side: f32) -> Option<Vec<Place>> {
    let mut out = vec![[Vec2::ZERO; 3]; count];
    let (mut x, mut y, mut shelf) = (0.0_f32, 0.0_f32, 0.0_f32);
    for f in order {
        let (w, h) = ((f.length * density).max(SMALLEST), (f.height * density).max(SMALLEST));
        let (full_w, full_h) = (w + 2.0 * GUTTER, h + 2.0 * GUTTER);
        if full_w > side {
            return None;
        }
        if x + full_w > side {
            (x, y, shelf) = (0.0, y + shelf, 0.0);
        }
        if y + full_h > side {
            return None;
        }
        let foot = if f.length > 0.0 { f.foot / f.length * w } else { 0.0 };
        let origin = Vec2::new(x + GUTTER, y + GUTTER);
        let laid = [Vec2::ZERO, Vec2::new(w, 0.0), Vec2::new(foot, h)];
        for (k, at) in laid.into_iter().enumerate() {
            out[f.triangle][(f.first + k) % 3] = origin + at;
        }
        x += full_w;
        shelf = shelf.max(full_h);
    }
    Some(out)
}

/// The mesh with three vertices of its own for every triangle, one material for all, and the triangles' places in a
/// texture of `side` pixels. Normals stay those of the corners.
pub(super) fn unwrapped(mesh: &Mesh, side: u32) -> (Mesh, Vec<Place>) {
    let triangles: Vec<[u32; 3]> = mesh.triangles().collect();
    let mut order: Vec<Flat> = triangles.iter().enumerate().map(|(i, t)| flat(mesh, i, *t)).collect();
    order.sort_by(|a, b| b.height.total_cmp(&a.height).then(a.triangle.cmp(&b.triangle)));
    let pixels = side as f32;
    let longest = order.iter().map(|f| f.length).fold(1e-6, f32::max);
    // The largest scale that fits, to a few percent; at scale 0 all shapes are a pixel high.
    let (mut low, mut high) = (0.0, pixels / longest);
    let mut best = places(&order, triangles.len(), low, pixels);
    for _ in 0..12 {
        let middle = f32::midpoint(low, high);
        match places(&order, triangles.len(), middle, pixels) {
            Some(found) => (best, low) = (Some(found), middle),
            None => high = middle,
        }
    }
    // Too many triangles for the texture: they share its first pixels.
    let places = best.unwrap_or_else(|| vec![[Vec2::splat(GUTTER); 3]; triangles.len()]);
    let mut out = Mesh { materials: mesh.materials.iter().take(1).cloned().collect(), ..Mesh::default() };
    let mut own = Vec::with_capacity(triangles.len());
    for (t, place) in triangles.iter().zip(&places) {
        let base = out.positions.len() as u32;
        for (i, at) in t.iter().zip(place) {
            out.positions.push(mesh.positions[*i as usize]);
            out.normals.push(mesh.normals.get(*i as usize).copied().unwrap_or(Vec3::Y));
            out.uvs.push(*at / pixels);
        }
        own.push([base, base + 1, base + 2]);
    }
    out.groups = vec![Group { material: 0, triangles: own }];
    (out, places)
}

/// Texture pixels of a place and around it, with the barycentric weights of the nearest point of the triangle.
pub(super) fn texels(place: &Place, side: u32) -> Vec<(u32, u32, [f32; 3])> {
    let [a, b, c] = *place;
    let (low, high) = (a.min(b).min(c) - GUTTER, a.max(b).max(c) + GUTTER);
    let area = (b - a).perp_dot(c - a);
    let range = |from: f32, to: f32| {
        let (from, to) = (from.floor().max(0.0) as u32, (to.ceil().max(0.0) as u32).min(side));
        from..to
    };
    let mut out = Vec::new();
    for y in range(low.y, high.y) {
        for x in range(low.x, high.x) {
            let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let raw = if area.abs() > 1e-9 {
                let v = (p - a).perp_dot(c - a) / area;
                let w = (b - a).perp_dot(p - a) / area;
                [1.0 - v - w, v, w]
            } else {
                [1.0, 0.0, 0.0]
            };
            let held = raw.map(|w| w.max(0.0));
            let sum: f32 = held.iter().sum();
            let weights = held.map(|w| w / sum.max(1e-9));
            let nearest = a * weights[0] + b * weights[1] + c * weights[2];
            if nearest.distance(p) <= GUTTER + 0.5 {
                out.push((x, y, weights));
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn soup() -> Mesh {
        let json = r#"{"parts":[{"shape":"sphere"},{"shape":"box","from":[0,0,0],"to":[0.9,0.02,0.1]}]}"#;
        let size = harmony_scene::Size { width: 1.0, height: 0.7, depth: 0.5 };
        harmony_mesh::PartModel::from_json(json).unwrap().build(size).unwrap().mesh
    }

    #[test]
    fn shapes_keep_their_form_and_do_not_overlap() {
        let mesh = soup();
        let side = 256;
        let (out, places) = unwrapped(&mesh, side);
        out.check().unwrap();
        assert_eq!(out.triangle_count(), mesh.triangle_count());
        let mut owner = vec![None; (side * side) as usize];
        let mut scales = Vec::new();
        for (i, (t, place)) in out.triangles().zip(&places).enumerate() {
            let p = t.map(|v| out.positions[v as usize]);
            for (k, at) in place.iter().enumerate() {
                assert!(at.min_element() >= 1.0 && at.max_element() <= side as f32 - 1.0, "{at}");
                let length = p[k].distance(p[(k + 1) % 3]);
                let drawn = at.distance(place[(k + 1) % 3]);
                if drawn > 4.0 {
                    scales.push(drawn / length);
                }
            }
            // Pixels whose centre is inside belong to nobody else.
            let [a, b, c] = *place;
            let side_of = |p: Vec2, q: Vec2, r: Vec2| (q - p).perp_dot(r - p);
            for y in 0..side {
                for x in 0..side {
                    let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                    let s = [side_of(a, b, at), side_of(b, c, at), side_of(c, a, at)];
                    if s.iter().all(|v| *v > 0.0) || s.iter().all(|v| *v < 0.0) {
                        let before = owner[(y * side + x) as usize].replace(i);
                        assert!(before.is_none(), "{before:?} and {i}");
                    }
                }
            }
        }
        // One scale for all that is larger than a pixel.
        let (low, high) = scales.iter().fold((f32::MAX, 0.0_f32), |(l, h), s| (l.min(*s), h.max(*s)));
        assert!(scales.len() > 20 && high / low < 1.15, "{low} {high}");
    }

    #[test]
    fn texels_around_a_shape_have_weights_of_its_nearest_point() {
        let place = [Vec2::new(4.0, 4.0), Vec2::new(12.0, 4.0), Vec2::new(4.0, 12.0)];
        let all = texels(&place, 32);
        let find = |x: u32, y: u32| all.iter().find(|t| (t.0, t.1) == (x, y)).map(|t| t.2);
        // The centre of pixel (5, 6) is 1.5 and 2.5 of 8 pixels along both legs.
        let w = find(5, 6).unwrap();
        assert!((w[1] - 1.5 / 8.0).abs() < 1e-6 && (w[2] - 2.5 / 8.0).abs() < 1e-6);
        // Just left of the left leg: held on it.
        let w = find(3, 7).unwrap();
        assert!(w[1] == 0.0 && w[2] > 0.3 && (w.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert!(find(20, 20).is_none());
    }
}
