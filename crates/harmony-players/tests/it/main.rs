//! Players, each against its services on loopback.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod canary;
mod files;
mod hosted;
mod http;
mod loopback;
mod offline;
mod schemas;
mod services;
