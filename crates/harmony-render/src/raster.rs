//! Scan conversion of one band of rows into a visibility buffer: nearest reciprocal depth and triangle number.
//!
//! A pixel's value depends on the pixel and the triangle alone, never on the window or the band, so that a window
//! equals the same part of the whole image bit by bit.

use crate::assemble::{Piece, STEPS, edge_bias, first_pixel, last_pixel};
use crate::prepare::{ALPHA_CUT, Draw};
use crate::shade::Facet;

/// No triangle.
pub(crate) const NOTHING: u32 = u32::MAX;

/// Side of the box, in sub-pixel steps, up to which 32-bit edge functions cannot overflow (64 pixels: products stay
/// below 2^29).
const SMALL: i32 = 64 * STEPS;

/// Side of the box, in sub-pixel steps, up to which depth is interpolated between the snapped corners.
///
/// Snapping moves depths as it moves corners, by up to 1/512 pixel; on larger triangles, where that could be seen
/// on steep faces, the plane of the triangle is used as it is.
const TINY: i32 = 4 * STEPS;

/// A rectangle of samples.
pub(crate) struct Band<'b> {
    /// Image column and row of the first sample.
    pub(crate) x0: i32,
    pub(crate) y0: i32,
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Where in its pixel each sample lies, in sub-pixel steps from the centre.
    pub(crate) offset: [i32; 2],
    /// Reciprocal depth, 0 where nothing is.
    pub(crate) inverse_depth: &'b mut [f32],
    /// Triangle number or [`NOTHING`].
    pub(crate) triangle: &'b mut [u32],
}

impl Band<'_> {
    /// Sets everything to nothing.
    pub(crate) fn clear(&mut self) {
        self.inverse_depth.fill(0.0);
        self.triangle.fill(NOTHING);
    }

    /// Draws pieces in order; of equal depths the first stays.
    pub(crate) fn draw(&mut self, draw: &Draw, pieces: &[Piece]) {
        let mut run = 0;
        for piece in pieces {
            run = draw.run_of(piece.triangle, run);
            let cut_out = draw.runs[run].cut_out;
            let [ox, oy] = self.offset;
            // Moving the piece against the sample puts samples on whole pixels.
            let ([ax, bx, cx], [ay, by, cy]) = (piece.x, piece.y);
            let p = Piece { x: [ax - ox, bx - ox, cx - ox], y: [ay - oy, by - oy, cy - oy], ..*piece };
            let (min_x, max_x) = range(p.x);
            let (min_y, max_y) = range(p.y);
            let b = Bounds {
                left: first_pixel(min_x).max(self.x0),
                right: last_pixel(max_x).min(self.x0 + self.width as i32 - 1),
                top: first_pixel(min_y).max(self.y0),
                bottom: last_pixel(max_y).min(self.y0 + self.height as i32 - 1),
            };
            if b.left > b.right || b.top > b.bottom {
                continue;
            }
            let side = (max_x - min_x).max(max_y - min_y);
            if side <= TINY && !cut_out {
                let depth = Between::new(&p);
                self.small(&p, b, |x, y| depth.at(x, y));
            } else {
                let depth = Plane::new(draw, &p, run, self.offset);
                if cut_out {
                    let facet = Facet::new(draw, &draw.vertices(draw.corners(p.triangle, run), run), run);
                    let [dx, dy] = [ox, oy].map(|o| o as f32 / STEPS as f32);
                    let keep = |x: i32, y: i32| facet.alpha(draw, run, x as f32 + dx, y as f32 + dy) >= ALPHA_CUT;
                    self.large(&p, b, &depth, keep);
                } else if side <= SMALL {
                    self.small(&p, b, |x, y| depth.at(x, y));
                } else {
                    self.large(&p, b, &depth, |_, _| true);
                }
            }
        }
    }

    /// Hands out pixel, reciprocal depth and triangle of every sample of the pieces that is nearer than what is there.
    pub(crate) fn visit(&self, draw: &Draw, pieces: &[Piece], mut found: impl FnMut(usize, f32, u32)) {
        let mut run = 0;
        let [ox, oy] = self.offset;
        for piece in pieces {
            run = draw.run_of(piece.triangle, run);
            let ([ax, bx, cx], [ay, by, cy]) = (piece.x, piece.y);
            let p = Piece { x: [ax - ox, bx - ox, cx - ox], y: [ay - oy, by - oy, cy - oy], ..*piece };
            let (min_y, max_y) = range(p.y);
            let plane = Plane::new(draw, &p, run, self.offset);
            let (left, right) = (self.x0, self.x0 + self.width as i32 - 1);
            let (top, bottom) =
                (first_pixel(min_y).max(self.y0), last_pixel(max_y).min(self.y0 + self.height as i32 - 1));
            for py in top..=bottom {
                let Some((from, to)) = span(&p, py, left, right) else { continue };
                let row = (py - self.y0) as usize * self.width;
                for px in from..=to {
                    let at = row + (px - self.x0) as usize;
                    let w = plane.at(px, py);
                    if w > self.inverse_depth[at] {
                        found(at, w, p.triangle);
                    }
                }
            }
        }
    }

    /// Edge functions in 32 bits over the whole box; `depth_at` gives the reciprocal depth of a pixel.
    #[inline]
    fn small(&mut self, p: &Piece, b: Bounds, depth_at: impl Fn(i32, i32) -> f32) {
        let [x, y] = [p.x, p.y];
        let step = |i: usize, j: usize| {
            let (dx, dy) = (x[j] - x[i], y[j] - y[i]);
            let at = dx * (b.top * STEPS - y[i]) - dy * (b.left * STEPS - x[i]);
            (at - edge_bias(dx, dy), -dy * STEPS, dx * STEPS)
        };
        let (mut e0, x0, y0) = step(0, 1);
        let (mut e1, x1, y1) = step(1, 2);
        let (mut e2, x2, y2) = step(2, 0);
        let mut row = (b.top - self.y0) as usize * self.width + (b.left - self.x0) as usize;
        let n = (b.right - b.left + 1) as usize;
        for py in b.top..=b.bottom {
            let (mut f0, mut f1, mut f2) = (e0, e1, e2);
            let depths = &mut self.inverse_depth[row..row + n];
            let owners = &mut self.triangle[row..row + n];
            for (px, (depth, owner)) in (b.left..).zip(depths.iter_mut().zip(owners)) {
                if (f0 | f1 | f2) >= 0 {
                    let w = depth_at(px, py);
                    if w > *depth {
                        *depth = w;
                        *owner = p.triangle;
                    }
                }
                f0 += x0;
                f1 += x1;
                f2 += x2;
            }
            e0 += y0;
            e1 += y1;
            e2 += y2;
            row += self.width;
        }
    }

    /// Row spans by division in 64 bits; `keep` decides on pixels that would be seen.
    #[inline]
    fn large(&mut self, p: &Piece, b: Bounds, plane: &Plane, keep: impl Fn(i32, i32) -> bool) {
        for py in b.top..=b.bottom {
            let Some((from, to)) = span(p, py, b.left, b.right) else { continue };
            let row = (py - self.y0) as usize * self.width;
            let (start, end) = (row + (from - self.x0) as usize, row + (to - self.x0) as usize);
            let depths = &mut self.inverse_depth[start..=end];
            let owners = &mut self.triangle[start..=end];
            for (px, (depth, owner)) in (from..).zip(depths.iter_mut().zip(owners)) {
                let w = plane.at(px, py);
                if w > *depth && keep(px, py) {
                    *depth = w;
                    *owner = p.triangle;
                }
            }
        }
    }
}

/// Reciprocal depth interpolated between the snapped corners of a tiny piece, in single precision.
struct Between {
    x: i32,
    y: i32,
    at_first: f32,
    gradient: [f32; 2],
    low: f32,
    high: f32,
}

impl Between {
    #[inline]
    fn new(p: &Piece) -> Self {
        let ([x, y], [w0, w1, w2]) = ([p.x, p.y], p.inverse_depth);
        let area = ((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])) as f32;
        let (d1, d2) = ((w1 - w0) / area, (w2 - w0) / area);
        let gradient = [
            d1 * (y[2] - y[0]) as f32 - d2 * (y[1] - y[0]) as f32,
            d2 * (x[1] - x[0]) as f32 - d1 * (x[2] - x[0]) as f32,
        ];
        Self { x: x[0], y: y[0], at_first: w0, gradient, low: least(w0, w1, w2), high: most(w0, w1, w2) }
    }

    #[inline]
    fn at(&self, px: i32, py: i32) -> f32 {
        let (dx, dy) = ((px * STEPS - self.x) as f32, (py * STEPS - self.y) as f32);
        hold(self.at_first + self.gradient[0] * dx + self.gradient[1] * dy, self.low, self.high)
    }
}

/// Reciprocal depth on the exact plane of a piece's triangle, held within the range of the piece's corners.
struct Plane {
    coefficients: [f64; 3],
    low: f32,
    high: f32,
}

impl Plane {
    fn new(draw: &Draw, p: &Piece, run: usize, offset: [i32; 2]) -> Self {
        let [a, b, c] = draw.inverse_depth_plane(p.triangle, run);
        let (dx, dy) = (f64::from(offset[0]) / f64::from(STEPS), f64::from(offset[1]) / f64::from(STEPS));
        let [w0, w1, w2] = p.inverse_depth;
        Self { coefficients: [a, b, c + a * dx + b * dy], low: least(w0, w1, w2), high: most(w0, w1, w2) }
    }

    /// At the sample of a pixel. NaN (a plane seen exactly edge-on) becomes the farther end.
    #[inline]
    fn at(&self, px: i32, py: i32) -> f32 {
        let [a, b, c] = self.coefficients;
        hold((a * f64::from(px) + (b * f64::from(py) + c)) as f32, self.low, self.high)
    }
}

/// `v` held within `low..=high`; `low` for NaN. Compiles to two instructions, unlike `max` and `min`.
#[inline]
fn hold(v: f32, low: f32, high: f32) -> f32 {
    let v = if v > low { v } else { low };
    if v < high { v } else { high }
}

#[derive(Clone, Copy)]
struct Bounds {
    left: i32,
    right: i32,
    top: i32,
    bottom: i32,
}

fn least(a: f32, b: f32, c: f32) -> f32 {
    let d = if a < b { a } else { b };
    if d < c { d } else { c }
}

fn most(a: f32, b: f32, c: f32) -> f32 {
    let d = if a > b { a } else { b };
    if d > c { d } else { c }
}

fn range(v: [i32; 3]) -> (i32, i32) {
    (v[0].min(v[1]).min(v[2]), v[0].max(v[1]).max(v[2]))
}

/// First and last pixel of a row inside all three edges, within `left..=right`.
fn span(p: &Piece, row: i32, left: i32, right: i32) -> Option<(i32, i32)> {
    let (mut from, mut to) = (i64::from(left), i64::from(right));
    for i in 0..3 {
        let j = (i + 1) % 3;
        let (dx, dy) = (p.x[j] - p.x[i], p.y[j] - p.y[i]);
        // Inside where `at + slope * column >= 0`.
        let at = i64::from(dx) * i64::from(row * STEPS - p.y[i]) + i64::from(dy) * i64::from(p.x[i])
            - i64::from(edge_bias(dx, dy));
        let slope = -i64::from(dy) * i64::from(STEPS);
        match slope.signum() {
            // ceil(-at / slope)
            1 => from = from.max(-at.div_euclid(slope)),
            // floor(at / -slope)
            -1 => to = to.min(at.div_euclid(-slope)),
            _ if at < 0 => return None,
            _ => {}
        }
    }
    (from <= to).then_some((from as i32, to as i32))
}
