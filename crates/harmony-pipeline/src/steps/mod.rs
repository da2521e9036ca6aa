//! Steps that the object phases share; the level is data.

pub mod added;
pub mod canonical;
pub mod colour;
pub mod counts;
pub mod detect;
pub mod doubt;
pub mod grain;
pub mod groups;
pub mod hosts;
pub mod inspect;
pub mod last_look;
pub mod missing;
pub mod physical;
pub mod place;
pub mod prepare;
pub mod prints;
pub mod programs;
pub mod relief;
pub mod review;
pub mod second_look;
pub mod shades;
pub mod shading;
pub mod sun;
pub mod surfaces;
pub mod texture;
pub mod turns;
