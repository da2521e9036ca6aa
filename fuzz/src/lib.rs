//! What the targets share: files in memory, questions, a cast of nobody.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use harmony_prompts::{
    CompletedVars, FrontsVars, InspectVars, LayoutVars, LightingReviewVars, LightsVars, ListVars, Question, ReviewVars,
};
use harmony_scene::Level;

pub mod nobody;

/// A folder of this process, in memory where there is such a place; made once, its files are overwritten.
pub fn scratch() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let base = Path::new("/dev/shm");
        let base = if base.is_dir() { base.to_owned() } else { std::env::temp_dir() };
        let folder = base.join(format!("harmony-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a scratch folder");
        folder
    })
}

/// Writes a file of the scratch folder.
pub fn put(name: &str, bytes: &[u8]) -> PathBuf {
    let path = scratch().join(name);
    std::fs::write(&path, bytes).expect("a scratch file");
    path
}

/// Ids that the questions ask about.
pub fn ids() -> Vec<String> {
    ["chair_01", "table_01", "floor_lamp_01", "window_01"].map(str::to_owned).to_vec()
}

/// Every question there is, in a fixed order.
pub fn questions() -> &'static [Question] {
    static ALL: OnceLock<Vec<Question>> = OnceLock::new();
    ALL.get_or_init(|| {
        let list = |with_boxes| ListVars {
            level: Level::Furniture,
            room_type: "bedroom".into(),
            with_boxes,
            placed: Vec::new(),
        };
        vec![
            harmony_prompts::layout(&LayoutVars { width: 640, height: 480, measured: String::new() }),
            harmony_prompts::list(&list(true)),
            harmony_prompts::list(&list(false)),
            harmony_prompts::inspect(&inspect_vars()),
            harmony_prompts::completed(&CompletedVars { objects: ids() }),
            harmony_prompts::fronts(&FrontsVars { objects: ids() }),
            harmony_prompts::orient(&FrontsVars { objects: ids() }),
            harmony_prompts::review(&review_vars()),
            harmony_prompts::lights(&LightsVars { sources: ids() }),
            harmony_prompts::lighting_review(&LightingReviewVars { setup: "{}".into(), measured: String::new() }),
        ]
    })
}

fn inspect_vars() -> InspectVars {
    InspectVars {
        level: Level::Furniture,
        room_type: "bedroom".into(),
        room: "3 x 4 x 2.5 m".into(),
        candidates: ids(),
        placed: Vec::new(),
        templates: vec!["chair".into(), "table".into()],
        with_models: true,
    }
}

fn review_vars() -> ReviewVars {
    ReviewVars {
        level: Level::Furniture,
        room: "3 x 4 x 2.5 m".into(),
        objects: ids(),
        unplaced: Vec::new(),
        findings: Vec::new(),
    }
}
