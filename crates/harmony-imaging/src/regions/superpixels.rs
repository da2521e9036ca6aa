//! Superpixels by greedy merging.
//!
//! P. Felzenszwalb, D. Huttenlocher, "Efficient Graph-Based Image Segmentation", IJCV 59(2), 2004: neighbours are
//! joined, most alike first, while their difference is small against the variation inside both parts.

/// Constant `k` of the paper's threshold function, Lab units: larger makes larger parts.
const SCALE: f32 = 90.0;

/// Parts of a picture.
pub(super) struct Superpixels {
    /// Part of each pixel, 0, 1, 2, ... in reading order.
    pub labels: Vec<u32>,
    pub count: usize,
}

struct Forest {
    parent: Vec<u32>,
    size: Vec<u32>,
    /// Largest edge inside, plus the threshold.
    limit: Vec<f32>,
}

impl Forest {
    fn root(&mut self, mut i: u32) -> u32 {
        while self.parent[i as usize] != i {
            self.parent[i as usize] = self.parent[self.parent[i as usize] as usize];
            i = self.parent[i as usize];
        }
        i
    }

    fn join(&mut self, a: u32, b: u32, weight: f32) {
        let (keep, drop) = if self.size[a as usize] >= self.size[b as usize] { (a, b) } else { (b, a) };
        self.parent[drop as usize] = keep;
        self.size[keep as usize] += self.size[drop as usize];
        self.limit[keep as usize] = weight + SCALE / self.size[keep as usize] as f32;
    }
}

/// Divides a picture; parts are at least `least` pixels (if the picture is).
pub(super) fn divide(lab: &[[f32; 3]], width: usize, height: usize, least: usize) -> Superpixels {
    let mut edges: Vec<(f32, u32, u32)> = Vec::with_capacity(lab.len() * 4);
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            let mut join = |j: usize| {
                edges.push((crate::color::distance_squared(lab[i], lab[j]).sqrt(), i as u32, j as u32));
            };
            if x + 1 < width {
                join(i + 1);
            }
            if y + 1 < height {
                join(i + width);
                if x + 1 < width {
                    join(i + width + 1);
                }
                if x > 0 {
                    join(i + width - 1);
                }
            }
        }
    }
    edges.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
    let n = lab.len();
    let mut forest = Forest { parent: (0..n as u32).collect(), size: vec![1; n], limit: vec![SCALE; n] };
    for (weight, a, b) in &edges {
        let (a, b) = (forest.root(*a), forest.root(*b));
        if a != b && *weight <= forest.limit[a as usize] && *weight <= forest.limit[b as usize] {
            forest.join(a, b, *weight);
        }
    }
    for (weight, a, b) in &edges {
        let (a, b) = (forest.root(*a), forest.root(*b));
        if a != b && (forest.size[a as usize].min(forest.size[b as usize]) as usize) < least {
            forest.join(a, b, *weight);
        }
    }
    let mut number = vec![u32::MAX; n];
    let mut count = 0;
    let labels = (0..n as u32)
        .map(|i| {
            let root = forest.root(i) as usize;
            if number[root] == u32::MAX {
                number[root] = count;
                count += 1;
            }
            number[root]
        })
        .collect();
    Superpixels { labels, count: count as usize }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gradient_is_one_part_and_a_square_on_it_another() {
        let (w, h) = (60, 40);
        let lab: Vec<[f32; 3]> = (0..w * h)
            .map(|i| {
                let (x, y) = (i % w, i / w);
                if (20..35).contains(&x) && (10..30).contains(&y) {
                    [40.0, 50.0, 20.0]
                } else {
                    [50.0 + x as f32 * 0.5, 0.0, 0.0]
                }
            })
            .collect();
        let parts = divide(&lab, w, h, 10);
        assert_eq!(parts.count, 2);
        assert_eq!(parts.labels.iter().filter(|l| **l == 1).count(), 15 * 20);
        assert_eq!(divide(&[], 0, 0, 5).count, 0);
    }
}
