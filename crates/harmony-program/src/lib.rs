//! Modelling programs: text that a model wrote, run in a cage, becomes a [`ShapeTree`](harmony_shape::ShapeTree).
//!
//! The language is Starlark (a Python without files, clock, network or `while`) with about 130 functions that make curves,
//! outlines, parts, materials and patterns. A program defines `build`, which gives back a part:
//!
//! ```
//! use harmony_program::{Inputs, Limits, evaluate};
//! let source = "
//! def build(w, h, d):
//!     oak = mat('oak', '#b98a58', map = wood(seed = 1))
//!     top = box((w, 0.03, d), bevel = 0.003, mat = oak).at(0, h - 0.03, 0)
//!     leg = cylinder(0.02, h - 0.03, mat = oak).at(w / 2 - 0.05, 0, d / 2 - 0.05)
//!     return group('table', top = top, legs = mirror(leg, 'xz'))
//! ";
//! let size = harmony_scene::Size { width: 1.2, height: 0.75, depth: 0.7 };
//! let tree = evaluate(source, &Inputs::object(size), &Limits::default())?;
//! assert_eq!(tree.materials[0].name, "oak");
//! # Ok::<(), harmony_program::ProgramError>(())
//! ```
//!
//! * [`prescan()`]: what is refused before anything parses it.
//! * [`evaluate`]: in this process. The interpreter's own limits do not hold against hostile programs.
//! * [`run`]: the same in a child process with limits of memory and time ([`child_main`] is what the child does). What a
//!   program can and cannot do to the machine stands in `docs/decisions/0026-modelling-programs.md`.
//! * [`GUIDE`]: what a model that writes programs is told.

mod bounds;
mod cage;
mod call;
mod child;
mod curves;
mod engine;
mod error;
mod functions;
mod guide;
mod hints;
mod inputs;
mod letters;
mod names;
mod numbers;
mod outlines;
mod prescan;
mod session;
mod source;
mod thing;

pub use cage::{ChildCommand, run};
pub use child::{CHILD_COMMAND, child_main};
pub use engine::{check_syntax, evaluate};
pub use error::{ErrorKind, ProgramError};
pub use guide::{GUIDE, signatures};
pub use inputs::{Inputs, Limits, Surface};
pub use prescan::prescan;
