//! What questions are about: the room, candidates, objects. Each is written as one line of a prompt by `Display`.

use std::fmt::{Display, Formatter, Result};

use harmony_scene::{Extents, ImageSize, Ledge, Level, ObjectId, PixelBox, RoomShape, Size, Support, Vec3};
use serde::{Serialize, Serializer};

/// The room and where the camera stands in it.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct RoomSummary {
    /// Metres.
    pub extents: Extents,
    /// `bedroom`, `living_room`, ...
    #[serde(skip)]
    pub room_type: String,
    /// Camera centre in the room, metres.
    #[serde(skip)]
    pub camera: [f64; 3],
    /// Where the room is no box.
    #[serde(skip)]
    pub shape: RoomShape,
}

impl Display for RoomSummary {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let Extents { width, height, depth } = self.extents;
        let [x, y, z] = self.camera;
        write!(
            f,
            "Room W x D x H = {width:.2} x {depth:.2} x {height:.2} m ({}). Camera at x {x:.2}, y {y:.2}, z {z:.2}.",
            self.room_type
        )?;
        let RoomShape { blocks, niches, slopes } = &self.shape;
        let between = |low: Vec3, high: Vec3| {
            let [x, y, z] = [0, 1, 2].map(|i| format!("{:.2} to {:.2}", low[i], high[i]));
            format!("x {x}, y {y}, z {z}")
        };
        for (i, block) in blocks.iter().enumerate() {
            write!(f, " Solid: {}, {}", block.kind, between(block.min, block.max))?;
            if block.carries(&self.extents) {
                write!(f, " (what stands or lies on it is on top of {})", Ledge::Block(i).id())?;
            }
            write!(f, ".")?;
        }
        for (i, niche) in niches.iter().enumerate() {
            write!(f, " Free: {}, {}", niche.kind, between(niche.min, niche.max))?;
            if niche.carries() {
                write!(f, " (what stands or lies in it is on top of {})", Ledge::Niche(i).id())?;
            }
            write!(f, ".")?;
        }
        for slope in slopes {
            let (wall, low, run) = (slope.wall.surface().name(), slope.low, slope.run);
            write!(f, " The ceiling comes down to y {low:.2} at the {wall} wall, over {run:.2} m.")?;
        }
        Ok(())
    }
}

/// An object and a few words about it.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct NamedObject {
    /// Id.
    pub id: String,
    /// Its kind or description.
    #[serde(skip)]
    pub about: String,
}

impl Display for NamedObject {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        write!(f, "- {}: {}", self.id, self.about)
    }
}

/// An object that stands in the scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlacedObject {
    /// Id.
    pub id: ObjectId,
    /// Category.
    #[serde(skip)]
    pub label: String,
    /// Level.
    #[serde(skip)]
    pub level: Level,
    /// Bounds of its mask in the photo, pixels.
    #[serde(skip)]
    pub seen: Option<PixelBox>,
    /// Middle of its underside in the room, metres.
    pub position: [f64; 3],
    /// Counter-clockwise from above, 0 = front to the viewer, degrees.
    pub yaw_deg: f64,
    /// Metres.
    pub size: Size,
    /// What carries it.
    pub support: Support,
    /// Intersection over union of its mask and its render, 0 to 1.
    #[serde(skip)]
    pub outline_agreement: Option<f64>,
}

/// `1.20 x 0.75 x 0.60`; a thin side in millimetres: `0.44 x 0.44 x 0.006`.
pub(crate) fn sides(size: &Size) -> String {
    let side = |v: f64| if v < 0.095 { format!("{v:.3}") } else { format!("{v:.2}") };
    format!("{} x {} x {}", side(size.width), side(size.height), side(size.depth))
}

impl Display for PlacedObject {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let ([x, y, z], size) = (self.position, self.size);
        write!(
            f,
            "- {}: {}, at ({x:.2}, {y:.2}, {z:.2}), yaw {:.0} deg, size {} m, ",
            self.id,
            self.label,
            self.yaw_deg,
            sides(&size)
        )?;
        match &self.support {
            Support::Floor => write!(f, "on the floor")?,
            Support::Ceiling => write!(f, "under the ceiling")?,
            Support::Wall { wall } => write!(f, "on the {} wall", wall.surface().name())?,
            Support::Object { id } => write!(f, "on {id}")?,
            Support::Block { block } => write!(f, "on {}", Ledge::Block(*block).id())?,
            Support::Niche { niche } => write!(f, "on {}", Ledge::Niche(*niche).id())?,
        }
        self.outline_agreement.map_or(Ok(()), |iou| write!(f, ", outline agreement {iou:.2}"))
    }
}

/// An object of an earlier level that is not placed yet.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundObject {
    /// Id.
    pub id: ObjectId,
    /// Category.
    pub label: String,
    /// Level.
    pub level: Level,
    /// Bounds of its mask in the photo, pixels.
    pub seen: Option<PixelBox>,
    /// The box it was detected by, pixels.
    pub bounds: PixelBox,
    /// Size of the photo, pixels.
    pub image: ImageSize,
    /// Estimated, metres.
    pub size: Size,
}

impl Display for FoundObject {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        write!(
            f,
            "- {}: {}, seen at box {}, about {} m; its place is not known yet",
            self.id,
            self.label,
            thousandths(&self.bounds, self.image),
            sides(&self.size)
        )
    }
}

/// An object of an earlier level.
#[derive(Debug, Clone, PartialEq)]
pub enum KnownObject {
    /// It stands in the scene.
    Placed(PlacedObject),
    /// It is found in the photo only.
    Found(FoundObject),
}

impl KnownObject {
    /// Id.
    pub fn id(&self) -> &ObjectId {
        match self {
            Self::Placed(object) => &object.id,
            Self::Found(object) => &object.id,
        }
    }

    /// Level.
    pub fn level(&self) -> Level {
        match self {
            Self::Placed(object) => object.level,
            Self::Found(object) => object.level,
        }
    }

    /// Bounds of its mask in the photo, pixels.
    pub fn seen(&self) -> Option<PixelBox> {
        match self {
            Self::Placed(object) => object.seen,
            Self::Found(object) => object.seen,
        }
    }
}

impl Display for KnownObject {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match self {
            Self::Placed(object) => object.fmt(f),
            Self::Found(object) => object.fmt(f),
        }
    }
}

impl Serialize for KnownObject {
    /// Where it is seen beside where it stands, for content keys; the rest is in the text.
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Row<'a> {
            id: &'a ObjectId,
            label: &'a str,
            level: Level,
            #[serde(rename = "box")]
            seen: Option<PixelBox>,
            position: Option<[f64; 3]>,
            size: Size,
        }
        let (label, position, size) = match self {
            Self::Placed(object) => (&object.label, Some(object.position), object.size),
            Self::Found(object) => (&object.label, None, object.size),
        };
        Row { id: self.id(), label, level: self.level(), seen: self.seen(), position, size }.serialize(serializer)
    }
}

/// `[left, top, right, bottom]` in thousandths of a photo.
pub(crate) fn thousandths(bounds: &PixelBox, image: ImageSize) -> String {
    let (kx, ky) = (1000.0 / f64::from(image.width), 1000.0 / f64::from(image.height));
    let PixelBox { x0, y0, x1, y1 } = bounds;
    format!("[{:.0}, {:.0}, {:.0}, {:.0}]", x0 * kx, y0 * ky, x1 * kx, y1 * ky)
}

#[cfg(test)]
mod tests {
    use harmony_scene::{Niche, Surface};

    use super::*;

    #[test]
    fn where_the_room_is_no_box_is_told() {
        let extents = Extents { width: 4.0, height: 2.5, depth: 5.0 };
        let mut room =
            RoomSummary { extents, room_type: "study".into(), camera: [2.0, 1.5, 4.0], shape: RoomShape::default() };
        assert!(room.to_string().ends_with("z 4.00."), "{room}");
        room.shape.niches.push(Niche {
            kind: "alcove".into(),
            surface: Surface::Left,
            sides: None,
            glow: None,
            min: Vec3::new(-0.75, 0.0, 1.0),
            max: Vec3::new(0.0, 2.1, 3.0),
        });
        let told = "Free: alcove, x -0.75 to 0.00, y 0.00 to 2.10, z 1.00 to 3.00.";
        assert!(room.to_string().ends_with(told), "{room}");
    }
}
