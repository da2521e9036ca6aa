//! Pillows: two sheets sewn at the seam and filled.

use glam::{DVec2, DVec3};

use super::grid::{sheet, tube};
use super::noise::noise2;
use super::sheet::Middle;
use crate::Piece;

/// Arguments of [`pillow`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PillowSpec {
    /// Width (x), depth (z), greatest thickness (y).
    pub size: [f64; 3],
    /// 0 smooth to 1 crumpled.
    pub wrinkle: f64,
    /// Radius of the piping, 0: none.
    pub piping: f64,
    /// How far the corners stand out, 0 to 1.
    pub ears: f64,
    /// Dent of the middle of the upper edge (-z: up once it leans), 0 to 1.
    pub dent: f64,
    /// Seed.
    pub seed: u32,
}

/// A distance that two particles keep.
struct Link {
    a: usize,
    b: usize,
    rest: f64,
    /// Share of the error that each takes.
    give: f64,
    /// Only pulls (a thread) instead of pushing, too.
    thread: bool,
}

/// Both sheets of a pillow as particles: the upper grid, then the inner points of the lower one.
struct Bag {
    nu: usize,
    nv: usize,
    points: Vec<DVec3>,
    links: Vec<Link>,
    triangles: Vec<[usize; 3]>,
    /// Particles of the seam.
    seam: Vec<usize>,
}

/// A pillow lying flat on `y = 0`, closed, within its width, depth and thickness.
///
/// Two flat sheets are sewn together, the seam a little shorter than the cloth, and filled to a volume: position-based
/// dynamics with one volume constraint (Muller and others, "Position based dynamics", 2007, section 4.4). Creases at
/// the seam and the corners that stand out come by themselves.
pub fn pillow(spec: &PillowSpec) -> Piece {
    let [w, d, t] = spec.size.map(|v| v.clamp(0.02, 4.0));
    let mut bag = Bag::sewn(spec, [w, d, t]);
    bag.fill(0.55 * w * d * t, 280);
    let mut sides = bag.sheets(spec, [w, d]);
    // Exactly the size asked for, standing on the floor; a pillow that lies there is flat below.
    let (mut lo, mut hi) = (DVec3::MAX, DVec3::MIN);
    for p in sides.iter_mut().flat_map(|s| &mut s.points) {
        let low = -0.30 * t;
        if p.y < low {
            p.y = low - 0.12 * t * (1.0 - libm::exp((p.y - low) / (0.12 * t)));
        }
        lo = lo.min(*p);
        hi = hi.max(*p);
    }
    let inner = DVec3::new(w - 2.0 * spec.piping, t, d - 2.0 * spec.piping).max(DVec3::splat(0.01));
    let scale = inner / (hi - lo).max(DVec3::splat(1e-6));
    for p in sides.iter_mut().flat_map(|s| &mut s.points) {
        *p = (*p - DVec3::new(f64::midpoint(lo.x, hi.x), lo.y, f64::midpoint(lo.z, hi.z))) * scale;
    }
    let seam = sides[0].hems().named("all").unwrap_or_default();
    let [upper, lower] = sides;
    let nu = upper.nu as u32;
    // Rows towards +z and columns towards +x face down: the upper sheet is turned over.
    let mut piece = turned(sheet(upper.points, upper.flat, nu));
    piece.closed = true;
    let mut under = sheet(lower.points, lower.flat, nu);
    under.closed = true;
    piece.append(&under);
    if spec.piping > 0.0 {
        tube(&mut piece, &seam, &[spec.piping], 7, true);
    }
    piece
}

/// The same sheet seen from its other side.
fn turned(mut piece: Piece) -> Piece {
    for t in &mut piece.triangles {
        t.swap(1, 2);
    }
    for n in &mut piece.normals {
        *n = -*n;
    }
    piece
}

impl Bag {
    fn sewn(spec: &PillowSpec, [w, d, t]: [f64; 3]) -> Self {
        let cell = (w.max(d) / 34.0).max(0.012);
        let nu = ((w / cell).round() as usize).clamp(10, 36) + 1;
        let nv = ((d / cell).round() as usize).clamp(10, 36) + 1;
        let wrinkle = spec.wrinkle.clamp(0.0, 1.0);
        // Filling draws the sides in; cut round sides for corners that do not stand out.
        let round = 0.10 * (1.0 - spec.ears.clamp(0.0, 1.0));
        let pattern = |i: usize, j: usize| {
            let (u, v) = (2.0 * i as f64 / (nu - 1) as f64 - 1.0, 2.0 * j as f64 / (nv - 1) as f64 - 1.0);
            let (x, z) = (u * (1.0 + round * (1.0 - v * v)), v * (1.0 + round * (1.0 - u * u)));
            DVec2::new(x * w / 2.0, z * d / 2.0)
        };
        let edge = |i: usize, j: usize| i == 0 || j == 0 || i + 1 == nu || j + 1 == nv;
        let mut points = Vec::new();
        let mut index = [vec![0; nu * nv], vec![0; nu * nv]];
        for (side, sign) in [(0, 1.0), (1, -1.0)] {
            for j in 0..nv {
                for i in 0..nu {
                    let k = j * nu + i;
                    if side == 1 && edge(i, j) {
                        index[1][k] = index[0][k];
                        continue;
                    }
                    let p = pattern(i, j);
                    let (u, v) = (i as f64 / (nu - 1) as f64, j as f64 / (nv - 1) as f64);
                    let rise = 16.0 * u * (1.0 - u) * v * (1.0 - v);
                    let bump = 0.012 * t * noise2(u * 7.0 + 3.0 * sign, v * 7.0, spec.seed);
                    index[side][k] = points.len();
                    points.push(DVec3::new(p.x, sign * (0.2 * t * rise + if edge(i, j) { 0.0 } else { bump }), p.y));
                }
            }
        }
        let mut links = Vec::new();
        let bend = 0.16 - 0.07 * wrinkle - 0.03 * wrinkle.powi(3);
        let pucker = 0.02 + 0.03 * wrinkle;
        for (side, index) in index.iter().enumerate() {
            let mut link = |a: (usize, usize), b: (usize, usize), give: f64| {
                let seam = edge(a.0, a.1) && edge(b.0, b.1) && (a.0 == b.0 || a.1 == b.1);
                if seam && side == 1 {
                    return;
                }
                let (p, q) = (pattern(a.0, a.1), pattern(b.0, b.1));
                let m = (p + q) * 0.5;
                // Cloth with more length in some places than in others crumples there.
                let slack = if seam {
                    -pucker
                } else {
                    0.02 * (wrinkle + wrinkle.powi(3))
                        * noise2(m.x / 0.11, m.y / 0.11 + 9.0 * side as f64, spec.seed ^ 3)
                };
                let rest = p.distance(q) * (1.0 + slack);
                links.push(Link { a: index[a.1 * nu + a.0], b: index[b.1 * nu + b.0], rest, give, thread: false });
            };
            for j in 0..nv {
                for i in 0..nu {
                    let steps = [(1, 0, 0.5), (0, 1, 0.5), (1, 1, 0.3), (2, 0, bend), (0, 2, bend), (2, 2, 0.5 * bend)];
                    for (a, b, give) in steps {
                        if i + a < nu && j + b < nv {
                            link((i, j), (i + a, j + b), give);
                            if a == b {
                                link((i + a, j), (i, j + b), give);
                            }
                        }
                    }
                }
            }
        }
        // A blow with the edge of the hand: threads from sheet to sheet below the middle of the upper edge.
        let dent = spec.dent.clamp(0.0, 1.0);
        if dent > 0.0 {
            let (middle, deep) = (nu / 2, (nv as f64 * 0.5) as usize);
            for j in 1..deep {
                let k = j * nu + middle;
                let open = j as f64 / deep as f64;
                links.push(Link {
                    a: index[0][k],
                    b: index[1][k],
                    rest: t * (1.0 - dent * 0.9 * (1.0 - open)),
                    give: 0.4,
                    thread: true,
                });
            }
            // The edge itself is drawn down.
            let far = index[0][(nv * 3 / 5) * nu + middle];
            let length = pattern(middle, 0).distance(pattern(middle, nv * 3 / 5));
            links.push(Link {
                a: index[0][middle],
                b: far,
                rest: length * (1.0 - 0.22 * dent),
                give: 0.4,
                thread: true,
            });
        }
        let mut triangles = Vec::new();
        for j in 0..nv - 1 {
            for i in 0..nu - 1 {
                let k = [j * nu + i, j * nu + i + 1, (j + 1) * nu + i + 1, (j + 1) * nu + i];
                let [a, b, c, d] = k.map(|k| index[0][k]);
                triangles.extend([[a, c, b], [a, d, c]]);
                let [a, b, c, d] = k.map(|k| index[1][k]);
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        let seam = (0..nu * nv).filter(|k| edge(k % nu, k / nu)).collect();
        Self { nu, nv, points, links, triangles, seam }
    }

    /// Blows it up to a volume.
    fn fill(&mut self, volume: f64, steps: usize) {
        let mut velocity = vec![DVec3::ZERO; self.points.len()];
        let mut gradient = vec![DVec3::ZERO; self.points.len()];
        for step in 0..steps {
            let target = volume * ((step + 1) as f64 / (0.5 * steps as f64)).min(1.0);
            let before = self.points.clone();
            for (p, v) in self.points.iter_mut().zip(&velocity) {
                *p += *v;
            }
            for k in 0..self.links.len() {
                // There and back, so that no side is pulled first.
                let link = &self.links[if step % 2 == 0 { k } else { self.links.len() - 1 - k }];
                let d = self.points[link.b] - self.points[link.a];
                let length = d.length();
                if length < 1e-9 || (link.thread && length < link.rest) {
                    continue;
                }
                let move_by = d * (link.give * (1.0 - link.rest / length));
                self.points[link.a] += move_by;
                self.points[link.b] -= move_by;
            }
            gradient.fill(DVec3::ZERO);
            let mut now = 0.0;
            for [a, b, c] in &self.triangles {
                let (p, q, r) = (self.points[*a], self.points[*b], self.points[*c]);
                now += p.dot(q.cross(r)) / 6.0;
                gradient[*a] += q.cross(r) / 6.0;
                gradient[*b] += r.cross(p) / 6.0;
                gradient[*c] += p.cross(q) / 6.0;
            }
            let sum: f64 = gradient.iter().map(|g| g.length_squared()).sum();
            let push = 0.6 * (target - now) / sum.max(1e-12);
            for (k, p) in self.points.iter_mut().enumerate() {
                *p += gradient[k] * push;
                velocity[k] = (*p - before[k]) * 0.93;
            }
            // The seam is stiffer than the cloth: it leaves its plane in long waves only.
            for k in &self.seam {
                self.points[*k].y *= 0.96;
            }
        }
    }

    /// The upper and the lower sheet, twice as fine; their outer points are the same ones.
    fn sheets(&self, spec: &PillowSpec, [w, d]: [f64; 2]) -> [Middle; 2] {
        let (nu, nv) = (self.nu, self.nv);
        let mut inner = nu * nv;
        let upper: Vec<DVec3> = self.points[..nu * nv].to_vec();
        let lower: Vec<DVec3> = (0..nu * nv)
            .map(|k| {
                let (i, j) = (k % nu, k / nu);
                if i == 0 || j == 0 || i + 1 == nu || j + 1 == nv {
                    return upper[k];
                }
                inner += 1;
                self.points[inner - 1]
            })
            .collect();
        let smooth = if spec.wrinkle > 0.6 { 2 } else { 4 };
        [(upper, 0.0), (lower, w + 0.1)].map(|(points, shift)| {
            let flat = (0..nu * nv)
                .map(|k| {
                    let (u, v) = ((k % nu) as f64 / (nu - 1) as f64, (k / nu) as f64 / (nv - 1) as f64);
                    DVec2::new(shift + u * w, v * d)
                })
                .collect();
            let mut side = Middle { points, flat, nu, nv };
            side.smooth(smooth);
            side.divided()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::grid::testing::{sound, volume};
    use super::*;

    fn spec() -> PillowSpec {
        PillowSpec { size: [0.68, 0.46, 0.17], wrinkle: 0.5, piping: 0.0, ears: 0.3, dent: 0.0, seed: 4 }
    }

    #[test]
    fn pillows_are_closed_and_of_the_right_size() {
        for s in [
            spec(),
            PillowSpec { piping: 0.005, ..spec() },
            PillowSpec { dent: 0.8, ears: 1.0, wrinkle: 1.0, ..spec() },
        ] {
            let p = pillow(&s);
            sound(&p);
            let (lo, hi) = p.bounds().unwrap();
            let size = hi - lo;
            for (k, (got, want)) in [(size.x, 0.68), (size.y, 0.17), (size.z, 0.46)].into_iter().enumerate() {
                assert!((got / want - 1.0).abs() < 0.02, "axis {k}: {got}, not {want}");
            }
            assert!(lo.y.abs() < 1e-9 && (lo.x + hi.x).abs() < 0.01 && (lo.z + hi.z).abs() < 0.01);
            // Filled like a pillow: more than a roof, less than a box.
            let fill = volume(&p) / (size.x * size.y * size.z);
            assert!((0.35..0.75).contains(&fill), "{fill}");
        }
    }

    #[test]
    fn a_blow_dents_the_upper_edge() {
        let edge = |dent| {
            let p = pillow(&PillowSpec { dent, wrinkle: 0.2, ..spec() });
            let near =
                |x: f64| p.positions.iter().filter(|p| (p.x - x).abs() < 0.02).map(|p| p.z).fold(f64::MAX, f64::min);
            near(0.0) - near(0.2).min(near(-0.2))
        };
        assert!(edge(1.0) > edge(0.0) + 0.02, "{} after {}", edge(1.0), edge(0.0));
    }

    #[test]
    fn seeds_matter_and_repeat() {
        assert_eq!(pillow(&spec()), pillow(&spec()));
        assert_ne!(pillow(&spec()), pillow(&PillowSpec { seed: 5, ..spec() }));
    }
}
