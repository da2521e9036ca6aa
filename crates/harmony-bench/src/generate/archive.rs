//! NumPy archives with integer arrays, stored without compression (the `.npz` writer of `harmony-io` knows floats).

/// One array of an archive.
pub(super) struct Entry {
    name: String,
    bytes: Vec<u8>,
}

impl Entry {
    fn new(name: &str, descr: &str, shape: &[usize], data: &[u8]) -> Self {
        let dims = match shape {
            [one] => format!("{one},"),
            all => all.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
        };
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({dims}), }}");
        // Padded with blanks so that the data starts at a multiple of 64 bytes.
        let padded = (10 + header.len() + 1).div_ceil(64) * 64 - 10;
        let mut bytes = b"\x93NUMPY\x01\0".to_vec();
        bytes.extend((padded as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.resize(10 + padded - 1, b' ');
        bytes.push(b'\n');
        bytes.extend(data);
        Self { name: format!("{name}.npy"), bytes }
    }

    /// 32-bit floats in rows of three.
    pub(super) fn points(name: &str, points: &[glam::Vec3]) -> Self {
        let data: Vec<u8> = points.iter().flat_map(glam::Vec3::to_array).flat_map(f32::to_le_bytes).collect();
        Self::new(name, "<f4", &[points.len(), 3], &data)
    }

    /// 32-bit indices in rows of three.
    pub(super) fn triangles(name: &str, triangles: &[[u32; 3]]) -> Self {
        let data: Vec<u8> = triangles.iter().flatten().flat_map(|i| i.to_le_bytes()).collect();
        Self::new(name, "<u4", &[triangles.len(), 3], &data)
    }

    /// 16-bit numbers.
    pub(super) fn numbers(name: &str, numbers: &[u16]) -> Self {
        let data: Vec<u8> = numbers.iter().flat_map(|i| i.to_le_bytes()).collect();
        Self::new(name, "<u2", &[numbers.len()], &data)
    }
}

/// The archive's bytes: a zip of stored files without times.
pub(super) fn archive(entries: &[Entry]) -> Vec<u8> {
    let (mut out, mut directory) = (Vec::new(), Vec::new());
    for entry in entries {
        let offset = out.len() as u32;
        let size = (entry.bytes.len() as u32).to_le_bytes();
        // Version, flags, method, time, date (1980-01-01), checksum, sizes, name, no extra field.
        let mut fields = vec![20, 0, 0, 0, 0, 0, 0, 0, 0x21, 0];
        fields.extend(checksum(&entry.bytes).to_le_bytes());
        fields.extend([size, size].concat());
        fields.extend((entry.name.len() as u16).to_le_bytes());
        fields.extend([0, 0]);
        out.extend(b"PK\x03\x04");
        out.extend(&fields);
        out.extend(entry.name.as_bytes());
        out.extend(&entry.bytes);
        directory.extend(b"PK\x01\x02\x14\0");
        directory.extend(&fields);
        directory.extend([0; 10]);
        directory.extend(offset.to_le_bytes());
        directory.extend(entry.name.as_bytes());
    }
    let (start, count) = (out.len() as u32, (entries.len() as u16).to_le_bytes());
    out.extend(&directory);
    out.extend(b"PK\x05\x06\0\0\0\0");
    out.extend([count, count].concat());
    out.extend((directory.len() as u32).to_le_bytes());
    out.extend(start.to_le_bytes());
    out.extend([0, 0]);
    out
}

/// CRC-32 as in zip files.
fn checksum(bytes: &[u8]) -> u32 {
    let table: Vec<u32> =
        (0..256_u32).map(|n| (0..8).fold(n, |c, _| if c & 1 == 1 { 0xEDB8_8320 ^ (c >> 1) } else { c >> 1 })).collect();
    !bytes.iter().fold(!0, |c, b| table[((c ^ u32::from(*b)) & 0xFF) as usize] ^ (c >> 8))
}
