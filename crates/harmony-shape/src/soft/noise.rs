//! Random numbers and smooth noise.
