//! Who can play here: what `harmony doctor` shows.

use harmony_calls::Cast;
use harmony_roles::{PlayerCard, Role};
use serde::Serialize;

/// One role and who plays it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RoleStatus {
    /// Role.
    pub role: Role,
    /// Player and model that are cast.
    pub player: PlayerCard,
    /// Whether they can do what the role asks for here and now.
    pub available: bool,
    /// What to expect of them, in a sentence.
    pub detail: String,
    /// What would make it better, if something would.
    pub hint: Option<String>,
}

/// What can be expected of a cast, role by role, in the order of [`Role::ALL`]. Nobody is asked anything.
pub fn casting_report(cast: &Cast) -> Vec<RoleStatus> {
    cast.cards()
        .into_iter()
        .map(|(role, player)| {
            let (available, detail, hint) = expectation(role, &player);
            RoleStatus { role, player, available, detail: detail.to_owned(), hint }
        })
        .collect()
}

fn expectation(role: Role, player: &PlayerCard) -> (bool, &'static str, Option<String>) {
    let hint = |text: &str| Some(text.to_owned());
    match (player.player.as_str(), role) {
        ("offline", Role::VisionLanguage) => (
            true,
            "rules over geometry and pixels: nobody looks at the photo, so objects have no names but where they are",
            hint("use the files player to have a person, a chat window or an agent answer, or replay a recording"),
        ),
        ("offline", Role::ImageEditor) => {
            (true, "exemplar fill: closes holes and mirrors what is hidden, invents nothing", None)
        }
        ("offline", Role::MeshGenerator) => (
            true,
            "part models: clean simple meshes with the photo's colours, not the object's own details",
            hint("give a folder of GLB files for objects whose meshes you have"),
        ),
        ("offline", Role::GeometryEstimator) => (
            true,
            "no depth: the room box comes from vanishing points and the layout answer",
            hint("give a point map or a depth image with the photo"),
        ),
        ("offline", Role::Detector) => (
            true,
            "regions matched by place and shape: finds little",
            hint("let the language model give boxes with its lists, or give labelled mask files"),
        ),
        ("offline", Role::Segmenter) => (
            true,
            "graph cut: good on clear edges, rough where colours run together",
            hint("give mask files for exact masks"),
        ),
        ("offline", Role::LitRenderer) => (
            false,
            "no path tracer was found: the flat render stands in and the lighting is not fitted",
            harmony_lighting::LitError::NotFound.hint(),
        ),
        ("cycles", _) => (true, "Blender Cycles, in a process of its own", None),
        ("files", _) => (true, "waits for answers in a folder", None),
        ("mask files" | "point-map file" | "mesh folder", _) => (true, "taken from files", None),
        _ => (true, "as cast", None),
    }
}
