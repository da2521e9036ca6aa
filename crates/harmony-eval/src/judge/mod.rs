//! A judge that looks: pairs of renders beside their photo, put to a vision-language model or a person.
//! Key `eval.judge`.
//!
//! # How a pair is judged
//! The judge gets the photo, and of each reconstruction the photo's view and, where both have one, an elevated view, all
//! of one size, named A and B: nothing tells whose they are. It is asked in **both orders**; which comes first is
//! drawn from the seed and the scene's name, so that not even the names of questions tell. A criterion is won when both
//! orders agree; if they do not, or say "same", it is a tie (L. Zheng et al., "Judging LLM-as-a-Judge", 2023, on the
//! bias of positions). An answer that never came in a usable form is missing: it is counted and reported, never taken
//! for a tie or a zero.
//!
//! # What comes of it
//! Wins, ties, the sign test, and strengths by Bradley-Terry ([`bradley_terry`]) with an interval by bootstrap over
//! *scenes*, because the rounds of a scene are no independent trials. How often both orders agree tells how far the
//! judge can be trusted at all; [`agreement`] holds two judges against each other.
//!
//! # Limits
//! A model that made one of the scenes should not be the only judge of them. Models judge colour and presence better
//! than sizes and angles: read the criteria apart.

mod agreement;
pub mod bradley_terry;
mod page;
mod pictures;
mod play;
mod question;
mod tally;

pub use agreement::{Agreement, agreement};
pub use page::page;
pub use pictures::{JudgeScene, Pair, PairView, PairsError, pairs};
pub use play::{JudgeOptions, Judgement, Trial, judge};
pub use question::{Better, Criterion, JudgeAnswer, JudgeQuestion, Verdict};
pub use tally::{CriterionScore, Outcome, Ruling, Strength, tally, text};
