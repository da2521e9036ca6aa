//! Rates are learnt from answers: a full bucket is waited for, no 429 is drawn.

use std::sync::Arc;
use std::time::{Duration, Instant};

use harmony_bench::oracle::NoiseLevel;
use harmony_calls::{BookOptions, CallBook, CallOptions, Calls, Cast};
use harmony_players::flat_cast;
use harmony_players::http::{ApiKey, Auth, Http, HttpLimits, ServiceOptions};
use harmony_players::vlm::wire::ModelSettings;
use harmony_players::vlm::{Format, VlmOptions, VlmPlayer};
use harmony_prompts::ListQuestion;
use harmony_roles::VlmRequest;
use harmony_scene::Level;
use harmony_studio::services::Service;
use harmony_studio::truth_oracle::TruthOracle;
use harmony_studio::{KEY, Studio, StudioOptions, rooms};

/// Requests in a window, and how long that is.
const REQUESTS: u32 = 3;
const WINDOW: Duration = Duration::from_millis(1200);

#[tokio::test(flavor = "multi_thread")]
async fn a_full_bucket_is_waited_for_and_no_429_is_drawn() {
    let work = tempfile::tempdir().unwrap();
    let room = rooms::small(work.path()).unwrap();
    let truth_oracle = Arc::new(TruthOracle::new(room, NoiseLevel::Clean.noise(), 1, false).unwrap());
    for (service, format) in [(Service::OpenAi, Format::Responses), (Service::Anthropic, Format::Anthropic)] {
        let options = StudioOptions { requests: REQUESTS, window: WINDOW, ..StudioOptions::default() };
        let studio = Studio::start(Arc::clone(&truth_oracle), options, 0).await.unwrap();
        let key = ApiKey::new("STUDIO_KEY", KEY).unwrap();
        let service = ServiceOptions {
            player: service.prefix().to_owned(),
            address: studio.base(service),
            auth: if service == Service::OpenAi { Auth::Bearer(key) } else { Auth::Header("x-api-key", key) },
            limits: HttpLimits::default(),
            remedy: String::new(),
        };
        let settings = ModelSettings { model: "a-model".into(), detail: "low".into(), ..ModelSettings::default() };
        let http = Http::new(None, Duration::from_secs(5)).unwrap();
        let player = VlmPlayer::new(&http, VlmOptions { service, format, settings, concurrency: 1 }).unwrap();
        let cast = Cast { vision_language: Arc::new(player), ..flat_cast() };
        let run = tempfile::tempdir().unwrap();
        let book = Arc::new(CallBook::open(run.path(), BookOptions::default()).unwrap());
        let calls = Calls::new(book, cast, flat_cast(), CallOptions::default());
        let begun = Instant::now();
        for i in 0..=2 * REQUESTS {
            let question = ListQuestion {
                level: Level::Furniture,
                room_type: format!("room {i}"),
                with_boxes: false,
                placed: vec![],
                trays: vec![],
                view: None,
            };
            let request = VlmRequest::new(format!("3_furniture/list_{i}"), question.into(), vec![]);
            calls.ask(&request, |_| Ok(())).await.unwrap();
        }
        let statuses: Vec<u16> = studio.ledger.entries().iter().map(|entry| entry.status).collect();
        assert_eq!(statuses, vec![200; 2 * REQUESTS as usize + 1], "{format:?}");
        assert!(begun.elapsed() >= WINDOW * 19 / 10, "two windows were waited for");
        assert_eq!(calls.counts().replaced, 0);
    }
}
