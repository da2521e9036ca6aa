//! `1_layout/layout`: the room and the camera (paper App. C, "Layout Generation").

use harmony_scene::{Extents, ImageSize};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::{Ask, fill, in_range};

/// Asks for the room and the camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LayoutQuestion {
    /// Size of the photo, pixels.
    #[serde(skip)]
    pub photo: ImageSize,
    /// What depth is known already.
    #[serde(skip)]
    pub depth: KnownDepth,
    /// The room box that the photo's lines give by themselves, where it is known.
    #[serde(flatten)]
    pub unaided: Option<UnaidedRoom>,
}

/// What depth is known when the layout is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KnownDepth {
    /// A depth sensor's, in metres.
    Metric,
    /// A point map up to one unknown scale.
    UpToScale,
    /// None.
    None,
}

impl KnownDepth {
    fn words(self) -> &'static str {
        match self {
            Self::Metric => {
                "A depth sensor measured the scene in metres; what you see fixes names, openings and textures."
            }
            Self::UpToScale => {
                "A point map up to one unknown scale is there; the ceiling height you give sets the scale, so estimate it with care."
            }
            Self::None => {
                "Nothing is measured: the pins and the ceiling height you give fix the camera, so place them with care."
            }
        }
    }
}

/// The room box that lines and vanishing points give without an answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct UnaidedRoom {
    /// Metres.
    pub extents: Extents,
    /// Above the floor, metres.
    pub camera_height_m: f64,
    /// Downward tilt, degrees.
    pub tilt_deg: f64,
    /// Turn to the left (positive) from facing the back wall squarely, degrees.
    pub yaw_deg: f64,
    /// From the camera to the back wall, metres.
    pub dist_to_back_m: f64,
    /// 0 to 1.
    pub confidence: f64,
}

/// The whole answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayoutAnswer {
    /// STEP 2: type and dimensions.
    pub room: LayoutRoom,
    /// STEP 1 and 2: visible walls.
    pub walls: Vec<LayoutWall>,
    /// STEP 3.
    pub camera: LayoutCamera,
    /// STEP 4.
    pub floor_texture: FloorTexture,
    /// STEP 4.
    pub wall_texture: WallTexture,
    /// STEP 4: what floor, ceiling and walls are made of, in figures (beyond the paper).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<LayoutSurface>,
    /// STEP 4: boards that go round the room (beyond the paper).
    #[serde(default, skip_serializing_if = "LayoutTrims::is_empty")]
    pub trims: LayoutTrims,
    /// Leave it out: nothing uses it. Older answers have it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub blocked_corners: Vec<String>,
    /// Positions of room edges in the photo (beyond the paper): they pin the camera.
    #[serde(default)]
    pub pins: Vec<LayoutPin>,
    /// STEP 6: where the room is not a box (beyond the paper).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub shape: Vec<LayoutFeature>,
    /// STEP 7: outlines of what is on the picture and not in the room, corner by corner (beyond the paper).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ignore: Vec<Vec<[f64; 2]>>,
}

/// Room type and dimensions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayoutRoom {
    /// `bedroom`, `living_room`, ...
    pub room_type: String,
    /// Metres.
    pub floor_width_m: f64,
    /// Metres.
    pub floor_depth_m: f64,
    /// Metres.
    pub ceiling_height_m: f64,
}

/// A visible wall.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayoutWall {
    /// left, back or right.
    pub orientation: harmony_scene::Wall,
    /// Metres.
    pub length_m: f64,
    /// Metres.
    pub height_m: f64,
    /// What it is made of, in words.
    pub surface: String,
    /// Doors, windows and passages in it.
    #[serde(default)]
    pub openings: Vec<LayoutOpening>,
}

/// What an opening is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum LayoutOpeningKind {
    Window,
    Door,
    /// Open, without a leaf, into another room (beyond the paper).
    Passage,
}

/// A door, window or passage in a wall.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayoutOpening {
    /// window, door or passage.
    pub kind: LayoutOpeningKind,
    /// Metres.
    pub width_m: f64,
    /// Metres.
    pub height_m: f64,
    /// From the wall's left end, metres.
    pub offset_m: f64,
    /// Outline of a passage or a window in the photo, 0..1000, in order; empty for doors (beyond the paper).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub face: Vec<[f64; 2]>,
    /// How much higher the middle of a rounded top is than its ends, metres; null when straight (beyond the paper).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arch_m: Option<f64>,
}

/// On which side of the deepest corner the back wall lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum BackWallSide {
    Left,
    Right,
    /// The camera faces the back wall squarely.
    Both,
}

/// Camera placement. The paper's `facing`, `aim_target_*` and `visible_floor_depth_m` are not asked for: nothing uses them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LayoutCamera {
    /// Above the floor, metres.
    pub height_m: f64,
    /// Downward tilt, degrees.
    pub tilt_deg: f64,
    /// Row of the floor / back wall junction as a fraction of the image height, 0 = top.
    pub floor_junction_y_frac: f64,
    /// Turn to the left (positive) or right from facing the back wall squarely, degrees.
    pub yaw_deg: f64,
    /// Metres.
    pub dist_to_back_m: f64,
    /// The deepest visible floor corner, 0..1000; null when none is visible.
    pub corner_px: Option<[f64; 2]>,
    /// Side of the corner on which the back wall lies.
    pub back_wall_side: BackWallSide,
    /// Metres.
    pub visible_wall_height_m: f64,
}

/// Floor material; the paper's `synthesis_prompt` is not asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[expect(missing_docs, reason = "the paper's fields")]
pub struct FloorTexture {
    pub material: String,
    pub color: String,
    pub pattern: String,
    pub tile_size_m: f64,
}

/// Wall material; the paper's `synthesis_prompt` is not asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[expect(missing_docs, reason = "the paper's fields")]
pub struct WallTexture {
    pub material: String,
    pub color: String,
    pub finish: String,
    pub tile_size_m: f64,
}

/// What makes a room other than a box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LayoutFeatureKind {
    /// Solid, standing out of a wall: the corner that an L-shaped room lacks, a chimney breast, a pier, a low wall.
    Block,
    /// Free, behind a wall's face: a niche, the recess that a window lies in, the arm of an L.
    Niche,
    /// A ceiling that comes down towards a wall.
    Slope,
    /// A recess in the ceiling, away from the walls.
    Tray,
    /// An arched ceiling that springs from a wall and from the one across.
    Vault,
}

/// Where a feature's face goes on to, seen or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum LayoutReach {
    Floor,
    Ceiling,
    /// The wall at its left end, as one faces it from inside: of a right wall the far one, of a left wall the near one.
    LeftEnd,
    /// The same at its right end: of a right wall the near one.
    RightEnd,
}

/// A place where the room is not a box.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayoutFeature {
    /// block, niche, slope, tray or vault.
    pub kind: LayoutFeatureKind,
    /// In a word or two: `chimney breast`, `window recess`, ...
    pub what: String,
    /// The wall that it stands out of, opens behind, or comes down to; a tray's is not asked for: `back`.
    pub wall: harmony_scene::Wall,
    /// Corners in the photo, 0..1000, in order: of a block's face that looks the same way as the wall, of a niche's
    /// opening, of the slope, of a tray's opening in the lower ceiling, of the vault's curved face.
    pub face: Vec<[f64; 2]>,
    /// Metres: how far a block stands out of its wall, a niche goes behind it, a slope reaches into the room, a tray goes
    /// up, a vault's crown is from its wall.
    pub depth_m: f64,
    /// Where the face goes on to.
    #[serde(default)]
    pub reaches: Vec<LayoutReach>,
    /// Height of a slope at its wall, of a vault where it springs, metres; null for others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub low_m: Option<f64>,
    /// Colour of the light hidden behind a tray's edge, `#rrggbb`; null where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub glow_hex: Option<String>,
}

/// Which room edge a pin lies on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PinKind {
    /// Floor meets back wall.
    FloorBack,
    /// Floor meets left wall.
    FloorLeft,
    /// Floor meets right wall.
    FloorRight,
    /// Ceiling meets back wall.
    CeilingBack,
    /// Ceiling meets left wall.
    CeilingLeft,
    /// Ceiling meets right wall.
    CeilingRight,
    /// Vertical edge of back and left wall.
    BackLeft,
    /// Vertical edge of back and right wall.
    BackRight,
}

/// A visible stretch of a room edge: two or more points on it, far apart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayoutPin {
    /// Which edge.
    pub edge: PinKind,
    /// Points on it, 0..1000; an end that is a room corner should be exact.
    pub points: Vec<[f64; 2]>,
}

mod surfaces;

pub use surfaces::{
    Finish, LayoutPart, LayoutPartKind, LayoutPattern, LayoutPatternKind, LayoutSurface, LayoutTrim, LayoutTrims,
    SurfaceName,
};

impl Ask for LayoutQuestion {
    type Answer = LayoutAnswer;

    fn prompt(&self) -> String {
        fill(
            include_str!("../templates/layout.md"),
            &[
                ("width", self.photo.width.to_string()),
                ("height", self.photo.height.to_string()),
                ("measured", self.depth.words().to_owned()),
            ],
        )
    }

    fn example(&self) -> LayoutAnswer {
        LayoutAnswer::example()
    }

    fn check(&self, answer: &LayoutAnswer) -> Result<(), String> {
        answer.check()
    }
}

impl LayoutAnswer {
    /// A well-formed answer about some other picture.
    pub fn example() -> Self {
        Self {
            room: LayoutRoom {
                room_type: "bedroom".into(),
                floor_width_m: 3.6,
                floor_depth_m: 4.2,
                ceiling_height_m: 2.6,
            },
            walls: vec![LayoutWall {
                orientation: harmony_scene::Wall::Back,
                length_m: 3.6,
                height_m: 2.6,
                surface: "painted plaster".into(),
                openings: vec![
                    LayoutOpening {
                        kind: LayoutOpeningKind::Window,
                        width_m: 1.2,
                        height_m: 1.3,
                        offset_m: 1.0,
                        face: vec![],
                        arch_m: None,
                    },
                    LayoutOpening {
                        kind: LayoutOpeningKind::Passage,
                        width_m: 1.0,
                        height_m: 2.1,
                        offset_m: 2.5,
                        face: vec![[790.0, 668.0], [792.0, 330.0], [850.0, 290.0], [908.0, 334.0], [910.0, 680.0]],
                        arch_m: Some(0.25),
                    },
                ],
            }],
            camera: LayoutCamera {
                height_m: 1.5,
                tilt_deg: 8.0,
                floor_junction_y_frac: 0.62,
                yaw_deg: -15.0,
                dist_to_back_m: 3.8,
                corner_px: Some([310.0, 640.0]),
                back_wall_side: BackWallSide::Right,
                visible_wall_height_m: 2.6,
            },
            floor_texture: FloorTexture {
                material: "oak planks".into(),
                color: "warm light brown".into(),
                pattern: "straight boards 12 cm wide".into(),
                tile_size_m: 1.2,
            },
            wall_texture: WallTexture {
                material: "plaster".into(),
                color: "off-white".into(),
                finish: "matt".into(),
                tile_size_m: 1.0,
            },
            surfaces: surfaces::example(),
            trims: LayoutTrims {
                skirting: Some(LayoutTrim { height_m: 0.08, depth_m: 0.015, color_hex: "#f2f0ea".into() }),
                cornice: None,
                casing: None,
            },
            blocked_corners: vec![],
            pins: vec![
                LayoutPin { edge: PinKind::FloorBack, points: vec![[310.0, 640.0], [980.0, 690.0]] },
                LayoutPin { edge: PinKind::BackLeft, points: vec![[310.0, 640.0], [306.0, 60.0]] },
            ],
            shape: vec![LayoutFeature {
                kind: LayoutFeatureKind::Block,
                what: "chimney breast".into(),
                wall: harmony_scene::Wall::Back,
                face: vec![[520.0, 70.0], [760.0, 62.0], [764.0, 672.0], [524.0, 660.0]],
                depth_m: 0.35,
                reaches: vec![LayoutReach::Floor, LayoutReach::Ceiling],
                low_m: None,
                glow_hex: None,
            }],
            ignore: vec![],
        }
    }

    /// Whether the numbers make sense.
    ///
    /// # Errors
    /// A complaint in words.
    pub fn check(&self) -> Result<(), String> {
        in_range("room.floor_width_m", self.room.floor_width_m, 0.8, 40.0)?;
        in_range("room.floor_depth_m", self.room.floor_depth_m, 0.8, 40.0)?;
        in_range("room.ceiling_height_m", self.room.ceiling_height_m, 1.8, 12.0)?;
        in_range("camera.height_m", self.camera.height_m, 0.1, 6.0)?;
        in_range("camera.tilt_deg", self.camera.tilt_deg, -80.0, 80.0)?;
        in_range("camera.yaw_deg", self.camera.yaw_deg, -90.0, 90.0)?;
        in_range("camera.dist_to_back_m", self.camera.dist_to_back_m, 0.2, 40.0)?;
        surfaces::check(&self.surfaces, &self.trims)?;
        for pin in &self.pins {
            if pin.points.len() < 2 {
                return Err(format!("pin {:?} has {} point(s); two or more are needed", pin.edge, pin.points.len()));
            }
            for p in &pin.points {
                in_range("a pin's x", p[0], -200.0, 1200.0)?;
                in_range("a pin's y", p[1], -200.0, 1200.0)?;
            }
        }
        for feature in &self.shape {
            feature.check()?;
        }
        for opening in self.walls.iter().flat_map(|w| &w.openings) {
            opening.check()?;
        }
        for outline in &self.ignore {
            if outline.len() < 3 {
                return Err(format!(
                    "an outline of `ignore` has {} corner(s); three or more are needed",
                    outline.len()
                ));
            }
            for p in outline {
                in_range("an ignored corner's x", p[0], -500.0, 1500.0)?;
                in_range("an ignored corner's y", p[1], -500.0, 1500.0)?;
            }
        }
        if let Some(p) = self.camera.corner_px {
            in_range("camera.corner_px x", p[0], -200.0, 1200.0)?;
            in_range("camera.corner_px y", p[1], -200.0, 1200.0)?;
        }
        Ok(())
    }
}

impl LayoutOpening {
    fn check(&self) -> Result<(), String> {
        if self.kind == LayoutOpeningKind::Passage && self.face.len() < 3 {
            let given = self.face.len();
            return Err(format!("the outline of a passage has {given} corner(s); three or more are needed"));
        }
        for p in &self.face {
            in_range("an opening corner's x", p[0], -2000.0, 3000.0)?;
            in_range("an opening corner's y", p[1], -2000.0, 3000.0)?;
        }
        self.arch_m.map_or(Ok(()), |arch| in_range("an opening's arch_m", arch, 0.0, 3.0))
    }
}

impl LayoutFeature {
    /// Colour of the light hidden behind its edge, sRGB bytes.
    pub fn glow(&self) -> Option<[u8; 3]> {
        self.glow_hex.as_deref().and_then(surfaces::rgb)
    }

    fn check(&self) -> Result<(), String> {
        if self.face.len() < 3 {
            return Err(format!(
                "the face of the {} has {} corner(s); three or more are needed",
                self.what,
                self.face.len()
            ));
        }
        for p in &self.face {
            in_range("a face corner's x", p[0], -2000.0, 3000.0)?;
            in_range("a face corner's y", p[1], -2000.0, 3000.0)?;
        }
        let most = if self.kind == LayoutFeatureKind::Tray { 1.5 } else { 20.0 };
        in_range("a shape's depth_m", self.depth_m, 0.02, most)?;
        if self.glow_hex.is_some() && self.glow().is_none() {
            return Err(format!("the glow_hex of the {} is not a colour; expected #rrggbb", self.what));
        }
        match (self.kind, self.low_m) {
            (LayoutFeatureKind::Slope | LayoutFeatureKind::Vault, Some(low)) => {
                in_range(&format!("low_m of the {}", self.what), low, 0.0, 8.0)
            }
            (LayoutFeatureKind::Slope | LayoutFeatureKind::Vault, None) => {
                Err(format!("the {} needs low_m, its height at its wall", self.what))
            }
            _ => Ok(()),
        }
    }
}
