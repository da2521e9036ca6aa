//! PLY files: meshes, coloured points, and Gaussian splats by their points.
//!
//! Text and both binary forms, with what other programs write: any scalar types, faces as a list. Counts are believed
//! only as far as the file's bytes can hold them.

use glam::Vec3;
use harmony_mesh::{Group, Material, Mesh};

/// Most vertices and faces.
const MAX_COUNT: usize = 8_000_000;
/// Most corners of a face.
const MAX_CORNERS: usize = 64;

/// Not a PLY file that can be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("not a readable PLY file: {reason}")]
pub struct PlyError {
    /// What is wrong.
    pub reason: String,
}

fn bad(reason: impl Into<String>) -> PlyError {
    PlyError { reason: reason.into() }
}

/// What a PLY file holds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlyFile {
    /// Positions.
    pub positions: Vec<Vec3>,
    /// sRGB colours from 0 to 1, one a position or none at all.
    pub colors: Vec<[f32; 3]>,
    /// Triangles; none in a point cloud.
    pub triangles: Vec<[u32; 3]>,
    /// Opacity from 0 to 1 and mean radius of each splat; none where the file has no splats.
    pub splats: Vec<[f32; 2]>,
}

#[derive(Clone, Copy, PartialEq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

enum Property {
    One(String, Scalar),
    List(String, Scalar, Scalar),
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

#[derive(Clone, Copy, PartialEq)]
enum Form {
    Text,
    Little,
    Big,
}

/// The numbers after the header, one after the other.
struct Body<'a> {
    bytes: &'a [u8],
    form: Form,
}

impl Body<'_> {
    fn take(&mut self, scalar: Scalar) -> Result<f64, PlyError> {
        if self.form == Form::Text {
            let begin = self.bytes.iter().position(|b| !b.is_ascii_whitespace()).ok_or_else(|| bad("it ends early"))?;
            let rest = &self.bytes[begin..];
            let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
            self.bytes = &rest[end..];
            let word = std::str::from_utf8(&rest[..end]).map_err(|_| bad("a number is none"))?;
            return word
                .parse()
                .map_err(|_| bad(format!("{:?} is no number", word.chars().take(20).collect::<String>())));
        }
        let n = scalar.size();
        let (head, rest) = self.bytes.split_at_checked(n).ok_or_else(|| bad("it ends early"))?;
        self.bytes = rest;
        let mut raw = [0_u8; 8];
        raw[..n].copy_from_slice(head);
        if self.form == Form::Big {
            raw[..n].reverse();
        }
        let low = u64::from_le_bytes(raw);
        Ok(match scalar {
            Scalar::I8 => f64::from(low as i8),
            Scalar::U8 => f64::from(low as u8),
            Scalar::I16 => f64::from(low as i16),
            Scalar::U16 => f64::from(low as u16),
            Scalar::I32 => f64::from(low as i32),
            Scalar::U32 => f64::from(low as u32),
            Scalar::F32 => f64::from(f32::from_bits(low as u32)),
            Scalar::F64 => f64::from_bits(low),
        })
    }
}

/// Reads a PLY file.
///
/// # Errors
/// [`PlyError`].
pub fn parse_ply(bytes: &[u8]) -> Result<PlyFile, PlyError> {
    let (form, elements, body) = header(bytes)?;
    let mut body = Body { bytes: body, form };
    let mut out = PlyFile::default();
    for element in &elements {
        match element.name.as_str() {
            "vertex" => vertices(element, &mut body, &mut out)?,
            "face" => faces(element, &mut body, &mut out)?,
            // What comes after the faces is not needed.
            _ if !out.positions.is_empty() && !elements.iter().any(|e| e.name == "face") => break,
            _ => skip(element, &mut body)?,
        }
    }
    if out.positions.is_empty() {
        return Err(bad("it has no vertices"));
    }
    if let Some(i) = out.triangles.iter().flatten().find(|i| **i as usize >= out.positions.len()) {
        return Err(bad(format!("a face refers to vertex {i}, but there are {}", out.positions.len())));
    }
    Ok(out)
}

fn header(bytes: &[u8]) -> Result<(Form, Vec<Element>, &[u8]), PlyError> {
    const MAX_HEADER: usize = 1 << 16;
    if !bytes.starts_with(b"ply") {
        return Err(bad("it does not begin with \"ply\""));
    }
    let mut form = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut at = 0;
    loop {
        let length = bytes[at..]
            .iter()
            .take(MAX_HEADER)
            .position(|b| *b == b'\n')
            .ok_or_else(|| bad("its header has no end"))?;
        let line = std::str::from_utf8(&bytes[at..at + length]).map_err(|_| bad("its header is no text"))?.trim();
        at += length + 1;
        if at > MAX_HEADER {
            return Err(bad("its header has no end"));
        }
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["end_header"] => break,
            ["format", name, _] => {
                form = Some(match name {
                    "ascii" => Form::Text,
                    "binary_little_endian" => Form::Little,
                    "binary_big_endian" => Form::Big,
                    _ => return Err(bad(format!("the form {name:?} is not known"))),
                });
            }
            ["element", name, count] => {
                let count: usize = count.parse().map_err(|_| bad(format!("{count:?} is no count")))?;
                // A text number takes at least two bytes, a binary one at least one.
                if count > MAX_COUNT || count > bytes.len() {
                    return Err(bad(format!(
                        "{count} of {name:?} are more than the file can hold, or than {MAX_COUNT}"
                    )));
                }
                elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
            }
            ["property", "list", count, item, name] => {
                let (Some(count), Some(item)) = (Scalar::of(count), Scalar::of(item)) else {
                    return Err(bad(format!("the type of {name:?} is not known")));
                };
                let element = elements.last_mut().ok_or_else(|| bad("a property without element"))?;
                element.properties.push(Property::List(name.to_owned(), count, item));
            }
            ["property", kind, name] => {
                let kind = Scalar::of(kind).ok_or_else(|| bad(format!("the type {kind:?} is not known")))?;
                let element = elements.last_mut().ok_or_else(|| bad("a property without element"))?;
                element.properties.push(Property::One(name.to_owned(), kind));
            }
            _ => {}
        }
    }
    Ok((form.ok_or_else(|| bad("its header tells no form"))?, elements, &bytes[at..]))
}

/// Values of one item by property; a list gives its items one after the other.
fn item(element: &Element, body: &mut Body<'_>, mut each: impl FnMut(usize, f64)) -> Result<(), PlyError> {
    for (i, property) in element.properties.iter().enumerate() {
        match property {
            Property::One(_, scalar) => each(i, body.take(*scalar)?),
            Property::List(_, count, scalar) => {
                let n = body.take(*count)?;
                if !(0.0..=MAX_CORNERS as f64).contains(&n) {
                    return Err(bad(format!("a list has {n} items, at most {MAX_CORNERS} are read")));
                }
                for _ in 0..n as usize {
                    each(i, body.take(*scalar)?);
                }
            }
        }
    }
    Ok(())
}

fn skip(element: &Element, body: &mut Body<'_>) -> Result<(), PlyError> {
    (0..element.count).try_for_each(|_| item(element, body, |_, _| {}))
}

fn vertices(element: &Element, body: &mut Body<'_>, out: &mut PlyFile) -> Result<(), PlyError> {
    let place = |names: &[&str]| {
        element.properties.iter().position(|p| matches!(p, Property::One(n, _) if names.contains(&n.as_str())))
    };
    let axes = [place(&["x"]), place(&["y"]), place(&["z"])];
    let [Some(x), Some(y), Some(z)] = axes else { return Err(bad("its vertices have no x, y, z")) };
    let rgb = [
        place(&["red", "r", "diffuse_red"]),
        place(&["green", "g", "diffuse_green"]),
        place(&["blue", "b", "diffuse_blue"]),
    ];
    let dc = [place(&["f_dc_0"]), place(&["f_dc_1"]), place(&["f_dc_2"])];
    let (opacity, scale) = (place(&["opacity"]), [place(&["scale_0"]), place(&["scale_1"]), place(&["scale_2"])]);
    // Colours as numbers from 0 to 1 where they are floating-point.
    let whole = rgb[0].is_some_and(|i| !matches!(element.properties[i], Property::One(_, Scalar::F32 | Scalar::F64)));
    let mut values = vec![0.0; element.properties.len()];
    for _ in 0..element.count {
        item(element, body, |i, v| values[i] = v)?;
        out.positions.push(Vec3::new(values[x] as f32, values[y] as f32, values[z] as f32));
        if let [Some(r), Some(g), Some(b)] = dc {
            // The constant term of the spherical harmonics.
            out.colors.push([r, g, b].map(|i| (0.5 + 0.282_094_79 * values[i]).clamp(0.0, 1.0) as f32));
        } else if let [Some(r), Some(g), Some(b)] = rgb {
            let k = if whole { 255.0 } else { 1.0 };
            out.colors.push([r, g, b].map(|i| (values[i] / k).clamp(0.0, 1.0) as f32));
        }
        if let (Some(o), [Some(a), Some(b), Some(c)]) = (opacity, scale) {
            let radius = ((values[a] + values[b] + values[c]) / 3.0).exp();
            out.splats.push([(1.0 / (1.0 + (-values[o]).exp())) as f32, radius as f32]);
        }
    }
    Ok(())
}

fn faces(element: &Element, body: &mut Body<'_>, out: &mut PlyFile) -> Result<(), PlyError> {
    let list = element
        .properties
        .iter()
        .position(|p| matches!(p, Property::List(n, _, _) if n == "vertex_indices" || n == "vertex_index"));
    let list = list.ok_or_else(|| bad("its faces have no vertex_indices"))?;
    let mut corners: Vec<u32> = Vec::new();
    for _ in 0..element.count {
        corners.clear();
        item(element, body, |i, v| {
            if i == list {
                corners.push(if v >= 0.0 && v <= f64::from(u32::MAX) { v as u32 } else { u32::MAX });
            }
        })?;
        if corners.len() >= 3 {
            out.triangles.extend(corners.windows(2).skip(1).map(|w| [corners[0], w[0], w[1]]));
        }
        if out.triangles.len() > MAX_COUNT {
            return Err(bad(format!("it has more than {MAX_COUNT} triangles")));
        }
    }
    Ok(())
}

impl PlyFile {
    /// The mesh, its colours linear; triangles with corners that are not finite are left out. `None` for points alone.
    pub fn mesh(&self) -> Option<Mesh> {
        if self.triangles.is_empty() {
            return None;
        }
        let finite = |t: &&[u32; 3]| t.iter().all(|i| self.positions[*i as usize].is_finite());
        let positions: Vec<Vec3> = self.positions.iter().map(|p| if p.is_finite() { *p } else { Vec3::ZERO }).collect();
        let mut mesh = Mesh {
            uvs: vec![glam::Vec2::ZERO; positions.len()],
            positions,
            groups: vec![Group { material: 0, triangles: self.triangles.iter().filter(finite).copied().collect() }],
            materials: vec![grey_or_colored(!self.colors.is_empty())],
            colors: self.colors.iter().map(|c| c.map(linear)).collect(),
            ..Mesh::default()
        };
        mesh.recompute_normals();
        Some(mesh)
    }
}

/// Vertex colours are multiplied with the material: white where there are any, grey else. Seen from both sides, because
/// others do not say which is the outside.
pub fn grey_or_colored(colored: bool) -> Material {
    let color = if colored { [1.0; 3] } else { [0.6; 3] };
    Material { double_sided: true, ..Material::plain("surface", color) }
}

/// sRGB to linear.
pub fn linear(v: f32) -> f32 {
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const TEXT: &str = "ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty double y\n\
        property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0 0 0 255 0 0\n1 0 0 255 0 0\n1 1 0 255 0 0\n0 1 0.5 0 0 255\n\
        4 0 1 2 3\n";

    #[test]
    fn text_and_binary_hold_the_same() {
        let text = parse_ply(TEXT.as_bytes()).unwrap();
        assert_eq!(text.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!((text.positions[3], text.colors[3]), (Vec3::new(0.0, 1.0, 0.5), [0.0, 0.0, 1.0]));
        for (name, big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
            let (head, _) = TEXT.split_once("end_header\n").unwrap();
            let mut bytes = format!("{}end_header\n", head.replace("ascii", name)).into_bytes();
            let mut put = |raw: &[u8]| {
                let mut raw = raw.to_vec();
                if big {
                    raw.reverse();
                }
                bytes.extend(raw);
            };
            for (p, c) in text.positions.iter().zip(&text.colors) {
                put(&p.x.to_le_bytes());
                put(&f64::from(p.y).to_le_bytes());
                put(&p.z.to_le_bytes());
                for v in c {
                    put(&[(v * 255.0) as u8]);
                }
            }
            put(&[4]);
            (0..4_i32).for_each(|i| put(&i.to_le_bytes()));
            assert_eq!(parse_ply(&bytes).unwrap(), text, "{name}");
        }
        assert!(text.mesh().unwrap().check().is_ok());
    }

    #[test]
    fn broken_files_are_refused_with_a_reason() {
        for (from, to) in [
            ("element vertex 4", "element vertex 4000000000"),
            ("4 0 1 2 3", "4 0 1 2 9"),
            ("4 0 1 2 3", "4 0 1"),
            ("float x", "float w"),
            ("4 0 1 2 3", "99 0 1 2 3"),
            ("ascii", "binary_middle_endian"),
            ("end_header", "end"),
        ] {
            assert!(parse_ply(TEXT.replacen(from, to, 1).as_bytes()).is_err(), "{from} -> {to}");
        }
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..400), cut in 0_usize..400) {
            let _ = parse_ply(&bytes);
            let mut torn = TEXT.as_bytes().to_vec();
            torn.truncate(cut);
            torn.extend(&bytes);
            let _ = parse_ply(&torn);
        }
    }
}
