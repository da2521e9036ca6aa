//! Renders with a real Blender; each test says so and passes when there is none.

#![expect(clippy::unwrap_used, reason = "a test, helpers included")]

mod support;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Duration;

use harmony_lighting::{
    CyclesJob, CyclesRenderer, FitOptions, LitError, RenderMode, assess, fit_lights, neutral_field, relight,
};
use harmony_render::{Instance, RenderOptions};
use harmony_scene::{AlbedoCells, Lighting, ViewTransform};
use harmony_testing::skip;
use support::{ROOM, camera, lighting, nodes, write_glb};

fn renderer() -> Option<&'static CyclesRenderer> {
    static FOUND: OnceLock<(Option<CyclesRenderer>, Vec<String>)> = OnceLock::new();
    let (found, why) = FOUND.get_or_init(CyclesRenderer::find_saying_why);
    if found.is_none() {
        skip(format_args!("no Blender here ({})", why.join("; ")));
    }
    found.as_ref()
}

struct Fixture {
    _folder: tempfile::TempDir,
    glb: PathBuf,
}

fn scene() -> Fixture {
    let folder = tempfile::tempdir().unwrap();
    let glb = folder.path().join("room.glb");
    write_glb(&nodes(), &glb);
    Fixture { _folder: folder, glb }
}

fn job(fixture: &Fixture, width: u32) -> CyclesJob {
    CyclesJob {
        room: Some(ROOM),
        samples: 8,
        denoise: false,
        delight: None,
        timeout: Duration::from_mins(5),
        ..CyclesJob::lit(&fixture.glb, camera(width), Lighting { view: ViewTransform::Standard, ..lighting() })
    }
}

/// Keeps a picture for a look, when the environment names a folder.
fn keep(name: &str, image: &image::RgbImage) {
    if let Some(folder) = std::env::var_os("HARMONY_TEST_OUT") {
        image.save(PathBuf::from(folder).join(name)).unwrap();
    }
}

#[test]
fn cycles_and_the_rasteriser_see_every_object_at_the_same_pixels() {
    let Some(cycles) = renderer() else { return };
    let fixture = scene();
    let nodes = nodes();
    let ids: BTreeMap<String, u32> = nodes.iter().map(|n| (n.name.to_owned(), n.id)).collect();
    let output = cycles.render(&job(&fixture, 640).ids(ids)).unwrap();
    let theirs = output.ids.unwrap();
    let instances: Vec<Instance> = nodes.iter().map(|n| Instance::in_room(&n.mesh, n.id)).collect();
    let ours = harmony_render::render(&camera(640), &instances, &RenderOptions::default()).ids;
    let mut total = 0.0;
    let mut seen = 0;
    for node in &nodes {
        let both = ours.iter().zip(&theirs).filter(|(a, b)| **a == node.id && **b == node.id).count();
        let either = ours.iter().zip(&theirs).filter(|(a, b)| **a == node.id || **b == node.id).count();
        if either > 0 {
            let iou = both as f64 / either as f64;
            assert!(iou > 0.97, "{}: {iou}", node.name);
            total += iou;
            seen += 1;
        }
    }
    assert!(seen >= 9, "most objects are in view");
    assert!(total / f64::from(seen) > 0.98, "{}", total / f64::from(seen));
}

#[test]
fn light_adds_up_and_each_source_reaches_the_room() {
    let Some(cycles) = renderer() else { return };
    let fixture = scene();
    let mut job = CyclesJob { samples: 32, ..job(&fixture, 160) };
    // Highlights clip in the 8-bit picture: keep everything below.
    job.lighting.exposure = -3.0;
    let lit = cycles.render(&job).unwrap();
    let passes = cycles.render(&CyclesJob { mode: RenderMode::PerLight, ..job.clone() }).unwrap().lights;
    let names: Vec<Option<&str>> = passes.iter().map(|p| p.light.as_deref()).collect();
    assert_eq!(names, [Some("window_01"), Some("lamp_01"), None]);
    for pass in &passes {
        let mean = pass.image.rgb.iter().map(|p| p[1]).sum::<f32>() / pass.image.rgb.len() as f32;
        assert!(mean > 0.01, "{:?} gives {mean}", pass.light);
    }
    let sum = relight(&passes, &[[2f64.powi(-3); 3]; 3]);
    let picture = lit.response.to_picture(&sum);
    let found = assess(&lit.image.unwrap(), &picture, None);
    assert!(found.error <= 0.1, "{found:?}");
}

#[test]
fn what_shines_by_its_material_lights_the_room_from_where_it_is() {
    let Some(cycles) = renderer() else { return };
    let folder = tempfile::tempdir().unwrap();
    let fixture = Fixture { glb: folder.path().join("room.glb"), _folder: folder };
    let all: Vec<support::Node> = nodes().into_iter().chain([support::cove()]).collect();
    write_glb(&all, &fixture.glb);
    let mut job = CyclesJob { samples: 32, mode: RenderMode::PerLight, ..job(&fixture, 120) };
    job.lighting.ambient_intensity = 0.0;
    job.lighting.lights.truncate(1);
    let light = &mut job.lighting.lights[0];
    // As `lights_from_scene` lists it: a rectangle below, which would light the floor.
    (light.id, light.object) = ("cove_01".to_owned(), Some(harmony_scene::ObjectId::new("cove_01").unwrap()));
    (light.position, light.intensity) = ([2.0, 2.26, 0.8], 30.0);
    light.kind = harmony_scene::LightKind::Area { direction: [0.0, -1.0, 0.0], size_m: [1.8, 0.1] };
    let ids: BTreeMap<String, u32> = all.iter().map(|n| (n.name.to_owned(), n.id)).collect();
    job.node_ids.clone_from(&ids);
    let image = cycles.render(&job).unwrap().lights.remove(0).image;
    let seen = cycles.render(&CyclesJob { denoise: false, ..job.ids(ids) }).unwrap().ids.unwrap();
    let mean = |id: u32, albedo: f32| {
        let of: Vec<f32> = image.rgb.iter().zip(&seen).filter(|(_, i)| **i == id).map(|(p, _)| p[1]).collect();
        assert!(of.len() > 50, "{} pixels of {id}", of.len());
        of.iter().sum::<f32>() / of.len() as f32 / albedo
    };
    let (ceiling, floor) = (mean(2, 0.8), mean(1, 0.22));
    assert!(ceiling > 3.0 * floor && floor > 0.0, "ceiling {ceiling}, floor {floor}");
}

#[test]
fn a_windows_daylight_falls_into_the_room_and_not_on_its_own_frame() {
    let Some(cycles) = renderer() else { return };
    let folder = tempfile::tempdir().unwrap();
    let fixture = Fixture { glb: folder.path().join("room.glb"), _folder: folder };
    let others = nodes().into_iter().filter(|n| n.name != "window_01");
    let all: Vec<support::Node> = others.chain([support::window_frame()]).collect();
    write_glb(&all, &fixture.glb);
    let ids: BTreeMap<String, u32> = all.iter().map(|n| (n.name.to_owned(), n.id)).collect();
    let mut job = CyclesJob { samples: 32, mode: RenderMode::PerLight, ..job(&fixture, 160) };
    job.lighting.ambient_intensity = 0.0;
    job.lighting.lights.truncate(1);
    job.node_ids.clone_from(&ids);
    let seen = cycles.render(&job.clone().ids(ids)).unwrap().ids.unwrap();
    let means = |job: &CyclesJob| {
        let image = cycles.render(job).unwrap().lights.remove(0).image;
        [14, 1].map(|id| {
            let of: Vec<f32> = image.rgb.iter().zip(&seen).filter(|(_, i)| **i == id).map(|(p, _)| p[1]).collect();
            assert!(of.len() > 40, "{} pixels of {id}", of.len());
            of.iter().sum::<f32>() / of.len() as f32
        })
    };
    let [frame, floor] = means(&job);
    // The same light as nobody's.
    job.lighting.lights[0].object = None;
    let [burnt, same_floor] = means(&job);
    assert!(frame < 0.25 * burnt, "the frame is at {frame}, by another's light at {burnt}");
    assert!((floor / same_floor - 1.0).abs() < 0.15, "the floor is at {floor} and {same_floor}");
}

#[test]
fn what_lies_a_fifth_of_a_millimetre_above_is_on_top_and_shared_planes_are_not_black() {
    let Some(cycles) = renderer() else { return };
    let folder = tempfile::tempdir().unwrap();
    let fixture = Fixture { glb: folder.path().join("room.glb"), _folder: folder };
    let all: Vec<support::Node> = nodes().into_iter().chain([support::layered_rug()]).collect();
    write_glb(&all, &fixture.glb);
    let ids: BTreeMap<String, u32> = all.iter().map(|n| (n.name.to_owned(), n.id)).collect();
    let job = CyclesJob { samples: 32, ..job(&fixture, 160) };
    let picture = cycles.render(&job).unwrap().image.unwrap();
    keep("layers.png", &picture);
    let seen = cycles.render(&job.ids(ids)).unwrap().ids.unwrap();
    let rug: Vec<[u8; 3]> = picture
        .pixels()
        .zip(0..seen.len())
        .filter(|(_, i)| seen[*i] == 18 && is_interior(&seen, *i))
        .map(|(p, _)| p.0)
        .collect();
    assert!(rug.len() > 100, "{} pixels", rug.len());
    let green = rug.iter().filter(|p| p[1] > 40 && p[1] > 2 * p[0]).count();
    assert!(green * 100 >= rug.len() * 98, "{green} of {} are green", rug.len());
}

/// The module checks itself: pieces of a frame that share planes, one of them grown by a program beforehand.
#[test]
fn faces_in_one_plane_come_apart_and_no_others_move() {
    let Some(renderer) = renderer() else { return };
    let folder = tempfile::tempdir().unwrap();
    let script = include_str!("../blender/apart.py");
    let said = renderer.run_script(script, &serde_json::json!({}), folder.path(), std::time::Duration::from_mins(1));
    assert!(said.unwrap().contains("faces come apart"));
}

#[test]
fn a_closed_shade_lets_the_bulb_out() {
    let Some(cycles) = renderer() else { return };
    let fixture = scene();
    let mut job = job(&fixture, 120);
    job.mode = RenderMode::PerLight;
    job.lighting.lights.remove(0);
    job.lighting.ambient_intensity = 0.0;
    let level = |job: &CyclesJob| {
        let passes = cycles.render(job).unwrap().lights;
        // Away from the lamp itself: the left half of the image.
        let image = &passes[0].image;
        let left = image.rgb.iter().enumerate().filter(|(i, _)| i % 120 < 60).map(|(_, p)| p[1]);
        left.sum::<f32>() / (image.rgb.len() / 2) as f32
    };
    let with_shade = level(&job);
    job.lighting.lights[0].object = None;
    let blocked = level(&job);
    assert!(with_shade > 0.02, "{with_shade}");
    assert!(blocked < with_shade * 0.05, "without its object the shade is opaque: {blocked} of {with_shade}");
}

#[test]
fn the_fit_finds_the_light_of_a_rendered_photo() {
    let Some(cycles) = renderer() else { return };
    let fixture = scene();
    let mut truth = CyclesJob { samples: 48, denoise: true, ..job(&fixture, 160) };
    truth.lighting.view = ViewTransform::Agx;
    truth.lighting.lights[0].intensity *= 0.3;
    truth.lighting.lights[1].intensity *= 2.5;
    truth.lighting.lights[1].color = [1.0, 0.65, 0.35];
    truth.lighting.ambient_intensity *= 0.5;
    let rendered = cycles.render(&truth).unwrap();
    let photo = rendered.image.unwrap();
    keep("fit_photo.png", &photo);

    let start = CyclesJob { lighting: lighting(), ..truth.clone() };
    let output = cycles.render(&CyclesJob { mode: RenderMode::PerLight, samples: 32, ..start.clone() }).unwrap();
    let light = output.response.to_linear(&photo);
    let fit = fit_lights(&output.lights, &light, &[], &FitOptions::default()).unwrap();
    let mut fitted = lighting();
    fit.apply(&mut fitted);
    let again = cycles.render(&CyclesJob { lighting: fitted.clone(), ..start.clone() }).unwrap().image.unwrap();
    let before = cycles.render(&start).unwrap().image.unwrap();
    keep("fit_before.png", &before);
    keep("fit_after.png", &again);
    let (before, after) = (assess(&photo, &before, None), assess(&photo, &again, None));
    assert!(after.matches(), "{after:?}");
    assert!(after.error < before.error * 0.35, "{} to {}", before.error, after.error);
    for (got, want) in fitted.lights.iter().zip(&truth.lighting.lights) {
        let ratio = got.intensity / want.intensity;
        assert!((0.7..1.4).contains(&ratio), "{}: {} W, {} W in truth", got.id, got.intensity, want.intensity);
    }
    assert!(fitted.lights[1].color[2] < 0.5, "the lamp is warmer than assumed: {:?}", fitted.lights[1].color);
}

#[test]
fn a_field_lies_where_the_photo_saw_and_a_measurement_tells_nodes_and_views() {
    let Some(cycles) = renderer() else { return };
    let fixture = scene();
    let mut job = CyclesJob { mode: RenderMode::PerLight, samples: 16, ..job(&fixture, 160) };
    let ids = [("back", 1), ("floor", 2), ("bed_01/frame", 3), ("bed_01/cover", 4)];
    job.node_ids = ids.map(|(name, id)| (name.to_owned(), id)).into();
    job.views = ViewTransform::ALL.to_vec();
    let plain = cycles.render(&job).unwrap();
    let ids = plain.ids.unwrap();
    assert!(ids.iter().filter(|id| **id == 1).count() > 500 && ids.contains(&2));
    assert!([3, 4].map(|part| ids.iter().filter(|id| **id == part).count()).iter().all(|n| *n > 100));
    assert_eq!(plain.views.iter().map(|v| v.view).collect::<Vec<_>>(), ViewTransform::ALL);
    // Blender's own numbers: Standard is sRGB, AgX shows 18 % grey darker than that.
    for table in &plain.views {
        let shown = table.shown([0.18; 3])[0];
        match table.view {
            ViewTransform::Standard => assert!((shown - 0.461).abs() <= 0.003, "{shown}"),
            _ => assert!((0.2..0.6).contains(&shown), "{:?} {shown}", table.view),
        }
    }
    let mut field = neutral_field(&job.camera);
    // Half of the reflectance on the right of the image, on the back wall alone.
    let half = |i: u32| if i % field.columns < field.columns / 2 { [1.0; 3] } else { [0.5; 3] };
    let cells =
        AlbedoCells { mean: [1.0; 3], factors: (0..field.columns * field.rows).map(half).collect(), gloss: 1.0 };
    field.nodes.insert("back".to_owned(), cells);
    // And a quarter of the bed's cover, whose frame stays.
    field.nodes.insert("bed_01/cover".to_owned(), AlbedoCells { mean: [0.25; 3], factors: Vec::new(), gloss: 0.3 });
    job.albedo = Some(field.into());
    let scaled = cycles.render(&job).unwrap();
    let (before, after) = (plain.albedo.unwrap(), scaled.albedo.unwrap());
    for (i, id) in ids.iter().enumerate().filter(|(_, id)| **id != 0) {
        let x = i % 160;
        let want = match id {
            1 if x >= 90 => 0.5,
            4 => 0.25,
            _ => 1.0,
        };
        if !(70..90).contains(&x) && is_interior(&ids, i) {
            let ratio = after.rgb[i][1] / before.rgb[i][1].max(1e-3);
            assert!((ratio - want).abs() <= 0.06, "node {id} at {x}: {ratio}, {want} wanted");
        }
    }
}

/// Whether all pixels within two of a pixel show the same node: the pixel filter is wider than a pixel.
fn is_interior(ids: &[u32], i: usize) -> bool {
    let offsets = (-2..=2_isize).flat_map(|y| (-2..=2_isize).map(move |x| y * 160 + x));
    offsets.map(|o| i.checked_add_signed(o).and_then(|j| ids.get(j))).all(|id| id == Some(&ids[i]))
}

#[test]
fn walls_can_be_hidden_and_the_same_job_gives_the_same_bytes() {
    let Some(cycles) = renderer() else { return };
    let fixture = scene();
    let mut job = job(&fixture, 120);
    // From above the room, in through the ceiling.
    job.camera = harmony_scene::Camera::looking(
        job.camera.size,
        job.camera.intrinsics,
        glam::DVec3::new(2.0, 7.0, 9.0),
        glam::DVec3::new(0.0, -1.0, -1.1),
    );
    let closed = cycles.render(&job).unwrap().image.unwrap();
    job.hidden_nodes = ["ceiling", "front", "no_such_wall"].map(str::to_owned).to_vec();
    job.background = Some([1.0; 3]);
    let mut steps = Vec::new();
    let open = cycles.render_with(&job, &mut |p| steps.push(p)).unwrap();
    assert!(open.notes.iter().any(|n| n.contains("no_such_wall")));
    assert!(steps.last().is_some_and(|p| p.sample == 8 && p.of == 8), "{steps:?}");
    let picture = open.image.unwrap();
    keep("open.png", &picture);
    assert_ne!(picture, closed);
    // A cupboard up to the ceiling shows its own colour from above.
    let tall: Vec<support::Node> = nodes().into_iter().chain([support::tall_cupboard()]).collect();
    write_glb(&tall, &fixture.glb);
    let with_top = cycles.render(&job).unwrap().image.unwrap();
    let top = job.camera.project(glam::DVec3::new(0.5, 2.59, 0.5)).unwrap();
    let shown = with_top.get_pixel(top.x as u32, top.y as u32).0;
    assert!(shown[0] > 60 && shown[0] > shown[2], "the cupboard's top is {shown:?}");
    write_glb(&nodes(), &fixture.glb);
    assert_eq!(picture.get_pixel(0, 0).0, [255; 3], "white where nothing is");
    assert_eq!(cycles.render(&job).unwrap().image.unwrap(), picture);
}

#[test]
fn boards_along_a_hidden_wall_are_hidden_with_it() {
    let Some(cycles) = renderer() else { return };
    let fixture = scene();
    let boarded: Vec<support::Node> = nodes().into_iter().chain([support::skirting()]).collect();
    write_glb(&boarded, &fixture.glb);
    let mut job = job(&fixture, 240);
    job.camera = harmony_scene::Camera::looking(
        job.camera.size,
        job.camera.intrinsics,
        glam::DVec3::new(2.0, 7.0, 9.0),
        glam::DVec3::new(0.0, -1.0, -1.1),
    );
    let mut dark_in_front = |hidden: &[&str]| {
        job.hidden_nodes = hidden.iter().map(|name| (*name).to_owned()).collect();
        let picture = cycles.render(&job).unwrap().image.unwrap();
        let shown = |point| {
            let at = job.camera.project(point).unwrap();
            picture.get_pixel(at.x as u32, at.y as u32).0
        };
        let [r, g, b] = shown(glam::DVec3::new(0.6, 0.15, 0.03));
        assert!(u32::from(r) > 2 * u32::from(g.max(b)), "the back wall's red board stays");
        // The outer side of the front wall's board, where no light comes; behind it lies the floor.
        shown(glam::DVec3::new(2.0, 0.15, support::ROOM.depth))[0] < 10
    };
    assert!(dark_in_front(&["ceiling", "front"]));
    assert!(!dark_in_front(&["ceiling", "front", "wall_front"]));
}

#[test]
fn failures_say_what_happened() {
    let Some(cycles) = renderer() else { return };
    let fixture = scene();
    let good = job(&fixture, 120);
    let slow = CyclesJob { timeout: Duration::from_millis(300), ..good.clone() };
    assert!(matches!(cycles.render(&slow), Err(LitError::Timeout { .. })));
    let missing = CyclesJob { glb: "no/such/scene.glb".into(), ..good.clone() };
    assert!(matches!(cycles.render(&missing), Err(LitError::NoScene { .. })));
    let broken = fixture.glb.with_file_name("broken.glb");
    std::fs::write(&broken, b"glTF nonsense").unwrap();
    match cycles.render(&CyclesJob { glb: broken, ..good.clone() }) {
        Err(LitError::Failed { log_tail, .. }) => assert!(log_tail.contains("Error"), "{log_tail}"),
        other => panic!("{other:?}"),
    }
    let mut dark = good;
    dark.lighting.ambient_intensity = f64::NAN;
    assert!(matches!(cycles.render(&dark), Err(LitError::BadJob { .. })));
}
