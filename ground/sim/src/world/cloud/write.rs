//! Points into files.

use std::io::{self, Write};

/// Writes points, world frame, m, as a binary `.ply`.
///
/// # Errors
/// Whatever `out` fails with.
pub fn write_ply(out: &mut impl Write, points: &[[f32; 3]]) -> io::Result<()> {
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nend_header\n",
        points.len()
    )?;
    points.iter().flatten().try_for_each(|c| out.write_all(&c.to_le_bytes()))
}
