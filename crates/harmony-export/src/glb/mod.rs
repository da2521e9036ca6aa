//! GLB: the scene, the empty room, and one file a level, as the paper's data set has them.
//!
//! The scene is written by `harmony-io`, as `scene_full.glb` is. Options are put on top of that file: levels of detail
//! (MSFT_lod), lossy WebP textures (EXT_texture_webp), packed geometry (EXT_meshopt_compression, its vertex format 0). A
//! plain GLB is the default, for every viewer reads it.

mod container;
mod joints;
mod lods;
mod pack;
mod pictures;

use std::collections::BTreeMap;
use std::sync::Arc;

use harmony_io::glb::{AMBIENT_GLOW, TextureEncoding};
use harmony_io::{GlbNode, GlbScene, NodeTransform, glb_bytes};
use harmony_mesh::Mesh;
use harmony_scene::Level;
use serde_json::{Value, json};

use crate::files::Files;
use crate::usd_level_name;
use crate::world::{Item, Select};
use crate::{ExportError, World};

pub(crate) use pack::unpacked;

/// What a GLB may have beside the plain scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GlbOptions {
    /// Coarser forms of each object, by MSFT_lod.
    pub lods: bool,
    /// Textures as lossy WebP.
    pub webp: bool,
    /// Geometry packed by EXT_meshopt_compression.
    pub meshopt: bool,
}

/// `glb/scene.glb`, `glb/shell.glb`, `glb/level_<name>.glb`.
///
/// # Errors
/// [`ExportError::Glb`], [`ExportError::Encode`].
pub(crate) fn write(world: &World, options: GlbOptions) -> Result<Files, ExportError> {
    let mut files = Files::default();
    let all: Vec<&Item> = world.items.iter().collect();
    files.add(
        "glb/scene.glb",
        file("glb/scene.glb", world, &all, Parts { shell: true, whole: true, glow: AMBIENT_GLOW }, options)?,
    );
    files.add(
        "glb/shell.glb",
        file("glb/shell.glb", world, &[], Parts { shell: true, whole: false, glow: AMBIENT_GLOW }, options)?,
    );
    for level in Level::ALL {
        let items: Vec<&Item> = world.level(level).collect();
        if items.is_empty() {
            continue;
        }
        let name = format!("glb/level_{}.glb", usd_level_name(level));
        let bytes = file(&name, world, &items, Parts { shell: false, whole: false, glow: AMBIENT_GLOW }, options)?;
        files.add(name, bytes);
    }
    Ok(files)
}

/// The scene without glow and without vertex colours, camera and lights, for programs that light it themselves.
///
/// # Errors
/// [`ExportError::Glb`].
pub(crate) fn for_relighting(world: &World) -> Result<Vec<u8>, ExportError> {
    let mut bare: Vec<(*const Mesh, Arc<Mesh>)> = Vec::new();
    let items: Vec<Item> = world
        .items
        .iter()
        .map(|item| {
            let key = Arc::as_ptr(&item.mesh);
            let known = bare.iter().find(|(k, _)| *k == key).map(|(_, m)| Arc::clone(m));
            let mesh = known.unwrap_or_else(|| {
                let mesh = Arc::new(Mesh { colors: Vec::new(), ..(*item.mesh).clone() });
                bare.push((key, Arc::clone(&mesh)));
                mesh
            });
            Item { mesh, ..(*item).clone() }
        })
        .collect();
    let items: Vec<&Item> = items.iter().collect();
    file("blend/scene.glb", world, &items, Parts { shell: true, whole: false, glow: 0.0 }, GlbOptions::default())
}

/// What of a scene goes into a file.
#[derive(Debug, Clone, Copy)]
struct Parts {
    shell: bool,
    whole: bool,
    glow: f64,
}

fn file(
    name: &str,
    world: &World,
    items: &[&Item],
    Parts { shell, whole, glow }: Parts,
    options: GlbOptions,
) -> Result<Vec<u8>, ExportError> {
    let glb_error = |source| ExportError::Glb { file: name.to_owned(), source };
    let mut objects: Vec<GlbNode> = Vec::new();
    let mut fixed: BTreeMap<usize, Arc<Mesh>> = BTreeMap::new();
    for item in items {
        let mesh = if item.opens.is_empty() {
            Arc::clone(&item.mesh)
        } else {
            // Identical objects share what does not open as well.
            let key = Arc::as_ptr(&item.mesh) as usize;
            Arc::clone(fixed.entry(key).or_insert_with(|| Arc::new(item.selected(Select::Fixed))))
        };
        objects.push(node(item.name().to_owned(), item, mesh, extras(item)));
        objects.extend(joints::nodes(item));
    }
    let opens = items.iter().any(|i| !i.opens.is_empty());
    let coarser = if options.lods { lods::coarser(items) } else { Vec::new() };
    for lod in &coarser {
        objects.push(node(lod.name.clone(), items[lod.item], Arc::clone(&lod.mesh), Value::Null));
    }
    let faces = world.shell.iter().map(|f| GlbNode {
        name: f.name.clone(),
        mesh: Arc::clone(&f.mesh),
        transform: NodeTransform::IDENTITY,
        extras: json!({ "surface": f.name }),
    });
    let scene = GlbScene {
        objects,
        shell: if shell { faces.collect() } else { Vec::new() },
        camera: whole.then_some(world.camera),
        lighting: whole.then_some(&world.scene.lighting),
        glow,
        extras: json!({
            "generator": world.scene.generator,
            "room": world.scene.room,
            "frame": "right-handed, +X width, +Y up, +Z from the back wall to the viewer, metres",
        }),
        generator: world.scene.generator.clone(),
        textures: TextureEncoding::Compact,
    };
    let mut bytes = glb_bytes(&scene).map_err(glb_error)?;
    if opens || options.lods || options.webp || options.meshopt {
        let mut parts = container::Parts::of(&bytes).map_err(glb_error)?;
        joints::link(&mut parts, items);
        if options.lods {
            lods::link(&mut parts, &coarser, items);
        }
        if options.webp {
            pictures::to_webp(&mut parts)?;
        }
        if options.meshopt {
            pack::pack(&mut parts);
        }
        bytes = parts.bytes().map_err(glb_error)?;
    }
    Ok(bytes)
}

fn node(name: String, item: &Item, mesh: Arc<Mesh>, extras: Value) -> GlbNode {
    GlbNode { name, mesh, transform: NodeTransform::from(&item.object.pose), extras }
}

/// What `scene_full.glb` says of an object.
fn extras(item: &Item) -> Value {
    let o = &item.object;
    json!({
        "id": o.id, "label": o.label, "level": o.level, "description": o.description, "size_m": o.size,
        "support": o.support, "relations": o.relations, "material": o.material, "confidence": o.confidence,
        "mesh_source": o.mesh_source, "index": o.index,
        "opens": opens_of(item),
    })
}

/// Names of the parts that open, or why there are none.
fn opens_of(item: &Item) -> Value {
    match &item.rigid {
        Some(why) => json!({ "parts": [], "rigid": why }),
        None => json!({ "parts": item.opens.iter().map(|o| &o.name).collect::<Vec<_>>() }),
    }
}
