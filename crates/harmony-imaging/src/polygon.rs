//! Filled polygons.

use harmony_scene::{ImageSize, Mask};

/// The pixels of an image whose centres lie inside a polygon (even-odd); points that are not finite are skipped.
pub fn filled(points: &[[f64; 2]], size: ImageSize) -> Mask {
    let inside = rasterize(points, size.width as usize, size.height as usize);
    Mask::from_fn(size, |x, y| inside[y as usize * size.width as usize + x as usize])
}

/// One polygon that covers what several cover (even-odd), joined by bridges without area; `None` for none.
pub fn joined(pieces: &[Vec<[f64; 2]>]) -> Option<Vec<[f64; 2]>> {
    let pieces: Vec<&Vec<[f64; 2]>> = pieces.iter().filter(|p| p.len() >= 3).collect();
    let (first, others) = pieces.split_first()?;
    let mut all = (*first).clone();
    let start = first[0];
    for piece in others {
        // Out along the bridge, round the piece, and back along it.
        all.push(start);
        all.extend(piece.iter());
        all.push(piece[0]);
    }
    Some(all)
}

/// Pixels of a `width` x `height` grid whose centre lies inside the polygon (even-odd), row-major.
///
/// Points that are not finite are skipped; fewer than three leave the grid empty.
pub(crate) fn rasterize(points: &[[f64; 2]], width: usize, height: usize) -> Vec<bool> {
    let mut inside = vec![false; width * height];
    let points: Vec<[f64; 2]> = points.iter().copied().filter(|p| p[0].is_finite() && p[1].is_finite()).collect();
    if points.len() < 3 {
        return inside;
    }
    let mut crossings: Vec<f64> = Vec::new();
    for y in 0..height {
        let yc = y as f64 + 0.5;
        crossings.clear();
        for (i, a) in points.iter().enumerate() {
            let b = points[(i + 1) % points.len()];
            if (a[1] <= yc) != (b[1] <= yc) {
                crossings.push(a[0] + (yc - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
            }
        }
        crossings.sort_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            // Centres x + 0.5 in [pair.0, pair.1).
            let from = (pair[0] - 0.5).ceil().clamp(0.0, width as f64) as usize;
            let to = (pair[1] - 0.5).ceil().clamp(0.0, width as f64) as usize;
            inside[y * width + from..y * width + to.max(from)].fill(true);
        }
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_covers_half_of_its_box_and_a_hole_stays_open() {
        let n = rasterize(&[[0.0, 0.0], [40.0, 0.0], [0.0, 40.0]], 50, 50).iter().filter(|b| **b).count();
        assert!((780..=820).contains(&n), "{n}");
        // A square run twice around in a figure of eight leaves the doubly covered part out.
        let eight = [
            [0.0, 0.0],
            [10.0, 0.0],
            [10.0, 10.0],
            [0.0, 10.0],
            [0.0, 0.0],
            [2.0, 2.0],
            [8.0, 2.0],
            [8.0, 8.0],
            [2.0, 8.0],
            [2.0, 2.0],
        ];
        assert_eq!(rasterize(&eight, 12, 12).iter().filter(|b| **b).count(), 100 - 36);
        assert!(rasterize(&[[f64::NAN, 0.0], [1.0, 1.0], [2.0, 0.0]], 5, 5).iter().all(|b| !b));
        assert_eq!(
            rasterize(&[[-9.0, -9.0], [99.0, -9.0], [99.0, 99.0], [-9.0, 99.0]], 5, 4).iter().filter(|b| **b).count(),
            20
        );
    }

    #[test]
    fn pieces_are_joined_without_what_lies_between_them() {
        let square = |x: f64, y: f64| vec![[x, y], [x + 4.0, y], [x + 4.0, y + 4.0], [x, y + 4.0]];
        let (a, b, c) = (square(1.0, 1.0), square(11.3, 7.0), square(20.0, 2.0));
        let all = joined(&[a.clone(), b.clone(), c.clone()]).unwrap();
        let of = |p: &[[f64; 2]]| rasterize(p, 30, 20);
        let each: Vec<Vec<bool>> = [a, b, c].iter().map(|p| of(p)).collect();
        let wanted: Vec<bool> = (0..30 * 20).map(|i| each.iter().any(|one| one[i])).collect();
        assert_eq!(of(&all), wanted);
        assert_eq!(wanted.iter().filter(|b| **b).count(), 48);
        assert!(joined(&[vec![[0.0; 2]; 2]]).is_none());
    }
}
