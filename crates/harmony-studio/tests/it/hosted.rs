//! Each hosted mesh generator against its double, whole and with faults: meshes come in our frame, nothing is paid twice,
//! and what cannot be helped is said.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use harmony_bench::oracle::NoiseLevel;
use harmony_calls::{BookOptions, CallBook, CallOptions, Calls, Cast, Limits, Price, Prices, RetryPolicy};
use harmony_mesh::TemplateParams;
use harmony_players::flat_cast;
use harmony_players::http::{ApiKey, Auth, Http, HttpLimits, ServiceOptions};
use harmony_players::mesh::hosted::tasks::Tasks;
use harmony_players::mesh::hosted::{Host, HostedOptions, HostedPlayer};
use harmony_roles::{MeshGenerator, MeshRequest, MeshSettings, RoleError};
use harmony_scene::{Level, Size};
use harmony_studio::faults::{Fault, FaultPlan, Part};
use harmony_studio::services::Service;
use harmony_studio::truth_oracle::TruthOracle;
use harmony_studio::{KEY, Studio, StudioOptions, rooms};
use image::{Rgba, RgbaImage};

const HOSTS: [(Service, Host, &str); 4] = [
    (Service::Fal, Host::Fal, "fal-ai/trellis"),
    (Service::Replicate, Host::Replicate, "firtoz/trellis:1"),
    (Service::Tripo, Host::Tripo, "v2.5-20250123"),
    (Service::Meshy, Host::Meshy, "meshy-6"),
];

struct Room {
    _folder: tempfile::TempDir,
    truth_oracle: Arc<TruthOracle>,
}

fn room() -> Room {
    let folder = tempfile::tempdir().unwrap();
    let truth = rooms::small(folder.path()).unwrap();
    Room {
        truth_oracle: Arc::new(TruthOracle::new(truth, NoiseLevel::Clean.noise(), 1, false).unwrap()),
        _folder: folder,
    }
}

async fn studio(room: &Room, always: Option<Fault>) -> Studio {
    let always = always.map(|fault| (Part::HostedMesh, fault));
    let faults = FaultPlan { seed: 1, always, ..FaultPlan::default() };
    Studio::start(Arc::clone(&room.truth_oracle), StudioOptions { faults, ..StudioOptions::default() }, 0)
        .await
        .unwrap()
}

fn player(studio: &Studio, which: usize, tasks: Tasks) -> HostedPlayer {
    let (service, host, model) = HOSTS[which];
    let key = ApiKey::new("STUDIO_KEY", KEY).unwrap();
    let options = HostedOptions {
        service: ServiceOptions {
            player: service.prefix().to_owned(),
            address: studio.base(service),
            auth: if host == Host::Fal { Auth::Scheme("Key", key) } else { Auth::Bearer(key) },
            limits: HttpLimits { total: Duration::from_secs(5), ..HttpLimits::default() },
            remedy: "look at the studio".to_owned(),
        },
        host,
        model: model.to_owned(),
        texture: true,
        seed: 1,
        extra: serde_json::Map::new(),
        frame: None,
        usd_per_credit: Some(0.01),
        poll: Duration::from_millis(10),
        patience: Duration::from_secs(10),
        tasks: Arc::new(tasks),
        concurrency: 2,
    };
    HostedPlayer::new(&Http::new(None, Duration::from_secs(5)).unwrap(), options).unwrap()
}

/// The object of the room that is seen best, cut out of the photo.
fn request(room: &Room) -> MeshRequest {
    let truth = room.truth_oracle.room();
    let photo = harmony_io::load_photo(&truth.photo()).unwrap();
    let size = photo.size();
    let most = truth.objects.iter().max_by_key(|object| room.truth_oracle.mask(object, size).count()).unwrap();
    let mask = room.truth_oracle.mask(most, size);
    let crop = RgbaImage::from_fn(size.width, size.height, |x, y| {
        let [r, g, b] = photo.image.get_pixel(x, y).0;
        Rgba([r, g, b, if mask.get(i64::from(x), i64::from(y)) { 255 } else { 0 }])
    });
    MeshRequest {
        name: "3_furniture/sofa_01/mesh".into(),
        crop: Arc::new(crop),
        label: "sofa".into(),
        description: "a sofa".into(),
        level: Level::Furniture,
        size: Size { width: 1.0, height: 1.0, depth: 1.0 },
        template: None,
        params: TemplateParams::default(),
        part_model: None,
        settings: MeshSettings { faces: 4000, ..MeshSettings::default() },
    }
}

/// Tasks that were made, each of them paid.
fn made(studio: &Studio) -> u64 {
    studio.ledger.tasks.load(Ordering::Relaxed)
}

#[tokio::test(flavor = "multi_thread")]
async fn every_service_makes_the_mesh_of_the_truth_in_our_frame() {
    let room = room();
    let request = request(&room);
    let truth = room.truth_oracle.mesh(&request.crop).unwrap().bounds().unwrap().size();
    for (which, (service, host, _)) in HOSTS.into_iter().enumerate() {
        let studio = studio(&room, None).await;
        let player = player(&studio, which, Tasks::default());
        let name = service.prefix();
        let mesh = player.generate(&request).await.unwrap_or_else(|error| panic!("{name}: {error}"));
        let size = mesh.mesh.bounds().unwrap().size();
        assert!((size - truth).length() < 0.02 * truth.length(), "{name}: {size} for {truth}");
        let credits = matches!(host, Host::Tripo | Host::Meshy);
        assert_eq!(mesh.usage.cost_usd, credits.then_some(0.3), "{name}: 30 credits of a cent");
        assert_eq!(made(&studio), 1, "{name}");
        // The same again is the same task.
        player.generate(&request).await.unwrap();
        assert_eq!(made(&studio), 1, "{name}: paid once");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_task_is_gone_on_with_by_another_start_of_the_program() {
    let room = room();
    let request = request(&room);
    for (which, (service, ..)) in HOSTS.into_iter().enumerate() {
        let studio = studio(&room, None).await;
        let folder = tempfile::tempdir().unwrap();
        let name = service.prefix();
        let first = player(&studio, which, Tasks::in_folder(folder.path().join("tasks")));
        // Killed as soon as the task is made.
        let killed = tokio::time::timeout(Duration::from_secs(20), async {
            tokio::select! {
                made = first.generate(&request) => panic!("{name}: not killed in time: {:?}", made.map(|m| m.source)),
                () = async { while made(&studio) == 0 || std::fs::read_dir(folder.path().join("tasks")).is_err() {
                    tokio::time::sleep(Duration::from_millis(1)).await;
                } } => {}
            }
        });
        killed.await.unwrap();
        let second = player(&studio, which, Tasks::in_folder(folder.path().join("tasks")));
        second.generate(&request).await.unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(made(&studio), 1, "{name}: paid once");
        let notes = std::fs::read_dir(folder.path().join("tasks")).unwrap();
        for note in notes {
            let text = std::fs::read_to_string(note.unwrap().path()).unwrap();
            assert!(text.contains("sofa_01") && !text.contains(KEY), "{name}: {text}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn broken_looks_and_files_and_links_that_end_are_not_paid_again() {
    let room = room();
    let request = request(&room);
    for (which, (service, ..)) in HOSTS.into_iter().enumerate() {
        let name = service.prefix();
        let broken = studio(&room, Some(Fault::BrokenLooks)).await;
        let mesh = player(&broken, which, Tasks::default()).generate(&request).await;
        assert!(mesh.is_ok(), "{name}: {:?}", mesh.err());
        assert_eq!(made(&broken), 1, "{name}: paid once");

        let expired = studio(&room, Some(Fault::ExpiredLink)).await;
        let mesh = player(&expired, which, Tasks::default()).generate(&request).await;
        assert_eq!(made(&expired), 1, "{name}: paid once");
        if matches!(service, Service::Tripo | Service::Meshy) {
            assert!(mesh.is_ok(), "{name}: another look gives another link: {:?}", mesh.err());
        } else {
            let error = mesh.unwrap_err();
            assert!(
                matches!(&error, RoleError::NotCapable { reason, .. } if reason.contains("link") && reason.contains("--from")),
                "{name}: it says what to do: {error}"
            );
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_helped_is_told_apart() {
    let room = room();
    let request = request(&room);
    for (which, (service, ..)) in HOSTS.into_iter().enumerate() {
        let name = service.prefix();
        let error = async |fault| {
            let studio = studio(&room, Some(fault)).await;
            let error = player(&studio, which, Tasks::default()).generate(&request).await.unwrap_err();
            assert!(!format!("{error} {error:?}").contains(KEY), "{name}");
            error
        };
        let spent = error(Fault::AccountSpent).await;
        let top_up = spent.hint().is_some_and(|hint| hint.contains("top up"));
        assert!(top_up && spent.to_string().contains("used up"), "{name}: {spent}");
        assert!(matches!(error(Fault::TaskRefused).await, RoleError::Refused { .. }), "{name}");
        let failed = error(Fault::TaskFailed).await;
        assert!(failed.is_retryable() && failed.to_string().contains("CUDA"), "{name}: {failed}");
        let limited = error(Fault::RateLimitedWait).await;
        assert_eq!((limited.status(), limited.retry_after()), (Some(429), Some(Duration::from_millis(40))), "{name}");
        for fault in [Fault::HalfGlb, Fault::EmptyMesh] {
            let error = error(fault).await;
            assert!(matches!(error, RoleError::UnusableAnswer { .. }), "{name} {fault:?}: {error}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_task_that_never_ends_is_given_up_and_cancelled_where_that_can_be() {
    let room = room();
    let request = request(&room);
    for (which, (service, ..)) in HOSTS.into_iter().enumerate() {
        let studio = studio(&room, Some(Fault::TaskStuck)).await;
        let mut player = player(&studio, which, Tasks::default());
        player.be_patient_for(Duration::from_millis(300));
        let error = player.generate(&request).await.unwrap_err();
        let can = matches!(service, Service::Fal | Service::Replicate);
        assert_eq!(studio.ledger.cancelled.load(Ordering::Relaxed), u64::from(can), "{}", service.prefix());
        let said = if can { "it was cancelled" } else { "no way to cancel" };
        assert!(matches!(&error, RoleError::NotCapable { reason, .. } if reason.contains(said)), "{error}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_call_book_retries_without_paying_twice_and_bills_by_the_price_table() {
    let room = room();
    let request = request(&room);
    for (which, (service, _, model)) in HOSTS.into_iter().enumerate() {
        let name = service.prefix();
        // All of the ways in which a line and a service can fail, drawn by content.
        for seed in 0..6 {
            let only = vec![Fault::BrokenLooks, Fault::Slow, Fault::ServerError, Fault::RateLimited, Fault::Close];
            let faults = FaultPlan { seed, share: 0.7, always: None, only };
            let options = StudioOptions { faults, ..StudioOptions::default() };
            let studio = Studio::start(Arc::clone(&room.truth_oracle), options, 0).await.unwrap();
            let folder = tempfile::tempdir().unwrap();
            let book = Arc::new(CallBook::open(folder.path(), BookOptions::default()).unwrap());
            let cast = Cast { mesh_generator: Arc::new(player(&studio, which, Tasks::default())), ..flat_cast() };
            let retry = RetryPolicy { retries: 8, first_seconds: 0.01, most_seconds: 0.02, ..RetryPolicy::default() };
            let mut prices = Prices::default();
            prices.models.insert(format!("{name} / {model}"), Price { mesh: 0.3, ..Price::default() });
            let limits = Limits { retry, ..Limits::default() };
            let calls = Calls::new(
                Arc::clone(&book),
                cast,
                flat_cast(),
                CallOptions { limits, prices, ..CallOptions::default() },
            );
            calls.generate_mesh(&request).await.unwrap_or_else(|error| panic!("{name} {seed}: {error}"));
            assert_eq!(calls.counts().replaced, 0, "{name} {seed}");
            assert_eq!(studio.ledger.paid_twice(), [], "{name} {seed}");
            let usd = calls.now().spent.usd;
            assert!(usd >= 0.3 - 1e-9, "{name} {seed}: {usd} US$");
            let log = book.log().unwrap();
            assert_eq!(log.iter().filter_map(|call| call.usage.cost_usd).sum::<f64>(), 0.3, "{name} {seed}: the bill");
        }
    }
}
