//! One scene with players that only wait.

use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use async_trait::async_trait;
use harmony_batch::inside;
use harmony_calls::{
    Bill, BookOptions, CallBook, CallOptions, Calls, Cast, Limits, PlayerLimits, Price, Prices, StopReason,
};
use harmony_roles::{
    DetectRequest, Detections, Detector, EditKind, EditRequest, EditedImage, GeneratedMesh, GeometryAnswer,
    GeometryEstimator, GeometryRequest, ImageEditor, LitImage, LitRenderer, LitRequest, MeshGenerator, MeshRequest,
    PlayerCard, RoleError, SegmentRequest, SegmentedMask, Segmenter, Usage, VisionLanguage, VlmAnswer, VlmRequest,
};
use image::{Rgba, RgbaImage};
use serde_json::{Value, json};

/// Seconds that answers usually take.
const QUESTION_S: f64 = 8.0;
const EDIT_S: f64 = 12.0;
/// A mesh; asked through the editor's role here, for nobody looks at it.
const MESH_S: f64 = 45.0;

/// What a question, an edit, a mesh cost, US dollars.
pub const PRICES: [f64; 3] = [0.02, 0.04, 0.1];

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The photo; its content decides how the scene goes.
    photo: PathBuf,
    #[arg(long)]
    out: PathBuf,
    /// Where what is paid is written down.
    #[arg(long)]
    ledger: PathBuf,
    /// Answers take the usual time divided by this.
    #[arg(long, default_value_t = 100.0)]
    speed: f64,
    /// Objects in the scene.
    #[arg(long, default_value_t = 6)]
    objects: usize,
    /// Meshes at a time, over all workers; 0 = no limit.
    #[arg(long, default_value_t = 0)]
    mesh_places: usize,
    /// Questions in a scaled minute, over all workers.
    #[arg(long)]
    questions_a_minute: Option<f64>,
}

/// A player that waits, writes down that it is paid, and answers what follows from the question.
struct Waits {
    card: PlayerCard,
    seconds: f64,
    scene: String,
    ledger: PathBuf,
}

/// A number from 0 to 1 that follows from a text.
fn drawn(text: &str) -> f64 {
    let hash = blake3::hash(text.as_bytes());
    let bytes: [u8; 4] = hash.as_bytes()[..4].try_into().unwrap();
    f64::from(u32::from_le_bytes(bytes)) / f64::from(u32::MAX)
}

/// How long an answer takes: half to one and a half of the usual.
fn latency(usual: f64, scene: &str, call: &str) -> f64 {
    usual * (0.5 + drawn(&format!("{scene} {call}")))
}

fn millis() -> u128 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_millis()
}

impl Waits {
    async fn wait(&self, call: &str) {
        let begun = millis();
        tokio::time::sleep(Duration::from_secs_f64(latency(self.seconds, &self.scene, call))).await;
        // One write a line: lines of many programs stay whole.
        let line = format!("{}\t{}\t{call}\t{begun}\t{}\n", self.card.player, self.scene, millis());
        OpenOptions::new().create(true).append(true).open(&self.ledger).unwrap().write_all(line.as_bytes()).unwrap();
    }
}

#[async_trait]
impl VisionLanguage for Waits {
    fn card(&self) -> PlayerCard {
        self.card.clone()
    }

    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        self.wait(&request.name).await;
        let value = json!({ "word": blake3::hash(request.prompt.as_bytes()).to_hex()[..12].to_owned() });
        let usage = Usage { input_tokens: 900, output_tokens: 100, ..Usage::default() };
        Ok(VlmAnswer { raw: value.to_string(), value, usage })
    }
}

#[async_trait]
impl ImageEditor for Waits {
    fn card(&self) -> PlayerCard {
        self.card.clone()
    }

    async fn edit(&self, request: &EditRequest) -> Result<EditedImage, RoleError> {
        self.wait(&request.name).await;
        let shade = (drawn(&request.instruction) * 255.0) as u8;
        let (w, h) = request.image.dimensions();
        Ok(EditedImage { image: RgbaImage::from_pixel(w, h, Rgba([shade, 7, 9, 255])), usage: Usage::default() })
    }
}

/// Whoever is not there.
struct Nobody;

fn nobody() -> PlayerCard {
    PlayerCard { player: "nobody".into(), model: "none".into(), offline: true, concurrency: 0 }
}

fn absent() -> RoleError {
    RoleError::NotSetUp { player: "nobody".into(), reason: "nobody plays this here".into(), hint: String::new() }
}

macro_rules! absent {
    ($($role:ident :: $method:ident ($request:ty) -> $answer:ty;)+) => {$(
        #[async_trait]
        impl $role for Nobody {
            fn card(&self) -> PlayerCard {
                nobody()
            }

            async fn $method(&self, _: &$request) -> Result<$answer, RoleError> {
                Err(absent())
            }
        }
    )+};
}

absent! {
    VisionLanguage::ask(VlmRequest) -> VlmAnswer;
    ImageEditor::edit(EditRequest) -> EditedImage;
    MeshGenerator::generate(MeshRequest) -> GeneratedMesh;
    GeometryEstimator::estimate(GeometryRequest) -> GeometryAnswer;
    Detector::detect(DetectRequest) -> Detections;
    Segmenter::segment(SegmentRequest) -> Vec<SegmentedMask>;
    LitRenderer::render(LitRequest) -> LitImage;
}

/// The calls of a scene: question by question, then a chain of edit, question and mesh for each object beside each
/// other, then a last question.
struct Plan {
    before: Vec<String>,
    chains: Vec<[String; 3]>,
    after: String,
}

impl Plan {
    fn new(objects: usize) -> Self {
        Self {
            before: vec!["1_layout/layout".into(), "3_furniture/list".into(), "3_furniture/inspect".into()],
            chains: (0..objects)
                .map(|i| ["complete", "check", "mesh"].map(|step| format!("3_furniture/{step}/thing_{i:02}")))
                .collect(),
            after: "6_lighting/lights".into(),
        }
    }

    /// Seconds that the scene takes when nobody is waited for but its own players.
    fn seconds(&self, scene: &str) -> f64 {
        let question = |name: &String| latency(QUESTION_S, scene, name);
        let chain = |[edit, check, mesh]: &[String; 3]| {
            latency(EDIT_S, scene, edit) + question(check) + latency(MESH_S, scene, mesh)
        };
        self.before.iter().map(question).sum::<f64>()
            + self.chains.iter().map(chain).fold(0.0, f64::max)
            + question(&self.after)
    }
}

/// Seconds that a scene takes alone with players of its own, at full length; and of its meshes, added up.
pub fn ideal_seconds(scene: &str, objects: usize) -> (f64, f64) {
    let plan = Plan::new(objects);
    let meshes = plan.chains.iter().map(|[_, _, mesh]| latency(MESH_S, scene, mesh)).sum();
    (plan.seconds(scene), meshes)
}

/// Calls of a scene.
pub fn calls_of(objects: usize) -> usize {
    4 + 3 * objects
}

/// Makes the scene; returns the exit code of `harmony reconstruct`.
pub async fn run(args: &Args) -> u8 {
    let photo = std::fs::read(&args.photo).unwrap();
    let scene = args.out.file_name().unwrap().to_str().unwrap().to_owned();
    std::fs::create_dir_all(&args.out).unwrap();
    let lock = File::options().create(true).truncate(false).write(true).open(args.out.join(".lock")).unwrap();
    if lock.try_lock().is_err() {
        eprintln!("error: another program is at work in {}", args.out.display());
        return 1;
    }
    let word = String::from_utf8_lossy(&photo).into_owned();
    if word.contains("no picture") {
        eprintln!("error: {} is no picture: {} bytes", args.photo.display(), photo.len());
        return 1;
    }
    if word.contains("crash") {
        std::process::abort();
    }
    if word.contains("endless") {
        tokio::time::sleep(Duration::from_hours(1)).await;
    }
    let shared = match inside::shared_players().await {
        Ok(shared) => shared.map(|s| Arc::new(s.with_minute(Duration::from_secs_f64(60.0 / args.speed)))),
        Err(error) => {
            eprintln!("error: {error}");
            return 1;
        }
    };
    let waits = |player: &str, seconds: f64, concurrency: usize| {
        Arc::new(Waits {
            card: PlayerCard { player: player.into(), model: "1".into(), offline: false, concurrency },
            seconds: seconds / args.speed,
            scene: scene.clone(),
            ledger: args.ledger.clone(),
        })
    };
    let nobody = Arc::new(Nobody);
    let cast = |editor: Arc<dyn ImageEditor>, vision_language: Arc<dyn VisionLanguage>| Cast {
        vision_language,
        image_editor: editor,
        mesh_generator: nobody.clone(),
        geometry_estimator: nobody.clone(),
        detector: nobody.clone(),
        segmenter: nobody.clone(),
        lit_renderer: nobody.clone(),
    };
    let language = waits("language", QUESTION_S, 0);
    let book = Arc::new(CallBook::open(&args.out, BookOptions::default()).unwrap());
    let mut limits = Limits { minute: Some(Duration::from_secs_f64(60.0 / args.speed)), ..Limits::default() };
    limits.players.insert(
        "language".into(),
        PlayerLimits { requests_per_minute: args.questions_a_minute, ..PlayerLimits::default() },
    );
    let price = |usd: f64| Price { call: usd, ..Price::default() };
    let models = [("language / 1", PRICES[0]), ("editor / 1", PRICES[1]), ("meshes / 1", PRICES[2])];
    let prices = Prices {
        models: models.into_iter().map(|(name, usd)| (name.to_owned(), price(usd))).collect(),
        ..Prices::default()
    };
    let make = |editor: Arc<Waits>| {
        let options = CallOptions {
            limits: limits.clone(),
            prices: prices.clone(),
            shared: shared.clone().map(|s| s as Arc<dyn harmony_calls::SharedLimits>),
            ..CallOptions::default()
        };
        let offline = cast(nobody.clone(), nobody.clone());
        Arc::new(Calls::new(Arc::clone(&book), cast(editor, language.clone()), offline, options))
    };
    // Meshes are edits here, of a player of their own.
    let calls = make(waits("editor", EDIT_S, 0));
    let meshes = make(waits("meshes", MESH_S, args.mesh_places));
    let stops = [Arc::clone(calls.stop()), Arc::clone(meshes.stop())];
    inside::when_worker_ends(move || {
        for stop in stops {
            stop.close(StopReason::Interrupted("the worker has ended, or wants this scene to stop".into()));
        }
    });
    let made = Box::pin(answers(&calls, &meshes, &word, args.objects)).await;
    let code = match made {
        _ if word.contains("never works") => {
            let run = json!({"phases": {"1_layout": {"state": "done", "outcome": "ok"},
                "3_furniture": {"state": "failed", "outcome": format!("no answer to inspect of {} things", args.objects)}}});
            harmony_io::write_json(&args.out.join("run.json"), &run).unwrap();
            3
        }
        Ok(words) => {
            let bill = Bill::of(&book.log().unwrap());
            harmony_io::write_json(&args.out.join("bill.json"), &bill.without_times()).unwrap();
            harmony_io::write_json(&args.out.join("scene.json"), &words).unwrap();
            0
        }
        Err(error) if calls.stop().reason().is_some() || meshes.stop().reason().is_some() => {
            eprintln!("error: {error}");
            4
        }
        Err(error) => {
            eprintln!("error: {error}");
            3
        }
    };
    if let Some(shared) = shared {
        shared.flush(Duration::from_secs(5)).await;
    }
    drop(lock);
    code
}

async fn answers(calls: &Arc<Calls>, meshes: &Arc<Calls>, word: &str, objects: usize) -> Result<Value, RoleError> {
    let plan = Plan::new(objects);
    let mut words = serde_json::Map::new();
    let mut so_far = word.to_owned();
    for name in &plan.before {
        so_far = ask(calls, name, &so_far).await?;
        words.insert(name.clone(), so_far.clone().into());
    }
    let mut chains = tokio::task::JoinSet::new();
    for chain in plan.chains {
        let (calls, meshes, so_far) = (Arc::clone(calls), Arc::clone(meshes), so_far.clone());
        chains.spawn(async move {
            let [edited, check, mesh] = chain;
            let shade = edit(&calls, &edited, &so_far).await?;
            let word = ask(&calls, &check, &format!("{so_far} {shade}")).await?;
            let shade = edit(&meshes, &mesh, &word).await?;
            Ok::<_, RoleError>((mesh, format!("{word} {shade}")))
        });
    }
    let mut failure = None;
    let mut parts = Vec::new();
    while let Some(chain) = chains.join_next().await {
        match chain.unwrap() {
            Ok(part) => parts.push(part),
            Err(error) => failure = Some(error),
        }
    }
    if let Some(error) = failure {
        return Err(error);
    }
    parts.sort();
    for (name, part) in parts {
        so_far += &part;
        words.insert(name, part.into());
    }
    let last = ask(calls, &plan.after, &so_far).await?;
    words.insert(plan.after, last.into());
    Ok(Value::Object(words))
}

async fn ask(calls: &Calls, name: &str, prompt: &str) -> Result<String, RoleError> {
    let request = VlmRequest {
        name: name.to_owned(),
        prompt: prompt.to_owned(),
        pictures: Vec::new(),
        schema: json!({"type": "object", "properties": {"word": {"type": "string"}}, "required": ["word"],
            "additionalProperties": false}),
        example: json!({"word": "x"}),
        question: None,
    };
    let answer = calls.ask(&request, |_| Ok(())).await?;
    Ok(answer.value["word"].as_str().unwrap_or_default().to_owned())
}

async fn edit(calls: &Calls, name: &str, words: &str) -> Result<u8, RoleError> {
    let request = EditRequest {
        name: name.to_owned(),
        kind: EditKind::Amodal,
        image: Arc::new(image::RgbImage::new(2, 2)),
        mask: None,
        object: None,
        instruction: words.to_owned(),
    };
    Ok(calls.edit(&request).await?.image.get_pixel(0, 0)[0])
}

/// Everything of a run folder that is the same however it was made: no times, no lock.
pub fn lasting(run: &Path) -> std::collections::BTreeMap<PathBuf, Vec<u8>> {
    let mut files = std::collections::BTreeMap::new();
    let mut folders = vec![run.to_owned()];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = std::fs::read_dir(&folder) else { continue };
        for entry in entries.flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if !["timing.json", ".lock"].contains(&entry.file_name().to_str().unwrap_or_default()) {
                let bytes = std::fs::read(&path).unwrap();
                files.insert(path.strip_prefix(run).unwrap().to_owned(), bytes);
            }
        }
    }
    files
}
