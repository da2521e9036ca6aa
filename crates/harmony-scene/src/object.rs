//! Objects, their poses and relations.

use std::collections::BTreeSet;

use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Ledge, ObjectId, PixelBox, Surface, SurfaceMaterial, Wall};

/// The four object levels, in the order they are detected; placement goes wall, furniture, ceiling, decoration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// On a wall: window, door, painting, shelf.
    Wall,
    /// On the floor: sofa, table, rug.
    Furniture,
    /// Under the ceiling: pendant, fan.
    Ceiling,
    /// On furniture: vase, cushion, monitor.
    Decoration,
}

impl Level {
    /// Placement order.
    pub const ALL: [Self; 4] = [Self::Wall, Self::Furniture, Self::Ceiling, Self::Decoration];

    /// Folder of the phase in a run.
    pub fn folder(self) -> &'static str {
        match self {
            Self::Wall => "2_wall",
            Self::Furniture => "3_furniture",
            Self::Ceiling => "4_ceiling",
            Self::Decoration => "5_decoration",
        }
    }

    /// The stage name of the paper's data set annotations.
    pub fn stage(self) -> &'static str {
        match self {
            Self::Wall => "wall-mounted",
            Self::Furniture => "furniture",
            Self::Ceiling => "ceiling",
            Self::Decoration => "decoration",
        }
    }
}

/// Width (x), height (y) and depth (z) of an unrotated object, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Size {
    /// Along the object's x (side to side).
    pub width: f64,
    /// Along y (bottom to top).
    pub height: f64,
    /// Along z (back to front).
    pub depth: f64,
}

impl Size {
    /// `(W, H, D)`.
    pub fn as_vec(self) -> DVec3 {
        DVec3::new(self.width, self.height, self.depth)
    }

    /// From `(W, H, D)`.
    pub fn from_vec(v: DVec3) -> Self {
        Self { width: v.x, height: v.y, depth: v.z }
    }
}

/// Where an object stands: `room = position + Ry(yaw) * (scale * stretch .* canonical)`.
///
/// `position` is the canonical origin: the bottom centre, for wall objects the centre of the back face's
/// bottom edge likewise (canonical meshes have their bottom at y = 0 on every level).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Pose {
    /// Room position of the canonical origin, metres.
    #[schemars(with = "[f64; 3]")]
    pub position: DVec3,
    /// About +Y, radians, 0 = front towards +Z.
    pub yaw: f64,
    /// The paper's uniform scale `s`: metres per canonical unit.
    pub scale: f64,
    /// Proportions corrected on top of `scale`; all 1 unless the mesh is a part model or a slab.
    #[schemars(with = "[f64; 3]")]
    pub stretch: DVec3,
}

impl Pose {
    /// A pose without stretch.
    pub fn new(position: DVec3, yaw: f64, scale: f64) -> Self {
        Self { position, yaw, scale, stretch: DVec3::ONE }
    }

    /// Linear part of `room_from_object`.
    pub fn linear(&self) -> DMat3 {
        DMat3::from_rotation_y(self.yaw) * DMat3::from_diagonal(self.stretch * self.scale)
    }

    /// Maps a canonical point into the room.
    pub fn point(&self, canonical: DVec3) -> DVec3 {
        self.position + self.linear() * canonical
    }

    /// Unit vector of the object's front in the room.
    pub fn front(&self) -> DVec3 {
        DVec3::new(self.yaw.sin(), 0.0, self.yaw.cos())
    }
}

/// Which wall an object's back touches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WallAffinity {
    /// Back wall.
    Back,
    /// Left wall.
    Left,
    /// Right wall.
    Right,
    /// The wall behind the camera.
    Front,
    /// None: it stands free.
    #[default]
    Centre,
}

impl WallAffinity {
    /// The wall, if any.
    pub fn wall(self) -> Option<Wall> {
        match self {
            Self::Back => Some(Wall::Back),
            Self::Left => Some(Wall::Left),
            Self::Right => Some(Wall::Right),
            Self::Front => Some(Wall::Front),
            Self::Centre => None,
        }
    }
}

impl From<Wall> for WallAffinity {
    fn from(wall: Wall) -> Self {
        match wall {
            Wall::Back => Self::Back,
            Wall::Left => Self::Left,
            Wall::Right => Self::Right,
            Wall::Front => Self::Front,
        }
    }
}

/// What carries an object.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "on", rename_all = "snake_case")]
pub enum Support {
    /// It stands on the floor.
    Floor,
    /// It hangs from the ceiling.
    Ceiling,
    /// It is fixed to a wall.
    Wall {
        /// Which.
        wall: Wall,
    },
    /// It rests on another object.
    Object {
        /// Which.
        id: ObjectId,
    },
    /// It stands on a block of the room that comes up from the floor: a ledge, a step, a half-high wall.
    Block {
        /// Index into the blocks of the room's shape.
        block: usize,
    },
    /// It stands on the floor of a niche: a window's recess, an alcove in the wall.
    Niche {
        /// Index into the niches of the room's shape.
        niche: usize,
    },
}

impl Support {
    /// The part of the room on which it stands, where that is not the floor.
    pub fn ledge(&self) -> Option<Ledge> {
        match self {
            Self::Block { block } => Some(Ledge::Block(*block)),
            Self::Niche { niche } => Some(Ledge::Niche(*niche)),
            Self::Floor | Self::Ceiling | Self::Wall { .. } | Self::Object { .. } => None,
        }
    }
}

/// Share of the room's height above which a thing under the ceiling belongs to it rather than hanging in the room.
const UNDER_THE_CEILING: f64 = 0.75;

/// What a view without some of the room's faces leaves out with them, of objects given by id, support and bottom, metres
/// above the floor: what is fixed to a wall that is left out, what keeps close to the ceiling (fans, flush lights, beams:
/// from above these would be seen from behind, and hide what is below), and what lies on such things.
pub fn gone_with<'a>(
    omit: &[Surface],
    height: f64,
    objects: impl IntoIterator<Item = (&'a ObjectId, &'a Support, f64)>,
) -> BTreeSet<&'a ObjectId> {
    let objects: Vec<_> = objects.into_iter().collect();
    let fixed = |support: &Support, bottom: f64| match support {
        Support::Floor | Support::Object { .. } | Support::Block { .. } | Support::Niche { .. } => false,
        Support::Ceiling => omit.contains(&Surface::Ceiling) && bottom > UNDER_THE_CEILING * height,
        Support::Wall { wall } => omit.contains(&wall.surface()),
    };
    let mut gone: BTreeSet<&ObjectId> =
        objects.iter().filter(|(_, support, bottom)| fixed(support, *bottom)).map(|(id, ..)| *id).collect();
    loop {
        let carried = |support: &Support| matches!(support, Support::Object { id } if gone.contains(id));
        let more: Vec<_> =
            objects.iter().filter(|(id, s, _)| carried(s) && !gone.contains(id)).map(|(id, ..)| *id).collect();
        if more.is_empty() {
            return gone;
        }
        gone.extend(more);
    }
}

/// Coarse way in which a decoration rests (paper App. C).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlacementType {
    /// Flat on the surface.
    #[default]
    OnSurface,
    /// Leaning against a backrest.
    AgainstBack,
    /// On the floor beside the furniture.
    OnFloor,
}

/// Left, centre or right on the surface, as the camera sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum SurfacePosition {
    Left,
    #[default]
    Center,
    Right,
}

/// Front, middle or back on the surface, as the camera sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum DepthPosition {
    Front,
    #[default]
    Middle,
    Back,
}

/// How a decoration lies on its host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Placement {
    /// Resting, leaning, or beside.
    pub placement_type: PlacementType,
    /// Across.
    pub surface_position: SurfacePosition,
    /// Along.
    pub depth_position: DepthPosition,
    /// Whether it has a front that must face the room.
    pub faces_room: bool,
}

/// Relations of an object, as reasoned by the VLM and checked (paper App. C, layout template).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Relations {
    /// The wall that the object's back touches.
    pub wall_affinity: WallAffinity,
    /// Rests on.
    pub on_top_of: Option<ObjectId>,
    /// Between the anchor and the camera.
    pub in_front_of: Option<ObjectId>,
    /// Behind.
    pub behind: Option<ObjectId>,
    /// Front turned to.
    pub facing_toward: Option<ObjectId>,
    /// Functional group, such as `dining`.
    pub group: Option<String>,
    /// Matched set of identical instances, such as `dining_chair`.
    pub matched_set: Option<String>,
    /// Row of things that are built together side by side, such as `kitchen_units`.
    #[serde(default)]
    pub joined_row: Option<String>,
}

/// How sure the evidence makes us, 0 to 1 each; `None` where there was no evidence of that kind.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Confidence {
    /// Overall.
    pub overall: f64,
    /// Detection score given by the detector; never invented.
    pub detection: Option<f64>,
    /// IoU of mask and rendered silhouette in the scene.
    pub silhouette_iou: Option<f64>,
    /// Depth residual in metres after refinement (smaller is better).
    pub depth_residual_m: Option<f64>,
}

/// An object placed in the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SceneObject {
    /// Id, also file and node name.
    pub id: ObjectId,
    /// Value in `segmentation.png` and colour table; 10 and up.
    pub index: u32,
    /// Level.
    pub level: Level,
    /// Category in the model's words, lower case.
    pub label: String,
    /// One sentence about its looks.
    pub description: String,
    /// Phrase it was detected by.
    pub source_phrase: String,
    /// Pose of the canonical mesh.
    pub pose: Pose,
    /// Size in the room before rotation, metres.
    pub size: Size,
    /// What carries it.
    pub support: Support,
    /// Relations.
    pub relations: Relations,
    /// Material.
    pub material: SurfaceMaterial,
    /// Mesh file in the run folder, relative.
    pub mesh: String,
    /// Mask file in the run folder, relative.
    pub mask: Option<String>,
    /// Where it was seen, pixels of the photo.
    pub seen_box: Option<PixelBox>,
    /// Who made the mesh, in words.
    pub mesh_source: String,
    /// Confidence from evidence.
    pub confidence: Confidence,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_fixed_to_faces_that_are_left_out_goes_with_them() {
        let id = |name: &str| ObjectId::new(name).unwrap();
        let wall = |wall| Support::Wall { wall };
        let on = |name: &str| Support::Object { id: id(name) };
        let objects = [
            (id("fan_01"), Support::Ceiling, 2.2),
            (id("pendant_01"), Support::Ceiling, 1.6),
            (id("shelf_01"), wall(Wall::Right), 1.5),
            (id("leaf_01"), on("plant_01"), 2.0),
            (id("plant_01"), on("shelf_01"), 1.6),
            (id("clock_01"), wall(Wall::Back), 1.8),
            (id("sofa_01"), Support::Floor, 0.0),
            (id("pillow_01"), on("sofa_01"), 0.4),
        ];
        let gone = |omit: &[Surface]| -> Vec<String> {
            let held = objects.iter().map(|(id, support, bottom)| (id, support, *bottom));
            gone_with(omit, 2.5, held).into_iter().map(ToString::to_string).collect()
        };
        assert_eq!(gone(&[Surface::Ceiling]), ["fan_01"]);
        assert_eq!(gone(&[Surface::Right, Surface::Front]), ["leaf_01", "plant_01", "shelf_01"]);
        assert!(gone(&[]).is_empty());
    }
}
