//! `<level>/sizes`: sizes far outside what their kinds usually have, asked again before anything is made of them. An answer is
//! doubted, not cut: a bean bag of a metre exists.

use std::collections::BTreeSet;
use std::fmt::{Display, Formatter};

use harmony_scene::{ObjectId, Size};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::InspectedSize;
use crate::question::{Ask, bare_lines, fill, in_range};
use crate::subjects::sides;

/// Asks again for some sizes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SizesQuestion {
    /// The objects.
    pub objects: Vec<DoubtedSize>,
}

/// An object with a size that is hard to believe.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DoubtedSize {
    /// Id.
    pub id: ObjectId,
    /// Its kind.
    pub kind: String,
    /// As answered, metres.
    pub answered: Size,
    /// What things of its kind usually have, smallest and largest, metres.
    pub usual: [Size; 2],
    /// Width and height that its box has at the distance where it seems to stand, metres.
    pub apparent: Option<Size>,
}

impl Display for DoubtedSize {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let [low, high] = &self.usual;
        write!(
            f,
            "- {}: {}, answered {} m, usual {} to {} m",
            self.id,
            self.kind,
            sides(&self.answered),
            sides(low),
            sides(high)
        )?;
        self.apparent.map_or(Ok(()), |a| write!(f, ", looks about {:.2} wide and {:.2} high", a.width, a.height))
    }
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SizesAnswer {
    /// One entry an object whose size is another one than answered; the others may be left out.
    pub objects: Vec<SizesObject>,
}

/// The size of one object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SizesObject {
    /// Id.
    pub id: String,
    /// Metres.
    pub size_m: InspectedSize,
}

impl Ask for SizesQuestion {
    type Answer = SizesAnswer;

    fn prompt(&self) -> String {
        fill(include_str!("../templates/sizes.md"), &[("objects", bare_lines(&self.objects))])
    }

    fn example(&self) -> SizesAnswer {
        let size_m = InspectedSize { width: 0.95, height: 0.8, depth: 0.95 };
        SizesAnswer { objects: vec![SizesObject { id: "bean_bag_01".into(), size_m }] }
    }

    fn check(&self, answer: &SizesAnswer) -> Result<(), String> {
        let asked: BTreeSet<&str> = self.objects.iter().map(|o| o.id.as_str()).collect();
        for object in &answer.objects {
            if !asked.contains(object.id.as_str()) {
                return Err(format!("{:?} was not asked for", object.id));
            }
            let InspectedSize { width, height, depth } = object.size_m;
            for v in [width, height, depth] {
                in_range(&format!("a side of {}", object.id), v, 0.001, 20.0)?;
            }
        }
        Ok(())
    }

    fn without_looking(&self) -> Option<SizesAnswer> {
        Some(SizesAnswer::default())
    }
}
