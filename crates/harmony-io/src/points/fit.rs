//! How a map's grid lies over the photo.

use glam::Vec3;
use harmony_scene::{ImageSize, Intrinsics, PointMap};

use super::{MapFit, PointMapOptions, PointsError};

/// Shapes that differ by less are the same, but for rounding to the network's patch size.
const SAME_ASPECT: f64 = 0.06;
/// Vision transformers round image sides to their patch size; VGGT's is 14.
const PATCH: u32 = 14;

/// Which of the ways holds, with `Auto` decided.
fn decided(map: ImageSize, options: &PointMapOptions) -> Result<MapFit, PointsError> {
    if options.fit != MapFit::Auto {
        return Ok(options.fit);
    }
    let photo = options.photo_size;
    let aspect = |s: ImageSize| f64::from(s.width) / f64::from(s.height);
    if (aspect(map) / aspect(photo)).ln().abs() <= SAME_ASPECT {
        Ok(MapFit::Stretched)
    } else if map.width == map.height && photo.width > photo.height {
        Ok(MapFit::Padded)
    } else {
        // A square map of a tall photo may be padded or cropped: nothing in the file tells which.
        Err(PointsError::Aspect {
            map_width: map.width,
            map_height: map.height,
            photo_width: photo.width,
            photo_height: photo.height,
        })
    }
}

/// The scaled photo's size and the position of the map's top-left corner in it (negative = padding).
struct Window {
    content: ImageSize,
    left: i64,
    top: i64,
}

fn window(map: ImageSize, options: &PointMapOptions) -> Result<Window, PointsError> {
    let photo = options.photo_size;
    let (pw, ph) = (f64::from(photo.width), f64::from(photo.height));
    let to_patch = |length: f64, full: u32| {
        if full.is_multiple_of(PATCH) {
            ((length / f64::from(PATCH)).round() as u32 * PATCH).max(PATCH)
        } else {
            (length.round() as u32).max(1)
        }
    };
    let content = match decided(map, options)? {
        MapFit::Padded => {
            let k = (f64::from(map.width) / pw).min(f64::from(map.height) / ph);
            let width = if pw * k >= f64::from(map.width) - 1.0 { map.width } else { to_patch(pw * k, map.width) };
            let height = if ph * k >= f64::from(map.height) - 1.0 { map.height } else { to_patch(ph * k, map.height) };
            ImageSize::new(width.min(map.width), height.min(map.height))
        }
        MapFit::Cropped => {
            ImageSize::new(map.width, to_patch(ph * f64::from(map.width) / pw, map.height).max(map.height))
        }
        MapFit::Stretched | MapFit::Auto => map,
    };
    let centred = |outer: u32, inner: u32| (i64::from(outer) - i64::from(inner)).div_euclid(2);
    Ok(Window { left: centred(content.width, map.width), top: centred(content.height, map.height), content })
}

/// Intrinsics given in photo pixels, in pixels of the map's own grid.
pub(super) fn given_for_map(
    given: Intrinsics,
    map: ImageSize,
    options: &PointMapOptions,
) -> Result<Intrinsics, PointsError> {
    let w = window(map, options)?;
    let k = given.resized(options.photo_size, w.content);
    Ok(Intrinsics { cx: k.cx - w.left as f64, cy: k.cy - w.top as f64, ..k })
}

/// The same map on a grid that covers exactly the photo.
pub(super) fn cover_photo(map: PointMap, options: &PointMapOptions) -> Result<PointMap, PointsError> {
    let w = window(map.size, options)?;
    if w.content == map.size {
        return Ok(map);
    }
    let n = w.content.pixels();
    let mut out = PointMap {
        size: w.content,
        xyz: vec![Vec3::NAN; n],
        confidence: vec![0.0; n],
        intrinsics: Intrinsics {
            cx: map.intrinsics.cx + w.left as f64,
            cy: map.intrinsics.cy + w.top as f64,
            ..map.intrinsics
        },
        ..map.clone()
    };
    for y in 0..i64::from(w.content.height) {
        for x in 0..i64::from(w.content.width) {
            let (sx, sy) = (x - w.left, y - w.top);
            if (0..i64::from(map.size.width)).contains(&sx) && (0..i64::from(map.size.height)).contains(&sy) {
                let from = sy as usize * map.size.width as usize + sx as usize;
                let to = y as usize * w.content.width as usize + x as usize;
                out.xyz[to] = map.xyz[from];
                out.confidence[to] = map.confidence[from];
            }
        }
    }
    Ok(out)
}
