//! Part models: read, checked, and built into a mesh of any size.
#![no_main]

use harmony_mesh::PartModel;
use harmony_scene::Size;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Some((head, text)) = data.split_at_checked(3) else { return };
    let Ok(text) = std::str::from_utf8(text) else { return };
    let Ok(model) = PartModel::from_json(text) else { return };
    // 1 mm to 50 m, in steps of a sixth of an octave around half a metre.
    let side = |b: u8| (0.5 * f64::powf(2.0, (f64::from(b) - 128.0) / 14.0)).clamp(0.001, 50.0);
    let size = Size { width: side(head[0]), height: side(head[1]), depth: side(head[2]) };
    if let Ok(built) = model.build(size) {
        built.mesh.check().expect("a built mesh is sound");
        assert!(built.convex.iter().flat_map(|p| &p.points).all(|p| p.is_finite()));
        assert!(built.mesh.triangle_count() < 4_000_000);
    }
});
