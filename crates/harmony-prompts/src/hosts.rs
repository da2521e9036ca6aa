//! `<level>/hosts`: on which of several pieces a decoration stands (paper App. C, "Placement": matching, and the
//! verification after it).

use std::fmt::{Display, Formatter};

use harmony_scene::ObjectId;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Ask, bare_lines, fill, mostly_sound};

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

impl HostsQuestion {
    /// What is wrong with an entry of an answer: it is of no object that was asked about, or no host that it could have.
    pub fn complaint(&self, entry: &HostsObject) -> Option<String> {
        let Some(known) = self.objects.iter().find(|o| o.id.as_str() == entry.id) else {
            return Some(format!("{:?} was not asked for", entry.id));
        };
        known.candidates.iter().all(|c| c.as_str() != entry.host).then(|| {
            let could: Vec<&str> = known.candidates.iter().map(ObjectId::as_str).collect();
            format!("{} cannot be on {:?}; it could be on {}", entry.id, entry.host, could.join(", "))
        })
    }
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
        let complaints: Vec<String> = answer.objects.iter().filter_map(|object| self.complaint(object)).collect();
        mostly_sound(&complaints, answer.objects.len())
    }

    fn without_looking(&self) -> Option<HostsAnswer> {
        Some(HostsAnswer::default())
    }
}
