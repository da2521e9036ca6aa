//! `<level>/programs` and `<level>/second_look_<n>`: modelling programs for objects, and a second look at them.

use std::collections::{BTreeMap, BTreeSet};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Question, QuestionKind, fill};

/// What both questions are filled with.
#[derive(Debug, Clone)]
pub struct ProgramsVars {
    /// Room size and camera, one line.
    pub room: String,
    /// Objects: id, type, size, description, template or program so far.
    pub objects: Vec<String>,
    /// What the modelling language offers.
    pub guide: String,
}

/// The programs of a level.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProgramsAnswer {
    /// One entry an object.
    pub objects: Vec<ProgramObject>,
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
    /// Values for further parameters of `build`.
    #[serde(default)]
    pub params: BTreeMap<String, f64>,
}

/// Asks for programs.
pub fn programs(vars: &ProgramsVars) -> Question {
    Question::new(
        QuestionKind::Programs,
        filled(include_str!("../templates/programs.md"), vars),
        &ProgramsAnswer::example(),
    )
}

/// Asks whether the models are right.
pub fn second_look(vars: &ProgramsVars) -> Question {
    Question::new(
        QuestionKind::SecondLook,
        filled(include_str!("../templates/second_look.md"), vars),
        &SecondLookAnswer::example(),
    )
}

fn filled(template: &str, vars: &ProgramsVars) -> String {
    fill(template, &[("room", vars.room.clone()), ("objects", vars.objects.join("\n")), ("guide", vars.guide.clone())])
}

/// A stool, for examples.
const STOOL: &str = r##"def build(w=0.4, h=0.45, d=0.4):
    oak = mat("oak", "#b98a58", rough=0.5, map=wood(grain="x", seed=1))
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
        }
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

    /// Whether asked objects are answered, each once, and changes bring a program.
    ///
    /// # Errors
    /// A complaint in words.
    pub fn check(&self, asked: &[String]) -> Result<(), String> {
        known_once(self.objects.iter().map(|o| o.id.as_str()), asked)?;
        match self.objects.iter().find(|o| o.verdict == LookVerdict::Change && o.program.is_none()) {
            Some(object) => Err(format!("{} is to be changed, but there is no program", object.id)),
            None => Ok(()),
        }
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
        answer.objects[0].program = None;
        assert!(answer.check(&asked).unwrap_err().contains("no program"));
    }
}
