//! The judge: finished runs on photos without truth, beside each other and beside what other programs made.
//!
//! | module | does |
//! |---|---|
//! | [`score`] | N-CLIP, PL and LPIPS of renders against their photos; tables with three means; paired comparison |
//! | [`ablate`] | the paper's ablation table on photos with recordings |
//! | [`baked`] | a run's scene for scripts that ignore node transforms |
//! | [`judge`] | pairs of renders put to somebody who looks, in both orders, without names; Bradley-Terry, agreement of judges |
//! | [`rivals`] | finished outputs of other programs in one form, drawn by our flat renderer |
//! | [`statistics`] | means, bootstrap intervals, sign test: the same seed, the same numbers |
//!
//! Networks that look at pictures are not here: whoever has their weights hands a [`score::PictureMetric`] in.

pub mod ablate;
pub mod baked;
pub mod judge;
mod page;
pub mod rivals;
pub mod score;
pub mod statistics;
