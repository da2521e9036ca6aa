//! `<level>/hosts`: on which of several pieces a decoration stands (paper App. C, "Placement": matching, and the
//! verification after it).

use std::collections::BTreeMap;
use std::fmt::{Display, Formatter};

use harmony_scene::ObjectId;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Ask, bare_lines, fill};

/// Asks for the hosts of some decorations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HostsQuestion {
    /// The decorations that could stand on more than one thing, or stand badly.
    pub objects: Vec<HostedObject>,
}

/// A decoration with the hosts that it could have.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HostedObject {
    /// Id.
    pub id: ObjectId,
    /// Its kind.
    #[serde(skip)]
    pub about: String,
    /// What it stands on now.
    pub current: Option<ObjectId>,
    /// What it could stand on, the current one among them.
    pub candidates: Vec<ObjectId>,
}

impl Display for HostedObject {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let now = self.current.as_ref().map_or("nothing", ObjectId::as_str);
        let could: Vec<&str> = self.candidates.iter().map(ObjectId::as_str).collect();
        write!(f, "- {}: {}; now on {now}; could be on {}", self.id, self.about, could.join(", "))
    }
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HostsAnswer {
    /// One entry an object whose host is another one than now; the others may be left out.
    pub objects: Vec<HostsObject>,
}

/// On what one decoration stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HostsObject {
    /// Id of the decoration.
    pub id: String,
    /// Id of what it stands on.
    pub host: String,
    /// What in the photo says so.
    #[serde(default)]
    pub reason: String,
}

impl Ask for HostsQuestion {
    type Answer = HostsAnswer;

    fn prompt(&self) -> String {
        fill(include_str!("../templates/hosts.md"), &[("objects", bare_lines(&self.objects))])
    }

    fn example(&self) -> HostsAnswer {
        let reason = "it stands on the larger, closer table".to_owned();
        HostsAnswer { objects: vec![HostsObject { id: "vase_01".into(), host: "coffee_table_02".into(), reason }] }
    }

    fn check(&self, answer: &HostsAnswer) -> Result<(), String> {
        let asked: BTreeMap<&str, &HostedObject> = self.objects.iter().map(|o| (o.id.as_str(), o)).collect();
        for object in &answer.objects {
            let Some(known) = asked.get(object.id.as_str()) else {
                return Err(format!("{:?} was not asked for", object.id));
            };
            if known.candidates.iter().all(|c| c.as_str() != object.host) {
                let could: Vec<&str> = known.candidates.iter().map(ObjectId::as_str).collect();
                return Err(format!(
                    "{} cannot be on {:?}; it could be on {}",
                    object.id,
                    object.host,
                    could.join(", ")
                ));
            }
        }
        Ok(())
    }

    fn without_looking(&self) -> Option<HostsAnswer> {
        Some(HostsAnswer::default())
    }
}
