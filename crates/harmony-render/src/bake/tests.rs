use glam::{DVec3, Vec3};
use harmony_mesh::PartModel;
use harmony_scene::{ImageSize, Intrinsics, Size};
use image::Rgb;

use super::*;
use crate::{Instance, RenderOptions, render};

const BACKGROUND: [u8; 3] = [255, 0, 255];

/// A body and a lid; the body's colour runs with |x|, y and z, so that it is symmetric.
fn model() -> Mesh {
    let json = r##"{"slots":[{"name":"body","color":"#101010"},{"name":"lid","color":"#202020"},
        {"name":"glass","color":"#3050ff","texture":"plain"}],
        "parts":[{"shape":"box","slot":"body","to":[1,0.8,1],"round":0.05},
        {"shape":"box","slot":"lid","from":[0.1,0.79,0.1],"to":[0.9,1,0.9]},
        {"shape":"box","slot":"glass","from":[0.3,0.3,0.9],"to":[0.7,0.5,1]}]}"##;
    PartModel::from_json(json).unwrap().build(Size { width: 1.0, height: 0.8, depth: 0.6 }).unwrap().mesh
}

fn truth_color(p: Vec3) -> [u8; 3] {
    let v = |t: f32| (60.0 + 150.0 * t.clamp(0.0, 1.0)) as u8;
    [v(p.x.abs() * 2.0), v(p.y / 0.8), v(p.z / 0.6 + 0.5)]
}

/// The model painted with the truth.
fn painted(mesh: &Mesh) -> Mesh {
    let side = 512;
    let texels = texels::surface(mesh, side, &["glass".to_owned()]);
    let mut colors = vec![None; (side * side) as usize];
    for t in &texels {
        colors[t.at] = Some(truth_color(t.point).map(f32::from));
    }
    let texture = Arc::new(pyramid::fill(&colors, side as usize));
    let mut mesh = mesh.clone();
    for m in mesh.materials.iter_mut().filter(|m| m.name != "glass") {
        m.texture = Some(Arc::clone(&texture));
        m.base_color = [1.0; 4];
    }
    mesh
}

fn camera(azimuth: f64) -> Camera {
    let size = ImageSize::new(320, 240);
    let centre = DVec3::new(2.0, 0.4, 2.0);
    let from = DVec3::new(azimuth.sin(), 0.5, azimuth.cos()) * 2.2;
    Camera::looking(size, Intrinsics::from_horizontal_fov(size, 0.9), centre + from, -from)
}

fn photo(mesh: &Mesh, pose: &Pose, camera: &Camera) -> (RgbImage, Mask) {
    let [r, g, b] = BACKGROUND;
    let options = RenderOptions { background: [r, g, b, 255], ..RenderOptions::default() };
    let frame = render(camera, &[Instance::posed(mesh, pose, 1)], &options);
    let rgb = RgbImage::from_fn(camera.size.width, camera.size.height, |x, y| {
        let [r, g, b, _] = frame.color.get_pixel(x, y).0;
        Rgb([r, g, b])
    });
    (rgb, frame.mask(1))
}

fn pose() -> Pose {
    Pose::new(DVec3::new(2.0, 0.0, 2.0), 0.3, 1.0)
}

fn options() -> BakeOptions {
    BakeOptions { plain_slots: vec!["glass".to_owned()], ..BakeOptions::default() }
}

/// Mean absolute difference over the object, sRGB steps.
fn difference(a: &RgbImage, b: &RgbImage, mask: &Mask) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for (x, y, p) in a.enumerate_pixels() {
        if mask.get(x.into(), y.into()) {
            sum += (0..3).map(|k| f64::from(p[k].abs_diff(b.get_pixel(x, y)[k]))).sum::<f64>() / 3.0;
            n += 1.0;
        }
    }
    sum / n
}

#[test]
fn what_was_seen_comes_back_and_the_hidden_side_follows_by_symmetry() {
    let truth = painted(&model());
    let (rgb, mask) = photo(&truth, &pose(), &camera(0.8));
    let baked = bake_texture(&model(), &pose(), &camera(0.8), &rgb, &mask, &options());
    assert!((0.2..0.8).contains(&baked.observed), "{}", baked.observed);
    let (again, _) = photo(&baked.mesh, &pose(), &camera(0.8));
    let same = difference(&rgb, &again, &mask.dilated(-2));
    assert!(same < 3.0, "seen side differs by {same}");
    // from the other side of the plane of symmetry (yaw 0.3): the unseen end is the seen one mirrored
    let other = camera(0.6 - 0.8);
    let (expected, other_mask) = photo(&truth, &pose(), &other);
    let (got, _) = photo(&baked.mesh, &pose(), &other);
    let mirrored = difference(&expected, &got, &other_mask.dilated(-2));
    assert!(mirrored < 5.0, "mirrored side differs by {mirrored}");
    // from behind, where colours are made up, they at least are the object's
    let behind = camera(0.8 + std::f64::consts::PI);
    let (expected, behind_mask) = photo(&truth, &pose(), &behind);
    let (got, _) = photo(&baked.mesh, &pose(), &behind);
    let made_up = difference(&expected, &got, &behind_mask.dilated(-2));
    assert!(made_up < 60.0, "back differs by {made_up}");
}

#[test]
fn the_background_never_gets_onto_the_object() {
    let truth = painted(&model());
    let (rgb, mask) = photo(&truth, &pose(), &camera(0.8));
    // the pose is off by three centimetres and two degrees, the mask a pixel too large
    let mut off = pose();
    off.position += DVec3::new(0.03, 0.0, -0.02);
    off.yaw += 0.035;
    let baked = bake_texture(&model(), &off, &camera(0.8), &rgb, &mask.dilated(1), &options());
    let texture = baked.mesh.materials.iter().find_map(|m| m.texture.clone()).unwrap();
    let magenta = texture.pixels().filter(|p| p[0] > 200 && p[1] < 60 && p[2] > 200).count();
    assert_eq!(magenta, 0);
    let (again, again_mask) = photo(&baked.mesh, &off, &camera(0.8));
    let seen = difference(&rgb, &again, &again_mask.and(&mask).dilated(-4));
    assert!(seen < 14.0, "{seen}");
}

#[test]
fn slots_keep_or_take_their_colours() {
    let mesh = model();
    let truth = painted(&mesh);
    let (rgb, mask) = photo(&truth, &pose(), &camera(0.8));
    let baked = bake_texture(&mesh, &pose(), &camera(0.8), &rgb, &mask, &options());
    let glass = baked.mesh.materials.iter().find(|m| m.name == "glass").unwrap();
    assert!(glass.texture.is_none());
    assert_eq!(glass.base_color, mesh.materials.iter().find(|m| m.name == "glass").unwrap().base_color);
    let lid = baked.colors.iter().find(|c| c.slot == "lid").unwrap();
    assert!(lid.pixels > 100 && lid.rgb[1] > 185, "the lid is the highest part: {lid:?}");
    let body = baked.colors.iter().find(|c| c.slot == "body").unwrap();
    assert!(body.rgb[1] < lid.rgb[1], "{body:?}");
}

#[test]
fn without_a_usable_photo_everything_takes_the_slots_own_colour() {
    let mesh = model();
    let empty = Mask::empty(camera(0.8).size);
    let wrong = RgbImage::new(10, 10);
    let right = RgbImage::from_pixel(320, 240, Rgb(BACKGROUND));
    for (rgb, pose) in [
        (&wrong, pose()),
        (&right, pose()),
        (&right, Pose::new(DVec3::splat(f64::NAN), 0.0, 1.0)),
        (&right, Pose::new(DVec3::ZERO, 0.0, 0.0)),
    ] {
        let baked = bake_texture(&mesh, &pose, &camera(0.8), rgb, &empty, &options());
        assert_eq!(baked.observed, 0.0);
        let texture = baked.mesh.materials[0].texture.clone().unwrap();
        assert!(texture.pixels().all(|p| p[0] <= 0x20 && p[2] <= 0x20), "only the slots' own dark colours");
        assert!(baked.colors.iter().all(|c| c.pixels == 0));
    }
}

#[test]
fn fine_texture_goes_on_where_nothing_was_seen() {
    let mesh = model();
    let mut truth = painted(&mesh);
    // speckles on one colour
    let side = 512;
    let texture = RgbaImage::from_fn(side, side, |x, y| {
        let v = if (x * 7 + y * 13) % 5 < 2 { 150 } else { 90 };
        image::Rgba([v, v, v, 255])
    });
    let texture = Arc::new(texture);
    for m in &mut truth.materials {
        m.texture = Some(Arc::clone(&texture));
    }
    let (rgb, mask) = photo(&truth, &pose(), &camera(0.8));
    let baked = bake_texture(&mesh, &pose(), &camera(0.8), &rgb, &mask, &options());
    let spread = |image: &RgbImage, mask: &Mask| {
        let inside = mask.dilated(-3);
        let seen = image.enumerate_pixels().filter(|(x, y, _)| inside.get((*x).into(), (*y).into()));
        let values: Vec<f64> = seen.map(|(_, _, p)| f64::from(p[0])).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
    };
    let front = spread(&rgb, &mask);
    let (got, behind_mask) = photo(&baked.mesh, &pose(), &camera(0.8 + std::f64::consts::PI));
    let back = spread(&got, &behind_mask);
    // The base is the material's even colour: only the fine part of what was seen goes on, a quarter of it here.
    assert!(back > 0.2 * front && front > 1.0, "spread {front} where seen, {back} behind");
    // What a picture shows in one place is no texture of the rest.
    let shown = bake_texture(&mesh, &pose(), &camera(0.8), &rgb, &mask, &BakeOptions { trusted: true, ..options() });
    let (got, _) = photo(&shown.mesh, &pose(), &camera(0.8 + std::f64::consts::PI));
    let of_a_picture = spread(&got, &behind_mask);
    assert!(of_a_picture < 0.5 * back, "spread {of_a_picture} behind a picture");
}

/// A rug of a long pile of which only faint fibres were said; the photo shows its near end, from above.
#[test]
fn a_coarse_pile_goes_on_where_the_slots_tile_is_faint_and_the_texture_is_as_fine_as_the_photo() {
    let [w, d] = [2.0_f32, 3.0];
    let corners = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)];
    let faint = RgbaImage::from_fn(16, 16, |x, y| {
        let v = 120 + ((x * 5 + y * 3) % 4) as u8;
        image::Rgba([v, v, v, 255])
    });
    let tile = harmony_mesh::Tile { size: [0.05; 2], turn: 0.0, color: Arc::new(faint), normal: None, surface: None };
    let rug = Mesh {
        positions: corners.map(|(x, z)| Vec3::new(x * w / 2.0, 0.01, z * d / 2.0)).to_vec(),
        normals: vec![Vec3::Y; 4],
        // As in an atlas of many parts: the top has a tenth of the picture.
        uvs: corners.map(|(x, z)| glam::Vec2::new(0.1 + x * 0.1, 0.15 + z * 0.15)).to_vec(),
        metric_uvs: corners.map(|(x, z)| glam::Vec2::new(x * w / 2.0, z * d / 2.0)).to_vec(),
        groups: vec![harmony_mesh::Group { material: 0, triangles: vec![[0, 1, 2], [0, 2, 3]] }],
        materials: vec![Material { tile: Some(Arc::new(tile)), ..Material::plain("pile", [1.0; 3]) }],
        ..Mesh::default()
    };
    // Tufts of 2 cm, by a hash of their place.
    let tuft = |x: u32, y: u32| {
        let h = (x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA77)).wrapping_mul(0xC2B2_AE3D);
        60 + (h >> 24) as u8 / 2
    };
    let shag = RgbaImage::from_fn(1000, 1500, |x, y| image::Rgba([tuft(x / 10, y / 10), 100, 80, 255]));
    let mut truth = rug.clone();
    truth.materials = vec![Material { texture: Some(Arc::new(shag)), ..Material::plain("pile", [1.0; 3]) }];
    truth.uvs = corners.map(|(x, z)| glam::Vec2::new(0.5 + x / 2.0, 0.5 + z / 2.0)).to_vec();
    let size = ImageSize::new(640, 480);
    let pose = Pose::new(DVec3::new(2.0, 0.0, 2.0), 0.0, 1.0);
    let near = Camera::looking(
        size,
        Intrinsics::from_horizontal_fov(size, 0.9),
        DVec3::new(2.0, 1.4, 4.2),
        DVec3::new(0.0, -1.0, -0.7),
    );
    let (rgb, mask) = photo(&truth, &pose, &near);
    let baked = bake_texture(&rug, &pose, &near, &rgb, &mask, &BakeOptions::default());
    assert!((0.05..0.5).contains(&baked.observed), "the far end is not seen: {}", baked.observed);
    let texture = baked.mesh.materials[0].texture.clone().unwrap();
    assert!(texture.width() > texture_side(&mask, &BakeOptions::default()), "{}", texture.width());
    // From above: how much the red channel differs from tuft to tuft, in the half that was seen and in the other.
    let above =
        Camera::looking(size, Intrinsics::from_horizontal_fov(size, 0.9), DVec3::new(2.0, 3.2, 2.0), DVec3::NEG_Y);
    let (got, _) = photo(&baked.mesh, &pose, &above);
    let rough = |rows: std::ops::Range<u32>| {
        let values: Vec<f64> = rows
            .flat_map(|y| (200..440).map(move |x| (x, y)))
            .map(|(x, y)| f64::from(got.get_pixel(x, y)[0]))
            .collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
    };
    let halves = [rough(60..220), rough(260..420)];
    let (seen, unseen) = (halves[0].max(halves[1]), halves[0].min(halves[1]));
    assert!(seen > 15.0 && unseen > 0.5 * seen, "{halves:?}");
}
