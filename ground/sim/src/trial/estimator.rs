//! The vehicle's state estimate: the truth with an estimator's noise and drift, and late.

use std::collections::VecDeque;

use goshawk_core::types::{Odometry, Time, Vec3};
use nalgebra::UnitQuaternion;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::quadrotor::QuadrotorState;

/// Errors of a good visual-inertial estimator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimatorConfig {
    /// White noise of position, m.
    pub position_m: f64,
    /// Random walk of position, m/√s.
    pub drift_m: f64,
    /// White noise of velocity, m/s.
    pub velocity_mps: f64,
    /// White noise of attitude, rad.
    pub attitude_rad: f64,
    /// White noise of angular velocity, rad/s.
    pub rate_radps: f64,
    /// From a state being true to its being known, s.
    pub delay_s: f64,
}

impl Default for EstimatorConfig {
    fn default() -> Self {
        Self {
            position_m: 0.005,
            drift_m: 0.02,
            velocity_mps: 0.03,
            attitude_rad: 0.003,
            rate_radps: 0.01,
            delay_s: 0.010,
        }
    }
}

/// Makes odometry of the truth; the same seed makes the same errors.
#[derive(Clone, Debug)]
pub struct Estimator {
    config: EstimatorConfig,
    drift: Vec3,
    last: Option<Time>,
    waiting: VecDeque<Odometry>,
    rng: ChaCha8Rng,
}

impl Estimator {
    /// An estimator without drift yet.
    #[must_use]
    pub fn new(config: EstimatorConfig, seed: u64) -> Self {
        let rng = ChaCha8Rng::seed_from_u64(seed);
        Self { config, drift: Vec3::zeros(), last: None, waiting: VecDeque::new(), rng }
    }

    /// Observes the truth at `now`.
    pub fn observe(&mut self, now: Time, truth: &QuadrotorState) {
        let odometry = self.estimate(now, truth);
        self.waiting.push_back(odometry);
    }

    /// The estimate of the truth at `now`, without the delay.
    pub fn estimate(&mut self, now: Time, truth: &QuadrotorState) -> Odometry {
        let config = self.config;
        let dt = self.last.map_or(0.0, |last| now.since(last));
        self.last = Some(now);
        let step = self.noise(config.drift_m * dt.max(0.0).sqrt());
        self.drift += step;
        Odometry {
            stamp: now,
            pos_world: truth.pos_world + self.drift + self.noise(config.position_m),
            vel_world: truth.vel_world + self.noise(config.velocity_mps),
            world_from_body: truth.world_from_body * UnitQuaternion::from_scaled_axis(self.noise(config.attitude_rad)),
            ang_vel_body: truth.ang_vel_body + self.noise(config.rate_radps),
            reset_counter: 0,
        }
    }

    /// The next estimate that has become known by `now`.
    pub fn known(&mut self, now: Time) -> Option<Odometry> {
        let due = self.waiting.front().is_some_and(|o| now >= o.stamp.plus(self.config.delay_s));
        due.then(|| self.waiting.pop_front()).flatten()
    }

    /// How far the estimate of the position has drifted, m.
    #[must_use]
    pub fn drift_world(&self) -> Vec3 {
        self.drift
    }

    fn noise(&mut self, std: f64) -> Vec3 {
        Vec3::from_fn(|_, _| std * self.rng.sample::<f64, _>(StandardNormal))
    }
}
