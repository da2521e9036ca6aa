//! What somebody made before: masks, a point map, meshes.

mod masks;
mod meshes;
mod points;

pub use masks::MaskFiles;
pub use meshes::MeshFolder;
pub use points::PointMapFile;
