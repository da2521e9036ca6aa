//! What somebody made before: masks, a point map, meshes.

mod catalogue;
mod masks;
mod meshes;
pub mod obj;
mod points;

pub use catalogue::Catalogue;
pub use masks::MaskFiles;
pub use meshes::MeshFolder;
pub use points::PointMapFile;
