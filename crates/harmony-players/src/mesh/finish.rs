//! A GLB file of somebody else as a mesh that can be placed.

use glam::{DMat3, DVec3};
use harmony_io::{ReadLimits, read_glb};
use harmony_mesh::{Mesh, clean};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A direction along an axis of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[expect(missing_docs, reason = "the names say it")]
pub enum AxisName {
    #[serde(rename = "+x")]
    PlusX,
    #[serde(rename = "-x")]
    MinusX,
    #[serde(rename = "+y")]
    PlusY,
    #[serde(rename = "-y")]
    MinusY,
    #[serde(rename = "+z")]
    PlusZ,
    #[serde(rename = "-z")]
    MinusZ,
}

impl AxisName {
    fn vector(self) -> DVec3 {
        match self {
            Self::PlusX => DVec3::X,
            Self::MinusX => -DVec3::X,
            Self::PlusY => DVec3::Y,
            Self::MinusY => -DVec3::Y,
            Self::PlusZ => DVec3::Z,
            Self::MinusZ => -DVec3::Z,
        }
    }
}

/// The frame in which a generator leaves its meshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SourceFrame {
    /// Where up is.
    pub up: AxisName,
    /// Where the front looks.
    pub front: AxisName,
}

impl Default for SourceFrame {
    /// glTF's usage, and that of Hunyuan3D and TRELLIS: +Y up, front +Z.
    fn default() -> Self {
        Self { up: AxisName::PlusY, front: AxisName::PlusZ }
    }
}

impl SourceFrame {
    /// The rotation that carries the frame into ours (+Y up, front +Z).
    ///
    /// # Errors
    /// In words, when up and front lie along one axis.
    pub fn canonical_from_source(self) -> Result<DMat3, String> {
        let (up, front) = (self.up.vector(), self.front.vector());
        let right = up.cross(front);
        if right.length() < 0.5 {
            return Err("up and front lie along one axis".to_owned());
        }
        // Rows are our axes in the source's frame.
        Ok(DMat3::from_cols(right, up, front).transpose())
    }
}

/// What is done to a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Finish {
    /// Most triangles.
    pub faces: usize,
    /// The frame it comes in.
    pub frame: SourceFrame,
    /// Whether a metalness that nobody chose is taken out: exporters that leave it away mean 0 and say 1.
    pub not_metal: bool,
}

/// Whether bytes are a whole GLB file, by its header. A file that is still being written is not.
///
/// # Errors
/// In words.
pub fn whole(bytes: &[u8]) -> Result<(), String> {
    if bytes.len() < 12 || &bytes[..4] != b"glTF" {
        return Err("the answer is not a GLB file".to_owned());
    }
    let length = u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]) as usize;
    if length > bytes.len() {
        return Err(format!("the GLB file is cut off: {} of {length} bytes are there", bytes.len()));
    }
    Ok(())
}

/// Reads, checks, cleans, simplifies and turns a mesh; with what there is to say about it.
///
/// # Errors
/// In words, what is wrong with the file or the mesh.
pub fn finished(bytes: &[u8], finish: &Finish) -> Result<(Mesh, Vec<String>), String> {
    whole(bytes)?;
    let loaded = read_glb(bytes, &ReadLimits::default()).map_err(|error| error.to_string())?;
    let mut notes = loaded.notes.clone();
    let mut mesh = loaded.into_mesh().map_err(|error| error.to_string())?;
    if finish.not_metal {
        for material in mesh.materials.iter_mut().filter(|material| material.metallic >= 0.999) {
            material.metallic = 0.0;
        }
    }
    let (mut mesh, report) = clean(&mesh, finish.faces);
    mesh.check().map_err(|error| format!("nothing usable is left of the mesh: {error}"))?;
    if report.triangles_in - report.dropped > finish.faces {
        notes.push(format!("simplified from {} to {} triangles", report.triangles_in, report.triangles_out));
    }
    if report.dropped * 20 > report.triangles_in {
        notes.push(format!("{} of {} triangles were broken and left out", report.dropped, report.triangles_in));
    }
    let turn = finish.frame.canonical_from_source()?.as_mat3();
    mesh.map(|p| turn * p, |n| turn * n);
    Ok((mesh, notes))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use harmony_io::{GlbNode, GlbScene, NodeTransform, glb_bytes};
    use harmony_mesh::{TemplateParams, template};
    use harmony_scene::Size;
    use serde_json::Value;

    fn sofa() -> Mesh {
        let size = Size { width: 2.0, height: 0.8, depth: 0.9 };
        template("sofa", &TemplateParams::default(), size).build(size).unwrap().mesh
    }

    fn glb(mesh: Mesh) -> Vec<u8> {
        let node =
            GlbNode { name: "m".into(), mesh: Arc::new(mesh), transform: NodeTransform::IDENTITY, extras: Value::Null };
        glb_bytes(&GlbScene { objects: vec![node], ..GlbScene::default() }).unwrap()
    }

    const PLAIN: Finish =
        Finish { faces: 80_000, frame: SourceFrame { up: AxisName::PlusY, front: AxisName::PlusZ }, not_metal: false };

    #[test]
    fn half_a_file_and_other_files_are_refused() {
        let bytes = glb(sofa());
        assert!(finished(&bytes, &PLAIN).is_ok());
        assert!(finished(&bytes[..bytes.len() / 2], &PLAIN).unwrap_err().contains("cut off"));
        for odd in [&b""[..], b"glTF", b"{\"text\": \"error\"}", &[0; 64]] {
            assert!(finished(odd, &PLAIN).unwrap_err().contains("not a GLB"));
        }
    }

    #[test]
    fn the_budget_is_kept_and_said() {
        let (mesh, notes) = finished(&glb(sofa()), &Finish { faces: 600, ..PLAIN }).unwrap();
        assert!(mesh.triangle_count() <= 600);
        assert!(notes.iter().any(|note| note.contains("simplified")), "{notes:?}");
    }

    #[test]
    fn frames_are_turned_to_ours() {
        // A Z-up file whose front looks along -Y, as CAD programs leave it.
        let frame = SourceFrame { up: AxisName::PlusZ, front: AxisName::MinusY };
        let turn = frame.canonical_from_source().unwrap();
        assert!((turn * DVec3::Z - DVec3::Y).length() < 1e-12);
        assert!((turn * -DVec3::Y - DVec3::Z).length() < 1e-12);
        assert!((turn.determinant() - 1.0).abs() < 1e-12);
        let (mesh, _) = finished(&glb(sofa()), &Finish { frame, ..PLAIN }).unwrap();
        let size = mesh.bounds().unwrap().size();
        assert!((size - DVec3::new(2.0, 0.9, 0.8)).length() < 0.02, "{size:?}");
        let flat = SourceFrame { up: AxisName::PlusY, front: AxisName::MinusY };
        assert!(flat.canonical_from_source().is_err());
        assert_eq!(SourceFrame::default().canonical_from_source().unwrap(), DMat3::IDENTITY);
    }

    #[test]
    fn metal_that_nobody_chose_is_taken_out() {
        let mut mesh = sofa();
        mesh.materials.iter_mut().for_each(|m| m.metallic = 1.0);
        let bytes = glb(mesh);
        let metal = |finish: &Finish| finished(&bytes, finish).unwrap().0.materials.iter().any(|m| m.metallic > 0.5);
        assert!(metal(&PLAIN) && !metal(&Finish { not_metal: true, ..PLAIN }));
    }
}
