//! The judge on small sets of pictures whose figures are known.

mod judging;
mod rivals;
mod scoring;
