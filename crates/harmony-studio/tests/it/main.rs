//! The program against the studio's services.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod doctor;
mod faults;
mod hosted;
mod local_only;
mod profiles;
mod rates;
mod setup;
