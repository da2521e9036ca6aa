//! Mesh generators over HTTP.
//!
//! | player | server |
//! |---|---|
//! | `hunyuan3d_2` | `api_server.py` of Hunyuan3D-2 ([`hunyuan`]) |
//! | `hunyuan3d_2_1` | the server of Hunyuan3D-2.1 ([`hunyuan`]) |
//! | `trellis_nim` | NVIDIA's container of TRELLIS ([`trellis`]) |
//! | `trellis_localai` | LocalAI's `/3d/generations` with TRELLIS.2 ([`trellis`]) |
//! | `fal`, `replicate`, `tripo`, `meshy` | hosted services that take money for a mesh ([`hosted`]) |
//!
//! What comes back is checked, cleaned, simplified to the budget of faces and turned to +Y up, front +Z ([`finish`]).

pub mod finish;
pub mod hosted;
pub mod hunyuan;
mod picture;
pub mod trellis;
