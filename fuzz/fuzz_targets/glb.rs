//! GLB files of others, as a mesh generator or a person would give them.
#![no_main]

use harmony_io::{ReadLimits, read_glb};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let limits = ReadLimits {
        bytes: 1 << 20,
        triangles: 100_000,
        vertices: 100_000,
        nodes: 1000,
        texture_pixels: 1 << 20,
    };
    if let Ok(glb) = read_glb(data, &limits) {
        for node in &glb.nodes {
            node.mesh.check().expect("a mesh that was read is sound");
        }
        if let Ok(mesh) = glb.into_mesh() {
            mesh.check().expect("a mesh that was joined is sound");
        }
    }
});
