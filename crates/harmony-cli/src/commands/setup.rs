//! `harmony setup`.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use harmony_pipeline::{Inventory, estimate};
use harmony_scene::ImageSize;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::doctor;
use crate::cast::{self, CastRequest};
use crate::config::players::{Editor, Language, Meshes};
use crate::config::{self, ConfigFile, Profile};
use crate::display::{self, hinted};
use crate::setup::blender::{Plan, TERMS};
use crate::setup::file::{Written, written};
use crate::setup::propose::{Proposal, Wish, propose};
use crate::survey::{Survey, USUAL, survey};
use crate::{EXIT_ERROR, EXIT_OK, say, tell};

/// Size of the photo that the estimate is for; it changes nothing about calls.
const PHOTO: ImageSize = ImageSize { width: 1600, height: 1200 };

/// Arguments.
#[derive(Debug, clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "switches of a command line")]
#[command(after_help = "\
Examples:
  harmony setup
      looks around, proposes, asks on a terminal, writes harmony.toml, tries each player once (free)
  harmony setup --meshes tripo --yes
      the same with Tripo for meshes, without questions
  harmony setup --show
      only tells what is here and what it would write
  harmony setup --blender
      also installs Blender's Python module where no Blender is found
Nothing is asked when it is not a terminal. Keys are never read from or written to a file. Running it again changes only
what changed.")]
pub struct Args {
    /// Who looks: gemini, openai, openai_chat, anthropic, compatible, files, offline.
    #[arg(long, value_parser = named::<Language>)]
    language: Option<Language>,
    /// Who draws: gemini, openai, local_edits, offline.
    #[arg(long, value_parser = named::<Editor>)]
    editor: Option<Editor>,
    /// Who makes meshes: fal, tripo, meshy, replicate, hunyuan3d_2, hunyuan3d_2_1, trellis_nim, trellis_localai, offline.
    #[arg(long, value_parser = named::<Meshes>)]
    meshes: Option<Meshes>,
    /// A further address where a server of one's own may answer; may be repeated.
    #[arg(long = "server", value_name = "ADDRESS")]
    servers: Vec<String>,
    /// Look at no usual port, only at addresses that are named.
    #[arg(long)]
    no_ports: bool,
    /// Configuration that is written (default: harmony.toml here).
    #[arg(long, default_value = "harmony.toml")]
    config: PathBuf,
    /// Only show what would be written.
    #[arg(long)]
    show: bool,
    /// Ask nothing, take what is proposed.
    #[arg(long, short)]
    yes: bool,
    /// Do not try the players.
    #[arg(long)]
    no_try: bool,
    /// Let each player do a tiny piece of work, which costs some cents; else each is asked for nothing.
    #[arg(long)]
    paid: bool,
    /// Fetch these weights after showing their licences (`harmony models list` has the names); may be repeated.
    #[arg(long, value_name = "NAME")]
    pull: Vec<String>,
    /// Agree to a licence; may be repeated. Without it a terminal is asked.
    #[arg(long = "accept-licence", value_name = "LICENCE")]
    accept: Vec<String>,
    /// Install Blender's Python module where no Blender is found: 370 MB from PyPI, GPL-3.0. Without it a terminal is
    /// asked.
    #[arg(long)]
    blender: bool,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

/// A player by its name in the configuration.
fn named<P: DeserializeOwned>(name: &str) -> Result<P, String> {
    serde_json::from_value(Value::String(name.to_owned())).map_err(|error| error.to_string())
}

/// The name of a player.
fn name_of<P: Serialize>(player: &P) -> String {
    serde_json::to_value(player).ok().and_then(|name| name.as_str().map(str::to_owned)).unwrap_or_default()
}

/// Runs the command.
///
/// # Errors
/// A configuration that is there and does not fit, a folder that cannot be written.
pub fn run(args: &Args) -> Result<u8> {
    let before = match std::fs::read_to_string(&args.config) {
        Ok(text) => Some(text),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
        Err(error) => return Err(error).with_context(|| format!("reading {}", args.config.display())),
    };
    // A file that does not fit is told of as everywhere, and not touched.
    let file = if before.is_some() { config::load(Some(&args.config))? } else { ConfigFile::default() };
    let store = crate::models::store(&file.models, None);
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting")?;
    let found = runtime.block_on(survey(&addresses(args, &file), &store))?;
    let mut wish = wished(args, &file);
    let mut proposal = proposed(&found, wish, &file);
    let talks = !args.yes && !args.json && std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
    if !args.json {
        say!("On this machine:")?;
        for line in found.lines() {
            say!("  {line}")?;
        }
    }
    if talks {
        tell!("\nPress Enter to take what is in brackets.");
        wish.language = Some(asked("Who shall look at the photo", &proposal.language.player)?);
        wish.editor = Some(asked("Who shall draw what is hidden", &proposal.editor.player)?);
        wish.meshes = Some(asked("Who shall make meshes", &proposal.meshes.player)?);
        proposal = proposed(&found, wish, &file);
    }
    let new = written(before.as_deref(), &proposal)?;
    let cost = Cost::of(&new, proposal.profile, &found)?;
    let shown = args.show || (talks && !new.changes.is_empty() && !agreed(&args.config, &proposal, &new, &cost)?);
    if args.json {
        let report = json!({
            "found": found, "profile": proposal.profile.name(), "changes": new.changes, "missing": proposal.missing(),
            "cost": cost, "written": !shown && !new.changes.is_empty(), "text": new.text,
        });
        say!("{}", serde_json::to_string_pretty(&report)?)?;
    } else if !talks || args.show {
        told(&proposal, &new, &cost)?;
    }
    if shown {
        if args.show && args.blender {
            with_blender(args, &found, talks, file.players.local_only)?;
        }
        return Ok(EXIT_OK);
    }
    if new.changes.is_empty() {
        if !args.json {
            say!("\n{} is as it should be: nothing is changed", args.config.display())?;
        }
    } else {
        harmony_io::write_durable(&args.config, new.text.as_bytes())?;
        if !args.json {
            say!("\nwrote {}", args.config.display())?;
        }
    }
    if !args.pull.is_empty() {
        super::models::pull_named(&args.pull, &args.accept, Some(args.config.clone()))?;
    }
    let file = config::load(Some(&args.config))?;
    with_blender(args, &found, talks, file.players.local_only)?;
    let mut code = EXIT_OK;
    if !args.no_try && !args.json {
        let price =
            if args.paid { "each does a tiny piece of work, which costs some cents" } else { "this costs nothing" };
        say!("\nTrying each player once; {price}.")?;
        let looked = doctor::look(&file, proposal.profile, file.players.local_only, args.paid)?;
        doctor::print(&looked.report, proposal.profile)?;
        code = if looked.missing { EXIT_ERROR } else { EXIT_OK };
    }
    if !args.json {
        let config = if args.config == Path::new("harmony.toml") {
            String::new()
        } else {
            format!(" --config {}", args.config.display())
        };
        say!("\nYour own photo:\n  harmony reconstruct PHOTO.jpg --out run{config}")?;
    }
    Ok(code)
}

/// Installs Blender's module where no Blender was found, when the user wants it.
fn with_blender(args: &Args, found: &Survey, talks: bool, local_only: bool) -> Result<()> {
    if found.no_blender.is_none() {
        if args.blender && !args.json {
            say!("\nBlender is here: nothing to install")?;
        }
        return Ok(());
    }
    if !args.blender && !talks {
        return Ok(());
    }
    if local_only {
        let error = "Blender's module comes from PyPI, and the configuration promises that nothing leaves this machine";
        let hint = "take `local_only` out for the installation, or put a Blender of 4.2 or newer on PATH";
        return if args.blender { Err(hinted(error.to_owned(), Some(hint))) } else { Ok(()) };
    }
    tell!("\n{TERMS}");
    let plan = match Plan::new() {
        // Nobody asked for it yet: what is missing is said, and setup goes on.
        Err(error) if !args.blender => {
            display::print_error(&error);
            return Ok(());
        }
        other => other?,
    };
    for line in plan.lines() {
        tell!("  {line}");
    }
    if args.show || (!args.blender && !yes("Install it?", false)?) {
        return Ok(());
    }
    let blender = plan.run()?;
    harmony_players::forget_path_tracer();
    tell!("Blender {} is installed", blender.version());
    Ok(())
}

/// Where servers are looked for: the usual places, those that the user names, those that the file names.
fn addresses(args: &Args, file: &ConfigFile) -> Vec<String> {
    let mut all: Vec<String> = if args.no_ports { vec![] } else { USUAL.map(str::to_owned).to_vec() };
    all.extend(args.servers.iter().cloned());
    let players = &file.players;
    let named = [&players.vision_language.address, &players.image_editor.address, &players.mesh_generator.address];
    // A key is sent to none of them; what is encrypted is a service, not a server of one's own.
    let own = named.into_iter().flatten().filter(|address| address.starts_with("http://"));
    all.extend(own.map(|address| address.trim_end_matches('/').trim_end_matches("/v1").to_owned()));
    let mut seen = std::collections::BTreeSet::new();
    all.retain(|address| seen.insert(address.trim_end_matches('/').to_owned()));
    all
}

/// What the user wishes: on the command line, else what the file says already.
fn wished(args: &Args, file: &ConfigFile) -> Wish {
    let named = !matches!(file.profile, Some(Profile::Offline | Profile::Files));
    let players = &file.players;
    Wish {
        language: args.language.or(players.vision_language.player.filter(|_| named)),
        editor: args.editor.or(players.image_editor.player.filter(|_| named)),
        meshes: args.meshes.or(players.mesh_generator.player.filter(|_| named)),
    }
}

/// A proposal; a profile of services or servers that the file names stays, for all three play what the sections say.
fn proposed(found: &Survey, wish: Wish, file: &ConfigFile) -> Proposal {
    let mut proposal = propose(found, wish);
    let plays = |profile: Profile| matches!(profile, Profile::Paper | Profile::Local | Profile::Hosted);
    if let Some(profile) = file.profile.filter(|profile| plays(*profile) && plays(proposal.profile)) {
        proposal.profile = profile;
    }
    proposal
}

/// Asks for a player on a terminal.
fn asked<P: Serialize + DeserializeOwned + Copy>(question: &str, proposed: &P) -> Result<P> {
    loop {
        let mut err = std::io::stderr().lock();
        write!(err, "{question}? [{}] ", name_of(proposed))?;
        err.flush()?;
        drop(err);
        let mut answer = String::new();
        if std::io::stdin().read_line(&mut answer)? == 0 || answer.trim().is_empty() {
            return Ok(*proposed);
        }
        match named(answer.trim()) {
            Ok(player) => return Ok(player),
            Err(error) => tell!("{error}"),
        }
    }
}

/// Shows a proposal and asks whether it is to be written.
fn agreed(config: &Path, proposal: &Proposal, new: &Written, cost: &Cost) -> Result<bool> {
    told(proposal, new, cost)?;
    tell!("");
    yes(&format!("Write {}?", config.display()), true)
}

/// Asks yes or no on a terminal; `usual` = the answer of Enter.
fn yes(question: &str, usual: bool) -> Result<bool> {
    let mut err = std::io::stderr().lock();
    write!(err, "{question} [{}] ", if usual { "yes" } else { "no" })?;
    err.flush()?;
    drop(err);
    let mut answer = String::new();
    std::io::stdin().read_line(&mut answer)?;
    Ok(match answer.trim().to_lowercase().as_str() {
        "" => usual,
        answer => matches!(answer, "y" | "yes"),
    })
}

fn told(proposal: &Proposal, new: &Written, cost: &Cost) -> Result<()> {
    say!("\nProposed: profile {}", proposal.profile.name())?;
    for (what, player, why) in [
        ("looks", name_of(&proposal.language.player), &proposal.language.why),
        ("draws", name_of(&proposal.editor.player), &proposal.editor.why),
        ("meshes", name_of(&proposal.meshes.player), &proposal.meshes.why),
    ] {
        say!("  {what:<8} {player:<16} {why}")?;
    }
    for missing in proposal.missing() {
        say!("  missing: {missing}")?;
    }
    say!("{}", cost.words())?;
    if !new.changes.is_empty() {
        say!("\nChanges:")?;
        for change in &new.changes {
            say!("  {change}")?;
        }
    }
    Ok(())
}

/// What a typical room takes.
#[derive(Debug, Serialize)]
struct Cost {
    /// US dollars, of what has a price.
    usd: f64,
    /// Roles whose price is not known.
    unpriced: Vec<&'static str>,
    /// Minutes of waiting for players, at least.
    minutes: f64,
    /// Memory at most, MiB, and of what.
    memory_mib: u64,
}

/// Memory of the program itself with a room of 25 objects, and of networks on the CPU, MiB (`docs/performance.md`): they
/// do not run at once, so the largest counts.
const OWN_MIB: u64 = 1000;
const NETWORKS_MIB: [(&str, u64); 3] = [("vggt", 5900), ("sam2", 2200), ("owlv2", 1600)];

impl Cost {
    fn of(new: &Written, profile: Profile, found: &Survey) -> Result<Self> {
        let file = config::parse(&new.text).map_err(|reason| anyhow::anyhow!(reason))?;
        let casting = cast::cast(&CastRequest {
            profile,
            // Nobody is asked, so no key is needed; networks are not loaded for a guess.
            players: file.players.resolved(profile).without_keys().without_networks(),
            models: crate::models::store(&file.models, None),
            photo_size: PHOTO,
            points: None,
            intrinsics: None,
            depth_scale: 1000.0,
            masks: None,
            questions: PathBuf::from("questions"),
            tasks: None,
            timeout_minutes: 0.0,
            path_tracer: found.no_blender.is_none(),
            working_px: file.settings.working_px,
            tell: std::sync::Arc::new(|_| {}),
        })?;
        let traces = casting.cast.can().traces;
        let e = estimate(Inventory::typical(None), &casting.cast, traces, &file.prices, &[]);
        let runs = |name: &str| found.networks && found.weights.iter().any(|weights| weights.model.starts_with(name));
        let networks = NETWORKS_MIB.iter().filter(|(name, _)| runs(name)).map(|(_, mib)| *mib).max();
        let plays = !matches!(profile, Profile::Offline | Profile::Files);
        Ok(Self {
            usd: e.usd,
            unpriced: e.unpriced.iter().map(|role| role.folder()).collect(),
            minutes: e.minutes_at_least,
            memory_mib: networks.filter(|_| plays).unwrap_or(0).max(OWN_MIB),
        })
    }

    fn words(&self) -> String {
        let unknown = if self.unpriced.is_empty() {
            String::new()
        } else {
            format!(" without {} (price not known)", self.unpriced.join(", "))
        };
        format!(
            "a typical room, an ESTIMATE: {:.2} US${unknown}; at least {:.0} minutes of waiting for players; up to {:.1} GiB \
             of memory",
            self.usd,
            self.minutes.max(1.0),
            self.memory_mib as f64 / 1024.0
        )
    }
}
