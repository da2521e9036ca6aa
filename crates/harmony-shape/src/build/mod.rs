//! From a tree to a mesh.
