//! Small studies on disk.

use std::path::{Path, PathBuf};

use harmony_study::build::{BuildOptions, Built, build};
use harmony_study::private::PrivateStudy;
use harmony_study::record::{Answer, LayoutShown};
use harmony_study::shuffle::panel_order;
use image::{Rgb, RgbImage};
use tempfile::TempDir;

/// Names that occur in no text of the page.
pub const METHODS: [&str; 6] = ["Zorblax", "Quuxine", "Vermilio", "Tandrath", "Obskuron", "Wylfgang"];

pub struct Study {
    pub folder: TempDir,
    pub built: Built,
}

impl Study {
    pub fn site(&self) -> PathBuf {
        self.folder.path().join("site")
    }

    pub fn private(&self) -> PathBuf {
        self.folder.path().join("private")
    }

    pub fn log(&self) -> PathBuf {
        self.folder.path().join("log.jsonl")
    }

    pub fn secret(&self) -> &PrivateStudy {
        &self.built.study
    }
}

/// A picture that says which scene and method it is by its colours.
pub fn picture(path: &Path, scene: usize, method: usize, size: (u32, u32)) {
    let color = [((40 + 30 * scene) % 250) as u8, 20 + 35 * method as u8, 90];
    let mut image = RgbImage::from_pixel(size.0, size.1, Rgb(color));
    for x in 0..size.0 / 2 {
        image.put_pixel(x, size.1 / 2, Rgb([255, 255, 255]));
    }
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    image.save(path).unwrap();
}

/// Sets of `methods` methods with `scenes` scenes, and their photos.
pub fn sets(folder: &Path, methods: usize, scenes: usize) -> Vec<(String, PathBuf)> {
    for s in 0..scenes {
        picture(&folder.join(format!("photos/room_{s:02}.png")), s, 6, (48, 36));
        for (m, method) in METHODS[..methods].iter().enumerate() {
            picture(&folder.join(format!("{method}/room_{s:02}.png")), s, m, (64, 48));
        }
    }
    METHODS[..methods].iter().map(|m| ((*m).to_owned(), folder.join(m))).collect()
}

pub fn options(folder: &Path, methods: usize, scenes: usize) -> BuildOptions {
    BuildOptions {
        photos: Some(folder.join("photos")),
        seed: Some(7),
        ..BuildOptions::new("test-study", sets(folder, methods, scenes))
    }
}

pub fn study(methods: usize, scenes: usize, change: impl FnOnce(&mut BuildOptions)) -> Study {
    let folder = tempfile::tempdir().unwrap();
    let mut options = options(folder.path(), methods, scenes);
    change(&mut options);
    let built = build(&options, &folder.path().join("site"), &folder.path().join("private")).unwrap();
    Study { folder, built }
}

/// An answer with these ranks by letter.
pub fn answer(study: &PrivateStudy, participant: &str, trial: usize, ranks: Vec<u8>) -> Answer {
    let trial = &study.trials[trial];
    let order = panel_order(&study.study, participant, &trial.id, trial.panels.len());
    Answer {
        study: study.study.clone(),
        version: study.version.clone(),
        participant: participant.to_owned(),
        trial: trial.id.clone(),
        revision: 1,
        order: order.iter().map(|i| trial.panels[*i].id.clone()).collect(),
        ranks,
        active_ms: 20_000,
        total_ms: 21_000,
        changes: 6,
        zooms: 1,
        views: 0,
        layout: LayoutShown::Grid,
    }
}
