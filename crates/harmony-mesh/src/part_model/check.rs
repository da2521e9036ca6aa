//! Reading and checking part models that somebody else wrote.

use super::{MAX_DEPTH, MAX_PARTS, MAX_POINTS, MAX_SLOTS, Part, PartModel, Repeats, Shape, hex_color};

/// Coordinates may leave the unit box by this much.
const FARTHEST: f64 = 10.0;

/// What is wrong with a part model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PartModelError {
    /// The JSON does not fit.
    #[error("{path}: {problem}")]
    Json {
        /// Where, such as `parts[3].round`.
        path: String,
        /// What is wrong and what is allowed.
        problem: String,
    },
    /// A value cannot be used.
    #[error("{path}: {problem}")]
    Value {
        /// Where, such as `parts[3].round`.
        path: String,
        /// What is wrong and what is allowed.
        problem: String,
    },
    /// Too many parts once expanded.
    #[error("{count} parts after repeats and mirrors; at most {limit} are allowed")]
    TooManyParts {
        /// Counted so far.
        count: usize,
        /// Allowed.
        limit: usize,
    },
    /// The size is not usable.
    #[error("size {width} x {height} x {depth} m; each must lie between {min} and {max}")]
    Size {
        /// Given.
        width: f64,
        /// Given.
        height: f64,
        /// Given.
        depth: f64,
        /// Smallest side, metres.
        min: f64,
        /// Largest side, metres.
        max: f64,
    },
}

pub(super) fn from_json(text: &str) -> Result<PartModel, PartModelError> {
    let text = unfenced(text);
    let reader = &mut serde_json::Deserializer::from_str(text);
    finish(serde_path_to_error::deserialize(reader).map_err(|e| told(&e)))
}

pub(super) fn from_value(value: &serde_json::Value) -> Result<PartModel, PartModelError> {
    finish(serde_path_to_error::deserialize(value).map_err(|e| told(&e)))
}

/// The text inside a Markdown code fence, if there is one.
fn unfenced(text: &str) -> &str {
    let text = text.trim();
    let Some(body) = text.strip_prefix("```") else { return text };
    let body = body.strip_prefix("json").unwrap_or(body);
    body.strip_suffix("```").unwrap_or(body).trim()
}

fn told(error: &serde_path_to_error::Error<serde_json::Error>) -> PartModelError {
    let path = error.path().to_string();
    let path = if path == "." { "part model".to_owned() } else { path };
    PartModelError::Json { path, problem: error.inner().to_string() }
}

fn finish(model: Result<PartModel, PartModelError>) -> Result<PartModel, PartModelError> {
    let mut model = model?;
    for slot in &mut model.slots {
        if let Some(rgb) = parse_color(&slot.color) {
            slot.color = hex_color(rgb);
        }
    }
    check(&model)?;
    Ok(model)
}

fn wrong<T>(path: impl Into<String>, problem: impl Into<String>) -> Result<T, PartModelError> {
    Err(PartModelError::Value { path: path.into(), problem: problem.into() })
}

pub(super) fn check(model: &PartModel) -> Result<(), PartModelError> {
    if model.slots.len() > MAX_SLOTS {
        return wrong("slots", format!("{} slots; at most {MAX_SLOTS} are allowed", model.slots.len()));
    }
    for (i, slot) in model.slots.iter().enumerate() {
        if slot.name.is_empty() || slot.name.len() > 64 {
            return wrong(format!("slots[{i}].name"), "must have 1 to 64 characters");
        }
        if model.slots[..i].iter().any(|s| s.name == slot.name) {
            return wrong(format!("slots[{i}].name"), format!("{:?} is there twice", slot.name));
        }
        if parse_color(&slot.color).is_none() {
            let shown: String = slot.color.chars().take(30).collect();
            return wrong(format!("slots[{i}].color"), format!("{shown:?} is not a colour; write #rrggbb"));
        }
    }
    if model.parts.is_empty() {
        return wrong("parts", "is empty; at least one part is needed");
    }
    let mut solids = 0;
    for (i, part) in model.parts.iter().enumerate() {
        check_part(model, part, &format!("parts[{i}]"), 1, None, &mut solids)?;
    }
    if solids == 0 {
        return wrong("parts", "only groups without parts; at least one shape is needed");
    }
    Ok(())
}

fn check_part(
    model: &PartModel,
    part: &Part,
    path: &str,
    depth: usize,
    inherited: Option<&str>,
    solids: &mut usize,
) -> Result<(), PartModelError> {
    let slot = part.slot.as_deref().or(inherited);
    if let Some(name) = slot.filter(|name| model.slot(name).is_none()) {
        let known: Vec<&str> = model.slots.iter().map(|s| s.name.as_str()).collect();
        let shown: String = name.chars().take(40).collect();
        return wrong(format!("{path}.slot"), format!("no slot {shown:?}; there are: {}", known.join(", ")));
    }
    let numbers = [
        ("from", part.from.to_vec(), FARTHEST),
        ("to", part.to.to_vec(), FARTHEST),
        ("turn_deg", part.turn_deg.unwrap_or_default().to_vec(), 360.0),
        ("round", part.round.into_iter().collect(), FARTHEST),
        ("corner", part.corner.into_iter().collect(), FARTHEST),
        ("top", part.top.into_iter().collect(), FARTHEST),
        ("hollow", part.hollow.into_iter().collect(), FARTHEST),
        ("puff", part.puff.into_iter().collect(), FARTHEST),
        ("bend_deg", part.bend_deg.into_iter().collect(), 360.0),
        ("thickness", part.thickness.into_iter().collect(), FARTHEST),
        ("leaf_size", part.leaf_size.into_iter().collect(), FARTHEST),
        ("points", part.points.iter().flatten().flatten().copied().collect(), FARTHEST),
        ("path", part.path.iter().flatten().flatten().copied().collect(), FARTHEST),
    ];
    for (field, values, limit) in numbers {
        if let Some(v) = values.iter().find(|v| v.is_nan() || v.abs() > limit) {
            return wrong(format!("{path}.{field}"), format!("{v} is out of range; at most {limit} either way"));
        }
    }
    for k in 0..3 {
        if (part.from[k] - part.to[k]).abs() < 1e-9 && part.shape != Shape::Tube {
            let axis = ["x", "y", "z"][k];
            return wrong(
                format!("{path}.to"),
                format!("the box has no extent along {axis}; to must differ from from"),
            );
        }
    }
    let rows = match &part.repeat {
        None => &[][..],
        Some(Repeats::Row(row)) => std::slice::from_ref(row),
        Some(Repeats::Grid(rows)) => rows.as_slice(),
    };
    if rows.len() > 3 {
        return wrong(format!("{path}.repeat"), format!("{} rows; at most 3 are allowed", rows.len()));
    }
    for row in rows {
        if row.count == 0 || row.count > 100 {
            return wrong(format!("{path}.repeat.count"), format!("{} is out of range; 1 to 100", row.count));
        }
        if row.step.is_some_and(|s| s.is_nan() || s.abs() > FARTHEST) {
            return wrong(format!("{path}.repeat.step"), "is out of range");
        }
    }
    for (field, len) in [("points", part.points.as_ref().map(Vec::len)), ("path", part.path.as_ref().map(Vec::len))] {
        if len.is_some_and(|n| n > MAX_POINTS) {
            return wrong(format!("{path}.{field}"), format!("more than {MAX_POINTS} points"));
        }
    }
    match part.shape {
        Shape::Extrude => match &part.points {
            Some(points) if points.len() >= 3 => {
                let outline: Vec<glam::DVec2> = points
                    .iter()
                    .map(|p| glam::DVec2::from_array(*p).clamp(glam::DVec2::ZERO, glam::DVec2::ONE))
                    .collect();
                if !super::shapes::is_simple_outline(outline) {
                    return wrong(format!("{path}.points"), "the polygon crosses or touches itself, or has no area");
                }
            }
            _ => return wrong(format!("{path}.points"), "an extrude needs at least 3 points [u, v] between 0 and 1"),
        },
        Shape::Lathe if part.points.as_ref().is_none_or(|p| p.len() < 2) => {
            return wrong(format!("{path}.points"), "a lathe needs at least 2 points [radius, height] between 0 and 1");
        }
        Shape::Tube if part.path.as_ref().is_none_or(|p| p.len() < 2) => {
            return wrong(format!("{path}.path"), "a tube needs at least 2 points [x, y, z] between 0 and 1");
        }
        Shape::Group => {
            if depth >= MAX_DEPTH {
                return wrong(path, format!("groups are nested deeper than {MAX_DEPTH}"));
            }
            let children = part.parts.as_deref().unwrap_or(&[]);
            for (i, child) in children.iter().enumerate() {
                check_part(model, child, &format!("{path}.parts[{i}]"), depth + 1, slot, solids)?;
            }
            return Ok(());
        }
        _ => {}
    }
    *solids += 1;
    if *solids > MAX_PARTS {
        return Err(PartModelError::TooManyParts { count: *solids, limit: MAX_PARTS });
    }
    Ok(())
}

/// Colour words that are understood besides hex codes.
const WORDS: &[(&str, [u8; 3])] = &[
    ("black", [25, 25, 25]),
    ("white", [240, 240, 238]),
    ("grey", [128, 128, 128]),
    ("gray", [128, 128, 128]),
    ("silver", [190, 190, 192]),
    ("red", [170, 40, 35]),
    ("green", [60, 110, 60]),
    ("blue", [50, 80, 140]),
    ("yellow", [220, 190, 60]),
    ("orange", [210, 120, 40]),
    ("pink", [220, 160, 165]),
    ("purple", [110, 70, 130]),
    ("brown", [110, 75, 50]),
    ("beige", [215, 200, 175]),
    ("cream", [238, 230, 210]),
    ("tan", [195, 165, 125]),
    ("gold", [190, 155, 80]),
];

pub(super) fn parse_color(text: &str) -> Option<[u8; 3]> {
    let text = text.trim().to_lowercase();
    if let Some((_, rgb)) = WORDS.iter().find(|(word, _)| *word == text) {
        return Some(*rgb);
    }
    let hex = text.strip_prefix('#').or(text.strip_prefix("0x")).unwrap_or(&text);
    if !hex.chars().all(|c| c.is_ascii_hexdigit()) {
        return None;
    }
    let value = u32::from_str_radix(hex, 16).ok()?;
    match hex.len() {
        6 => Some([(value >> 16) as u8, (value >> 8) as u8, value as u8]),
        8 => Some([(value >> 24) as u8, (value >> 16) as u8, (value >> 8) as u8]), // with alpha
        3 => Some([(value >> 8) as u8, (value >> 4) as u8, value as u8].map(|c| (c & 15) * 17)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_say_where_and_what_is_allowed() {
        let cases = [
            (r#"{"parts":[{"shape":"blob"}]}"#, "parts[0].shape", "box"),
            (r#"{"parts":[{"shape":"box","rund":1}]}"#, "parts[0]", "round"),
            (r#"{"parts":[]}"#, "parts", "at least one"),
            (r#"{"parts":[{"shape":"box","slot":"x"}]}"#, "parts[0].slot", "no slot"),
            (r#"{"parts":[{"shape":"box","from":[0,0,0],"to":[1,0,1]}]}"#, "parts[0].to", "along y"),
            (r#"{"parts":[{"shape":"box","from":[0,0,0],"to":[1,1e9,1]}]}"#, "parts[0].to", "out of range"),
            (r#"{"parts":[{"shape":"group","parts":[{"shape":"tube"}]}]}"#, "parts[0].parts[0].path", "at least 2"),
            (r#"{"slots":[{"name":"a","color":"sky"}],"parts":[{"shape":"box"}]}"#, "slots[0].color", "#rrggbb"),
            (r#"{"parts":[{"shape":"extrude","points":[[0,0],[1,1],[1,0],[0,1]]}]}"#, "parts[0].points", "crosses"),
        ];
        for (json, path, hint) in cases {
            let text = PartModel::from_json(json).unwrap_err().to_string();
            assert!(text.contains(path) && text.contains(hint), "{json}: {text}");
        }
    }

    #[test]
    fn obvious_variants_are_understood() {
        let text = "```json\n{\"slots\":[{\"name\":\"a\",\"colour\":\"ABC\"}],\"parts\":[{\"type\":\"rounded_box\",\
                    \"slot\":\"a\",\"min\":[1,1,1],\"max\":[0,0,0]}]}\n```";
        let model = PartModel::from_json(text).unwrap();
        assert_eq!(model.slots[0].color, "#aabbcc");
        model.build(harmony_scene::Size { width: 1.0, height: 1.0, depth: 1.0 }).unwrap();
        assert_eq!(parse_color("Beige"), Some([215, 200, 175]));
        assert_eq!(parse_color("#12g456"), None);
        assert_eq!(parse_color("+12345"), None);
    }

    #[test]
    fn too_many_copies_are_refused_without_making_them() {
        let json = r#"{"parts":[{"shape":"box","repeat":[{"axis":"x","count":100},{"axis":"y","count":100},
                      {"axis":"z","count":100}]}]}"#;
        let model = PartModel::from_json(json).unwrap();
        let size = harmony_scene::Size { width: 1.0, height: 1.0, depth: 1.0 };
        assert!(matches!(model.build(size), Err(PartModelError::TooManyParts { .. })));
        let nan = harmony_scene::Size { width: f64::NAN, height: 1.0, depth: 1.0 };
        assert!(matches!(PartModel::example().build(nan), Err(PartModelError::Size { .. })));
    }
}
