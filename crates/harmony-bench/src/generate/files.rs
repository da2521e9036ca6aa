//! The folder of a room.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DVec3, Vec3};
use harmony_io::picture::{PictureError, rgb_jpeg, write_depth_png};
use harmony_io::{FileError, write_atomic, write_json};
use harmony_mesh::Mesh;
use harmony_scene::{Camera, ImageSize, Surface, Wall};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, RgbImage};
use serde_json::{Value, json};

use super::archive::{Entry, archive};
use super::form::room_of;
use super::layout::Level;
use super::outline::shape;
use super::shell::LEDGE;
use super::{GeneratedObject, GeneratedOpening, GeneratedRoom, LightKind, RoomLight};

/// A room could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GenerateError {
    /// A file could not be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A picture could not be encoded or written.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// The id image could not be encoded.
    #[error("cannot encode the id image: {0}")]
    Ids(#[source] image::ImageError),
}

/// Writes a room's folder, which is made when missing; files that are there are replaced.
///
/// # Errors
/// [`GenerateError`].
pub fn write(room: &GeneratedRoom, folder: &Path) -> Result<(), GenerateError> {
    std::fs::create_dir_all(folder).map_err(|source| FileError::Write { path: folder.to_owned(), source })?;
    write_pictures(folder, &room.photo, &room.depth, &room.ids, room.jpeg_quality)?;
    write_json(&folder.join("camera.json"), &camera(&room.camera, room.camera_yaw, room.camera_pitch))?;
    write_json(&folder.join("room.json"), &room_json(room))?;
    let list: Vec<Value> = room.objects.iter().map(object).collect();
    write_json(&folder.join("objects.json"), &json!({ "scene": room.name, "objects": list }))?;
    let points = [
        Entry::points("xyz", &room.points.xyz),
        Entry::numbers("id", &room.points.id),
        Entry::points("shell_xyz", &room.shell_points.xyz),
        Entry::numbers("shell_id", &room.shell_points.id),
    ];
    write_atomic(&folder.join("points.npz"), &archive(&points))?;
    let mut meshes = Vec::new();
    for object in room.objects.iter().filter(|o| o.visible_pixels > 0) {
        let (vertices, triangles) = welded(&object.mesh);
        meshes.push(Entry::points(&format!("{}/v", object.id), &vertices));
        meshes.push(Entry::triangles(&format!("{}/f", object.id), &triangles));
    }
    write_atomic(&folder.join("meshes.npz"), &archive(&meshes))?;
    write_atomic(&folder.join("credits.txt"), credits(room).as_bytes())?;
    for view in &room.views {
        let folder = folder.join("views").join(view.name);
        std::fs::create_dir_all(&folder).map_err(|source| FileError::Write { path: folder.clone(), source })?;
        write_pictures(&folder, &view.photo, &view.depth, &view.ids, room.jpeg_quality)?;
        write_json(&folder.join("camera.json"), &camera(&view.camera, view.yaw, view.pitch))?;
    }
    Ok(())
}

/// `photo.jpg`, `depth.png` and `instances.png`.
fn write_pictures(
    folder: &Path,
    photo: &RgbImage,
    depth: &[f32],
    ids: &[u8],
    quality: u8,
) -> Result<(), GenerateError> {
    let size = ImageSize::new(photo.width(), photo.height());
    write_atomic(&folder.join("photo.jpg"), &rgb_jpeg(photo, quality)?)?;
    write_depth_png(&folder.join("depth.png"), size, depth)?;
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(ids, size.width, size.height, ExtendedColorType::L8)
        .map_err(GenerateError::Ids)?;
    Ok(write_atomic(&folder.join("instances.png"), &png)?)
}

/// Equal positions made one.
fn welded(mesh: &Mesh) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut known: BTreeMap<[u32; 3], u32> = BTreeMap::new();
    let mut vertices = Vec::new();
    let mut number = |i: u32| {
        let p = mesh.positions[i as usize];
        *known.entry(p.to_array().map(f32::to_bits)).or_insert_with(|| {
            vertices.push(p);
            vertices.len() as u32 - 1
        })
    };
    let triangles = mesh.triangles().map(|t| t.map(&mut number)).collect();
    (vertices, triangles)
}

/// Rounded for a person to read.
pub(super) fn round(v: f64, digits: i32) -> f64 {
    let k = 10_f64.powi(digits);
    // Adding zero turns -0 into 0.
    (v * k).round() / k + 0.0
}

pub(super) fn list(v: DVec3, digits: i32) -> Value {
    json!(v.to_array().map(|c| round(c, digits)))
}

fn camera(c: &Camera, yaw: f64, pitch: f64) -> Value {
    let k = &c.intrinsics;
    let rows = c.rotation.transpose();
    json!({
        "width": c.size.width,
        "height": c.size.height,
        "K": [[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]],
        "R": [list(rows.x_axis, 9), list(rows.y_axis, 9), list(rows.z_axis, 9)],
        "t": list(c.translation, 9),
        "center": list(c.centre(), 9),
        "hfov_deg": round(c.horizontal_fov().to_degrees(), 4),
        "yaw_deg": round(yaw.to_degrees(), 4),
        "pitch_down_deg": round(pitch.to_degrees(), 4),
        "roll_deg": 0.0,
        "convention": "OpenCV; x_cam = R x_room + t; the centre of the top-left pixel is (0.5, 0.5)",
        "distortion": null,
    })
}

/// Name of an opening's kind.
pub(super) fn kind_of(opening: &GeneratedOpening) -> &'static str {
    match (opening.door, &opening.object) {
        (true, None) => "passage",
        (true, Some(_)) => "door",
        (false, _) => "window",
    }
}

/// Fewest pixels of a wall that counts as in view.
const WALL_PIXELS: usize = 500;

fn room_json(room: &GeneratedRoom) -> Value {
    let walls = [Wall::Back, Wall::Left, Wall::Right, Wall::Front];
    let pixels = |w: &Wall| room.surface_pixels(w.surface());
    let visible: Vec<&str> = walls.iter().filter(|w| pixels(w) >= WALL_PIXELS).map(|w| w.surface().name()).collect();
    let wall_pixels: serde_json::Map<String, Value> =
        walls.iter().map(|w| (w.surface().name().to_owned(), json!(pixels(w)))).collect();
    let corners: Vec<Value> = room
        .corners
        .iter()
        .map(|c| {
            let pixel = c.pixel.map(|p| p.map(|v| round(v, 2)));
            json!({ "corner": c.name, "in_image": c.in_image, "unoccluded": c.unoccluded, "pixel": pixel })
        })
        .collect();
    let openings: Vec<Value> = room
        .openings
        .iter()
        .map(|o| {
            let mut entry = json!({
                "kind": kind_of(o),
                "wall": o.wall.surface().name(),
                "u0": round(o.u[0], 6), "u1": round(o.u[1], 6), "y0": round(o.y[0], 6), "y1": round(o.y[1], 6),
                "cut": !o.door || o.object.is_none(),
                "object": o.object,
            });
            if let Some(plane) = o.plane {
                entry["plane"] = json!(round(plane, 6));
            }
            if o.object.is_none() {
                entry["rise"] = json!(round(o.rise, 6));
            }
            entry
        })
        .collect();
    let lights: Vec<Value> = room.lights.iter().map(|l| light(room, l)).collect();
    let mut out = json!({
        "W": room.extents.width,
        "D": room.extents.depth,
        "H": room.extents.height,
        "walls_visible": visible,
        "wall_pixels": wall_pixels,
        "floor_visible": room.surface_pixels(Surface::Floor) >= WALL_PIXELS,
        "ceiling_visible": room.surface_pixels(Surface::Ceiling) >= WALL_PIXELS,
        "floor_corners": corners,
        "openings": openings,
        "openings_note": "u runs along x on back/front, along z on left/right; cut: a hole in the wall (the window pane lies 0.096 m behind the wall plane)",
        "lighting": if room.openings.iter().any(|o| !o.door) { "day" } else { "lamps" },
        "lights": lights,
        "shell_ids": {
            "floor": 1, "ceiling": 2, "wall_back": 3, "wall_right": 4, "wall_front": 5, "wall_left": 6,
            "skirting": 7, "outside": 8,
        },
    });
    if !room.shape.is_box() {
        out["shape"] = shape(&room_of(room.extents, room.shape.clone()), &room.openings);
        out["shell_ids"]["ledge"] = json!(LEDGE);
    }
    out
}

fn light(room: &GeneratedRoom, l: &RoomLight) -> Value {
    let color = json!(l.color.to_array().map(|c| round(f64::from(c), 3)));
    let owner = l.owner.map(|k| room.objects[k].id.clone());
    // The shader's unit of power is the radiant intensity of a Lambertian patch: 1 for each pi watts.
    let watts = round(l.power * std::f64::consts::PI, 3);
    match l.kind {
        LightKind::Area => json!({
            "type": "area", "position": list(l.position, 4), "normal": list(l.normal, 4),
            "size": l.size.map(|v| round(v, 4)), "watts": watts, "color": color, "owner": owner,
        }),
        LightKind::Point => json!({
            "type": "point", "position": list(l.position, 4), "watts": round(l.power * 4.0 * std::f64::consts::PI, 3),
            "color": color, "owner": owner,
        }),
        LightKind::Sun => json!({
            "type": "sun", "direction": list(l.normal, 4), "strength": round(l.power, 3), "color": color,
        }),
    }
}

fn object(o: &GeneratedObject) -> Value {
    let centred = o.level == Level::Wall;
    let centre = if centred { o.position } else { o.position + DVec3::Y * o.size.y / 2.0 };
    let yaw = (o.yaw + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
    let relations: Vec<Value> = o.relations.iter().map(|(k, t)| json!({ "type": k, "target": t })).collect();
    let mut out = json!({
        "id": o.id,
        "index": o.index,
        "level": o.level.name(),
        "label": o.label,
        "position": list(o.position, 6),
        "position_is": if centred { "centre" } else { "bottom_centre" },
        "center": list(centre, 6),
        "yaw_deg": round(yaw.to_degrees(), 4),
        "size_whd": list(o.size, 6),
        "aabb": { "min": list(o.aabb.min, 6), "max": list(o.aabb.max, 6) },
        "support": o.support,
        "wall_affinity": o.wall.map(|w| w.surface().name()),
        "facing": o.facing,
        "group": o.group,
        "relations": relations,
        "visible_pixels": o.visible_pixels,
        "occluded_fraction": o.occluded_fraction.map(|f| round(f, 3)),
        "truncated": o.truncated_fraction > 0.005,
        "truncated_fraction": round(o.truncated_fraction, 3),
        "model": "procedural",
        "model_code": "procedural",
        "boxes_may_overlap": o.boxes_may_overlap,
    });
    if let Some(plane) = o.wall_plane {
        out["wall_plane"] = json!(round(plane, 6));
    }
    out
}

fn credits(room: &GeneratedRoom) -> String {
    let mut text = format!("{}: models in this scene\n\n", room.name);
    for o in &room.objects {
        text.push_str(&o.id);
        text.push_str(": made by this generator (procedural, no third-party content)\n");
    }
    text.push_str("\nRoom, textures, pictures, rugs and windows: procedural, no third-party content.\n");
    text
}
