//! `harmony-batch-trial`: a batch with players that only wait, and whoever kills its workers and its database. A means of
//! tests and measurements, no part of the shipped program.
//!
//! * `scene`: one scene as `harmony reconstruct` makes it, as far as a batch sees it: a run folder with its lock, calls
//!   through `harmony-calls` with records, turns from the worker's queue, exit codes; players that take the usual time of
//!   an answer, divided by `--speed`, and write down what is paid;
//! * `worker`: a worker whose program is this one;
//! * `throughput`, `queue`, `kills`: measurements, `docs/batch.md`.
#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "a program of tests: what fails, fails loudly"
)]

mod fleet;
mod kills;
mod queue_cost;
mod scene;
mod server;
mod throughput;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::{Parser, Subcommand};
use harmony_batch::{Queue, QueueAddress, SetFolder, WorkerOptions, WorkerStop, work};

#[derive(Debug, Parser)]
#[command(name = "harmony-batch-trial", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Makes one scene with players that only wait.
    Scene(scene::Args),
    /// Works from a queue, scenes made by this program.
    Worker(Worker),
    /// How near many workers come to the ideal.
    Throughput(throughput::Args),
    /// What a job costs the queue, however many there are.
    Queue(queue_cost::Args),
    /// Kills workers, scenes and the database, and looks whether every scene ended once, as it should.
    Kills(kills::Args),
}

#[derive(Debug, clap::Args)]
struct Worker {
    #[arg(long)]
    set: PathBuf,
    #[arg(long)]
    queue: Option<String>,
    #[arg(long, default_value_t = 1)]
    slots: usize,
    #[arg(long, default_value_t = 300)]
    heartbeat_ms: u64,
    #[arg(long, default_value_t = 50)]
    poll_ms: u64,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    match cli.command {
        Command::Scene(args) => ExitCode::from(runtime.block_on(scene::run(&args))),
        Command::Worker(args) => runtime.block_on(worker(&args)),
        Command::Throughput(args) => judged(runtime.block_on(throughput::run(&args))),
        Command::Queue(args) => judged(runtime.block_on(queue_cost::run(&args))),
        Command::Kills(args) => judged(runtime.block_on(kills::run(&args))),
    }
}

fn judged(result: Result<(), String>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            println!("FAILED: {reason}");
            ExitCode::FAILURE
        }
    }
}

async fn worker(args: &Worker) -> ExitCode {
    let set = SetFolder::open(&args.set).unwrap();
    let address: QueueAddress = set.queue(args.queue.as_deref()).unwrap();
    let queue = loop {
        match Queue::open(&address, 3).await {
            Ok(queue) => break queue,
            Err(error) if error.is_passing() => tokio::time::sleep(Duration::from_millis(200)).await,
            Err(error) => panic!("{error}"),
        }
    };
    let options = WorkerOptions {
        slots: args.slots,
        only: Some(set),
        until_idle: true,
        poll: Duration::from_millis(args.poll_ms),
        heartbeat: Duration::from_millis(args.heartbeat_ms),
        grace: Duration::from_secs(30),
        ..WorkerOptions::new(std::env::current_exe().unwrap())
    };
    match work(&queue, options, &WorkerStop::default()).await {
        Ok(_) => ExitCode::SUCCESS,
        Err(error) => {
            println!("worker: {error}");
            ExitCode::FAILURE
        }
    }
}
