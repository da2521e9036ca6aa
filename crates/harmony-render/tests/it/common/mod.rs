//! Small meshes and cameras for the tests.
#![allow(dead_code, reason = "each test file uses some of it")]

use glam::{DVec3, Vec2};
use harmony_mesh::{Group, Material, Mesh};
use harmony_scene::{Camera, ImageSize, Intrinsics};

/// Numbers in -1..1 from a fixed linear congruential generator.
pub struct Numbers(pub u64);

impl Numbers {
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    pub fn point(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// A mesh with one plain single-sided material.
pub fn mesh_of(corners: &[DVec3], triangles: &[[u32; 3]]) -> Mesh {
    let mut mesh = Mesh {
        positions: corners.iter().map(|p| p.as_vec3()).collect(),
        uvs: vec![Vec2::ZERO; corners.len()],
        groups: vec![Group { material: 0, triangles: triangles.to_vec() }],
        materials: vec![Material::plain("m", [1.0; 3])],
        ..Mesh::default()
    };
    mesh.recompute_normals();
    mesh
}

/// Two triangles, corners counter-clockwise as seen from the front.
pub fn quad(corners: [DVec3; 4]) -> Mesh {
    mesh_of(&corners, &[[0, 1, 2], [0, 2, 3]])
}

/// An axis-aligned box with outward faces.
pub fn cube(min: DVec3, max: DVec3) -> Mesh {
    let corner = |i: usize| {
        DVec3::new(
            if i & 1 == 0 { min.x } else { max.x },
            if i & 2 == 0 { min.y } else { max.y },
            if i & 4 == 0 { min.z } else { max.z },
        )
    };
    let faces = [[4, 5, 7, 6], [1, 0, 2, 3], [5, 1, 3, 7], [0, 4, 6, 2], [6, 7, 3, 2], [0, 1, 5, 4]];
    let mut mesh = mesh_of(&[], &[]);
    for f in faces {
        let mut face = quad(f.map(corner));
        face.uvs = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)].map(Vec2::from).to_vec();
        mesh.append(&face);
    }
    mesh
}

/// A unit sphere.
pub fn sphere(around: u32, up: u32, material: Material) -> Mesh {
    let mut corners = Vec::new();
    let mut uvs = Vec::new();
    for j in 0..=up {
        for i in 0..=around {
            let (u, v) = (f64::from(i) / f64::from(around), f64::from(j) / f64::from(up));
            let (a, b) = (u * std::f64::consts::TAU, v * std::f64::consts::PI);
            corners.push(DVec3::new(b.sin() * a.sin(), b.cos(), b.sin() * a.cos()));
            uvs.push(Vec2::new(u as f32, v as f32));
        }
    }
    let mut triangles = Vec::new();
    for j in 0..up {
        for i in 0..around {
            let a = j * (around + 1) + i;
            let b = a + around + 1;
            triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
        }
    }
    let mut mesh = mesh_of(&corners, &triangles);
    mesh.uvs = uvs;
    mesh.materials = vec![material];
    mesh
}

/// A camera without roll that looks at a point.
pub fn camera(width: u32, height: u32, hfov: f64, eye: DVec3, at: DVec3) -> Camera {
    let size = ImageSize::new(width, height);
    Camera::looking(size, Intrinsics::from_horizontal_fov(size, hfov), eye, at - eye)
}
