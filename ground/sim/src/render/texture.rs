//! Noise without tables: the same place always has the same value.

/// A well mixed hash of three integers.
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
pub(super) fn signed(h: u32) -> f32 {
    (h >> 8) as f32 * (2.0 / 16_777_216.0) - 1.0
}

/// ⌊x⌋ for |x| < 2³⁰ without a call.
pub(super) fn floor(x: f32) -> i32 {
    let i = x as i32;
    i - i32::from(x < i as f32)
}

/// Nodes of the smooth noise along each axis; it repeats after so many features.
const NODES: usize = 128;

/// Its values, −127..=127. Small enough to stay in the fastest cache, where a hash for each node is twice as slow.
static LATTICE: [i8; NODES * NODES] = {
    let mut lattice = [0; NODES * NODES];
    let mut i = 0;
    while i < lattice.len() {
        lattice[i] = ((hash(i as i32, 77, 5) >> 8) % 255) as i8;
        i += 1;
    }
    lattice
};

/// Smooth noise in −1..1 over the plane with features of size 1.
pub(super) fn smooth(x: f32, y: f32, salt: i32) -> f32 {
    let (ix, iy) = (floor(x), floor(y));
    let ease = |f: f32| f * f * (3.0 - 2.0 * f);
    let (fx, fy) = (ease(x - ix as f32), ease(y - iy as f32));
    // Each salt begins elsewhere on the lattice.
    let (ix, iy) = (ix.wrapping_add(salt.wrapping_mul(37)), iy.wrapping_add(salt.wrapping_mul(59)));
    let at = |dx: i32, dy: i32| {
        let (column, row) = ((ix + dx) as usize % NODES, (iy + dy) as usize % NODES);
        f32::from(LATTICE[row * NODES + column]) * (1.0 / 127.0)
    };
    let low = at(0, 0) + (at(1, 0) - at(0, 0)) * fx;
    let high = at(0, 1) + (at(1, 1) - at(0, 1)) * fx;
    low + (high - low) * fy
}
