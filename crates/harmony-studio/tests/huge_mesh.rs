//! Meshes of five million faces, through each generator: they are brought to the budget, in bounded memory and time.
//!
//! One test in a program of its own: memory is that of the whole process, the studio's side of it included.
#![allow(clippy::unwrap_used, reason = "tests")]

use std::sync::Arc;
use std::time::{Duration, Instant};

use harmony_bench::oracle::NoiseLevel;
use harmony_mesh::TemplateParams;
use harmony_players::http::{Auth, Http, HttpLimits, ServiceOptions};
use harmony_players::mesh::finish::{Finish, SourceFrame, finished};
use harmony_players::mesh::hunyuan::{HunyuanOptions, HunyuanPlayer, Route, Version};
use harmony_players::mesh::trellis::{Host, TrellisOptions, TrellisPlayer};
use harmony_roles::{MeshGenerator, MeshRequest, MeshSettings};
use harmony_scene::{Level, Size};
use harmony_studio::faults::{Fault, FaultPlan, Part};
use harmony_studio::services::Service;
use harmony_studio::soak::{forget_peak, one, status_mib};
use harmony_studio::truth_oracle::TruthOracle;
use harmony_studio::{Studio, StudioOptions, glb, rooms};
use image::{Rgba, RgbaImage};

/// Most triangles that are wanted.
const FACES: u32 = 20_000;

/// What a mesh of five million faces may need at its worst, MiB: the answer as it came (60 MiB, by base64 and JSON up to
/// three times that), positions and faces as read, and the tables of the simplification.
const MAX_MIB: u64 = 1800;

/// And how long, on a busy machine with a build for development.
const MOST: Duration = Duration::from_mins(3);

fn request() -> MeshRequest {
    MeshRequest {
        name: "3_furniture/mesh/chair_01".into(),
        crop: Arc::new(RgbaImage::from_pixel(64, 64, Rgba([120, 90, 60, 255]))),
        label: "chair".into(),
        description: "a chair".into(),
        level: Level::Furniture,
        size: Size { width: 0.5, height: 0.9, depth: 0.5 },
        template: None,
        params: TemplateParams::default(),
        part_model: None,
        settings: MeshSettings { faces: FACES, ..MeshSettings::default() },
    }
}

/// Runs something, and tells what it took.
async fn measured<T>(what: &str, work: impl Future<Output = T>) -> (T, u64, Duration) {
    let before = status_mib("VmRSS");
    forget_peak();
    let begun = Instant::now();
    let result = work.await;
    let (took, peak) = (begun.elapsed(), status_mib("VmHWM"));
    eprintln!("{what}: {:.1} s, {before} MiB before, {peak} MiB at most", took.as_secs_f64());
    (result, peak, took)
}

#[tokio::test(flavor = "multi_thread")]
async fn five_million_faces_are_brought_to_the_budget_in_bounded_memory_and_time() {
    let folder = tempfile::tempdir().unwrap();
    let room = rooms::small(folder.path()).unwrap();
    let truth_oracle = Arc::new(TruthOracle::new(room.clone(), NoiseLevel::Clean.noise(), 1, false).unwrap());
    let always = Some((Part::Mesh, Fault::HugeMesh));
    let faults = FaultPlan { seed: 1, always, ..FaultPlan::default() };
    let options = StudioOptions { faults: faults.clone(), ..StudioOptions::default() };
    let studio = Studio::start(truth_oracle, options, 0).await.unwrap();
    let http = Http::new(None, Duration::from_secs(5)).unwrap();
    // Base64 makes the file of a TRELLIS server a third larger than the usual limit.
    let limits = HttpLimits { answer_bytes: 128 << 20, ..HttpLimits::default() };
    let at = |service: Service| ServiceOptions {
        player: service.prefix().into(),
        address: studio.base(service),
        auth: Auth::None,
        limits,
        remedy: String::new(),
    };
    let hunyuan = |service, version, route| {
        let (service, model) = (at(service), "m".to_owned());
        let poll = Duration::from_millis(20);
        let options = HunyuanOptions { service, version, model, route, texture: true, seed: 1, poll, concurrency: 1 };
        Arc::new(HunyuanPlayer::new(&http, options).unwrap())
    };
    let trellis = |service, host| {
        let options = TrellisOptions { service: at(service), host, model: "m".into(), seed: 1, concurrency: 1 };
        Arc::new(TrellisPlayer::new(&http, options).unwrap())
    };
    let generators: [(&str, Arc<dyn MeshGenerator>); 4] = [
        ("hunyuan 2", hunyuan(Service::Hunyuan2, Version::V2, Route::Generate)),
        ("hunyuan 2.1, a job", hunyuan(Service::Hunyuan21, Version::V2_1, Route::Send)),
        ("trellis nim", trellis(Service::TrellisNim, Host::Nim)),
        ("trellis localai", trellis(Service::TrellisLocalAi, Host::LocalAi)),
    ];
    for (name, generator) in generators {
        let request = request();
        let (made, peak, took) = measured(name, generator.generate(&request)).await;
        let made = made.unwrap_or_else(|error| panic!("{name}: {error}"));
        let count = made.mesh.triangle_count();
        assert!(count > 1000 && count <= FACES as usize, "{name}: {count} triangles");
        made.mesh.check().unwrap();
        assert!(made.notes.iter().any(|note| note.contains("simplified")), "{name}: {:?}", made.notes);
        assert!(peak > 0 && peak < MAX_MIB && took < MOST, "{name}: {peak} MiB, {took:?}");
    }

    // The usual limit on answers holds for it as for everything else.
    let small = ServiceOptions { limits: HttpLimits { answer_bytes: 32 << 20, ..limits }, ..at(Service::TrellisNim) };
    let options = TrellisOptions { service: small, host: Host::Nim, model: "m".into(), seed: 1, concurrency: 1 };
    let error = TrellisPlayer::new(&http, options).unwrap().generate(&request()).await.unwrap_err();
    assert!(error.to_string().contains("33554432"), "{error}");

    // Five million *different* faces, as octree 384 without texture leaves them, read from a file.
    let file = glb::sheet(1583, glb::HUGE_FACES);
    let read = async {
        let finish = Finish { faces: FACES as usize, frame: SourceFrame::default(), not_metal: false };
        tokio::task::spawn_blocking(move || finished(&file, &finish)).await.unwrap()
    };
    let (made, peak, took) = measured("five million different faces", read).await;
    let (mesh, notes) = made.unwrap();
    assert!(mesh.triangle_count() > 1000 && mesh.triangle_count() <= FACES as usize, "{}", mesh.triangle_count());
    assert!(notes.iter().any(|note| note.contains("simplified from")), "{notes:?}");
    assert!(peak < 2 * MAX_MIB && took < MOST, "{peak} MiB, {took:?}");

    // And a whole run of which every mesh is such a one.
    let out = folder.path().join("run");
    let (ended, peak, _) = measured("a run of such meshes", one(&room, 3, faults, &out)).await;
    let ended = ended.unwrap();
    eprintln!("{ended:?}");
    assert_eq!(ended.wrong, Vec::<String>::new());
    assert!(ended.end.starts_with("scene") && ended.objects > 0, "{ended:?}");
    assert!(ended.faults.contains_key(&Fault::HugeMesh), "{ended:?}");
    assert!(peak < 2 * MAX_MIB, "{peak} MiB");
}
