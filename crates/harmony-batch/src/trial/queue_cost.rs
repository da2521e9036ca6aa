//! What a job costs the queue, however many there are.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use harmony_batch::queue::{Ended, NewJob, NewSet, SetRow, SharedPlayers};
use harmony_batch::status::{Status, write_table};
use harmony_batch::{Queue, QueueAddress, SetFolder};
use harmony_calls::{PlayerLimits, SharedAsk, SharedLimits as _, SharedOver, SharedTurn};
use harmony_roles::Role;

use crate::fleet::folder;
use crate::server::Server;

/// Turns that are timed.
const TURNS: u32 = 500;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(long, default_value_t = 10_000)]
    jobs: usize,
    /// Of these, how many are claimed and ended.
    #[arg(long)]
    end: Option<usize>,
    #[arg(long)]
    postgres: bool,
    /// Fails when the last tenth costs more than this many times the first.
    #[arg(long, default_value_t = f64::INFINITY)]
    most: f64,
    #[arg(long)]
    folder: Option<PathBuf>,
}

pub async fn run(args: &Args) -> Result<(), String> {
    let text = |e: harmony_batch::BatchError| e.to_string();
    let (root, _kept) = folder(args.folder.as_ref());
    let server = if args.postgres { Some(Server::start(&root)?.ok_or("PostgreSQL is not installed")?) } else { None };
    let address = match &server {
        Some(server) => QueueAddress::parse(&server.address()).map_err(text)?,
        None => QueueAddress::File(root.join("queue.sqlite")),
    };
    let queue = Queue::create(&address, 2).await.map_err(text)?;
    let set = queue
        .put_set(&NewSet {
            name: "cost".to_owned(),
            folder: String::new(),
            args: Vec::new(),
            attempts: 3,
            losses: 5,
            lease_ms: 600_000,
            retry_ms: 1000,
            timeout_ms: 0,
            streak: 0,
        })
        .await
        .map_err(text)?;
    let jobs: Vec<NewJob> = (0..args.jobs)
        .map(|i| NewJob {
            scene: format!("room_{i:07}"),
            photo: format!("photos/room_{i:07}.jpg"),
            hash: blake3::hash(&i.to_le_bytes()).to_hex().to_string(),
            priority: (i % 3) as i64,
        })
        .collect();
    let tenth = (args.jobs / 10).max(1);
    let mut queued = Vec::new();
    for some in jobs.chunks(tenth) {
        let clock = Instant::now();
        let added = queue.enqueue(set.id, some).await.map_err(text)?;
        if added != some.len() as u64 {
            return Err(format!("{added} of {} were queued", some.len()));
        }
        queued.push(clock.elapsed().as_secs_f64() * 1e3 / some.len() as f64);
    }
    // The same again changes nothing.
    if queue.enqueue(set.id, &jobs[..tenth]).await.map_err(text)? != 0 {
        return Err("scenes were queued twice".to_owned());
    }
    let ends = args.end.unwrap_or(args.jobs).min(args.jobs);
    let part = (ends / 10).max(1);
    let turn = turns(&queue, &set).await?;
    let mut ended = Vec::new();
    let mut done = 0;
    let mut before = i64::MAX;
    while done < ends {
        let clock = Instant::now();
        for _ in 0..part.min(ends - done) {
            let job = queue.claim(&set, "cost").await.map_err(text)?.ok_or("no job")?;
            let number: i64 = job.scene[5..].parse().map_err(|_| "name")?;
            if number % 3 > before {
                return Err("a lower priority went first".to_owned());
            }
            before = number % 3;
            // Not every scene has a bill.
            let bill = (number % 2 == 1).then_some(0.1);
            queue.finish(&job, &Ended::Done, bill).await.map_err(text)?;
        }
        done += part.min(ends - done);
        ended.push(clock.elapsed().as_secs_f64() * 1e3 / part as f64);
    }
    let clock = Instant::now();
    let counts = queue.counts(set.id).await.map_err(text)?;
    let counted = clock.elapsed().as_secs_f64() * 1e3;
    if counts.done != ends as i64 || counts.all() != args.jobs as i64 {
        return Err(format!("{counts:?}"));
    }
    drop(jobs);
    let looked = looks(&queue, &set, &root).await?;
    let row = |values: &[f64]| values.iter().map(|v| format!("{v:.3}")).collect::<Vec<_>>().join(" ");
    println!("{} jobs, {}", args.jobs, if args.postgres { "PostgreSQL" } else { "SQLite" });
    println!("queued, ms a job by tenths:            {}", row(&queued));
    println!("claimed and ended, ms a job by tenths: {}", row(&ended));
    println!("a turn at a player and its end: {turn:.3} ms");
    println!("status of all: {counted:.1} ms");
    for (what, ms, mib) in looked {
        println!("{what}: {ms:.1} ms, {mib}");
    }
    if args.postgres {
        queue.close().await;
    } else {
        let size = std::fs::metadata(root.join("queue.sqlite")).map_or(0, |m| m.len());
        println!("{:.0} bytes a job", size as f64 / args.jobs as f64);
    }
    // The first one also opens files and plans statements.
    let ratio = ended.last().unwrap_or(&0.0) / ended.iter().take(2).copied().fold(f64::INFINITY, f64::min);
    if ratio > args.most {
        return Err(format!("the last tenth costs {ratio:.2} times the first"));
    }
    Ok(())
}

/// What a call costs the queue: milliseconds for a turn and its end, one after the other, of a scene that goes back then.
async fn turns(queue: &Queue, set: &SetRow) -> Result<f64, String> {
    let text = |e: harmony_batch::BatchError| e.to_string();
    let job = queue.claim(set, "turns").await.map_err(text)?.ok_or("no job")?;
    let players = SharedPlayers::new(queue.clone(), (set.id, job.id, job.token), "here".to_owned());
    let ask = SharedAsk {
        role: Role::VisionLanguage,
        player: "trial".to_owned(),
        model: "m".to_owned(),
        places: 8,
        limits: PlayerLimits::default(),
        expected_usd: Some(0.0),
    };
    let clock = Instant::now();
    for _ in 0..TURNS {
        let SharedTurn::Go(number) = players.take(&ask).await else { return Err("no turn".to_owned()) };
        players.settle(number, SharedOver::default()).await;
        players.flush(Duration::from_secs(30)).await;
    }
    let ms = clock.elapsed().as_secs_f64() * 1e3 / f64::from(TURNS);
    queue.finish(&job, &Ended::Again { wait_ms: 0 }, None).await.map_err(text)?;
    Ok(ms)
}

/// What is done once for all scenes of a set: milliseconds, and the memory that the program took at most meanwhile.
async fn looks(queue: &Queue, set: &SetRow, root: &Path) -> Result<Vec<(&'static str, f64, String)>, String> {
    let text = |e: harmony_batch::BatchError| e.to_string();
    let folder = SetFolder::make(&root.join("set"), None, &[], "", "trial").map_err(text)?;
    let mut looked = Vec::new();
    let clock = begin();
    let status = Status::of(queue, &set.name).await.map_err(text)?;
    status.write(&folder).map_err(text)?;
    looked.push(("status and page", clock.elapsed().as_secs_f64() * 1e3, peak()));
    let clock = begin();
    write_table(queue, set, &folder).await.map_err(text)?;
    looked.push(("scenes.csv", clock.elapsed().as_secs_f64() * 1e3, peak()));
    let lines = std::fs::read_to_string(folder.path().join("scenes.csv")).map_err(|e| e.to_string())?.lines().count();
    if lines as i64 != status.counts.all() + 1 {
        return Err(format!("scenes.csv has {lines} lines"));
    }
    let clock = begin();
    queue.names(set.id).await.map_err(text)?;
    looked.push(("names of all", clock.elapsed().as_secs_f64() * 1e3, peak()));
    Ok(looked)
}

/// Begins to measure: forgets how much memory was taken at most until now, where the system can.
fn begin() -> Instant {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
    Instant::now()
}

/// Memory that was taken at most since, in words; off Linux nobody knows.
fn peak() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().trim_end_matches("kB").trim().parse::<f64>().ok());
    kib.map_or_else(|| "memory not known".to_owned(), |kib| format!("{:.0} MiB at most", kib / 1024.0))
}
