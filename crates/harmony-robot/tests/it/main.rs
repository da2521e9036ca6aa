//! Robots of the MuJoCo Menagerie in a small study: tasks, what they say when geometry forbids them, and MuJoCo's opinion.
//!
//! The models are not part of the project: `tools/setup.sh robots` installs them; without them these tests are skipped.
#![expect(clippy::unwrap_used, reason = "tests, helpers included")]

mod room;

use std::path::{Path, PathBuf};
use std::process::Command;

use harmony_export::World;
use harmony_physics::pictures::Lit;
use harmony_robot::lit::LitMotion;
use harmony_robot::pictures::Painter;
use harmony_robot::{Job, Model, Output, RobotError, Surroundings, affordances, jaw::Jaw, perform, write};
use harmony_scene::ImageSize;
use room::{Study, study};

fn cache() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    set("HARMONY_CACHE").or_else(|| set("HOME").map(|home| home.join(".cache").join("harmony")))
}

/// A robot's model file, or a skip.
fn robot(name: &str) -> Option<PathBuf> {
    let path = cache()?.join("robots").join(name).join(format!("{name}.xml"));
    if path.is_file() {
        return Some(path);
    }
    harmony_testing::skip(format!("the model of {name} is not installed (tools/setup.sh robots)"));
    None
}

/// The Python with MuJoCo, or a skip.
fn mujoco() -> Option<PathBuf> {
    let python = cache()?.join("checkers").join("bin").join("python");
    if Command::new(&python).args(["-c", "import mujoco"]).output().is_ok_and(|o| o.status.success()) {
        return Some(python);
    }
    harmony_testing::skip("MuJoCo is not installed (tools/setup.sh)");
    None
}

fn output(folder: &Path) -> Output {
    Output { folder: folder.to_owned(), hulls: Some(folder.join("hulls")), size: ImageSize::new(160, 120), pictures: 3 }
}

/// What MuJoCo measures of a motion's files.
fn replayed(python: &Path, folder: &Path, task: &str, touching: &str, original: &Path) -> serde_json::Value {
    let found = Command::new(python)
        .arg(harmony_testing::root().join("tools/robot_replay.py"))
        .arg(folder.join(format!("mjcf/{task}.xml")))
        .arg(folder.join("trajectory.json"))
        .args(["--touching", touching, "--original"])
        .arg(original)
        .output()
        .unwrap();
    assert!(found.status.success(), "{}", String::from_utf8_lossy(&found.stderr));
    serde_json::from_slice(&found.stdout).unwrap()
}

#[test]
fn the_panda_draws_a_chair_by_its_backrest_and_mujoco_finds_the_same() {
    let Some(path) = robot("panda") else { return };
    let model = Model::read(&path).unwrap();
    assert_eq!((model.joints.len(), model.floating), (9, false));
    let jaw = Jaw::of(&model).unwrap();
    assert!((jaw.size.opening_m - 0.08).abs() < 1e-9, "{:?}", jaw.size);
    let run = study(&Study::default());
    let world = World::read(run.path()).unwrap();
    let room = Surroundings::new(&world);
    let done = perform(&world, &room, &model, Job::DrawChair, None).unwrap();
    let e = &done.evidence;
    assert_eq!((e.frames, e.failed_frames), (140, 0), "{e:?}");
    assert!(e.smallest_clearance_m >= 0.0 && e.smallest_margin >= 0.0, "{e:?}");
    assert!(e.largest_gap_m < 1e-3 && e.deepest_touch_m < 1e-3, "both fingers touch: {e:?}");
    let m = &done.measured;
    assert!((m["grasp_thickness_m"] - 0.03).abs() < 1e-4 && m["fingertip_off_its_line_m"] < 2e-3, "{m:?}");
    assert!((m["jaw_closed_to_m"] - 0.03).abs() < 2e-3, "{m:?}");
    let last = done.motion.frames.last().unwrap().moved.translation;
    assert!((last.length() - 0.45).abs() < 1e-9 && last.z > 0.4, "away from the desk: {last}");
    let out = tempfile::tempdir().unwrap();
    write(&world, &room, &done, &output(out.path())).unwrap();
    assert!(out.path().join("sheet.png").is_file());
    let Some(python) = mujoco() else { return };
    let found = replayed(&python, out.path(), "draw-chair", "left_finger,right_finger", &path);
    assert_eq!(found["frames"], 140);
    assert!(found["over_limits"].as_f64().unwrap() < 1e-6, "{found}");
    assert!(found["links_apart"].as_f64().unwrap() < 1e-4, "the kinematics are those of the model file: {found}");
    assert!(found["height_spread"].as_f64().unwrap() < 2e-3, "{found}");
    assert!(found["deepest"]["distance"].as_f64().unwrap() > -1e-3, "{found}");
    assert!(found["deepest_touch"]["distance"].as_f64().unwrap() > -2e-3, "{found}");
}

#[test]
fn the_panda_picks_what_is_thin_enough_and_says_of_the_rest_why_not() {
    let Some(path) = robot("panda") else { return };
    let model = Model::read(&path).unwrap();
    let run = study(&Study::default());
    let world = World::read(run.path()).unwrap();
    let room = Surroundings::new(&world);
    let done = perform(&world, &room, &model, Job::Pick, Some("vase_01")).unwrap();
    assert!(done.evidence.smallest_clearance_m >= 0.0 && done.evidence.failed_frames == 0, "{:?}", done.evidence);
    assert!((done.motion.frames.last().unwrap().moved.translation.y - 0.2).abs() < 1e-9);
    let wide = perform(&world, &room, &model, Job::Pick, Some("box_01")).err().unwrap();
    let said = wide.to_string();
    assert!(matches!(wide, RobotError::Forbidden { .. }) && said.contains("150 mm across"), "{said}");
    assert!(matches!(perform(&world, &room, &model, Job::Pick, Some("cup_09")), Err(RobotError::Nothing { .. })));
    let found = affordances(&world, &room, &Jaw::of(&model).unwrap().size);
    let of = |id: &str| found.iter().find(|a| a.id == id).unwrap();
    assert!(of("vase_01").grasp.possible && !of("box_01").grasp.possible);
    assert!(of("chair_01").sit.possible && of("chair_01").grasp.possible, "{:?}", of("chair_01"));
    assert!(of("desk_01").place.possible && !of("desk_01").sit.possible);
}

#[test]
fn what_forbids_a_task_is_told_with_its_number() {
    let Some(path) = robot("panda") else { return };
    let model = Model::read(&path).unwrap();
    let said = |study_of: &Study| {
        let run = study(study_of);
        let world = World::read(run.path()).unwrap();
        perform(&world, &Surroundings::new(&world), &model, Job::DrawChair, None).err().unwrap()
    };
    let thick = said(&Study { back_m: 0.12, ..Study::default() }).to_string();
    assert!(thick.contains("120 mm across") && thick.contains("80 mm"), "{thick}");
    let blocked = said(&Study { wall_behind_m: Some(0.2), ..Study::default() }).to_string();
    assert!(blocked.contains("bookshelf_01") && blocked.contains("0.45 m"), "{blocked}");
    let none = said(&Study { chair: false, ..Study::default() });
    assert!(matches!(&none, RobotError::Nothing { what } if what == "chair"), "{none}");
}

/// What usd-core reads of a motion's layer, and how far it is from the trajectory and from MuJoCo.
fn staged(python: &Path, folder: &Path, task: &str) -> serde_json::Value {
    let found = Command::new(python)
        .arg(harmony_testing::root().join("tools/usd_motion.py"))
        .arg(folder.join(format!("usd/{task}.usda")))
        .arg(folder.join("trajectory.json"))
        .arg("--mjcf")
        .arg(folder.join(format!("mjcf/{task}.xml")))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&found.stdout);
    assert!(found.status.success(), "{said} {}", String::from_utf8_lossy(&found.stderr));
    serde_json::from_str(&said).unwrap()
}

#[test]
fn the_panda_opens_a_drawer_by_its_handle_and_mujoco_and_usd_find_the_same() {
    let Some(path) = robot("panda") else { return };
    let model = Model::read(&path).unwrap();
    let run = study(&Study { dresser_m: Some(3.0), ..Study::default() });
    let world = World::read(run.path()).unwrap();
    let room = Surroundings::new(&world);
    let done = perform(&world, &room, &model, Job::OpenDrawer, Some("dresser_01")).unwrap();
    let (e, m) = (&done.evidence, &done.measured);
    assert_eq!((e.frames, e.failed_frames), (140, 0), "{e:?}");
    assert!(e.smallest_clearance_m >= 0.0 && e.largest_gap_m < 1e-3 && e.deepest_touch_m < 1e-3, "{e:?}");
    // The template's bars stand 22 mm before the front and are 10 mm thick.
    assert!((m["handle_proud_m"] - 0.0216).abs() < 1e-3 && (m["grasp_thickness_m"] - 0.0096).abs() < 1e-3, "{m:?}");
    assert!(
        m["opened_m"] > 0.25 * m["joint_limit_m"] - 1e-9 && (m["joint_limit_m"] - 0.7 * 0.45).abs() < 0.03,
        "{m:?}"
    );
    let last = done.motion.frames.last().unwrap();
    let out = glam::DVec3::X * m["opened_m"];
    assert!(last.moved.translation.distance(out) < 1e-9 && (last.opened - m["opened_m"]).abs() < 1e-12, "{last:?}");
    let folder = tempfile::tempdir().unwrap();
    write(&world, &room, &done, &output(folder.path())).unwrap();
    let Some(python) = mujoco() else { return };
    let found = replayed(&python, folder.path(), "open-drawer", "left_finger,right_finger", &path);
    assert_eq!(found["frames"], 140);
    assert!(found["over_limits"].as_f64().unwrap() < 1e-5 && found["links_apart"].as_f64().unwrap() < 1e-4, "{found}");
    assert!(found["deepest"]["distance"].as_f64().unwrap() > -0.011, "{found}");
    let found = staged(&python, folder.path(), "open-drawer");
    assert_eq!((found["frames"].as_u64(), found["links"].as_u64()), (Some(140), Some(model.links.len() as u64)));
    assert_eq!(found["kinematic"], serde_json::json!([room.things[done.motion.object].id]), "{found}");
}

#[test]
fn a_drawer_that_meets_something_is_told_with_its_way() {
    let Some(path) = robot("panda") else { return };
    let run = study(&Study { dresser_m: Some(0.1), ..Study::default() });
    let world = World::read(run.path()).unwrap();
    let room = Surroundings::new(&world);
    let model = Model::read(&path).unwrap();
    let said = perform(&world, &room, &model, Job::OpenDrawer, None).err().unwrap().to_string();
    assert!(said.contains("it meets bookshelf_02 after 0.0") && said.contains("its joint allows 0.3"), "{said}");
    let said = perform(&world, &room, &model, Job::OpenDrawer, Some("desk_01")).err().unwrap().to_string();
    assert!(said.contains("desk_01 cannot be opened"), "{said}");
}

/// Joints that move faster between two frames than the H1's can, with the frame and the radians. Speeds are those of the
/// maker's own description (unitree_ros, `h1_description/urdf/h1.urdf`), rad/s; the MJCF file has none.
fn too_fast(motion: &harmony_robot::motion::Motion) -> Vec<(String, usize, f64)> {
    let most = |name: &str| match name {
        n if n.contains("hip") || n == "torso" => 23.0,
        n if n.contains("knee") => 14.0,
        n if n.contains("shoulder_yaw") || n.contains("elbow") => 20.0,
        _ => 9.0,
    };
    let mut out = Vec::new();
    for (k, pair) in motion.frames.windows(2).enumerate() {
        for (j, joint) in motion.model.joints.iter().enumerate() {
            let step = (pair[1].posture.joints[j] - pair[0].posture.joints[j]).abs();
            if step > most(&joint.name) / f64::from(harmony_robot::motion::FRAMES_PER_SECOND) {
                out.push((joint.name.clone(), k + 1, step));
            }
        }
    }
    out
}

#[test]
fn the_h1_sits_down_at_the_desk_and_mujoco_finds_the_same() {
    let Some(path) = robot("h1") else { return };
    let model = Model::read(&path).unwrap();
    assert_eq!((model.joints.len(), model.floating), (19, true));
    assert!((model.mass() - 51.4).abs() < 0.3, "{}", model.mass());
    let run = study(&Study::default());
    let world = World::read(run.path()).unwrap();
    let room = Surroundings::new(&world);
    let done = perform(&world, &room, &model, Job::Sit, None).unwrap();
    let (e, m) = (&done.evidence, &done.measured);
    assert_eq!((e.frames, e.failed_frames), (230, 0), "{e:?}");
    assert!(e.smallest_clearance_m > -0.01 && e.smallest_margin >= 0.0, "{e:?}");
    for (name, most) in [
        ("hands_to_backrest_m", 0.01),
        ("hands_to_desk_m", 0.01),
        ("thighs_to_seat_m", 0.01),
        ("deepest_in_seat_m", 0.01),
        ("feet_off_floor_m", 0.002),
    ] {
        assert!(m[name] <= most, "{name}: {m:?}");
    }
    assert!(m["balance_margin_m"] > 0.0, "{m:?}");
    let hasty = too_fast(&done.motion);
    assert!(hasty.is_empty(), "{hasty:?}");
    let out = tempfile::tempdir().unwrap();
    write(&world, &room, &done, &output(out.path())).unwrap();
    let Some(python) = mujoco() else { return };
    let seated = "pelvis,left_hip_yaw_link,left_hip_roll_link,left_hip_pitch_link,right_hip_yaw_link,right_hip_roll_link,\
                  right_hip_pitch_link,left_elbow_link,right_elbow_link";
    let found = replayed(&python, out.path(), "sit", seated, &path);
    assert_eq!(found["frames"], 230);
    assert!(found["over_limits"].as_f64().unwrap() < 1e-6, "{found}");
    assert!(found["links_apart"].as_f64().unwrap() < 1e-4, "{found}");
    assert!(found["deepest"]["distance"].as_f64().unwrap() > -0.011, "{found}");
    assert!(found["deepest_touch"]["distance"].as_f64().unwrap() > -0.011, "{found}");
    let feet = &found["lowest_foot"];
    assert!(feet[0].as_f64().unwrap() > -0.002 && feet[1].as_f64().unwrap() < 0.002, "{found}");
}

#[test]
fn a_robot_for_another_task_and_files_that_lack_something_are_named() {
    let (Some(panda), Some(h1)) = (robot("panda"), robot("h1")) else { return };
    let run = study(&Study::default());
    let world = World::read(run.path()).unwrap();
    let room = Surroundings::new(&world);
    let said = perform(&world, &room, &Model::read(&h1).unwrap(), Job::DrawChair, None).err().unwrap();
    assert!(matches!(said, RobotError::NotThisRobot { .. }), "{said}");
    let said = perform(&world, &room, &Model::read(&panda).unwrap(), Job::Sit, None).err().unwrap();
    assert!(said.to_string().contains("left_ankle_link"), "{said}");
    // The XML without its meshes.
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("panda.xml");
    std::fs::copy(&panda, &copy).unwrap();
    let said = Model::read(&copy).unwrap_err();
    assert!(matches!(&said, RobotError::NoMesh { path, .. } if path.starts_with(folder.path())), "{said}");
}

#[test]
fn frames_of_a_task_are_path_traced_with_the_robot_in_its_colours() {
    let Some(path) = robot("panda") else { return };
    let (found, why) = harmony_lighting::CyclesRenderer::find_saying_why();
    let Some(renderer) = found else {
        return harmony_testing::skip(format_args!("no Blender here ({})", why.join("; ")));
    };
    let model = Model::read(&path).unwrap();
    let run = study(&Study::default());
    let world = World::read(run.path()).unwrap();
    let room = Surroundings::new(&world);
    let done = perform(&world, &room, &model, Job::DrawChair, None).unwrap();
    let painter = Painter::new(&world, &room, &done.motion, ImageSize::new(160, 120));
    let kept = run.path().join("7_world/lit");
    let lit = Lit { renderer: &renderer, scene: &world.scene, albedo: None, samples: 8, kept: Some(kept.clone()) };
    let traced = LitMotion::new(&world, &done.motion, &painter).unwrap();
    let last = done.motion.frames.len() - 1;
    let frames = [0, last].map(|number| traced.frame(&lit, number).unwrap());
    // Who asks again gets what is kept, each frame its own: here pictures that Blender would not make.
    let names: Vec<_> = std::fs::read_dir(&kept).unwrap().map(|e| e.unwrap().path()).collect();
    assert_eq!(names.len(), 2);
    for name in &names {
        image::RgbImage::from_pixel(3, 2, image::Rgb([9, 8, 7])).save(name).unwrap();
    }
    assert_eq!(traced.frame(&lit, last).unwrap().dimensions(), (3, 2));
    if let Some(kept) = std::env::var_os("HARMONY_TEST_OUT") {
        for (k, frame) in frames.iter().enumerate() {
            frame.save(Path::new(&kept).join(format!("robot_lit_{k}.png"))).unwrap();
            painter.frame([0, last][k]).save(Path::new(&kept).join(format!("robot_even_{k}.png"))).unwrap();
        }
    }
    // What differs between the frames is what moved, in both renderers.
    let differs = |a: &image::RgbImage, b: &image::RgbImage| -> Vec<bool> {
        a.pixels().zip(b.pixels()).map(|(p, q)| (0..3).any(|k| p[k].abs_diff(q[k]) > 12)).collect()
    };
    let moved = differs(&frames[0], &frames[1]);
    let even = differs(&painter.frame(0), &painter.frame(last));
    let both = moved.iter().zip(&even).filter(|(a, b)| **a && **b).count();
    let one = even.iter().filter(|d| **d).count();
    assert!(one > 300, "robot and chair move in the even pictures: {one} pixels");
    assert!(both as f64 > 0.5 * one as f64, "{both} of {one} pixels that move do so in the path-traced pictures, too");
}
