//! Loops over [`LANES`] pixels at once, each step simple enough to become vector instructions on any x86-64 or ARM.

/// Pixels that are worked on together.
pub(crate) const LANES: usize = 32;

/// One number for each of them.
pub(crate) type Lanes = [f32; LANES];

/// A value for each pixel.
#[inline(always)]
pub(crate) fn lanes<T: Copy + Default>(of: impl Fn(usize) -> T) -> [T; LANES] {
    each(of)
}

/// As `std::array::from_fn`, which is not always inlined.
#[inline(always)]
pub(crate) fn each<T: Copy + Default, const N: usize>(of: impl Fn(usize) -> T) -> [T; N] {
    let mut values = [T::default(); N];
    for (i, value) in values.iter_mut().enumerate() {
        *value = of(i);
    }
    values
}

/// A value for each axis or colour, likewise.
#[inline(always)]
pub(crate) fn three<T>(of: impl Fn(usize) -> T) -> [T; 3] {
    [of(0), of(1), of(2)]
}

/// The values from the one at `first` on, of rows that are padded to whole stretches.
#[inline(always)]
pub(crate) fn some(values: &[f32], first: usize) -> &Lanes {
    values[first..].first_chunk().expect("rows are padded to whole stretches")
}

/// All bits set if it holds. A select by a mask stays without branches where one by a condition may not.
#[inline(always)]
pub(crate) fn mask(holds: bool) -> u32 {
    u32::from(holds).wrapping_neg()
}

/// `a` where the mask is set, otherwise `b`.
#[inline(always)]
pub(crate) fn pick(mask: u32, a: f32, b: f32) -> f32 {
    f32::from_bits((a.to_bits() & mask) | (b.to_bits() & !mask))
}

/// Not 0 if any mask is set.
#[inline(always)]
pub(crate) fn any(masks: &[u32; LANES]) -> u32 {
    masks.iter().fold(0, |a, b| a | b)
}

/// ⌊x⌋ for |x| < 2²², without a call or a check.
#[inline(always)]
pub(crate) fn floor(x: f32) -> i32 {
    // At this size a float's last bit is worth 1, so the sum's bits end in the nearest whole number.
    const UNITS: f32 = 12_582_912.0;
    let shifted = x + UNITS;
    let nearest = shifted.to_bits().wrapping_sub(UNITS.to_bits()) as i32;
    nearest - i32::from(shifted - UNITS > x)
}

/// A float's last bit is worth 1 from here on.
const UNITS_FROM: f32 = 8_388_608.0;

/// The nearest whole number of 0 ≤ x < 2²²; to even where there are two.
#[inline(always)]
pub(crate) fn nearest_whole(x: f32) -> f32 {
    (x + UNITS_FROM) - UNITS_FROM
}

/// The nearest whole number of 0 ≤ x < 2²², in the low 22 bits of the answer.
#[inline(always)]
pub(crate) fn low_bits(x: f32) -> u32 {
    (x + UNITS_FROM).to_bits()
}

/// The larger of two numbers in one instruction; `b` if either is NaN.
#[inline(always)]
pub(crate) fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller, likewise.
#[inline(always)]
pub(crate) fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::{floor, least, low_bits, mask, most, nearest_whole, pick};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rounding_without_calls_is_rounding(x in -4_000_000.0f32..4_000_000.0) {
            prop_assert_eq!(floor(x), x.floor() as i32);
            prop_assert_eq!(floor(x.floor()), x.floor() as i32);
            prop_assert_eq!(nearest_whole(x.abs()), x.abs().round_ties_even());
            prop_assert_eq!(low_bits(x.abs()) & 0x3f_ffff, x.abs().round_ties_even() as u32);
        }

        #[test]
        fn a_pick_is_a_select(a in any::<f32>(), b in any::<f32>(), holds: bool) {
            prop_assert_eq!(pick(mask(holds), a, b).to_bits(), if holds { a } else { b }.to_bits());
        }
    }

    #[test]
    fn what_is_not_a_number_loses() {
        assert_eq!((most(f32::NAN, 1.0), least(f32::NAN, 1.0)), (1.0, 1.0));
    }
}
