//! Surface elements of a point map: mean point and normal of small grid cells.
//!
//! Paper: App. B.2, "point cloud with per-point normals"; the paper doesn't say how the normals are made.
//! Ours are finite differences on the image grid, between the mean points of square cells: averaging first takes
//! most of a sensor's noise out, and the mean of points of a plane lies on that plane, so it adds no bias.
//! A plane has an inverse depth that is linear in the image, whatever its slant; so a depth jump (or a crease) is
//! where the second difference of the inverse depth is large.

use harmony_scene::{PointMap, Vec3};

/// Cells along the longer side of the map.
const CELLS: u32 = 144;

/// Second difference of inverse depth over inverse depth at which neighbours are not one surface.
const JUMP: f64 = 0.025;

/// Largest spread of inverse depth within one cell, relative.
const CELL_SPREAD: f64 = 0.10;

/// Confidence below this share of the median is no confidence.
const MIN_CONFIDENCE: f64 = 0.15;

/// Least cosine between normal and line of sight; flatter ones are mostly noise.
const GRAZING: f64 = 0.06;

/// One small piece of surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surfel {
    /// Mean point, `points` frame.
    pub point: Vec3,
    /// Unit normal towards the camera, `points` frame; zero where the grid is broken (jump, border).
    pub normal: Vec3,
    /// 0..=1, from the map's confidence.
    pub weight: f64,
    /// Planar depth, unit of the map.
    pub depth: f64,
    /// Vertical position in the image, 0 top to 1 bottom.
    pub row: f64,
    /// Horizontal position in the image, 0 left to 1 right.
    pub column: f64,
}

/// All surfels of a map.
#[derive(Debug, Clone, PartialEq)]
pub struct Surfels {
    /// Cells with points, in image order.
    pub cells: Vec<Surfel>,
    /// Side of a cell, pixels of the map.
    pub cell_px: u32,
    /// Usable points of the map.
    pub usable_points: usize,
    /// Median depth, the length by which tolerances are measured.
    pub median_depth: f64,
}

impl Surfels {
    /// Those with a normal.
    pub fn oriented(&self) -> impl Iterator<Item = &Surfel> {
        self.cells.iter().filter(|s| s.normal != Vec3::ZERO)
    }
}

/// Cuts a point map into surfels (key `cam.normals`).
///
/// Points without confidence, behind the camera or not finite are left out; an empty map gives no cells.
pub fn surfels(map: &PointMap) -> Surfels {
    let (width, height) = (map.size.width, map.size.height);
    let cell_px = width.max(height).div_ceil(CELLS).max(1);
    let (columns, rows) = (width / cell_px, height / cell_px);
    let typical = typical_confidence(map);
    let depth_row = map.rotation.transpose() * Vec3::Z;
    let depth_of = |p: Vec3| depth_row.dot(p) + map.translation.z;

    let mut usable_points = 0;
    let mut grid: Vec<Option<Surfel>> = Vec::with_capacity((columns * rows) as usize);
    for cy in 0..rows {
        for cx in 0..columns {
            let (mut sum, mut weight, mut n) = (Vec3::ZERO, 0.0, 0u32);
            let (mut least, mut most) = (f64::INFINITY, 0.0f64);
            for y in cy * cell_px..(cy + 1) * cell_px {
                for x in cx * cell_px..(cx + 1) * cell_px {
                    let i = (y * width + x) as usize;
                    let (p, c) = (map.xyz[i].as_dvec3(), f64::from(map.confidence[i]));
                    let depth = depth_of(p);
                    // NaN fails these comparisons too.
                    if !(c > MIN_CONFIDENCE * typical && depth > 1e-9 && depth.is_finite()) {
                        continue;
                    }
                    sum += p;
                    weight += (c / typical).min(1.0);
                    n += 1;
                    (least, most) = (least.min(depth), most.max(depth));
                }
            }
            usable_points += n as usize;
            let enough = n * 2 >= cell_px * cell_px;
            let flat = 1.0 / least - 1.0 / most <= CELL_SPREAD * f64::from(cell_px).max(4.0) / 4.0 / most;
            grid.push((enough && flat).then(|| {
                let point = sum / f64::from(n);
                Surfel {
                    point,
                    normal: Vec3::ZERO,
                    weight: weight / f64::from(n),
                    depth: depth_of(point),
                    row: (f64::from(cy) + 0.5) / f64::from(rows),
                    column: (f64::from(cx) + 0.5) / f64::from(columns),
                }
            }));
        }
    }

    let centre = map.camera_centre();
    let at = |x: u32, y: u32| grid[(y * columns + x) as usize].as_ref();
    let mut cells = Vec::with_capacity(grid.len());
    for y in 0..rows {
        for x in 0..columns {
            let Some(cell) = at(x, y) else { continue };
            let mut cell = *cell;
            if x > 0 && y > 0 && x + 1 < columns && y + 1 < rows {
                let neighbours = (at(x - 1, y), at(x + 1, y), at(x, y - 1), at(x, y + 1));
                if let (Some(l), Some(r), Some(u), Some(d)) = neighbours {
                    cell.normal = normal(&cell, [l, r], [u, d], centre);
                }
            }
            cells.push(cell);
        }
    }
    let mut depths: Vec<f64> = cells.iter().map(|c| c.depth).collect();
    let median_depth = crate::stats::percentile_in_place(&mut depths, 50.0).unwrap_or(0.0);
    Surfels { cells, cell_px, usable_points, median_depth }
}

/// Normal of a cell towards `eye` from its four neighbours, or zero across a jump.
fn normal(cell: &Surfel, horizontal: [&Surfel; 2], vertical: [&Surfel; 2], eye: Vec3) -> Vec3 {
    let bend = |[a, b]: [&Surfel; 2]| (1.0 / a.depth - 2.0 / cell.depth + 1.0 / b.depth).abs() * cell.depth;
    if bend(horizontal).max(bend(vertical)) > JUMP {
        return Vec3::ZERO;
    }
    let across = horizontal[1].point - horizontal[0].point;
    let down = vertical[1].point - vertical[0].point;
    let (Some(n), Some(sight)) = (across.cross(down).try_normalize(), (eye - cell.point).try_normalize()) else {
        return Vec3::ZERO;
    };
    let facing = n.dot(sight);
    if facing.abs() < GRAZING { Vec3::ZERO } else { n * facing.signum() }
}

/// Median of the positive confidences (every 7th pixel is enough for that).
fn typical_confidence(map: &PointMap) -> f64 {
    let mut sample: Vec<f64> =
        map.confidence.iter().step_by(7).map(|c| f64::from(*c)).filter(|c| *c > 0.0 && c.is_finite()).collect();
    crate::stats::percentile_in_place(&mut sample, 50.0).unwrap_or(1.0)
}
