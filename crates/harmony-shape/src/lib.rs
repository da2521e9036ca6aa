//! Shape trees: the typed form of everything that a modelling program yields (decision 0026).
//!
//! A program (crate `harmony-program`) calls modelling functions; each call makes one [`Node`] of a [`ShapeTree`]. No
//! mesh exists until the program ends: the tree is what is checked, stored, edited and meshed.
//!
//! * [`tree`]: the nodes, their limits and their check.
//! * [`material`]: slot materials and metric patterns, baked into tiles.
//! * [`build`]: from a tree to a mesh; [`solid`]: hard solids; [`soft`]: upholstery, cloth, fringes, plants.
//!
//! Frame: metres, +Y up, front +Z, origin at the bottom centre, as canonical meshes have it.

pub mod build;
pub mod material;
pub mod piece;
pub mod soft;
pub mod solid;
pub mod tree;

pub use material::{MaterialSpec, Pattern, PhotoMap};
pub use piece::Piece;
pub use tree::{Kind, Node, NodeId, ShapeTree, TreeError};
