//! Tables as Apache Parquet.
//!
//! A writer of the little that an index needs: columns without gaps, plain encoding, no compression, one page a column
//! and row group, by the format's description (`parquet.thrift`, version 1 pages). The crate of that name would bring
//! some thirty crates for it; what this writes is read back by pyarrow in the tests.

use std::collections::BTreeSet;

use crate::DatasetError;

/// Rows of a row group.
const GROUP: usize = 65_536;

/// A column without gaps.
#[derive(Debug, Clone, PartialEq)]
pub enum Column {
    /// UTF-8.
    Text(Vec<String>),
    /// 64-bit integers.
    Int(Vec<i64>),
    /// 64-bit floats.
    Real(Vec<f64>),
    /// Yes or no.
    Bool(Vec<bool>),
}

impl Column {
    fn len(&self) -> usize {
        match self {
            Self::Text(v) => v.len(),
            Self::Int(v) => v.len(),
            Self::Real(v) => v.len(),
            Self::Bool(v) => v.len(),
        }
    }

    /// Number of the physical type.
    fn kind(&self) -> i64 {
        match self {
            Self::Bool(_) => 0,
            Self::Int(_) => 2,
            Self::Real(_) => 5,
            Self::Text(_) => 6,
        }
    }

    fn plain(&self, rows: std::ops::Range<usize>) -> Vec<u8> {
        match self {
            Self::Text(v) => v[rows]
                .iter()
                .flat_map(|t| (t.len() as u32).to_le_bytes().into_iter().chain(t.bytes()).collect::<Vec<u8>>())
                .collect(),
            Self::Int(v) => v[rows].iter().flat_map(|i| i.to_le_bytes()).collect(),
            Self::Real(v) => v[rows].iter().flat_map(|r| r.to_le_bytes()).collect(),
            Self::Bool(v) => v[rows]
                .chunks(8)
                .map(|bits| bits.iter().enumerate().fold(0, |byte, (i, bit)| byte | u8::from(*bit) << i))
                .collect(),
        }
    }
}

/// Thrift's compact protocol, as much of it as is needed.
#[derive(Default)]
struct Thrift {
    bytes: Vec<u8>,
    last: Vec<i16>,
}

const I32: u8 = 5;
const I64: u8 = 6;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const STRUCT: u8 = 12;

impl Thrift {
    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.bytes.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.bytes.push(value as u8);
    }

    fn zigzag(&mut self, value: i64) {
        self.varint(((value << 1) ^ (value >> 63)) as u64);
    }

    fn open(&mut self) {
        self.last.push(0);
    }

    fn close(&mut self) {
        self.bytes.push(0);
        self.last.pop();
    }

    fn field(&mut self, id: i16, kind: u8) {
        let last = self.last.last_mut().expect("fields stand in structs");
        // Fields are written in ascending order, less than 16 apart.
        self.bytes.push(((id - *last) as u8) << 4 | kind);
        *last = id;
    }

    fn number(&mut self, id: i16, kind: u8, value: i64) {
        self.field(id, kind);
        self.zigzag(value);
    }

    fn text(&mut self, id: i16, text: &str) {
        self.field(id, BINARY);
        self.raw_text(text);
    }

    fn raw_text(&mut self, text: &str) {
        self.varint(text.len() as u64);
        self.bytes.extend_from_slice(text.as_bytes());
    }

    fn list(&mut self, id: i16, kind: u8, length: usize) {
        self.field(id, LIST);
        if length < 15 {
            self.bytes.push((length as u8) << 4 | kind);
        } else {
            self.bytes.push(0xf0 | kind);
            self.varint(length as u64);
        }
    }
}

/// A chunk that was written: where, and how many bytes.
struct Chunk {
    offset: usize,
    bytes: usize,
}

/// The bytes of a Parquet file.
///
/// # Errors
/// No column, columns of other lengths, a name twice, a page of more than 2 GB.
pub fn table(columns: &[(&str, Column)]) -> Result<Vec<u8>, DatasetError> {
    let refuse = |why| DatasetError::Format { what: "the index".to_owned(), format: "Parquet", why };
    let rows = columns.first().map(|(_, c)| c.len()).ok_or_else(|| refuse("it has no column"))?;
    if columns.iter().any(|(_, c)| c.len() != rows) {
        return Err(refuse("its columns have other lengths"));
    }
    if columns.iter().map(|(n, _)| n).collect::<BTreeSet<_>>().len() != columns.len() {
        return Err(refuse("it has a column twice"));
    }
    let mut file = b"PAR1".to_vec();
    let mut groups: Vec<(usize, Vec<Chunk>)> = Vec::new();
    let mut start = 0;
    while start < rows {
        let end = (start + GROUP).min(rows);
        let mut chunks = Vec::new();
        for (_, column) in columns {
            let data = column.plain(start..end);
            if data.len() > i32::MAX as usize {
                return Err(refuse("a page is larger than 2 GB"));
            }
            let offset = file.len();
            file.extend(page_header(data.len(), end - start));
            file.extend(data);
            chunks.push(Chunk { offset, bytes: file.len() - offset });
        }
        groups.push((end - start, chunks));
        start = end;
    }
    let footer = footer(columns, rows, &groups);
    file.extend(&footer);
    file.extend((footer.len() as u32).to_le_bytes());
    file.extend(b"PAR1");
    Ok(file)
}

fn page_header(bytes: usize, values: usize) -> Vec<u8> {
    let mut t = Thrift::default();
    t.open();
    t.number(1, I32, 0); // a data page
    t.number(2, I32, bytes as i64);
    t.number(3, I32, bytes as i64);
    t.field(5, STRUCT);
    t.open();
    t.number(1, I32, values as i64);
    t.number(2, I32, 0); // plain
    t.number(3, I32, 3); // levels by run length; there are none
    t.number(4, I32, 3);
    t.close();
    t.close();
    t.bytes
}

fn footer(columns: &[(&str, Column)], rows: usize, groups: &[(usize, Vec<Chunk>)]) -> Vec<u8> {
    let mut t = Thrift::default();
    t.open();
    t.number(1, I32, 1);
    t.list(2, STRUCT, columns.len() + 1);
    t.open();
    t.text(4, "schema");
    t.number(5, I32, columns.len() as i64);
    t.close();
    for (name, column) in columns {
        t.open();
        t.number(1, I32, column.kind());
        t.number(3, I32, 0); // required
        t.text(4, name);
        if matches!(column, Column::Text(_)) {
            t.number(6, I32, 0); // UTF-8
        }
        t.close();
    }
    t.number(3, I64, rows as i64);
    t.list(4, STRUCT, groups.len());
    for (rows, chunks) in groups {
        t.open();
        t.list(1, STRUCT, columns.len());
        for ((name, column), chunk) in columns.iter().zip(chunks) {
            t.open();
            t.number(2, I64, chunk.offset as i64);
            t.field(3, STRUCT);
            t.open();
            t.number(1, I32, column.kind());
            t.list(2, I32, 1);
            t.zigzag(0);
            t.list(3, BINARY, 1);
            t.raw_text(name);
            t.number(4, I32, 0); // not compressed
            t.number(5, I64, *rows as i64);
            t.number(6, I64, chunk.bytes as i64);
            t.number(7, I64, chunk.bytes as i64);
            t.number(9, I64, chunk.offset as i64);
            t.close();
            t.close();
        }
        t.number(2, I64, chunks.iter().map(|c| c.bytes as i64).sum());
        t.number(3, I64, *rows as i64);
        t.close();
    }
    t.text(6, concat!("harmony-dataset ", env!("CARGO_PKG_VERSION")));
    t.close();
    t.bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_tables_are_written() {
        assert!(table(&[]).is_err());
        assert!(table(&[("a", Column::Int(vec![1])), ("b", Column::Int(vec![]))]).is_err());
        assert!(table(&[("a", Column::Int(vec![1])), ("a", Column::Int(vec![2]))]).is_err());
        let bytes = table(&[("a", Column::Bool(vec![true; 9]))]).unwrap();
        assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"));
        assert!(table(&[("a", Column::Text(vec![]))]).is_ok());
    }

    #[test]
    fn numbers_are_thrifts() {
        // Varints and zigzag by the compact protocol's own examples: 50399 is df 89 03, -1 is 1.
        let mut t = Thrift::default();
        t.varint(50_399);
        t.zigzag(-1);
        t.zigzag(1);
        assert_eq!(t.bytes, [0xdf, 0x89, 0x03, 1, 2]);
    }
}
