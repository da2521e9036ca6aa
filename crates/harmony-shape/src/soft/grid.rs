//! Meshes from grids and tubes.
