//! A usdz package: a zip archive of stored files, each beginning at a multiple of 64 bytes, the root layer first.

use std::sync::Arc;

use crate::ExportError;

/// Where files of a package may begin.
const ALIGNMENT: usize = 64;
/// The extra field that pads a local header (as other writers of packages name it).
const PADDING_ID: u16 = 0x1986;
/// 1980-01-01, so that the same scene gives the same bytes.
const DATE: u16 = 0x21;

/// The bytes of a package.
///
/// # Errors
/// [`ExportError::TooLarge`] beyond what zip without its 64-bit extension holds.
pub(super) fn package(name: &str, entries: &[(String, Arc<[u8]>)]) -> Result<Vec<u8>, ExportError> {
    let total: u64 = entries.iter().map(|(n, b)| b.len() as u64 + 2 * n.len() as u64 + 200).sum();
    if total > u64::from(u32::MAX) || entries.len() > usize::from(u16::MAX) {
        return Err(ExportError::TooLarge { file: name.to_owned(), bytes: total, limit: u32::MAX.into() });
    }
    let mut out: Vec<u8> = Vec::with_capacity(total as usize);
    let mut directory: Vec<u8> = Vec::new();
    for (path, bytes) in entries {
        let start = out.len();
        let sum = crc32(bytes);
        let size = bytes.len() as u32;
        // The extra field has a head of four bytes at least; the data begins after it.
        let head = start + 30 + path.len();
        let mut extra = (ALIGNMENT - head % ALIGNMENT) % ALIGNMENT;
        if extra < 4 {
            extra += ALIGNMENT;
        }
        let common = |out: &mut Vec<u8>| {
            for word in [0_u16, 0, 0, DATE] {
                out.extend(word.to_le_bytes());
            }
            for word in [sum, size, size] {
                out.extend(word.to_le_bytes());
            }
            out.extend((path.len() as u16).to_le_bytes());
        };
        out.extend(0x0403_4b50_u32.to_le_bytes());
        out.extend(10_u16.to_le_bytes());
        common(&mut out);
        out.extend((extra as u16).to_le_bytes());
        out.extend(path.as_bytes());
        out.extend(PADDING_ID.to_le_bytes());
        out.extend((extra as u16 - 4).to_le_bytes());
        out.resize(out.len() + extra - 4, 0);
        out.extend_from_slice(bytes);
        directory.extend(0x0201_4b50_u32.to_le_bytes());
        directory.extend(10_u16.to_le_bytes());
        directory.extend(10_u16.to_le_bytes());
        common(&mut directory);
        // No extra field, no comment, first disk, no attributes.
        directory.extend([0_u8; 12]);
        directory.extend((start as u32).to_le_bytes());
        directory.extend(path.as_bytes());
    }
    let (at, long) = (out.len() as u32, directory.len() as u32);
    out.extend(directory);
    out.extend(0x0605_4b50_u32.to_le_bytes());
    out.extend([0_u8; 4]);
    for _ in 0..2 {
        out.extend((entries.len() as u16).to_le_bytes());
    }
    out.extend(long.to_le_bytes());
    out.extend(at.to_le_bytes());
    out.extend([0_u8; 2]);
    Ok(out)
}

/// CRC-32 as zip has it (polynomial 0xedb88320).
fn crc32(bytes: &[u8]) -> u32 {
    let table: [u32; 256] =
        std::array::from_fn(|n| (0..8).fold(n as u32, |c, _| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 }));
    !bytes.iter().fold(u32::MAX, |c, b| table[((c ^ u32::from(*b)) & 0xff) as usize] ^ (c >> 8))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_is_that_of_the_standard() {
        // The check value of CRC-32/ISO-HDLC.
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    }

    #[test]
    fn files_begin_at_multiples_of_64() {
        let entries: Vec<(String, Arc<[u8]>)> =
            (0..70).map(|n| (format!("textures/{}.png", "x".repeat(n + 1)), vec![n as u8; n * 3 + 1].into())).collect();
        let bytes = package("p.usdz", &entries).unwrap();
        let mut at = 0;
        for (path, data) in &entries {
            assert_eq!(bytes[at..at + 4], 0x0403_4b50_u32.to_le_bytes());
            let extra = u16::from_le_bytes([bytes[at + 28], bytes[at + 29]]) as usize;
            let begin = at + 30 + path.len() + extra;
            assert_eq!(begin % ALIGNMENT, 0);
            assert_eq!(bytes[begin..begin + data.len()], **data);
            at = begin + data.len();
        }
    }
}
