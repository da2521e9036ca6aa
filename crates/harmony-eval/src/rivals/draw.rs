//! A rival's scene from the photo's place, by our flat renderer, as every other is drawn.
//!
//! # The protocol
//! The paper's "Baseline Setup": one renderer and one light for all, the camera that the program recovered, the photo's
//! shape. A camera of another shape keeps its horizontal field of view. Where nothing is, the picture is white.
//!
//! # A lent background
//! A program that makes no room gets the shell of our run of the same photo (the paper does so for CAST and SAM 3D).
//! It appears exactly where our own camera sees it, whatever the rival's lens is, and always behind what the rival made.
//! Such pictures are marked with a star wherever they are shown.
//!
//! # Limits
//! Vertex colours are taken as glTF means them (linear); exporters that write screen colours look pale. The elevated view
//! needs a scale: the median ratio of our run's depth to the rival's, where both show objects.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};
use harmony_io::{GlbNode, GlbScene, NodeTransform, ReadLimits, load_glb, load_photo, picture};
use harmony_mesh::{Mesh, is_left_out, shell_material_name};
use harmony_render::{Instance, OUTSIDE, RenderOptions, canonical_camera, render};
use harmony_scene::{Camera, ImageSize, Intrinsics, Scene, Surface};
use image::{DynamicImage, RgbImage};
use serde::{Deserialize, Serialize};

use super::frames::baked;
use super::{Frame, Part, PartKind, RivalError, RivalKind, RivalScene, Unit};
use crate::statistics::median;

/// Id of shells in id images.
const SHELL: u32 = u32::MAX;
/// Aspects that differ by less count as equal.
const SAME_SHAPE: f64 = 0.01;
/// Least share of the objects' corners in the picture.
const MIN_INSIDE: f64 = 0.2;
/// Fewest pixels with both depths that a scale is taken from.
const FEWEST: usize = 200;
/// Most vertices that are projected to tell what is inside.
const MAX_PROJECTED: usize = 100_000;
/// Size of the elevated view.
const ELEVATED: ImageSize = ImageSize { width: 1024, height: 768 };
/// Longest side of the drawn picture, pixels.
const LONGEST: u32 = 2048;

/// How it is drawn.
#[derive(Debug, Clone, Default)]
pub struct DrawOptions {
    /// Our run of the same photo.
    pub run: Option<PathBuf>,
    /// The photo, where there is no run.
    pub photo: Option<PathBuf>,
    /// Lend our background to scenes without one.
    pub lend_background: bool,
    /// Draw even what lies outside the picture.
    pub anyway: bool,
}

/// What is told of a rival's output, `rival.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RivalReport {
    /// Who drew it.
    pub generator: String,
    /// Whose output.
    pub kind: RivalKind,
    /// What was read.
    pub files: Vec<PathBuf>,
    /// Frame of the files.
    pub frame: Frame,
    /// Unit of the files.
    pub unit: Unit,
    /// Parts: name, what it is, triangles.
    pub parts: Vec<(String, PartKind, usize)>,
    /// Whether the background is that of our run.
    pub background_lent: bool,
    /// Share of the objects' corners that project into the picture.
    pub share_inside: f64,
    /// Share of the picture that the rival's own parts cover.
    pub coverage: f64,
    /// Share of the picture that its objects cover.
    pub object_coverage: f64,
    /// Intersection over union of its objects' pixels and our run's objects' pixels.
    pub overlap_with_run: Option<f64>,
    /// Our run's depth over the rival's, the median over pixels of objects.
    pub scale_to_run: Option<f64>,
    /// What was guessed, repaired or left out.
    pub notes: Vec<String>,
}

/// A rival's scene, drawn.
#[derive(Debug, Clone)]
pub struct Drawn {
    /// From the photo's place.
    pub flat: RgbImage,
    /// From above, near walls away, in our room; where there is a run and a scale.
    pub elevated: Option<RgbImage>,
    /// Its objects in our room's frame, metres; where there is a run and a scale.
    pub in_room: Vec<Part>,
    /// What is told of it.
    pub report: RivalReport,
    /// The photo, as bytes and extension.
    photo: (Vec<u8>, &'static str),
}

/// Our run of the same photo.
struct OwnRun {
    scene: Scene,
    camera: Camera,
    shell: Vec<(String, Arc<Mesh>)>,
    objects: Vec<Arc<Mesh>>,
}

impl OwnRun {
    fn load(folder: &Path) -> Result<Self, RivalError> {
        let bad = |reason: String| RivalError::Run { path: folder.to_owned(), reason };
        let scene: Scene = harmony_io::read_json(&folder.join("scene.json")).map_err(|e| bad(e.to_string()))?;
        let glb = load_glb(&folder.join("scene_full.glb"), &ReadLimits::default()).map_err(|e| bad(e.to_string()))?;
        let camera = Camera::from(&scene.camera);
        let (mut shell, mut objects) = (Vec::new(), Vec::new());
        for node in &glb.nodes {
            let mesh = Arc::new(baked(&node.mesh, &node.transform));
            if scene.objects.iter().any(|o| o.id.as_str() == node.name) {
                objects.push(mesh);
            } else {
                shell.push((node.name.clone(), mesh));
            }
        }
        Ok(Self { scene, camera, shell, objects })
    }
}

fn instance(mesh: &Mesh, id: u32) -> Instance<'_> {
    Instance::in_room(mesh, id)
}

fn options() -> RenderOptions {
    RenderOptions { multisample: true, background: [255; 4], ..RenderOptions::default() }
}

/// Draws a scene beside a run or a photo.
///
/// # Errors
/// [`RivalError::NoCamera`], [`RivalError::Outside`], a run or a photo that cannot be used.
pub fn draw(scene: &RivalScene, folder: &Path, draw: &DrawOptions) -> Result<Drawn, RivalError> {
    let run = draw.run.as_deref().map(OwnRun::load).transpose()?;
    let photo = photo_of(draw)?;
    let Some(camera) = scene.camera else { return Err(RivalError::NoCamera { folder: folder.to_owned() }) };
    let size = photo.size().fit_within(LONGEST);
    let mut notes = scene.notes.clone();
    let camera = for_photo(&camera, size, &mut notes);
    let share_inside = inside(scene, &camera);
    if share_inside < MIN_INSIDE && !draw.anyway {
        return Err(RivalError::Outside { share: share_inside });
    }
    let own: Vec<Instance<'_>> = scene
        .parts
        .iter()
        .zip(1..)
        .map(|(part, id)| instance(&part.mesh, if part.kind == PartKind::Shell { SHELL } else { id }))
        .collect();
    let alone = render(&camera, &own, &options());
    let lent = draw.lend_background && scene.parts.iter().all(|p| p.kind == PartKind::Object);
    let background = run.as_ref().filter(|_| lent).map(|run| behind(run, scene, &camera));
    let flat = match &background {
        None => alone.color.clone(),
        Some(shell) => {
            let shell = shell.iter().map(|mesh| instance(mesh, SHELL));
            render(&camera, &own.iter().copied().chain(shell).collect::<Vec<_>>(), &options()).color
        }
    };
    let object = |id: u32| id != 0 && id != SHELL;
    let share = |test: &dyn Fn(u32) -> bool| {
        alone.ids.iter().filter(|id| test(**id)).count() as f64 / alone.ids.len().max(1) as f64
    };
    let (coverage, object_coverage) = (share(&|id| id != 0), share(&object));
    let compared = run.as_ref().map(|run| compare(run, &camera, &alone.ids, &alone.depth, object));
    let scale = compared.and_then(|c| c.1);
    if run.is_some() && scale.is_none() {
        notes.push("no scale against our run: their objects share too few pixels".to_owned());
    }
    let in_room = match (&run, scale) {
        (Some(run), Some(scale)) => carried(scene, &camera, run, scale),
        _ => Vec::new(),
    };
    let elevated =
        run.as_ref().filter(|_| !in_room.is_empty()).map(|run| from_above(run, &in_room, background.is_some()));
    let report = RivalReport {
        generator: format!("HARMONY {}, {}", env!("CARGO_PKG_VERSION"), scene.kind.name()),
        kind: scene.kind,
        files: scene.files.clone(),
        frame: scene.frame,
        unit: scene.unit,
        parts: scene.parts.iter().map(|p| (p.name.clone(), p.kind, p.mesh.triangle_count())).collect(),
        background_lent: background.is_some(),
        share_inside,
        coverage,
        object_coverage,
        overlap_with_run: compared.and_then(|c| c.0),
        scale_to_run: scale,
        notes,
    };
    let flat = DynamicImage::ImageRgba8(flat).into_rgb8();
    Ok(Drawn { flat, elevated, in_room, report, photo: (photo.bytes, photo.extension) })
}

fn photo_of(draw: &DrawOptions) -> Result<harmony_io::Photo, RivalError> {
    const KINDS: [&str; 8] = ["jpg", "png", "jpeg", "webp", "bmp", "tif", "tiff", "ppm"];
    let in_run =
        draw.run.as_ref().and_then(|run| KINDS.iter().map(|e| run.join(format!("input.{e}"))).find(|p| p.is_file()));
    let path = draw.photo.clone().or(in_run);
    let Some(path) = path else {
        let path = draw.run.clone().unwrap_or_default();
        return Err(RivalError::Run { path, reason: "it has no photo input.*".to_owned() });
    };
    load_photo(&path).map_err(|e| RivalError::Content { path, reason: e.to_string() })
}

/// The camera at the photo's size; one of another shape keeps its horizontal field of view.
fn for_photo(camera: &Camera, photo: ImageSize, notes: &mut Vec<String>) -> Camera {
    let aspect = |s: ImageSize| f64::from(s.width) / f64::from(s.height);
    if (aspect(camera.size) / aspect(photo) - 1.0).abs() < SAME_SHAPE {
        return camera.resized(photo);
    }
    notes.push(format!(
        "its picture of {} x {} has another shape than the photo: drawn in the photo's, horizontal field of view kept",
        camera.size.width, camera.size.height
    ));
    let focal = camera.intrinsics.fx * f64::from(photo.width) / f64::from(camera.size.width);
    Camera { size: photo, intrinsics: Intrinsics::centred(photo, focal), ..*camera }
}

/// Share of the objects' corners that project into the picture.
fn inside(scene: &RivalScene, camera: &Camera) -> f64 {
    let objects = || scene.parts.iter().filter(|p| p.kind == PartKind::Object);
    let parts: Vec<&Part> = if objects().next().is_some() { objects().collect() } else { scene.parts.iter().collect() };
    let all: usize = parts.iter().map(|p| p.mesh.positions.len()).sum();
    let step = all.div_ceil(MAX_PROJECTED).max(1);
    let (mut seen, mut count) = (0, 0);
    for p in parts.iter().flat_map(|p| &p.mesh.positions).step_by(step) {
        count += 1;
        seen += usize::from(camera.project(p.as_dvec3()).is_some_and(|pixel| camera.contains(pixel)));
    }
    seen as f64 / f64::from(count.max(1))
}

/// Our shell in the rival's world, where its camera sees it as ours does, farther than all that it made.
fn behind(run: &OwnRun, scene: &RivalScene, camera: &Camera) -> Vec<Mesh> {
    let matrix = |k: &Intrinsics| DMat3::from_cols_array(&[k.fx, 0.0, 0.0, 0.0, k.fy, 0.0, k.cx, k.cy, 1.0]);
    let ours = run.camera.resized(camera.size);
    // The same pixels through another lens: a shear of the camera's frame.
    let lens = matrix(&camera.intrinsics).inverse() * matrix(&ours.intrinsics);
    let farthest =
        scene.parts.iter().flat_map(|p| &p.mesh.positions).map(|p| camera.depth(p.as_dvec3())).fold(1.0, f64::max);
    // The nearest of what is seen of it; floors begin nearer than any corner.
    let shell: Vec<Instance<'_>> = run.shell.iter().map(|(_, mesh)| instance(mesh, SHELL)).collect();
    let depth = harmony_render::render_depth_ids(&ours, &shell, &RenderOptions::default()).depth;
    let seen = depth.iter().filter(|z| **z > 0.0).map(|z| f64::from(*z));
    let nearest = seen.fold(f64::INFINITY, f64::min).clamp(0.1, 10.0);
    let scale = (2.0 * farthest / nearest).max(1.0);
    let back = camera.rotation.transpose();
    let place = DAffine3 {
        matrix3: back * lens * ours.rotation * scale,
        translation: back * (lens * ours.translation * scale - camera.translation),
    };
    run.shell.iter().map(|(_, mesh)| baked(mesh, &place)).collect()
}

/// Overlap of the objects' pixels, and our depth over the rival's.
fn compare(
    run: &OwnRun,
    camera: &Camera,
    ids: &[u32],
    depth: &[f32],
    object: impl Fn(u32) -> bool,
) -> (Option<f64>, Option<f64>) {
    let ours = run.camera.resized(camera.size);
    let instances: Vec<Instance<'_>> = run
        .objects
        .iter()
        .map(|mesh| instance(mesh, 1))
        .chain(run.shell.iter().map(|(_, mesh)| instance(mesh, SHELL)))
        .collect();
    let own = harmony_render::render_depth_ids(&ours, &instances, &RenderOptions::default());
    let (mut both, mut either) = (0_usize, 0_usize);
    let mut ratios = Vec::new();
    for (i, id) in ids.iter().enumerate() {
        let (theirs, mine) = (object(*id), own.ids[i] == 1);
        either += usize::from(theirs || mine);
        if theirs && mine {
            both += 1;
            if depth[i] > 0.0 && own.depth[i] > 0.0 {
                ratios.push(f64::from(own.depth[i]) / f64::from(depth[i]));
            }
        }
    }
    let overlap = (either > 0).then(|| both as f64 / either as f64);
    (overlap, median(&ratios).filter(|_| ratios.len() >= FEWEST))
}

/// The rival's objects in our room: through both cameras, by the scale.
fn carried(scene: &RivalScene, camera: &Camera, run: &OwnRun, scale: f64) -> Vec<Part> {
    let back = run.camera.rotation.transpose();
    let place = DAffine3 {
        matrix3: back * camera.rotation * scale,
        translation: back * (camera.translation * scale - run.camera.translation),
    };
    let objects = scene.parts.iter().map(|p| Part { mesh: Arc::new(baked(&p.mesh, &place)), ..p.clone() });
    objects.collect()
}

fn from_above(run: &OwnRun, parts: &[Part], shell: bool) -> RgbImage {
    let view = canonical_camera(&run.scene.room, ELEVATED, &run.camera, &run.scene.stands());
    let hidden: Vec<&str> = view.omit.iter().map(|s: &Surface| shell_material_name(*s)).collect();
    let own_shell = run.shell.iter().filter(|(name, _)| shell && !is_left_out(name, &hidden));
    let instances: Vec<Instance<'_>> = parts
        .iter()
        // A rival's own shell would hide its room from above.
        .filter(|p| p.kind == PartKind::Object)
        .map(|p| instance(&p.mesh, 1))
        .chain(own_shell.map(|(_, mesh)| instance(mesh, SHELL)))
        .collect();
    let options = RenderOptions { background: OUTSIDE, ..options() };
    DynamicImage::ImageRgba8(render(&view.camera, &instances, &options).color).into_rgb8()
}

/// Writes what a run folder has: `input.*`, `render_flat.png`, `render_canonical.png`, `rival.glb` (its scene in our
/// room, transforms baked in), and `rival.json` last.
///
/// # Errors
/// A file that cannot be written, or a folder that holds a run: nothing of it is overwritten.
pub fn write(out: &Path, drawn: &Drawn) -> Result<(), RivalError> {
    if out.join("run.json").exists() || out.join("scene.json").exists() {
        let reason = "it is a run of ours; choose another folder for --out".to_owned();
        return Err(RivalError::Run { path: out.to_owned(), reason });
    }
    let (bytes, extension) = &drawn.photo;
    harmony_io::write_atomic(&out.join(format!("input.{extension}")), bytes)?;
    picture::write_rgb_png(&out.join("render_flat.png"), &drawn.flat)?;
    if let Some(elevated) = &drawn.elevated {
        picture::write_rgb_png(&out.join("render_canonical.png"), elevated)?;
    }
    if !drawn.in_room.is_empty() {
        let node = |p: &Part| GlbNode {
            name: p.name.clone(),
            mesh: Arc::clone(&p.mesh),
            transform: NodeTransform { translation: DVec3::ZERO, ..NodeTransform::IDENTITY },
            extras: serde_json::Value::Null,
        };
        let scene = GlbScene {
            objects: drawn.in_room.iter().map(node).collect(),
            generator: drawn.report.generator.clone(),
            ..GlbScene::default()
        };
        let path = out.join("rival.glb");
        harmony_io::write_glb(&scene, &path).map_err(|source| RivalError::Glb { path, source })?;
    }
    Ok(harmony_io::write_json(&out.join("rival.json"), &drawn.report)?)
}
