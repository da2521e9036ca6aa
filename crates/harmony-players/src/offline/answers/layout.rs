//! `layout`: the room as the lines of the photo and usual proportions give it.

use harmony_imaging::color::median_color;
use harmony_prompts::{
    BackWallSide, FloorTexture, LayoutAnswer, LayoutCamera, LayoutQuestion, LayoutRoom, LayoutTrims, LayoutWall,
    WallTexture,
};
use harmony_scene::{ImageSize, Mask, Wall};
use image::RgbImage;

/// Usual room, metres (width, depth, ceiling), where nothing was measured.
const USUAL_ROOM: [f64; 3] = [4.2, 4.8, 2.6];

/// Eye height of a photographer, metres.
const USUAL_CAMERA_HEIGHT: f64 = 1.5;

/// The room box that the lines give, within what a room can be; the usual room where they give none.
///
/// No pins and no corner are given: what the lines tell is known already, and more is not.
pub fn layout(question: &LayoutQuestion, photo: Option<&RgbImage>) -> LayoutAnswer {
    let known = question.unaided.as_ref();
    let within = |value: Option<f64>, low: f64, high: f64| value.filter(|v| v.is_finite()).map(|v| v.clamp(low, high));
    let width = within(known.map(|k| k.extents.width), 1.2, 30.0).unwrap_or(USUAL_ROOM[0]);
    let depth = within(known.map(|k| k.extents.depth), 1.2, 30.0).unwrap_or(USUAL_ROOM[1]);
    let height = within(known.map(|k| k.extents.height), 1.9, 10.0).unwrap_or(USUAL_ROOM[2]);
    let camera_height =
        within(known.map(|k| k.camera_height_m), 0.3, (height - 0.1).min(5.9)).unwrap_or(USUAL_CAMERA_HEIGHT);
    let tilt = within(known.map(|k| k.tilt_deg), -75.0, 75.0).unwrap_or(0.0);
    let yaw = within(known.map(|k| k.yaw_deg), -85.0, 85.0).unwrap_or(0.0);
    let distance = within(known.map(|k| k.dist_to_back_m), 0.3, 35.0).unwrap_or(depth * 0.85);
    let [floor, wall] = surface_colors(photo);
    LayoutAnswer {
        room: LayoutRoom {
            room_type: "room".to_owned(),
            floor_width_m: width,
            floor_depth_m: depth,
            ceiling_height_m: height,
        },
        shape: Vec::new(),
        ignore: Vec::new(),
        walls: vec![LayoutWall {
            orientation: Wall::Back,
            length_m: width,
            height_m: height,
            surface: "not known".to_owned(),
            openings: vec![],
        }],
        camera: LayoutCamera {
            height_m: camera_height,
            tilt_deg: tilt,
            floor_junction_y_frac: junction(camera_height, distance, tilt, photo),
            yaw_deg: yaw,
            dist_to_back_m: distance,
            corner_px: None,
            back_wall_side: BackWallSide::Both,
            visible_wall_height_m: height,
        },
        floor_texture: FloorTexture {
            material: "not known".to_owned(),
            color: floor.clone(),
            pattern: "as in the photo".to_owned(),
            tile_size_m: 1.0,
        },
        wall_texture: WallTexture {
            material: "paint".to_owned(),
            color: wall.clone(),
            finish: "matt".to_owned(),
            tile_size_m: 1.0,
        },
        surfaces: vec![],
        trims: LayoutTrims::default(),
        blocked_corners: vec![],
        pins: vec![],
    }
}

/// Row of the junction of floor and back wall, as a fraction, for a lens as long as the photo's longer side.
fn junction(camera_height: f64, distance: f64, tilt_deg: f64, photo: Option<&RgbImage>) -> f64 {
    let (w, h) = photo.map_or((4.0, 3.0), |p| (f64::from(p.width()), f64::from(p.height())));
    let below_axis = (camera_height / distance).atan() - tilt_deg.to_radians();
    (0.5 + below_axis.clamp(-1.2, 1.2).tan() * w.max(h) / h).clamp(0.0, 1.0)
}

/// Colours in words of the lowest strip of the photo (floor) and of its upper middle (wall).
fn surface_colors(photo: Option<&RgbImage>) -> [String; 2] {
    let Some(photo) = photo else { return ["not known".to_owned(), "not known".to_owned()] };
    let size = ImageSize::new(photo.width(), photo.height());
    let rows = |from: f64, to: f64| {
        let (from, to) = ((from * f64::from(size.height)) as u32, (to * f64::from(size.height)).ceil() as u32);
        let color = median_color(photo, &Mask::from_fn(size, |_, y| (from..to).contains(&y)));
        color.map_or_else(|| "not known".to_owned(), |[r, g, b]| format!("#{r:02x}{g:02x}{b:02x}"))
    };
    [rows(0.9, 1.0), rows(0.15, 0.35)]
}
