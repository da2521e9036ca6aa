//! Materials and light of a finished scene (paper Sec. 3.4, App. C "Material and Lighting Estimation").
//!
//! * [`sources`]: the light sources a furnished room has, with default powers;
//! * [`spec`] and [`delta`]: the model's two answers about light, as types with bounds;
//! * [`assess`]: brightness and tone of a render against the photo, measured;
//! * [`fit`]: beyond the paper, intensities and colours by non-negative least squares over per-light images;
//! * [`scene_fit`]: the same with unknown reflectances, exposure and view transform: the main path;
//! * [`albedo`]: taking the photo's light out of textures before they are lit again;
//! * [`view`]: view transforms and their inverse;
//! * [`material`]: PBR factors and physical properties from an answer or from defaults;
//! * [`cycles`]: Blender Cycles in a process of its own.
//!
//! Everything but [`cycles`] is pure. Nothing here knows that models exist: answers come in as data.

pub mod albedo;
pub mod assess;
pub mod cycles;
pub mod delta;
pub mod fit;
pub mod linear;
pub mod material;
pub mod scene_fit;
mod schema;
mod smooth;
pub mod sources;
pub mod spec;
pub mod sun;
pub mod view;

pub use albedo::{Comparison, FieldNode, bounce_response, design_of, neutral_field, updated_field};
pub use assess::{Assessment, Brightness, Judgement, Tone, assess, judge, propose};
pub use cycles::{
    BPY_PYTHON, BPY_VERSION, BlenderKind, CyclesJob, CyclesOutput, CyclesRenderer, CyclesTimings, Delight, LightPass,
    LitError, Progress, RenderMode, bpy_folder, python_of,
};
pub use delta::{AmbientDelta, DirectionalDelta, LightingDelta, LightingVerdict, PointLightDelta, WindowDelta};
pub use fit::{FitOptions, LightFit, fit_lights, relight};
pub use linear::{GreyResponse, LinearImage};
pub use material::{MaterialAnswer, PhysicsSidecar, material_for};
pub use scene_fit::{Measured, SceneFit, fit_scene};
pub use schema::strict_schema;
pub use sources::{
    Emitter, emitter_bounds, is_cove, is_passage_light, is_shade, is_unseen_window, lights_from_scene, unseen_windows,
};
pub use spec::{AmbientSpec, DirectionalSpec, LightingSpec, PointLightSpec, SunSpec, WindowSpec};
pub use sun::{FoundSun, Place, Places, ToldSun, UnseenOpenings, find_sun, is_found_sun, sun_light, unseen_openings};
pub use view::{PictureError, ViewTable, display_linear, picture_error};
