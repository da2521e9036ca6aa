//! The judge that looks, with judges whose taste is known.

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use async_trait::async_trait;
use harmony_calls::{BookOptions, CallBook, CallOptions, Calls};
use harmony_eval::judge::{Criterion, JudgeAnswer, JudgeOptions, Judgement, agreement, judge, page, pairs, text};
use harmony_eval::score::{Look, RunSet, SetOptions, find_set};
use harmony_players::{FilesOptions, FilesPlayer, flat_cast};
use harmony_roles::{PlayerCard, RoleError, Usage, VisionLanguage, VlmAnswer, VlmRequest};
use image::{Rgb, RgbImage};
use serde_json::json;

/// Looks at the pictures: nearer to the photo's grey is better, and what is not known is the first letter.
struct Eye {
    always_a: bool,
}

fn grey(image: &RgbImage) -> f64 {
    image.pixels().map(|p| f64::from(p[0])).sum::<f64>() / f64::from(image.width() * image.height())
}

fn answer(request: &VlmRequest, always_a: bool) -> serde_json::Value {
    let greys: Vec<f64> = request.pictures.iter().map(|p| grey(&p.image)).collect();
    let off = |i: usize| (greys[i] - greys[0]).abs();
    let better = if always_a || off(1) < off(2) { "a" } else { "b" };
    let mut value = json!({"observations": "greys"});
    for c in ["objects_present", "identity", "position", "orientation", "scale", "materials", "light", "overall"] {
        let better = if c == "light" { "same" } else { better };
        value[c] = json!({"better": better, "why": "its grey"});
    }
    value
}

#[async_trait]
impl VisionLanguage for Eye {
    fn card(&self) -> PlayerCard {
        PlayerCard { player: "eye".into(), model: "1".into(), offline: false, concurrency: 0 }
    }

    async fn ask(&self, request: &VlmRequest) -> Result<VlmAnswer, RoleError> {
        let all = format!("{} {}", request.prompt, request.name);
        let mut words = all.split(|c: char| !c.is_alphanumeric());
        assert!(!words.any(|w| w == "ours" || w == "theirs"), "nothing tells whose they are: {all}");
        assert!(request.pictures.iter().all(|p| !p.caption.contains("ours")));
        let value = answer(request, self.always_a);
        Ok(VlmAnswer { raw: value.to_string(), value, usage: Usage::default() })
    }
}

fn run(folder: &Path, grey: u8) {
    fs::create_dir_all(folder).unwrap();
    RgbImage::from_pixel(32, 24, Rgb([100; 3])).save(folder.join("input.png")).unwrap();
    RgbImage::from_pixel(32, 24, Rgb([grey; 3])).save(folder.join("render_flat.png")).unwrap();
    RgbImage::from_pixel(40, 30, Rgb([grey; 3])).save(folder.join("render_canonical.png")).unwrap();
}

/// Ours is nearer in all but the last of `count` scenes.
fn sets(folder: &Path, count: usize) -> Vec<RunSet> {
    for i in 0..count {
        let (near, far) = (105, 160);
        let (ours, theirs) = if i + 1 == count { (far, near) } else { (near, far) };
        run(&folder.join(format!("ours/Room {i}, blue")), ours);
        run(&folder.join(format!("theirs/Room {i}, blue")), theirs);
    }
    let set = |name: &str| {
        let source = folder.join(name).to_string_lossy().into_owned();
        find_set(name, &[source], &SetOptions::default()).unwrap()
    };
    vec![set("ours"), set("theirs")]
}

fn calls(folder: &Path, player: Arc<dyn VisionLanguage>) -> Calls {
    let mut cast = flat_cast();
    let offline = cast.clone();
    cast.vision_language = player;
    let book = CallBook::open(folder, BookOptions::default()).unwrap();
    Calls::new(Arc::new(book), cast, offline, CallOptions::default())
}

async fn judged(folder: &Path, sets: &[RunSet], calls: &Calls, rounds: usize) -> Judgement {
    let _ = folder;
    let scenes = pairs(sets, Look::Flat).unwrap();
    let names: Vec<String> = sets.iter().map(|s| s.name.clone()).collect();
    judge(&scenes, &names, JudgeOptions { look: Look::Flat, rounds, seed: 5 }, calls, &|_| {}).await
}

#[tokio::test]
async fn what_is_nearer_wins_in_both_orders_and_every_call_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let sets = sets(folder.path(), 6);
    let out = folder.path().join("out");
    let first = calls(&out, Arc::new(Eye { always_a: false }));
    let j = judged(folder.path(), &sets, &first, 2).await;
    assert_eq!((j.trials.len(), first.counts().asked), (24, 24), "two orders, two rounds");
    let score = |c: Criterion| j.scores.iter().find(|s| s.criterion == c).unwrap();
    let overall = score(Criterion::Overall);
    assert_eq!((overall.pairs[0].first, overall.pairs[0].second, overall.pairs[0].ties), (10, 2, 0));
    assert_eq!((overall.consistent, overall.missing), (Some(1.0), 0));
    assert!(overall.strengths[0].log > 0.5 && overall.strengths[0].interval.is_some());
    // Scenes vote, not rounds: 5 against 1.
    assert!((overall.pairs[0].p - 2.0 * 7.0 / 64.0).abs() < 1e-12, "{}", overall.pairs[0].p);
    assert_eq!(score(Criterion::Light).pairs[0].ties, 12);
    // Who is A is drawn, not fixed.
    let firsts: Vec<bool> = j.trials.iter().filter(|t| t.call.ends_with("first")).map(|t| t.swapped).collect();
    assert!(firsts.contains(&true) && firsts.contains(&false), "{firsts:?}");
    let again = calls(&out, Arc::new(Eye { always_a: false }));
    let same = judged(folder.path(), &sets, &again, 2).await;
    assert_eq!((again.counts().asked, again.counts().reused), (0, 24), "nothing is asked twice");
    assert_eq!(same, j);
    let html = page(&j, &pairs(&sets, Look::Flat).unwrap());
    assert_eq!(html.matches("<img ").count(), 6 * 5, "photo and two views of both");
    assert!(text(&j).contains("both orders agree in 100 %"), "{}", text(&j));
}

#[tokio::test]
async fn a_judge_with_a_habit_is_found_out_and_agrees_with_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let sets = sets(folder.path(), 4);
    let fair =
        judged(folder.path(), &sets, &calls(&folder.path().join("a"), Arc::new(Eye { always_a: false })), 1).await;
    let lazy =
        judged(folder.path(), &sets, &calls(&folder.path().join("b"), Arc::new(Eye { always_a: true })), 1).await;
    let overall = &lazy.scores[7];
    assert_eq!((overall.pairs[0].ties, overall.consistent), (4, Some(0.0)));
    let of =
        |all: Vec<harmony_eval::judge::Agreement>| all.into_iter().find(|a| a.criterion == Criterion::Overall).unwrap();
    assert_eq!(of(agreement(&fair, &fair)).kappa, Some(1.0));
    let other = of(agreement(&fair, &lazy));
    assert_eq!((other.n, other.same, other.kappa), (4, Some(0.0), Some(0.0)));
}

/// Whoever answers folders (a person, a chat window) judges as well.
#[tokio::test]
async fn questions_can_be_answered_as_files() {
    let folder = tempfile::tempdir().unwrap();
    let sets = sets(folder.path(), 1);
    let questions = folder.path().join("questions");
    let patience = Some(Duration::from_mins(5));
    let options = FilesOptions { poll: Duration::from_millis(10), patience, ..FilesOptions::new(&questions) };
    let calls = calls(&folder.path().join("out"), Arc::new(FilesPlayer::new(options)));
    let place = questions.clone();
    // Whoever answers stays until both are answered: a slow machine asks late.
    let until = Instant::now() + Duration::from_mins(5);
    let person = tokio::task::spawn_blocking(move || {
        let mut answered = std::collections::BTreeSet::new();
        while Instant::now() < until {
            for entry in fs::read_dir(&place).into_iter().flatten().flatten().map(|e| e.path()) {
                // A folder that is still being written has a hidden name.
                let hidden = entry.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
                if !hidden && entry.join("schema.json").is_file() && answered.insert(entry.clone()) {
                    let mut value = serde_json::to_value(JudgeAnswer::example()).unwrap();
                    value["observations"] = json!("I looked");
                    fs::write(entry.join("answer.json"), value.to_string()).unwrap();
                }
            }
            if answered.len() == 2 {
                return true;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        false
    });
    let j = judged(folder.path(), &sets, &calls, 1).await;
    assert!(person.await.unwrap());
    assert!(j.trials.iter().all(|t| t.observations == "I looked"), "{:?}", j.trials);
    assert_eq!(j.scores[7].pairs[0].ties, 1, "the same letter in both orders decides nothing");
}

#[tokio::test]
async fn nobody_who_looks_is_no_judgement() {
    let folder = tempfile::tempdir().unwrap();
    let sets = sets(folder.path(), 1);
    let cast = flat_cast();
    let j = judged(folder.path(), &sets, &calls(&folder.path().join("out"), cast.vision_language), 1).await;
    assert!(j.trials.iter().all(|t| t.verdicts.is_none() && t.error.is_some()), "{:?}", j.trials);
    assert!(j.scores.iter().all(|s| s.missing == 1 && s.consistent.is_none()));
    assert!(pairs(&sets[..1], Look::Flat).is_err() && pairs(&sets, Look::Lit).is_err());
}
