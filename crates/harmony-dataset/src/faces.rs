//! Faces that somebody found in the photos become regions that are blurred on export.
//! Key `data.faces`.
//!
//! Beyond the paper. Who looks (a detector, a person) is not known here; its boxes are data. A photo goes this way:
//!
//! | step | function |
//! |---|---|
//! | which photos are asked about | [`wanted`] |
//! | the photo as it is shown: upright, no larger than a detector sees | [`open`] |
//! | a box becomes a wider region of the photo | [`region`] |
//! | regions that are new join those that are there | [`added`] |
//! | both go into `sources.csv`, with the name of who looked | [`keep`] |
//!
//! A region that is there is never removed nor changed, whoever gave it: nothing tells those given by hand from others. So a
//! region too many is taken out of `sources.csv` by hand.
//!
//! # Limits
//! Detectors miss faces (small, turned away, in a mirror) and take other things for faces. What is found is a help, no
//! promise.

use std::path::Path;

use harmony_io::{picture, read_bounded};
use harmony_scene::{ImageSize, PixelBox};
use image::RgbImage;
use image::imageops::{FilterType, resize};

use crate::layout::{self, SceneId};
use crate::sources::{self, Source, YesNo};
use crate::{DatasetError, photo};

/// Longest side of a photo as it is shown, pixels: more than detectors see of it (OWLv2: 960), and enough for language
/// models that look at it in tiles.
pub const LONGEST_PX: u32 = 2048;

/// Least score at which a face that was found is blurred, 0 to 1. OWLv2's own bound (`docs/decisions/0014-detector.md`); a
/// face too many costs a few blurred pixels, one too few cannot be taken back.
pub const MIN_SCORE: f64 = 0.25;

/// Share of a box by which it is widened on each side: boxes go from chin to brow and leave out hair and ears. The export
/// widens by a tenth more.
const WIDEN: f64 = 0.15;

/// Least widening on each side, fraction of the photo's longer side: models write boxes in thousandths.
const MIN_WIDEN: f64 = 0.002;

/// Which photos are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Which {
    /// All that are published.
    Published,
    /// Of these the ones that nobody looked at ([`Source::is_looked_at`]).
    New,
}

/// The photos of a data set by whether they are looked at.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Wanted {
    /// To be looked at.
    pub photos: Vec<Source>,
    /// Left out: not published, so that nobody sees their faces.
    pub unpublished: usize,
    /// Left out: somebody looked.
    pub known: usize,
}

/// Sorts photos by whether they are to be looked at.
pub fn wanted(rows: &[Source], which: Which) -> Wanted {
    let mut wanted = Wanted::default();
    for row in rows {
        if row.redistributable == YesNo::No {
            wanted.unpublished += 1;
        } else if which == Which::New && row.is_looked_at() {
            wanted.known += 1;
        } else {
            wanted.photos.push(row.clone());
        }
    }
    wanted
}

/// A photo as it is shown to whoever looks.
#[derive(Debug, Clone)]
pub struct Shown {
    /// Upright, at most [`LONGEST_PX`] long.
    pub image: RgbImage,
    /// Size of the upright photo, which regions are in.
    pub photo: ImageSize,
}

/// Reads a scene's photo.
///
/// # Errors
/// No photo, another one than the list of sources is about, or none that can be read.
pub fn open(root: &Path, row: &Source) -> Result<Shown, DatasetError> {
    let folder = root.join(row.id().path());
    let path = layout::photo_of(&folder).ok_or(DatasetError::NoPhoto(folder))?;
    let bytes = read_bounded(&path, picture::MAX_IMAGE_BYTES)?;
    if layout::sha256(&bytes) != row.sha256 {
        return Err(DatasetError::OtherPhoto(row.id().path()));
    }
    let (image, _) = photo::upright(&bytes).map_err(|source| DatasetError::Picture { path, source })?;
    let photo = ImageSize::new(image.width(), image.height());
    let size = photo.fit_within(LONGEST_PX);
    let image = if size == photo { image } else { resize(&image, size.width, size.height, FilterType::Triangle) };
    Ok(Shown { image, photo })
}

/// A face that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face {
    /// Region to blur: `x0 y0 x1 y1`, pixels of the upright photo, upper bounds exclusive.
    pub region: [u32; 4],
    /// Score of who found it, 0 to 1; `None` when it gives none.
    pub score: Option<f64>,
}

impl Face {
    /// Whether it is blurred: who gives no scores is believed.
    fn is_believed(&self, min_score: f64) -> bool {
        self.score.is_none_or(|score| score >= min_score)
    }
}

/// The region of a photo that a box becomes: widened, in whole pixels, inside of the photo; `None` when nothing of the box
/// is.
///
/// | argument | unit |
/// |---|---|
/// | `bounds` | pixels of the picture that was shown |
/// | `shown` | size of that picture |
/// | `photo` | size of the upright photo |
pub fn region(bounds: &PixelBox, shown: ImageSize, photo: ImageSize) -> Option<[u32; 4]> {
    let finite = [bounds.x0, bounds.y0, bounds.x1, bounds.y1].iter().all(|v| v.is_finite());
    if !finite || bounds.area() <= 0.0 || shown.pixels() == 0 {
        return None;
    }
    let least = MIN_WIDEN * f64::from(photo.width.max(photo.height));
    let range = |low: f64, high: f64, shown: u32, photo: u32| {
        let scale = f64::from(photo) / f64::from(shown);
        let by = (WIDEN * (high - low) * scale).max(least);
        let (low, high) = ((low * scale - by).floor(), (high * scale + by).ceil());
        (low.clamp(0.0, f64::from(photo)) as u32, high.clamp(0.0, f64::from(photo)) as u32)
    };
    let (x0, x1) = range(bounds.x0, bounds.x1, shown.width, photo.width);
    let (y0, y1) = range(bounds.y0, bounds.y1, shown.height, photo.height);
    (x0 < x1 && y0 < y1).then_some([x0, y0, x1, y1])
}

/// Of the regions that were found those that are new: what lies inside of one that is there, or of a larger one that was
/// found, adds nothing. From the left to the right.
pub fn added(there: &[[u32; 4]], found: &[[u32; 4]]) -> Vec<[u32; 4]> {
    let area = |b: &[u32; 4]| u64::from(b[2] - b[0]) * u64::from(b[3] - b[1]);
    let inside = |a: &[u32; 4], b: &[u32; 4]| a[0] >= b[0] && a[1] >= b[1] && a[2] <= b[2] && a[3] <= b[3];
    let mut found = found.to_vec();
    found.sort_by_key(|b| (std::cmp::Reverse(area(b)), *b));
    let mut new: Vec<[u32; 4]> = Vec::new();
    for region in found {
        if !there.iter().chain(&new).any(|other| inside(&region, other)) {
            new.push(region);
        }
    }
    new.sort_unstable();
    new
}

/// A photo that somebody looked at, and what was found; no faces is an answer, too.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// Scene.
    pub scene: SceneId,
    /// Which photo: its hash in `sources.csv`.
    pub sha256: String,
    /// Faces.
    pub faces: Vec<Face>,
}

/// What became of looks.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Kept {
    /// Photos whose row says now who looked.
    pub photos: usize,
    /// Regions that were added.
    pub regions: usize,
    /// Faces below the least score, which are not blurred.
    pub below: usize,
    /// Scenes that are gone from `sources.csv`, or have another photo by now.
    pub gone: Vec<SceneId>,
}

/// Writes looks into `sources.csv`: new regions behind those that are there, and the name of who looked. The list is read
/// anew for it, so that rows that were added or changed meanwhile stay as they are.
///
/// # Errors
/// A list that cannot be read or written; it is as it was then.
pub fn keep(root: &Path, looks: &[Look], who: &str, min_score: f64) -> Result<Kept, DatasetError> {
    let before = sources::load(root)?;
    let mut rows = before.clone();
    let mut kept = Kept::default();
    for look in looks {
        let row = rows.iter_mut().find(|row| row.sha256 == look.sha256 && row.id() == look.scene);
        let Some(row) = row else {
            kept.gone.push(look.scene.clone());
            continue;
        };
        let believed: Vec<[u32; 4]> =
            look.faces.iter().filter(|f| f.is_believed(min_score)).map(|face| face.region).collect();
        let new = added(&row.boxes()?, &believed);
        kept.photos += 1;
        kept.regions += new.len();
        kept.below += look.faces.iter().filter(|f| !f.is_believed(min_score)).count();
        for [x0, y0, x1, y1] in new {
            row.blur = joined(&row.blur, &format!("{x0} {y0} {x1} {y1}"));
        }
        let who = who.replace(';', ",");
        if !row.faces.split(';').any(|name| name.trim() == who) {
            row.faces = joined(&row.faces, &who);
        }
    }
    if rows != before {
        sources::save(root, &rows)?;
    }
    Ok(kept)
}

/// An entry behind those of a list with `;` between them.
fn joined(list: &str, entry: &str) -> String {
    match list.trim().trim_end_matches(';').trim_end() {
        "" => entry.to_owned(),
        list => format!("{list}; {entry}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::Split;
    use harmony_io::picture::{rgb_jpeg, rgb_png};

    fn row(name: &str, photo: &[u8], published: YesNo) -> Source {
        Source {
            split: Split::Medium,
            name: name.into(),
            source: "own".into(),
            source_id: String::new(),
            source_url: String::new(),
            author: "A".into(),
            licence: "CC0-1.0".into(),
            licence_url: String::new(),
            retrieved_at: String::new(),
            width: 400,
            height: 300,
            sha256: layout::sha256(photo),
            redistributable: published,
            blur: String::new(),
            faces: String::new(),
            note: String::new(),
        }
    }

    fn at(x0: f64, y0: f64, x1: f64, y1: f64) -> PixelBox {
        PixelBox { x0, y0, x1, y1 }
    }

    #[test]
    fn a_box_becomes_a_wider_region_of_the_photo_at_its_own_size() {
        let (shown, photo) = (ImageSize::new(100, 80), ImageSize::new(1000, 800));
        // 20 x 20 of the picture is 200 x 200 of the photo, and 30 more on each side.
        assert_eq!(region(&at(40.0, 30.0, 60.0, 50.0), shown, photo), Some([370, 270, 630, 530]));
        // A speck gets two pixels, the thousandths that boxes are written in.
        assert_eq!(region(&at(40.0, 30.0, 40.5, 30.5), shown, photo), Some([398, 298, 407, 307]));
        // Cut at the border; nothing of it inside; not a box at all.
        assert_eq!(region(&at(-10.0, 70.0, 10.0, 90.0), shown, photo), Some([0, 670, 130, 800]));
        assert_eq!(region(&at(-40.0, 0.0, -20.0, 20.0), shown, photo), None);
        for odd in [at(5.0, 5.0, 5.0, 9.0), at(f64::NAN, 0.0, 9.0, 9.0), at(0.0, 0.0, f64::INFINITY, 9.0)] {
            assert_eq!(region(&odd, shown, photo), None, "{odd:?}");
        }
    }

    #[test]
    fn only_what_is_not_covered_is_added() {
        let there = [[10, 10, 100, 100]];
        let found = [[200, 5, 260, 60], [20, 20, 80, 80], [90, 90, 140, 140], [205, 10, 250, 50], [90, 90, 140, 140]];
        assert_eq!(added(&there, &found), [[90, 90, 140, 140], [200, 5, 260, 60]]);
        assert_eq!(added(&there, &there), Vec::<[u32; 4]>::new());
        assert_eq!(added(&[], &[]), Vec::<[u32; 4]>::new());
    }

    #[test]
    fn looks_are_kept_beside_what_was_given_by_hand() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let mut rows: Vec<Source> =
            ["a_01", "a_02", "a_03"].iter().map(|name| row(name, name.as_bytes(), YesNo::Yes)).collect();
        rows[0].blur = "1,2 ,30 40 ;".into();
        rows[0].faces = "by hand".into();
        sources::save(root, &rows).unwrap();
        let rows = sources::load(root).unwrap();
        let look =
            |row: &Source, faces: &[Face]| Look { scene: row.id(), sha256: row.sha256.clone(), faces: faces.to_vec() };
        let face = |region, score| Face { region, score };
        let mut other = look(&rows[2], &[]);
        other.sha256 = "another photo".into();
        let found = [
            face([5, 5, 20, 20], Some(0.9)),
            face([100, 10, 150, 60], Some(0.25)),
            face([200, 10, 250, 60], Some(0.2)),
            face([300, 10, 350, 60], None),
        ];
        let looks = [look(&rows[0], &found), look(&rows[1], &[]), other];
        let kept = keep(root, &looks, "net; large", 0.25).unwrap();
        assert_eq!((kept.photos, kept.regions, kept.below), (2, 2, 1));
        assert_eq!(kept.gone, [rows[2].id()]);
        let after = sources::load(root).unwrap();
        assert_eq!(after[0].blur, "1,2 ,30 40; 100 10 150 60; 300 10 350 60", "what was given by hand is as it was");
        assert_eq!(after[0].faces, "by hand; net, large");
        assert_eq!(
            (after[1].blur.as_str(), after[1].faces.as_str()),
            ("", "net, large"),
            "looked at, and nobody there"
        );
        assert_eq!(after[2], rows[2]);
        // The same again changes nothing, another least score adds.
        assert_eq!(keep(root, &looks, "net; large", 0.25).unwrap().regions, 0);
        assert_eq!(sources::load(root).unwrap(), after);
        assert_eq!(keep(root, &looks, "net; large", 0.1).unwrap().regions, 1);
        let wanted = wanted(&sources::load(root).unwrap(), Which::New);
        assert_eq!((wanted.photos.len(), wanted.known, wanted.photos[0].name.as_str()), (1, 2, "a_03"));
    }

    #[test]
    fn photos_are_shown_upright_and_small_and_only_those_that_are_published() {
        let folder = tempfile::tempdir().unwrap();
        let large = rgb_jpeg(&RgbImage::new(LONGEST_PX * 2, 100), 80).unwrap();
        let small = rgb_png(&RgbImage::new(40, 30)).unwrap();
        let rows = [row("a_01", &large, YesNo::Yes), row("a_02", &small, YesNo::No), row("a_03", &small, YesNo::Yes)];
        let wanted = wanted(&rows, Which::Published);
        assert_eq!((wanted.photos.len(), wanted.unpublished, wanted.known), (2, 1, 0));
        let put = |name: &str, bytes: &[u8]| {
            harmony_io::write_atomic(&folder.path().join("medium").join(name), bytes).unwrap();
        };
        put("a_01/photo.jpg", &large);
        put("a_02/photo.png", &small);
        let shown = open(folder.path(), &rows[0]).unwrap();
        assert_eq!((shown.image.dimensions(), shown.photo.width), ((LONGEST_PX, 50), LONGEST_PX * 2));
        assert_eq!(open(folder.path(), &rows[1]).unwrap().image.dimensions(), (40, 30));
        assert!(matches!(open(folder.path(), &rows[2]).unwrap_err(), DatasetError::NoPhoto(_)));
        put("a_03/photo.png", b"another");
        let error = open(folder.path(), &rows[2]).unwrap_err();
        assert!(matches!(error, DatasetError::OtherPhoto(_)) && error.hint().is_some(), "{error}");
    }
}
