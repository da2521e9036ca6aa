//! Meshes and point maps.

use std::path::Path;
use std::sync::Arc;

use harmony_io::{MapFit, PointMapOptions, ReadLimits};
use harmony_mesh::{ConvexPart, PartModel};
use harmony_roles::{
    GeneratedMesh, GeometryAnswer, GeometryEstimator, GeometryRequest, MeshFrame, MeshGenerator, MeshRequest,
    PlayerCard, Role, RoleError, Usage,
};
use harmony_scene::ImageSize;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{Recordable, rgb_hash, rgba_hash, show_rgb, show_rgba, write_failed};
use crate::ContentKey;
use crate::book::{BookError, RecordWriter, read_json};
use crate::key::KeyHasher;

/// Most triangles of one object's mesh.
const MAX_TRIANGLES: usize = 4_000_000;

/// Most convex parts of one object.
const MAX_CONVEX_PARTS: usize = 2000;

/// `answer.json` of a mesh generator; the mesh itself is `answer.glb`.
#[derive(Serialize, Deserialize)]
struct MeshSheet {
    frame: MeshFrame,
    source: String,
    notes: Vec<String>,
    part_model: Option<PartModel>,
    /// Points of each convex part, in the mesh's frame.
    convex: Option<Vec<Vec<[f32; 3]>>>,
}

impl Recordable for MeshRequest {
    type Answer = GeneratedMesh;
    type Player = dyn MeshGenerator;
    const ROLE: Role = Role::MeshGenerator;

    fn name(&self) -> &str {
        &self.name
    }

    fn card(player: &Self::Player) -> PlayerCard {
        player.card()
    }

    async fn play(&self, player: &Self::Player) -> Result<GeneratedMesh, RoleError> {
        player.generate(self).await
    }

    fn hash(&self, hasher: &mut KeyHasher) {
        hasher.pixels("crop", &rgba_hash(&self.crop));
        hasher.json("parameters", &mesh_parameters(self));
    }

    fn work(&self, player: &Self::Player) -> Option<ContentKey> {
        player.sees_picture_only().then(|| {
            let mut hasher = KeyHasher::new(Self::ROLE);
            hasher.pixels("crop", &rgba_hash(&self.crop));
            hasher.json("settings", &json!(self.settings));
            hasher.finish()
        })
    }

    fn write_request(&self, out: &RecordWriter<'_>, offline: bool) -> Result<(), BookError> {
        let crop = show_rgba(out, "image_1.png", &self.crop, "the completed object", offline)?;
        let mut request = mesh_parameters(self);
        request["images"] = json!([crop]);
        out.json("request.json", &request)
    }

    fn write_answer(&self, answer: &GeneratedMesh, out: &RecordWriter<'_>) -> Result<(), BookError> {
        let path = out.folder().join("answer.glb");
        harmony_io::write_mesh_glb(&path, "object", Arc::clone(&answer.mesh), Value::Null)
            .map_err(|error| write_failed(out, "answer.glb", &error))?;
        let points = |part: &ConvexPart| part.points.iter().copied().map(Into::into).collect();
        out.json(
            "answer.json",
            &MeshSheet {
                frame: answer.frame,
                source: answer.source.clone(),
                notes: answer.notes.clone(),
                part_model: answer.part_model.clone(),
                convex: answer.convex.as_ref().map(|parts| parts.iter().map(points).collect()),
            },
        )
    }

    fn read_answer(&self, folder: &Path) -> Result<GeneratedMesh, String> {
        let sheet: MeshSheet = read_json(&folder.join("answer.json"))?;
        let mesh = harmony_io::load_mesh_glb(&folder.join("answer.glb"), &ReadLimits::default())
            .map_err(|error| error.to_string())?;
        let part = |points: Vec<[f32; 3]>| ConvexPart { points: points.into_iter().map(Into::into).collect() };
        Ok(GeneratedMesh {
            mesh: Arc::new(mesh),
            convex: sheet.convex.map(|parts| parts.into_iter().map(part).collect()),
            frame: sheet.frame,
            part_model: sheet.part_model,
            source: sheet.source,
            notes: sheet.notes,
            usage: Usage::default(),
        })
    }

    fn check(&self, answer: &GeneratedMesh) -> Result<(), String> {
        answer.mesh.check().map_err(|error| error.to_string())?;
        let triangles = answer.mesh.triangle_count();
        if triangles > MAX_TRIANGLES {
            return Err(format!("the mesh has {triangles} triangles; at most {MAX_TRIANGLES} are taken"));
        }
        let size = answer.mesh.bounds().map_or(0.0, |b| b.size().max_element());
        if !(size.is_finite() && size > 1e-9) {
            return Err(format!("the mesh is {size} units large"));
        }
        let parts = answer.convex.as_deref().unwrap_or_default();
        if parts.len() > MAX_CONVEX_PARTS || parts.iter().flat_map(|p| &p.points).any(|p| !p.is_finite()) {
            return Err(format!("the convex parts are not {MAX_CONVEX_PARTS} finite ones at most"));
        }
        Ok(())
    }

    fn usage(answer: &GeneratedMesh) -> Usage {
        answer.usage
    }
}

fn mesh_parameters(request: &MeshRequest) -> Value {
    json!({
        "label": request.label,
        "description": request.description,
        "level": request.level,
        "size": request.size,
        "template": request.template,
        "params": request.params,
        "part_model": request.part_model,
        "settings": request.settings,
    })
}

/// `answer.json` of a geometry estimator; the points are `points.npz`.
#[derive(Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum GeometrySheet {
    Points,
    NoDepth { evidence: Value },
}

impl Recordable for GeometryRequest {
    type Answer = GeometryAnswer;
    type Player = dyn GeometryEstimator;
    const ROLE: Role = Role::GeometryEstimator;

    fn name(&self) -> &str {
        &self.name
    }

    fn card(player: &Self::Player) -> PlayerCard {
        player.card()
    }

    async fn play(&self, player: &Self::Player) -> Result<GeometryAnswer, RoleError> {
        player.estimate(self).await
    }

    fn hash(&self, hasher: &mut KeyHasher) {
        hasher.pixels("image", &rgb_hash(&self.image));
        hasher.json("exif_focal_px", &json!(self.exif_focal_px));
    }

    fn write_request(&self, out: &RecordWriter<'_>, offline: bool) -> Result<(), BookError> {
        let image = show_rgb(out, "image_1.png", &self.image, "the photo", offline)?;
        out.json("request.json", &json!({"images": [image], "exif_focal_px": self.exif_focal_px}))
    }

    fn write_answer(&self, answer: &GeometryAnswer, out: &RecordWriter<'_>) -> Result<(), BookError> {
        let sheet = match answer {
            GeometryAnswer::Points(map) => {
                let path = out.folder().join("points.npz");
                harmony_io::save_point_map(&path, map).map_err(|error| write_failed(out, "points.npz", &error))?;
                GeometrySheet::Points
            }
            GeometryAnswer::NoDepth { evidence } => GeometrySheet::NoDepth { evidence: evidence.clone() },
        };
        out.json("answer.json", &sheet)
    }

    fn read_answer(&self, folder: &Path) -> Result<GeometryAnswer, String> {
        match read_json(&folder.join("answer.json"))? {
            GeometrySheet::NoDepth { evidence } => Ok(GeometryAnswer::NoDepth { evidence }),
            GeometrySheet::Points => {
                let photo_size = ImageSize::new(self.image.width(), self.image.height());
                let options = PointMapOptions { fit: MapFit::Stretched, ..PointMapOptions::new(photo_size) };
                let map = harmony_io::load_point_map(&folder.join("points.npz"), &options)
                    .map_err(|error| error.to_string())?;
                Ok(GeometryAnswer::Points(Arc::new(map)))
            }
        }
    }

    fn check(&self, answer: &GeometryAnswer) -> Result<(), String> {
        let GeometryAnswer::Points(map) = answer else { return Ok(()) };
        if map.xyz.len() != map.size.pixels() || map.confidence.len() != map.xyz.len() {
            return Err(format!(
                "{} points and {} confidences for {} x {}",
                map.xyz.len(),
                map.confidence.len(),
                map.size.width,
                map.size.height
            ));
        }
        let k = map.intrinsics;
        let finite = [k.fx, k.fy, k.cx, k.cy].iter().all(|v| v.is_finite());
        if !(finite && k.fx > 0.0 && k.fy > 0.0 && map.rotation.is_finite() && map.translation.is_finite()) {
            return Err(format!("the camera of the point map is not finite and positive: {k:?}"));
        }
        let known = map.xyz.iter().zip(&map.confidence).filter(|(p, c)| p.is_finite() && **c > 0.0).count();
        if known == 0 {
            return Err("the point map holds no point".to_owned());
        }
        Ok(())
    }
}
