//! The six phases. Layout and lighting are single; the four object phases share one body, the level is data.

pub mod layout;
pub mod lighting;
pub mod objects;
