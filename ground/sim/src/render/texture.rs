//! Noise without state: the same place always has the same value.

use crate::render::lanes::{LANES, Lanes, floor, lanes};

/// A well mixed hash of three integers.
#[inline(always)]
pub(super) const fn hash(x: i32, y: i32, z: i32) -> u32 {
    let mut h = (x as u32).wrapping_mul(0x8da6_b343)
        ^ (y as u32).wrapping_mul(0xd816_3841)
        ^ (z as u32).wrapping_mul(0xcb1a_b31f);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2c1b_3c6d);
    h ^= h >> 13;
    h = h.wrapping_mul(0x297a_2d39);
    h ^ (h >> 16)
}

/// A hash as a number in −1..1.
#[inline(always)]
pub(super) fn signed(h: u32) -> f32 {
    // The conversion of a signed number is one instruction.
    (h >> 8) as i32 as f32 * (2.0 / 16_777_216.0) - 1.0
}

/// Noise in −1..1 that is constant in each unit cube.
#[inline(always)]
pub(super) fn blocks(at: impl Fn(usize) -> (i32, i32, i32)) -> Lanes {
    lanes(|i| {
        let (x, y, z) = at(i);
        signed(hash(x, y, z))
    })
}

/// Nodes of the smooth noise along each axis; it repeats after so many features.
const NODES: usize = 128;

/// Its values, −127..=127, at the four corners of each cell: (0, 0), (1, 0), (0, 1), (1, 1) from the lowest byte on.
static CORNERS: [u32; NODES * NODES] = {
    const fn node(column: usize, row: usize) -> u32 {
        let i = (row % NODES) * NODES + column % NODES;
        ((hash(i as i32, 77, 5) >> 8) % 255) & 0xff
    }
    let mut corners = [0; NODES * NODES];
    let mut i = 0;
    while i < corners.len() {
        let (column, row) = (i % NODES, i / NODES);
        let low = node(column, row) | node(column + 1, row) << 8;
        corners[i] = low | node(column, row + 1) << 16 | node(column + 1, row + 1) << 24;
        i += 1;
    }
    corners
};

/// Smooth noise in −1..1 over the plane with features of size 1; each salt begins elsewhere.
#[inline(always)]
pub(super) fn smooth(at: impl Fn(usize) -> (f32, f32), salt: impl Fn(usize) -> i32) -> Lanes {
    let ease = |f: f32| f * f * (3.0 - 2.0 * f);
    let (mut along_x, mut along_y, mut cells) = ([0.0; LANES], [0.0; LANES], [0u32; LANES]);
    for i in 0..LANES {
        let ((x, y), salt) = (at(i), salt(i));
        let (ix, iy) = (floor(x), floor(y));
        (along_x[i], along_y[i]) = (ease(x - ix as f32), ease(y - iy as f32));
        let (column, row) = (ix.wrapping_add(salt.wrapping_mul(37)), iy.wrapping_add(salt.wrapping_mul(59)));
        cells[i] = (row as u32 % NODES as u32) * NODES as u32 + column as u32 % NODES as u32;
    }
    for cell in &mut cells {
        *cell = CORNERS[*cell as usize % CORNERS.len()];
    }
    lanes(|i| {
        let node = |shift: u32| ((cells[i] << shift) as i32 >> 24) as f32;
        let low = node(24) + (node(16) - node(24)) * along_x[i];
        let high = node(8) + (node(0) - node(8)) * along_x[i];
        (low + (high - low) * along_y[i]) * (1.0 / 127.0)
    })
}
