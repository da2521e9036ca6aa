//! What Blender gives back.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read as exr_read};
use harmony_scene::{ImageSize, ViewTransform};
use image::RgbImage;
use serde::{Deserialize, Serialize};

use super::{CyclesJob, LitError, RenderMode};
use crate::{GreyResponse, LinearImage, ViewTable};

/// Light that came from one source.
#[derive(Debug, Clone, PartialEq)]
pub struct LightPass {
    /// Id of the light, or `None` for the ambient light.
    pub light: Option<String>,
    /// Whether it is daylight through a window, as far as is known: nearly white, unlike a lamp.
    pub is_daylight: bool,
    /// Its contribution at the job's intensity and colour, before exposure.
    pub image: LinearImage,
}

/// Where the time went, seconds of wall clock.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct CyclesTimings {
    /// Whole process, as seen from here.
    pub total: f64,
    /// Starting, importing the GLB and building the scene.
    pub load: f64,
    /// Rendering and denoising.
    pub render: f64,
}

/// A finished job.
#[derive(Debug, Clone)]
pub struct CyclesOutput {
    /// The picture, sRGB ([`RenderMode::Lit`]).
    pub image: Option<RgbImage>,
    /// Per-light images, lights that are on in the job's order, then ambient ([`RenderMode::PerLight`]).
    pub lights: Vec<LightPass>,
    /// Ids, row-major ([`RenderMode::Ids`], [`RenderMode::PerLight`]).
    pub ids: Option<Vec<u32>>,
    /// Diffuse reflectance as rendered ([`RenderMode::PerLight`]).
    pub albedo: Option<LinearImage>,
    /// The job's views, sampled ([`RenderMode::PerLight`]).
    pub views: Vec<ViewTable>,
    /// How grey light becomes 8-bit values under the job's view transform.
    pub response: GreyResponse,
    /// Gain that [`crate::Delight`] gave to the base colours; 1 without it.
    pub albedo_gain: f64,
    /// Blender's version.
    pub version: String,
    /// Where the time went.
    pub timings: CyclesTimings,
    /// Largest resident memory of the process, MiB.
    pub peak_memory_mb: u64,
    /// Triangles of the scene as Blender read it.
    pub triangles: u64,
    /// What the script had to leave out or could not find, in words.
    pub notes: Vec<String>,
}

/// The script's own account.
#[derive(Debug, Deserialize)]
struct ResultFile {
    version: String,
    load_s: f64,
    render_s: f64,
    peak_memory_mb: u64,
    triangles: u64,
    albedo_gain: f64,
    response_light: Vec<f32>,
    response_display: Vec<f32>,
    notes: Vec<String>,
}

fn bad(reason: impl Into<String>) -> LitError {
    LitError::BadOutput { reason: reason.into() }
}

/// Reads everything that the script left in its folder.
pub(super) fn read(job: &CyclesJob, folder: &Path, total: Duration) -> Result<CyclesOutput, LitError> {
    let text = std::fs::read(folder.join("result.json"))
        .map_err(|source| LitError::Io { what: "read Blender's result file", source })?;
    let result: ResultFile = serde_json::from_slice(&text).map_err(|e| bad(format!("result file: {e}")))?;
    let size = job.camera.size;
    let mut output = CyclesOutput {
        image: None,
        lights: Vec::new(),
        ids: None,
        albedo: None,
        views: Vec::new(),
        response: if result.response_light.len() >= 2 {
            GreyResponse { light: result.response_light, display: result.response_display }
        } else {
            GreyResponse::srgb()
        },
        albedo_gain: result.albedo_gain,
        version: result.version,
        timings: CyclesTimings { total: total.as_secs_f64(), load: result.load_s, render: result.render_s },
        peak_memory_mb: result.peak_memory_mb,
        triangles: result.triangles,
        notes: result.notes,
    };
    match job.mode {
        RenderMode::Lit => {
            let image = image::open(folder.join("lit.png")).map_err(|e| bad(format!("picture: {e}")))?.into_rgb8();
            if (image.width(), image.height()) != (size.width, size.height) {
                return Err(bad(format!("the picture is {} x {}", image.width(), image.height())));
            }
            output.image = Some(image);
        }
        RenderMode::Ids => {
            let channels = exr_channels(&folder.join("ids.exr"), size)?;
            let red = channels.iter().find(|(name, _)| name.ends_with('R'));
            let (_, red) = red.ok_or_else(|| bad("the id image has no red channel"))?;
            output.ids = Some(red.iter().map(|v| v.round().max(0.0) as u32).collect());
        }
        RenderMode::PerLight => {
            let channels = exr_channels(&folder.join("lights.exr"), size)?;
            for (index, light) in job.lighting.lights.iter().enumerate().filter(|(_, l)| l.on) {
                let image = light_group(&channels, &format!("light_{index}"), size)?;
                output.lights.push(LightPass { light: Some(light.id.clone()), is_daylight: false, image });
            }
            output.lights.push(LightPass {
                light: None,
                is_daylight: false,
                image: light_group(&channels, "ambient", size)?,
            });
            output.albedo = Some(rgb_of(&channels, &["DiffCol", "Diffuse Color"], size)?);
            let nodes = indices(&channels, ["IndexOB", "Object Index"])?;
            let parts = indices(&channels, ["IndexMA", "Material Index"])?;
            let ids = nodes.zip(parts).map(|(node, part)| if part > 0 { part } else { node });
            output.ids = Some(ids.collect());
            output.views = view_tables(&job.views, folder)?;
        }
    }
    Ok(output)
}

/// An index pass, by the names that Blender's versions give it.
fn indices<'a>(
    channels: &'a BTreeMap<String, Vec<f32>>,
    names: [&str; 2],
) -> Result<impl Iterator<Item = u32> + 'a, LitError> {
    let pass = channels.iter().find(|(n, _)| names.iter().any(|name| n.contains(name)));
    let (_, pass) = pass.ok_or_else(|| bad(format!("the EXR has no {}", names[1].to_lowercase())))?;
    Ok(pass.iter().map(|v| v.round().max(0.0) as u32))
}

/// The image of a light group: channels `...Combined_<group>.{R,G,B}`.
fn light_group(channels: &BTreeMap<String, Vec<f32>>, group: &str, size: ImageSize) -> Result<LinearImage, LitError> {
    let channel = |c: char| {
        let end = format!("Combined_{group}.{c}");
        let found = channels.iter().find(|(name, _)| name.ends_with(&end)).map(|(_, values)| values);
        found.ok_or_else(|| {
            let names: Vec<&str> = channels.keys().map(String::as_str).take(12).collect();
            bad(format!("no channel {end} among {}", names.join(", ")))
        })
    };
    let (r, g, b) = (channel('R')?, channel('G')?, channel('B')?);
    let rgb = r.iter().zip(g).zip(b).map(|((r, g), b)| [*r, *g, *b]).collect();
    Ok(LinearImage { size, rgb })
}

/// The image of a pass under one of its names.
fn rgb_of(channels: &BTreeMap<String, Vec<f32>>, names: &[&str], size: ImageSize) -> Result<LinearImage, LitError> {
    let channel = |c: char| {
        let mut ends = names.iter().map(|n| format!("{n}.{c}"));
        let found = ends.find_map(|end| channels.iter().find(|(name, _)| name.ends_with(&end)));
        found.map(|(_, values)| values).ok_or_else(|| bad(format!("the EXR has no pass {}", names.join(" or "))))
    };
    let (r, g, b) = (channel('R')?, channel('G')?, channel('B')?);
    Ok(LinearImage { size, rgb: r.iter().zip(g).zip(b).map(|((r, g), b)| [*r, *g, *b]).collect() })
}

/// The tables that the script sampled, in the order of the job.
fn view_tables(views: &[ViewTransform], folder: &Path) -> Result<Vec<ViewTable>, LitError> {
    if views.is_empty() {
        return Ok(Vec::new());
    }
    let bytes = std::fs::read(folder.join("views.f32"))
        .map_err(|source| LitError::Io { what: "read Blender's view tables", source })?;
    let values: Vec<f32> =
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap_or_default())).collect();
    let count = values.len() / 3 / views.len();
    let rgb: Vec<[f32; 3]> = values.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect();
    views
        .iter()
        .enumerate()
        .map(|(i, view)| {
            let own = rgb.get(i * count..(i + 1) * count).unwrap_or_default().to_vec();
            ViewTable::new(*view, own).ok_or_else(|| bad(format!("a view table of {count} values")))
        })
        .collect()
}

/// All channels of an EXR by `layer.channel`, whether layers are parts or name prefixes.
fn exr_channels(path: &Path, size: ImageSize) -> Result<BTreeMap<String, Vec<f32>>, LitError> {
    let file = exr_read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
    let image = exr::prelude::ReadImage::from_file(file, path).map_err(|e| bad(format!("EXR: {e}")))?;
    let mut channels = BTreeMap::new();
    for layer in image.layer_data {
        let prefix = layer.attributes.layer_name.as_ref().map(|n| format!("{n}.")).unwrap_or_default();
        if (layer.size.x(), layer.size.y()) != (size.width as usize, size.height as usize) {
            return Err(bad(format!("the EXR is {} x {}", layer.size.x(), layer.size.y())));
        }
        for channel in layer.channel_data.list {
            let values = match channel.sample_data {
                FlatSamples::F32(values) => values,
                FlatSamples::F16(values) => values.iter().map(|v| v.to_f32()).collect(),
                FlatSamples::U32(values) => values.iter().map(|v| *v as f32).collect(),
            };
            channels.insert(format!("{prefix}{}", channel.name), values);
        }
    }
    Ok(channels)
}
