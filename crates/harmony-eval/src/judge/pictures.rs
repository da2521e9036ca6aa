//! The pictures that a judge gets: of one size, without names, the same views of both.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use harmony_io::{load_photo, picture};
use harmony_roles::Picture;
use harmony_scene::ImageSize;
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};

use crate::score::{Look, RunEntry, RunSet};

/// Longest side of a picture, pixels.
const LONGEST: u32 = 1024;
/// Size of elevated views.
const ELEVATED: ImageSize = ImageSize { width: 1024, height: 768 };
/// What fills the borders of a picture of another shape.
const BORDER: Rgb<u8> = Rgb([128; 3]);

/// Sets that cannot be judged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PairsError {
    /// Fewer than two sets.
    #[error("{count} sets: at least two are compared")]
    Few {
        /// How many.
        count: usize,
    },
    /// No scene that two sets have.
    #[error("no scene has a photo and a {} render in two sets", .look.name())]
    None {
        /// Which render was wanted.
        look: Look,
    },
}

impl PairsError {
    /// What a person can do about it.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::Few { .. } => "name two or more sets of runs",
            Self::None { .. } => {
                "scenes belong together by the names of their folders; --look flat needs no path tracer"
            }
        }
    }
}

/// A view of both.
#[derive(Debug, Clone)]
pub struct PairView {
    /// `the photo's view`, `from above`.
    pub name: &'static str,
    /// Of the first set.
    pub first: Arc<RgbImage>,
    /// Of the second.
    pub second: Arc<RgbImage>,
}

/// Two sets, by their numbers, the lower one first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
pub struct Pair {
    /// First set.
    pub first: usize,
    /// Second set.
    pub second: usize,
}

/// A scene of two sets, where its pictures are.
#[derive(Debug, Clone)]
pub struct JudgeScene {
    /// Name.
    pub scene: String,
    /// Which sets.
    pub pair: Pair,
    /// The photo.
    pub photo: PathBuf,
    /// The photo's view of each.
    pub input: [PathBuf; 2],
    /// The elevated view of each, where both have one.
    pub elevated: Option<[PathBuf; 2]>,
}

/// What can be judged: every scene of every two sets that both have.
///
/// # Errors
/// [`PairsError`].
pub fn pairs(sets: &[RunSet], look: Look) -> Result<Vec<JudgeScene>, PairsError> {
    if sets.len() < 2 {
        return Err(PairsError::Few { count: sets.len() });
    }
    let mut out = Vec::new();
    for first in 0..sets.len() {
        for second in first + 1..sets.len() {
            for run in &sets[first].runs {
                let Some(other) = sets[second].runs.iter().find(|r| r.name == run.name) else { continue };
                out.extend(scene(run, other, Pair { first, second }, look));
            }
        }
    }
    if out.is_empty() { Err(PairsError::None { look }) } else { Ok(out) }
}

fn scene(first: &RunEntry, second: &RunEntry, pair: Pair, look: Look) -> Option<JudgeScene> {
    let input = |run: &RunEntry| if look == Look::Lit { run.lit.clone() } else { run.flat.clone() };
    let elevated = |run: &RunEntry| {
        let file = if look == Look::Lit { "render_lit_canonical.png" } else { "render_canonical.png" };
        Some(run.path.join(file)).filter(|p| p.is_file())
    };
    Some(JudgeScene {
        scene: first.name.clone(),
        pair,
        photo: first.photo.clone().or_else(|| second.photo.clone())?,
        input: [input(first)?, input(second)?],
        elevated: elevated(first).zip(elevated(second)).map(|(a, b)| [a, b]),
    })
}

impl JudgeScene {
    /// The photo and the views, of one size each.
    ///
    /// # Errors
    /// A picture that cannot be read, in words.
    pub fn load(&self) -> Result<(Arc<RgbImage>, Vec<PairView>), String> {
        let said = |path: &Path, reason: &dyn std::fmt::Display| format!("{}: {reason}", path.display());
        let photo = load_photo(&self.photo).map_err(|e| said(&self.photo, &e))?.image;
        let size = ImageSize::new(photo.width(), photo.height()).fit_within(LONGEST);
        let read = |path: &Path, size| {
            let image = picture::read(path).map_err(|e| said(path, &e))?.into_rgb8();
            Ok::<_, String>(Arc::new(letterboxed(&image, size)))
        };
        let [a, b] = &self.input;
        let mut views = vec![PairView { name: "the photo's view", first: read(a, size)?, second: read(b, size)? }];
        if let Some([a, b]) = &self.elevated {
            views.push(PairView { name: "from above", first: read(a, ELEVATED)?, second: read(b, ELEVATED)? });
        }
        Ok((Arc::new(letterboxed(&photo, size)), views))
    }
}

/// The pictures of a question: the photo, then A and B of each view; `swapped` makes the second set A.
pub fn shown(photo: &Arc<RgbImage>, views: &[PairView], swapped: bool) -> Vec<Picture> {
    let mut out = vec![Picture { caption: "IMAGE 1 is the photo.".to_owned(), image: Arc::clone(photo) }];
    for view in views {
        let (a, b) = if swapped { (&view.second, &view.first) } else { (&view.first, &view.second) };
        for (letter, image) in [("A", a), ("B", b)] {
            let caption = format!("IMAGE {} is {letter}, {}.", out.len() + 1, view.name);
            out.push(Picture { caption, image: Arc::clone(image) });
        }
    }
    out
}

/// The picture inside a frame of a size, its own shape kept.
fn letterboxed(image: &RgbImage, size: ImageSize) -> RgbImage {
    if image.dimensions() == (size.width, size.height) {
        return image.clone();
    }
    let k = (f64::from(size.width) / f64::from(image.width())).min(f64::from(size.height) / f64::from(image.height()));
    let side = |n: u32, most: u32| ((f64::from(n) * k).round() as u32).clamp(1, most);
    let inner = imageops::resize(
        image,
        side(image.width(), size.width),
        side(image.height(), size.height),
        FilterType::CatmullRom,
    );
    let mut frame = RgbImage::from_pixel(size.width, size.height, BORDER);
    let (x, y) = ((size.width - inner.width()) / 2, (size.height - inner.height()) / 2);
    imageops::replace(&mut frame, &inner, i64::from(x), i64::from(y));
    frame
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_of_another_shape_keeps_its_own() {
        let square = RgbImage::from_pixel(100, 100, Rgb([255, 0, 0]));
        let framed = letterboxed(&square, ImageSize::new(160, 90));
        assert_eq!(framed.dimensions(), (160, 90));
        assert_eq!((framed.get_pixel(80, 45), framed.get_pixel(5, 45)), (&Rgb([255, 0, 0]), &BORDER));
        let red = framed.pixels().filter(|p| p[0] == 255).count();
        assert_eq!(red, 90 * 90);
    }

    #[test]
    fn the_orders_show_the_same_pictures_under_other_letters() {
        let image = |n: u8| Arc::new(RgbImage::from_pixel(2, 2, Rgb([n; 3])));
        let views = [PairView { name: "the photo's view", first: image(1), second: image(2) }];
        let grey = |pictures: Vec<Picture>| pictures.iter().map(|p| p.image.get_pixel(0, 0)[0]).collect::<Vec<_>>();
        assert_eq!(grey(shown(&image(0), &views, false)), [0, 1, 2]);
        assert_eq!(grey(shown(&image(0), &views, true)), [0, 2, 1]);
        let captions: Vec<String> = shown(&image(0), &views, true).into_iter().map(|p| p.caption).collect();
        assert_eq!(captions[1], "IMAGE 2 is A, the photo's view.");
    }
}
