//! Fetching from something that behaves like a model hub: redirects to another host, ranges, marks, refusals, breaks.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

mod hub;

use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;

use harmony_models::{
    Checksum, Endpoints, Event, FileState, Hub, HubOptions, LEDGER, Licence, Model, ModelError, ModelFile, PullLimits,
    Source, Store, Token,
};
use hub::{FakeHub, Front, Storage};
use sha2::{Digest, Sha256};

const BODY: &[u8] = b"0123456789abcdefghijklmnopqrstuvwxyz of weights";
const COMMIT: &str = "0123456789abcdef0123456789abcdef01234567";

const FREE: Licence =
    Licence { id: "free", title: "", terms: "", address: "", restricted: false, non_commercial: false };
const BOUND: Licence = Licence { id: "bound", restricted: true, non_commercial: true, ..FREE };

fn sum(body: &[u8]) -> String {
    let digits = b"0123456789abcdef";
    let both = Sha256::digest(body).into_iter().flat_map(|b| [b >> 4, b & 15]);
    both.map(|d| char::from(digits[usize::from(d)])).collect()
}

/// A model of one file; its checksum and size are known where a body is given.
fn model(pinned: Option<&[u8]>, licence: &'static Licence) -> Model {
    let file = ModelFile {
        name: "model.safetensors",
        path: "model.safetensors",
        source: Source::Hub { repo: "maker/net", revision: pinned.map(|_| COMMIT) },
        size: pinned.map(|b| b.len() as u64),
        sha256: pinned.map(|b| &*sum(b).leak()),
    };
    Model { id: "net", what: "tests", licence, files: Box::leak(Box::new([file])), note: "" }
}

fn client(fake: &FakeHub, token: Option<&str>) -> Hub {
    let address = format!("http://127.0.0.1:{}", fake.port);
    let limits = PullLimits {
        connect: Duration::from_secs(2),
        silence: Duration::from_millis(300),
        tries: 3,
        first_wait: Duration::from_millis(5),
        longest_wait: Duration::from_millis(50),
    };
    let endpoints = Endpoints::new(&address, &address, &address).unwrap();
    Hub::new(HubOptions { endpoints, token: token.and_then(Token::new), only: None, limits }).unwrap()
}

struct Case {
    folder: tempfile::TempDir,
    fake: FakeHub,
    events: Mutex<Vec<Event>>,
}

impl Case {
    async fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap(), fake: FakeHub::start(BODY).await, events: Mutex::default() }
    }

    fn store(&self) -> Store {
        Store::new(self.folder.path())
    }

    async fn pull_with(&self, model: &Model, token: Option<&str>) -> Result<(), ModelError> {
        self.events.lock().unwrap().clear();
        let store = self.store();
        let lock = store.lock()?;
        let tell = |event| self.events.lock().unwrap().push(event);
        client(&self.fake, token).pull(&store, &lock, model, &tell).await
    }

    async fn pull(&self, model: &Model) -> Result<(), ModelError> {
        self.pull_with(model, None).await
    }

    fn bytes(&self) -> Vec<u8> {
        std::fs::read(self.folder.path().join("net/model.safetensors")).unwrap()
    }

    fn nothing_left(&self) {
        for name in ["model.safetensors", "model.safetensors.part", "model.safetensors.part.json"] {
            assert!(!self.folder.path().join("net").join(name).exists(), "{name} is there");
        }
    }

    /// Why it began anew.
    fn anew(&self) -> Vec<String> {
        let events = self.events.lock().unwrap();
        events
            .iter()
            .filter_map(|e| if let Event::Anew { reason, .. } = e { Some(reason.clone()) } else { None })
            .collect()
    }

    fn ranges(&self) -> Vec<Option<String>> {
        self.fake.seen("storage").iter().map(|s| s.header("range").map(str::to_owned)).collect()
    }
}

#[tokio::test]
async fn a_file_comes_over_a_redirect_and_is_there_the_next_time() {
    let case = Case::new().await;
    let model = model(Some(BODY), &FREE);
    case.pull(&model).await.unwrap();
    assert_eq!(case.bytes(), BODY);
    assert_eq!(case.fake.seen("hub")[0].path, format!("/maker/net/resolve/{COMMIT}/model.safetensors"));
    assert!(
        matches!(case.store().state(&model, &model.files[0]).unwrap(), FileState::Verified(k) if k.sha256 == sum(BODY))
    );
    case.pull(&model).await.unwrap();
    assert!(matches!(&case.events.lock().unwrap()[..], [Event::Already { .. }]));
    assert_eq!(case.fake.seen("hub").len(), 1, "nobody was asked again");
}

#[tokio::test]
async fn the_token_goes_to_the_hub_and_not_where_it_sends_us() {
    let case = Case::new().await;
    case.fake.set(|s| s.front = Front::Gated("hf_canary".to_owned()));
    let model = model(Some(BODY), &FREE);
    let error = case.pull(&model).await.unwrap_err();
    assert!(matches!(error, ModelError::Gated { status: 401, with_token: false, .. }), "{error}");
    let hint = error.hint().unwrap();
    assert!(hint.contains("/maker/net") && hint.contains("HF_TOKEN"), "{hint}");
    let error = case.pull_with(&model, Some("hf_wrong")).await.unwrap_err();
    assert!(error.hint().unwrap().contains("no access"), "{error}");
    assert!(!format!("{error:?}").contains("hf_wrong"));
    case.pull_with(&model, Some("hf_canary")).await.unwrap();
    assert_eq!(case.bytes(), BODY);
    let storage = case.fake.seen("storage");
    assert!(!storage.is_empty() && storage.iter().all(|s| s.header("authorization").is_none()));
}

#[tokio::test]
async fn a_break_is_gone_on_with_where_it_stopped() {
    let case = Case::new().await;
    case.fake.storage([Storage::Cut(10), Storage::Cut(7), Storage::Stall(5), Storage::Serve]);
    case.pull(&model(Some(BODY), &FREE)).await.unwrap();
    assert_eq!(case.bytes(), BODY);
    let at = |n: usize| Some(format!("bytes={n}-"));
    assert_eq!(case.ranges(), [None, at(10), at(17), at(22)]);
    let tags: Vec<_> = case.fake.seen("storage").iter().map(|s| s.header("if-range").map(str::to_owned)).collect();
    assert_eq!(tags[1..], [Some("\"first\"".to_owned()), Some("\"first\"".to_owned()), Some("\"first\"".to_owned())]);
}

#[tokio::test]
async fn the_next_process_goes_on_too() {
    let case = Case::new().await;
    let model = model(None, &FREE);
    case.fake.storage([Storage::Cut(12), Storage::Refuse(503, vec![])]);
    let error = case.pull(&model).await.unwrap_err();
    assert!(matches!(error, ModelError::Answer { passing: true, .. }), "{error}");
    let state = case.store().state(&model, &model.files[0]).unwrap();
    assert_eq!(state, FileState::Missing { partial: 12 });
    case.fake.storage([Storage::Serve]);
    case.pull(&model).await.unwrap();
    assert_eq!(case.bytes(), BODY);
    assert_eq!(case.ranges().last().unwrap().as_deref(), Some("bytes=12-"));
    assert!(case.anew().is_empty());
}

#[tokio::test]
async fn a_file_that_changed_meanwhile_is_fetched_from_its_start() {
    let case = Case::new().await;
    let model = model(None, &FREE);
    case.fake.storage([Storage::Cut(12), Storage::Refuse(500, vec![])]);
    case.pull(&model).await.unwrap_err();
    let other = b"quite another content, of another length too";
    case.fake.set(|s| (s.body, s.etag) = (other.to_vec(), Some("\"second\"".to_owned())));
    case.fake.storage([Storage::Serve]);
    case.pull(&model).await.unwrap();
    assert_eq!(case.bytes(), other);
    assert!(case.anew()[0].contains("changed"), "{:?}", case.anew());
}

#[tokio::test]
async fn a_server_that_mixes_two_contents_is_found_out() {
    // The mark is ignored: the rest of the new file comes for the beginning of the old one.
    let case = Case::new().await;
    let new: Vec<u8> = BODY.iter().map(u8::to_ascii_uppercase).collect();
    let model = model(Some(&new), &FREE);
    case.fake.storage([Storage::Cut(12), Storage::Refuse(500, vec![])]);
    case.pull(&model).await.unwrap_err();
    // With another mark it shows at once, with the same one by the checksum.
    for etag in ["\"second\"", "\"first\""] {
        std::fs::write(case.folder.path().join("net/model.safetensors.part"), &BODY[..12]).unwrap();
        case.fake.set(|s| (s.body, s.etag) = (new.clone(), Some(etag.to_owned())));
        case.fake.storage([Storage::CarelessRange, Storage::CarelessRange]);
        let _ = std::fs::remove_file(case.folder.path().join("net/model.safetensors"));
        case.pull(&model).await.unwrap();
        assert_eq!(case.bytes(), new, "{etag}");
        assert_eq!(case.anew().len(), 1, "{etag}: {:?}", case.anew());
        let about = format!(
            "{{\"what\":\"model.safetensors maker/net@{COMMIT} {COMMIT}\",\"etag\":\"\\\"first\\\"\",\"total\":{}}}",
            BODY.len()
        );
        std::fs::write(case.folder.path().join("net/model.safetensors.part.json"), about).unwrap();
    }
}

#[tokio::test]
async fn a_server_without_ranges_starts_over() {
    let case = Case::new().await;
    case.fake.storage([Storage::Cut(12), Storage::WholeOnly]);
    case.pull(&model(Some(BODY), &FREE)).await.unwrap();
    assert_eq!(case.bytes(), BODY);
    assert!(case.anew()[0].contains("whole files"), "{:?}", case.anew());
}

#[tokio::test]
async fn without_a_mark_only_a_pinned_file_is_gone_on_with() {
    for pinned in [Some(BODY), None] {
        let case = Case::new().await;
        case.fake.set(|s| s.etag = None);
        case.fake.storage([Storage::Cut(12), Storage::Serve]);
        case.pull(&model(pinned, &FREE)).await.unwrap();
        assert_eq!(case.bytes(), BODY);
        let again = if pinned.is_some() { Some("bytes=12-".to_owned()) } else { None };
        assert_eq!(case.ranges(), [None, again]);
    }
}

#[tokio::test]
async fn a_wrong_checksum_or_length_is_refused_with_both_and_nothing_stays() {
    let case = Case::new().await;
    let mut other = BODY.to_vec();
    other[3] ^= 1;
    let error = case.pull(&model(Some(&other), &FREE)).await.unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, ModelError::WrongChecksum { .. }), "{text}");
    assert!(
        text.contains(&sum(BODY)) && text.contains(&sum(&other)) && text.contains("net/model.safetensors"),
        "{text}"
    );
    case.nothing_left();
    let error = case.pull(&model(Some(b"short"), &FREE)).await.unwrap_err().to_string();
    assert!(error.contains("has 47 bytes, wanted 5"), "{error}");
    // The hub itself tells of another file: not a byte of it is fetched.
    case.fake.set(|s| (s.linked, s.seen) = (Some(format!("\"{}\"", sum(b"x"))), Vec::new()));
    let error = case.pull(&model(Some(BODY), &FREE)).await.unwrap_err();
    assert!(matches!(error, ModelError::WrongChecksum { .. }), "{error}");
}

#[tokio::test]
async fn an_unknown_checksum_is_pinned_at_the_first_pull() {
    let case = Case::new().await;
    let model = model(None, &FREE);
    case.fake.set(|s| (s.commit, s.linked) = (Some(COMMIT.to_owned()), Some(format!("\"{}\"", sum(BODY)))));
    case.pull(&model).await.unwrap();
    let known = case.store().known(&model, &model.files[0]).unwrap().unwrap();
    assert_eq!((known.checksum, known.revision.as_deref()), (Checksum::Hub, Some(COMMIT)));
    assert!(matches!(case.events.lock().unwrap().last(), Some(Event::Done { verified, .. }) if verified.first));
    // The same commit is asked for from then on, and only that content is taken.
    std::fs::remove_file(case.folder.path().join("net/model.safetensors")).unwrap();
    case.fake.set(|s| (s.body[0], s.linked) = (b'X', None));
    let error = case.pull(&model).await.unwrap_err();
    assert!(matches!(error, ModelError::WrongChecksum { .. }), "{error}");
    assert!(case.fake.seen("hub").last().unwrap().path.contains(&format!("/resolve/{COMMIT}/")));
    // What the hub says of its checksum must hold, too.
    let fresh = Case::new().await;
    fresh.fake.set(|s| s.linked = Some(format!("\"{}\"", sum(b"other"))));
    assert!(matches!(fresh.pull(&model).await.unwrap_err(), ModelError::WrongChecksum { .. }));
    // Without any word of the hub it is the first file that counts.
    let silent = Case::new().await;
    silent.pull(&model).await.unwrap();
    let known = silent.store().known(&model, &model.files[0]).unwrap().unwrap();
    assert_eq!(known.checksum, Checksum::FirstUse);
}

#[tokio::test]
async fn refusals_say_what_to_do() {
    let case = Case::new().await;
    let model = model(Some(BODY), &FREE);
    let refuse = |status, headers| case.fake.set(|s| s.front = Front::Refuse(status, headers));
    refuse(404, vec![("x-error-code", "RevisionNotFound".to_owned())]);
    let error = case.pull(&model).await.unwrap_err();
    assert!(matches!(error, ModelError::NotFound { .. }) && error.hint().unwrap().contains("mirror"), "{error}");
    refuse(403, vec![("x-error-message", "ask for access".to_owned())]);
    let error = case.pull(&model).await.unwrap_err().to_string();
    assert!(error.contains("403") && error.contains("ask for access"), "{error}");
    case.fake.set(|s| s.front = Front::Circle);
    let error = case.pull(&model).await.unwrap_err().to_string();
    assert!(error.contains("redirects"), "{error}");
    case.fake.set(|s| s.front = Front::Redirect);
    case.fake.storage([Storage::Refuse(403, vec![])]);
    let error = case.pull(&model).await.unwrap_err();
    assert!(!error.to_string().contains("canary-signature"), "{error}");
    case.fake.storage([Storage::Refuse(429, vec![("retry-after", "1".to_owned())]), Storage::Serve]);
    case.pull(&model).await.unwrap();
    let events = case.events.lock().unwrap();
    // The server's second is cut to the longest wait of this test.
    assert!(events.iter().any(|e| matches!(e, Event::Again { wait, .. } if *wait == Duration::from_millis(50))));
}

#[tokio::test]
async fn a_dead_or_slow_server() {
    let case = Case::new().await;
    let model = model(Some(BODY), &FREE);
    // Slow, but never silent for long.
    case.fake.storage([Storage::Slow(4)]);
    case.pull(&model).await.unwrap();
    assert_eq!(case.bytes(), BODY);
    std::fs::remove_file(case.folder.path().join("net/model.safetensors")).unwrap();
    case.fake.storage([Storage::Stall(6), Storage::Stall(0)]);
    let error = case.pull(&model).await.unwrap_err().to_string();
    assert!(error.contains("nothing came") && error.contains("6 bytes of 47 are kept"), "{error}");
}

#[tokio::test]
async fn a_licence_is_accepted_once() {
    let case = Case::new().await;
    let model = model(Some(BODY), &BOUND);
    let error = case.pull(&model).await.unwrap_err();
    assert!(matches!(error, ModelError::NotAccepted { .. }), "{error}");
    assert!(error.hint().unwrap().contains("--accept-licence bound"));
    assert!(case.fake.seen("hub").is_empty(), "nothing was asked for");
    let store = case.store();
    store.accept(&store.lock().unwrap(), &BOUND, "a test").unwrap();
    case.pull(&model).await.unwrap();
    assert_eq!(store.accepted(&BOUND).unwrap().unwrap().how, "a test");
}

#[tokio::test]
async fn two_pulls_at_once_do_not_happen() {
    let case = Case::new().await;
    let held = case.store().lock().unwrap();
    assert!(matches!(case.pull(&model(Some(BODY), &FREE)).await.unwrap_err(), ModelError::Busy { .. }));
    drop(held);
    case.pull(&model(Some(BODY), &FREE)).await.unwrap();
}

#[tokio::test]
async fn a_full_disk_is_told_before_anything_is_fetched() {
    let case = Case::new().await;
    let mut model = model(Some(BODY), &FREE);
    let file = ModelFile { size: None, sha256: None, ..model.files[0] };
    model.files = Box::leak(Box::new([file]));
    // The server announces more than any disk has.
    case.fake.storage([Storage::Announce(1 << 60)]);
    let error = case.pull(&model).await.unwrap_err();
    assert!(matches!(error, ModelError::NoSpace { .. }), "{error}");
}

#[tokio::test]
async fn only_this_machine_is_asked_when_nothing_may_leave_it() {
    let case = Case::new().await;
    let endpoints = Endpoints::new("https://hub.invalid", "https://hub.invalid", "https://hub.invalid").unwrap();
    let options = HubOptions { endpoints, token: None, only: Some(vec![]), limits: PullLimits::default() };
    let store = case.store();
    let lock = store.lock().unwrap();
    let outcome = Hub::new(options).unwrap().pull(&store, &lock, &model(Some(BODY), &FREE), &|_| {}).await;
    let error = outcome.unwrap_err().to_string();
    assert!(error.contains("local_only"), "{error}");
}

fn write(path: &Path, bytes: &[u8]) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn a_folder_copied_by_hand_is_checked_and_used() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::new(folder.path());
    let model = model(Some(BODY), &FREE);
    let file = &model.files[0];
    assert!(matches!(store.verify(&model, file, &|_| {}).unwrap_err(), ModelError::Missing { .. }));
    let path = store.path(&model, file);
    write(&path, &BODY[..20]);
    let error = store.verify(&model, file, &|_| {}).unwrap_err().to_string();
    assert!(error.contains("has 20 bytes, wanted 47 (cut off?)") && error.contains("model.safetensors"), "{error}");
    write(&path, &[b'x'; BODY.len()]);
    assert_eq!(store.state(&model, file).unwrap(), FileState::Unchecked);
    let error = store.verify(&model, file, &|_| {}).unwrap_err().to_string();
    assert!(error.contains(&sum(BODY)) && error.contains(&sum(&[b'x'; BODY.len()])), "{error}");
    write(&path, BODY);
    assert!(store.has(&model).unwrap());
    assert_eq!(store.verify(&model, file, &|_| {}).unwrap().known.sha256, sum(BODY));
    assert!(matches!(store.state(&model, file).unwrap(), FileState::Verified(_)));
    // Written to once more: it counts as checked no longer.
    std::fs::File::options().append(true).open(&path).unwrap().set_modified(std::time::SystemTime::UNIX_EPOCH).unwrap();
    assert_eq!(store.state(&model, file).unwrap(), FileState::Unchecked);
}

#[test]
fn files_are_taken_from_another_folder_and_checked_on_the_way() {
    let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let store = Store::new(to.path());
    let lock = store.lock().unwrap();
    let pinned = model(Some(BODY), &FREE);
    let take = |model: &Model| store.import(&lock, model, from.path(), &|_, _| {});
    let error = take(&pinned).unwrap_err();
    assert!(matches!(error, ModelError::Missing { .. }), "{error}");
    write(&from.path().join("model.safetensors"), BODY);
    take(&pinned).unwrap();
    assert_eq!(std::fs::read(store.path(&pinned, &pinned.files[0])).unwrap(), BODY);
    write(&from.path().join("net/model.safetensors"), &[b'x'; BODY.len()]);
    assert!(matches!(take(&pinned).unwrap_err(), ModelError::WrongChecksum { .. }));
    assert_eq!(std::fs::read(store.path(&pinned, &pinned.files[0])).unwrap(), BODY, "what was right stays");
    // Without a checksum in the table, the record of the other folder is believed, and what it says must hold.
    let other = tempfile::tempdir().unwrap();
    let store = Store::new(other.path());
    let lock = store.lock().unwrap();
    let open = model(None, &FREE);
    let record = |sha256: &str| {
        let text = format!(
            "{{\"files\":{{\"net/model.safetensors\":{{\"sha256\":\"{sha256}\",\"checksum\":\"hub\",\"size\":47,\
             \"modified\":0,\"checked\":0}}}}}}"
        );
        write(&from.path().join(LEDGER), text.as_bytes());
    };
    record(&sum(BODY));
    let take = || store.import(&lock, &open, from.path(), &|_, _| {});
    assert!(matches!(take().unwrap_err(), ModelError::WrongChecksum { .. }));
    write(&from.path().join("net/model.safetensors"), BODY);
    assert_eq!(take().unwrap()[0].known.checksum, Checksum::Hub);
}
