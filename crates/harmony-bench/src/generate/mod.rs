//! Furnished rooms from a seed, in the format of the rooms with known truth.
