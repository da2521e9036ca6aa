//! Heights that furniture has because people sit at it, stand at it and walk through it: data of the catalogue.

pub(crate) use harmony_mesh::catalogue::standard_height;
