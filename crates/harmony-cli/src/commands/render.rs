//! `harmony render`: the scene of a run from a chosen camera, read back from its files.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use glam::{DMat3, DVec3};
use harmony_export::World;
use harmony_export::world::Item;
use harmony_io::{ReadLimits, albedo_field, load_glb, picture, scene_for_light};
use harmony_lighting::CyclesRenderer;
use harmony_mesh::{Mesh, is_left_out};
use harmony_physics::pictures::{Lit, LitView};
use harmony_pipeline::views::{hidden_nodes, inner_cameras};
use harmony_render::{Instance, Lighting, OUTSIDE, RenderOptions, canonical_camera, orbit_cameras, render};
use harmony_scene::{AlbedoField, Camera, ImageSize, Scene, Surface};
use image::{DynamicImage, RgbImage};

use crate::display::hinted;
use crate::{EXIT_OK, say, tell};

/// Which view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum View {
    /// The photo's camera.
    Input,
    /// From above, near walls and ceiling removed.
    Canonical,
    /// All around, several pictures.
    Orbit,
    /// From two places in the room where the photo was not taken.
    Inner,
}

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  harmony render run --camera canonical --out above.png
  harmony render run --camera orbit --views 12
  harmony render run --camera inner --out side.png
  harmony render run --camera inner --lit --out lit.png")]
pub struct Args {
    /// Run folder.
    run: PathBuf,
    /// Which view.
    #[arg(long, value_enum, default_value = "canonical")]
    camera: View,
    /// Longest side, pixels; default 1280, for the photo's camera the photo's own.
    #[arg(long, value_parser = clap::value_parser!(u32).range(16..=8192))]
    size: Option<u32>,
    /// Pictures of an orbit.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=360))]
    views: u16,
    /// Shade with a light at the camera instead of showing the textures as they are.
    #[arg(long)]
    head_light: bool,
    /// Path-trace with the scene's own light, as `render_lit.png` is (Blender; a run that went through phase 6).
    #[arg(long, conflicts_with_all = ["head_light", "open", "ids"])]
    lit: bool,
    /// Samples a pixel with --lit.
    #[arg(long, default_value_t = 48, requires = "lit", value_parser = clap::value_parser!(u32).range(1..=4096))]
    samples: u32,
    /// Open doors and drawers by a share of their ranges, 0 to 1; without a number all the way.
    #[arg(long, value_name = "SHARE", num_args = 0..=1, default_missing_value = "1", value_parser = share)]
    open: Option<f64>,
    /// Output PNG (where there are several, a number is added); default `<run>/render_<camera>.png`.
    #[arg(long, short)]
    out: Option<PathBuf>,
    /// Also write which object each pixel shows: a 16-bit grey PNG of the `index` in scene.json, 0 for the room.
    #[arg(long, value_name = "PNG")]
    ids: Option<PathBuf>,
}

fn share(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("\"{text}\" is no number"))?;
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err("a share is between 0 and 1".to_owned()) }
}

/// Meshes of the objects that open, opened, by node.
fn opened(args: &Args, open: f64) -> Result<BTreeMap<String, Mesh>> {
    let world = World::read(&args.run).map_err(|e| hinted(e.to_string(), e.hint()))?;
    let items: Vec<&Item> = world.items.iter().filter(|i| !i.opens.is_empty()).collect();
    if items.is_empty() {
        tell!("nothing in this scene opens: harmony export says of each object why, in export.json");
    }
    for item in &items {
        let parts: Vec<&str> = item.opens.iter().map(|o| o.name.as_str()).collect();
        tell!("open: {}", parts.join(", "));
    }
    Ok(items.into_iter().map(|i| (i.name().to_owned(), i.opened(open))).collect())
}

/// Runs the command.
///
/// # Errors
/// A run without a scene, or an unwritable file.
pub fn run(args: &Args) -> Result<u8> {
    let scene: Scene = harmony_io::read_json(&args.run.join("scene.json")).context("this run has no scene yet")?;
    let glb = load_glb(&args.run.join("scene_full.glb"), &ReadLimits::default())?;
    let opened = args.open.map(|share| opened(args, share)).transpose()?.unwrap_or_default();
    let photo = Camera::from(&scene.camera);
    let several = matches!(args.camera, View::Orbit | View::Inner);
    if args.ids.is_some() && several {
        bail!("--ids is one picture, this camera makes several; choose --camera input or canonical");
    }
    let size = args.size.map_or(photo.size, |longest| photo.size.fit_within(longest));
    let longest = args.size.unwrap_or(1280);
    let wide = ImageSize::new(longest, longest * 3 / 4);
    let views: Vec<(Camera, Vec<Surface>, String)> = match args.camera {
        View::Input => vec![(photo.resized(size), Vec::new(), "input".into())],
        View::Canonical => {
            let view = canonical_camera(&scene.room, wide, &photo, &scene.stands());
            vec![(view.camera, view.omit, "canonical".into())]
        }
        View::Orbit => orbit_cameras(&scene.room, wide, usize::from(args.views))
            .into_iter()
            .enumerate()
            .map(|(i, view)| (view.camera, view.omit, format!("orbit_{i:02}")))
            .collect(),
        View::Inner => inner_cameras(&scene.room, &photo, wide)
            .into_iter()
            .enumerate()
            .map(|(i, camera)| (camera, Vec::new(), format!("inner_{i:02}")))
            .collect(),
    };
    let traced = args.lit.then(|| Traced::new(args, &scene)).transpose()?;
    for (camera, omit, name) in views {
        let path = match (&args.out, several) {
            (Some(out), true) => {
                let stem = out.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
                out.with_file_name(format!("{stem}_{name}.png"))
            }
            (Some(out), _) => out.clone(),
            (None, _) => args.run.join(format!("render_{}{name}.png", if args.lit { "lit_" } else { "" })),
        };
        let hidden = hidden_nodes(&omit, &scene.gone_with(&omit), glb.nodes.iter().map(|n| n.name.as_str()));
        if let Some(traced) = &traced {
            tell!("path-tracing {name}");
            picture::write_rgb_png(&path, &traced.picture(&scene, camera, &hidden)?)?;
            say!("{}", path.display())?;
            continue;
        }
        let instances: Vec<Instance<'_>> = glb
            .nodes
            .iter()
            .filter(|node| !is_left_out(&node.name, &hidden))
            .map(|node| Instance {
                mesh: opened.get(&node.name).unwrap_or(&node.mesh),
                linear: DMat3::from_cols_array(&node.transform.matrix3.to_cols_array()),
                translation: DVec3::from_array(node.transform.translation.to_array()),
                id: index_of(&scene, &node.name),
            })
            .collect();
        let options = RenderOptions {
            multisample: true,
            lighting: if args.head_light { Lighting::HeadLight } else { Lighting::Unlit },
            background: OUTSIDE,
            ..RenderOptions::default()
        };
        let frame = render(&camera, &instances, &options);
        if let Some(path) = &args.ids {
            picture::write_ids_png(path, camera.size, &frame.ids)?;
        }
        picture::write_rgb_png(&path, &DynamicImage::ImageRgba8(frame.color).to_rgb8())?;
        say!("{}", path.display())?;
    }
    Ok(EXIT_OK)
}

/// The path tracer with a run's scene and light.
struct Traced {
    renderer: CyclesRenderer,
    glb: Vec<u8>,
    albedo: Option<AlbedoField>,
    samples: u32,
}

impl Traced {
    fn new(args: &Args, scene: &Scene) -> Result<Self> {
        if scene.lighting.lights.is_empty() && scene.lighting.ambient_intensity <= 0.0 {
            return Err(hinted(
                "this scene has no light".to_owned(),
                Some("`harmony reconstruct` with the same photo and --out goes on where the run stopped"),
            ));
        }
        let glb = harmony_io::read_bounded(&scene_for_light(&args.run), ReadLimits::default().bytes)?;
        let albedo = albedo_field(&args.run);
        Ok(Self { renderer: super::simulate::blender()?, glb, albedo, samples: args.samples })
    }

    fn picture(&self, scene: &Scene, camera: Camera, hidden: &[String]) -> Result<RgbImage> {
        let view = LitView { camera, hidden: hidden.to_vec(), true_colors: Vec::new() };
        let lit =
            Lit { renderer: &self.renderer, scene, albedo: self.albedo.clone(), samples: self.samples, kept: None };
        Ok(lit.picture(&self.glb, &[], &view)?)
    }
}

/// The number of a node's object; the room has none.
fn index_of(scene: &Scene, node: &str) -> u32 {
    scene.objects.iter().find(|o| o.id.as_str() == node).map_or(0, |o| o.index)
}
