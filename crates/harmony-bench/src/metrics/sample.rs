//! Points on surfaces, uniformly by area, from a seed.

use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::soup::{Triangle, area};

/// Points drawn by one stream of the generator. Fixed, so that the number of threads has no influence.
const BATCH: usize = 1 << 14;

/// There is no surface to draw from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("none of {triangles} triangles has an area")]
pub struct NoSurface {
    /// Triangles, all of them degenerate.
    pub triangles: usize,
}

/// Which random numbers a sampling uses: other draws of the same seed are independent of each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Seed {
    /// Seed of a comparison.
    pub seed: u64,
    /// Number of the sampling in it.
    pub draw: u32,
}

/// Points on a surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceSample {
    /// The points, in the triangles' frame and unit.
    pub points: Vec<DVec3>,
    /// Triangles left out: without area, or with corners that are not finite.
    pub skipped: usize,
    /// Area of the others.
    pub area: f64,
}

/// Draws `count` points uniformly by area (inverse square-root map: R. Osada et al., "Shape Distributions", TOG 2002).
///
/// # Errors
/// [`NoSurface`] when no triangle has an area.
pub fn sample_surface(triangles: &[Triangle], count: usize, seed: Seed) -> Result<SurfaceSample, NoSurface> {
    let mut total = 0.0;
    // The end of each usable triangle's share of the total area.
    let (ends, usable): (Vec<f64>, Vec<&Triangle>) = triangles
        .iter()
        .filter_map(|t| {
            let area = area(t);
            (area > 0.0 && area.is_finite()).then(|| {
                total += area;
                (total, t)
            })
        })
        .unzip();
    let Some(last) = usable.len().checked_sub(1) else {
        return Err(NoSurface { triangles: triangles.len() });
    };
    let mut points = vec![DVec3::ZERO; count];
    points.par_chunks_mut(BATCH).enumerate().for_each(|(batch, points)| {
        let mut numbers = ChaCha8Rng::seed_from_u64(seed.seed);
        numbers.set_stream(u64::from(seed.draw) << 32 | batch as u64);
        for point in points {
            let place = numbers.random::<f64>() * total;
            let [a, b, c] = usable[ends.partition_point(|end| *end <= place).min(last)];
            let (root, v) = (numbers.random::<f64>().sqrt(), numbers.random::<f64>());
            *point = *a * (1.0 - root) + *b * (root * (1.0 - v)) + *c * (root * v);
        }
    });
    Ok(SurfaceSample { points, skipped: triangles.len() - usable.len(), area: total })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEED: Seed = Seed { seed: 7, draw: 0 };

    #[test]
    fn points_lie_on_the_triangles_in_proportion_to_their_areas() {
        let (o, x, y, z) = (DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z);
        // Areas 0.5 and 1.5, one a needle, one not finite.
        let soup = [[o, x, y], [z, z + 3.0 * x, z + y], [o, x, 2.0 * x], [o, x, DVec3::NAN]];
        let sample = sample_surface(&soup, 40_000, SEED).unwrap();
        assert_eq!((sample.points.len(), sample.skipped), (40_000, 2));
        assert!((sample.area - 2.0).abs() <= 1e-12);
        let (low, high): (Vec<DVec3>, Vec<DVec3>) = sample.points.iter().partition(|p| p.z == 0.0);
        // Five standard deviations of a share of 0.25, and of a mean over 10,000.
        assert!((low.len() as f64 / 40_000.0 - 0.25).abs() <= 5.0 * (0.1875_f64 / 40_000.0).sqrt());
        assert!(low.iter().all(|p| p.x >= 0.0 && p.y >= 0.0 && p.x + p.y <= 1.0 + 1e-12));
        assert!(
            high.iter()
                .all(|p| (p.z - 1.0).abs() <= 1e-15 && p.x >= 0.0 && p.y >= 0.0 && p.x / 3.0 + p.y <= 1.0 + 1e-12)
        );
        let mean = low.iter().sum::<DVec3>() / low.len() as f64;
        assert!((mean - DVec3::new(1.0, 1.0, 0.0) / 3.0).abs().max_element() <= 5.0 * 0.236 / 100.0);
    }

    #[test]
    fn a_seed_gives_the_same_points_on_any_number_of_threads() {
        let soup = [[DVec3::ZERO, DVec3::X, DVec3::Y]];
        let draw = |threads, seed| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| sample_surface(&soup, 50_000, seed).unwrap().points)
        };
        assert_eq!(draw(1, SEED), draw(3, SEED));
        let (first, other) = (draw(2, SEED), draw(2, Seed { draw: 1, ..SEED }));
        assert!(first.iter().zip(&other).all(|(a, b)| a != b));
        assert_eq!(draw(2, SEED)[..20_000], sample_surface(&soup, 20_000, SEED).unwrap().points, "a prefix");
    }

    #[test]
    fn nothing_to_draw_from_is_an_error() {
        assert_eq!(sample_surface(&[], 5, SEED), Err(NoSurface { triangles: 0 }));
        assert_eq!(sample_surface(&[[DVec3::ONE; 3]], 5, SEED), Err(NoSurface { triangles: 1 }));
    }
}
