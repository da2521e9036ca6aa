//! Tables of sets whose figures are known.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use harmony_eval::score::{
    ColumnKey, Evaluation, Look, Looks, MetricError, MetricId, PictureMetric, SetOptions, csv, evaluate, find_set,
    table, write,
};
use image::{Rgb, RgbImage};

/// Mean red of the render: a network's place, with a figure that the test knows.
#[derive(Debug)]
struct Red;

impl PictureMetric for Red {
    fn id(&self) -> MetricId {
        MetricId::LpipsVgg
    }

    fn measure(&self, render: &RgbImage, photo: &RgbImage) -> Result<f64, MetricError> {
        assert_eq!(render.dimensions(), photo.dimensions());
        if render.width() < 8 {
            return Err(MetricError { metric: self.id(), reason: "too small".to_owned() });
        }
        Ok(f64::from(render.get_pixel(0, 0)[0]) / 255.0)
    }
}

/// A run whose photo is grey `photo` and whose flat render has the given size and grey.
fn run(folder: &Path, name: &str, photo: u8, size: (u32, u32), grey: Option<u8>) {
    let run = folder.join(name);
    fs::create_dir_all(&run).unwrap();
    RgbImage::from_pixel(32, 24, Rgb([photo; 3])).save(run.join("input.png")).unwrap();
    if let Some(grey) = grey {
        RgbImage::from_pixel(size.0, size.1, Rgb([grey; 3])).save(run.join("render_flat.png")).unwrap();
    }
}

fn set(name: &str, folder: &Path) -> harmony_eval::score::RunSet {
    find_set(name, &[folder.to_string_lossy().into_owned()], &SetOptions::default()).unwrap()
}

fn networks() -> Looks {
    Looks::new(vec![Arc::new(Red)], vec!["N-CLIP is not measured: no weights".to_owned()])
}

fn two_sets(folder: &Path) -> Evaluation {
    let (ours, theirs) = (folder.join("ours"), folder.join("theirs"));
    // PL of greys that differ by d of 255 is (d / 255)^2: 51 is 0.04, 102 is 0.16.
    run(&ours, "a", 100, (32, 24), Some(151));
    run(&ours, "b", 100, (32, 24), Some(202));
    run(&ours, "c", 100, (32, 24), None);
    run(&theirs, "a", 100, (24, 24), Some(202));
    run(&theirs, "b", 100, (32, 24), Some(202));
    run(&theirs, "c", 100, (32, 24), Some(100));
    // Another name for another photo: a scene of its own.
    run(&theirs, "d", 33, (32, 24), Some(33));
    evaluate(&[set("ours", &ours), set("theirs", &theirs)], &networks(), 7, &|_| {})
}

fn key(set: usize, metric: MetricId) -> ColumnKey {
    ColumnKey { set, look: Look::Flat, metric }
}

#[test]
fn three_means_tell_what_one_would_hide() {
    let folder = tempfile::tempdir().unwrap();
    let e = two_sets(folder.path());
    let column = |k: ColumnKey| e.columns.iter().find(|c| c.key == k).unwrap().clone();
    let (ours, theirs) = (column(key(0, MetricId::Pl)), column(key(1, MetricId::Pl)));
    let close = |m: Option<harmony_eval::statistics::Mean>, n: usize, mean: f64| {
        let m = m.unwrap();
        assert_eq!(m.n, n);
        assert!((m.mean - mean).abs() <= 1e-12, "{} is not {mean}", m.mean);
    };
    close(ours.own, 2, 0.1);
    close(theirs.own, 4, (0.16 + 0.16) / 4.0);
    close(ours.intersection, 2, 0.1);
    close(theirs.intersection, 2, 0.16);
    // c and d are missing from ours and count with 0.16, the worst of all.
    close(ours.failures_as_worst, 4, (0.04 + 0.16 + 0.16 + 0.16) / 4.0);
    close(theirs.failures_as_worst, 4, 0.08);
    assert_eq!((ours.missing, theirs.missing, ours.worst), (2, 0, Some(0.16)));
    assert!(e.columns.iter().all(|c| c.key.metric != MetricId::NClip), "nobody measured it");
    assert!(e.notes.iter().any(|n| n.contains("N-CLIP is not measured")));
    let squashed = e.notes.iter().find(|n| n.contains("squashed")).unwrap();
    assert!(squashed.contains("theirs: 1 renders") && squashed.ends_with(" a"), "{squashed}");
}

#[test]
fn pairs_are_compared_scene_by_scene() {
    let folder = tempfile::tempdir().unwrap();
    let e = two_sets(folder.path());
    let c = e.comparisons.iter().find(|c| c.metric == MetricId::Pl).unwrap();
    // a: 0.04 - 0.16, b: equal; c and d have no pair.
    assert_eq!((c.paired.difference.n, c.paired.lower, c.paired.higher, c.paired.equal), (2, 1, 0, 1));
    assert!((c.paired.difference.mean + 0.06).abs() <= 1e-12);
    assert_eq!(c.paired.p, 1.0, "one scene says nothing");
}

#[test]
fn scenes_of_other_names_meet_by_their_photo() {
    let folder = tempfile::tempdir().unwrap();
    let (ours, theirs) = (folder.path().join("ours"), folder.path().join("theirs"));
    run(&ours, "kitchen_01", 90, (32, 24), Some(90));
    run(&theirs, "rgb_0017", 90, (32, 24), Some(141));
    let e = evaluate(&[set("ours", &ours), set("theirs", &theirs)], &networks(), 7, &|_| {});
    assert_eq!(e.scenes.len(), 1);
    assert_eq!(e.comparisons.iter().find(|c| c.metric == MetricId::Pl).unwrap().paired.difference.n, 1);
}

#[test]
fn files_are_written_whole_and_hold_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let e = two_sets(folder.path());
    let out = folder.path().join("out");
    write(&out, &e).unwrap();
    let back: Evaluation = harmony_io::read_json(&out.join("eval.json")).unwrap();
    assert_eq!(back, e);
    let scenes = fs::read_to_string(out.join("scenes.csv")).unwrap();
    let widths: Vec<usize> = scenes.lines().filter(|l| !l.is_empty()).map(|l| l.split(',').count()).collect();
    assert!(widths.iter().all(|w| *w == widths[0]), "{scenes}");
    assert!(
        scenes.contains("scene,ours_flat_pl,ours_flat_lpips_vgg,theirs_flat_pl,theirs_flat_lpips_vgg,remarks"),
        "{scenes}"
    );
    assert!(scenes.lines().any(|l| l.starts_with("NUM_SCORED,2,2,4,4")), "{scenes}");
    assert!(scenes.lines().any(|l| l.starts_with("c,,,0,") && l.ends_with("ours: no render_flat.png")), "{scenes}");
    let page = fs::read_to_string(out.join("eval.html")).unwrap();
    assert!(!page.contains("http://") && !page.contains("https://") && !page.contains("<script"), "self-contained");
    // What is missing from the first set stands first, then the worst.
    let places = ["<h3>c</h3>", "<h3>d</h3>", "<h3>b</h3>", "<h3>a</h3>"].map(|t| page.find(t).unwrap());
    assert!(places.is_sorted(), "{places:?}");
    // a has a photo, ours and theirs; b too; c a photo and theirs; d likewise.
    assert_eq!(page.matches("<img ").count(), 10);
    let text = table(&e);
    assert!(text.contains("ours flat PL") && text.contains("0.1000"), "{text}");
    assert!(csv::table(&e).contains("ours,flat,pl,failures_as_worst,4,0.13"), "{}", csv::table(&e));
    // The same again, whatever the threads do.
    assert_eq!(two_sets(folder.path()), e);
}

#[test]
fn what_a_network_refuses_is_said_and_the_rest_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), "tiny", 90, (4, 3), Some(90));
    fs::write(folder.path().join("broken.txt"), "").unwrap();
    run(folder.path(), "torn", 90, (32, 24), None);
    fs::write(folder.path().join("torn/render_flat.png"), b"no picture").unwrap();
    let e = evaluate(&[set("x", folder.path())], &networks(), 7, &|_| {});
    let scene = |name: &str| e.scenes.iter().find(|s| s.scene == name).unwrap();
    let tiny = &scene("tiny").sets[0].shots[&Look::Flat];
    assert_eq!(tiny.values.keys().copied().collect::<Vec<_>>(), [MetricId::Pl]);
    assert_eq!(tiny.errors, ["LPIPS vgg: too small"]);
    let torn = &scene("torn").sets[0];
    assert!(torn.shots.is_empty() && torn.failure.as_ref().unwrap().contains("not a readable image"), "{torn:?}");
}

#[test]
fn a_photo_painted_on_bare_walls_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (ours, theirs) = (folder.path().join("ours"), folder.path().join("theirs"));
    run(&ours, "a", 100, (32, 24), Some(151));
    run(&theirs, "a", 100, (32, 24), Some(100));
    let scene = |objects: &str| format!("{{\"version\": {}, \"objects\": {objects}}}", harmony_scene::SCENE_VERSION);
    fs::write(ours.join("a/scene.json"), scene("[{}, {}]")).unwrap();
    fs::write(theirs.join("a/scene.json"), scene("[]")).unwrap();
    let e = evaluate(&[set("ours", &ours), set("theirs", &theirs)], &networks(), 7, &|_| {});
    assert_eq!((e.scenes[0].sets[0].objects, e.scenes[0].sets[1].objects), (Some(2), Some(0)));
    let bare: Vec<&String> = e.notes.iter().filter(|n| n.contains("no objects")).collect();
    assert!(bare.len() == 1 && bare[0].starts_with("theirs: 1 scenes"), "{bare:?}");
}
