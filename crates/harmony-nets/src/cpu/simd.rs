//! Vector code without vector types: plain loops, compiled once for each instruction set and chosen at run time.

use std::sync::OnceLock;

/// Instruction sets that code is compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Whatever the target has.
    Portable,
    /// AVX2 and FMA.
    Avx2,
    /// AVX-512 F, VL, DQ, BW.
    Avx512,
}

impl Level {
    /// The best that this machine has. `HARMONY_SIMD=portable|avx2` takes a lower one, for tests.
    pub fn best() -> Self {
        static LEVEL: OnceLock<Level> = OnceLock::new();
        *LEVEL.get_or_init(|| {
            let found = Self::detect();
            match std::env::var("HARMONY_SIMD").as_deref() {
                Ok("portable") => Self::Portable,
                Ok("avx2") => found.min(Self::Avx2),
                _ => found,
            }
        })
    }

    #[cfg(target_arch = "x86_64")]
    fn detect() -> Self {
        use std::arch::is_x86_feature_detected as has;
        let avx2 = has!("avx2") && has!("fma");
        if avx2 && has!("avx512f") && has!("avx512vl") && has!("avx512dq") && has!("avx512bw") {
            Self::Avx512
        } else if avx2 {
            Self::Avx2
        } else {
            Self::Portable
        }
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn detect() -> Self {
        Self::Portable
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }
}

/// Defines a function whose body is compiled for every [`Level`]; the call picks the best one that the machine has.
macro_rules! for_each_level {
    ($(#[$doc:meta])* pub fn $name:ident $(<const $c:ident: $ct:ty>)? ($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? $body:block) => {
        $(#[$doc])*
        pub fn $name $(<const $c: $ct>)? ($($arg: $ty),*) $(-> $ret)? {
            #[inline(always)]
            fn body $(<const $c: $ct>)? ($($arg: $ty),*) $(-> $ret)? $body
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
                fn avx512 $(<const $c: $ct>)? ($($arg: $ty),*) $(-> $ret)? { body $(::<$c>)? ($($arg),*) }
                #[target_feature(enable = "avx2,fma")]
                fn avx2 $(<const $c: $ct>)? ($($arg: $ty),*) $(-> $ret)? { body $(::<$c>)? ($($arg),*) }
                match $crate::cpu::simd::Level::best() {
                    // SAFETY: the level was found on this machine.
                    $crate::cpu::simd::Level::Avx512 => return unsafe { avx512 $(::<$c>)? ($($arg),*) },
                    // SAFETY: as above.
                    $crate::cpu::simd::Level::Avx2 => return unsafe { avx2 $(::<$c>)? ($($arg),*) },
                    $crate::cpu::simd::Level::Portable => {}
                }
            }
            body $(::<$c>)? ($($arg),*)
        }
    };
}
pub(crate) use for_each_level;

/// `exp x`, within 2 units in the last place; below -87.3 it is 0, above 88.7 infinite.
///
/// Cody and Waite's reduction to |r| <= ln 2 / 2, then Cephes' polynomial of degree 5.
#[inline(always)]
#[expect(clippy::excessive_precision, reason = "as published")]
pub fn exp(x: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23: adding it rounds to an integer in the low bits
    let t = x.clamp(-87.3, 88.7) * std::f32::consts::LOG2_E + ROUND;
    let n = t - ROUND;
    let r = x.clamp(-87.3, 88.7) - n * 0.693_359_375 - n * -2.121_944_400_5e-4;
    let mut p = 1.987_569_150_0e-4f32;
    p = p * r + 1.398_199_950_7e-3;
    p = p * r + 8.333_451_907_3e-3;
    p = p * r + 4.166_579_589_4e-2;
    p = p * r + 1.666_666_545_9e-1;
    p = p * r + 5.000_000_120_1e-1;
    let y = p * r * r + r + 1.0;
    // 2^n in two halves, for n = 128 has no float of its own.
    let n = t.to_bits().cast_signed() - ROUND.to_bits().cast_signed();
    let half = n >> 1;
    let power = |n: i32| f32::from_bits(((n + 127) << 23).cast_unsigned());
    let y = y * power(half) * power(n - half);
    if x < -87.3 {
        0.0
    } else if x > 88.7 {
        f32::INFINITY
    } else {
        y
    }
}

/// The error function, within 4e-7; the rational approximation used by Eigen and XLA.
#[inline(always)]
#[expect(clippy::excessive_precision, reason = "as published")]
pub fn erf(x: f32) -> f32 {
    let x = x.clamp(-4.0, 4.0);
    let s = x * x;
    let mut p = -2.726_142_258_013_06e-10f32;
    p = p * s + 2.770_681_424_959_02e-8;
    p = p * s - 2.101_024_020_825_08e-6;
    p = p * s - 5.692_506_394_623_46e-5;
    p = p * s - 7.349_906_303_268_55e-4;
    p = p * s - 2.954_599_808_540_25e-3;
    p = p * s - 1.609_603_332_624_15e-2;
    let mut q = -1.456_607_184_649_96e-5f32;
    q = q * s - 2.133_740_552_789_05e-4;
    q = q * s - 1.682_826_974_382_03e-3;
    q = q * s - 7.373_329_167_204_68e-3;
    q = q * s - 1.426_473_905_141_89e-2;
    x * p / q
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_and_erf_are_near_the_true_ones() {
        for i in -9000..9000 {
            let x = i as f32 * 0.01;
            let wanted = f64::from(x).exp();
            let found = f64::from(exp(x));
            if x.abs() < 87.0 {
                assert!((found - wanted).abs() <= 2.5e-7 * wanted, "exp {x}: {found} {wanted}");
            }
            let wanted = crate::math::erf(f64::from(x) / 15.0);
            assert!((f64::from(erf(x / 15.0)) - wanted).abs() <= 4e-7, "erf {x}");
        }
        assert_eq!(exp(-200.0), 0.0);
        assert_eq!(exp(f32::NEG_INFINITY), 0.0);
        assert_eq!(exp(200.0), f32::INFINITY);
        assert!(exp(f32::NAN).is_nan());
    }
}
