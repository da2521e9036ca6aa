//! What a mesh stands on.
//!
//! A body rests on a face of its convex hull over which its centre of mass lies; any other pose rocks or falls. Generated
//! meshes are tilted, and the feet on the side that nobody saw are made up, so that what was set upright by its faces
//! ([`crate::upright`]) still stands on one foot and a corner. Here it gets a base, by the least that does:
//!
//! 1. feet whose lengths differ little are stretched to the ground, the top stays;
//! 2. where that is not enough, the mesh turns to the nearest face that carries the centre of mass, if its faces don't speak
//!    against it or nothing else helps, and its feet are evened;
//! 3. the lowest part of its height is pressed flat.
//!
//! The centre of mass is taken to be that of the surface: an even thickness, as boards and legs have.

use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Matrix4, Vector4};

use crate::upright::level_share;
use crate::{Mesh, canonicalise, quickhull};

/// Height of what is pressed flat: a share of the bounds' diagonal ...
const PRESSED: f64 = 0.006;
/// ... and at most one of the height: rugs and plates are flat already.
const PRESSED_OF_HEIGHT: f64 = 0.05;
/// Feet that differ by less are evened without a turn: a share of the bounds' diagonal. Upright by faces is exact to a
/// fraction of a degree for most things, and what is made up at the back moves feet by so much.
const UNEVEN: f64 = 0.015;
/// Feet that differ by more are other things than feet.
const MAX_UNEVEN: f64 = 0.06;
/// A base reaches so far beyond the centre of mass on every side, a share of the bounds' diagonal.
const MARGIN: f64 = 0.02;
/// A turn leaves this much of the surface that was level or plumb so, as a share: a cabinet whose base was made up at the
/// back is upright by its doors, an armchair whose arms are all round stands as its feet say.
const KEPT_LEVEL: f64 = 0.7;
/// Points this near to the hull of the others are left out, a share of the longest side: what single precision resolves.
const FLUSH: f64 = 1e-6;
/// Corners of the hull at most: of a round mesh those that stand out most.
const HULL_CORNERS: usize = 2000;
/// Farthest turn to a face that carries, degrees: more is another pose, not a crooked foot. Photo frames lean by so much.
const MAX_TURN_DEG: f64 = 20.0;

/// What was done to make a mesh stand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stand {
    /// The turn that was made, degrees; 0 where there was none.
    pub turned_deg: f64,
    /// How far its feet differed, a share of its size.
    pub uneven: f64,
    /// Whether its base carries it now; else it has none within reach (a ball on a stick).
    pub stands: bool,
}

/// Gives a canonical mesh (+Y up) a flat base at y = 0 below its centre of mass; x and z are centred anew when it turns.
pub fn stand(mesh: &mut Mesh) -> Stand {
    let mut done = Stand { turned_deg: 0.0, uneven: 0.0, stands: false };
    let Some(size) = mesh.bounds().map(|b| b.size()).filter(|s| s.min_element() > 0.0) else { return done };
    canonicalise(mesh, DMat3::IDENTITY);
    let pressed = (PRESSED * size.length()).min(PRESSED_OF_HEIGHT * size.y);
    let margin = MARGIN * size.length();
    let feet = Feet::of(mesh);
    done.uneven = feet.uneven() / size.length();
    done.stands = done.uneven <= UNEVEN && even(mesh, &feet, size.y, pressed, margin) || carried(mesh, pressed, margin);
    if !done.stands {
        let turn = turn_to_face(mesh, pressed, margin);
        let as_level = |turn: &DMat3| {
            let [before, after] = [DVec3::Y, turn.transpose() * DVec3::Y].map(|up| level_share(mesh, up));
            after >= KEPT_LEVEL * before
        };
        let mut turns = vec![DMat3::IDENTITY];
        if let Some(turn) = turn {
            turns.insert(usize::from(!as_level(&turn)), turn);
        }
        for turn in turns {
            let mut turned = mesh.clone();
            canonicalise(&mut turned, turn);
            let feet = Feet::of(&turned);
            if feet.uneven() <= MAX_UNEVEN * size.length() {
                even(&mut turned, &feet, size.y, pressed, margin);
            }
            done.stands = carried(&turned, pressed, 0.25 * margin);
            if done.stands {
                done.turned_deg = (turn * DVec3::Y).y.clamp(-1.0, 1.0).acos().to_degrees();
                *mesh = turned;
                break;
            }
        }
    }
    press(mesh, pressed);
    done
}

/// The lowest points of the four quarters of the footprint.
#[derive(Debug, Clone, Copy)]
struct Feet([DVec3; 4]);

impl Feet {
    /// Of a canonical mesh.
    fn of(mesh: &Mesh) -> Self {
        let mut feet = [DVec3::INFINITY; 4];
        for p in &mesh.positions {
            let foot = &mut feet[usize::from(p.x > 0.0) + 2 * usize::from(p.z > 0.0)];
            if f64::from(p.y) < foot.y {
                *foot = p.as_dvec3();
            }
        }
        Self(feet)
    }

    /// How far their heights differ.
    fn uneven(&self) -> f64 {
        self.0.iter().map(|f| f.y).fold(0.0, f64::max)
    }

    /// The height of the ground that goes through all four, `a + b x + c z + d x z`; `None` when they are in a line.
    fn ground(&self) -> Option<Vector4<f64>> {
        let rows = Matrix4::from_fn(|r, c| {
            let f = self.0[r];
            [1.0, f.x, f.z, f.x * f.z][c]
        });
        rows.lu().solve(&Vector4::from_fn(|r, _| self.0[r].y)).filter(|g| g.iter().all(|v| v.is_finite()))
    }
}

/// Brings all feet to the ground, the top stays; a change is kept when the base carries the mesh then. Tells whether.
fn even(mesh: &mut Mesh, feet: &Feet, height: f64, pressed: f64, margin: f64) -> bool {
    let Some(ground) = feet.ground() else { return false };
    let (most, before) = (feet.uneven(), mesh.positions.clone());
    mesh.map(
        |p| {
            let (x, y, z) = (f64::from(p.x), f64::from(p.y), f64::from(p.z));
            let lift = ground.dot(&Vector4::new(1.0, x, z, x * z)).clamp(0.0, most);
            glam::Vec3::new(p.x, (y - lift * (1.0 - y / height).clamp(0.0, 1.0)) as f32, p.z)
        },
        |n| n,
    );
    let lowest = mesh.positions.iter().map(|p| p.y).fold(f32::INFINITY, f32::min);
    for p in &mut mesh.positions {
        p.y -= lowest;
    }
    let carries = carried(mesh, pressed, margin);
    if !carries {
        mesh.positions = before;
    }
    carries
}

/// Mean of the surface, by area.
fn centre_of_surface(mesh: &Mesh) -> DVec3 {
    let (sum, area) = mesh.triangles().fold((DVec3::ZERO, 0.0), |(sum, total), t| {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize].as_dvec3());
        let area = (b - a).cross(c - a).length();
        (sum + (a + b + c) / 3.0 * area, total + area)
    });
    if area > 0.0 { sum / area } else { DVec3::ZERO }
}

/// Whether what is below `line` carries the mesh's centre of mass by the margin.
fn carried(mesh: &Mesh, line: f64, margin: f64) -> bool {
    let points: Vec<DVec3> = mesh.positions.iter().map(|p| p.as_dvec3()).filter(|p| p.y <= line).collect();
    surrounded(&points, centre_of_surface(mesh), line, margin)
}

/// Whether the points below `line` reach beyond a centre by the margin on every side.
fn surrounded(points: &[DVec3], centre: DVec3, line: f64, margin: f64) -> bool {
    (0..32).all(|k| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 32.0).sin_cos();
        let out = |p: &DVec3| (p.x - centre.x) * cos + (p.z - centre.z) * sin;
        points.iter().filter(|p| p.y <= line).map(out).fold(f64::NEG_INFINITY, f64::max) >= margin
    })
}

/// The least turn that brings a face of the hull to the ground which carries the centre of mass, by the margin if there
/// is such a face.
fn turn_to_face(mesh: &Mesh, pressed: f64, margin: f64) -> Option<DMat3> {
    let centre = centre_of_surface(mesh);
    let points: Vec<DVec3> = mesh.positions.iter().map(|p| p.as_dvec3()).collect();
    let size = mesh.bounds()?.size().max_element();
    let faces = quickhull(&points, FLUSH * size, HULL_CORNERS)?;
    let mut corners = faces.concat();
    corners.sort_unstable();
    corners.dedup();
    let mut down: Vec<DVec3> = faces
        .iter()
        .filter_map(|face| {
            let [a, b, c] = face.map(|i| points[i as usize]);
            let out = (b - a).cross(c - a).try_normalize()?;
            // The centre of mass along the normal, inside all three sides of the face.
            let carries =
                [(a, b), (b, c), (c, a)].iter().all(|(from, to)| (*to - *from).cross(centre - *from).dot(out) >= 0.0);
            (carries && -out.y >= MAX_TURN_DEG.to_radians().cos()).then_some(out)
        })
        .collect();
    down.sort_by(|a, b| a.y.total_cmp(&b.y));
    let turn = |out: &DVec3| DMat3::from_quat(DQuat::from_rotation_arc(*out, DVec3::NEG_Y));
    let safe = down.iter().map(turn).find(|turn| {
        let turned: Vec<DVec3> = corners.iter().map(|i| *turn * points[*i as usize]).collect();
        let ground = turned.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        surrounded(&turned, *turn * centre, ground + pressed, margin)
    });
    safe.or_else(|| down.first().map(turn))
}

/// Presses what is below `line` flat onto it, and sets it down to y = 0.
fn press(mesh: &mut Mesh, line: f64) {
    let line = line as f32;
    mesh.map(|p| glam::Vec3::new(p.x, (p.y - line).max(0.0), p.z), |n| n);
}

#[cfg(test)]
mod tests {
    use harmony_scene::Size;

    use super::*;
    use crate::{TemplateParams, template};

    fn built(name: &str, width: f64, height: f64, depth: f64) -> Mesh {
        let size = Size { width, height, depth };
        template(name, &TemplateParams::default(), size).build(size).unwrap().mesh
    }

    /// Points on the ground, and how far apart they are along x and z.
    fn base(mesh: &Mesh) -> (usize, f32, f32) {
        let low: Vec<_> = mesh.positions.iter().filter(|p| p.y == 0.0).collect();
        let spread = |f: fn(&glam::Vec3) -> f32| {
            let all: Vec<f32> = low.iter().map(|p| f(p)).collect();
            all.iter().copied().fold(f32::NEG_INFINITY, f32::max) - all.iter().copied().fold(f32::INFINITY, f32::min)
        };
        (low.len(), spread(|p| p.x), spread(|p| p.z))
    }

    #[test]
    fn a_table_with_a_short_leg_and_a_tilt_stands_on_all_its_legs() {
        for tilt_deg in [0.0_f64, 0.3, 4.0, 9.0] {
            let mut mesh = built("table", 1.4, 0.74, 0.8);
            // 2 cm short; the legs are near the corners.
            for p in &mut mesh.positions {
                if p.y < 0.01 && p.x > 0.0 && p.z > 0.0 {
                    p.y += 0.02;
                }
            }
            let tilt = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), tilt_deg.to_radians()).as_mat3();
            mesh.map(|p| tilt * p, |n| tilt * n);
            let done = stand(&mut mesh);
            assert!(done.stands && (done.turned_deg - tilt_deg).abs() < 0.7, "{tilt_deg}: {done:?}");
            let (count, x, z) = base(&mesh);
            assert!(legs(&mesh), "{tilt_deg}: a leg is in the air");
            assert!(count >= 16 && x > 1.0 && z > 0.5, "{tilt_deg}: {count} points, {x} by {z}");
            let top = mesh.positions.iter().map(|p| p.y).fold(0.0, f32::max);
            assert!((top - 0.74).abs() < 0.02, "{top}");
        }
    }

    /// Whether something of every quarter is on the ground.
    fn legs(mesh: &Mesh) -> bool {
        Feet::of(mesh).uneven() == 0.0
    }

    #[test]
    fn what_stands_is_not_turned_and_hardly_pressed() {
        for (name, w, h, d) in [("chair", 0.5, 0.95, 0.55), ("sofa", 2.0, 0.8, 0.9), ("floor_lamp", 0.4, 1.6, 0.4)] {
            let mut mesh = built(name, w, h, d);
            let before = mesh.bounds().unwrap().size();
            assert_eq!(stand(&mut mesh), Stand { turned_deg: 0.0, uneven: 0.0, stands: true }, "{name}");
            let lost = before - mesh.bounds().unwrap().size();
            assert!(lost.max_element() <= 0.0061 * before.length() && lost.x == 0.0 && lost.z == 0.0, "{name}: {lost}");
        }
    }

    #[test]
    fn a_frame_that_was_set_straight_leans_on_its_stand_again() {
        let size = Size { width: 0.2, height: 0.25, depth: 0.01 };
        let mut frame = template("box", &TemplateParams::default(), size).build(size).unwrap().mesh;
        // A stand behind it, whose end is as low as the frame when that leans by about 12 degrees.
        let slant = DMat3::from_rotation_x(0.55).as_mat3();
        let mut strut = frame.clone();
        let end = glam::Vec3::new(0.0, 0.12, -0.005);
        strut.map(|p| end + slant * (glam::Vec3::new(0.1, 0.5, 0.4) * p - glam::Vec3::Y * 0.125), |n| slant * n);
        frame.append(&strut);
        let done = stand(&mut frame);
        assert!(done.stands && (5.0..20.0).contains(&done.turned_deg), "{done:?}");
        assert!(base(&frame).2 > 0.04, "frame and strut are on the ground: {:?}", base(&frame));
    }

    #[test]
    fn what_cannot_stand_is_left_as_it_was() {
        let mut mesh = built("table", 1.0, 0.7, 0.7);
        // Its legs are far to the side of its top.
        mesh.map(|p| p + glam::Vec3::X * (1.2 * p.y), |n| n);
        let before = mesh.bounds().unwrap().size();
        assert!(!stand(&mut mesh).stands);
        assert!((mesh.bounds().unwrap().size() - before).length() < 0.02);
        assert!(!stand(&mut Mesh::default()).stands);
    }
}
