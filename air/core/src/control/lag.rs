//! The attitude loop's first-order lag, learnt in flight. Beyond the paper.
//!
//! The direction of the commanded specific force, which is the commanded body z axis, goes through a row of models, each
//! a first-order lag of its own. The one whose output is nearest to the body z axis that was measured tells the lag. An
//! output error is not biased by the measurement's noise, and wind, weight and drag do not enter: they move the vehicle,
//! not its axis. The models are compared only while they differ, so that a hover neither teaches nor forgets.

use crate::values::types::{Time, Vec3};

/// Models in the row. With lags of 0.04 to 0.35 s each is 1.3 times the one before.
const MODELS: usize = 9;
/// Commands that odometry has not reached yet, at most: 0.6 s of them at 200 Hz.
const WAITING: usize = 128;
/// The models differ: distance of the first and the last one's axis, about rad. Chosen by eye, ten times the attitude's
/// noise in `ground/sim/sensors/d455.toml`.
const EXCITED: f64 = 0.03;
/// Time constant of forgetting while excited, s. Chosen by eye.
const MEMORY: f64 = 6.0;
/// What the file's value weighs against one of half or twice it, rad² s: so little that a step of 10 degrees outweighs
/// it.
const PRIOR: f64 = 3e-4;
/// Time constant with which the estimate follows the best model while excited, s. Chosen by eye.
const SMOOTHING: f64 = 0.5;
/// Measurements farther apart are not compared, s. Chosen by eye.
const LONGEST_GAP: f64 = 0.1;

/// The lag's estimate.
#[derive(Clone, Copy, Debug)]
pub struct AttitudeLag {
    /// What the estimate may come to, s.
    range: [f64; 2],
    estimate: f64,
    /// Each model's lag, s, evenly spaced by their logarithm, and its axis, world frame.
    lag: [f64; MODELS],
    axis_world: [Vec3; MODELS],
    /// ∫ |axis - measured|² dt, fading.
    error: [f64; MODELS],
    /// Command that the models follow, and how far they have come; none: not started.
    at: Option<(Time, Vec3)>,
    waiting: [(Time, Vec3); WAITING],
    first: usize,
    count: usize,
    measured: Option<Time>,
}

impl AttitudeLag {
    /// Believes `tau` (s) until flight says otherwise; the estimate stays in `range` (s).
    #[must_use]
    pub fn new([least, most]: [f64; 2], tau: f64) -> Self {
        let ratio = (most / least).ln() / (MODELS - 1) as f64;
        let lag: [f64; MODELS] = std::array::from_fn(|i| least * (ratio * i as f64).exp());
        Self {
            range: [least, most],
            estimate: tau.clamp(least, most),
            lag,
            axis_world: [Vec3::z(); MODELS],
            error: lag.map(|lag| PRIOR * ((lag / tau.max(1e-3)).ln() / std::f64::consts::LN_2).powi(2)),
            at: None,
            waiting: [(Time(0), Vec3::zeros()); WAITING],
            first: 0,
            count: 0,
            measured: None,
        }
    }

    /// The estimate, s; within the bounds.
    #[must_use]
    pub fn get(&self) -> f64 {
        self.estimate
    }

    /// What was commanded and measured does not belong to what comes: on the ground, after a jump of the heading. What
    /// was learnt stays.
    pub fn skip(&mut self) {
        (self.at, self.count, self.measured) = (None, 0, None);
    }

    /// From `now` on the body z axis is commanded to be `axis_world` (a unit vector).
    pub fn command(&mut self, now: Time, axis_world: Vec3) {
        if !is_unit(axis_world) {
            return;
        }
        if self.at.is_none() {
            self.at = Some((now, axis_world));
            self.axis_world = [axis_world; MODELS];
            return;
        }
        if self.count == WAITING {
            self.follow_next();
        }
        self.waiting[(self.first + self.count) % WAITING] = (now, axis_world);
        self.count += 1;
    }

    /// At `stamp` the body z axis was `axis_world`, in free flight.
    pub fn measure(&mut self, stamp: Time, axis_world: Vec3) {
        while self.count > 0 && self.waiting[self.first].0 <= stamp {
            self.follow_next();
        }
        self.relax(stamp);
        let before = self.measured.replace(stamp);
        let (Some(before), Some(_)) = (before, self.at) else { return };
        let dt = stamp.since(before);
        let differ = (self.axis_world[0] - self.axis_world[MODELS - 1]).norm();
        if differ > EXCITED && (0.0..=LONGEST_GAP).contains(&dt) && is_unit(axis_world) {
            let keep = (-dt / MEMORY).exp();
            for (error, model) in self.error.iter_mut().zip(&self.axis_world) {
                *error = *error * keep + (axis_world - model).norm_squared() * dt;
            }
            self.estimate += (self.best() - self.estimate) * (1.0 - (-dt / SMOOTHING).exp());
        }
    }

    /// The models move on to the oldest command that waits, and follow it from there.
    fn follow_next(&mut self) {
        let (from, axis_world) = self.waiting[self.first];
        self.first = (self.first + 1) % WAITING;
        self.count -= 1;
        self.relax(from);
        self.at = self.at.map(|(at, _)| (at, axis_world));
    }

    /// The models move on to `to` under the command that they follow.
    fn relax(&mut self, to: Time) {
        let Some((at, axis_world)) = self.at.filter(|(at, _)| to > *at) else { return };
        let dt = to.since(at);
        for (model, lag) in self.axis_world.iter_mut().zip(&self.lag) {
            *model += (axis_world - *model) * (1.0 - (-dt / lag).exp());
        }
        self.at = Some((to, axis_world));
    }

    /// The lag with the least error, between the models by the parabola through the three nearest ones.
    fn best(&self) -> f64 {
        let nearest = (0..MODELS).fold(0, |best, i| if self.error[i] < self.error[best] { i } else { best });
        let inner = nearest.clamp(1, MODELS - 2);
        let (low, mid, high) = (self.error[inner - 1], self.error[inner], self.error[inner + 1]);
        let curvature = low - 2.0 * mid + high;
        let offset = if curvature > 0.0 { (0.5 * (low - high) / curvature).clamp(-1.0, 1.0) } else { 0.0 };
        let ratio = self.lag[1] / self.lag[0];
        (self.lag[inner] * ratio.powf(offset)).clamp(self.range[0], self.range[1])
    }
}

fn is_unit(v: Vec3) -> bool {
    (v.norm_squared() - 1.0).abs() < 1e-3
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RANGE: [f64; 2] = [0.04, 0.35];

    fn axis(tilt: f64) -> Vec3 {
        Vec3::new(tilt.sin(), 0.0, tilt.cos())
    }

    /// Weaves for `seconds` with a true lag of `tau`: commands at 200 Hz, odometry at 100 Hz known 10 ms late and with
    /// noise (rad).
    fn fly(lag: &mut AttitudeLag, tau: f64, seconds: f64, amplitude: f64, noise: f64) {
        let (mut actual, mut late) = (0.0, [(Time(0), Vec3::z()); 2]);
        for k in 0..(seconds * 200.0) as u32 {
            let now = Time::from_secs(100.0 + f64::from(k) * 0.005);
            // A new plan every 0.3 s.
            let command = amplitude * (f64::from(k / 60) * 2.4).sin();
            lag.command(now, axis(command));
            if k % 2 == 0 {
                let error = noise * ((f64::from(k) * 12.9898).sin() * 43_758.547).fract();
                if late[0].0 > Time(0) {
                    lag.measure(late[0].0, late[0].1);
                }
                late = [late[1], (now, axis(actual + error))];
            }
            actual += (command - actual) * (1.0 - (-0.005_f64 / tau).exp());
        }
    }

    #[test]
    fn lags_of_50_to_300_ms_are_found_in_the_noise_with_a_wrong_file() {
        for tau in [0.05, 0.1, 0.2, 0.3] {
            let mut lag = AttitudeLag::new(RANGE, 0.1);
            fly(&mut lag, tau, 6.0, 0.3, 0.006);
            assert!((lag.get() / tau - 1.0).abs() < 0.1, "{tau}: {}", lag.get());
        }
    }

    #[test]
    fn a_hover_neither_teaches_nor_forgets() {
        let mut lag = AttitudeLag::new(RANGE, 0.1);
        fly(&mut lag, 0.2, 6.0, 0.3, 0.0);
        let learnt = lag.get();
        lag.skip();
        fly(&mut lag, 0.05, 60.0, 0.005, 0.006);
        assert_eq!(lag.get(), learnt);
    }

    #[test]
    fn a_lag_beyond_the_bounds_ends_at_them() {
        for (tau, bound) in [(0.01, RANGE[0]), (0.9, RANGE[1])] {
            let mut lag = AttitudeLag::new(RANGE, 0.1);
            fly(&mut lag, tau, 10.0, 0.3, 0.0);
            assert!((lag.get() / bound - 1.0).abs() < 0.05, "{tau}: {}", lag.get());
        }
    }

    #[test]
    fn more_commands_than_can_wait_lose_nothing_but_time() {
        let mut lag = AttitudeLag::new(RANGE, 0.1);
        for k in 0..1000 {
            lag.command(Time::from_secs(f64::from(k) * 0.005), axis(0.3));
        }
        lag.measure(Time::from_secs(5.0), axis(0.3));
        assert_eq!(lag.get(), 0.1);
    }

    proptest! {
        #[test]
        fn whatever_comes_the_estimate_is_within_its_bounds(
            steps in prop::collection::vec((any::<u32>(), prop::array::uniform3(prop::num::f64::ANY), any::<bool>(), any::<bool>()), 1..200)
        ) {
            let mut lag = AttitudeLag::new(RANGE, 0.1);
            for (stamp, v, command, unit) in steps {
                let v = Vec3::from(v);
                let (stamp, v) = (Time(u64::from(stamp)), if unit { axis(v.x) } else { v });
                if command { lag.command(stamp, v) } else { lag.measure(stamp, v) }
                prop_assert!((RANGE[0]..=RANGE[1]).contains(&lag.get()), "{}", lag.get());
            }
        }
    }
}
