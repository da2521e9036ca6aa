//! `<level>/inspect`: verify, describe, relate, order, material, model, up to eight candidates of a level at once.
//!
//! Joins the paper's verification, description, "Depth and Relational Analysis", decoration placement and material
//! prompts: one numbered contact sheet instead of one call an object and purpose.

use std::collections::BTreeSet;
use std::fmt::{Display, Formatter};

use harmony_mesh::{PART_MODEL_GUIDE, PartModel, TemplateParams};
use harmony_scene::{
    DepthPosition, ImageSize, Level, MaterialCategory, ObjectId, PixelBox, PlacementType, Size, SurfacePosition, Wall,
    WallAffinity,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Ask, fill, in_range, lines};
use crate::subjects::{KnownObject, RoomSummary, thousandths};

/// Asks about candidates of a level.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InspectQuestion {
    /// Level asked for.
    pub level: Level,
    /// Room type as it was answered.
    #[serde(skip)]
    pub room_type: String,
    /// Room and camera.
    pub room: RoomSummary,
    /// Candidates.
    pub candidates: Vec<InspectCandidate>,
    /// The level's other candidates, which another question asks about: relations and sets may name them.
    #[serde(skip)]
    pub others: Vec<InspectCandidate>,
    /// Objects of earlier levels.
    pub placed: Vec<KnownObject>,
    /// Template names that can be used.
    #[serde(skip)]
    pub templates: Vec<String>,
    /// Whether meshes come from part models, so that `template` / `part_model` are wanted.
    #[serde(skip)]
    pub with_models: bool,
}

/// What was detected and is to be looked at.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InspectCandidate {
    /// Id as printed on the sheet.
    pub id: ObjectId,
    /// Category it was detected as.
    pub label: String,
    /// Phrase it was detected by.
    #[serde(skip)]
    pub phrase: String,
    /// Its box, pixels.
    #[serde(rename = "box")]
    pub bounds: PixelBox,
    /// Size of the photo, pixels.
    pub image: ImageSize,
    /// Width and height as they appear at the depth where its foot meets the room, metres.
    pub estimated_size_m: Option<Size>,
    /// Furniture that it was listed on.
    pub host: Option<ObjectId>,
    /// Whether a program is asked for next, if it is kept: then no part model is wanted.
    #[serde(skip)]
    pub program_follows: bool,
}

impl Display for InspectCandidate {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let bounds = thousandths(&self.bounds, self.image);
        write!(f, "- {}: {} (\"{}\"), box {bounds}", self.id, self.label, self.phrase)?;
        if self.program_follows {
            write!(f, ", a program follows")?;
        }
        self.host.as_ref().map_or(Ok(()), |host| write!(f, ", listed on {host}"))
    }
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InspectAnswer {
    /// One entry a candidate.
    pub objects: Vec<InspectedObject>,
    /// Ids in placement order, all kept ones.
    #[serde(default)]
    pub placement_order: Vec<String>,
    /// One or two sentences about how these objects are arranged.
    #[serde(default)]
    pub scene_summary: String,
}

/// How much of an object is hidden by others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum Occlusion {
    #[default]
    None,
    Partly,
    Heavily,
}

/// Real-world size, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InspectedSize {
    /// Side to side, seen from its front.
    pub width: f64,
    /// Bottom to top.
    pub height: f64,
    /// Front to back.
    pub depth: f64,
}

/// Dominant material (paper App. C, "Material estimation"); what is left out comes from per-category defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the paper's fields")]
pub struct InspectedMaterial {
    pub material_category: MaterialCategory,
    #[serde(default)]
    pub roughness: Option<f64>,
    #[serde(default)]
    pub metallic: Option<f64>,
    #[serde(default)]
    pub ior: Option<f64>,
    #[serde(default)]
    pub transmission: Option<f64>,
    #[serde(default)]
    pub weight_kg: Option<f64>,
    #[serde(default)]
    pub thickness_m: Option<f64>,
    #[serde(default)]
    pub elasticity: Option<f64>,
}

/// To where a thing on a wall goes on, seen or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum WallReach {
    Floor,
    Ceiling,
}

/// What is said about one candidate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InspectedObject {
    /// The candidate's id as printed on the sheet.
    pub id: String,
    /// False for fragments, reflections, things of another level, duplicates.
    pub keep: bool,
    /// Why not, when not kept.
    #[serde(default)]
    pub reason: String,
    /// Corrected category.
    #[serde(rename = "type")]
    pub kind: String,
    /// One sentence: shape, parts, colours, materials; enough to draw it completely.
    #[serde(default)]
    pub description: String,
    /// How much of it other objects hide.
    #[serde(default)]
    pub occlusion: Occlusion,
    /// Real-world size.
    pub size_m: InspectedSize,
    /// Wall its back touches.
    #[serde(default)]
    pub wall_affinity: WallAffinity,
    /// Wall level only: the wall it is fixed to.
    #[serde(default)]
    pub wall: Option<Wall>,
    /// Wall level only: it goes on to the floor, to the ceiling, seen or not (beyond the paper).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reaches: Vec<WallReach>,
    /// Id of what it rests on, when not the floor.
    #[serde(default)]
    pub on_top_of: Option<String>,
    /// Id.
    #[serde(default)]
    pub in_front_of: Option<String>,
    /// Id.
    #[serde(default)]
    pub behind: Option<String>,
    /// Id of what its front is turned to.
    #[serde(default)]
    pub facing_toward: Option<String>,
    /// Direction of its front in the room in degrees: 0 towards the viewer (+z), 90 to the right (+x), 180 to the
    /// back wall, -90 to the left; null when it has no front or you can't tell.
    #[serde(default)]
    pub front_deg: Option<f64>,
    /// Functional group, such as `dining`.
    #[serde(default)]
    pub group: Option<String>,
    /// Name of the set of identical instances it belongs to.
    #[serde(default)]
    pub matched_set: Option<String>,
    /// Number of identical instances in that set.
    #[serde(default)]
    pub count: Option<u32>,
    /// Name of the row of things it is built together with side by side at a wall, such as `kitchen_units`.
    #[serde(default)]
    pub joined_row: Option<String>,
    /// Decorations: how it rests.
    #[serde(default)]
    pub placement_type: PlacementType,
    /// Decorations: across the surface as the camera sees it.
    #[serde(default)]
    pub surface_position: SurfacePosition,
    /// Decorations: along the surface as the camera sees it.
    #[serde(default)]
    pub depth_position: DepthPosition,
    /// Whether it has a front that must face the room (a screen, a picture frame).
    #[serde(default)]
    pub faces_room: bool,
    /// Dominant material.
    #[serde(default)]
    pub material: Option<InspectedMaterial>,
    /// Template to build its mesh from.
    #[serde(default)]
    pub template: Option<String>,
    /// Options of the template.
    #[serde(default)]
    pub params: Option<TemplateParams>,
    /// A part model written for it, where no template fits.
    #[serde(default)]
    pub part_model: Option<PartModel>,
    /// Anything else.
    #[serde(default)]
    pub notes: String,
}

impl InspectedObject {
    /// An object about which nothing but its label and size is said.
    pub fn plain(id: &str, kind: &str, size_m: InspectedSize) -> Self {
        Self {
            id: id.to_owned(),
            keep: true,
            reason: String::new(),
            kind: kind.to_owned(),
            description: String::new(),
            occlusion: Occlusion::None,
            size_m,
            wall_affinity: WallAffinity::Centre,
            wall: None,
            reaches: Vec::new(),
            on_top_of: None,
            in_front_of: None,
            behind: None,
            facing_toward: None,
            front_deg: None,
            group: None,
            matched_set: None,
            count: None,
            joined_row: None,
            placement_type: PlacementType::OnSurface,
            surface_position: SurfacePosition::Center,
            depth_position: DepthPosition::Middle,
            faces_room: false,
            material: None,
            template: None,
            params: None,
            part_model: None,
            notes: String::new(),
        }
    }
}

impl Ask for InspectQuestion {
    type Answer = InspectAnswer;

    fn prompt(&self) -> String {
        let level = match self.level {
            Level::Wall => include_str!("../templates/inspect_wall.md"),
            Level::Furniture => include_str!("../templates/inspect_furniture.md"),
            Level::Ceiling => include_str!("../templates/inspect_ceiling.md"),
            Level::Decoration => include_str!("../templates/inspect_decoration.md"),
        };
        let models = if self.with_models {
            let models = [("templates", self.templates.join(", ")), ("part_models", self.part_models())];
            fill(include_str!("../templates/inspect_models.md"), &models)
        } else {
            "Leave `template`, `params` and `part_model` null.\n".to_owned()
        };
        fill(
            include_str!("../templates/inspect.md"),
            &[
                ("level_rules", level.to_owned()),
                ("models", models),
                ("room_type", self.room_type.clone()),
                ("room", self.room.to_string()),
                ("candidates", lines(&self.candidates) + &self.others()),
                ("placed", lines(&self.placed)),
            ],
        )
    }

    fn example(&self) -> InspectAnswer {
        InspectAnswer::example()
    }

    fn check(&self, answer: &InspectAnswer) -> Result<(), String> {
        let ids = |of: &[InspectCandidate]| of.iter().map(|c| c.id.to_string()).collect::<Vec<_>>();
        answer.check(&ids(&self.candidates), &ids(&self.others))
    }
}

impl InspectQuestion {
    /// Those of the level that are not asked about here, under a line that says so; empty where there are none.
    fn others(&self) -> String {
        if self.others.is_empty() {
            return String::new();
        }
        let about = "Of the same stage, asked about in another question (relations, sets and rows may name them; give no entry \
                     for them):";
        format!("\n\n{about}\n{}", lines(&self.others))
    }

    /// How to answer where no template comes near. Who gets a program needs no part model.
    fn part_models(&self) -> String {
        let follows = self.candidates.iter().filter(|c| c.program_follows).count();
        let next = "Programs that model them are asked for after this";
        let wanted = format!("write a `part_model` instead (then `template` is null):\n{PART_MODEL_GUIDE}");
        match follows {
            0 => format!("Where no template comes near, {wanted}"),
            n if n == self.candidates.len() => format!("{next}: leave `part_model` null."),
            _ => format!(
                "{next} for those with \"a program follows\": leave their `part_model` null. Where no template comes near \
                 another one, {wanted}"
            ),
        }
    }
}

impl InspectAnswer {
    /// A well-formed answer about some other picture.
    pub fn example() -> Self {
        let mut sofa =
            InspectedObject::plain("sofa_01", "sofa", InspectedSize { width: 2.1, height: 0.82, depth: 0.9 });
        sofa.description = "three-seat sofa, light grey woven fabric, rounded arms, short dark wooden legs".into();
        sofa.occlusion = Occlusion::Partly;
        sofa.wall_affinity = WallAffinity::Back;
        sofa.facing_toward = Some("coffee_table_01".into());
        sofa.front_deg = Some(0.0);
        sofa.group = Some("seating".into());
        sofa.material = Some(InspectedMaterial {
            material_category: MaterialCategory::Fabric,
            roughness: Some(0.9),
            metallic: Some(0.0),
            ior: Some(1.5),
            transmission: Some(0.0),
            weight_kg: Some(55.0),
            thickness_m: Some(0.1),
            elasticity: Some(0.4),
        });
        sofa.template = Some("sofa".into());
        let mut fragment =
            InspectedObject::plain("chair_02", "chair", InspectedSize { width: 0.5, height: 0.9, depth: 0.5 });
        fragment.keep = false;
        fragment.reason = "a reflection of chair_01 in the mirror".into();
        Self {
            objects: vec![sofa, fragment],
            placement_order: vec!["sofa_01".into()],
            scene_summary: "A sofa stands against the back wall and faces a coffee table.".into(),
        }
    }

    /// Whether every candidate is answered once and the numbers make sense. An answer that has entries for `others`, too, is
    /// of a recording that was made when more was asked at once: what it lacks is in another one.
    ///
    /// # Errors
    /// A complaint in words.
    pub fn check(&self, candidates: &[String], others: &[String]) -> Result<(), String> {
        let known: BTreeSet<&str> = candidates.iter().map(String::as_str).collect();
        let mut seen = BTreeSet::new();
        for object in &self.objects {
            if !known.contains(object.id.as_str()) && !others.contains(&object.id) {
                return Err(format!("there is no candidate {:?}; the ids are {}", object.id, candidates.join(", ")));
            }
            if !seen.insert(object.id.as_str()) {
                return Err(format!("candidate {:?} is answered twice", object.id));
            }
            for (name, v) in
                [("width", object.size_m.width), ("height", object.size_m.height), ("depth", object.size_m.depth)]
            {
                in_range(&format!("size_m.{name} of {}", object.id), v, 0.001, 12.0)?;
            }
            if let Some(v) = object.front_deg {
                in_range(&format!("front_deg of {}", object.id), v, -360.0, 360.0)?;
            }
        }
        let missing: Vec<_> = known.difference(&seen).copied().collect();
        if missing.is_empty() || !seen.is_subset(&known) {
            Ok(())
        } else {
            Err(format!("no entry for {}", missing.join(", ")))
        }
    }
}
