//! Canonical views of runs.

use harmony_dataset::DatasetError;
use harmony_dataset::gallery::{GalleryOptions, find_runs, make};
use harmony_io::picture;

use crate::fixture::set;

#[test]
fn every_room_is_framed_by_the_same_rule_and_shown_without_ceiling() {
    let set = set();
    let options = GalleryOptions { width: 320, frames: 4, turntable_width: 96, cell: 160, ..GalleryOptions::default() };
    // Runs and a data set's scenes alike.
    let runs = find_runs(&[set.run(0), set.root().join("medium")]).unwrap();
    assert_eq!(runs.len(), 4);
    let out = set.folder.path().join("gallery");
    let shown = make(&runs, &out, &options).unwrap();
    let names: Vec<&str> = shown.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["run_0", "bedroom_01", "bedroom_02", "home_office_01"]);
    assert!(shown[0].lit && shown.iter().all(|s| s.failed.is_empty() && s.objects == 2));
    let image = picture::read(&out.join("run_0/canonical_flat.png")).unwrap().to_rgb8();
    assert_eq!(image.dimensions(), (320, 240));
    // Floor, back wall, table and lamp are seen; the ceiling's colour (0.9 of linear white) is not.
    let near = |c: [u8; 3]| image.pixels().filter(|p| p.0.iter().zip(c).all(|(a, b)| a.abs_diff(b) <= 3)).count();
    let srgb = |v: f64| ((1.055 * v.powf(1.0 / 2.4) - 0.055) * 255.0).round() as u8;
    let of = |c: [f64; 3]| near(c.map(srgb));
    let (floor, back) = (of([0.5, 0.4, 0.3]), of([0.8, 0.8, 0.7]));
    assert!(floor > 5000 && back > 3000, "{floor} {back}");
    assert!(of([0.7, 0.2, 0.1]) > 500 && of([0.1, 0.3, 0.8]) > 50);
    assert_eq!(of([0.9, 0.9, 0.9]), 0);
    for file in ["sheet_flat.png", "sheet_lit.png", "index.html", "gallery.json", "bedroom_02/turntable.webp"] {
        assert!(out.join(file).is_file(), "{file}");
    }
    // The same runs, the same bytes; nothing is overwritten.
    let again = set.folder.path().join("again");
    make(&runs, &again, &options).unwrap();
    for file in harmony_dataset::release::files(&out) {
        assert!(std::fs::read(out.join(&file)).unwrap() == std::fs::read(again.join(&file)).unwrap(), "{file}");
    }
    assert!(matches!(make(&runs, &out, &options).unwrap_err(), DatasetError::Exists(_)));
}

#[test]
fn a_broken_run_is_named_and_the_others_are_shown() {
    let set = set();
    let options = GalleryOptions { width: 64, frames: 0, cell: 64, ..GalleryOptions::default() };
    std::fs::write(set.run(1).join("scene_full.glb"), b"nothing").unwrap();
    let runs = [set.run(0), set.run(1)];
    let out = set.folder.path().join("gallery");
    let shown = make(&find_runs(&runs).unwrap(), &out, &options).unwrap();
    assert!(shown[0].failed.is_empty() && shown[1].failed.contains("not a GLB"));
    assert!(std::fs::read_to_string(out.join("index.html")).unwrap().contains("Not shown"));
    let none = set.folder.path().join("none");
    assert!(make(&runs[1..], &none, &options).is_err() && !none.exists());
    assert!(find_runs(&[set.folder.path().join("nowhere")]).is_err());
    std::fs::create_dir(&none).unwrap();
    assert!(matches!(find_runs(&[none]).unwrap_err(), DatasetError::NoRuns(_)));
}
