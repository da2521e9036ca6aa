//! Wavefront OBJ models, as furniture libraries hold them: polygons, groups by material, colours and textures.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Vec2, Vec3};
use harmony_mesh::{Group, Material, Mesh};
use image::RgbaImage;

/// Most triangles that are read.
const MAX_TRIANGLES: usize = 4_000_000;

/// Most corners of one polygon.
const MAX_CORNERS: usize = 4096;

/// Reads a model. `load` gives the bytes of a file that the model names (its materials, their textures), or `None`; a
/// texture that is not there leaves its material's colour.
///
/// # Errors
/// In words, when there is no usable polygon.
pub fn read_obj(text: &str, load: &mut dyn FnMut(&str) -> Option<Vec<u8>>) -> Result<Mesh, String> {
    let mut reader = Reader::default();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => reader.positions.push(Vec3::from(numbers(&mut words))),
            Some("vt") => {
                let [u, v, _] = numbers(&mut words);
                // OBJ counts rows from below, glTF from above.
                reader.uvs.push(Vec2::new(u, 1.0 - v));
            }
            Some("f") => reader.polygon(words)?,
            Some("usemtl") => reader.material = rest(line, "usemtl"),
            Some("mtllib") => {
                if let Some(bytes) = load(&rest(line, "mtllib")) {
                    read_mtl(&String::from_utf8_lossy(&bytes), load, &mut reader.materials);
                }
            }
            _ => {}
        }
    }
    reader.finish()
}

fn rest(line: &str, keyword: &str) -> String {
    line.trim().strip_prefix(keyword).unwrap_or_default().trim().to_owned()
}

/// Three numbers; what is missing or none is 0, except that broken ones stay broken for the check of the mesh.
fn numbers<'a>(words: &mut impl Iterator<Item = &'a str>) -> [f32; 3] {
    [(); 3].map(|()| words.next().map_or(0.0, |word| word.parse().unwrap_or(f32::NAN)))
}

#[derive(Default)]
struct Reader {
    positions: Vec<Vec3>,
    uvs: Vec<Vec2>,
    material: String,
    materials: HashMap<String, Material>,
    /// Groups in the order of their first polygon.
    groups: Vec<(String, Vec<[u32; 3]>)>,
    /// Vertices by position and texture coordinate.
    corners: HashMap<(usize, Option<usize>), u32>,
    vertices: Vec<(Vec3, Vec2)>,
    triangles: usize,
}

impl Reader {
    fn polygon<'a>(&mut self, words: impl Iterator<Item = &'a str>) -> Result<(), String> {
        let mut corners = Vec::new();
        for word in words.take(MAX_CORNERS) {
            let mut parts = word.split('/');
            let Some(position) = index(parts.next(), self.positions.len()) else { return Ok(()) };
            let uv = index(parts.next(), self.uvs.len());
            let (p, t) = (self.positions[position], uv.map_or(Vec2::ZERO, |uv| self.uvs[uv]));
            let vertices = &mut self.vertices;
            let corner = *self.corners.entry((position, uv)).or_insert_with(|| {
                vertices.push((p, t));
                (vertices.len() - 1) as u32
            });
            corners.push(corner);
        }
        let points: Vec<Vec3> = corners.iter().map(|c| self.vertices[*c as usize].0).collect();
        let triangles = ears(&points);
        self.triangles += triangles.len();
        if self.triangles > MAX_TRIANGLES {
            return Err(format!("the model has more than {MAX_TRIANGLES} triangles"));
        }
        if !self.groups.iter().any(|(name, _)| *name == self.material) {
            self.groups.push((self.material.clone(), Vec::new()));
        }
        let group = self.groups.iter_mut().find(|(name, _)| *name == self.material);
        if let Some((_, list)) = group {
            list.extend(triangles.into_iter().map(|t| t.map(|i| corners[i])));
        }
        Ok(())
    }

    fn finish(self) -> Result<Mesh, String> {
        if self.triangles == 0 {
            return Err("the model has no polygon".to_owned());
        }
        let mut mesh = Mesh::default();
        for (position, uv) in self.vertices {
            mesh.positions.push(position);
            mesh.uvs.push(uv);
        }
        for (name, triangles) in self.groups {
            let material = self.materials.get(&name).cloned();
            mesh.materials.push(material.unwrap_or_else(|| Material::plain("body", [0.6; 3])));
            mesh.groups.push(Group { material: mesh.materials.len() - 1, triangles });
        }
        Ok(mesh)
    }
}

/// An index of OBJ: from 1, or from the end when negative.
fn index(word: Option<&str>, count: usize) -> Option<usize> {
    let value: i64 = word?.parse().ok()?;
    let index = if value < 0 { count as i64 + value } else { value - 1 };
    usize::try_from(index).ok().filter(|i| *i < count)
}

/// A polygon in triangles, by ears: polygons of furniture models are often concave, and a fan would cover the notch.
fn ears(points: &[Vec3]) -> Vec<[usize; 3]> {
    let count = points.len();
    if count <= 3 {
        return if count == 3 { vec![[0, 1, 2]] } else { vec![] };
    }
    // Newell's normal, whatever the polygon's shape.
    let normal = (0..count).map(|i| points[i].cross(points[(i + 1) % count])).sum::<Vec3>();
    let cross = |a: usize, b: usize, c: usize| (points[b] - points[a]).cross(points[c] - points[b]).dot(normal);
    let mut left: Vec<usize> = (0..count).collect();
    let mut out = Vec::with_capacity(count - 2);
    while left.len() > 3 {
        let n = left.len();
        let ear = (0..n).find(|k| {
            let (a, b, c) = (left[(k + n - 1) % n], left[*k], left[(k + 1) % n]);
            let inside = |p: &usize| {
                ![a, b, c].contains(p)
                    && [(a, b), (b, c), (c, a)]
                        .iter()
                        .all(|(i, j)| (points[*j] - points[*i]).cross(points[*p] - points[*i]).dot(normal) >= 0.0)
            };
            cross(a, b, c) > 0.0 && !left.iter().any(inside)
        });
        // A polygon that crosses itself has no ear at some point; then it is cut somewhere.
        let k = ear.unwrap_or(0);
        out.push([left[(k + n - 1) % n], left[k], left[(k + 1) % n]]);
        left.remove(k);
    }
    out.push([left[0], left[1], left[2]]);
    out
}

fn read_mtl(text: &str, load: &mut dyn FnMut(&str) -> Option<Vec<u8>>, materials: &mut HashMap<String, Material>) {
    let mut name = String::new();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        let keyword = words.next().unwrap_or_default();
        if keyword == "newmtl" {
            name = rest(line, "newmtl");
            materials.insert(name.clone(), Material::plain(&name, [0.6; 3]));
            continue;
        }
        let Some(material) = materials.get_mut(&name) else { continue };
        match keyword {
            "Kd" => {
                let color = numbers(&mut words);
                if material.texture.is_none() && color.iter().all(|c| c.is_finite()) {
                    // Colours of OBJ are meant for the screen.
                    let linear = color.map(|c| harmony_imaging::color::linear_from_srgb(c.clamp(0.0, 1.0)));
                    material.base_color = [linear[0], linear[1], linear[2], material.base_color[3]];
                }
            }
            "d" => material.base_color[3] = numbers(&mut words)[0].clamp(0.05, 1.0),
            "Tr" => material.base_color[3] = (1.0 - numbers(&mut words)[0]).clamp(0.05, 1.0),
            "map_Kd" => {
                if let Some(texture) = texture(&rest(line, "map_Kd"), load) {
                    material.texture = Some(Arc::new(texture));
                    material.base_color = [1.0, 1.0, 1.0, material.base_color[3]];
                }
            }
            _ => {}
        }
    }
}

fn texture(name: &str, load: &mut dyn FnMut(&str) -> Option<Vec<u8>>) -> Option<RgbaImage> {
    let bytes = load(name)?;
    Some(harmony_io::picture::decode(&bytes).ok()?.to_rgba8())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_materials_and_textures_are_read() {
        let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nusemtl red wood\n\
                   f 1/1 2/1 3/2 4/2\nusemtl glass\nf -4 -3 -2\n";
        let mut asked = Vec::new();
        let mesh = read_obj(obj, &mut |file| {
            asked.push(file.to_owned());
            (file == "a.mtl")
                .then(|| b"newmtl red wood\nKd 1 0 0\nmap_Kd gone.png\nnewmtl glass\nKd 0 0 1\nd 0.3\n".to_vec())
        })
        .unwrap();
        assert_eq!(asked, ["a.mtl", "gone.png"]);
        assert_eq!((mesh.groups.len(), mesh.triangle_count()), (2, 3));
        assert_eq!(mesh.materials[0].base_color, [1.0, 0.0, 0.0, 1.0], "a missing texture leaves the colour");
        assert!((mesh.materials[1].base_color[3] - 0.3).abs() < 1e-6);
        assert_eq!(mesh.uvs[0], Vec2::new(0.0, 1.0));
    }

    #[test]
    fn concave_polygons_keep_their_area() {
        // An L of area 3.
        let points: Vec<Vec3> = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)]
            .map(|(x, y)| Vec3::new(x, y, 1.0))
            .into();
        for shift in 0..6 {
            let mut turned = points.clone();
            turned.rotate_left(shift);
            let area: f32 = ears(&turned)
                .iter()
                .map(|t| (turned[t[1]] - turned[t[0]]).cross(turned[t[2]] - turned[t[0]]).length() / 2.0)
                .sum();
            assert!((area - 3.0).abs() < 1e-5, "{shift}: {area}");
        }
    }

    #[test]
    fn broken_models_are_refused_without_a_panic() {
        for text in
            ["", "f 1 2 3", "v a b c\nv 1 2 3\nf 1 2 9", "v 0 0 0\nf 1 1", "f 0 0 0\nf -1 -2 -3", "usemtl\nmtllib"]
        {
            assert!(read_obj(text, &mut |_| None).is_err(), "{text:?}");
        }
    }
}
