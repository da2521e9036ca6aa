//! Tests of the whole: from a finished run to a release that others read.

mod building;
mod checking;
mod fixture;
mod galleries;
