//! The joined run's folder.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use harmony_io::{
    GlbNode, GlbScene, NodeTransform, Segment, glb::TextureEncoding, picture, save_segmentation, write_json,
};
use harmony_mesh::{Mesh, ShellOptions, Trims, room_shell_with};
use harmony_pipeline::outputs::{objects_json, shell_nodes};
use harmony_pipeline::{Beyond, GENERATOR, JoinedRun, PhaseEntry, PhaseState, RunFile, hash_files, panes};
use harmony_render::{Instance, Lighting as Shading, OUTSIDE, RenderOptions, canonical_camera, render};
use harmony_scene::{
    Camera, ImageSize, Light, Lighting, Mask, ObjectId, Room, SCENE_VERSION, Scene, SceneCamera, Surface,
    ViewTransform, Warning, WarningKind,
};
use harmony_viewer::{
    DroppedObject, Evidence, Fact, ObjectReport, PhaseReport, PhaseStatus, ReportData, ReportPicture,
};
use image::{DynamicImage, RgbImage, RgbaImage};
use serde_json::{Value, json};

use crate::merge::{Dropped, Thing};
use crate::room::FaceReport;
use crate::seen::{SeenShare, in_place, seen_share};
use crate::solve::Joint;
use crate::source::{Source, photo_file};
use crate::tree::Link;
use crate::{JOIN_FILE, JoinError, LeftOut, PHASE};

/// Everything that was made.
pub struct Joined<'a> {
    /// Runs, the first one's frame is the joined one's.
    pub sources: &'a [Source],
    /// How pairs of runs lie together.
    pub links: &'a [Link],
    /// Placings, room, places.
    pub joint: &'a Joint,
    /// The room.
    pub room: Room,
    /// What is seen through its passages.
    pub beyond: Vec<Beyond>,
    /// Its faces.
    pub textures: BTreeMap<Surface, Arc<RgbaImage>>,
    /// How they were made.
    pub faces: Vec<FaceReport>,
    /// Boards along the walls.
    pub trims: Trims,
    /// Things.
    pub things: Vec<Thing>,
    /// What is not in the scene.
    pub dropped: Vec<Dropped>,
    /// Runs that are not in it.
    pub left_out: Vec<LeftOut>,
}

impl Joined<'_> {
    /// Each photo's camera in the joined room.
    pub fn cameras(&self) -> Vec<Camera> {
        self.sources.iter().zip(&self.joint.placings).map(|(s, p)| p.camera(&s.camera)).collect()
    }

    fn shell(&self, omit: Vec<Surface>) -> Mesh {
        let options = ShellOptions { omit, trims: self.trims, ..ShellOptions::default() };
        let shown = |o: &&Beyond| !options.omit.contains(&o.opening.wall.surface());
        let beyond: Vec<Beyond> = self.beyond.iter().filter(shown).cloned().collect();
        let mut shell = room_shell_with(&self.room, &|s| self.textures.get(&s).cloned(), &options);
        if !beyond.is_empty() {
            shell.append(&panes(&beyond, &self.room.extents));
        }
        shell
    }

    fn instances<'b>(&'b self, shell: &'b Mesh) -> Vec<Instance<'b>> {
        let things = self.things.iter().map(|t| Instance::posed(&t.mesh, &t.object.pose, t.object.index));
        std::iter::once(Instance::in_room(shell, 1)).chain(things).collect()
    }

    /// Shares of the scene's surface that the photos show.
    pub fn seen(&self) -> SeenShare {
        let shell = self.shell(Vec::new());
        let things: Vec<Instance<'_>> =
            self.things.iter().map(|t| Instance::posed(&t.mesh, &t.object.pose, t.object.index)).collect();
        seen_share(&things, &[in_place(&shell)], &self.cameras())
    }

    fn lighting(&self) -> Lighting {
        let mut out = self.sources[0].scene.lighting.clone();
        out.lights.clear();
        let id_of = |run: usize, id: &ObjectId| {
            let thing =
                self.things.iter().find(|t| t.track.objects(self.sources).any(|m| m.0 == run && m.1.object.id == *id));
            thing.map(|t| t.object.id.clone())
        };
        for (run, source) in self.sources.iter().enumerate() {
            let placing = &self.joint.placings[run];
            for light in &source.scene.lighting.lights {
                // A lamp or window that an earlier run has shines once.
                let object = light.object.as_ref().and_then(|id| id_of(run, id));
                let known = object.is_some() && out.lights.iter().any(|l| l.object == object);
                let sun = run > 0 && light.object.is_none();
                if known || sun || (light.object.is_some() && object.is_none()) {
                    continue;
                }
                out.lights.push(moved(light, placing, object, out.lights.len()));
            }
        }
        if out.lights.is_empty() && self.sources.iter().all(|s| s.scene.lighting.lights.is_empty()) {
            out.view = ViewTransform::Standard;
        }
        out
    }

    /// The scene as `scene.json` holds it.
    pub fn scene(&self) -> Scene {
        let mut warnings: Vec<Warning> = self.dropped.iter().map(warning_of).collect();
        warnings.extend(self.left_out.iter().map(|l| Warning {
            phase: PHASE.to_owned(),
            object: None,
            kind: WarningKind::NotAvailable,
            message: format!("left out: {}", l.reason),
        }));
        warnings.extend(self.sources.iter().filter(|s| !s.depth.measured).map(|s| Warning {
            phase: PHASE.to_owned(),
            object: None,
            kind: WarningKind::Fallback,
            message: format!(
                "{} has no point map: what its photo shows to be empty is judged by its own scene",
                s.name
            ),
        }));
        if self.sources[1..].iter().any(|s| s.scene.room.shape != harmony_scene::RoomShape::default()) {
            warnings.push(Warning {
                phase: PHASE.to_owned(),
                object: None,
                kind: WarningKind::NotAvailable,
                message: "blocks, niches and slopes are those of the first run alone".to_owned(),
            });
        }
        Scene {
            version: SCENE_VERSION,
            generator: GENERATOR.to_owned(),
            room: self.room.clone(),
            camera: SceneCamera::from(&self.cameras()[0]),
            objects: self.things.iter().map(|t| t.object.clone()).collect(),
            lighting: self.lighting(),
            summary: self.sources[0].scene.summary.clone(),
            warnings,
        }
    }
}

fn warning_of(d: &Dropped) -> Warning {
    Warning {
        phase: PHASE.to_owned(),
        object: Some(d.id.clone()),
        kind: WarningKind::ObjectDropped,
        message: format!("{} of {}: {}", d.id, d.run, d.reason),
    }
}

/// A light of a run in the joined room.
fn moved(light: &Light, placing: &crate::Placing, object: Option<ObjectId>, number: usize) -> Light {
    use harmony_scene::LightKind;
    let s = placing.joined_from_run();
    let turned = |d: [f64; 3]| s.direction(DVec3::from_array(d)).to_array();
    let mut out = light.clone();
    out.position = s.point(DVec3::from_array(light.position)).to_array();
    match &mut out.kind {
        LightKind::Area { direction, .. } | LightKind::Sun { direction, .. } => *direction = turned(*direction),
        LightKind::Point { .. } => {}
    }
    if number > 0 {
        out.id = format!("{}_{}", light.id, number + 1);
    }
    out.object = object;
    out
}

const FLAT: RenderOptions = RenderOptions {
    lighting: Shading::Unlit,
    multisample: true,
    background: OUTSIDE,
    near: 0.05,
    glass: harmony_render::Glass::Solid,
};

/// Writes everything; `run.json` last.
///
/// # Errors
/// Files that cannot be written.
pub fn write(out: &Path, joined: &Joined<'_>, title: &str) -> Result<(Scene, SeenShare), JoinError> {
    let scene = joined.scene();
    let seen = joined.seen();
    copy_photos(out, joined)?;
    write_json(&out.join("scene.json"), &scene)?;
    write_json(&out.join("objects.json"), &objects_json(&scene))?;
    write_json(&out.join("camera.json"), &camera_json(joined, &scene))?;
    write_json(&out.join("cameras.json"), &cameras_json(joined))?;
    write_json(&out.join(JOIN_FILE), &join_json(joined, &seen))?;
    for (surface, image) in &joined.textures {
        let rgb = DynamicImage::ImageRgba8((**image).clone()).to_rgb8();
        picture::write_rgb_png(&out.join("1_layout/textures").join(format!("{}.png", surface.name())), &rgb)?;
    }
    write_json(&out.join("1_layout/room.json"), &joined.room)?;
    for thing in &joined.things {
        let path = out.join(&thing.object.mesh);
        harmony_io::glb::write_mesh_glb(&path, thing.object.id.as_str(), Arc::clone(&thing.mesh), Value::Null)?;
    }
    write_glb(out, joined, &scene)?;
    let masks = masks(joined, &scene);
    for (object, mask) in &masks {
        if let Some(path) = scene.objects.iter().find(|o| o.id == *object).and_then(|o| o.mask.as_ref()) {
            harmony_io::save_mask(&out.join(path), mask)?;
        }
    }
    pictures(out, joined, &scene)?;
    let size = ImageSize::new(scene.camera.size.width, scene.camera.size.height);
    let whole: Vec<(ObjectId, Mask)> = masks.into_iter().map(|(id, mask)| (id, mask.resized(size))).collect();
    let segments: Vec<Segment<'_>> = scene
        .objects
        .iter()
        .filter_map(|object| Some(Segment { object, mask: &whole.iter().find(|(id, _)| *id == object.id)?.1 }))
        .collect();
    save_segmentation(out, size, &segments)?;
    harmony_viewer::write_report(out, &scene, &report(joined, &scene, &seen, title))?;
    run_file(out, joined)?.write(out)?;
    Ok((scene, seen))
}

/// The first photo as the run's input, the others beside it.
fn copy_photos(out: &Path, joined: &Joined<'_>) -> Result<(), JoinError> {
    for (k, source) in joined.sources.iter().enumerate() {
        let Some(path) = photo_file(&source.folder) else { continue };
        let bytes = std::fs::read(&path).map_err(|error| JoinError::Photo { path: path.clone(), source: error })?;
        let extension = path.extension().map_or_else(|| "jpg".to_owned(), |e| e.to_string_lossy().into_owned());
        let name = if k == 0 { format!("input.{extension}") } else { format!("inputs/photo_{}.{extension}", k + 1) };
        harmony_io::write_atomic(&out.join(name), &bytes)?;
    }
    Ok(())
}

/// Masks of what the first photo shows, as its run has them.
fn masks(joined: &Joined<'_>, scene: &Scene) -> Vec<(ObjectId, Mask)> {
    let mut out = Vec::new();
    for (thing, object) in joined.things.iter().zip(&scene.objects) {
        let first = thing.track.objects(joined.sources).find(|(run, _)| *run == 0);
        let mask = first
            .and_then(|(_, o)| harmony_io::load_mask(&joined.sources[0].folder.join(o.object.mask.as_ref()?)).ok());
        out.extend(mask.map(|m| (object.id.clone(), m)));
    }
    out
}

fn write_glb(out: &Path, joined: &Joined<'_>, scene: &Scene) -> Result<(), JoinError> {
    let nodes = joined
        .things
        .iter()
        .map(|t| {
            let o = &t.object;
            GlbNode {
                name: o.id.to_string(),
                mesh: Arc::clone(&t.mesh),
                transform: NodeTransform::from(&o.pose),
                extras: json!({
                    "id": o.id, "label": o.label, "level": o.level, "description": o.description, "size_m": o.size,
                    "support": o.support, "relations": o.relations, "material": o.material,
                    "confidence": o.confidence, "mesh_source": o.mesh_source, "index": o.index,
                    "seen_in": t.track.members.iter().map(|m| &joined.sources[m.0].name).collect::<Vec<_>>(),
                }),
            }
        })
        .collect();
    let shell = joined.shell(Vec::new());
    let glb = GlbScene {
        objects: nodes,
        shell: shell_nodes(&shell),
        camera: Some(joined.cameras()[0]),
        lighting: (!scene.lighting.lights.is_empty()).then_some(&scene.lighting),
        glow: harmony_io::glb::AMBIENT_GLOW,
        extras: json!({
            "generator": GENERATOR,
            "room": joined.room,
            "frame": "right-handed, +X width, +Y up, +Z from the back wall to the viewer, metres",
        }),
        generator: GENERATOR.to_owned(),
        textures: TextureEncoding::Compact,
    };
    Ok(harmony_io::write_glb(&glb, &out.join("scene_full.glb"))?)
}

/// The scene from every photo's camera, beside the photo, and the canonical view.
fn pictures(out: &Path, joined: &Joined<'_>, scene: &Scene) -> Result<(), JoinError> {
    let shell = joined.shell(Vec::new());
    let drawn = |camera: &Camera| -> RgbImage {
        DynamicImage::ImageRgba8(render(camera, &joined.instances(&shell), &FLAT).color).to_rgb8()
    };
    for (k, camera) in joined.cameras().iter().enumerate() {
        let small = camera.resized(camera.size.fit_within(1280));
        let name = if k == 0 { "render_flat.png".to_owned() } else { format!("render_photo_{}.png", k + 1) };
        picture::write_rgb_png(&out.join(name), &drawn(&small))?;
    }
    let view = canonical_camera(&joined.room, ImageSize::new(1280, 960), &Camera::from(&scene.camera), &scene.stands());
    let open = joined.shell(view.omit.clone());
    // What is fixed to a face that is left out goes with it.
    let gone = scene.gone_with(&view.omit);
    let hidden: Vec<u32> = scene.objects.iter().filter(|o| gone.contains(&o.id)).map(|o| o.index).collect();
    let mut shown = joined.instances(&open);
    shown.retain(|instance| !hidden.contains(&instance.id));
    let canonical = render(&view.camera, &shown, &FLAT).color;
    picture::write_rgb_png(&out.join("render_canonical.png"), &DynamicImage::ImageRgba8(canonical).to_rgb8())?;
    Ok(())
}

fn camera_json(joined: &Joined<'_>, scene: &Scene) -> Value {
    let camera = Camera::from(&scene.camera);
    json!({
        "convention": "OpenCV; x_cam = R x_room + t; the centre of the top-left pixel is (0.5, 0.5)",
        "width": camera.size.width, "height": camera.size.height,
        "K": [[camera.intrinsics.fx, 0.0, camera.intrinsics.cx], [0.0, camera.intrinsics.fy, camera.intrinsics.cy], [0.0, 0.0, 1.0]],
        "R": scene.camera.rotation, "t": scene.camera.translation, "centre": scene.camera.centre,
        "horizontal_fov_deg": camera.horizontal_fov().to_degrees(),
        "room_m": scene.room.extents,
        "method": format!("joined from {} photos", joined.sources.len()),
    })
}

fn cameras_json(joined: &Joined<'_>) -> Value {
    let each = joined.sources.iter().zip(joined.cameras()).zip(&joined.joint.placings).enumerate();
    let rows: Vec<Value> = each
        .map(|(k, ((source, camera), placing))| {
            json!({
                "photo": k + 1, "run": source.name, "camera": SceneCamera::from(&camera),
                "quarter_turns": placing.turn.quarters(), "askew_deg": placing.yaw.to_degrees(),
                "scale": placing.ln_scale.exp(), "origin_m": [placing.x, 0.0, placing.z],
            })
        })
        .collect();
    json!({ "convention": "OpenCV; x_cam = R x_room + t", "cameras": rows })
}

fn join_json(joined: &Joined<'_>, seen: &SeenShare) -> Value {
    let name = |run: usize| &joined.sources[run].name;
    let things: Vec<Value> = joined
        .things
        .iter()
        .map(|t| {
            let members: Vec<Value> = t
                .track
                .objects(joined.sources)
                .map(|(run, o)| json!({ "run": name(run), "id": o.object.id }))
                .collect();
            json!({
                "id": t.object.id, "of": members, "shape_from": name(t.from.0),
                "sigma_m": t.sigma_m, "apart_m": t.apart_m,
            })
        })
        .collect();
    let links: Vec<Value> = joined
        .links
        .iter()
        .map(|link| {
            let best = link.pairing.best.as_ref();
            json!({
                "runs": link.runs.map(name), "odds_nats": best.map(|b| b.odds), "lead_nats": link.pairing.lead,
                "things_in_common": best.map(|b| b.pairs.len()), "things_missing": best.map(|b| b.missing),
            })
        })
        .collect();
    json!({
        "runs": joined.sources.iter().map(|s| &s.name).collect::<Vec<_>>(),
        "links": links, "placings": joined.joint.placings, "energy_nats": joined.joint.energy,
        "objects": things, "dropped": joined.dropped, "left_out": joined.left_out, "faces": joined.faces, "seen_share": seen,
    })
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

fn report(joined: &Joined<'_>, scene: &Scene, seen: &SeenShare, title: &str) -> ReportData {
    let e = scene.room.extents;
    let several = joined.things.iter().filter(|t| t.track.members.len() > 1).count();
    let objects = joined
        .things
        .iter()
        .map(|t| {
            let runs: Vec<&str> = t.track.members.iter().map(|m| joined.sources[m.0].name.as_str()).collect();
            let facts = vec![
                Fact::new("seen in", runs.join(", ")),
                Fact::new("shape and look from", joined.sources[t.from.0].name.clone()),
                Fact::new("place known to", format!("{:.0} mm", 1000.0 * t.sigma_m)),
                Fact::new("runs differ by at most", format!("{:.0} mm", 1000.0 * t.apart_m)),
            ];
            (t.object.id.clone(), ObjectReport { facts, ..ObjectReport::default() })
        })
        .collect();
    let mut facts = vec![
        Fact::new("program", GENERATOR),
        Fact::new("photos", joined.sources.len().to_string()),
        Fact::new("things seen in several photos", format!("{several} of {}", joined.things.len())),
        Fact::new("surface of the objects that a photo shows", percent(seen.objects)),
        Fact::new("the first photo alone", percent(seen.objects_by_photo.first().copied().unwrap_or(0.0))),
        Fact::new("surface of the room that a photo shows", percent(seen.room)),
        Fact::new("the first photo alone ", percent(seen.room_by_photo.first().copied().unwrap_or(0.0))),
    ];
    for link in joined.links {
        let names = link.runs.map(|r| joined.sources[r].name.as_str());
        if let Some(best) = &link.pairing.best {
            let text = format!(
                "{:.0} nats for one room, {:.0} before the next way, {} things in common",
                best.odds,
                link.pairing.lead,
                best.pairs.len()
            );
            facts.push(Fact::new(format!("{} and {}", names[0], names[1]), text));
        }
    }
    let pictures = (1..joined.sources.len())
        .flat_map(|k| {
            let photo = photo_file(&joined.sources[k].folder);
            let extension = photo.and_then(|p| Some(p.extension()?.to_string_lossy().into_owned()));
            let beside = extension.map(|e| ReportPicture {
                title: format!("photo {}", k + 1),
                path: format!("inputs/photo_{}.{e}", k + 1),
                comparable: false,
            });
            let drawn = ReportPicture {
                title: format!("the scene from photo {}", k + 1),
                path: format!("render_photo_{}.png", k + 1),
                comparable: false,
            };
            beside.into_iter().chain([drawn])
        })
        .collect();
    ReportData {
        title: title.to_owned(),
        profile: "joined".to_owned(),
        facts,
        phases: vec![PhaseReport {
            name: PHASE.to_owned(),
            status: PhaseStatus::Done,
            seconds: 0.0,
            outcome: format!("{} things from {} runs", joined.things.len(), joined.sources.len()),
            ..PhaseReport::default()
        }],
        pictures,
        objects,
        dropped: joined
            .dropped
            .iter()
            .map(|d| DroppedObject {
                label: format!("{} of {}", d.id, d.run),
                phase: PHASE.to_owned(),
                reason: d.reason.clone(),
            })
            .collect(),
        room: Evidence {
            method: format!("all walls of {} runs together", joined.sources.len()),
            facts: vec![
                Fact::new("size W x D x H", format!("{:.2} x {:.2} x {:.2} m", e.width, e.depth, e.height)),
                Fact::new("faces seen", scene.room.seen.iter().map(|s| s.name()).collect::<Vec<_>>().join(", ")),
            ],
            ..Evidence::default()
        },
        camera: Evidence { method: "all photos together".to_owned(), ..Evidence::default() },
        ..ReportData::default()
    }
}

/// `run.json`: nothing was asked; who played is who played in the runs.
#[expect(clippy::default_trait_access, reason = "the bill is a type of a crate that joining does not know")]
fn run_file(out: &Path, joined: &Joined<'_>) -> Result<RunFile, JoinError> {
    let files: Vec<(String, Option<RunFile>)> =
        joined.sources.iter().map(|s| (s.name.clone(), RunFile::read(&s.folder))).collect();
    let mut cast = Vec::new();
    for card in files.iter().filter_map(|(_, f)| f.as_ref()).flat_map(|f| &f.cast) {
        if !cast.contains(card) {
            cast.push(card.clone());
        }
    }
    let joined_from: Vec<JoinedRun> = files
        .iter()
        .map(|(name, file)| JoinedRun {
            name: name.clone(),
            inputs: file.as_ref().map_or_else(String::new, |f| f.inputs.clone()),
        })
        .collect();
    let text = serde_json::to_string(&joined_from).map_err(|source| JoinError::Encode { source })?;
    let done = PhaseEntry { state: PhaseState::Done, outcome: "done".to_owned(), hint: None, time: None };
    Ok(RunFile {
        generator: GENERATOR.to_owned(),
        profile: "joined".to_owned(),
        inputs: blake3::hash(text.as_bytes()).to_hex().to_string(),
        answers: String::new(),
        phases: BTreeMap::from([(PHASE.to_owned(), done)]),
        cast,
        settings: files.iter().find_map(|(_, f)| Some(f.as_ref()?.settings.clone())).unwrap_or_default(),
        objects: joined.things.len(),
        questions_per_object: 0.0,
        looks: Vec::new(),
        bill: Default::default(),
        plausibility: Vec::new(),
        joined_from,
        files: hash_files(out),
    })
}
