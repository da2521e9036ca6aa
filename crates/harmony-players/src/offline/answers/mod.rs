//! One rule a question, for those that have an answer without looking at more than fields and colours.

mod inspect;
mod layout;
mod lights;
mod list;

pub(super) use inspect::inspect;
pub(super) use layout::layout;
pub(super) use lights::lights;
pub(super) use list::list;
