//! How near many workers come to the ideal.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use crate::fleet::{Fleet, Paid, Plan, folder};
use crate::scene::{calls_of, ideal_seconds};
use crate::server::Server;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(long, default_value_t = 300)]
    scenes: usize,
    #[arg(long, default_value_t = 4)]
    workers: usize,
    #[arg(long, default_value_t = 6)]
    objects: usize,
    #[arg(long, default_value_t = 30.0)]
    speed: f64,
    /// Meshes at a time over all workers; 0 = no limit.
    #[arg(long, default_value_t = 0)]
    mesh_places: usize,
    /// Questions in a scaled minute over all workers.
    #[arg(long)]
    questions_a_minute: Option<f64>,
    /// On PostgreSQL in place of SQLite.
    #[arg(long)]
    postgres: bool,
    /// Fails below this share of the ideal.
    #[arg(long, default_value_t = 0.0)]
    least: f64,
    /// Where; a temporary folder when left out.
    #[arg(long)]
    folder: Option<PathBuf>,
}

pub async fn run(args: &Args) -> Result<(), String> {
    let (root, _kept) = folder(args.folder.as_ref());
    let server = if args.postgres { Some(Server::start(&root)?.ok_or("PostgreSQL is not installed")?) } else { None };
    let address = server.as_ref().map(Server::address);
    let mut more = vec!["--mesh-places".to_owned(), args.mesh_places.to_string()];
    if let Some(rate) = args.questions_a_minute {
        more.extend(["--questions-a-minute".to_owned(), rate.to_string()]);
    }
    let plan = Plan {
        folder: &root,
        queue: address.as_deref(),
        scenes: args.scenes,
        objects: args.objects,
        speed: args.speed,
        more: &more,
        losses: 5,
        lease_ms: 5000,
    };
    let mut fleet = Fleet::new(&plan).await?;
    let scenes: Vec<String> = (0..args.scenes).map(|i| format!("room_{i:04}")).collect();
    let ideals: Vec<(f64, f64)> = scenes.iter().map(|scene| ideal_seconds(scene, args.objects)).collect();
    let work = ideals.iter().map(|(alone, _)| alone).sum::<f64>() / args.speed / args.workers as f64;
    let longest = ideals.iter().map(|(alone, _)| *alone).fold(0.0, f64::max) / args.speed;
    let meshes = match args.mesh_places {
        0 => 0.0,
        places => ideals.iter().map(|(_, meshes)| meshes).sum::<f64>() / args.speed / places as f64,
    };
    let questions = args.scenes * (4 + args.objects);
    let rated = args.questions_a_minute.map_or(0.0, |rate| (questions as f64 / rate - 1.0) * 60.0 / args.speed);
    let ideal = work.max(longest).max(meshes).max(rated);
    for _ in 0..args.workers {
        fleet.hire();
    }
    fleet.wait(Duration::from_secs_f64(ideal * 6.0 + 60.0)).await?;
    let counts = fleet.counts().await.ok_or("the database is away")?;
    if counts.done != args.scenes as i64 {
        return Err(format!("{counts:?}"));
    }
    let rows = fleet.queue.scenes(fleet.row.id, "done", i64::MAX).await.map_err(|e| e.to_string())?;
    let first = rows.iter().map(|row| row.ended - row.busy_ms).min().unwrap_or_default();
    let last = rows.iter().map(|row| row.ended).max().unwrap_or_default();
    let took = (last - first) as f64 / 1000.0;
    let paid = fleet.ledger();
    let most = at_a_time(&paid, "meshes");
    println!(
        "{} scenes of {:.2} s ({} calls each), {} workers, {}: {took:.1} s; ideal {ideal:.1} s (work {work:.1}, meshes \
         {meshes:.1}, rates {rated:.1}); share {:.3}; meshes at a time at most {most}",
        args.scenes,
        ideals.iter().map(|(alone, _)| alone).sum::<f64>() / args.speed / args.scenes as f64,
        calls_of(args.objects),
        args.workers,
        if args.postgres { "PostgreSQL" } else { "SQLite" },
        ideal / took,
    );
    once_each(&paid, args.scenes * calls_of(args.objects))?;
    if args.mesh_places > 0 && most > args.mesh_places {
        return Err(format!("{most} meshes at a time, {} are allowed", args.mesh_places));
    }
    if let Some(rate) = args.questions_a_minute {
        let most = in_a_window(&paid, "language", (60_000.0 / args.speed) as i64);
        println!("questions in a scaled minute: at most {most}, {rate} are allowed");
        // Begins are written down a moment after they were counted: a minute is shorter than it looks by that much.
        if most as f64 > rate * 1.2 + 1.0 {
            return Err("more than are allowed".to_owned());
        }
    }
    let money = fleet.queue.set(fleet.set.name()).await.map_err(|e| e.to_string())?;
    let wanted = args.scenes as f64 * crate::scene::PRICES[0] * (4 + args.objects) as f64
        + (args.scenes * args.objects) as f64 * (crate::scene::PRICES[1] + crate::scene::PRICES[2]);
    println!("{:.2} US$ counted, {wanted:.2} US$ asked for", money.spent_usd + money.flying_usd);
    if (money.spent_usd - wanted).abs() > 1e-6 || money.flying_usd.abs() > 1e-6 {
        return Err(format!("money: {money:?}"));
    }
    if ideal / took < args.least {
        return Err(format!("{:.3} of the ideal, {} are wanted", ideal / took, args.least));
    }
    Ok(())
}

/// Fails unless every call was paid once.
pub fn once_each(paid: &[Paid], calls: usize) -> Result<(), String> {
    let mut times: BTreeMap<(&str, &str), usize> = BTreeMap::new();
    for one in paid {
        *times.entry((&one.scene, &one.call)).or_default() += 1;
    }
    let twice: Vec<_> = times.iter().filter(|(_, n)| **n > 1).take(5).collect();
    if !twice.is_empty() || times.len() != calls {
        return Err(format!("{} calls of {calls}; paid more than once: {twice:?}", times.len()));
    }
    Ok(())
}

/// Most calls of a player at a time.
fn at_a_time(paid: &[Paid], player: &str) -> usize {
    let of: Vec<&Paid> = paid.iter().filter(|p| p.player == player).collect();
    of.iter().map(|p| of.iter().filter(|q| q.begun <= p.begun && p.begun < q.ended).count()).max().unwrap_or(0)
}

/// Most calls of a player that begin in a window, milliseconds.
fn in_a_window(paid: &[Paid], player: &str, window: i64) -> usize {
    let mut begins: Vec<i64> = paid.iter().filter(|p| p.player == player).map(|p| p.begun).collect();
    begins.sort_unstable();
    (0..begins.len()).map(|i| begins[i..].iter().take_while(|b| *b - begins[i] < window).count()).max().unwrap_or(0)
}
