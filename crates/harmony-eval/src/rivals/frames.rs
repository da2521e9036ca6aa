//! From the axes of others to ours, and meshes with their transforms baked in.

use glam::{DAffine3, DMat3, DVec3};
use harmony_mesh::Mesh;

/// Axes of a file. None of the conversions mirrors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axes {
    /// glTF: +Y up.
    YUp,
    /// Blender: +Z up.
    ZUp,
    /// OpenCV: x right, y down, z forward.
    OpenCv,
    /// PyTorch3D: x left, y up, z forward.
    PyTorch3d,
}

impl std::str::FromStr for Axes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "y-up" => Ok(Self::YUp),
            "z-up" => Ok(Self::ZUp),
            "opencv" => Ok(Self::OpenCv),
            "pytorch3d" => Ok(Self::PyTorch3d),
            _ => Err("axes are y-up, z-up, opencv, pytorch3d".to_owned()),
        }
    }
}

impl Axes {
    /// `world_from_file`: what turns a point of the file into our world.
    pub fn turn(self) -> DMat3 {
        match self {
            Self::YUp => DMat3::IDENTITY,
            Self::ZUp => DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
            Self::OpenCv => DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
            Self::PyTorch3d => DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0)),
        }
    }

    /// Whether it is a camera's frame.
    pub fn is_camera(self) -> bool {
        matches!(self, Self::OpenCv | Self::PyTorch3d)
    }
}

/// The mesh at its place. A transform that mirrors keeps the outside outside.
pub fn baked(mesh: &Mesh, place: &DAffine3) -> Mesh {
    let mut mesh = mesh.clone();
    let m = place.matrix3;
    // Cofactors: the direction of the inverse transpose, defined for flat transforms too.
    let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    let normals = DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis)) * sign;
    mesh.map(
        |p| place.transform_point3(p.as_dvec3()).as_vec3(),
        |n| (normals * n.as_dvec3()).try_normalize().unwrap_or(DVec3::Y).as_vec3(),
    );
    if sign < 0.0 {
        mesh.groups.iter_mut().flat_map(|g| &mut g.triangles).for_each(|t| t.swap(1, 2));
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_axes_mirror_and_each_goes_where_the_table_says() {
        for axes in [Axes::YUp, Axes::ZUp, Axes::OpenCv, Axes::PyTorch3d] {
            assert!((axes.turn().determinant() - 1.0).abs() < 1e-12, "{axes:?}");
        }
        let p = DVec3::new(1.0, 2.0, 3.0);
        assert_eq!(Axes::ZUp.turn() * p, DVec3::new(1.0, 3.0, -2.0));
        assert_eq!(Axes::OpenCv.turn() * p, DVec3::new(1.0, -2.0, -3.0));
        assert_eq!(Axes::PyTorch3d.turn() * p, DVec3::new(-1.0, 2.0, -3.0));
    }
}
