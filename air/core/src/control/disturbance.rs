//! High-gain observer of the lumped disturbance (eq. 14-15), discretised exactly.
//!
//! Divided by the mass the observer is, for each axis, with v the velocity, u the modelled acceleration
//! (R_b F_c e_z / m - g) and a = alpha1/zeta, b = alpha2/zeta²:
//!
//! ```text
//! v̂' = u + d̂ + a (v - v̂)        d̂' = b (v - v̂)
//! ```
//!
//! Between two odometry samples take u as constant and v as linear, so that w = Δv/Δt - u is constant. Then
//! e = v - v̂ and q = d̂ - w obey (e, q)' = M (e, q) with M = [-a -1; b 0], and one step is the matrix exponential of
//! M Δt: exact, and stable for every Δt because M's eigenvalues have real parts below zero.
//!
//! Stability in the loop. The model u takes the attitude that was measured, so that the attitude loop's lag is no error
//! of it, and the estimate is the disturbance through G(s) = b / (s² + a s + b), whatever is commanded. What closes a
//! loop is thrust that is not what it is believed to be, F (1 + ε): ε times the commanded acceleration, which contains
//! -d̂, is a disturbance too, and comes back through the thrust's lag L: the loop gain is ε G L. |L| <= 1, and
//! |G| <= 1 at every frequency if and only if a² >= 2 b, that is alpha1² >= 2 alpha2, which the configuration must fulfil.
//! So by the small gain theorem the loop is stable for every |ε| < 1, any lag, any zeta > 0: a thrust from nothing to
//! twice what it is believed to be, more than what the bounds of the hover thrust leave.

use crate::values::geometry::cap;
use crate::values::types::Vec3;
use schemars::JsonSchema;
use serde::Deserialize;

/// Gains of the high-gain observer (eq. 14-15). `disturbance.rs` derives the region in which the loop is stable.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObserverConfig {
    /// First gain of eq. 15; the paper's alpha1.
    #[schemars(range(min = 0.1, max = 20.0), extend("x-why" = "a higher gain only follows noise", "x-source" = "the paper's authors, in their published code"))]
    pub alpha1: f64,
    /// Second gain of eq. 15, at most alpha1² / 2; the paper's alpha2.
    #[schemars(range(min = 0.01, max = 200.0), extend("x-why" = "with more than alpha1^2 / 2 the observer overshoots", "x-source" = "the paper's authors, in their published code"))]
    pub alpha2: f64,
    /// Time scale of eq. 15, s; the paper's zeta.
    #[schemars(range(min = 0.02, max = 2.0), extend("x-why" = "a slower observer is no answer to a gust", "x-source" = "the paper's authors, in their published code"))]
    pub zeta_s: f64,
    /// Largest disturbance that is believed, m/s².
    #[schemars(range(min = 0.0, max = 20.0), extend("x-why" = "no wind pushes with more than two g", "x-source" = "chosen by eye"))]
    pub limit_mps2: f64,
}

/// The observer's state; per unit mass.
#[derive(Clone, Copy, Debug)]
pub struct Observer {
    config: ObserverConfig,
    /// Velocity of the last sample, m/s; none: not started.
    vel_world: Option<Vec3>,
    /// v - v̂, m/s.
    error: Vec3,
    /// d̂ / m, m/s².
    disturbance: Vec3,
}

/// exp(M t) for M = [-a -1; b 0], row-major; a, b > 0, t >= 0.
fn transition(a: f64, b: f64, t: f64) -> [[f64; 2]; 2] {
    let s = -0.5 * a;
    let discriminant = s * s - b;
    // exp(M t) = c I + k (M - s I), with c and k from the eigenvalues s ± √discriminant.
    let root = discriminant.abs().sqrt();
    let (c, k) = if root * t < 1e-6 {
        ((s * t).exp(), (s * t).exp() * t)
    } else if discriminant > 0.0 {
        let (slow, fast) = (((s + root) * t).exp(), ((s - root) * t).exp());
        (0.5 * (slow + fast), 0.5 * (slow - fast) / root)
    } else {
        let decay = (s * t).exp();
        (decay * (root * t).cos(), decay * (root * t).sin() / root)
    };
    [[c + k * (-a - s), -k], [k * b, c - k * s]]
}

impl Observer {
    /// An observer that has seen nothing.
    #[must_use]
    pub fn new(config: ObserverConfig) -> Self {
        Self { config, vel_world: None, error: Vec3::zeros(), disturbance: Vec3::zeros() }
    }

    /// Forgets everything: on the ground, or after the odometry jumped or was stale.
    pub fn reset(&mut self) {
        *self = Self::new(self.config);
    }

    /// Goes on from `vel_world` with the estimate as it is: the velocity jumped, or samples are missing.
    pub fn rebase(&mut self, vel_world: Vec3) {
        if vel_world.iter().all(|x| x.is_finite()) {
            self.vel_world = Some(vel_world);
            self.error = Vec3::zeros();
        }
    }

    /// Takes the velocity that was measured `dt` seconds after the last one, and the acceleration that attitude and
    /// thrust alone gave meanwhile. The first call starts the observer at zero disturbance. A `dt` that is not above
    /// zero, or a value that is not finite, changes nothing.
    pub fn step(&mut self, dt: f64, vel_world: Vec3, acc_model_world: Vec3) {
        let finite = vel_world.iter().chain(acc_model_world.iter()).all(|x| x.is_finite());
        if !finite || !dt.is_finite() {
            return;
        }
        let Some(before) = self.vel_world else {
            self.vel_world = Some(vel_world);
            return;
        };
        if dt <= 0.0 {
            return;
        }
        let (a, b) = (self.config.alpha1 / self.config.zeta_s, self.config.alpha2 / self.config.zeta_s.powi(2));
        let phi = transition(a, b, dt);
        let w = (vel_world - before) / dt - acc_model_world;
        let q = self.disturbance - w;
        let error = self.error * phi[0][0] + q * phi[0][1];
        self.disturbance = cap(self.error * phi[1][0] + q * phi[1][1] + w, self.config.limit_mps2);
        self.error = if error.iter().all(|x| x.is_finite()) { error } else { Vec3::zeros() };
        self.vel_world = Some(vel_world);
    }

    /// d̂ / m, m/s²; never longer than the limit.
    #[must_use]
    pub fn disturbance(&self) -> Vec3 {
        self.disturbance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;
    use proptest::prelude::*;

    fn paper() -> ObserverConfig {
        ObserverConfig { limit_mps2: 50.0, ..shipped::tuning().observer }
    }

    #[test]
    fn a_constant_push_is_found_at_any_step() {
        let push = Vec3::new(1.0, -2.0, 0.5);
        for dt in [0.001, 0.005, 0.02, 0.1, 0.5, 3.0] {
            let mut observer = Observer::new(paper());
            let steps = (6.0_f64 / dt).ceil() as u32;
            for k in 0..=steps {
                observer.step(dt, push * (f64::from(k) * dt), Vec3::zeros());
            }
            assert!((observer.disturbance() - push).norm() < 1e-6, "dt {dt}");
        }
    }

    #[test]
    fn the_step_size_does_not_change_the_answer() {
        // Constant push: velocity is linear, so coarse and fine steps must agree exactly.
        let run = |steps: u32| {
            let mut observer = Observer::new(paper());
            for k in 0..=steps {
                let t = 0.4 * f64::from(k) / f64::from(steps);
                observer.step(0.4 / f64::from(steps), Vec3::x() * t, Vec3::zeros());
            }
            observer.disturbance()
        };
        assert!((run(1) - run(400)).norm() < 1e-12);
    }

    /// One axis in closed loop: thrust that is 1 + epsilon of what it is believed to be, with a lag, holds a velocity
    /// against a push. The largest acceleration error of the last second of 60.
    fn loop_error(config: ObserverConfig, epsilon: f64, lag: f64) -> f64 {
        let (mut observer, dt) = (Observer::new(ObserverConfig { limit_mps2: 1e9, ..config }), 0.01);
        let (mut vel, mut believed, mut worst) = (0.0, 0.0, 0.0_f64);
        for k in 0..6000 {
            observer.step(dt, Vec3::x() * vel, Vec3::x() * believed);
            let command = -observer.disturbance().x;
            believed += (command - believed) * (1.0 - (-dt / lag).exp());
            let acc = (1.0 + epsilon) * believed + 1.0;
            vel += acc * dt;
            if k >= 5900 {
                worst = worst.max(acc.abs());
            }
        }
        worst
    }

    #[test]
    fn within_its_gains_region_the_loop_is_stable_for_thrust_from_a_tenth_to_nearly_twice() {
        for (alpha1, alpha2) in [(3.0, 2.0), (2.0, 2.0), (6.0, 2.0), (1.0, 0.5)] {
            for zeta in [0.1, 0.2, 0.5] {
                for (epsilon, lag) in [(-0.9, 0.05), (-0.5, 0.3), (0.0, 0.1), (0.5, 0.3), (0.9, 0.05), (0.9, 0.3)] {
                    let config = ObserverConfig { alpha1, alpha2, zeta_s: zeta, limit_mps2: 6.0 };
                    let error = loop_error(config, epsilon, lag);
                    assert!(error < 0.03, "{alpha1}, {alpha2}, {zeta}, {epsilon}, {lag}: {error}");
                }
            }
        }
    }

    #[test]
    fn outside_its_gains_region_the_same_thrust_errors_swing_up() {
        let ringing = ObserverConfig { alpha1: 1.0, alpha2: 8.0, ..paper() };
        assert!(loop_error(ringing, 0.9, 0.05) > 10.0);
        assert!(loop_error(paper(), 0.9, 0.05) < 1e-6);
    }

    #[test]
    fn a_commanded_acceleration_is_no_disturbance() {
        let mut observer = Observer::new(paper());
        for k in 0..200 {
            observer.step(0.01, Vec3::x() * (0.03 * f64::from(k)), Vec3::x() * 3.0);
        }
        assert!(observer.disturbance().norm() < 1e-9);
    }

    #[test]
    fn equal_and_complex_eigenvalues_are_defined() {
        for alpha2 in [2.25, 2.25 + 1e-12, 9.0] {
            let config = ObserverConfig { alpha2, ..paper() };
            let mut observer = Observer::new(config);
            for k in 0..1000 {
                observer.step(0.005, Vec3::y() * (0.005 * f64::from(k)), Vec3::zeros());
            }
            assert!((observer.disturbance() - Vec3::y()).norm() < 1e-6);
        }
    }

    proptest! {
        #[test]
        fn a_free_observer_never_grows_at_any_step(
            alpha1 in 0.1..10.0, alpha2 in 0.1..10.0, zeta in 0.02..1.0, dt in 1e-4..100.0
        ) {
            // The spectral radius of the transition is below one.
            let m = transition(alpha1 / zeta, alpha2 / (zeta * zeta), dt);
            let (trace, det) = (m[0][0] + m[1][1], m[0][0] * m[1][1] - m[0][1] * m[1][0]);
            prop_assert!(det.abs() < 1.0 && trace.abs() < 1.0 + det);
        }

        #[test]
        fn the_estimate_stays_within_its_limit(
            dt in prop::num::f64::ANY, v in prop::array::uniform3(prop::num::f64::ANY), steps in 1..20
        ) {
            let mut observer = Observer::new(ObserverConfig { limit_mps2: 4.0, ..paper() });
            for k in 0..steps {
                observer.step(dt, Vec3::from(v) * f64::from(k), Vec3::zeros());
                prop_assert!(observer.disturbance().norm() <= 4.0 + 1e-9);
            }
        }
    }
}
