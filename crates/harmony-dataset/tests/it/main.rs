//! Tests of the whole: from a finished run to a release that others read.

#![allow(clippy::unwrap_used, clippy::semicolon_if_nothing_returned, reason = "helpers of tests")]

mod building;
mod checking;
mod fixture;
mod galleries;
