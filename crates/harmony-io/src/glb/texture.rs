//! Images of materials as files inside a GLB file.

use std::collections::{HashMap, HashSet};
use std::sync::{Arc, LazyLock, Mutex, PoisonError, Weak};

use harmony_mesh::Mesh;
use image::{DynamicImage, RgbImage, RgbaImage};
use rayon::prelude::*;

use super::{GlbError, GlbScene, TextureEncoding};
use crate::picture::{rgb_jpeg, rgb_png, rgba_png};

/// Quality of embedded JPEG textures.
const JPEG_QUALITY: u8 = 92;
/// Quality of embedded JPEG normal maps, whose errors show as tilted light.
const NORMAL_QUALITY: u8 = 95;
/// A texture becomes JPEG when PNG is larger than that many times the JPEG.
const JPEG_GAIN: f64 = 1.5;
/// Smaller textures stay PNG, pixels.
const JPEG_MIN_PIXELS: u32 = 64 * 64;

/// What a texture's alpha channel is good for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Alpha {
    Opaque,
    /// Cut-outs: nearly every texel is on or off.
    Mask,
    Blend,
}

/// A file and its media type.
pub(super) type File = (Arc<[u8]>, &'static str);

/// A texture as it goes into the file.
pub(super) struct Compressed {
    pub alpha: Alpha,
    pub file: Result<File, GlbError>,
}

impl Compressed {
    pub(super) fn new(image: &Arc<RgbaImage>, encoding: TextureEncoding) -> Self {
        let alpha = alpha_of(image);
        Self { alpha, file: encoded(image, alpha, encoding) }
    }
}

/// Files of a scene's images by address; each is taken out once.
#[derive(Default)]
pub(super) struct Files {
    colors: HashMap<*const RgbaImage, Compressed>,
    maps: HashMap<*const RgbImage, Result<File, GlbError>>,
    encoding: TextureEncoding,
}

impl Files {
    /// The images of a scene, each on a core of its own: nothing else in a file takes as long.
    pub(super) fn of(scene: &GlbScene<'_>) -> Self {
        let mut colors: Vec<&Arc<RgbaImage>> = Vec::new();
        let mut maps: Vec<&Arc<RgbImage>> = Vec::new();
        let (mut known, mut known_maps) = (HashSet::new(), HashSet::new());
        for mesh in scene.shell.iter().chain(&scene.objects).map(|node| &node.mesh) {
            for material in mesh.groups.iter().filter_map(|group| mesh.materials.get(group.material)) {
                let tile = material.tile.as_ref().filter(|_| tiled(mesh, material));
                let color = material.texture.as_ref().or(tile.map(|t| &t.color));
                colors.extend(color.filter(|t| !t.is_empty() && known.insert(Arc::as_ptr(t))));
                let of_tile = tile.into_iter().flat_map(|t| t.normal.iter().chain(&t.surface));
                maps.extend(of_tile.filter(|t| !t.is_empty() && known_maps.insert(Arc::as_ptr(t))));
            }
        }
        let encoding = scene.textures;
        let (colors, maps) = rayon::join(
            || colors.par_iter().map(|t| (Arc::as_ptr(t) as usize, Compressed::new(t, encoding))).collect::<Vec<_>>(),
            || maps.par_iter().map(|t| (Arc::as_ptr(t) as usize, map_file(t, encoding))).collect::<Vec<_>>(),
        );
        Self {
            colors: colors.into_iter().map(|(k, v)| (k as *const RgbaImage, v)).collect(),
            maps: maps.into_iter().map(|(k, v)| (k as *const RgbImage, v)).collect(),
            encoding,
        }
    }

    /// A colour texture's file.
    pub(super) fn color(&mut self, image: &Arc<RgbaImage>) -> Compressed {
        self.colors.remove(&Arc::as_ptr(image)).unwrap_or_else(|| Compressed::new(image, self.encoding))
    }

    /// The file of normals or surface values.
    pub(super) fn map(&mut self, image: &Arc<RgbImage>) -> Result<File, GlbError> {
        self.maps.remove(&Arc::as_ptr(image)).unwrap_or_else(|| map_file(image, self.encoding))
    }
}

/// Whether a material of this mesh is drawn by its tile: there is one, no texture is in its way, and the mesh says how it
/// is laid.
pub(super) fn tiled(mesh: &Mesh, material: &harmony_mesh::Material) -> bool {
    material.texture.is_none()
        && material.tile.as_ref().is_some_and(|t| !t.color.is_empty())
        && mesh.metric_uvs.len() == mesh.positions.len()
}

fn alpha_of(image: &RgbaImage) -> Alpha {
    let (mut clear, mut between) = (0_usize, 0_usize);
    for p in image.pixels() {
        match p.0[3] {
            255 => {}
            0..=8 => clear += 1,
            _ => between += 1,
        }
    }
    match (clear, between) {
        (0, 0) => Alpha::Opaque,
        // Soft rims of cut-outs are a small part of them.
        (c, b) if b <= (c / 8).max(image.as_raw().len() / 4 / 50) && c > 0 => Alpha::Mask,
        _ => Alpha::Blend,
    }
}

fn encoded(image: &Arc<RgbaImage>, alpha: Alpha, encoding: TextureEncoding) -> Result<File, GlbError> {
    let png = lossless(image, alpha)?;
    if alpha == Alpha::Opaque && encoding == TextureEncoding::Compact {
        return smaller(png, image.width() * image.height(), || rgb_jpeg(&without_alpha(image), JPEG_QUALITY));
    }
    Ok((png, "image/png"))
}

/// A normal map's or a surface map's file; flat channels make PNG small, so that JPEG seldom wins for the latter.
fn map_file(image: &Arc<RgbImage>, encoding: TextureEncoding) -> Result<File, GlbError> {
    static KNOWN: Known<RgbImage> = Known::new();
    let png = KNOWN.file(image, || Ok(rgb_png(image)?))?;
    if encoding == TextureEncoding::Compact {
        return smaller(png, image.width() * image.height(), || rgb_jpeg(image, NORMAL_QUALITY));
    }
    Ok((png, "image/png"))
}

/// The JPEG where it is much smaller.
fn smaller(
    png: Arc<[u8]>,
    pixels: u32,
    jpeg: impl FnOnce() -> Result<Vec<u8>, crate::picture::PictureError>,
) -> Result<File, GlbError> {
    if pixels >= JPEG_MIN_PIXELS {
        let jpeg = jpeg()?;
        if png.len() as f64 > JPEG_GAIN * jpeg.len() as f64 {
            return Ok((jpeg.into(), "image/jpeg"));
        }
    }
    Ok((png, "image/png"))
}

/// The texture as PNG, made once as long as somebody holds it: a mesh is written with its answer, as an object, and in the
/// scene.
fn lossless(image: &Arc<RgbaImage>, alpha: Alpha) -> Result<Arc<[u8]>, GlbError> {
    static KNOWN: Known<RgbaImage> = Known::new();
    KNOWN.file(image, || Ok(if alpha == Alpha::Opaque { rgb_png(&without_alpha(image))? } else { rgba_png(image)? }))
}

/// Files by an image's address, which stays that image's own as long as the `Weak` is here.
type ByAddress<T> = HashMap<usize, (Weak<T>, Arc<[u8]>)>;

/// Files already made.
struct Known<T>(LazyLock<Mutex<ByAddress<T>>>);

impl<T> Known<T> {
    const fn new() -> Self {
        Self(LazyLock::new(Mutex::default))
    }

    fn file(&self, image: &Arc<T>, make: impl FnOnce() -> Result<Vec<u8>, GlbError>) -> Result<Arc<[u8]>, GlbError> {
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let key = Arc::as_ptr(image) as usize;
        if let Some((_, file)) = known().get(&key) {
            return Ok(Arc::clone(file));
        }
        let file: Arc<[u8]> = make()?.into();
        let mut known = known();
        known.retain(|_, (image, _)| image.strong_count() > 0);
        known.insert(key, (Arc::downgrade(image), Arc::clone(&file)));
        Ok(file)
    }
}

fn without_alpha(image: &RgbaImage) -> RgbImage {
    DynamicImage::ImageRgba8(image.clone()).into_rgb8()
}
