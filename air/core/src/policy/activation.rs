//! The network's output functions and the sines of small angles, over all anchors at once: straight-line code without
//! tables, calls or branches, which the compiler turns into vector instructions, and which costs few cache lines after a
//! network that has filled the caches with its weights.

/// Values of one channel for all anchors, padded to whole vectors.
pub(crate) type Lanes = [f32; LANES];

/// The anchors, and one more.
pub(crate) const LANES: usize = 16;

/// e^-|x|, to 2 ulp; 0 beyond |x| = 87.
fn exp_minus_abs(x: f32) -> f32 {
    /// ln 2, its leading bits: a multiple of it by a small integer is exact.
    const LN2_HIGH: f32 = 0.693_359_4;
    /// And what is left of ln 2.
    const LN2_LOW: f32 = -2.121_944_4e-4;
    /// 1.5 · 2²³. Adding it rounds to an integer, which then stands in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    /// 1 / k!, k = 7 .. 0.
    const TAYLOR: [f32; 8] = [1.0 / 5040.0, 1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
    let x = if x.abs() < 87.0 { -x.abs() } else { -87.0 };
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let power = shifted - ROUND;
    let rest = x - power * LN2_HIGH - power * LN2_LOW;
    let series = TAYLOR.iter().fold(0.0, |sum, c| sum * rest + c);
    // Times 2^power, in the exponent's bits.
    f32::from_bits(series.to_bits().wrapping_add(shifted.to_bits() << 23))
}

/// tanh of each, to 3e-7.
pub(crate) fn tanh(values: &mut [f32]) {
    for x in values {
        let e = exp_minus_abs(2.0 * *x);
        *x = ((1.0 - e) / (1.0 + e)).copysign(*x);
    }
}

/// 1 / (1 + e⁻ˣ) of each, to 3e-7.
pub(crate) fn sigmoid(values: &mut [f32]) {
    for x in values {
        let e = exp_minus_abs(*x);
        *x = if *x < 0.0 { e } else { 1.0 } / (1.0 + e);
    }
}

/// ln(1 + eˣ) of each, to 3e-7 of it and without overflow.
pub(crate) fn softplus(values: &mut [f32]) {
    for x in values {
        let e = exp_minus_abs(*x);
        // ln(1 + e) = 2 artanh(e / (2 + e)), whose argument is at most a third.
        let s = e / (2.0 + e);
        let series = (0..7).rev().fold(0.0, |sum, k: u16| sum * (s * s) + 1.0 / f32::from(2 * k + 1));
        *x = (if *x > 0.0 { *x } else { 0.0 }) + 2.0 * s * series;
    }
}

/// Sine and cosine of each angle between -pi/2 and pi/2, to 3e-7.
#[must_use]
pub(crate) fn sin_cos(angles: &Lanes) -> (Lanes, Lanes) {
    let (mut sin, mut cos) = ([0.0; LANES], [0.0; LANES]);
    for (lane, x) in angles.iter().enumerate() {
        let square = x * x;
        // Nested Taylor series.
        let nested = |first: u16| {
            (0..7).rev().fold(1.0, |sum, k| {
                let n = f32::from(2 * k + first);
                1.0 - sum * square * (1.0 / (n * (n + 1.0)))
            })
        };
        sin[lane] = x * nested(2);
        cos[lane] = nested(1);
    }
    (sin, cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn of(function: impl Fn(&mut [f32]), x: f32) -> f64 {
        let mut values = [x];
        function(&mut values);
        f64::from(values[0])
    }

    fn near(got: f64, want: f64) -> bool {
        (got - want).abs() <= 3e-7
    }

    proptest! {
        #[test]
        fn each_is_what_the_standard_library_says(x in prop_oneof![-30.0..30.0f32, -1e-3..1e-3f32, -1000.0..1000.0f32]) {
            let exact = f64::from(x);
            prop_assert!(near(of(tanh, x), exact.tanh()));
            prop_assert!(near(of(sigmoid, x), 1.0 / (1.0 + (-exact).exp())));
            let want = exact.max(0.0) + (-exact.abs()).exp().ln_1p();
            prop_assert!((of(softplus, x) - want).abs() <= 3e-7 * want + 1e-37, "{x} {want}");
        }

        #[test]
        fn sines_and_cosines_too(x in -std::f32::consts::FRAC_PI_2..std::f32::consts::FRAC_PI_2) {
            let (sin, cos) = sin_cos(&[x; LANES]);
            prop_assert!(near(sin[3].into(), f64::from(x).sin()) && near(cos[3].into(), f64::from(x).cos()));
        }

        #[test]
        fn whatever_comes_they_stay_within_their_bounds(x in prop::num::f32::ANY.prop_filter("finite", |x| x.is_finite())) {
            prop_assert!(of(tanh, x).abs() <= 1.0);
            prop_assert!((0.0..=1.0).contains(&of(sigmoid, x)));
            prop_assert!(of(softplus, x) >= 0.0);
        }
    }

    #[test]
    fn zero_is_exact() {
        assert_eq!([of(tanh, 0.0), of(sigmoid, 0.0)], [0.0, 0.5]);
    }
}
