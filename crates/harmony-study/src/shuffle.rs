//! The order of panels and trials, fixed to the bit.
//! Key `study.shuffle`.
//!
//! Paper: "the letter-method mapping is reshuffled per (participant, scene) via a seed hashed from participant ID and
//! scene name". The paper names neither hash nor generator; these are ours, and `assets/shuffle.js` is the same in
//! JavaScript:
//!
//! 1. **Seed**: SHA-256 of the UTF-8 text `harmony-study 1 panels\n{study}\n{participant}\n{trial}` (for the order of
//!    trials `harmony-study 1 trials\n{study}\n{participant}`). The first 16 bytes are four 32-bit words, big-endian;
//!    should all be 0, the first is 1.
//! 2. **Generator**: xoshiro128** (Blackman and Vigna, "Scrambled linear pseudorandom number generators", 2018) on
//!    these words.
//! 3. **A number below n**: words are drawn until one is below the largest multiple of n up to 2^32; its remainder by
//!    n is the number. No number is likelier than another.
//! 4. **Shuffle**: Fisher and Yates: for i from the last place down to the second, place i and a place drawn below
//!    i + 1 change contents.
//!
//! What is shuffled is the list of opaque names in ascending order, which says nothing about methods. `trial` is the
//! opaque name of the scene, one for one with its name in the private folder.

use sha2::{Digest as _, Sha256};

/// xoshiro128** on four words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Generator([u32; 4]);

impl Generator {
    /// Seeded from the SHA-256 of a text.
    pub fn from_text(text: &str) -> Self {
        let hash = Sha256::digest(text.as_bytes());
        let word = |i: usize| u32::from_be_bytes([hash[4 * i], hash[4 * i + 1], hash[4 * i + 2], hash[4 * i + 3]]);
        let mut state = [word(0), word(1), word(2), word(3)];
        if state == [0; 4] {
            state[0] = 1;
        }
        Self(state)
    }

    /// The next 32 bits.
    pub fn next_u32(&mut self) -> u32 {
        let s = &mut self.0;
        let result = s[1].wrapping_mul(5).rotate_left(7).wrapping_mul(9);
        let t = s[1] << 9;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = s[3].rotate_left(11);
        result
    }

    /// A number below `n` (0 for `n` = 0).
    pub fn below(&mut self, n: u32) -> u32 {
        if n == 0 {
            return 0;
        }
        let limit = (1_u64 << 32) / u64::from(n) * u64::from(n);
        loop {
            let x = self.next_u32();
            if u64::from(x) < limit {
                return x % n;
            }
        }
    }

    /// Shuffles in place.
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            let j = self.below(i as u32 + 1) as usize;
            items.swap(i, j);
        }
    }
}

/// Which of the `count` panels (in ascending order of their opaque names) each letter shows.
pub fn panel_order(study: &str, participant: &str, trial: &str, count: usize) -> Vec<usize> {
    shuffled(&format!("harmony-study 1 panels\n{study}\n{participant}\n{trial}"), count)
}

/// The order in which a participant sees the `count` trials (in the order of the page's list).
pub fn trial_order(study: &str, participant: &str, count: usize) -> Vec<usize> {
    shuffled(&format!("harmony-study 1 trials\n{study}\n{participant}"), count)
}

fn shuffled(seed: &str, count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    Generator::from_text(seed).shuffle(&mut order);
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_generator_is_xoshiro128_starstar() {
        // Worked by hand from the definition for the state (1, 2, 3, 4):
        // rotl(2 * 5, 7) * 9 = 1280 * 9 = 11520; then the state is (7, 0, 1026, 12288) and the next is 0;
        // s = (7, 0, 1026, 12288): t = 0; s2 = 1026 ^ 7 = 1029; s3 = 12288; s1 = 0 ^ 1029 = 1029; s0 = 7 ^ 12288 =
        // 12295; s3 = rotl(12288, 11) = 25165824. Then rotl(1029 * 5, 7) * 9 = 658560 * 9 = 5927040.
        let mut g = Generator([1, 2, 3, 4]);
        assert_eq!(g.next_u32(), 11_520);
        assert_eq!(g.0, [7, 0, 1026, 12_288]);
        assert_eq!(g.next_u32(), 0);
        assert_eq!(g.0, [12_295, 1029, 1029, 25_165_824]);
        assert_eq!(g.next_u32(), 5_927_040);
    }

    #[test]
    fn every_letter_shows_every_method_equally_often() {
        // 20,000 participants: each of the 720 orders has 27.8 expected; chi-square with 719 degrees of freedom has
        // mean 719 and standard deviation 37.9.
        let mut counts = std::collections::BTreeMap::<Vec<usize>, u32>::new();
        for i in 0..20_000 {
            *counts.entry(panel_order("s", &format!("p{i}"), "t", 6)).or_default() += 1;
        }
        let expected = 20_000.0 / 720.0;
        let seen: f64 = counts.values().map(|n| (f64::from(*n) - expected).powi(2) / expected).sum();
        let chi2 = seen + (720 - counts.len()) as f64 * expected;
        assert!((719.0 - 4.0 * 37.9..=719.0 + 4.0 * 37.9).contains(&chi2), "{chi2}");
    }

    #[test]
    fn another_participant_or_scene_is_another_order() {
        let base = panel_order("s", "anna", "t1", 9);
        assert_eq!(base, panel_order("s", "anna", "t1", 9));
        assert_ne!(base, panel_order("s", "bert", "t1", 9));
        assert_ne!(base, panel_order("s", "anna", "t2", 9));
        assert_eq!(panel_order("s", "anna", "t", 1), [0]);
        assert!(trial_order("s", "anna", 0).is_empty());
    }
}
