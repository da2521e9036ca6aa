//! One room from several sides: the truth of each photo is the same room.

use harmony_bench::generate::{GeneratorSettings, generate, photographed, write};
use harmony_bench::truth::TruthRoom;
use harmony_scene::{ImageSize, Surface, Wall};

fn small() -> GeneratorSettings {
    GeneratorSettings {
        image: Some(ImageSize::new(240, 180)),
        points: 500,
        shell_points: 200,
        views: false,
        ..GeneratorSettings::default()
    }
}

#[test]
fn each_photo_has_the_same_room_in_its_own_frame() {
    let photos = photographed(101, &small(), 4);
    assert!(photos.len() >= 3, "{}", photos.len());
    let first = &photos[0].room;
    assert_eq!(first.photo, generate(101, &small()).photo, "the first is the room's own photo");
    let mut faced = Vec::new();
    for photo in &photos {
        let (room, back) = (&photo.room, photo.turn.inverse());
        // The camera faces what is called the back wall there.
        let forward = room.camera.forward();
        assert!(forward.z < 0.0 && forward.z.abs() > forward.x.abs(), "{forward}");
        faced.push(back.wall(Wall::Back));
        for (a, b) in first.objects.iter().zip(&room.objects) {
            assert_eq!(a.id, b.id);
            assert!(back.point(&room.extents, b.position).distance(a.position) < 1e-9);
            assert!((back.yaw(b.yaw) - a.yaw).sin().abs() < 1e-9);
            assert_eq!(b.wall.map(|w| back.wall(w)), a.wall);
        }
        // Ids of the shell are those of the turned names: what a pixel shows lies on that face.
        let width = room.camera.size.width as usize;
        for (i, id) in room.ids.iter().enumerate().step_by(211) {
            let face = match id {
                1 => Surface::Floor,
                3 => Surface::Back,
                4 => Surface::Right,
                5 => Surface::Front,
                6 => Surface::Left,
                _ => continue,
            };
            let pixel = glam::DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let point = room.camera.unproject(pixel, f64::from(room.depth[i]));
            let off = (point - face.point(&room.extents, face.coordinates(point))).length();
            // Jambs of windows belong to their wall.
            assert!(off < 0.12, "{} {face:?}: {off}", room.name);
        }
    }
    faced.sort_unstable();
    faced.dedup();
    assert_eq!(faced.len(), photos.len(), "each photo faces another wall");
}

#[test]
fn the_folders_are_read_as_truth() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photographed(102, &small(), 2);
    for photo in &photos {
        let path = folder.path().join(&photo.room.name);
        write(&photo.room, &path).unwrap();
        let truth = TruthRoom::load(&path).unwrap();
        for object in truth.visible() {
            let made = photo.room.objects.iter().find(|o| o.id == object.id).unwrap();
            assert_eq!(object.visible_pixels as usize, made.visible_pixels);
            assert_eq!(truth.mask(object.index).count(), made.visible_pixels);
            // Its middle projects near where it is seen, unless much of it is hidden or cut off.
            if object.occluded < 0.3 && object.truncated < 0.1 && made.visible_pixels > 200 {
                let middle = object.point(object.mesh.bounds().unwrap().centre());
                let pixel = truth.camera.project(middle).unwrap();
                let seen = truth.mask(object.index).bounds().unwrap().padded(0.5, truth.camera.size);
                assert!(seen.x0 <= pixel.x && pixel.x <= seen.x1 && seen.y0 <= pixel.y && pixel.y <= seen.y1);
            }
        }
    }
}
