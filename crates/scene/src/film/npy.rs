//! NumPy's `.npy` files, version 1.0 (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>).

use std::path::Path;

use super::atomic;
use crate::Result;

/// Writes 32-bit floats as an array of this shape in C order: the last index changes fastest.
///
/// # Errors
/// The errors of [`atomic::write`].
pub fn write(path: &Path, shape: &[usize], values: &[f32]) -> Result<()> {
    let sides: String = shape.iter().map(|side| format!("{side},")).collect();
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({sides}), }}");
    // Magic, version, length and header end at a multiple of 64 bytes.
    const BEFORE: usize = 10;
    let length = (BEFORE + header.len() + 1).next_multiple_of(64) - BEFORE;
    header += &" ".repeat(length - 1 - header.len());
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    atomic::write(path, |file| {
        std::io::Write::write_all(file, &bytes)?;
        Ok(Ok(()))
    })
}
