//! The vehicle's state estimate: the truth with an estimator's noise and drift, and late.

use std::collections::VecDeque;

use goshawk_core::{Odometry, Time, Vec3};
use nalgebra::UnitQuaternion;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::Deserialize;

use crate::vehicle::quadrotor::QuadrotorState;

/// Errors of a visual-inertial estimator; see `sensors/d455.toml` for values.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OdometryConfig {
    /// From a state being true to its being known, s.
    pub delay_s: f64,
    /// White noise of position, m.
    pub position_m: f64,
    /// Random walk of position, m/√s.
    pub drift_m: f64,
    /// White noise of velocity, m/s.
    pub velocity_mps: f64,
    /// Slow error of velocity (Gauss-Markov), standard deviation, m/s.
    pub velocity_bias_mps: f64,
    /// Its correlation time, s.
    pub bias_time_s: f64,
    /// White noise of attitude, rad.
    pub attitude_rad: f64,
    /// Random walk of yaw, rad/√s.
    pub yaw_drift_rad: f64,
    /// White noise of angular velocity, rad/s.
    pub rate_radps: f64,
    /// Mean time between jumps of the position, s; 0: never.
    pub jump_every_s: f64,
    /// Size of a jump, in a random direction, m.
    pub jump_m: f64,
}

/// Makes odometry of the truth; the same seed makes the same errors.
#[derive(Clone, Debug)]
pub struct Estimator {
    config: OdometryConfig,
    drift: Vec3,
    velocity_bias: Vec3,
    yaw_drift: f64,
    jumps: u32,
    last: Option<Time>,
    waiting: VecDeque<Odometry>,
    rng: ChaCha8Rng,
}

impl Estimator {
    /// An estimator without drift yet.
    #[must_use]
    pub fn new(config: OdometryConfig, seed: u64) -> Self {
        let mut estimator = Self {
            config,
            drift: Vec3::zeros(),
            velocity_bias: Vec3::zeros(),
            yaw_drift: 0.0,
            jumps: 0,
            last: None,
            waiting: VecDeque::new(),
            rng: ChaCha8Rng::seed_from_u64(seed),
        };
        estimator.velocity_bias = estimator.noise(config.velocity_bias_mps);
        estimator
    }

    /// Observes the truth at `now`.
    pub fn observe(&mut self, now: Time, truth: &QuadrotorState) {
        let odometry = self.estimate(now, truth);
        self.waiting.push_back(odometry);
    }

    /// The estimate of the truth at `now`, without the delay.
    pub fn estimate(&mut self, now: Time, truth: &QuadrotorState) -> Odometry {
        let config = self.config;
        let dt = self.last.map_or(0.0, |last| now.since(last)).max(0.0);
        self.last = Some(now);
        self.wander(dt);
        let turn = UnitQuaternion::from_axis_angle(&Vec3::z_axis(), self.yaw_drift);
        Odometry {
            stamp: now,
            pos_world: truth.pos_world + self.drift + self.noise(config.position_m),
            vel_world: turn * truth.vel_world + self.velocity_bias + self.noise(config.velocity_mps),
            world_from_body: turn
                * truth.world_from_body
                * UnitQuaternion::from_scaled_axis(self.noise(config.attitude_rad)),
            ang_vel_body: truth.ang_vel_body + self.noise(config.rate_radps),
            reset_counter: self.jumps,
        }
    }

    /// Lets the slow errors go on for `dt` s.
    fn wander(&mut self, dt: f64) {
        let config = self.config;
        let step = self.noise(config.drift_m * dt.sqrt());
        self.drift += step;
        let keep = (-dt / config.bias_time_s).exp();
        let kick = self.noise(config.velocity_bias_mps * (1.0 - keep * keep).sqrt());
        self.velocity_bias = self.velocity_bias * keep + kick;
        self.yaw_drift += config.yaw_drift_rad * dt.sqrt() * self.rng.sample::<f64, _>(StandardNormal);
        if config.jump_every_s > 0.0 && self.rng.random_bool((dt / config.jump_every_s).min(1.0)) {
            let direction = self.noise(1.0).try_normalize(1e-9).unwrap_or(Vec3::x());
            self.drift += direction * config.jump_m;
            self.jumps = self.jumps.wrapping_add(1);
        }
    }

    /// The next estimate that has become known by `now`.
    pub fn known(&mut self, now: Time) -> Option<Odometry> {
        let due = self.waiting.front().is_some_and(|o| now >= o.stamp.plus(self.config.delay_s));
        due.then(|| self.waiting.pop_front()).flatten()
    }

    fn noise(&mut self, std: f64) -> Vec3 {
        Vec3::from_fn(|_, _| std * self.rng.sample::<f64, _>(StandardNormal))
    }
}
