//! What a program is given, and how much it may use.

use std::collections::BTreeMap;

use harmony_scene::{Camera, Extents, Size};
use serde::{Deserialize, Serialize};

pub use harmony_scene::Surface;

/// What a program is given: the object's size, parameters, and for room features camera and room.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Inputs {
    /// Width, height and depth of the object: what `build` takes as `w`, `h`, `d`.
    pub size: Option<Size>,
    /// Other parameters of `build`, by name; what `build` does not take is left out.
    pub params: BTreeMap<String, serde_json::Value>,
    /// The photo's camera in the room, for `pixel`.
    pub camera: Option<Camera>,
    /// The room, for `wall`, `floor`, `ceiling`.
    pub room: Option<Extents>,
    /// Columns (x, y, z, origin) of the rigid map that carries the program's frame into the room; the room's frame itself
    /// when there is none. What `pixel` and frames give is in the program's frame.
    pub room_from_program: Option<[[f64; 3]; 4]>,
}

impl Inputs {
    /// For an object of a size.
    pub fn object(size: Size) -> Self {
        Self { size: Some(size), ..Self::default() }
    }

    /// For a feature of a room, in the room's frame.
    pub fn feature(room: Extents, camera: Option<Camera>) -> Self {
        Self { camera, room: Some(room), ..Self::default() }
    }

    /// In the frame of a surface of the room: x along its u, y along its v, z into the room. Without a room nothing
    /// changes.
    ///
    /// Walls: u to the right as seen from inside, v up. Floor: u right, v away from the viewer. Ceiling: u right, v from
    /// the back wall towards the viewer.
    #[must_use]
    pub fn in_frame(mut self, surface: Surface) -> Self {
        self.room_from_program = self
            .room
            .as_ref()
            .map(|room| crate::functions::arrays::columns(&crate::functions::room::Frame::of(surface, room).map()));
        self
    }

    /// With one more parameter of `build`.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl Into<serde_json::Value>) -> Self {
        self.params.insert(name.to_owned(), value.into());
        self
    }
}

/// How much a program may use. The defaults are what programs of models are run with; a tree has limits of its own
/// (`harmony_shape::tree`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Statements of the program, each time they run.
    pub statements: u64,
    /// Memory of the interpreter's own heap, bytes; checked before each statement.
    pub heap_bytes: u64,
    /// Depth of calls.
    pub depth: u32,
    /// Processor time for the evaluation, seconds; checked between statements.
    pub seconds: f64,
    /// Points of curves and outlines, made in all.
    pub curve_points: u64,
    /// Particles of draped cloth in all.
    pub cloth: u64,
    /// Calls of functions of the program by `surf`.
    pub cells: u64,
    /// Triangles of the whole, estimated before anything is meshed.
    pub triangles: u64,
    /// Of the child process: address space, bytes.
    pub address_space_bytes: u64,
    /// Of the child process: processor time, seconds.
    pub cpu_seconds: u64,
    /// Of the child process: time on the clock, seconds.
    pub wall_seconds: f64,
    /// Of the child process: bytes that it may answer.
    pub output_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            statements: 2_000_000,
            heap_bytes: 256 << 20,
            depth: 64,
            seconds: 8.0,
            curve_points: 400_000,
            cloth: 60_000,
            cells: 100_000,
            triangles: 1_500_000,
            address_space_bytes: 1536 << 20,
            cpu_seconds: 10,
            // Beside other work the clock runs on: a rug whose program takes a second was refused on a busy machine.
            wall_seconds: 60.0,
            output_bytes: 16 << 20,
        }
    }
}
