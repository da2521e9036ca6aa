//! A studio on loopback: one program that plays all services of the profiles `paper`, `local` and `hosted` over real HTTP, with
//! their wire formats, limits and quirks, and answers from the truth of one room.
//!
//! It is a means of tests and no part of the shipped program: nothing in the program knows of it, and what reaches it is
//! what would reach the real services. [`truth_oracle`] tells how it finds out from that what is asked.
//!
//! * [`Studio`]: a running one; [`StudioOptions::faults`] lets things go wrong;
//! * [`ledger`]: what was asked and paid;
//! * [`soak`]: many runs with random faults, checked.

#![allow(clippy::format_push_string, clippy::assigning_clones, reason = "texts of tests: plain rather than quick")]

pub mod faults;
pub mod glb;
pub mod http;
pub mod ledger;
pub mod limits;
pub mod players;
pub mod profile;
pub mod reading;
pub mod rooms;
pub mod services;
pub mod soak;
pub mod strict;
pub mod truth_oracle;

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use harmony_bench::wall_clock::Pace;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;

use crate::faults::FaultPlan;
use crate::ledger::Ledger;
use crate::services::{Service, Services};
use crate::truth_oracle::TruthOracle;

/// The key that all services accept unless told otherwise. It is no secret: it opens nothing but a studio.
pub const KEY: &str = "studio-key-that-opens-nothing-else";

/// How a studio plays.
#[derive(Debug, Clone, PartialEq)]
pub struct StudioOptions {
    /// The key that services with keys accept.
    pub key: String,
    /// What goes wrong.
    pub faults: FaultPlan,
    /// Requests that a service with rate limits takes in a window.
    pub requests: u32,
    /// That window.
    pub window: Duration,
    /// How long language models, image editors and hosted mesh generators take; `None`: no longer than they need here.
    pub pace: Option<Pace>,
}

impl Default for StudioOptions {
    fn default() -> Self {
        Self {
            key: KEY.to_owned(),
            faults: FaultPlan::default(),
            requests: 500,
            window: Duration::from_mins(1),
            pace: None,
        }
    }
}

/// A running studio; it ends when dropped.
pub struct Studio {
    address: SocketAddr,
    /// What was asked and paid.
    pub ledger: Arc<Ledger>,
    elsewhere: Arc<AtomicU64>,
    tasks: Vec<JoinHandle<()>>,
}

impl Drop for Studio {
    fn drop(&mut self) {
        self.tasks.iter().for_each(JoinHandle::abort);
    }
}

impl Studio {
    /// Starts on a port of loopback; 0 = any free one.
    ///
    /// # Errors
    /// A port that cannot be had.
    pub async fn start(truth_oracle: Arc<TruthOracle>, options: StudioOptions, port: u16) -> io::Result<Self> {
        let listener = TcpListener::bind(("127.0.0.1", port)).await?;
        let address = listener.local_addr()?;
        // Another host, to which nobody should ever go.
        let other = TcpListener::bind(("127.0.0.1", 0)).await?;
        let elsewhere = Arc::new(AtomicU64::new(0));
        let services = Arc::new(Services::new(truth_oracle, options, address, other.local_addr()?));
        let ledger = Arc::clone(&services.ledger);
        let visits = Arc::clone(&elsewhere);
        let tasks = vec![
            tokio::spawn(http::serve(listener, services)),
            tokio::spawn(async move {
                while other.accept().await.is_ok() {
                    visits.fetch_add(1, Ordering::Relaxed);
                }
            }),
        ];
        Ok(Self { address, ledger, elsewhere, tasks })
    }

    /// Base address of a service, as a user would configure it.
    pub fn base(&self, service: Service) -> String {
        format!("http://{}/{}{}", self.address, service.prefix(), service.base())
    }

    /// Connections to the host that redirects lead to.
    pub fn visits_elsewhere(&self) -> u64 {
        self.elsewhere.load(Ordering::Relaxed)
    }

    /// Waits until the studio is ended from outside.
    pub async fn wait(mut self) {
        for task in self.tasks.drain(..) {
            let _ = task.await;
        }
    }
}
