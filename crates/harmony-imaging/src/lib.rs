//! Classical image operations, for the players that work without a network and for the room's surfaces.
//!
//! | module | does |
//! |---|---|
//! | [`color`] | sRGB, linear light, CIE Lab; median and dominant colours of a mask |
//! | [`segment`] | cuts an object out of a photo, from a box and perhaps a rough outline |
//! | [`polygon`] | filled polygons |
//! | [`outline`] | the outline of a mask as a polygon |
//! | [`regions`] | proposes object regions that differ from floor, walls and ceiling |
//! | [`inpaint`] | fills a hole from the rest of the photo |
//! | [`rectify`] | quadrilaterals and room surfaces seen head-on |
//! | [`tile`] | completes a partly seen surface; tileable material samples |
//! | [`border`] | the white or black frame of an undistorted picture |
//! | [`sheet`] | contact sheets, boxes, overlays, grids and crops for questions |
//!
//! Nothing here knows that models exist, reads or writes files, or panics on its input: masks of another size than
//! the photo are resized to it, boxes are cut to the image, and an empty input gives an empty answer. Same input,
//! same output: seeds are fixed and the number of threads has no influence.

mod components;
mod distance;
mod maxflow;
mod noise;
pub mod polygon;
mod resample;

pub mod border;
pub mod color;
pub mod inpaint;
pub mod outline;
pub mod rectify;
pub mod regions;
pub mod segment;
pub mod sheet;
pub mod tile;

use std::borrow::Cow;

use harmony_scene::{ImageSize, Mask};
use image::{GenericImageView, Pixel};

/// Size of an image in the project's words.
pub(crate) fn size_of<I: GenericImageView>(image: &I) -> ImageSize
where
    I::Pixel: Pixel,
{
    ImageSize::new(image.width(), image.height())
}

/// The mask at the image's size.
pub(crate) fn fitted<'a, I: GenericImageView>(mask: &'a Mask, image: &I) -> Cow<'a, Mask> {
    let size = size_of(image);
    if mask.size() == size { Cow::Borrowed(mask) } else { Cow::Owned(mask.resized(size)) }
}
