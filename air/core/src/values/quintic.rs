//! The trajectory: one fifth-order polynomial for each axis from its derivatives at both ends (eq. 1-2).

use crate::values::types::{FlatState, Vec3};

/// f(t) = Σ a_k t^k on 0..=T, in the frame of the states it was built from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quintic {
    coefficients: [Vec3; 6],
    duration: f64,
}

impl Quintic {
    /// The polynomial with state `start` at 0 and `end` at `duration` (s, above 0): `M·d` of eq. 2 in closed form.
    #[must_use]
    pub fn new(start: &FlatState, end: &FlatState, duration: f64) -> Self {
        let t = duration;
        // What is left at T once the starting derivatives have run freely, scaled to position.
        let pos = end.pos - start.pos - start.vel * t - start.acc * (0.5 * t * t);
        let vel = (end.vel - start.vel - start.acc * t) * t;
        let acc = (end.acc - start.acc) * (t * t);
        let (t3, t4) = (t * t * t, t * t * t * t);
        Self {
            coefficients: [
                start.pos,
                start.vel,
                start.acc * 0.5,
                (pos * 10.0 - vel * 4.0 + acc * 0.5) / t3,
                (pos * -15.0 + vel * 7.0 - acc) / t4,
                (pos * 6.0 - vel * 3.0 + acc * 0.5) / (t4 * t),
            ],
            duration,
        }
    }

    /// T, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// f, ḟ, f̈ at `t` seconds. Outside 0..=T the polynomial runs on: whoever flies it must not.
    #[must_use]
    pub fn at(&self, t: f64) -> FlatState {
        let a = &self.coefficients;
        FlatState {
            pos: a[0] + (a[1] + (a[2] + (a[3] + (a[4] + a[5] * t) * t) * t) * t) * t,
            vel: a[1] + (a[2] * 2.0 + (a[3] * 3.0 + (a[4] * 4.0 + a[5] * (5.0 * t)) * t) * t) * t,
            acc: a[2] * 2.0 + (a[3] * 6.0 + (a[4] * 12.0 + a[5] * (20.0 * t)) * t) * t,
        }
    }

    /// f⃛ at `t` seconds, m/s³.
    #[must_use]
    pub fn jerk(&self, t: f64) -> Vec3 {
        let a = &self.coefficients;
        a[3] * 6.0 + (a[4] * 24.0 + a[5] * (60.0 * t)) * t
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-20.0..20.0).prop_map(Vec3::from)
    }

    fn state() -> impl Strategy<Value = FlatState> {
        (vector(), vector(), vector()).prop_map(|(pos, vel, acc)| FlatState { pos, vel, acc })
    }

    proptest! {
        #[test]
        fn meets_all_derivatives_at_both_ends(start in state(), end in state(), duration in 0.2..4.0) {
            let quintic = Quintic::new(&start, &end, duration);
            for (time, want) in [(0.0, start), (duration, end)] {
                let got = quintic.at(time);
                prop_assert!((got.pos - want.pos).norm() < 1e-9);
                prop_assert!((got.vel - want.vel).norm() < 1e-8);
                prop_assert!((got.acc - want.acc).norm() < 1e-7);
            }
        }

        #[test]
        fn each_derivative_is_the_slope_of_the_one_below(start in state(), end in state(), t in 0.1..1.9) {
            let quintic = Quintic::new(&start, &end, 2.0);
            let h = 1e-5;
            let (before, now, after) = (quintic.at(t - h), quintic.at(t), quintic.at(t + h));
            prop_assert!(((after.pos - before.pos) / (2.0 * h) - now.vel).norm() < 1e-4);
            prop_assert!(((after.vel - before.vel) / (2.0 * h) - now.acc).norm() < 1e-4);
            prop_assert!(((after.acc - before.acc) / (2.0 * h) - quintic.jerk(t)).norm() < 1e-3);
        }
    }

    #[test]
    fn scaling_time_keeps_the_shape() {
        // f(alpha t): velocities grow with alpha, accelerations with alpha squared (eq. 5).
        let start = FlatState { vel: Vec3::new(2.0, 0.3, 0.0), ..Default::default() };
        let end =
            FlatState { pos: Vec3::new(5.0, 1.0, -0.5), vel: Vec3::new(3.0, 0.0, 0.2), acc: Vec3::new(1.0, -1.0, 0.0) };
        let scale = |s: &FlatState, a: f64| FlatState { pos: s.pos, vel: s.vel * a, acc: s.acc * a * a };
        let slow = Quintic::new(&start, &end, 2.0);
        let fast = Quintic::new(&scale(&start, 1.7), &scale(&end, 1.7), 2.0 / 1.7);
        for k in 0..=10 {
            let t = 0.2 * f64::from(k);
            assert!((slow.at(t).pos - fast.at(t / 1.7).pos).norm() < 1e-12);
        }
    }
}
