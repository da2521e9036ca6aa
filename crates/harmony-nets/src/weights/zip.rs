//! The table of contents of a zip archive whose entries are stored uncompressed, as PyTorch writes it; zip64 included.

use std::collections::BTreeMap;
use std::ops::Range;

use super::{Fault, Reader};

const END: [u8; 4] = *b"PK\x05\x06";
const END64: [u8; 4] = *b"PK\x06\x06";
const END64_LOCATOR: [u8; 4] = *b"PK\x06\x07";
const CENTRAL: [u8; 4] = *b"PK\x01\x02";
const LOCAL: [u8; 4] = *b"PK\x03\x04";
/// More entries than any checkpoint has.
const MAX_ENTRIES: u64 = 1_000_000;

/// Names and the bytes of their contents in the archive.
pub(super) fn entries(bytes: &[u8]) -> Result<BTreeMap<String, Range<usize>>, Fault> {
    let end = find_end(bytes)?;
    let mut reader = Reader::new(bytes, end + 10);
    let (count, _, offset) = (reader.u16()?, reader.u32()?, reader.u32()?);
    let (mut count, mut offset) = (u64::from(count), u64::from(offset));
    if let Some(locator) = end.checked_sub(20).filter(|at| bytes[*at..].starts_with(&END64_LOCATOR)) {
        let at = Reader::new(bytes, locator + 8).u64()?;
        let mut reader = Reader::new(bytes, position(at, bytes.len())?);
        expect(&mut reader, END64, "zip64 end record")?;
        reader.take(28)?;
        count = reader.u64()?;
        reader.u64()?;
        offset = reader.u64()?;
    }
    if count > MAX_ENTRIES {
        return Err(Fault::malformed(format!("a zip archive of {count} entries")));
    }
    let mut reader = Reader::new(bytes, position(offset, bytes.len())?);
    let mut out = BTreeMap::new();
    for _ in 0..count {
        let (name, range) = entry(&mut reader, bytes)?;
        if out.insert(name.clone(), range).is_some() {
            return Err(Fault::malformed(format!("two zip entries are called {name:?}")));
        }
    }
    Ok(out)
}

fn entry(reader: &mut Reader<'_>, bytes: &[u8]) -> Result<(String, Range<usize>), Fault> {
    expect(reader, CENTRAL, "central record")?;
    reader.take(6)?;
    let method = reader.u16()?;
    reader.take(8)?;
    let (packed, size) = (reader.u32()?, reader.u32()?);
    let (name_len, extra_len, comment_len) = (reader.u16()?, reader.u16()?, reader.u16()?);
    reader.take(8)?;
    let local = reader.u32()?;
    let name = String::from_utf8_lossy(reader.take(name_len.into())?).into_owned();
    let extra = reader.take(extra_len.into())?;
    reader.take(comment_len.into())?;
    let (mut packed, mut size, mut local) = (u64::from(packed), u64::from(size), u64::from(local));
    let full = u64::from(u32::MAX);
    let mut fields = Reader::new(extra, 0);
    while fields.at + 4 <= extra.len() {
        let (id, length) = (fields.u16()?, fields.u16()?);
        let mut field = Reader::new(fields.take(length.into())?, 0);
        if id == 1 {
            for value in [&mut size, &mut packed, &mut local] {
                if *value == full {
                    *value = field.u64()?;
                }
            }
        }
    }
    if method != 0 || packed != size {
        return Err(Fault::malformed(format!("the zip entry {name:?} is compressed; PyTorch stores entries plain")));
    }
    let mut head = Reader::new(bytes, position(local, bytes.len())?);
    expect(&mut head, LOCAL, "local record")?;
    head.take(22)?;
    let (name_len, extra_len) = (head.u16()?, head.u16()?);
    head.take(usize::from(name_len) + usize::from(extra_len))?;
    let start = head.at;
    head.take(position(size, usize::MAX)?)?;
    Ok((name, start..head.at))
}

fn find_end(bytes: &[u8]) -> Result<usize, Fault> {
    let last = bytes.len().checked_sub(22);
    let first = bytes.len().saturating_sub(22 + 65_535);
    last.and_then(|last| (first..=last).rev().find(|at| bytes[*at..].starts_with(&END)))
        .ok_or_else(|| Fault::malformed("a zip archive without its end record (cut off?)"))
}

fn position(at: u64, len: usize) -> Result<usize, Fault> {
    usize::try_from(at)
        .ok()
        .filter(|at| *at <= len)
        .ok_or_else(|| Fault::malformed(format!("a zip offset of {at} in a file of {len} bytes")))
}

fn expect(reader: &mut Reader<'_>, mark: [u8; 4], what: &str) -> Result<(), Fault> {
    let at = reader.at;
    if reader.array::<4>()? == mark {
        return Ok(());
    }
    Err(Fault::malformed(format!("no {what} of a zip archive at {at}")))
}
