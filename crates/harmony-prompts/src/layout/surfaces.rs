//! What the room's own surfaces are made of, in figures.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::question::in_range;

/// A face of the room.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum SurfaceName {
    Floor,
    Ceiling,
    WallBack,
    WallLeft,
    WallRight,
    WallFront,
}

impl SurfaceName {
    /// The face of the room box.
    pub fn surface(self) -> harmony_scene::Surface {
        use harmony_scene::Surface;
        match self {
            Self::Floor => Surface::Floor,
            Self::Ceiling => Surface::Ceiling,
            Self::WallBack => Surface::Back,
            Self::WallLeft => Surface::Left,
            Self::WallRight => Surface::Right,
            Self::WallFront => Surface::Front,
        }
    }
}

/// The material of a face.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayoutSurface {
    /// Which face.
    pub surface: SurfaceName,
    /// Paint, or mean colour, in even white light: `#rrggbb`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color_hex: Option<String>,
    /// How it shines; null: as such a material usually does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub finish: Option<Finish>,
    /// What repeats on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pattern: Option<LayoutPattern>,
    /// Stretches of a wall that differ from the rest.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<LayoutPart>,
}

/// How a surface shines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Finish {
    /// No reflection: wall paint, carpet, raw concrete, brick.
    Matt,
    /// Blurred reflections of windows and lamps: oiled or varnished wood, vinyl, honed stone.
    Satin,
    /// Clear reflections: polished stone or tiles, lacquered boards.
    Polished,
}

/// Kinds of repeating patterns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum LayoutPatternKind {
    Planks,
    Parquet,
    Herringbone,
    Tiles,
    Checks,
    Brick,
    Stripes,
    Panels,
    Dots,
    Motif,
    Carpet,
    Concrete,
    Marble,
    Terrazzo,
}

/// A repeating pattern.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayoutPattern {
    /// Which kind.
    pub kind: LayoutPatternKind,
    /// Of one piece, metres.
    pub width_m: f64,
    /// Of one piece, metres; 0: as the width.
    #[serde(default)]
    pub length_m: f64,
    /// Joint between pieces, metres.
    #[serde(default)]
    pub joint_m: f64,
    /// Counter-clockwise; 0: the length runs along x on the floor, level on walls.
    #[serde(default)]
    pub turn_deg: f64,
    /// `#rrggbb`, the main one first, joints last.
    #[serde(default)]
    pub colors: Vec<String>,
}

/// Kinds of wall parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LayoutPartKind {
    /// Another paint or paper on this wall only.
    Accent,
    /// Behind a worktop.
    Splashback,
    /// Boards or panels.
    Panelling,
    /// The lower part of a wall; walls that are not listed have it too.
    Wainscot,
}

/// A level stretch of a wall in another material.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayoutPart {
    /// Which kind.
    pub kind: LayoutPartKind,
    /// Height of its lower edge, metres.
    pub from_m: f64,
    /// Height of its upper edge, metres.
    pub to_m: f64,
    /// `#rrggbb`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color_hex: Option<String>,
    /// What repeats on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pattern: Option<LayoutPattern>,
}

/// A board along the walls.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayoutTrim {
    /// Height of a skirting or cornice, width of a casing, metres.
    pub height_m: f64,
    /// How far it stands out, metres.
    #[serde(default = "usual_depth")]
    pub depth_m: f64,
    /// `#rrggbb`.
    pub color_hex: String,
}

fn usual_depth() -> f64 {
    0.015
}

/// Boards that go round the room.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayoutTrims {
    /// Where floor and walls meet.
    #[serde(default)]
    pub skirting: Option<LayoutTrim>,
    /// Where ceiling and walls meet.
    #[serde(default)]
    pub cornice: Option<LayoutTrim>,
    /// Around doors.
    #[serde(default)]
    pub casing: Option<LayoutTrim>,
}

impl LayoutTrims {
    /// Whether none was named.
    pub fn is_empty(&self) -> bool {
        self.skirting.is_none() && self.cornice.is_none() && self.casing.is_none()
    }
}

/// Surfaces of some other picture.
pub(super) fn example() -> Vec<LayoutSurface> {
    vec![
        LayoutSurface {
            surface: SurfaceName::Floor,
            color_hex: Some("#a9825b".into()),
            finish: Some(Finish::Satin),
            pattern: Some(LayoutPattern {
                kind: LayoutPatternKind::Planks,
                width_m: 0.12,
                length_m: 1.2,
                joint_m: 0.002,
                turn_deg: 90.0,
                colors: vec!["#a9825b".into(), "#b58e66".into(), "#5d4630".into()],
            }),
            parts: vec![],
        },
        LayoutSurface {
            surface: SurfaceName::WallBack,
            color_hex: Some("#eceae4".into()),
            finish: None,
            pattern: None,
            parts: vec![LayoutPart {
                kind: LayoutPartKind::Wainscot,
                from_m: 0.0,
                to_m: 0.9,
                color_hex: Some("#8fa394".into()),
                pattern: None,
            }],
        },
    ]
}

/// Whether colours are colours and sizes possible.
pub(super) fn check(surfaces: &[LayoutSurface], trims: &LayoutTrims) -> Result<(), String> {
    for surface in surfaces {
        let name = format!("surfaces ({:?})", surface.surface);
        color(&name, surface.color_hex.as_deref())?;
        pattern(&name, surface.pattern.as_ref())?;
        for part in &surface.parts {
            in_range(&format!("{name}: a part's from_m"), part.from_m, -0.01, 12.0)?;
            in_range(&format!("{name}: a part's to_m"), part.to_m, part.from_m, 12.0)?;
            color(&name, part.color_hex.as_deref())?;
            pattern(&name, part.pattern.as_ref())?;
        }
    }
    for (name, trim) in [("skirting", &trims.skirting), ("cornice", &trims.cornice), ("casing", &trims.casing)] {
        if let Some(trim) = trim {
            in_range(&format!("trims.{name}.height_m"), trim.height_m, 0.01, 0.6)?;
            in_range(&format!("trims.{name}.depth_m"), trim.depth_m, 0.0, 0.3)?;
            color(&format!("trims.{name}"), Some(&trim.color_hex))?;
        }
    }
    Ok(())
}

fn pattern(name: &str, pattern: Option<&LayoutPattern>) -> Result<(), String> {
    let Some(p) = pattern else { return Ok(()) };
    in_range(&format!("{name}: pattern.width_m"), p.width_m, 0.002, 5.0)?;
    in_range(&format!("{name}: pattern.length_m"), p.length_m, 0.0, 20.0)?;
    in_range(&format!("{name}: pattern.joint_m"), p.joint_m, 0.0, 0.2)?;
    in_range(&format!("{name}: pattern.turn_deg"), p.turn_deg, -360.0, 360.0)?;
    p.colors.iter().try_for_each(|c| color(name, Some(c)))
}

fn color(name: &str, hex: Option<&str>) -> Result<(), String> {
    match hex {
        Some(hex) if rgb(hex).is_none() => Err(format!("{name}: {hex:?} is not a colour; expected #rrggbb")),
        _ => Ok(()),
    }
}

/// sRGB bytes of `#rrggbb`.
pub(super) fn rgb(hex: &str) -> Option<[u8; 3]> {
    let digits = hex.strip_prefix('#').filter(|d| d.len() == 6 && d.bytes().all(|b| b.is_ascii_hexdigit()))?;
    let value = u32::from_str_radix(digits, 16).ok()?;
    Some([(value >> 16) as u8, (value >> 8) as u8, value as u8])
}

impl Finish {
    /// Perceptual roughness.
    pub fn roughness(self) -> f32 {
        match self {
            Self::Matt => 0.7,
            Self::Satin => 0.38,
            Self::Polished => 0.15,
        }
    }
}

impl LayoutPatternKind {
    /// How such a material usually shines on a floor, or a wall.
    pub fn usual_finish(self) -> Finish {
        match self {
            Self::Planks | Self::Parquet | Self::Herringbone | Self::Tiles | Self::Checks | Self::Terrazzo => {
                Finish::Satin
            }
            Self::Marble => Finish::Polished,
            Self::Brick | Self::Stripes | Self::Panels | Self::Dots | Self::Motif | Self::Carpet | Self::Concrete => {
                Finish::Matt
            }
        }
    }
}

impl LayoutSurface {
    /// How it shines, said or usual; `None` where nothing tells.
    pub fn shine(&self) -> Option<Finish> {
        self.finish.or_else(|| Some(self.pattern.as_ref()?.kind.usual_finish()))
    }

    /// Its colour as sRGB bytes.
    pub fn rgb(&self) -> Option<[u8; 3]> {
        self.color_hex.as_deref().and_then(rgb)
    }
}

impl LayoutPart {
    /// Its colour as sRGB bytes.
    pub fn rgb(&self) -> Option<[u8; 3]> {
        self.color_hex.as_deref().and_then(rgb)
    }
}

impl LayoutTrim {
    /// Its colour as sRGB bytes; white when it is none.
    pub fn rgb(&self) -> [u8; 3] {
        rgb(&self.color_hex).unwrap_or([255; 3])
    }
}

#[cfg(test)]
mod tests {
    use super::super::LayoutAnswer;
    use super::*;

    #[test]
    fn answers_from_before_still_parse_and_the_new_ones_are_checked() {
        let mut old = serde_json::to_value(LayoutAnswer::example()).unwrap();
        let fields = old.as_object_mut().unwrap();
        assert!(fields.remove("surfaces").is_some() && fields.remove("trims").is_some());
        let answer: LayoutAnswer = serde_json::from_value(old).unwrap();
        assert!(answer.surfaces.is_empty() && answer.trims.is_empty());
        answer.check().unwrap();
        // What was asked once and is not any more.
        let mut long = serde_json::to_value(LayoutAnswer::example()).unwrap();
        long["blocked_corners"] = serde_json::json!(["back left"]);
        long["camera"]["facing"] = serde_json::json!("back wall");
        long["floor_texture"]["synthesis_prompt"] = serde_json::json!("oak");
        let question = crate::Question::from(crate::LayoutQuestion {
            photo: harmony_scene::ImageSize::new(640, 480),
            depth: crate::KnownDepth::None,
            unaided: None,
        });
        question.check(&long).unwrap();
        let parts = &question.schema()["$defs"];
        for part in ["LayoutCamera", "FloorTexture", "WallTexture"] {
            assert!(parts[part].is_object() && parts[part]["additionalProperties"].is_null(), "{part} refuses them");
        }

        let mut new = LayoutAnswer::example();
        new.check().unwrap();
        assert_eq!(new.surfaces[0].rgb(), Some([0xa9, 0x82, 0x5b]));
        new.surfaces[1].parts[0].color_hex = Some("green".into());
        assert!(new.check().unwrap_err().contains("green"));
        new.surfaces[1].parts[0].color_hex = None;
        new.surfaces[0].pattern.as_mut().unwrap().width_m = f64::NAN;
        assert!(new.check().is_err());
        let trim: LayoutTrim = serde_json::from_str(r##"{"height_m": 0.1, "color_hex": "#ffffff"}"##).unwrap();
        assert!((trim.depth_m - 0.015).abs() < 1e-12);
    }

    #[test]
    fn what_is_said_of_the_shine_goes_before_what_is_usual() {
        let [mut floor, wall] = <[LayoutSurface; 2]>::try_from(example()).unwrap();
        assert_eq!(wall.shine(), None);
        floor.finish = None;
        assert_eq!(floor.shine(), Some(Finish::Satin), "planks");
        floor.finish = Some(Finish::Polished);
        assert_eq!(floor.shine(), Some(Finish::Polished));
        assert!(Finish::Polished.roughness() < Finish::Satin.roughness());
    }
}
