//! NumPy's array files, as far as data sets need them: version 1.0, little-endian, C order.

use std::io::{self, Write};
use thiserror::Error;

/// Writes an array; `descr` is NumPy's type string (`|u1`, `<u2`, `<f4`), `bytes` the elements.
pub(super) fn write_npy(out: &mut impl Write, descr: &str, shape: &[usize], bytes: &[u8]) -> io::Result<()> {
    let dims: String = shape.iter().map(|n| format!("{n},")).collect();
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({dims}), }}");
    // Magic, version, length and header fill a multiple of 64 bytes, the last of them a newline.
    let padding = 64 - (10 + header.len() + 1) % 64;
    header.extend(std::iter::repeat_n(' ', padding % 64));
    header.push('\n');
    out.write_all(b"\x93NUMPY\x01\x00")?;
    out.write_all(&(header.len() as u16).to_le_bytes())?;
    out.write_all(header.as_bytes())?;
    out.write_all(bytes)
}

/// What is wrong with an array file.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum NpyError {
    /// Not an array file of version 1.
    #[error("not a NumPy file of version 1.0")]
    Magic,
    /// The header is not as NumPy writes it.
    #[error("NumPy header {0:?} cannot be read")]
    Header(String),
}

/// Splits an array file into type string, shape and the elements' bytes.
///
/// # Errors
/// [`NpyError`] if it is not such a file.
pub fn read_npy(file: &[u8]) -> Result<(String, Vec<usize>, &[u8]), NpyError> {
    if file.len() < 10 || &file[..8] != b"\x93NUMPY\x01\x00" {
        return Err(NpyError::Magic);
    }
    let end = 10 + usize::from(u16::from_le_bytes([file[8], file[9]]));
    let header = file.get(10..end).and_then(|h| std::str::from_utf8(h).ok()).ok_or(NpyError::Magic)?;
    let bad = || NpyError::Header(header.to_owned());
    let between = |from: &str, to: char| {
        let rest = &header[header.find(from)? + from.len()..];
        Some(&rest[..rest.find(to)?])
    };
    let descr = between("'descr': '", '\'').ok_or_else(bad)?;
    let dims = between("'shape': (", ')').ok_or_else(bad)?.split(',').map(str::trim).filter(|d| !d.is_empty());
    let shape: Result<Vec<usize>, _> = dims.map(str::parse).collect();
    Ok((descr.to_owned(), shape.map_err(|_| bad())?, &file[end..]))
}
