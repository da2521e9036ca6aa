//! What a mesh's form says about where its front is.
//!
//! A language model picks the front of a generated mesh from four panels (paper Sec. 3.2, "Mesh Canonicalization") and
//! errs at times, also between front and back, which outlines hardly tell apart. Of seats, beds and open shelves the
//! form tells.

use glam::DVec3;
use harmony_catalogue::Back;
use harmony_scene::Size;

use crate::Mesh;

/// Cells along each side of the grids in which a mesh is seen from above and from its four sides.
const CELLS: usize = 28;
/// Cells at a side's end that count as the strip along it, and that are left out of the relief.
const STRIP: usize = 5;
const MARGIN: usize = 3;
/// Samples of the surface.
const SAMPLES: f64 = 120_000.0;
/// Relief beyond this is a hole, whatever is behind it; share of the mesh's extent.
const DEEPEST: f64 = 0.5;
/// Smallest difference of front and back that tells one from the other, shares of the mesh's height and extent: of
/// height and relief together, and of relief alone (doors and handles make less than open shelves do, and less than
/// made-up back sides are off).
const CLEAR: f64 = 0.2;
const CLEAR_RELIEF: f64 = 0.1;
/// Largest share of it that the other two sides may differ by.
const OTHER_SIDES: f64 = 0.5;

/// Smallest product of the logarithms of width over depth, of the mesh and as named, that tells which of its sides are
/// the broad ones: 1.65 to 1 twice. Where each side is named 30 % off, one in seventeen is wrong at this limit.
const CLEAR_PROPORTIONS: f64 = 0.25;

/// Depth over width of a mesh with broad sides, at most.
const SLAB: f64 = 0.5;

/// The horizontal directions: +Z, +X, -Z, -X; each is a quarter turn about +Y after the one before.
const SIDES: [DVec3; 4] = [DVec3::Z, DVec3::X, DVec3::NEG_Z, DVec3::NEG_X];

/// The quarter turns about +Y, counterclockwise from above, by which the front of an upright mesh lies from +Z: 0 to 3.
///
/// A high back ([`Back::High`]) is where the mesh is higher and less deep behind its outermost plane than across; a
/// closed one is where it is less deep. `None` where no side differs clearly from the one across, or where both pairs of
/// sides do.
pub fn front_by_form(mesh: &Mesh, back: Back) -> Option<u8> {
    let sides = Seen::of(mesh)?.fronts(back);
    let clear = match back {
        Back::High => CLEAR,
        Back::Closed => CLEAR_RELIEF,
    };
    let (z, x) = (sides[0] - sides[2], sides[1] - sides[3]);
    let (difference, other, side) = if z.abs() >= x.abs() {
        (z.abs(), x.abs(), if z > 0.0 { 0 } else { 2 })
    } else {
        (x.abs(), z.abs(), if x > 0.0 { 1 } else { 3 })
    };
    (difference >= clear && other <= OTHER_SIDES * difference).then_some(side)
}

/// The two quarter turns (as of [`front_by_form`]) of the broad sides of a mesh that is at most half as deep as it is
/// wide: what hangs on a wall shows one of them. `None` where no side is that broad.
pub fn broad_sides(mesh: &Mesh) -> Option<[u8; 2]> {
    let size = mesh.bounds()?.size();
    let broad = |depth: f64, width: f64| depth > 0.0 && depth <= SLAB * width;
    match (broad(size.z, size.x), broad(size.x, size.z)) {
        (true, _) => Some([0, 2]),
        (_, true) => Some([1, 3]),
        _ => None,
    }
}

/// The two quarter turns (as of [`front_by_form`]) of the sides between which the front of an upright mesh is, by the
/// width and depth that its object was said to have; the more open one first, where its kind has a back. `None` where
/// mesh or named size are too nearly square to tell.
pub fn front_by_size(mesh: &Mesh, named: Size, back: Option<Back>) -> Option<[u8; 2]> {
    let size = mesh.bounds()?.size();
    let agreement = (size.x / size.z).ln() * (named.width / named.depth).ln();
    if !agreement.is_finite() || agreement.abs() < CLEAR_PROPORTIONS {
        return None;
    }
    let [a, b] = if agreement > 0.0 { [0, 2] } else { [1, 3] };
    let fronts = back.and_then(|back| Some(Seen::of(mesh)?.fronts(back)));
    let turned = fronts.is_some_and(|open| open[usize::from(b)] > open[usize::from(a)]);
    Some(if turned { [b, a] } else { [a, b] })
}

/// A mesh from above and from its four sides.
struct Seen {
    /// Height of the surface, share of the mesh's own, by cell: x, then z.
    heights: Vec<f64>,
    /// By side, how deep behind its outermost plane the surface is, share of the extent, by cell: across, then height.
    depths: [Vec<f64>; 4],
}

fn cell(share: f64) -> usize {
    ((share * CELLS as f64) as usize).min(CELLS - 1)
}

impl Seen {
    fn of(mesh: &Mesh) -> Option<Self> {
        let bounds = mesh.bounds()?;
        let size = bounds.size();
        if size.min_element() <= 0.0 || !size.is_finite() {
            return None;
        }
        let corner = |i: u32| (mesh.positions[i as usize].as_dvec3() - bounds.min) / size;
        let triangles: Vec<[DVec3; 3]> = mesh.triangles().map(|t| t.map(corner)).collect();
        let area = |[a, b, c]: &[DVec3; 3]| (*b - *a).cross(*c - *a).length();
        let total: f64 = triangles.iter().map(area).sum();
        let mut seen =
            Self { heights: vec![0.0; CELLS * CELLS], depths: std::array::from_fn(|_| vec![DEEPEST; CELLS * CELLS]) };
        for t in &triangles {
            let count = (SAMPLES * area(t) / total.max(f64::MIN_POSITIVE)).ceil() as usize;
            for k in 0..count {
                // M. Roberts' R2 sequence, folded into the triangle.
                let (mut u, mut v) =
                    ((0.5 + 0.754_877_666 * k as f64).fract(), (0.5 + 0.569_840_291 * k as f64).fract());
                if u + v > 1.0 {
                    (u, v) = (1.0 - u, 1.0 - v);
                }
                seen.add(t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v);
            }
        }
        Some(seen)
    }

    /// Adds a point of the surface, in shares of the mesh's box.
    fn add(&mut self, p: DVec3) {
        let height = &mut self.heights[cell(p.x) * CELLS + cell(p.z)];
        *height = height.max(p.y);
        for (side, depths) in self.depths.iter_mut().enumerate() {
            let along = p.dot(SIDES[side].abs());
            let across = p.dot(SIDES[(side + 1) % 4].abs());
            let depth = &mut depths[cell(across) * CELLS + cell(p.y)];
            *depth = depth.min(if side < 2 { 1.0 - along } else { along });
        }
    }

    /// How much each side looks like a front, before a back of that kind.
    fn fronts(&self, back: Back) -> [f64; 4] {
        std::array::from_fn(|side| match back {
            Back::High => self.relief(side) - self.height_along(side),
            Back::Closed => self.relief(side),
        })
    }

    /// Mean height of the surface in the strip along a side, share of the mesh's own.
    fn height_along(&self, side: usize) -> f64 {
        let strip = if side < 2 { CELLS - STRIP..CELLS } else { 0..STRIP };
        let at = |i: usize, j: usize| if side.is_multiple_of(2) { j * CELLS + i } else { i * CELLS + j };
        let cells = strip.flat_map(|i| (0..CELLS).map(move |j| (i, j)));
        cells.map(|(i, j)| self.heights[at(i, j)]).sum::<f64>() / (STRIP * CELLS) as f64
    }

    /// Mean depth behind a side's outermost plane, away from the outline.
    fn relief(&self, side: usize) -> f64 {
        let inner = MARGIN..CELLS - MARGIN;
        let cells = inner.clone().flat_map(|i| inner.clone().map(move |j| i * CELLS + j));
        let count = (CELLS - 2 * MARGIN).pow(2);
        cells.map(|i| self.depths[side][i]).sum::<f64>() / count as f64
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::{TemplateParams, canonicalise, template};

    fn made(category: &str, width: f64, height: f64, depth: f64) -> Mesh {
        let size = Size { width, height, depth };
        template(category, &TemplateParams::default(), size).build(size).unwrap().mesh
    }

    #[test]
    fn backs_tell_the_front_however_the_mesh_is_turned() {
        let things = [
            ("sofa", [2.0, 0.85, 0.9]),
            ("armchair", [0.8, 0.85, 0.85]),
            ("chair", [0.45, 0.9, 0.5]),
            ("bed", [1.6, 1.0, 2.1]),
            ("bookshelf", [0.9, 1.9, 0.3]),
            ("laptop", [0.33, 0.22, 0.3]),
        ];
        for (category, [w, h, d]) in things {
            let back = harmony_catalogue::back(category).expect(category);
            for quarters in 0..4_u8 {
                let mut mesh = made(category, w, h, d);
                let turn = std::f64::consts::FRAC_PI_2 * f64::from(quarters);
                canonicalise(&mut mesh, DMat3::from_rotation_y(turn));
                assert_eq!(front_by_form(&mesh, back), Some(quarters), "{category}");
            }
        }
    }

    #[test]
    fn what_hangs_on_a_wall_shows_a_broad_side() {
        for (category, [w, h, d]) in [("window", [1.2, 1.3, 0.2]), ("picture", [0.6, 0.5, 0.03])] {
            let mut mesh = made(category, w, h, d);
            assert_eq!(broad_sides(&mesh), Some([0, 2]), "{category}");
            canonicalise(&mut mesh, DMat3::from_rotation_y(std::f64::consts::FRAC_PI_2));
            assert_eq!(broad_sides(&mesh), Some([1, 3]), "{category}");
        }
        assert_eq!(broad_sides(&made("box", 0.4, 0.3, 0.3)), None);
        assert_eq!(broad_sides(&Mesh::default()), None);
    }

    #[test]
    fn named_proportions_tell_the_sides_that_a_front_is_among() {
        let named = |width: f64, depth: f64| Size { width, height: 0.8, depth };
        let mut shelf = made("bookshelf", 0.9, 1.9, 0.3);
        let back = harmony_catalogue::back("bookshelf");
        assert_eq!(front_by_size(&shelf, named(0.7, 0.35), back), Some([0, 2]));
        assert_eq!(front_by_size(&shelf, named(0.35, 0.7), None), Some([1, 3]));
        // Its open side comes first, whichever of the two that is.
        canonicalise(&mut shelf, DMat3::from_rotation_y(1.5 * std::f64::consts::PI));
        assert_eq!(front_by_size(&shelf, named(0.7, 0.35), back), Some([3, 1]));
        // Neither a square mesh nor square named sizes tell anything, nor does a size that is none.
        assert_eq!(front_by_size(&made("box", 0.4, 0.3, 0.4), named(2.0, 0.5), back), None);
        assert_eq!(front_by_size(&shelf, named(0.6, 0.55), back), None);
        assert_eq!(front_by_size(&shelf, named(0.6, 0.0), back), None);
    }

    #[test]
    fn what_is_alike_on_all_sides_tells_nothing() {
        for (category, [w, h, d]) in
            [("stool", [0.4, 0.6, 0.4]), ("dining_table", [1.6, 0.75, 0.9]), ("box", [0.4, 0.3, 0.4])]
        {
            for back in [Back::High, Back::Closed] {
                assert_eq!(front_by_form(&made(category, w, h, d), back), None, "{category}");
            }
        }
        assert_eq!(front_by_form(&Mesh::default(), Back::High), None);
    }
}
