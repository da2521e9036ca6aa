//! Kills workers, scenes and the database at random moments, and looks whether every scene ended once, in the bytes of a
//! run that nobody disturbed, and every call was paid once.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use rand::{Rng as _, SeedableRng as _};
use rustix::process::{Pid, Signal, kill_process};

use crate::fleet::{Fleet, Plan, folder};
use crate::scene::{PRICES, calls_of, lasting};
use crate::server::Server;
use crate::throughput::once_each;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(long, default_value_t = 120)]
    scenes: usize,
    #[arg(long, default_value_t = 4)]
    workers: usize,
    #[arg(long, default_value_t = 4)]
    objects: usize,
    #[arg(long, default_value_t = 60.0)]
    speed: f64,
    /// Kills of workers.
    #[arg(long, default_value_t = 200)]
    worker_kills: usize,
    /// Kills of PostgreSQL (without any, the queue is SQLite).
    #[arg(long, default_value_t = 20)]
    database_kills: usize,
    /// Kills of scenes' programs; a call in flight may then be paid twice.
    #[arg(long, default_value_t = 0)]
    scene_kills: usize,
    /// Milliseconds between two kills, half to one and a half of it.
    #[arg(long, default_value_t = 250)]
    pause_ms: u64,
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[arg(long)]
    folder: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Victim {
    Worker,
    Database,
    Scene,
}

pub async fn run(args: &Args) -> Result<(), String> {
    let (root, _kept) = folder(args.folder.as_ref());
    let server =
        if args.database_kills > 0 { Some(Server::start(&root)?.ok_or("PostgreSQL is not installed")?) } else { None };
    let address = server.as_ref().map(Server::address);
    let plan = Plan {
        folder: &root,
        queue: address.as_deref(),
        scenes: args.scenes,
        objects: args.objects,
        speed: args.speed,
        more: &["--mesh-places".to_owned(), "6".to_owned()],
        losses: 1_000_000,
        lease_ms: 1500,
    };
    let mut fleet = Fleet::new(&plan).await?;
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(args.seed);
    let mut victims = vec![Victim::Worker; args.worker_kills];
    victims.extend(vec![Victim::Database; args.database_kills]);
    victims.extend(vec![Victim::Scene; args.scene_kills]);
    for i in (1..victims.len()).rev() {
        victims.swap(i, random.random_range(0..=i));
    }
    for _ in 0..args.workers {
        fleet.hire();
    }
    let begun = Instant::now();
    let mut killed: BTreeMap<&str, usize> = BTreeMap::new();
    while let Some(victim) = victims.pop() {
        let pause = args.pause_ms as f64 * random.random_range(0.5..1.5);
        tokio::time::sleep(Duration::from_secs_f64(pause / 1000.0)).await;
        if let Some(counts) = fleet.counts().await
            && counts.open() == 0
        {
            victims.push(victim);
            break;
        }
        fleet.refill();
        match victim {
            Victim::Worker => {
                let i = random.random_range(0..fleet.size());
                fleet.replace(i);
                *killed.entry("workers").or_default() += 1;
            }
            Victim::Database => {
                let server = server.as_ref().ok_or("no server")?;
                server.kill(random.random_bool(0.5))?;
                tokio::time::sleep(Duration::from_millis(random.random_range(0..1000))).await;
                server.up()?;
                *killed.entry("databases").or_default() += 1;
            }
            Victim::Scene => {
                let scenes = fleet.scenes();
                if scenes.is_empty() {
                    victims.insert(0, victim);
                    continue;
                }
                let pid = scenes[random.random_range(0..scenes.len())];
                if let Some(pid) = Pid::from_raw(pid)
                    && kill_process(pid, Signal::KILL).is_ok()
                {
                    *killed.entry("scenes").or_default() += 1;
                }
            }
        }
    }
    let left = victims.len();
    fleet.wait(Duration::from_mins(3)).await?;
    println!("killed {killed:?} in {:.1} s, seed {}", begun.elapsed().as_secs_f64(), args.seed);
    judge(args, &fleet, &root, killed.get("scenes").copied().unwrap_or(0)).await?;
    if left > 0 {
        return Err(format!("all scenes had ended before {left} of the kills: take more scenes, or a shorter pause"));
    }
    Ok(())
}

async fn judge(args: &Args, fleet: &Fleet, root: &Path, scene_kills: usize) -> Result<(), String> {
    let rows = fleet.queue.scenes(fleet.row.id, "", i64::MAX).await.map_err(|e| e.to_string())?;
    if rows.len() != args.scenes {
        return Err(format!("{} scenes of {}", rows.len(), args.scenes));
    }
    for row in &rows {
        // A scene whose program was killed thrice has failed, as it should; then it is put back by hand in real life.
        if row.state != "done" || row.ends != 1 {
            return Err(format!("{}: {}, ended {} times: {}", row.scene, row.state, row.ends, row.message));
        }
    }
    let turns: i64 = rows.iter().map(|row| row.losses).sum();
    let paid = fleet.ledger();
    let calls = args.scenes * calls_of(args.objects);
    if scene_kills == 0 {
        once_each(&paid, calls)?;
    }
    let twice = paid.len() - calls;
    // As many chains as there are objects may be in flight when a scene is killed.
    if twice > scene_kills * args.objects {
        return Err(format!("{twice} calls were paid again after {scene_kills} kills of scenes"));
    }
    // The same scenes, undisturbed.
    let alone = root.join("alone");
    for row in &rows {
        let run = alone.join(&row.scene);
        let made = Command::new(std::env::current_exe().unwrap())
            .arg("scene")
            .arg(fleet.set.path().join(&row.photo))
            .arg("--out")
            .arg(&run)
            .arg("--ledger")
            .arg(alone.join("paid.log"))
            .args(["--speed", "1e6", "--objects", &args.objects.to_string(), "--mesh-places", "6"])
            .status()
            .map_err(|e| e.to_string())?;
        if !made.success() {
            return Err(format!("{} alone: {made}", row.scene));
        }
        let (one, other) = (lasting(&run), lasting(&fleet.set.run(&row.scene)));
        if scene_kills > 0 {
            // Records say that a call was asked twice; the scene is the same.
            let name = Path::new("scene.json");
            if one.get(name) != other.get(name) {
                return Err(format!("{}: another scene.json", row.scene));
            }
        } else if one != other {
            let differs: Vec<_> =
                one.keys().chain(other.keys()).filter(|k| one.get(*k) != other.get(*k)).take(3).collect();
            return Err(format!("{}: {differs:?} differ", row.scene));
        }
    }
    let set = fleet.queue.set(fleet.set.name()).await.map_err(|e| e.to_string())?;
    let price = |player: &str| match player {
        "language" => PRICES[0],
        "editor" => PRICES[1],
        _ => PRICES[2],
    };
    let spent: f64 = paid.iter().map(|p| price(&p.player)).sum();
    println!(
        "{} scenes, each ended once, in the bytes of an undisturbed run; {} calls, {twice} paid again; {turns} turns lost \
         with their workers; {:.2} US$ paid, {:.2} US$ counted",
        rows.len(),
        calls,
        spent,
        set.spent_usd
    );
    // What was in flight at a loss counts as paid, and may be: never less than what was paid.
    if set.spent_usd < spent - 1e-6 || set.flying_usd.abs() > 1e-6 {
        return Err(format!("{spent} US$ were paid, {} counted, {} in flight", set.spent_usd, set.flying_usd));
    }
    Ok(())
}
