//! Homes of synthetic rooms: every room is a run made from a known home, with stated errors.

#![expect(clippy::unwrap_used, reason = "tests, helpers included")]

mod adapting;
mod homes;
mod support;
