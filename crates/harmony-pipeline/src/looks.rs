//! What the looks at a placed scene came to: for each, how often it was asked and what of the scene is another since.
//!
//! A look is a question whose answer may change what stands already (paper App. C; [`crate::LookSettings`]). The scene
//! before it and after it are compared, so that a change counts only where it came about, whoever made it. What a look
//! proposed in vain is told by its warnings ([`harmony_scene::WarningKind::ActionRefused`]). Poses are of the room frame, in
//! metres and radians, in the room as it was at that look: later levels move camera and room once more.

use std::collections::BTreeSet;
use std::sync::Arc;

use harmony_placement::energy_change;
use harmony_scene::{ObjectId, Pose, Size};
use harmony_viewer::Fact;
use serde::{Deserialize, Serialize};

use crate::ctx::PhaseCtx;
use crate::state::SceneState;

/// Which look.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LookKind {
    /// What is missing on a piece of furniture.
    Missing,
    /// Another order of placing, where things stay in one another.
    Reorder,
    /// Which host carries a decoration.
    Hosts,
    /// Quarter turns of decorations.
    Quarters,
    /// Fine turns.
    Turns,
    /// Members of matched sets in their order.
    Groups,
    /// The reflective review.
    Review,
    /// Programs seen beside the photo.
    SecondLook,
    /// Kinds counted.
    Counts,
    /// The whole scene in its light.
    LastLook,
}

impl LookKind {
    /// All, in the order in which they are asked.
    pub const ALL: [Self; 10] = [
        Self::Missing,
        Self::Reorder,
        Self::Hosts,
        Self::Quarters,
        Self::Turns,
        Self::Groups,
        Self::Review,
        Self::SecondLook,
        Self::Counts,
        Self::LastLook,
    ];

    /// How the names of its questions begin, after the phase.
    fn asked_as(self) -> &'static str {
        match self {
            Self::Missing => "missing/",
            Self::Reorder => "reorder",
            Self::Hosts => "hosts",
            Self::Quarters => "orient",
            Self::Turns => "turn_",
            Self::Groups => "groups",
            Self::Review => "review_",
            Self::SecondLook => "second_look",
            Self::Counts => "counts",
            Self::LastLook => "last_look",
        }
    }

    /// In words.
    pub fn about(self) -> &'static str {
        match self {
            Self::Missing => "missing decorations",
            Self::Reorder => "another order",
            Self::Hosts => "right hosts",
            Self::Quarters => "quarter turns",
            Self::Turns => "fine turns",
            Self::Groups => "matched sets",
            Self::Review => "review",
            Self::SecondLook => "second look",
            Self::Counts => "counting",
            Self::LastLook => "last look",
        }
    }
}

/// An object whose place, turn or size is another one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Moved {
    /// The object.
    pub id: ObjectId,
    /// Where it was.
    pub before: Pose,
    /// Where it is.
    pub after: Pose,
    /// Its size before and after, metres.
    pub size: [Size; 2],
}

/// What came of one look at one phase.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Came {
    /// Phase.
    pub phase: String,
    /// Which look.
    pub look: LookKind,
    /// Questions asked.
    #[serde(default)]
    pub questions: usize,
    /// Objects that moved, turned, grew or shrank, by its will or making room.
    pub moved: Vec<Moved>,
    /// Objects of another shape.
    pub reshaped: Vec<ObjectId>,
    /// Objects that came.
    pub added: Vec<ObjectId>,
    /// Objects that went.
    pub removed: Vec<ObjectId>,
    /// Objects, faces of the room and lights of another colour or brightness; the last look alone.
    pub repainted: Vec<String>,
    /// Energy of the scene after it, less than before, nats; `None` where nothing moved or objects came or went.
    pub energy_change: Option<f64>,
}

impl Came {
    fn nothing(ctx: &PhaseCtx<'_>, look: LookKind) -> Self {
        Self {
            phase: ctx.phase.to_string(),
            look,
            questions: 0,
            moved: Vec::new(),
            reshaped: Vec::new(),
            added: Vec::new(),
            removed: Vec::new(),
            repainted: Vec::new(),
            energy_change: None,
        }
    }

    /// Things that it changed.
    pub fn changes(&self) -> usize {
        let objects =
            self.moved.len() + self.reshaped.iter().filter(|id| self.moved.iter().all(|m| m.id != **id)).count();
        objects + self.added.len() + self.removed.len() + self.repainted.len()
    }

    /// For the report.
    pub(crate) fn fact(&self) -> Fact {
        let count = |n: usize, what: &str| (n > 0).then(|| format!("{n} {what}"));
        let changed = [
            count(self.moved.len(), "moved, turned or resized"),
            count(self.reshaped.len(), "of another shape"),
            count(self.added.len(), "added"),
            count(self.removed.len(), "taken out"),
            count(self.repainted.len(), "repainted"),
            self.energy_change.map(|nats| format!("{nats:+.1} nats")),
        ];
        let changed: Vec<String> = changed.into_iter().flatten().collect();
        let changed = if changed.is_empty() { "nothing changed".to_owned() } else { changed.join(", ") };
        let asked = if self.questions == 1 { "1 question".to_owned() } else { format!("{} questions", self.questions) };
        Fact::new(format!("{}, {}", self.phase, self.look.about()), format!("{asked}: {changed}"))
    }
}

/// A move, a turn and a change of size below which nothing has changed: metres, radians, share.
const SAME: (f64, f64, f64) = (0.002, 0.005, 0.002);

/// The scene before a look.
pub struct SceneBefore(Box<SceneState>);

impl SceneBefore {
    /// Remembers the scene.
    pub fn of(state: &SceneState) -> Self {
        Self(Box::new(state.clone()))
    }

    /// Keeps what a look has changed since; the scene after it, for the next one.
    pub fn came(self, ctx: &PhaseCtx<'_>, look: LookKind, state: &mut SceneState) -> Self {
        let came = changes(&self.0, state, look, ctx);
        state.looks.push(came);
        Self::of(state)
    }
}

/// What came of asking each piece of furniture what is missing on it: those who came with their level.
pub fn missing_came(ctx: &PhaseCtx<'_>, state: &mut SceneState) {
    let found = |id: &&ObjectId| state.objects.get(id).is_some_and(|o| o.found_by == Some(LookKind::Missing));
    let of_level = state.partial.placed.iter().map(|p| &p.item.id).filter(found);
    let added = of_level.cloned().collect();
    state.looks.push(Came { added, ..Came::nothing(ctx, LookKind::Missing) });
}

fn changes(before: &SceneState, after: &SceneState, look: LookKind, ctx: &PhaseCtx<'_>) -> Came {
    let mut came = Came::nothing(ctx, look);
    for now in &after.partial.placed {
        let id = &now.item.id;
        let Some(was) = before.partial.find(id) else {
            came.added.push(id.clone());
            continue;
        };
        let turn = (now.pose.yaw - was.pose.yaw + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
            - std::f64::consts::PI;
        let sizes = [was.size(), now.size()];
        let grown = (sizes[1].as_vec() / sizes[0].as_vec() - 1.0).abs().max_element();
        let far = now.pose.position.distance(was.pose.position);
        if far > SAME.0 || turn.abs() > SAME.1 || grown > SAME.2 {
            came.moved.push(Moved { id: id.clone(), before: was.pose, after: now.pose, size: sizes });
        }
        if !Arc::ptr_eq(&now.item.shape, &was.item.shape) {
            came.reshaped.push(id.clone());
        }
    }
    let gone = before.partial.placed.iter().filter(|p| after.partial.find(&p.item.id).is_none());
    came.removed = gone.map(|p| p.item.id.clone()).collect();
    if look == LookKind::LastLook {
        came.repainted = repainted(before, after, &came);
    }
    let same_objects = came.added.is_empty() && came.removed.is_empty();
    if same_objects && !(came.moved.is_empty() && came.reshaped.is_empty()) {
        came.energy_change = Some(energy_change(&before.partial, &after.partial, &ctx.settings.placement));
    }
    came
}

/// What has other colours or shines otherwise, beside what moved or has another shape. The photo's light on what was modelled is
/// laid on anew after every change, and is none.
fn repainted(before: &SceneState, after: &SceneState, came: &Came) -> Vec<String> {
    let touched = |id: &ObjectId| came.moved.iter().any(|m| m.id == *id) || came.reshaped.contains(id);
    let other = |id: &&ObjectId| match (before.unlit(id), after.unlit(id)) {
        (Some(was), Some(now)) => !touched(id) && !Arc::ptr_eq(was, now),
        _ => false,
    };
    let mut out: Vec<String> = after.objects.keys().filter(other).map(ToString::to_string).collect();
    let faces =
        after.surfaces.iter().filter(|(face, now)| before.surfaces.get(face).is_some_and(|was| !Arc::ptr_eq(was, now)));
    out.extend(faces.map(|(face, _)| face.name().to_owned()));
    if let (Some(was), Some(now)) = (&before.lighting, &after.lighting) {
        let lights = now.lights.iter().filter(|light| was.lights.iter().any(|l| l.id == light.id && l != *light));
        out.extend(lights.map(|light| light.id.clone()));
        if was.exposure != now.exposure || was.ambient_intensity != now.ambient_intensity {
            out.push("exposure or ambient light".to_owned());
        }
    }
    out
}

/// Counts the questions of each look by the names of the calls that asked somebody, and leaves out looks that were not asked
/// and changed nothing. Where a phase has a look more than once, the first has the questions.
pub fn counted(mut all: Vec<Came>, names: &[&str]) -> Vec<Came> {
    let mut known = BTreeSet::new();
    for came in &mut all {
        if !known.insert((came.phase.clone(), came.look)) {
            continue;
        }
        let begins = format!("{}/{}", came.phase, came.look.asked_as());
        came.questions = names.iter().filter(|name| name.starts_with(&begins)).count();
    }
    all.retain(|came| came.questions > 0 || came.changes() > 0);
    all
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use harmony_scene::{Level, Support};

    use super::*;
    use crate::Phase;
    use crate::testing::{Desk, add, empty_room};

    #[test]
    fn what_moved_came_and_went_is_told_and_what_stayed_is_not() {
        let desk = Desk::new();
        let ctx = desk.ctx(Phase::Objects(Level::Furniture));
        let mut state = empty_room();
        let size = DVec3::new(0.5, 0.5, 0.5);
        let put = |state: &mut SceneState, name: &str, x: f64| {
            add(state, name, Level::Furniture, size, DVec3::new(x, 0.0, 1.5), Support::Floor)
        };
        let [chair, table, _still] =
            [("chair_01", 1.0), ("table_01", 2.0), ("stool_01", 3.0)].map(|(n, x)| put(&mut state, n, x));
        let before = SceneBefore::of(&state);
        let before = before.came(&ctx, LookKind::Turns, &mut state);
        assert_eq!(state.looks[0].changes(), 0);
        let i = state.partial.position(&chair).unwrap();
        state.partial.placed[i].pose.position.x += 0.2;
        let before = before.came(&ctx, LookKind::Review, &mut state);
        let came = &state.looks[1];
        assert_eq!((came.moved.len(), came.changes()), (1, 1));
        assert!((came.moved[0].after.position.x - came.moved[0].before.position.x - 0.2).abs() < 1e-9);
        assert!(came.energy_change.is_some_and(|nats| nats > 0.0), "it left its mask: {came:?}");
        let gone = state.partial.position(&table).unwrap();
        state.partial.placed.remove(gone);
        let vase = put(&mut state, "vase_01", 2.5);
        before.came(&ctx, LookKind::Counts, &mut state);
        let came = &state.looks[2];
        assert_eq!((&came.added[..], &came.removed[..], came.moved.len()), (&[vase][..], &[table][..], 0));
        assert_eq!(came.energy_change, None);
        let names = ["review_1", "turn_1", "turn_1_part_2", "groups"].map(|name| format!("3_furniture/{name}"));
        let names: Vec<&str> = names.iter().map(String::as_str).chain(["4_ceiling/turn_1"]).collect();
        state.looks.push(Came::nothing(&ctx, LookKind::Hosts));
        let counted = counted(state.looks, &names);
        let questions: Vec<(LookKind, usize)> = counted.iter().map(|c| (c.look, c.questions)).collect();
        assert_eq!(questions, [(LookKind::Turns, 2), (LookKind::Review, 1), (LookKind::Counts, 0)]);
        assert_eq!(counted[1].fact().value.split(',').next(), Some("1 question: 1 moved"));
    }
}
