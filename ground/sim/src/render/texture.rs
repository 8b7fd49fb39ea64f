//! Noise without tables: the same place always has the same value.

/// A well mixed hash of three integers.
pub(super) fn hash(x: i32, y: i32, z: i32) -> u32 {
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

/// Smooth noise in −1..1 over the plane with features of size 1.
pub(super) fn smooth(x: f32, y: f32, salt: i32) -> f32 {
    let (ix, iy) = (floor(x), floor(y));
    let ease = |f: f32| f * f * (3.0 - 2.0 * f);
    let (fx, fy) = (ease(x - ix as f32), ease(y - iy as f32));
    let at = |dx: i32, dy: i32| signed(hash(ix + dx, iy + dy, salt));
    let low = at(0, 0) + (at(1, 0) - at(0, 0)) * fx;
    let high = at(0, 1) + (at(1, 1) - at(0, 1)) * fx;
    low + (high - low) * fy
}
