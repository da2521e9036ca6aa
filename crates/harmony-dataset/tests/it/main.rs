//! Tests of the whole: from a finished run to a release that others read.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod building;
mod checking;
mod fixture;
mod galleries;
