//! `<level>/programs` and `<level>/second_look_<n>`: modelling programs for objects, and a second look at them.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{Display, Formatter};

use harmony_scene::{ImageSize, ObjectId, PixelBox, Size};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::layout::SurfaceName;
use crate::question::{Ask, bare_lines, fill, tried};
use crate::subjects::{PlacedObject, RoomSummary, thousandths};

/// Asks for programs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProgramsQuestion {
    /// Room and camera.
    #[serde(skip)]
    pub room: RoomSummary,
    /// What is to be modelled.
    pub objects: Vec<ToModel>,
    /// Whether what is built into the room is asked for, too.
    #[serde(skip)]
    pub features: bool,
    /// What the modelling language offers.
    #[serde(skip)]
    pub guide: String,
}

/// An object that a program is wanted for.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct ToModel {
    /// Id.
    pub id: ObjectId,
    /// Category.
    #[serde(skip)]
    pub kind: String,
    /// Metres.
    #[serde(skip)]
    pub size: Size,
    /// Its box, pixels.
    #[serde(skip)]
    pub bounds: PixelBox,
    /// Size of the photo, pixels.
    #[serde(skip)]
    pub image: ImageSize,
    /// How it would be modelled without a program.
    #[serde(skip)]
    pub otherwise: WithoutProgram,
    /// Name of the set of identical instances it belongs to.
    #[serde(skip)]
    pub matched_set: Option<String>,
    /// Looks in words.
    #[serde(skip)]
    pub description: String,
}

/// How an object is modelled when there is no program for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum WithoutProgram {
    /// By a part model of its own.
    PartModel,
    /// By this template.
    Template(String),
    /// By the template of its category.
    Unnamed,
}

impl Display for ToModel {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let Size { width, height, depth } = self.size;
        let bounds = thousandths(&self.bounds, self.image);
        write!(f, "- {}: {}, {width:.2} x {height:.2} x {depth:.2} m, box {bounds}; ", self.id, self.kind)?;
        match &self.otherwise {
            WithoutProgram::PartModel => write!(f, "a part model was written")?,
            WithoutProgram::Template(name) => write!(f, "template {name}")?,
            WithoutProgram::Unnamed => write!(f, "no template named")?,
        }
        self.matched_set.as_ref().map_or(Ok(()), |set| write!(f, "; one of the set {set:?}"))?;
        write!(f, "; {}", self.description)
    }
}

/// Asks whether models are right.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SecondLookQuestion {
    /// What is looked at.
    pub objects: Vec<ModelledObject>,
    /// What was asked for in the round before and what came of it, one line each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tried: Vec<String>,
    /// What the modelling language offers.
    #[serde(skip)]
    pub guide: String,
}

/// An object in the scene and how it is modelled.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelledObject {
    /// The object.
    pub object: PlacedObject,
    /// What its mesh was made from, in words.
    pub made_as: String,
    /// Its program.
    pub program: Option<ShownProgram>,
    /// Values of the program's further parameters.
    pub params: BTreeMap<String, f64>,
}

/// An object's program as a question shows it.
#[derive(Debug, Clone, PartialEq)]
pub enum ShownProgram {
    /// Its text.
    Text(String),
    /// That of an object whose text stands above.
    SameAs(ObjectId),
}

impl Serialize for ModelledObject {
    /// Its id; the rest is in the text.
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.object.id.serialize(serializer)
    }
}

impl Display for ModelledObject {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, made as {}", self.object, self.made_as)?;
        if !self.params.is_empty() {
            let params: Vec<String> = self.params.iter().map(|(name, value)| format!("{name} = {value}")).collect();
            write!(f, ", params {}", params.join(", "))?;
        }
        match &self.program {
            None => Ok(()),
            Some(ShownProgram::Text(text)) => write!(f, "\n```python\n{}\n```", text.trim_end()),
            Some(ShownProgram::SameAs(id)) => write!(f, ", by the program of {id}"),
        }
    }
}

/// The programs of a level.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProgramsAnswer {
    /// One entry an object.
    pub objects: Vec<ProgramObject>,
    /// What is built into the room and is no object; asked for with the walls' objects alone.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub features: Vec<RoomFeature>,
}

/// Something built into the room, modelled on one of its faces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RoomFeature {
    /// In a word or two; each once.
    pub name: String,
    /// The face of the room in whose frame it is modelled.
    pub on: SurfaceName,
    /// The program; null where it shares one by `same_as`.
    #[serde(default)]
    pub program: Option<String>,
    /// Name of the feature whose program it shares.
    #[serde(default)]
    pub same_as: Option<String>,
    /// Values for further parameters of `build`.
    #[serde(default)]
    pub params: BTreeMap<String, f64>,
}

/// How one object is modelled.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProgramObject {
    /// Id.
    pub id: String,
    /// The program; null: its template is good enough, or it shares one by `same_as`.
    #[serde(default)]
    pub program: Option<String>,
    /// Id of the object whose program it shares.
    #[serde(default)]
    pub same_as: Option<String>,
    /// Values for further parameters of `build`.
    #[serde(default)]
    pub params: BTreeMap<String, f64>,
    /// Anything else.
    #[serde(default)]
    pub notes: String,
}

/// Whether a model is good.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum LookVerdict {
    #[default]
    Fine,
    Change,
}

/// What a second look found.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SecondLookAnswer {
    /// One entry an object.
    pub objects: Vec<LookedAt>,
}

/// About one object.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LookedAt {
    /// Id.
    pub id: String,
    /// Whether it stays.
    #[serde(default)]
    pub verdict: LookVerdict,
    /// What differs.
    #[serde(default)]
    pub why: String,
    /// The whole corrected program, for a change.
    #[serde(default)]
    pub program: Option<String>,
    /// Id of the object whose corrected program it shares.
    #[serde(default)]
    pub same_as: Option<String>,
    /// Values for further parameters of `build`.
    #[serde(default)]
    pub params: BTreeMap<String, f64>,
}

impl Ask for ProgramsQuestion {
    type Answer = ProgramsAnswer;

    fn prompt(&self) -> String {
        let (features, form) =
            if self.features { (include_str!("../templates/features.md"), FEATURES_FORM) } else { ("", "") };
        fill(
            include_str!("../templates/programs.md"),
            &[
                ("room", self.room.to_string()),
                ("objects", bare_lines(&self.objects)),
                ("guide", self.guide.clone()),
                ("features", features.to_owned()),
                ("form", form.to_owned()),
            ],
        )
    }

    fn example(&self) -> ProgramsAnswer {
        let features = if self.features { RoomFeature::examples() } else { Vec::new() };
        ProgramsAnswer { features, ..ProgramsAnswer::example() }
    }

    fn check(&self, answer: &ProgramsAnswer) -> Result<(), String> {
        answer.check(&self.objects.iter().map(|o| o.id.to_string()).collect::<Vec<_>>())?;
        if !self.features && !answer.features.is_empty() {
            return Err("`features` is not asked for here: they come with the objects on the walls".into());
        }
        answer.check_features()
    }

    /// No programs are written.
    fn without_looking(&self) -> Option<ProgramsAnswer> {
        Some(ProgramsAnswer::default())
    }
}

impl Ask for SecondLookQuestion {
    type Answer = SecondLookAnswer;

    fn prompt(&self) -> String {
        fill(
            include_str!("../templates/second_look.md"),
            &[("objects", bare_lines(&self.objects)), ("tried", tried(&self.tried)), ("guide", self.guide.clone())],
        )
    }

    fn example(&self) -> SecondLookAnswer {
        SecondLookAnswer::example()
    }

    fn check(&self, answer: &SecondLookAnswer) -> Result<(), String> {
        answer.check(&self.objects.iter().map(|o| o.object.id.to_string()).collect::<Vec<_>>())
    }

    fn without_looking(&self) -> Option<SecondLookAnswer> {
        Some(SecondLookAnswer::default())
    }
}

/// How features are answered.
const FEATURES_FORM: &str = r#", "features": [{"name", "on", "program", "same_as", "params"}]"#;

/// Most features of a room.
const MAX_FEATURES: usize = 12;

/// A dado rail, for examples.
const RAIL: &str = r##"def build(w, h, d):
    white = mat("white", "#f0ede4", rough=0.5)
    rail = box((w, 0.05, 0.025), bevel=0.008, mat=white).at(w / 2, 0.9, 0.0125)
    return group("rail", rail=rail)
"##;

impl RoomFeature {
    /// About some other picture.
    fn examples() -> Vec<Self> {
        let on = |name: &str, on: SurfaceName| Self {
            name: name.into(),
            on,
            program: None,
            same_as: None,
            params: BTreeMap::new(),
        };
        vec![
            Self { program: Some(RAIL.into()), ..on("dado rail back", SurfaceName::WallBack) },
            Self { same_as: Some("dado rail back".into()), ..on("dado rail left", SurfaceName::WallLeft) },
        ]
    }
}

/// A stool, for examples.
const STOOL: &str = r##"def build(w=0.4, h=0.45, d=0.4):
    oak = mat("oak", "#b98a58", rough=0.5, map=wood(seed=1))
    seat = cylinder(w / 2, 0.03, bevel=0.006, mat=oak).at(0, h - 0.03, 0)
    leg = cylinder(0.02, h - 0.03, r2=0.014, mat=oak)
    return group("stool", seat=seat, legs=ring(leg, 4, w / 2 - 0.05))
"##;

impl ProgramsAnswer {
    /// A well-formed answer about some other picture.
    pub fn example() -> Self {
        Self {
            objects: vec![
                ProgramObject { id: "stool_01".into(), program: Some(STOOL.into()), ..ProgramObject::default() },
                ProgramObject { id: "stool_02".into(), same_as: Some("stool_01".into()), ..ProgramObject::default() },
                ProgramObject {
                    id: "sofa_01".into(),
                    notes: "the template shows it well".into(),
                    ..ProgramObject::default()
                },
            ],
            features: Vec::new(),
        }
    }

    /// The program of a feature, its own or the one it shares.
    pub fn program_of_feature<'a>(&'a self, feature: &'a RoomFeature) -> Option<&'a str> {
        let shared = |name: &String| self.features.iter().find(|f| f.name == *name)?.program.as_deref();
        feature.program.as_deref().or_else(|| shared(feature.same_as.as_ref()?))
    }

    /// Whether features have names of their own and programs.
    fn check_features(&self) -> Result<(), String> {
        if self.features.len() > MAX_FEATURES {
            return Err(format!("{} features; at most {MAX_FEATURES} are built", self.features.len()));
        }
        let mut names = BTreeSet::new();
        for feature in &self.features {
            let name = &feature.name;
            if name.trim().is_empty() || !names.insert(name) {
                return Err(format!("a feature needs a name of its own, not {name:?}"));
            }
            if self.program_of_feature(feature).is_none() {
                return Err(format!("the feature {name:?} has no program, and none that it shares by `same_as`"));
            }
        }
        Ok(())
    }

    /// The program of an object, its own or the one it shares, with its parameters.
    pub fn program_of(&self, id: &str) -> Option<(&str, &BTreeMap<String, f64>)> {
        let own = self.objects.iter().find(|o| o.id == id)?;
        let source = match (&own.program, &own.same_as) {
            (Some(program), _) => program,
            (None, Some(other)) => self.objects.iter().find(|o| o.id == *other)?.program.as_ref()?,
            (None, None) => return None,
        };
        Some((source, &own.params))
    }

    /// Whether only asked objects are answered, each once, and shared programs exist.
    ///
    /// # Errors
    /// A complaint in words.
    pub fn check(&self, asked: &[String]) -> Result<(), String> {
        known_once(self.objects.iter().map(|o| o.id.as_str()), asked)?;
        for object in &self.objects {
            let Some(other) = &object.same_as else { continue };
            if object.program.is_none() && self.program_of(&object.id).is_none() {
                return Err(format!("{} is the same as {other:?}, which has no program of its own", object.id));
            }
        }
        Ok(())
    }
}

impl SecondLookAnswer {
    /// A well-formed answer about some other picture.
    pub fn example() -> Self {
        Self {
            objects: vec![
                LookedAt {
                    id: "stool_01".into(),
                    verdict: LookVerdict::Change,
                    why: "the photo shows three legs, not four, and a thinner seat".into(),
                    program: Some(STOOL.replace("ring(leg, 4", "ring(leg, 3")),
                    ..LookedAt::default()
                },
                LookedAt { id: "sofa_01".into(), ..LookedAt::default() },
            ],
        }
    }

    /// The corrected program of an object that is to be changed, its own or the one it shares.
    pub fn program_of<'a>(&'a self, object: &'a LookedAt) -> Option<&'a str> {
        let of = |id: &String| self.objects.iter().find(|o| o.id == *id)?.program.as_deref();
        let program = object.program.as_deref().or_else(|| of(object.same_as.as_ref()?));
        program.filter(|_| object.verdict == LookVerdict::Change)
    }

    /// Whether asked objects are answered, each once, and changes bring a program.
    ///
    /// # Errors
    /// A complaint in words.
    pub fn check(&self, asked: &[String]) -> Result<(), String> {
        known_once(self.objects.iter().map(|o| o.id.as_str()), asked)?;
        let lacks = |o: &&LookedAt| o.verdict == LookVerdict::Change && self.program_of(o).is_none();
        let Some(object) = self.objects.iter().find(lacks) else { return Ok(()) };
        Err(match &object.same_as {
            Some(other) => format!("{} is the same as {other:?}, for which there is no corrected program", object.id),
            None => format!("{} is to be changed, but there is no program", object.id),
        })
    }
}

fn known_once<'a>(answered: impl Iterator<Item = &'a str>, asked: &[String]) -> Result<(), String> {
    let known: BTreeSet<&str> = asked.iter().map(String::as_str).collect();
    let mut seen = BTreeSet::new();
    let mut others = None;
    for id in answered {
        if !known.contains(id) {
            others = Some(id);
        }
        if !seen.insert(id) {
            return Err(format!("{id:?} is answered twice"));
        }
    }
    // What was not asked for is left out; an answer that holds nothing else is one to another question.
    match others {
        Some(id) if !seen.iter().any(|s| known.contains(s)) => {
            Err(format!("{id:?} was not asked for; the ids are {}", asked.join(", ")))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_are_shared_by_name_and_a_name_that_has_none_is_refused() {
        let answer = ProgramsAnswer::example();
        let asked = ["stool_01", "stool_02", "sofa_01"].map(str::to_owned);
        assert_eq!(answer.check(&asked), Ok(()));
        assert_eq!(answer.program_of("stool_02").map(|(p, _)| p), Some(STOOL));
        assert_eq!(answer.program_of("sofa_01"), None);
        let mut lost = answer.clone();
        lost.objects[1].same_as = Some("sofa_01".into());
        assert!(lost.check(&asked).unwrap_err().contains("no program of its own"));
        assert_eq!(answer.check(&asked[..2]), Ok(()), "what else it holds is left out");
        assert!(answer.check(&["lamp_01".to_owned()]).unwrap_err().contains("was not asked for"));
    }

    #[test]
    fn a_change_needs_a_program() {
        let mut answer = SecondLookAnswer::example();
        let asked = ["stool_01", "sofa_01"].map(str::to_owned);
        assert_eq!(answer.check(&asked), Ok(()));
        answer.objects[1].verdict = LookVerdict::Change;
        answer.objects[1].same_as = Some("stool_01".into());
        assert_eq!(answer.check(&asked), Ok(()));
        assert_eq!(answer.program_of(&answer.objects[1]), answer.objects[0].program.as_deref());
        answer.objects[0].program = None;
        assert!(answer.check(&asked).unwrap_err().contains("no program"));
        answer.objects[0].verdict = LookVerdict::Fine;
        assert!(answer.check(&asked).unwrap_err().contains("no corrected program"));
    }
}
