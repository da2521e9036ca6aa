//! `harmony models`.

use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, Result};
use harmony_models::{Checksum, Event, FileState, Lock, Model, ModelError, ModelFile, Source, Store, Verified, table};
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use serde_json::{Value, json};

use crate::display::hinted;
use crate::models::{bytes, hub, store, told};
use crate::{EXIT_ERROR, EXIT_OK, config, networks, say, tell};

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  harmony models list
  harmony models pull sam2.1-large owlv2-base

Weights lie in one folder: --dir, else HARMONY_MODELS, else [models] folder of harmony.toml, else the user's data folder.
Copy that folder to a machine without network and run `harmony models verify` there.
HF_TOKEN is sent to the hub's own host only; most models need none. HARMONY_HUB names a mirror.")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Tell what there is, under what terms, and what is here.
    #[command(after_help = "Example:\n  harmony models list")]
    List(ListArgs),
    /// Fetch weights; goes on where it stopped.
    #[command(after_help = "Example:\n  harmony models pull sam2.1-large owlv2-base")]
    Pull(PullArgs),
    /// Check weights that are here: lengths, checksums, keys and shapes.
    #[command(after_help = "Example:\n  harmony models verify")]
    Verify(VerifyArgs),
}

/// What all of them know.
#[derive(Debug, clap::Args)]
struct Common {
    /// Folder of the models.
    #[arg(long)]
    dir: Option<PathBuf>,
    /// Configuration (default: harmony.toml here, if there is one).
    #[arg(long)]
    config: Option<PathBuf>,
}

/// Arguments of `models list`.
#[derive(Debug, clap::Args)]
struct ListArgs {
    #[command(flatten)]
    common: Common,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

/// Arguments of `models pull`.
#[derive(Debug, clap::Args)]
struct PullArgs {
    /// Names, as `harmony models list` has them.
    #[arg(required = true)]
    names: Vec<String>,
    #[command(flatten)]
    common: Common,
    /// Take the files from this folder instead of the hub.
    #[arg(long)]
    from: Option<PathBuf>,
    /// Agree to a licence; may be repeated. Without it a terminal is asked.
    #[arg(long = "accept-licence", value_name = "LICENCE")]
    accept: Vec<String>,
    /// Nothing may leave this machine: only a hub on it is asked.
    #[arg(long)]
    local_only: bool,
}

/// Arguments of `models verify`.
#[derive(Debug, clap::Args)]
struct VerifyArgs {
    /// Names (default: all that are here).
    names: Vec<String>,
    #[command(flatten)]
    common: Common,
    /// Agree to a licence; may be repeated. Without it a terminal is asked.
    #[arg(long = "accept-licence", value_name = "LICENCE")]
    accept: Vec<String>,
}

/// Runs the command.
///
/// # Errors
/// Names that are none, licences that nobody accepts, files that don't come or are wrong.
pub fn run(args: &Args) -> Result<u8> {
    match &args.command {
        Command::List(args) => list(args),
        Command::Pull(args) => pull(args),
        Command::Verify(args) => verify(args),
    }
}

fn models_of(ids: &[String]) -> Result<Vec<&'static Model>> {
    let of = |name: &String| {
        table::find(name).ok_or_else(|| {
            let known: Vec<&str> = table::MODELS.iter().map(|m| m.id).collect();
            hinted(format!("there is no model {name}"), Some(format!("models are {}", known.join(", "))))
        })
    };
    ids.iter().map(of).collect()
}

fn list(args: &ListArgs) -> Result<u8> {
    let config = config::load(args.common.config.as_deref())?;
    let store = store(&config.models, args.common.dir.as_deref());
    if args.json {
        let models = table::MODELS.iter().map(|m| as_json(&store, m)).collect::<Result<Vec<_>>>()?;
        let all = json!({ "folder": store.folder(), "models": models });
        say!("{}", serde_json::to_string_pretty(&all)?)?;
        return Ok(EXIT_OK);
    }
    say!("Models in {}:\n", store.folder().display())?;
    for model in table::MODELS {
        let (size, all) = model.size();
        let size = if all { bytes(size) } else { model.note.to_owned() };
        say!("{:<20} {:<14} {}", model.id, size, here(&store, model)?)?;
        say!("    {}; from {}", model.what, model.origin())?;
        let accepted = match (model.licence.restricted, store.accepted(model.licence).map_err(|e| told(&e))?) {
            (true, Some(accepted)) => format!(" [accepted {}]", accepted.day()),
            (true, None) => format!(" [not accepted: --accept-licence {}]", model.licence.id),
            (false, _) => String::new(),
        };
        say!("    licence {}: {}{accepted}", model.licence.id, model.licence.terms)?;
        say!("    {}", model.licence.address)?;
        if all && !model.note.is_empty() {
            say!("    {}", model.note)?;
        }
        for file in model.files {
            say!("    {:<26} {}", file.name, pinned(&store, model, file)?)?;
        }
        say!("")?;
    }
    Ok(EXIT_OK)
}

/// Whether a model is here, in a word or two.
fn here(store: &Store, model: &Model) -> Result<String> {
    let (mut verified, mut unchecked, mut wrong, mut partial) = (0, 0, 0, 0);
    let mut day = String::new();
    for file in model.files {
        match store.state(model, file).map_err(|e| told(&e))? {
            FileState::Missing { partial: some } => partial += some,
            FileState::WrongSize { .. } => wrong += 1,
            FileState::Unchecked => unchecked += 1,
            FileState::Verified(known) => {
                verified += 1;
                day = known.day();
            }
        }
    }
    Ok(match model.files.len() {
        n if verified == n => format!("here, checked {day}"),
        _ if wrong > 0 => "here, but of another length: harmony models verify".to_owned(),
        n if verified + unchecked == n => "here, not checked yet: harmony models verify".to_owned(),
        _ if verified + unchecked > 0 => "in part".to_owned(),
        _ if partial > 0 => format!("begun: {}", bytes(partial)),
        _ => "not here".to_owned(),
    })
}

/// Revision and checksum of a file, and where that knowledge comes from.
fn pinned(store: &Store, model: &Model, file: &ModelFile) -> Result<String> {
    let known = store.known(model, file).map_err(|e| told(&e))?;
    let revision = match file.source {
        Source::Hub { revision: Some(commit), .. } | Source::Code { commit, .. } => format!(" at {}", &commit[..12]),
        Source::Hub { revision: None, .. } => {
            let commit = known.as_ref().and_then(|k| k.revision.as_deref()).and_then(|c| c.get(..12));
            commit.map_or_else(|| " at main".to_owned(), |c| format!(" at {c} (pinned at the first pull)"))
        }
        Source::Torch => String::new(),
    };
    Ok(match (file.sha256, known) {
        (Some(sum), _) => format!("SHA-256 {sum}{revision}"),
        (None, Some(known)) => format!("SHA-256 {} ({}){revision}", known.sha256, words(known.checksum)),
        (None, None) => format!("checksum not known: pinned at the first pull{revision}"),
    })
}

fn words(checksum: Checksum) -> &'static str {
    match checksum {
        Checksum::Table => "known",
        Checksum::Hub => "told by the hub at the first pull",
        Checksum::FirstUse => "of the first file that came",
    }
}

fn as_json(store: &Store, model: &Model) -> Result<Value> {
    let licence = model.licence;
    let mut files = Vec::new();
    for file in model.files {
        let state = store.state(model, file).map_err(|e| told(&e))?;
        let state = match state {
            FileState::Missing { partial } => json!({ "state": "missing", "partial": partial }),
            FileState::WrongSize { wanted, found } => {
                json!({ "state": "wrong_size", "wanted": wanted, "found": found })
            }
            FileState::Unchecked => json!({ "state": "unchecked" }),
            FileState::Verified(known) => json!({ "state": "verified", "known": known }),
        };
        let (repo, revision) = match file.source {
            Source::Hub { repo, revision } => (repo, revision),
            Source::Code { repo, commit } => (repo, Some(commit)),
            Source::Torch => ("torchvision", None),
        };
        files.push(json!({
            "name": file.name, "from": repo, "revision": revision, "path": file.path, "size": file.size,
            "sha256": file.sha256, "here": state,
        }));
    }
    let accepted = store.accepted(licence).map_err(|e| told(&e))?.map(|a| a.day());
    Ok(json!({
        "name": model.id, "what": model.what, "files": files, "note": model.note,
        "licence": {
            "id": licence.id, "title": licence.title, "terms": licence.terms, "address": licence.address,
            "restricted": licence.restricted, "non_commercial": licence.non_commercial, "accepted": accepted,
        },
    }))
}

/// Has the licences accepted that need it: those named are, a terminal is asked for the rest.
fn licences(store: &Store, lock: &Lock, models: &[&Model], accept: &[String]) -> Result<()> {
    let known: BTreeMap<&str, _> = table::MODELS.iter().map(|m| (m.licence.id, m.licence)).collect();
    for id in accept {
        let Some(licence) = known.get(id.as_str()) else {
            let ids: Vec<&str> = known.keys().copied().collect();
            return Err(hinted(
                format!("no model has the licence {id}"),
                Some(format!("licences are {}", ids.join(", "))),
            ));
        };
        store.accept(lock, licence, "--accept-licence").map_err(|e| told(&e))?;
    }
    for model in models {
        let licence = model.licence;
        tell!("{}: licence {}: {} ({})", model.id, licence.title, licence.terms, licence.address);
        match store.check_licence(model) {
            Err(ModelError::NotAccepted { .. }) if asked(model)? => {
                store.accept(lock, licence, "answered yes on a terminal").map_err(|e| told(&e))?;
            }
            other => other.map_err(|e| told(&e))?,
        }
    }
    Ok(())
}

/// Asks on a terminal; no terminal says no.
fn asked(model: &Model) -> Result<bool> {
    if !std::io::stdin().is_terminal() || !std::io::stderr().is_terminal() {
        return Ok(false);
    }
    let mut err = std::io::stderr().lock();
    write!(err, "Do you accept the licence {} for {}? Type yes: ", model.licence.id, model.id)?;
    err.flush()?;
    drop(err);
    let mut answer = String::new();
    std::io::stdin().read_line(&mut answer)?;
    Ok(matches!(answer.trim().to_lowercase().as_str(), "y" | "yes"))
}

/// Fetches models by name, after showing their licences.
///
/// # Errors
/// As [`run`].
pub fn pull_named(names: &[String], accept: &[String], config: Option<PathBuf>) -> Result<u8> {
    pull(&PullArgs {
        names: names.to_vec(),
        common: Common { dir: None, config },
        from: None,
        accept: accept.to_vec(),
        local_only: false,
    })
}

fn pull(args: &PullArgs) -> Result<u8> {
    let config = config::load(args.common.config.as_deref())?;
    let store = store(&config.models, args.common.dir.as_deref());
    let models = models_of(&args.names)?;
    let lock = store.lock().map_err(|e| told(&e))?;
    licences(&store, &lock, &models, &args.accept)?;
    let progress = Progress::default();
    if let Some(from) = &args.from {
        for model in &models {
            copy(&store, &lock, model, from, &progress)?;
        }
    } else {
        let mut players = config.players.clone();
        players.local_only |= args.local_only;
        let hub = hub(&config.models, &players)?;
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("starting")?;
        for model in &models {
            let pulled = runtime.block_on(hub.pull(&store, &lock, model, &|event| progress.event(event)));
            progress.clear();
            pulled.map_err(|e| told(&e))?;
        }
    }
    say!("{} in {}", args.names.join(", "), store.folder().display())?;
    Ok(EXIT_OK)
}

fn copy(store: &Store, lock: &Lock, model: &Model, from: &Path, progress: &Progress) -> Result<()> {
    let copied = store.import(lock, model, from, &|file, have| {
        progress.bytes(&format!("{}/{}", model.id, file.name), have, file.size);
    });
    progress.clear();
    for (file, verified) in model.files.iter().zip(copied.map_err(|e| told(&e))?) {
        tell!("{}/{}: {}", model.id, file.name, about(&verified));
    }
    Ok(())
}

fn about(verified: &Verified) -> String {
    let known = &verified.known;
    match (known.checksum, verified.first) {
        (Checksum::Table, _) => "checksum right".to_owned(),
        (other, true) => format!("checksum not known before: {} is pinned ({})", known.sha256, words(other)),
        (_, false) => "checksum as pinned".to_owned(),
    }
}

/// Bars on a terminal, lines elsewhere.
#[derive(Default)]
struct Progress(Mutex<Shown>);

/// What is shown now.
#[derive(Default)]
struct Shown {
    all: Option<MultiProgress>,
    bars: BTreeMap<String, ProgressBar>,
    /// Tenths of each file that were told.
    tenths: BTreeMap<String, u64>,
}

impl Progress {
    fn event(&self, event: Event) {
        match event {
            Event::Already { name } => tell!("{name}: here and right"),
            Event::Bytes { name, have, total } => self.bytes(&name, have, total),
            Event::Anew { name, reason } => self.line(&format!("{name}: from its start: {reason}")),
            Event::Again { name, reason, wait, .. } => {
                self.line(&format!("{name}: tried again in {:.0} s: {reason}", wait.as_secs_f64()));
            }
            Event::Done { name, verified, .. } => self.line(&format!("{name}: {}", about(&verified))),
            _ => {}
        }
    }

    fn bytes(&self, name: &str, have: u64, total: Option<u64>) {
        let mut shown = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Shown { all, bars, tenths } = &mut *shown;
        if std::io::stderr().is_terminal() {
            let multi = all.get_or_insert_with(MultiProgress::new);
            let bar = bars.entry(name.to_owned()).or_insert_with(|| {
                let bar = multi.add(ProgressBar::new(total.unwrap_or(0)));
                let style = "{msg} {bar:30} {bytes}/{total_bytes} {bytes_per_sec} {eta}";
                if let Ok(style) = ProgressStyle::with_template(style) {
                    bar.set_style(style);
                }
                bar.set_message(name.to_owned());
                bar
            });
            bar.set_length(total.unwrap_or(have));
            bar.set_position(have);
        } else if let Some(total) = total.filter(|t| *t > 0) {
            let tenth = have * 10 / total;
            if tenths.insert(name.to_owned(), tenth).is_none_or(|before| before != tenth) {
                tell!("{name}: {} of {}", bytes(have), bytes(total));
            }
        }
    }

    fn line(&self, text: &str) {
        let shown = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match &shown.all {
            Some(multi) => drop(multi.println(text)),
            None => tell!("{text}"),
        }
    }

    fn clear(&self) {
        let mut shown = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        shown.bars.values().for_each(ProgressBar::finish_and_clear);
        *shown = Shown::default();
    }
}

fn verify(args: &VerifyArgs) -> Result<u8> {
    let config = config::load(args.common.config.as_deref())?;
    let store = store(&config.models, args.common.dir.as_deref());
    let missing = |m: &Model| -> Result<bool> {
        let mut all = true;
        for file in m.files {
            all &= matches!(store.state(m, file).map_err(|e| told(&e))?, FileState::Missing { .. });
        }
        Ok(all)
    };
    let mut models = models_of(&args.names)?;
    if args.names.is_empty() {
        for model in table::MODELS {
            if !missing(model)? {
                models.push(model);
            }
        }
        if models.is_empty() {
            let hint = "`harmony models pull NAME` fetches some; `harmony models list` tells which there are";
            return Err(hinted(format!("no weights in {}", store.folder().display()), Some(hint)));
        }
    }
    // A folder that cannot be written to can be verified all the same.
    if let Ok(lock) = store.lock() {
        let here: Vec<&Model> =
            models.iter().copied().filter(|m| m.licence.restricted && !missing(m).unwrap_or(true)).collect();
        licences(&store, &lock, &here, &args.accept)?;
    }
    let progress = Progress::default();
    let mut wrong = 0;
    for model in models {
        let mut sound = true;
        for file in model.files {
            let name = format!("{}/{}", model.id, file.name);
            let found = store.verify(model, file, &|have| progress.bytes(&name, have, file.size));
            progress.clear();
            match found {
                Ok(verified) => say!("ok       {name}: {}", about(&verified))?,
                Err(error) => {
                    sound = false;
                    say!("{:<8} {error}", verdict(&error))?;
                }
            }
        }
        if sound {
            match networks::layout(model, &store) {
                None => say!("-        {}: keys and shapes not checked: this build has no networks", model.id)?,
                Some(Ok(())) => say!("ok       {}: keys and shapes fit", model.id)?,
                Some(Err(reason)) => {
                    sound = false;
                    say!("MISFIT   {}: {reason}", model.id)?;
                }
            }
        }
        wrong += usize::from(!sound);
    }
    if wrong > 0 {
        tell!("hint: `harmony models pull NAME` fetches what is missing or wrong");
        return Ok(EXIT_ERROR);
    }
    Ok(EXIT_OK)
}

fn verdict(error: &ModelError) -> &'static str {
    match error {
        ModelError::Missing { .. } => "MISSING",
        ModelError::WrongSize { wanted, found, .. } if found < wanted => "CUT OFF",
        ModelError::WrongSize { .. } | ModelError::WrongChecksum { .. } => "WRONG",
        _ => "FAILED",
    }
}
