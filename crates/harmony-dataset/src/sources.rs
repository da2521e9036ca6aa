//! `sources.csv`: where each photo is from and what may be done with it.
//! Key `data.sources`.
//!
//! Paper: "Per-scene source URLs are listed in the csv file included in the dataset." One row a scene; the columns are
//! those of [`Source`], in any order, and no others. `faces` may be missing: lists of earlier versions have none.

use std::path::Path;

use harmony_io::{read_bounded, write_atomic};
use serde::{Deserialize, Serialize};

use crate::DatasetError;
use crate::layout::{SOURCES, SceneId, Split};

/// Largest `sources.csv` that is read, bytes.
const MAX_BYTES: u64 = 256 << 20;

/// A row of `sources.csv`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// `easy`, `medium` or `complicated`.
    pub split: Split,
    /// `<room_type>_NN`.
    pub name: String,
    /// Who offers the photo: `pexels`, `own`, ...
    pub source: String,
    /// Its number there.
    pub source_id: String,
    /// Its page there.
    pub source_url: String,
    /// Who made it.
    pub author: String,
    /// Licence, by the name that [`crate::licences::KNOWN`] has, or in words.
    pub licence: String,
    /// Where the licence is written; empty for known ones.
    pub licence_url: String,
    /// Day on which it was fetched, `YYYY-MM-DD`.
    pub retrieved_at: String,
    /// Columns of the photo.
    pub width: u32,
    /// Rows of the photo.
    pub height: u32,
    /// SHA-256 of the photo as it came.
    pub sha256: String,
    /// `yes` or `no`: whether the photo itself is published. Where not, address and hash are.
    pub redistributable: YesNo,
    /// Regions that are blurred on export, `x0 y0 x1 y1` in pixels of the upright photo, separated by `;`.
    pub blur: String,
    /// Who looked for faces in the photo, separated by `;`: a detector and its model, `by hand`, ... Empty = nobody did, as
    /// far as anybody knows. A photo without a face has a name here and no region in `blur`.
    #[serde(default)]
    pub faces: String,
    /// Anything else.
    pub note: String,
}

/// `yes` or `no`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum YesNo {
    /// Yes.
    Yes,
    /// No.
    No,
}

impl Source {
    /// The scene.
    pub fn id(&self) -> SceneId {
        SceneId { split: self.split, name: self.name.clone() }
    }

    /// Regions to blur.
    ///
    /// # Errors
    /// Text that is no list of boxes.
    pub fn boxes(&self) -> Result<Vec<[u32; 4]>, DatasetError> {
        parse_boxes(&self.blur)
    }

    /// Whether somebody looked for faces: it is written so, or there are regions.
    pub fn is_looked_at(&self) -> bool {
        !self.faces.trim().is_empty() || !self.blur.trim().is_empty()
    }
}

/// Reads `x0 y0 x1 y1; x0 y0 x1 y1`, upper bounds exclusive.
///
/// # Errors
/// Anything else.
pub fn parse_boxes(text: &str) -> Result<Vec<[u32; 4]>, DatasetError> {
    let bad = || DatasetError::Value {
        what: "the region",
        value: text.to_owned(),
        why: "regions are x0 y0 x1 y1 in pixels with x0 < x1 and y0 < y1, separated by ;",
    };
    text.split(';')
        .map(str::trim)
        .filter(|part| !part.is_empty())
        .map(|part| {
            let numbers: Vec<u32> = part
                .split([' ', ','])
                .filter(|n| !n.is_empty())
                .map(str::parse)
                .collect::<Result<_, _>>()
                .map_err(|_| bad())?;
            let b: [u32; 4] = numbers.try_into().map_err(|_| bad())?;
            if b[0] < b[2] && b[1] < b[3] { Ok(b) } else { Err(bad()) }
        })
        .collect()
}

/// Reads `sources.csv`; rows sorted by scene.
///
/// # Errors
/// A missing or broken file; the message has the line.
pub fn load(root: &Path) -> Result<Vec<Source>, DatasetError> {
    let path = root.join(SOURCES);
    let bytes = read_bounded(&path, MAX_BYTES)?;
    let fail = |why: String| DatasetError::Csv { path: path.clone(), why };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes.as_slice());
    let mut rows = reader.deserialize().collect::<Result<Vec<Source>, _>>().map_err(|e| fail(words(&e)))?;
    rows.sort_by_key(Source::id);
    if let Some(pair) = rows.windows(2).find(|w| w[0].id() == w[1].id()) {
        return Err(fail(format!("{} has two rows", pair[0].id().path())));
    }
    Ok(rows)
}

/// The crate's message without its type names.
fn words(error: &csv::Error) -> String {
    let line = error.position().map_or_else(String::new, |p| format!("line {}: ", p.line()));
    match error.kind() {
        csv::ErrorKind::Deserialize { err, .. } => format!("{line}{err}"),
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("{line}{len} fields in place of {expected_len}")
        }
        _ => format!("{line}{error}"),
    }
}

/// Writes `sources.csv`, sorted by scene; without rows the head alone.
///
/// # Errors
/// An unwritable folder.
pub fn save(root: &Path, rows: &[Source]) -> Result<(), DatasetError> {
    let path = root.join(SOURCES);
    let mut rows: Vec<&Source> = rows.iter().collect();
    rows.sort_by_key(|r| r.id());
    let fail = |why: String| DatasetError::Csv { path: path.clone(), why };
    let mut writer = csv::WriterBuilder::new().has_headers(!rows.is_empty()).from_writer(Vec::new());
    if rows.is_empty() {
        writer.write_record(COLUMNS).map_err(|e| fail(e.to_string()))?;
    }
    for row in rows {
        writer.serialize(row).map_err(|e| fail(e.to_string()))?;
    }
    let bytes = writer.into_inner().map_err(|e| fail(e.to_string()))?;
    Ok(write_atomic(&path, &bytes)?)
}

/// The columns.
pub const COLUMNS: [&str; 16] = [
    "split",
    "name",
    "source",
    "source_id",
    "source_url",
    "author",
    "licence",
    "licence_url",
    "retrieved_at",
    "width",
    "height",
    "sha256",
    "redistributable",
    "blur",
    "faces",
    "note",
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_read_or_refused() {
        assert_eq!(parse_boxes("").unwrap(), Vec::<[u32; 4]>::new());
        assert_eq!(parse_boxes("1 2 3 4; 10,20,30,40 ;").unwrap(), [[1, 2, 3, 4], [10, 20, 30, 40]]);
        for bad in ["1 2 3", "3 2 1 4", "a b c d", "1 2 3 4 5", "-1 0 2 2"] {
            assert!(parse_boxes(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn an_empty_list_has_the_columns_of_a_row() {
        let folder = tempfile::tempdir().unwrap();
        save(folder.path(), &[]).unwrap();
        let head = std::fs::read_to_string(folder.path().join(SOURCES)).unwrap();
        assert_eq!(load(folder.path()).unwrap(), []);
        let row = Source {
            split: Split::Easy,
            name: "bedroom_01".into(),
            source: "own, \"mine\"".into(),
            source_id: String::new(),
            source_url: "https://example.org/1".into(),
            author: "A\nB".into(),
            licence: "CC0-1.0".into(),
            licence_url: String::new(),
            retrieved_at: "2026-01-02".into(),
            width: 3,
            height: 4,
            sha256: "00".into(),
            redistributable: YesNo::Yes,
            blur: String::new(),
            faces: String::new(),
            note: String::new(),
        };
        save(folder.path(), std::slice::from_ref(&row)).unwrap();
        let text = std::fs::read_to_string(folder.path().join(SOURCES)).unwrap();
        assert_eq!(text.lines().next(), head.lines().next());
        assert_eq!(load(folder.path()).unwrap(), std::slice::from_ref(&row));
        save(folder.path(), &[row.clone(), row]).unwrap();
        assert!(load(folder.path()).unwrap_err().to_string().contains("two rows"));
    }

    #[test]
    fn a_list_of_before_the_column_of_faces_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let old: Vec<&str> = COLUMNS.into_iter().filter(|c| *c != "faces").collect();
        let rows = "easy,b_01,,,,,,,,1,1,,yes,1 2 3 4,first\neasy,b_02,,,,,,,,1,1,,yes,,\n";
        std::fs::write(folder.path().join(SOURCES), format!("{}\n{rows}", old.join(","))).unwrap();
        let rows = load(folder.path()).unwrap();
        assert_eq!((rows[0].faces.as_str(), rows[0].note.as_str(), rows[0].is_looked_at()), ("", "first", true));
        assert!(!rows[1].is_looked_at(), "no regions, and nobody's name");
        save(folder.path(), &rows).unwrap();
        assert_eq!(load(folder.path()).unwrap(), rows);
    }

    #[test]
    fn a_broken_list_is_refused_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let head = COLUMNS.join(",");
        for (text, wanted) in [
            (format!("{head}\nhard,bedroom_01,,,,,,,,1,1,,yes,,,\n"), "line 2"),
            (format!("{head}\neasy,bedroom_01,a\n"), "3 fields in place of 16"),
            (format!("{head}\neasy,b_01,,,,,,,,x,1,,yes,,,\n"), "line 2"),
            ("split,name\neasy,b_01\n".to_owned(), "missing field"),
            (format!("{head},extra\neasy,b_01,,,,,,,,1,1,,yes,,,,z\n"), "extra"),
        ] {
            std::fs::write(folder.path().join(SOURCES), text).unwrap();
            let error = load(folder.path()).unwrap_err();
            assert!(error.to_string().contains(wanted) && error.hint().is_some(), "{error}");
        }
    }
}
