//! Exact nearest neighbours between large point sets.
//!
//! A k-d tree, cut at medians across the longest axis, of which three levels at a time are kept as one node with the
//! boxes of its eight children. Leaves hold eight points in f64; boxes are f32, rounded outwards, and the pruning
//! bound carries the rounding of the query, so that distances are those of a search in f64 throughout. Queries run in
//! Morton order: each starts from its predecessor's neighbour, and consecutive ones touch the same nodes.
//!
//! Sources: J. H. Friedman, J. L. Bentley, R. A. Finkel, "An Algorithm for Finding Best Matches in Logarithmic
//! Expected Time", TOMS 1977; G. M. Morton, "A Computer Oriented Geodetic Data Base", 1966, for the order; I. Wald,
//! C. Benthin, S. Boulos, "Getting Rid of Packets", RT 2008, for wide nodes tested all at once (they trace rays).
//! Tried: leaves straight from the points' Morton order build in half the time, but their boxes overlap, and queries
//! took half as long again; picking lanes by bit masks was slower than by branches.
//!
//! Weak regimes, where answers stay exact but take longer: queries much farther from the set than the set is wide see
//! most leaves at nearly the same distance, and thousands of points within a millionth of the set's width cannot be
//! told apart by their boxes (equal points cost nothing).

use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Children of a node, and points of a leaf.
const WIDTH: usize = 8;
/// Largest coordinate that is accepted, metres. Squares of it fit f32, in which boxes are tested.
pub const MAX_COORDINATE: f64 = 1e9;
/// Bits of an axis in a Morton key.
const KEY_BITS: u32 = 16;
/// Queries that share a warm start. Fixed, so that the number of threads has no influence.
const BATCH: usize = 2048;
/// Points below which an order is made by one thread.
const SERIAL: usize = 1 << 13;
/// Room for the open nodes of one query: at most seven stay behind on each of the 11 levels that 2^32 points need.
const STACK: usize = 96;

/// Why a search cannot be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NearestError {
    /// There is nothing to be near to.
    #[error("the point set is empty")]
    Empty,
    /// More points than an index counts.
    #[error("{count} points, at most {} are indexed", u32::MAX)]
    TooMany {
        /// Number of points.
        count: usize,
    },
    /// Coordinates that are NaN, infinite or beyond [`MAX_COORDINATE`].
    #[error("{count} points are not finite or out of range, the first of them is point {first}")]
    Unusable {
        /// How many.
        count: usize,
        /// First such point.
        first: usize,
    },
}

/// The nearest point of a set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Euclidean distance, in the unit of the points.
    pub distance: f64,
    /// Which point, counted as it was handed in. Any of them when several are equally near.
    pub index: u32,
}

/// Points that a search accepts, and how many were not.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FinitePoints {
    /// The usable points, in their order.
    pub points: Vec<DVec3>,
    /// Points left out: a coordinate was NaN, infinite or beyond [`MAX_COORDINATE`].
    pub dropped: usize,
}

/// Leaves out the points that a search refuses.
pub fn finite_points(points: &[DVec3]) -> FinitePoints {
    let kept: Vec<_> = points.iter().copied().filter(is_usable).collect();
    FinitePoints { dropped: points.len() - kept.len(), points: kept }
}

fn is_usable(point: &DVec3) -> bool {
    point.abs().max_element() <= MAX_COORDINATE && !point.is_nan()
}

fn check(points: &[DVec3]) -> Result<(), NearestError> {
    if points.len() > u32::MAX as usize {
        return Err(NearestError::TooMany { count: points.len() });
    }
    match points.par_iter().position_first(|p| !is_usable(p)) {
        None => Ok(()),
        Some(first) => {
            let count = points.par_iter().filter(|p| !is_usable(p)).count();
            Err(NearestError::Unusable { count, first })
        }
    }
}

/// Eight points; missing ones are infinitely far away.
#[derive(Debug, Clone)]
struct Leaf {
    x: [f64; WIDTH],
    y: [f64; WIDTH],
    z: [f64; WIDTH],
}

/// The boxes of eight children around the index's centre; missing ones are inside out.
#[derive(Debug, Clone)]
struct Node {
    min: [[f32; WIDTH]; 3],
    max: [[f32; WIDTH]; 3],
}

#[derive(Debug, Clone, Copy)]
struct Box32 {
    min: Vec3,
    max: Vec3,
}

/// An index over points for exact nearest-neighbour searches.
#[derive(Debug, Clone)]
pub struct NearestIndex {
    leaves: Vec<Leaf>,
    /// The original number of each point of the leaves.
    order: Vec<u32>,
    /// Nodes from those over leaves up to the root, which stands alone.
    levels: Vec<Vec<Node>>,
    /// What boxes are relative to.
    centre: DVec3,
    /// Largest coordinate about the centre.
    reach: f64,
}

/// The best point so far.
#[derive(Clone, Copy)]
struct Best {
    squared: f64,
    /// Leaf number times [`WIDTH`], plus the place in it.
    place: usize,
}

/// Points in another order, with their original numbers.
struct Ordered {
    points: Vec<DVec3>,
    order: Vec<u32>,
}

impl NearestIndex {
    /// Builds the index; time grows with n log n, memory is about 60 bytes a point.
    ///
    /// # Errors
    /// [`NearestError`]: an empty set, or coordinates that [`finite_points`] would leave out.
    pub fn build(points: &[DVec3]) -> Result<Self, NearestError> {
        if points.is_empty() {
            return Err(NearestError::Empty);
        }
        check(points)?;
        let (min, max) = bounds(points);
        let centre = (min + max) / 2.0;
        let Ordered { points, order } = in_tree_order(points);
        let (leaves, mut boxes): (Vec<Leaf>, Vec<Box32>) =
            points.par_chunks(WIDTH).map(|points| (leaf_of(points), box_of(points, centre))).unzip();
        let mut levels = Vec::new();
        loop {
            let (nodes, around): (Vec<Node>, Vec<Box32>) = boxes.par_chunks(WIDTH).map(node_of).unzip();
            let done = nodes.len() == 1;
            levels.push(nodes);
            if done {
                break;
            }
            boxes = around;
        }
        let reach = (max - centre).abs().max((min - centre).abs()).max_element();
        Ok(Self { leaves, order, levels, centre, reach })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Never: an index has at least one point.
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// The nearest point of each query, in the queries' order. All threads of the current rayon pool work on it.
    ///
    /// # Errors
    /// [`NearestError::Unusable`] for queries that [`finite_points`] would leave out.
    pub fn nearest(&self, queries: &[DVec3]) -> Result<Vec<Nearest>, NearestError> {
        self.search(queries, |best| Nearest { distance: best.squared.sqrt(), index: self.order[best.place] })
    }

    /// The distance of each query to its nearest point, in the queries' order and the points' unit.
    ///
    /// # Errors
    /// [`NearestError::Unusable`] for queries that [`finite_points`] would leave out.
    pub fn distances(&self, queries: &[DVec3]) -> Result<Vec<f64>, NearestError> {
        self.search(queries, |best| best.squared.sqrt())
    }

    fn search<T: Copy + Send>(
        &self,
        queries: &[DVec3],
        answer: impl Fn(Best) -> T + Sync,
    ) -> Result<Vec<T>, NearestError> {
        check(queries)?;
        if queries.is_empty() {
            return Ok(Vec::new());
        }
        let (min, max) = bounds(queries);
        let Ordered { points, order } = in_morton_order(queries, min, max);
        let found: Vec<T> = points
            .par_chunks(BATCH)
            .flat_map_iter(|batch| {
                let mut place = 0;
                let answer = &answer;
                batch.iter().map(move |query| {
                    let best = self.find(*query, place);
                    place = best.place;
                    answer(best)
                })
            })
            .collect();
        let mut answers = vec![found[0]; found.len()];
        for (value, i) in found.into_iter().zip(order) {
            answers[i as usize] = value;
        }
        Ok(answers)
    }

    /// The nearest point, begun with the point at `place`.
    fn find(&self, query: DVec3, place: usize) -> Best {
        let about_centre = query - self.centre;
        let q = about_centre.as_vec3().to_array();
        // In units of 2^-24 of (largest coordinate + reach): rounding the query and its differences to the boxes costs
        // 3.5 over three axes, the sum of squares 2.6, the bound 0.9; the boxes themselves are rounded outwards.
        let slack = (about_centre.abs().max_element() + self.reach) * (8.0 / 16_777_216.0);
        let bound_of = |best: &Best| {
            // Nothing is nearer than a point in the same place.
            let radius = if best.squared > 0.0 { best.squared.sqrt() + slack } else { 0.0 };
            (radius * radius) as f32
        };
        let mut best = Best { squared: f64::INFINITY, place };
        self.scan(place / WIDTH, query, &mut best);
        let mut bound = bound_of(&best);
        let mut stack = [(0.0_f32, 0_u32, 0_u32); STACK];
        let mut open = 1;
        stack[0] = (0.0, self.levels.len() as u32 - 1, 0);
        while open > 0 {
            open -= 1;
            let (distance, level, number) = stack[open];
            if distance >= bound {
                continue;
            }
            let squared = self.levels[level as usize][number as usize].squared_distances(q);
            if level == 0 {
                for (child, distance) in squared.into_iter().enumerate() {
                    if distance < bound {
                        let before = best.squared;
                        self.scan(number as usize * WIDTH + child, query, &mut best);
                        if best.squared < before {
                            bound = bound_of(&best);
                        }
                    }
                }
                continue;
            }
            let first = open;
            for (child, distance) in squared.into_iter().enumerate().filter(|(_, distance)| *distance < bound) {
                // Farther ones lie deeper in the stack.
                let mut at = open;
                while at > first && stack[at - 1].0 < distance {
                    stack[at] = stack[at - 1];
                    at -= 1;
                }
                stack[at] = (distance, level - 1, number * WIDTH as u32 + child as u32);
                open += 1;
            }
        }
        best
    }

    fn scan(&self, leaf: usize, query: DVec3, best: &mut Best) {
        let Leaf { x, y, z } = &self.leaves[leaf];
        let mut squared = [0.0; WIDTH];
        for (i, squared) in squared.iter_mut().enumerate() {
            let d = [x[i] - query.x, y[i] - query.y, z[i] - query.z];
            *squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        }
        for (i, squared) in squared.into_iter().enumerate() {
            if squared < best.squared {
                *best = Best { squared, place: leaf * WIDTH + i };
            }
        }
    }
}

impl Node {
    fn squared_distances(&self, q: [f32; 3]) -> [f32; WIDTH] {
        let mut squared = [0.0; WIDTH];
        for (q, (min, max)) in q.iter().zip(self.min.iter().zip(&self.max)) {
            for i in 0..WIDTH {
                let (below, above) = (min[i] - q, q - max[i]);
                let outside = if below > above { below } else { above };
                let outside = if outside > 0.0 { outside } else { 0.0 };
                squared[i] += outside * outside;
            }
        }
        squared
    }
}

fn leaf_of(points: &[DVec3]) -> Leaf {
    let mut leaf = Leaf { x: [f64::INFINITY; WIDTH], y: [f64::INFINITY; WIDTH], z: [f64::INFINITY; WIDTH] };
    for (i, p) in points.iter().enumerate() {
        (leaf.x[i], leaf.y[i], leaf.z[i]) = (p.x, p.y, p.z);
    }
    leaf
}

/// The box of the points about the centre, rounded outwards.
fn box_of(points: &[DVec3], centre: DVec3) -> Box32 {
    let (min, max) = serial_bounds(points);
    let outwards = |exact: f64, next: fn(f32) -> f32| next(exact as f32);
    let (min, max) = ((min - centre).to_array(), (max - centre).to_array());
    Box32 {
        min: Vec3::from_array(min.map(|v| outwards(v, f32::next_down))),
        max: Vec3::from_array(max.map(|v| outwards(v, f32::next_up))),
    }
}

fn node_of(boxes: &[Box32]) -> (Node, Box32) {
    let mut node = Node { min: [[f32::INFINITY; WIDTH]; 3], max: [[f32::NEG_INFINITY; WIDTH]; 3] };
    let mut around = Box32 { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };
    for (i, child) in boxes.iter().enumerate() {
        for axis in 0..3 {
            node.min[axis][i] = child.min[axis];
            node.max[axis][i] = child.max[axis];
        }
        around = Box32 { min: around.min.min(child.min), max: around.max.max(child.max) };
    }
    (node, around)
}

fn serial_bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(*p), max.max(*p)))
}

fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    let join = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
    points.par_chunks(1 << 14).map(serial_bounds).reduce(|| (DVec3::INFINITY, DVec3::NEG_INFINITY), join)
}

/// Points in the order of the tree's leaves.
fn in_tree_order(points: &[DVec3]) -> Ordered {
    let mut items: Vec<(DVec3, u32)> = points.par_iter().enumerate().map(|(i, p)| (*p, i as u32)).collect();
    halve(&mut items);
    let (points, order) = items.into_par_iter().unzip();
    Ordered { points, order }
}

/// Orders the points so that every aligned run of 8, 16, 32, ... points is one half of a cut across the longest axis.
fn halve(items: &mut [(DVec3, u32)]) {
    if items.len() <= WIDTH {
        return;
    }
    let left = items.len().next_power_of_two() / 2;
    let (min, max) =
        items.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), (p, _)| (min.min(*p), max.max(*p)));
    let axis = (max - min).max_position();
    items.select_nth_unstable_by(left, |a, b| a.0[axis].total_cmp(&b.0[axis]));
    let (low, high) = items.split_at_mut(left);
    if left > SERIAL {
        rayon::join(|| halve(low), || halve(high));
    } else {
        halve(low);
        halve(high);
    }
}

/// Points along the Morton curve through a cube around them.
fn in_morton_order(points: &[DVec3], min: DVec3, max: DVec3) -> Ordered {
    let side = (max - min).max_element();
    let cells = f64::from((1_u32 << KEY_BITS) - 1);
    let scale = if side > 0.0 { cells / side } else { 0.0 };
    let mut keys: Vec<(u64, u32)> = points
        .par_iter()
        .enumerate()
        .map(|(i, p)| {
            let cell = (*p - min) * scale;
            (spread(cell.x as u64) | spread(cell.y as u64) << 1 | spread(cell.z as u64) << 2, i as u32)
        })
        .collect();
    keys.par_sort_unstable();
    let (points, order) = keys.par_iter().map(|(_, i)| (points[*i as usize], *i)).unzip();
    Ordered { points, order }
}

/// The low 21 bits with two zeros after each.
fn spread(value: u64) -> u64 {
    let mut v = value & 0x1f_ffff;
    v = (v | v << 32) & 0x001f_0000_0000_ffff;
    v = (v | v << 16) & 0x001f_0000_ff00_00ff;
    v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
    v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn brute(points: &[DVec3], query: DVec3) -> f64 {
        points.iter().map(|p| p.distance(query)).fold(f64::INFINITY, f64::min)
    }

    fn assert_exact(points: &[DVec3], queries: &[DVec3]) {
        let index = NearestIndex::build(points).unwrap();
        let nearest = index.nearest(queries).unwrap();
        let distances = index.distances(queries).unwrap();
        assert_eq!(index.len(), points.len());
        for ((query, found), distance) in queries.iter().zip(nearest).zip(distances) {
            let expected = brute(points, *query);
            // The last bits of a sum of three squares and its root.
            assert!((found.distance - expected).abs() <= 1e-15 + 4e-16 * expected, "{query}: {found:?} {expected}");
            assert!((points[found.index as usize].distance(*query) - expected).abs() <= 1e-15 + 4e-16 * expected);
            assert_eq!(found.distance, distance);
        }
    }

    fn coordinate() -> impl Strategy<Value = f64> {
        prop_oneof![-3.0..3.0, (-4_i8..4).prop_map(f64::from), -1e-6..1e-6, 1000.0..1000.1, -1e8..1e8]
    }

    fn cloud(most: usize) -> impl Strategy<Value = Vec<DVec3>> {
        prop::collection::vec([coordinate(), coordinate(), coordinate()].prop_map(DVec3::from_array), 1..most)
    }

    proptest! {
        #[test]
        fn distances_are_those_of_trying_every_point(points in cloud(300), queries in cloud(100)) {
            assert_exact(&points, &queries);
        }

        #[test]
        fn points_of_a_line_or_a_plane_are_found(
            places in prop::collection::vec((-5.0..5.0, -5.0..5.0), 1..400),
            flat in 0.0..=1.0_f64,
            queries in cloud(50),
        ) {
            let points: Vec<_> = places
                .iter()
                .map(|(u, v)| DVec3::new(1.0, 2.0, 0.5) + *u * DVec3::new(1.0, 0.2, -0.4) + *v * flat.floor() * DVec3::Y)
                .collect();
            assert_exact(&points, &queries);
            assert_exact(&points, &points);
        }
    }

    #[test]
    fn far_sets_and_equal_points_are_exact() {
        let grid: Vec<_> =
            (0..2000).map(|i| DVec3::new((i % 10) as f64, (i / 10 % 20) as f64, (i / 200) as f64) * 0.1).collect();
        for offset in [0.0, 0.05, 7.0, 1e3, 1e6, 9e8] {
            let moved: Vec<_> = grid.iter().step_by(7).map(|p| *p + DVec3::new(offset, -offset / 3.0, 0.01)).collect();
            assert_exact(&grid, &moved);
            assert_exact(&moved, &grid);
        }
        let equal = vec![DVec3::new(0.1, 0.2, 0.3); 5000];
        assert_exact(&equal, &equal[..3]);
        assert_exact(&equal, &grid[..50]);
        let repeated: Vec<_> = grid.iter().chain(&grid).chain(&grid).copied().collect();
        assert_exact(&repeated, &grid);
    }

    #[test]
    fn sets_of_every_small_size_and_around_powers_of_eight_are_complete() {
        let point = |i: usize| {
            DVec3::new((i as f64 * 0.618_034).fract(), (i as f64 * 0.414_214).fract(), (i as f64 * 0.732_051).fract())
        };
        for count in (1..70).chain([511, 512, 513, 4095, 4096, 4097]) {
            let points: Vec<_> = (0..count).map(point).collect();
            let found = NearestIndex::build(&points).unwrap().nearest(&points).unwrap();
            assert!(found.iter().enumerate().all(|(i, n)| n.distance == 0.0 && n.index as usize == i), "{count}");
        }
    }

    #[test]
    fn what_cannot_be_measured_is_refused_with_a_count() {
        assert_eq!(NearestIndex::build(&[]).unwrap_err(), NearestError::Empty);
        let holes = [DVec3::ZERO, DVec3::new(f64::NAN, 0.0, 0.0), DVec3::new(0.0, f64::INFINITY, 0.0), DVec3::Y * 2e9];
        let refused = NearestError::Unusable { count: 3, first: 1 };
        assert_eq!(NearestIndex::build(&holes).unwrap_err(), refused);
        let index = NearestIndex::build(&[DVec3::X]).unwrap();
        assert_eq!(index.distances(&holes).unwrap_err(), refused);
        assert_eq!(index.distances(&[]).unwrap(), Vec::<f64>::new());
        assert_eq!(finite_points(&holes), FinitePoints { points: vec![DVec3::ZERO], dropped: 3 });
    }

    #[test]
    fn the_number_of_threads_has_no_influence() {
        let points: Vec<_> = (0..40_000).map(|i| DVec3::new((i % 200) as f64, (i / 200) as f64, 0.0)).collect();
        let queries: Vec<_> = points.iter().map(|p| *p + DVec3::new(0.5, 0.5, 1.0)).collect();
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| NearestIndex::build(&points).unwrap().nearest(&queries).unwrap())
        };
        assert_eq!(with(1), with(3), "even between equally near points");
    }
}
