//! Ground motion of an earthquake, made by rule from an intensity and a seed.
//!
//! Acceleration is noise in a band, with the spectrum of soil over rock (Kanai 1957, Tajimi 1960: a peak at
//! [`SOIL_HZ`]) cut at low frequencies (Clough and Penzien 1975) and above [`HIGHEST_HZ`], under an envelope that rises,
//! holds and fades (Jennings, Housner and Tsai 1968). It is a sum of sines with random phases, so that displacement, velocity
//! and acceleration are exact derivatives of each other, and ground that starts at rest ends where it began.
//!
//! Intensity is that of the modified Mercalli scale; its peak ground acceleration is the regression of Wald et al. 1999
//! ("Relationships between Peak Ground Acceleration, Peak Ground Velocity, and Modified Mercalli Intensity in California"):
//! `I = 3.66 log10(PGA) - 1.66` from V up, `I = 2.20 log10(PGA) + 1.00` below, PGA in cm/s2. The two horizontal components
//! are scaled so that the larger horizontal acceleration is the PGA; the vertical one has two thirds of it, as in the rule of
//! Newmark and Hall. Frame: the room's axes, metres, seconds.
//!
//! Limits: one place, no rotation of the ground, no building between ground and floor (a floor above ground sways more and
//! slower), and no record of a real earthquake.

use harmony_scene::Vec3;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Intensity where none is named: furniture moves, tall things fall.
pub const USUAL_INTENSITY: f64 = 8.0;
/// Lowest and highest intensity.
pub const INTENSITIES: (f64, f64) = (1.0, 12.0);
/// Peak of the soil's spectrum, hertz: firm ground.
const SOIL_HZ: f64 = 2.4;
/// Damping of the soil.
const SOIL_DAMPING: f64 = 0.6;
/// Below this the spectrum falls off, hertz: longer waves would carry the room away for metres.
const LOWEST_HZ: f64 = 0.4;
/// Highest frequency, hertz.
const HIGHEST_HZ: f64 = 8.0;
/// Sines of a component.
const SINES: usize = 160;
/// Vertical against horizontal peak acceleration.
const VERTICAL: f64 = 2.0 / 3.0;
/// Steps a second at which the peak is looked for.
const PEAK_STEPS: f64 = 400.0;

/// Peak ground acceleration of a modified Mercalli intensity, m/s2.
pub fn peak_acceleration(intensity: f64) -> f64 {
    let strong = (intensity + 1.66) / 3.66;
    let weak = (intensity - 1.0) / 2.2;
    let log = if intensity >= 5.0 { strong } else { weak };
    10_f64.powf(log) / 100.0
}

/// Place, velocity and acceleration of the ground.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct GroundState {
    /// Against its place at rest, metres.
    pub displacement: Vec3,
    /// m/s.
    pub velocity: Vec3,
    /// m/s2.
    pub acceleration: Vec3,
}

#[derive(Debug, Clone, Copy)]
struct Sine {
    omega: f64,
    phase: f64,
    /// Of the displacement, metres, before scaling.
    amplitude: f64,
}

/// The motion of the ground over time.
#[derive(Debug, Clone)]
pub struct GroundMotion {
    seconds: f64,
    axes: [(f64, Vec<Sine>); 3],
}

impl GroundMotion {
    /// Motion of an intensity for some seconds; the same seed gives the same motion.
    pub fn new(intensity: f64, seconds: f64, seed: u64) -> Self {
        let seconds = seconds.max(0.1);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let axes = std::array::from_fn(|_| (1.0, sines(&mut rng)));
        let mut motion = Self { seconds, axes };
        let peak = peak_acceleration(intensity);
        let steps = (seconds * PEAK_STEPS).ceil() as usize;
        let states: Vec<Vec3> = (0..=steps).map(|k| motion.at(k as f64 / PEAK_STEPS).acceleration).collect();
        let largest = |f: fn(&Vec3) -> f64| states.iter().map(f).fold(1e-9, f64::max);
        // Both horizontal components keep their ratio: the strongest moment of the two together is the peak.
        let level = largest(|a| a.x.hypot(a.z));
        let vertical = largest(|a| a.y.abs());
        motion.axes[0].0 = peak / level;
        motion.axes[2].0 = peak / level;
        motion.axes[1].0 = VERTICAL * peak / vertical;
        motion
    }

    /// How long it shakes, seconds.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// The ground at a time; at rest before and after.
    pub fn at(&self, time: f64) -> GroundState {
        let envelope = self.envelope(time);
        if envelope == [0.0; 3] {
            return GroundState::default();
        }
        let mut state = GroundState::default();
        for (axis, (scale, sines)) in self.axes.iter().enumerate() {
            let (mut d, mut v, mut a) = (0.0, 0.0, 0.0);
            for s in sines {
                let (sin, cos) = (libm::sin(s.omega * time + s.phase), libm::cos(s.omega * time + s.phase));
                d += s.amplitude * sin;
                v += s.amplitude * s.omega * cos;
                a -= s.amplitude * s.omega * s.omega * sin;
            }
            let [e, de, dde] = envelope;
            state.displacement[axis] = scale * e * d;
            state.velocity[axis] = scale * (de * d + e * v);
            state.acceleration[axis] = scale * (dde * d + 2.0 * de * v + e * a);
        }
        state
    }

    /// Envelope and its first two derivatives: up in a fifth of the time, down in two fifths, twice smooth at every end.
    fn envelope(&self, time: f64) -> [f64; 3] {
        let (rise, fall) = (0.2 * self.seconds, 0.4 * self.seconds);
        let (x, slope) = if time <= 0.0 || time >= self.seconds {
            return [0.0; 3];
        } else if time < rise {
            (time / rise, 1.0 / rise)
        } else if time > self.seconds - fall {
            ((self.seconds - time) / fall, -1.0 / fall)
        } else {
            return [1.0, 0.0, 0.0];
        };
        let value = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
        let first = 30.0 * x * x * (1.0 - x) * (1.0 - x) * slope;
        let second = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) * slope * slope;
        [value, first, second]
    }
}

/// Sines of one component: frequencies spread over the band with a random place in each share, random phases.
fn sines(rng: &mut ChaCha8Rng) -> Vec<Sine> {
    let (low, high) = (LOWEST_HZ / 4.0, HIGHEST_HZ);
    (0..SINES)
        .map(|k| {
            let place: f64 = rng.random();
            let phase = rng.random::<f64>() * std::f64::consts::TAU;
            let hz = low + (high - low) * (k as f64 + place) / SINES as f64;
            let omega = hz * std::f64::consts::TAU;
            Sine { omega, phase, amplitude: spectrum(hz).sqrt() / (omega * omega) }
        })
        .collect()
}

/// Power of the acceleration at a frequency, without a unit.
fn spectrum(hz: f64) -> f64 {
    let (r, z) = (hz / SOIL_HZ, SOIL_DAMPING);
    let soil = (1.0 + (2.0 * z * r).powi(2)) / ((1.0 - r * r).powi(2) + (2.0 * z * r).powi(2));
    let q = hz / LOWEST_HZ;
    let cut = q.powi(4) / ((1.0 - q * q).powi(2) + (2.0 * z * q).powi(2));
    soil * cut
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intensities_have_the_accelerations_of_the_regression() {
        // Wald et al. 1999, table 1: V 3.9-9.2 %g, VI 9.2-18, VII 18-34, VIII 34-65, IX 65-124 (bounds at half steps).
        for (intensity, low, high) in
            [(5.0, 0.039, 0.092), (6.0, 0.092, 0.18), (7.0, 0.18, 0.34), (8.0, 0.34, 0.65), (9.0, 0.65, 1.24)]
        {
            let g = peak_acceleration(intensity) / 9.81;
            assert!((low..high).contains(&g), "{intensity}: {g} g");
        }
        assert!((peak_acceleration(4.999) / peak_acceleration(5.0) - 1.0).abs() < 0.05, "no step between the branches");
    }

    #[test]
    fn it_starts_and_ends_at_rest_and_peaks_as_told() {
        let motion = GroundMotion::new(8.0, 10.0, 7);
        for time in [-1.0, 0.0, 10.0, 11.0] {
            assert_eq!(motion.at(time), GroundState::default());
        }
        let states: Vec<GroundState> = (0..=4000).map(|k| motion.at(f64::from(k) / 400.0)).collect();
        let peak = states.iter().map(|s| s.acceleration.x.hypot(s.acceleration.z)).fold(0.0, f64::max);
        assert!((peak / peak_acceleration(8.0) - 1.0).abs() < 1e-6, "{peak}");
        let up = states.iter().map(|s| s.acceleration.y.abs()).fold(0.0, f64::max);
        assert!((up / peak - 2.0 / 3.0).abs() < 1e-6);
        let far = states.iter().map(|s| s.displacement.length()).fold(0.0, f64::max);
        assert!((0.02..0.8).contains(&far), "moves by decimetres: {far}");
    }

    #[test]
    fn velocity_and_acceleration_are_derivatives() {
        let motion = GroundMotion::new(7.0, 6.0, 3);
        let h = 1e-4;
        for k in 1..60 {
            let t = f64::from(k) * 0.1;
            let (before, here, after) = (motion.at(t - h), motion.at(t), motion.at(t + h));
            let v = (after.displacement - before.displacement) / (2.0 * h);
            let a = (after.velocity - before.velocity) / (2.0 * h);
            assert!((v - here.velocity).abs().max_element() < 1e-4, "{t}");
            assert!((a - here.acceleration).abs().max_element() < 5e-3, "{t}: {a} {}", here.acceleration);
        }
    }

    #[test]
    fn its_power_lies_in_the_band() {
        let motion = GroundMotion::new(8.0, 20.0, 1);
        // Power at a frequency by direct Fourier sums over the part with a full envelope.
        let times = (0..1600).map(|k| 4.0 + f64::from(k) / 200.0);
        let series: Vec<(f64, f64)> = times.map(|t| (t, motion.at(t).acceleration.x)).collect();
        let power = |hz: f64| {
            let (mut re, mut im) = (0.0, 0.0);
            for (t, a) in &series {
                let w = std::f64::consts::TAU * hz * t;
                re += a * w.cos();
                im += a * w.sin();
            }
            re * re + im * im
        };
        let band = |low: f64, high: f64| (0..40).map(|k| power(low + (high - low) * f64::from(k) / 40.0)).sum::<f64>();
        let inside = band(0.8, 6.0);
        assert!(band(12.0, 17.0) < 0.01 * inside && band(0.02, 0.1) < 0.05 * inside);
    }

    #[test]
    fn seeds_differ_and_repeat() {
        let at = |seed| GroundMotion::new(8.0, 10.0, seed).at(3.0);
        assert_eq!(at(1), at(1));
        assert_ne!(at(1), at(2));
    }
}
