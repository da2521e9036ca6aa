//! Calls: how they are asked, recorded, waited for and paid.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod asking;
mod book;
mod common;
mod same_work;
mod shared;
mod waiting;
