//! Steps that the object phases share; the level is data.

pub mod canonical;
pub mod detect;
pub mod inspect;
pub mod place;
pub mod prepare;
pub mod review;
pub mod surfaces;
pub mod texture;
