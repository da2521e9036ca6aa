//! What the photo and its point map show of one object: the window around its mask ([`Window`]), the outline and why it ends
//! where it does ([`Contour`]), how far it reaches ([`Outline`]), and the depths.
//!
//! Nothing here knows of poses' prices: `terms` makes nats of it.

mod contour;
mod outline;
pub(crate) mod proxy;
pub(crate) mod raster;
mod strangers;
mod window;

use std::sync::Arc;

use harmony_scene::{ImageSize, Level, Mask, PixelBox};

use crate::{Item, PartialScene};

pub(crate) use contour::{Contour, DIRECTIONS};
pub(crate) use outline::Outline;
pub(crate) use strangers::drop_strangers;
pub use window::may_be_seen;
pub(crate) use window::{Match, Window};

/// Distance from the image's border at which it cuts a mask, relative to the image's longer side: masks end a little
/// before it, and sensors and scans leave a frame around their pictures.
const BORDER: f64 = 0.012;

/// The mask of another object.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Neighbour<'a> {
    /// Where it is seen.
    pub(crate) mask: &'a Mask,
    /// Whether it may be nearer than the object in question, as far as masks and kinds tell.
    pub(crate) may_hide: bool,
    /// Whether the object in question may stand on it.
    pub(crate) may_carry: bool,
    /// Whether it is placed, so that its own depth tells.
    pub(crate) placed: bool,
}

/// Masks of all other objects, with whether they may hide an item.
pub(crate) fn neighbours<'a>(
    scene: &'a PartialScene,
    item: &'a Item,
    waiting: &'a [Arc<Item>],
    skip: Option<usize>,
) -> Vec<Neighbour<'a>> {
    let bottom = |mask: &Mask| mask.bounds().map_or(0.0, |b| b.y1);
    let own_bottom = bottom(&item.mask);
    let slack = 0.02 * f64::from(scene.camera.size.height);
    let own_box = item.mask.bounds();
    // What is seen inside an object's box most often stands before it, whatever its lowest row says.
    let inside = |mask: &Mask| match (mask.bounds(), &own_box) {
        (Some(b), Some(own)) => b.covered_by(own) > 0.5,
        _ => false,
    };
    let may_hide = |other: &Item| match (item.level, other.level) {
        _ if other.traits.flat => false,
        // What stands lower in the image stands nearer.
        (Level::Furniture, Level::Furniture) => {
            item.traits.flat || bottom(&other.mask) >= own_bottom - slack || inside(&other.mask)
        }
        // What a sheer hangs before is seen through it.
        (Level::Wall, Level::Wall) => other.traits.hangs && !other.shape.is_see_through(),
        (Level::Decoration, Level::Decoration) => bottom(&other.mask) >= own_bottom - slack,
        (_, Level::Wall) => false,
        _ => true,
    };
    let may_carry = |other: &Item| {
        let said = item.relations.on_top_of.as_ref() == Some(&other.id);
        said || item.level == Level::Decoration && other.level == Level::Furniture
    };
    let placed = scene.placed.iter().enumerate().filter(|(i, _)| Some(*i) != skip);
    let placed = placed.map(|(_, p)| (&*p.item, true));
    placed
        .chain(waiting.iter().map(|w| (&**w, false)))
        .filter(|(other, _)| other.id != item.id)
        .map(|(other, placed)| {
            let (may_hide, may_carry) = (may_hide(other), may_carry(other));
            Neighbour { mask: &other.mask, may_hide, may_carry, placed }
        })
        .chain(scene.nobodys.iter().map(|mask| Neighbour { mask, may_hide: true, may_carry: false, placed: false }))
        .collect()
}

/// [`BORDER`] in pixels.
pub(crate) fn border_px(image: ImageSize) -> f64 {
    (BORDER * f64::from(image.width.max(image.height))).max(2.0)
}

/// Which sides of a mask's box the image's border cuts: left, top, right, bottom.
pub(crate) fn cut_by_border(b: &PixelBox, image: ImageSize) -> [bool; 4] {
    let border = border_px(image);
    let (w, h) = (f64::from(image.width), f64::from(image.height));
    [b.x0 <= border, b.y0 <= border, b.x1 >= w - border, b.y1 >= h - border]
}
