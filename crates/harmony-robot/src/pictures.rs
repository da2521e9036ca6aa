//! Pictures of a motion: frames in even light with the robot shaded, a sheet, a film.
//!
//! The scene keeps the look of `harmony render`; the robot has no light of the photo, so that it is shaded by one lamp from
//! above. The camera looks from where most of the robot is seen; walls between are left out.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use harmony_export::World;
use harmony_export::world::Select;
use harmony_mesh::{Material, Mesh, is_left_out, shell_material_name};
use harmony_physics::hull::hull_mesh;
use harmony_render::{Instance, OUTSIDE, RenderOptions, Renderer};
use harmony_scene::{Camera, ImageSize, Intrinsics, Level, SceneObject, Support, Surface};
use image::{DynamicImage, RgbImage};

use crate::model::{Form, Model};
use crate::motion::Motion;
use crate::room::Surroundings;

/// Horizontal field of view, radians.
const FOV: f64 = 0.9;
/// Id of the robot in the pictures that choose a camera.
const ROBOT: u32 = 1;

/// A visual mesh of a link.
pub(crate) struct Seen {
    /// Place in the link.
    pub link_from_mesh: DAffine3,
    /// Its triangles.
    pub mesh: Arc<Mesh>,
    /// Linear.
    pub color: [f32; 3],
}

/// Draws a motion.
pub struct Painter<'a> {
    world: &'a World,
    room: &'a Surroundings,
    motion: &'a Motion,
    meshes: Vec<Vec<Seen>>,
    drawn: Vec<Drawn>,
    renderer: Renderer,
    camera: Camera,
    hidden: Vec<&'static str>,
}

impl<'a> Painter<'a> {
    /// With the camera that sees most.
    pub fn new(world: &'a World, room: &'a Surroundings, motion: &'a Motion, size: ImageSize) -> Self {
        let camera = Camera::looking(size, Intrinsics::from_horizontal_fov(size, FOV), DVec3::ZERO, DVec3::NEG_Z);
        let mut painter = Self {
            world,
            room,
            motion,
            meshes: meshes(&motion.model),
            drawn: drawn(world, room, motion.object),
            renderer: Renderer::new(),
            camera,
            hidden: vec![],
        };
        painter.choose(size);
        painter
    }

    /// From where it looks.
    pub(crate) fn camera(&self) -> Camera {
        self.camera
    }

    /// Meshes of the scene.
    pub(crate) fn drawn(&self) -> &[Drawn] {
        &self.drawn
    }

    /// Names of what is left out of the pictures: faces of the room between camera and robot with what hangs on them, and
    /// what hangs under the ceiling.
    pub(crate) fn hidden_nodes(&self) -> Vec<String> {
        let items = self.world.items.iter().filter(|i| self.leaves_out(&i.object)).map(|i| i.name().to_owned());
        self.hidden.iter().map(|name| (*name).to_owned()).chain(items).collect()
    }

    /// What would float before the picture.
    fn leaves_out(&self, object: &SceneObject) -> bool {
        match object.support {
            Support::Ceiling => true,
            Support::Wall { wall } => self.hidden.contains(&shell_material_name(wall.surface())),
            _ => object.level == Level::Ceiling,
        }
    }

    fn choose(&mut self, size: ImageSize) {
        let small = size.fit_within(160);
        let e = self.room.extents;
        // What is to be seen: the object and the robot at some frames.
        let mut low = self.room.things[self.motion.object].low;
        let mut high = self.room.things[self.motion.object].high;
        for frame in self.motion.frames.iter().step_by(20) {
            for place in self.motion.model.places(&frame.posture) {
                low = low.min(place.translation - 0.1);
                high = high.max(place.translation + 0.1);
            }
        }
        let (centre, reach) = ((low + high) / 2.0, (high - low).length() / 2.0);
        let count = self.motion.frames.len();
        let some = [0, count / 3, 2 * count / 3, count - 1].map(|frame| (frame, self.robot(frame)));
        let from = |azimuth: f64, size: ImageSize| {
            let out = DVec3::new(azimuth.sin() * 0.94, 0.34, azimuth.cos() * 0.94);
            let eye = centre + out * (1.15 * reach / (FOV / 2.0).tan()).max(1.6);
            (eye, Camera::looking(size, Intrinsics::from_horizontal_fov(size, FOV), eye, centre - eye))
        };
        let mut best = (0, 0.0, Vec::new());
        for k in 0..12 {
            let azimuth = std::f64::consts::TAU * f64::from(k) / 12.0;
            let eye;
            (eye, self.camera) = from(azimuth, small);
            self.hidden = Surface::ALL
                .into_iter()
                .filter(|s| *s == Surface::Ceiling || (eye - s.point(&e, s.size(&e) / 2.0)).dot(s.normal()) <= 0.0)
                .map(shell_material_name)
                .collect();
            let seen: usize = some.iter().map(|(frame, robot)| self.seen(*frame, robot)).sum();
            if seen > best.0 {
                best = (seen, azimuth, self.hidden.clone());
            }
        }
        self.camera = from(best.1, size).1;
        self.hidden = best.2;
    }

    /// Pixels that show the robot.
    fn seen(&self, frame: usize, robot: &[Mesh]) -> usize {
        let instances = self.instances(frame, robot);
        let drawn = self.renderer.render_depth_ids(&self.camera, &instances, &RenderOptions::default());
        drawn.ids.iter().filter(|i| **i == ROBOT).count()
    }

    fn instances<'b>(&'b self, frame: usize, robot: &'b [Mesh]) -> Vec<Instance<'b>> {
        let moved = self.motion.frames[frame].moved;
        let mut out: Vec<Instance<'b>> = Vec::new();
        for face in self.world.shell.iter().filter(|f| !is_left_out(&f.name, &self.hidden)) {
            out.push(Instance::in_room(&face.mesh, 2));
        }
        for d in &self.drawn {
            let item = &self.world.items[d.item];
            if self.leaves_out(&item.object) {
                continue;
            }
            let mut instance = Instance::posed(&d.mesh, &item.object.pose, 3);
            if d.moves {
                instance.linear = moved.matrix3 * instance.linear;
                instance.translation = moved.transform_point3(instance.translation);
            }
            out.push(instance);
        }
        out.extend(robot.iter().map(|m| Instance::in_room(m, ROBOT)));
        out
    }

    /// The robot's meshes in the room, shaded.
    fn robot(&self, frame: usize) -> Vec<Mesh> {
        let places = self.motion.model.places(&self.motion.frames[frame].posture);
        let light = Vec3::new(0.35, 0.85, 0.4).normalize();
        let mut out = Vec::new();
        for (link, meshes) in self.meshes.iter().enumerate() {
            for Seen { link_from_mesh, mesh, color } in meshes {
                let place = places[link] * *link_from_mesh;
                let turn: DMat3 = place.matrix3;
                let quat = DQuat::from_mat3(&turn).as_quat();
                let mut moved = (**mesh).clone();
                moved.map(|p| place.transform_point3(p.as_dvec3()).as_vec3(), |n| quat * n);
                moved.colors = moved
                    .normals
                    .iter()
                    .map(|n| {
                        let shade = 0.45 + 0.55 * (0.5 + 0.5 * n.dot(light));
                        [shade; 3]
                    })
                    .collect();
                moved.materials = vec![Material::plain("robot", color.map(|c| c.clamp(0.04, 0.9)))];
                for g in &mut moved.groups {
                    g.material = 0;
                }
                out.push(moved);
            }
        }
        out
    }

    /// One frame.
    pub fn frame(&self, frame: usize) -> RgbImage {
        let robot = self.robot(frame);
        let options = RenderOptions { multisample: true, background: OUTSIDE, ..RenderOptions::default() };
        let drawn = self.renderer.render(&self.camera, &self.instances(frame, &robot), &options);
        DynamicImage::ImageRgba8(drawn.color).to_rgb8()
    }
}

/// A mesh of the scene, canonical.
pub(crate) struct Drawn {
    /// Number of its item.
    pub item: usize,
    /// All of it, or what moves of it, or the rest.
    pub mesh: Arc<Mesh>,
    /// Whether the motion moves it.
    pub moves: bool,
    /// Name of the part that opens when it is one.
    pub part: Option<String>,
}

/// Meshes of all items; one of which a part is moved comes as that and the rest.
pub(crate) fn drawn(world: &World, room: &Surroundings, object: usize) -> Vec<Drawn> {
    let name = &room.things[object].id;
    let of = |(number, item): (usize, &harmony_export::world::Item)| -> Vec<Drawn> {
        let one = |mesh: Arc<Mesh>, moves, part| Drawn { item: number, mesh, moves, part };
        let Some(part) = item.opens.iter().position(|o| o.name == *name) else {
            let rides = room.things.iter().position(|t| t.id == item.name()).is_some_and(|t| room.rides(t, object));
            return vec![one(Arc::clone(&item.mesh), rides, None)];
        };
        let mut rest = item.selected(Select::Fixed);
        for other in (0..item.opens.len()).filter(|k| *k != part) {
            rest.append(&item.selected(Select::Part(other)));
        }
        let moving = Arc::new(item.selected(Select::Part(part)));
        vec![one(Arc::new(rest), false, None), one(moving, true, Some(name.clone()))]
    };
    world.items.iter().enumerate().flat_map(of).collect()
}

/// Visual meshes of every link, with colours.
pub(crate) fn meshes(model: &Model) -> Vec<Vec<Seen>> {
    let of = |geom: &crate::model::Geom| match &geom.form {
        Form::Mesh(mesh) => Some(Arc::clone(mesh)),
        Form::Box(half) => {
            let hull = harmony_physics::Hull::cuboid(-*half, *half);
            // Corners of their own for every face, so that faces are flat.
            Some(Arc::new(faceted(&hull_mesh(&[hull], geom.color))))
        }
        _ => None,
    };
    let seen = |geom: &crate::model::Geom| {
        Some(Seen { link_from_mesh: geom.link_from_geom, mesh: of(geom)?, color: geom.color })
    };
    model.links.iter().map(|l| l.geoms.iter().filter(|g| g.visual).filter_map(seen).collect()).collect()
}

/// The same mesh with a vertex of its own for every corner.
fn faceted(mesh: &Mesh) -> Mesh {
    let mut out = Mesh { materials: mesh.materials.clone(), ..Mesh::default() };
    let mut group = harmony_mesh::Group::default();
    for t in mesh.triangles() {
        let base = out.positions.len() as u32;
        out.positions.extend(t.map(|i| mesh.positions[i as usize]));
        group.triangles.push([base, base + 1, base + 2]);
    }
    out.groups.push(group);
    out.uvs = vec![glam::Vec2::ZERO; out.positions.len()];
    out.recompute_normals();
    out
}
