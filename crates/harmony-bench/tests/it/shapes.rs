//! Rooms with truth that are no boxes: what is read of them is what their pictures show.

use harmony_bench::oracle::{NoiseLevel, Oracle};
use harmony_bench::truth::TruthRoom;
use harmony_prompts::{LayoutAnswer, LayoutFeatureKind, LayoutQuestion, Question};
use harmony_scene::{Surface, Vec2};

/// Value in the id image of each surface.
const IDS: [(u8, Surface); 6] = [
    (1, Surface::Floor),
    (2, Surface::Ceiling),
    (3, Surface::Back),
    (4, Surface::Right),
    (5, Surface::Front),
    (6, Surface::Left),
];

fn rooms() -> Option<Vec<TruthRoom>> {
    let folder = harmony_testing::shared("gt_shapes")?;
    let mut folders: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    folders.retain(|p| p.join("room.json").is_file());
    folders.sort();
    Some(folders.iter().map(|f| TruthRoom::load(f).unwrap()).collect())
}

#[test]
fn faces_lie_where_the_depth_image_has_the_walls() {
    for truth in rooms().into_iter().flatten() {
        let faces = truth.room().faces();
        assert!(!faces.is_box(), "{}", truth.name);
        let (mut right, mut all) = (0, 0);
        for i in (0..truth.ids.len()).step_by(13) {
            let Some((_, surface)) = IDS.iter().find(|(id, _)| *id == truth.ids[i]) else { continue };
            let width = truth.camera.size.width as usize;
            let pixel = Vec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let exit = faces.exit(&truth.camera.ray(pixel)).unwrap();
            let off = truth.camera.depth(exit.point) - f64::from(truth.depth[i]);
            all += 1;
            right += i32::from(off.abs() < 0.02 && exit.surface == *surface);
        }
        // Skirting and edges of pixels apart.
        assert!(f64::from(right) > 0.98 * f64::from(all), "{}: {right} of {all}", truth.name);
    }
}

#[test]
fn the_oracle_outlines_faces_where_they_are() {
    for truth in rooms().into_iter().flatten() {
        let (room, size) = (truth.room(), truth.camera.size);
        let camera = truth.camera;
        let oracle = Oracle::new(truth, NoiseLevel::Clean.noise(), 1, true);
        let question = LayoutQuestion { photo: size, depth: harmony_prompts::KnownDepth::None, unaided: None };
        let answer = oracle.answer(&Question::Layout(question)).unwrap();
        let answer: LayoutAnswer = serde_json::from_value(answer).unwrap();
        answer.check().unwrap();
        let features = room.shape.blocks.len() + room.shape.niches.len() + room.shape.slopes.len();
        assert_eq!(answer.shape.len(), features);
        for feature in answer.shape {
            let n = feature.face.len() as f64;
            let middle = feature.face.iter().fold(Vec2::ZERO, |sum, p| sum + Vec2::from_array(*p) / n);
            let pixel = middle / 1000.0 * Vec2::new(f64::from(size.width), f64::from(size.height));
            let exit = room.faces().exit(&camera.ray(pixel)).unwrap();
            let away = feature.wall.distance(&room.extents, exit.point);
            match feature.kind {
                LayoutFeatureKind::Block => assert!((away - feature.depth_m).abs() < 0.02, "{}", feature.what),
                LayoutFeatureKind::Niche => assert!((away + feature.depth_m).abs() < 0.02, "{}", feature.what),
                LayoutFeatureKind::Slope | LayoutFeatureKind::Tray | LayoutFeatureKind::Vault => {
                    assert_eq!(exit.surface, Surface::Ceiling);
                }
            }
        }
    }
}
