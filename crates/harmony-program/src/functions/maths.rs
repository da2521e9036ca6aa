//! Numbers, vectors and chance.

use std::f64::consts::TAU;
use std::sync::{Arc, Mutex};

use glam::DVec3;
use starlark::values::Value;

use crate::call::{Call, Function, Outcome};
use crate::error::Complaint;
use crate::numbers::{items, number, vector};
use crate::thing::{self, Kind};

/// Chance: SplitMix64 (Steele, Lea, Flood: Fast splittable pseudorandom number generators, 2014).
#[derive(Debug, Clone)]
pub(crate) struct Dice {
    state: u64,
}

impl Dice {
    pub fn new(seed: u32) -> Self {
        Self { state: u64::from(seed).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5851_f42d_4c95_7f2d }
    }

    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From 0 to below 1.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

const ANY: std::ops::RangeInclusive<f64> = -1e12..=1e12;

pub(crate) fn functions() -> Vec<Function> {
    vec![
        Function::new("vec(x=0, y=0, z=0)", |c| {
            let v = c.position()?;
            c.value(Kind::Vector(v))
        }),
        Function::new("seq(a, b, step)", |c| {
            let (a, b, step) = (c.need_number("a", ANY)?, c.need_number("b", ANY)?, c.need_number("step", ANY)?);
            // From a on, while below b (above it for a negative step), as range() does.
            let n = if step == 0.0 { f64::INFINITY } else { ((b - a) / step - 1e-9).ceil().max(0.0) };
            if n > 20_000.0 {
                return Err(Complaint::limit(format!("seq() of {n} numbers; at most 20000 are allowed")).into());
            }
            let list: Vec<f64> = (0..n as u32).map(|i| a + step * f64::from(i)).collect();
            Ok(c.heap.alloc(list))
        }),
        Function::new("lerp(a, b, t)", |c| {
            let t = c.need_number("t", ANY)?;
            let (a, b) = (c.need("a")?, c.need("b")?);
            match (number(a), number(b), vector(a), vector(b)) {
                (Some(a), Some(b), ..) => Ok(c.heap.alloc(a + (b - a) * t)),
                (.., Some(a), Some(b)) => c.value(Kind::Vector(a.lerp(b, t))),
                _ => Err(c.refuse("a", a, "a number or point, and b the same").into()),
            }
        }),
        Function::new("clamp(x, a=0, b=1)", |c| {
            let (x, a, b) = (c.need_number("x", ANY)?, c.number("a", 0.0, ANY)?, c.number("b", 1.0, ANY)?);
            Ok(c.heap.alloc(x.max(a).min(b)))
        }),
        Function::new("noise(p, scale=1, seed=0)", |c| {
            let value = c.need("p")?;
            let p = match (number(value), vector(value), crate::numbers::numbers(value).as_deref()) {
                (Some(x), ..) => DVec3::new(x, 0.0, 0.0),
                (_, Some(v), _) => v,
                (.., Some(&[x, y])) => DVec3::new(x, y, 0.0),
                _ => return Err(c.refuse("p", value, "a number or a point").into()),
            };
            let scale = c.number("scale", 1.0, 1e-6..=1e6)?;
            let seed = if c.given("seed").is_some() { c.seed()? } else { 0 };
            Ok(c.heap.alloc(noise(p / scale, seed)))
        }),
        Function::new("rng(seed=None)", |c| {
            let dice = Dice::new(c.seed()?);
            c.value(Kind::Dice(Arc::new(Mutex::new(dice))))
        }),
        Function::new("round(x, n=0)", |c| {
            let x = c.need_number("x", ANY)?;
            if c.given("n").is_none() {
                return Ok(integer(c, libm::rint(x)));
            }
            let k = libm::pow(10.0, f64::from(c.count("n", 0, 0..=12)?));
            Ok(c.heap.alloc(libm::rint(x * k) / k))
        }),
        Function::new("sum(items, start=0)", sum),
        Function::new("pow(x, y)", |c| power(c)),
        Function::new("hypot(x, y)", |c| {
            Ok(c.heap.alloc(libm::hypot(c.need_number("x", ANY)?, c.need_number("y", ANY)?)))
        }),
    ]
}

macro_rules! one {
    ($signature:literal, $range:expr, $map:expr) => {
        Function::new($signature, |c| {
            let x = c.need_number("x", $range)?;
            let map: fn(f64) -> f64 = $map;
            finite(c, map(x))
        })
    };
}

pub(crate) fn math() -> Vec<Function> {
    vec![
        one!("math.sin(x)", ANY, libm::sin),
        one!("math.cos(x)", ANY, libm::cos),
        one!("math.tan(x)", ANY, libm::tan),
        one!("math.asin(x)", -1.0..=1.0, libm::asin),
        one!("math.acos(x)", -1.0..=1.0, libm::acos),
        one!("math.atan(x)", ANY, libm::atan),
        one!("math.sinh(x)", -700.0..=700.0, libm::sinh),
        one!("math.cosh(x)", -700.0..=700.0, libm::cosh),
        one!("math.tanh(x)", ANY, libm::tanh),
        one!("math.sqrt(x)", 0.0..=1e12, libm::sqrt),
        one!("math.exp(x)", -700.0..=700.0, libm::exp),
        one!("math.radians(x)", ANY, f64::to_radians),
        one!("math.degrees(x)", ANY, f64::to_degrees),
        one!("math.fabs(x)", ANY, f64::abs),
        Function::new("math.log(x, base=None)", |c| {
            let x = libm::log(c.need_number("x", 1e-300..=1e12)?);
            let base = if c.given("base").is_some() { libm::log(c.need_number("base", 1e-6..=1e12)?) } else { 1.0 };
            finite(c, x / base)
        }),
        Function::new("math.atan2(y, x)", |c| {
            Ok(c.heap.alloc(libm::atan2(c.need_number("y", ANY)?, c.need_number("x", ANY)?)))
        }),
        Function::new("math.pow(x, y)", |c| power(c)),
        Function::new("math.hypot(x, y)", |c| {
            Ok(c.heap.alloc(libm::hypot(c.need_number("x", ANY)?, c.need_number("y", ANY)?)))
        }),
        Function::new("math.fmod(x, y)", |c| {
            let (x, y) = (c.need_number("x", ANY)?, c.need_number("y", ANY)?);
            finite(c, libm::fmod(x, y))
        }),
        Function::new("math.floor(x)", |c| Ok(integer(c, libm::floor(c.need_number("x", ANY)?)))),
        Function::new("math.ceil(x)", |c| Ok(integer(c, libm::ceil(c.need_number("x", ANY)?)))),
    ]
}

pub(crate) fn vector_methods() -> Vec<Function> {
    vec![
        Function::new("dot(b)", |c| {
            let b = c.vector("b", None)?;
            Ok(c.heap.alloc(own(c).dot(b)))
        }),
        Function::new("cross(b)", |c| {
            let b = c.vector("b", None)?;
            c.value(Kind::Vector(own(c).cross(b)))
        }),
    ]
}

pub(crate) fn dice_methods() -> Vec<Function> {
    vec![
        Function::new("uniform(a=0, b=1)", |c| {
            let (a, b) = (c.number("a", 0.0, ANY)?, c.number("b", 1.0, ANY)?);
            Ok(c.heap.alloc(a + (b - a) * throw(c)))
        }),
        Function::new("random()", |c| Ok(c.heap.alloc(throw(c)))),
        Function::new("normal(m=0, s=1)", |c| {
            let (m, s) = (c.number("m", 0.0, ANY)?, c.number("s", 1.0, ANY)?);
            // Box and Muller.
            let (u, v) = (throw(c), throw(c));
            Ok(c.heap.alloc(m + s * libm::sqrt(-2.0 * libm::log(1.0 - u)) * libm::cos(TAU * v)))
        }),
        Function::new("int(a, b)", |c| {
            let (a, b) = (c.need_number("a", -1e9..=1e9)?, c.need_number("b", -1e9..=1e9)?);
            // Both ends included, as randint() has them.
            let x = libm::floor(a + (b - a + 1.0) * throw(c)).min(b).max(a);
            Ok(integer(c, x))
        }),
        Function::new("pick(items)", |c| {
            let value = c.need("items")?;
            let list = items(value).filter(|l| !l.is_empty()).ok_or_else(|| c.refuse("items", value, "a list"))?;
            Ok(list[((throw(c) * list.len() as f64) as usize).min(list.len() - 1)])
        }),
    ]
}

fn own(c: &Call<'_, '_>) -> DVec3 {
    match c.receiver {
        Some(Kind::Vector(v)) => v,
        _ => DVec3::ZERO,
    }
}

fn throw(c: &Call<'_, '_>) -> f64 {
    match &c.receiver {
        Some(Kind::Dice(dice)) => dice.lock().map_or(0.5, |mut d| d.unit()),
        _ => 0.5,
    }
}

fn finite<'v>(c: &Call<'v, '_>, x: f64) -> Outcome<'v> {
    if x.is_finite() { Ok(c.heap.alloc(x)) } else { Err(Complaint::new("the result is not a number").into()) }
}

fn integer<'v>(c: &Call<'v, '_>, x: f64) -> Value<'v> {
    if x.abs() <= 2e9 { c.heap.alloc(x as i32) } else { c.heap.alloc(x) }
}

fn power<'v>(c: &Call<'v, '_>) -> Outcome<'v> {
    finite(c, libm::pow(c.need_number("x", ANY)?, c.need_number("y", -1000.0..=1000.0)?))
}

fn sum<'v>(c: &mut Call<'v, '_>) -> Outcome<'v> {
    let mut total = c.given("start").unwrap_or_else(|| c.heap.alloc(0));
    for &item in c.elements("items")? {
        if number(item).is_none() && vector(item).is_none() {
            let is = thing::word(item);
            return Err(Complaint::new(format!("sum() of a {is}: numbers and vectors only")).into());
        }
        // A tuple would be joined to the others; here it is a point.
        let item: Value<'v> = match (number(item), vector(item)) {
            (None, Some(v)) => c.heap.alloc(thing::Thing::from(Kind::Vector(v))),
            _ => item,
        };
        total = total.add(item, c.heap)?;
    }
    Ok(total)
}

/// Gradient noise over a cubic lattice (Perlin, Improving noise, 2002, with hashed gradients): about -1 to 1.
fn noise(p: DVec3, seed: u32) -> f64 {
    let p = p.clamp(DVec3::splat(-1e9), DVec3::splat(1e9));
    let cell = p.floor();
    let f = p - cell;
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let corner = |dx: f64, dy: f64, dz: f64| {
        let at = cell + DVec3::new(dx, dy, dz);
        let mut h = u64::from(seed) ^ 0x9e37_79b9_7f4a_7c15;
        for x in [at.x as i64, at.y as i64, at.z as i64] {
            h = (h ^ x as u64).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            h ^= h >> 29;
        }
        let pick = |shift: u32| ((h >> shift) & 0xffff) as f64 / 32_767.5 - 1.0;
        let gradient = DVec3::new(pick(0), pick(16), pick(32)).try_normalize().unwrap_or(DVec3::X);
        gradient.dot(f - DVec3::new(dx, dy, dz))
    };
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let (u, v, w) = (fade(f.x), fade(f.y), fade(f.z));
    let line = |y: f64, z: f64| mix(corner(0.0, y, z), corner(1.0, y, z), u);
    1.4 * mix(mix(line(0.0, 0.0), line(1.0, 0.0), v), mix(line(0.0, 1.0), line(1.0, 1.0), v), w)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chance_is_even_and_repeats_with_its_seed() {
        let mut dice = Dice::new(7);
        let mean = (0..10_000).map(|_| dice.unit()).sum::<f64>() / 10_000.0;
        // Standard error of the mean: 0.289 / 100.
        assert!((mean - 0.5).abs() <= 0.012, "{mean}");
        assert_eq!(Dice::new(3).unit(), Dice::new(3).unit());
        assert_ne!(Dice::new(3).unit(), Dice::new(4).unit());
    }

    #[test]
    fn noise_is_zero_on_the_lattice_smooth_and_bounded() {
        let mut least = f64::INFINITY;
        let mut most = f64::NEG_INFINITY;
        for i in 0..4000 {
            let p = DVec3::new(f64::from(i) * 0.037, f64::from(i) * 0.011, 0.3);
            let (a, b) = (noise(p, 1), noise(p + DVec3::splat(1e-6), 1));
            assert!((a - b).abs() <= 1e-4);
            least = least.min(a);
            most = most.max(a);
        }
        assert!(noise(DVec3::new(3.0, -2.0, 5.0), 1).abs() <= 1e-12);
        assert!(least > -1.8 && most < 1.8 && most - least > 0.8, "{least} {most}");
    }
}
