//! What a job costs the queue, however many there are.

use std::path::PathBuf;
use std::time::Instant;

use harmony_batch::queue::{Ended, NewJob, NewSet};
use harmony_batch::{Queue, QueueAddress};

use crate::fleet::folder;
use crate::server::Server;

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
    let row = |values: &[f64]| values.iter().map(|v| format!("{v:.3}")).collect::<Vec<_>>().join(" ");
    println!("{} jobs, {}", args.jobs, if args.postgres { "PostgreSQL" } else { "SQLite" });
    println!("queued, ms a job by tenths:            {}", row(&queued));
    println!("claimed and ended, ms a job by tenths: {}", row(&ended));
    println!("status of all: {counted:.1} ms");
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
