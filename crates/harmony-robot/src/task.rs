//! A task of the command line: done, measured, and as files.

use std::path::{Path, PathBuf};

use harmony_export::{Format, Options, World};
use harmony_io::{write_atomic, write_json};
use harmony_scene::ImageSize;
use image::RgbImage;

use crate::arm;
use crate::model::Model;
use crate::motion::{Done, Trajectory};
use crate::pictures::Painter;
use crate::room::Surroundings;
use crate::{RobotError, drawer, human, replay, stage};

/// What a robot is to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Job {
    /// An arm draws a chair back by its backrest.
    DrawChair,
    /// An arm picks a decoration up.
    Pick,
    /// An arm opens a drawer or a door of furniture.
    OpenDrawer,
    /// A humanoid sits down at the desk.
    Sit,
}

/// How its files are made.
#[derive(Debug, Clone)]
pub struct Output {
    /// Folder.
    pub folder: PathBuf,
    /// Folder in which convex decompositions are kept.
    pub hulls: Option<PathBuf>,
    /// Size of a frame's picture.
    pub size: ImageSize,
    /// Frames of the sheet.
    pub pictures: usize,
}

/// Does a job in a scene.
///
/// # Errors
/// [`RobotError`], with the measurement that forbids it.
pub fn perform(
    world: &World,
    room: &Surroundings,
    model: &Model,
    job: Job,
    object: Option<&str>,
) -> Result<Done, RobotError> {
    let level = |k: usize| {
        let id = &room.things[k].id;
        world.items.iter().find(|i| i.name() == id).map_or(harmony_scene::Level::Furniture, |i| i.object.level)
    };
    match job {
        Job::DrawChair => arm::draw_chair(room, model, object),
        Job::Pick => arm::pick(room, model, object, level),
        Job::OpenDrawer => drawer::open(world, room, model, object),
        Job::Sit => human::sit(room, model, object),
    }
}

/// Writes `trajectory.json`, `mjcf/<task>.xml` and `usd/<task>.usda` beside the scene's own files, `frame_<n>.png` and
/// `sheet.png`.
///
/// # Errors
/// Files that cannot be written, a scene that cannot be exported.
pub fn write(world: &World, room: &Surroundings, done: &Done, output: &Output) -> Result<Trajectory, RobotError> {
    let motion = &done.motion;
    let trajectory = motion.trajectory(room, done.evidence.clone(), done.measured.clone(), done.because.clone());
    write_json(&output.folder.join("trajectory.json"), &trajectory)?;
    let options = Options { cache: output.hulls.clone(), ..Options::default() };
    let files = harmony_export::export(world, &[Format::Mjcf, Format::Usd], &output.folder, &options)?;
    let scene =
        files.iter().find(|(name, _)| *name == "mjcf/scene.xml").map(|(_, bytes)| String::from_utf8_lossy(bytes));
    let scene =
        scene.ok_or_else(|| RobotError::Nothing { what: "mjcf/scene.xml among the exported files".to_owned() })?;
    let made = replay::replay(&scene, room, motion, &done.shapes.hulls())?;
    for (name, bytes) in &made.meshes {
        write_atomic(&output.folder.join("mjcf/assets").join(name), bytes)?;
    }
    write_atomic(&output.folder.join(format!("mjcf/{}.xml", motion.task)), made.xml.as_bytes())?;
    let layer = stage::layer(world, room, motion);
    write_atomic(&output.folder.join(format!("usd/{}.usda", motion.task)), layer.as_bytes())?;
    pictures(world, room, done, output)?;
    Ok(trajectory)
}

fn pictures(world: &World, room: &Surroundings, done: &Done, output: &Output) -> Result<(), RobotError> {
    let motion = &done.motion;
    let painter = Painter::new(world, room, motion, output.size);
    let frames = sheet_frames(&motion.frames.iter().map(|f| f.step).collect::<Vec<_>>(), output.pictures);
    let drawn: Vec<RgbImage> = frames.iter().map(|f| painter.frame(*f)).collect();
    for (picture, number) in drawn.iter().zip(&frames) {
        let path: &Path = &output.folder.join(format!("frame_{number:03}.png"));
        harmony_io::picture::write_rgb_png(path, picture)?;
    }
    let sheet = harmony_physics::pictures::sheet(&drawn);
    harmony_io::picture::write_rgb_png(&output.folder.join("sheet.png"), &sheet)?;
    Ok(())
}

/// The last frame of every step, and evenly spaced ones between until there are as many as are wanted.
fn sheet_frames(steps: &[usize], wanted: usize) -> Vec<usize> {
    let mut out: Vec<usize> = (0..steps.len()).filter(|k| steps.get(k + 1) != Some(&steps[*k])).collect();
    out.insert(0, 0);
    out.dedup();
    while out.len() < wanted.min(steps.len()) {
        // The middle of the longest stretch.
        let Some(at) = (1..out.len()).rev().max_by_key(|k| out[*k] - out[k - 1]) else { break };
        let middle = usize::midpoint(out[at - 1], out[at]);
        if out.contains(&middle) {
            break;
        }
        out.insert(at, middle);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_shows_the_end_of_every_step() {
        let steps = [vec![0; 10], vec![1; 30], vec![2; 5]].concat();
        let frames = sheet_frames(&steps, 6);
        assert_eq!(frames, [0, 9, 16, 24, 39, 44]);
    }
}
