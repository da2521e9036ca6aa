//! `<level>/groups`: members of a matched set in the photo's left-to-right order (paper App. C, "Matched-group
//! reordering").

use std::fmt::{Display, Formatter};

use harmony_scene::ObjectId;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::missing::check_box;
use crate::question::{Ask, bare_lines, fill, mostly_sound};

/// Asks about the order of some sets.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GroupsQuestion {
    /// The sets.
    pub sets: Vec<MatchedSet>,
}

/// A set of like things.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MatchedSet {
    /// Its name.
    pub name: String,
    /// Its members as they are placed, from left to right in the picture.
    pub members: Vec<ObjectId>,
}

impl Display for MatchedSet {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let members: Vec<&str> = self.members.iter().map(ObjectId::as_str).collect();
        write!(f, "- {}: {}", self.name, members.join(", "))
    }
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GroupsAnswer {
    /// Pairs that exchange their places, one after the other.
    #[serde(default)]
    pub swaps: Vec<GroupSwap>,
    /// Members that the photo shows and the reconstruction lacks.
    #[serde(default)]
    pub missing: Vec<MissingMember>,
}

/// Two members that stand in each other's place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GroupSwap {
    /// One.
    pub id: String,
    /// The other.
    pub with: String,
}

/// A member that is not there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MissingMember {
    /// The member whose shape it has.
    pub like: String,
    /// `[left, top, right, bottom]` in the photo (IMAGE 1), 0..1000, tight around the visible part.
    #[serde(rename = "box")]
    pub bounds: [f64; 4],
}

impl GroupsQuestion {
    /// What is wrong with a swap: one of the two is of no set that was asked about, or they are of different ones.
    pub fn swap_complaint(&self, swap: &GroupSwap) -> Option<String> {
        match (self.set_of(&swap.id), self.set_of(&swap.with)) {
            (Ok(one), Ok(other)) if one == other => None,
            (Ok(_), Ok(_)) => Some(format!("{} and {} are of different sets", swap.id, swap.with)),
            (Err(complaint), _) | (_, Err(complaint)) => Some(complaint),
        }
    }

    /// What is wrong with a missing member: the one that it is like is of no set that was asked about.
    pub fn member_complaint(&self, member: &MissingMember) -> Option<String> {
        self.set_of(&member.like).err()
    }

    /// Name of the set that an object is of.
    fn set_of(&self, id: &str) -> Result<&str, String> {
        let has = |set: &&MatchedSet| set.members.iter().any(|member| member.as_str() == id);
        let set = self.sets.iter().find(has).ok_or_else(|| format!("{id:?} is in no set that was asked about"))?;
        Ok(&set.name)
    }
}

impl Ask for GroupsQuestion {
    type Answer = GroupsAnswer;

    fn prompt(&self) -> String {
        fill(include_str!("../templates/groups.md"), &[("sets", bare_lines(&self.sets))])
    }

    fn example(&self) -> GroupsAnswer {
        GroupsAnswer {
            swaps: vec![GroupSwap { id: "pillow_01".into(), with: "pillow_03".into() }],
            missing: vec![MissingMember { like: "pillow_02".into(), bounds: [512.0, 380.0, 588.0, 455.0] }],
        }
    }

    fn check(&self, answer: &GroupsAnswer) -> Result<(), String> {
        for member in &answer.missing {
            check_box(&member.like, member.bounds)?;
        }
        let changes = answer.swaps.len() + answer.missing.len();
        if changes > 40 {
            return Err("more than 40 changes".to_owned());
        }
        let swaps = answer.swaps.iter().filter_map(|swap| self.swap_complaint(swap));
        let complaints: Vec<String> =
            swaps.chain(answer.missing.iter().filter_map(|member| self.member_complaint(member))).collect();
        mostly_sound(&complaints, changes)
    }

    fn without_looking(&self) -> Option<GroupsAnswer> {
        Some(GroupsAnswer::default())
    }
}
