//! Homes of synthetic rooms: every room is a run made from a known home, with stated errors.

mod adapting;
mod homes;
mod support;
