//! Tables, comparison and the result's file, from made-up scores of a small generated room.

use std::path::Path;

use harmony_bench::compare::{Verdict, compare, text};
use harmony_bench::generate::{GeneratorSettings, generate, write};
use harmony_bench::metrics::similarity::Looking;
use harmony_bench::report::{csv, page, write_tables};
use harmony_bench::run::{BenchResult, Judging, judge_finished, read_result};
use harmony_bench::score::{GeometryScore, ObjectScore, RoomScore, SurfaceScore, ThresholdFigures};
use harmony_bench::summary::{CHAMFER_OBJECTS, F_OBJECTS, POSITION, QUESTIONS, RECALL, find, summary};
use harmony_bench::truth::TruthRoom;
use harmony_scene::{ImageSize, Level};

fn room(folder: &Path) -> TruthRoom {
    let settings = GeneratorSettings {
        image: Some(ImageSize::new(160, 120)),
        points: 500,
        shell_points: 100,
        ..GeneratorSettings::default()
    };
    let room = generate(5, &settings);
    let folder = folder.join(&room.name);
    write(&room, &folder).unwrap();
    TruthRoom::load(&folder).unwrap()
}

fn object(truth: Option<&str>, position_m: f64) -> ObjectScore {
    ObjectScore {
        id: format!("{}, found", truth.unwrap_or("ghost")),
        truth: truth.map(str::to_owned),
        level: Level::Furniture,
        offset: truth.map_or([0.0; 3], |_| [position_m, 0.0, 0.0]),
        position_m,
        yaw_deg: position_m * 10.0,
        has_front: true,
        size: position_m / 2.0,
        size_bias: 0.0,
        iou: 0.9,
        support_right: true,
        on_host_m: None,
        confidence: 0.8,
        unseen: 0.1,
    }
}

fn scored(truth: &TruthRoom, seed: u64, far: &[f64], f: f64) -> RoomScore {
    let names = ["bed_01", "desk_01", "lamp_01"];
    let mut objects: Vec<ObjectScore> = names.iter().zip(far).map(|(n, p)| object(Some(n), *p)).collect();
    objects.push(object(None, f64::NAN));
    let at = ThresholdFigures { threshold_m: 0.1, precision: f, recall: f, f1: f, best_f1: 100.0 };
    let surface =
        SurfaceScore { chamfer_m: 0.04, best_chamfer_m: 0.004, at: vec![at], prediction_m2: 9.0, truth_m2: 9.5 };
    let geometry =
        GeometryScore { points: 1000, objects: Some(surface), with_background: None, whole: None, midi: None };
    RoomScore {
        seed: Some(seed),
        objects,
        missed: Vec::new(),
        geometry: Some(geometry),
        pixel_loss: Some(0.05),
        n_clip: Some(0.125),
        questions_per_object: Some(1.5 * seed as f64),
        failure: None,
        ..RoomScore::failed(truth, 3.0, String::new())
    }
}

fn result(raw: Vec<RoomScore>) -> BenchResult {
    BenchResult {
        title: "made up".to_owned(),
        level: None,
        meshes: None,
        exact_height: true,
        changes: vec!["review_rounds=0".to_owned()],
        absent: vec!["LPIPS is not measured: <no weights>".to_owned()],
        aligned: raw.clone(),
        raw,
    }
}

#[test]
fn a_result_survives_its_file_and_the_tables_hold_all_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let truth = room(folder.path());
    let rooms = vec![scored(&truth, 1, &[0.02, 0.04, 0.2], 98.0), scored(&truth, 2, &[0.03, 0.1], 90.0)];
    let figures = summary(&rooms);
    let f = find(&figures, F_OBJECTS).unwrap();
    assert_eq!((f.value, f.count, f.worst, f.p90, f.met()), (94.0, 2, Some(90.0), Some(90.0), Some(false)));
    assert_eq!(find(&figures, CHAMFER_OBJECTS).unwrap().met(), Some(false));
    let asked = find(&figures, QUESTIONS).unwrap();
    assert_eq!((asked.count, asked.mean, asked.worst), (2, Some(2.25), Some(3.0)));
    let position = find(&figures, POSITION).unwrap();
    assert_eq!((position.value, position.p25, position.worst), (0.04, Some(0.03), Some(0.2)));

    let before = result(rooms);
    let out = folder.path().join("out");
    write_tables(&out, &before).unwrap();
    let back = read_result(&out.join("scores.json")).unwrap();
    assert!(back.raw[0].objects[3].position_m.is_nan(), "not measured, null in JSON");
    let known = |r: &BenchResult| format!("{r:?}");
    assert_eq!(known(&back), known(&before));

    let table = csv::figures(&before);
    let line = |name: &str| table.lines().find(|l| l.contains(name)).map(str::to_owned).unwrap();
    assert!(line("N-CLIP (mean)").contains(",2,0.125,"), "{table}");
    assert!(line("\"LPIPS, AlexNet (mean)\"").contains(",0,,"), "{table}");
    assert!(table.lines().all(|l| l.replace('"', "").split(',').count() >= 14), "{table}");
    assert_eq!(table.lines().count(), 1 + 2 * figures.len());
    let objects = csv::objects(&before.raw);
    assert_eq!(objects.lines().count(), 1 + 4 + 3);
    assert!(objects.contains("\"bed_01, found\"") && !objects.contains("NaN"), "{objects}");
    let html = page(&before, &out);
    assert!(html.contains("review_rounds=0") && html.contains("not met") && html.contains("<svg"));
    assert!(html.contains("<td>0.125") && html.contains("LPIPS is not measured: &lt;no weights&gt;"));
    assert!(!html.contains("http:") && !html.contains("https:") && !html.contains("<script"));
}

#[test]
fn a_comparison_names_what_got_worse() {
    let folder = tempfile::tempdir().unwrap();
    let truth = room(folder.path());
    let before = result(vec![scored(&truth, 1, &[0.02, 0.04, 0.2], 90.0), scored(&truth, 2, &[0.02], 90.0)]);
    let mut after = result(vec![scored(&truth, 1, &[0.03, 0.3], 95.0), scored(&truth, 3, &[0.02], 95.0)]);
    let c = compare(&before, &after, false);
    let verdict = |name: &str| c.figures.iter().find(|f| f.name == name).unwrap().verdict;
    assert_eq!([verdict(F_OBJECTS), verdict(CHAMFER_OBJECTS)], [Verdict::Better, Verdict::Equal]);
    assert_eq!(verdict(RECALL), Verdict::Equal);
    let worse: Vec<&str> = c.worse.iter().map(|o| o.object.as_str()).collect();
    assert_eq!(worse, ["lamp_01", "desk_01"], "what is lost comes first; 1 cm is no change");
    assert_eq!((c.rooms.len(), c.unpaired.len(), c.better), (1, 2, 0));
    assert!(text(&c).contains("lost"));
    // Older files have no seeds: then rooms go together in their order.
    for r in &mut after.raw {
        r.seed = None;
    }
    let c = compare(&before, &after, false);
    assert_eq!((c.rooms.len(), c.unpaired.len()), (2, 0));
}

#[tokio::test]
async fn runs_that_go_with_no_room_are_refused_and_empty_ones_count_as_failed() {
    let folder = tempfile::tempdir().unwrap();
    let truth = room(folder.path());
    let runs = folder.path().join("runs");
    let rooms = [truth.folder.clone()];
    let run = runs.join("other_room_1");
    std::fs::create_dir_all(&run).unwrap();
    std::fs::write(run.join("run.json"), "{}").unwrap();
    let looking = Looking::default();
    let judging = Judging { points: 1000, out: None, looking: &looking, lit: None };
    let all = [runs.clone()];
    assert!(judge_finished(&all, &rooms, judging, &|_| {}).await.is_err(), "no run of this room");
    std::fs::rename(&run, runs.join(format!("{}_4", truth.name))).unwrap();
    let judged = judge_finished(&all, &rooms, judging, &|_| {}).await.unwrap();
    assert_eq!(judged.raw[0].seed, Some(4));
    assert!(judged.raw[0].failure.is_some() && judged.raw[0].geometry.is_none());
    assert_eq!(find(&summary(&judged.raw), F_OBJECTS).unwrap().count, 0, "skipped, as the protocol does");
}
