//! Yaw, planned apart from the trajectory (§III-C.2): toward the target, rate and acceleration limited; search when lost.

use crate::values::geometry::wrap;
use crate::values::types::Vec3;
use schemars::JsonSchema;
use serde::Deserialize;

/// Yaw limits and the search for a lost target.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct YawConfig {
    /// Largest yaw rate, rad/s.
    #[schemars(range(min = 0.1, max = 10.0), extend("x-why" = "odometry and camera are blurred beyond", "x-source" = "chosen by eye"))]
    pub max_rate_radps: f64,
    /// Largest yaw acceleration, rad/s².
    #[schemars(range(min = 0.1, max = 100.0), extend("x-why" = "no quadrotor's yaw answers quicker", "x-source" = "chosen by eye"))]
    pub max_acc_radps2: f64,
    /// Lag of the yaw loop, s: the command leads the plan by rate·lag. 0: no lead.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-why" = "a slower loop cannot be led", "x-source" = "chosen by eye"))]
    pub lag_s: f64,
    /// Yaw rate of the sweep for a lost target, rad/s.
    #[schemars(range(min = 0.05, max = 10.0), extend("x-why" = "it is a yaw rate as well", "x-source" = "3 was tried and gives the same, notebook, What mattered: Belief"))]
    pub search_rate_radps: f64,
    /// How long the camera looks where the target was lost before it sweeps, s.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-why" = "by then the target is elsewhere", "x-source" = "chosen by eye"))]
    pub search_delay_s: f64,
    /// Navigation: above this speed the nose follows the velocity, below it the goal, m/s.
    #[schemars(range(min = 0.1, max = 10.0), extend("x-why" = "navigation looks where it flies", "x-source" = "chosen by eye"))]
    pub along_velocity_speed_mps: f64,
}

/// Where the nose should point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum YawGoal {
    /// Stop turning.
    Keep,
    /// At a bearing (rad) that itself turns (rad/s).
    Toward {
        /// World yaw, rad.
        yaw: f64,
        /// The bearing's own rate, rad/s.
        rate: f64,
    },
    /// Turn at the search rate; the sign is the direction, positive to the left.
    Sweep(f64),
}

/// The planned yaw; runs ahead of the vehicle, which follows.
#[derive(Clone, Copy, Debug)]
pub struct YawPlanner {
    config: YawConfig,
    yaw: f64,
    rate: f64,
}

/// How fast an error is taken out once it is small, 1/s. Chosen by eye.
const GAIN: f64 = 6.0;

/// The goal that looks along `line_world` (m) to something that moves by `vel_world` (m/s) relative to us; keeps the
/// heading when it is overhead.
#[must_use]
pub fn toward(line_world: Vec3, vel_world: Vec3) -> YawGoal {
    let squared = line_world.xy().norm_squared();
    if !squared.is_finite() || squared < 0.3 * 0.3 {
        return YawGoal::Keep;
    }
    let rate = (line_world.x * vel_world.y - line_world.y * vel_world.x) / squared;
    YawGoal::Toward { yaw: line_world.y.atan2(line_world.x), rate: if rate.is_finite() { rate } else { 0.0 } }
}

/// Where to look on a way whose next place lies along `line_world` (m), flown with `vel_world` (m/s): along the velocity
/// when fast, to the place when slow or on the way away from it, in between by their share. Whoever only looks where they
/// go does not find back.
pub(crate) fn along(config: &YawConfig, line_world: Vec3, vel_world: Vec3) -> YawGoal {
    let to_place = Vec3::new(line_world.x, line_world.y, 0.0).try_normalize(1e-6).unwrap_or_default();
    let vel = Vec3::new(vel_world.x, vel_world.y, 0.0);
    let share = (vel.norm() / config.along_velocity_speed_mps - 0.5).clamp(0.0, 1.0);
    let along = vel.try_normalize(1e-6).unwrap_or_default();
    let share = share.min((along.dot(&to_place) + 0.5).max(0.0));
    toward(along * share + to_place * (1.0 - share), Vec3::zeros())
}

impl YawPlanner {
    /// At rest at yaw 0.
    #[must_use]
    pub fn new(config: YawConfig) -> Self {
        Self { config, yaw: 0.0, rate: 0.0 }
    }

    /// The configuration that it turns with.
    #[must_use]
    pub fn config(&self) -> &YawConfig {
        &self.config
    }

    /// At rest at `yaw` (rad): on the ground the plan follows the vehicle.
    pub fn reset(&mut self, yaw: f64) {
        self.yaw = wrap(yaw);
        self.rate = 0.0;
    }

    /// Turns the plan by `jump` (rad): the odometry's heading jumped, the vehicle did not.
    pub fn shift(&mut self, jump: f64) {
        self.yaw = wrap(self.yaw + jump);
    }

    /// Moves on by `dt` seconds (0..=0.1) and returns the yaw to command, led by the yaw loop's lag.
    pub fn step(&mut self, dt: f64, goal: YawGoal) -> f64 {
        let c = &self.config;
        let wanted = match goal {
            YawGoal::Keep => 0.0,
            YawGoal::Sweep(direction) => c.search_rate_radps * if direction < 0.0 { -1.0 } else { 1.0 },
            YawGoal::Toward { yaw, rate } => rate + approach_rate(wrap(yaw - self.yaw), c.max_acc_radps2),
        };
        let wanted = wanted.clamp(-c.max_rate_radps, c.max_rate_radps);
        self.rate += (wanted - self.rate).clamp(-c.max_acc_radps2 * dt, c.max_acc_radps2 * dt);
        self.yaw = wrap(self.yaw + self.rate * dt);
        wrap(self.yaw + self.rate * c.lag_s)
    }

    /// Planned yaw without the lead, rad.
    #[must_use]
    pub fn yaw(&self) -> f64 {
        self.yaw
    }
}

/// The rate that takes out `error`: proportional when it is small, else the fastest that `max_acc` can still stop.
fn approach_rate(error: f64, max_acc: f64) -> f64 {
    let linear = max_acc / (GAIN * GAIN);
    let size = error.abs();
    let rate = if size <= linear { GAIN * size } else { (2.0 * max_acc * (size - 0.5 * linear)).sqrt() };
    rate.copysign(error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;
    use proptest::prelude::*;

    fn config() -> YawConfig {
        shipped::controller().yaw
    }

    #[test]
    fn turns_to_a_bearing_the_short_way_round_without_overshoot() {
        let mut yaw = YawPlanner::new(config());
        yaw.reset(3.0);
        let mut past = 0.0_f64;
        for _ in 0..600 {
            yaw.step(0.005, YawGoal::Toward { yaw: -3.0, rate: 0.0 });
            past = past.max(wrap(yaw.yaw() - -3.0));
            assert!(yaw.yaw().abs() > 2.9, "went the long way");
        }
        assert!(wrap(yaw.yaw() + 3.0).abs() < 1e-3 && past < 0.01, "{past}");
    }

    #[test]
    fn follows_a_turning_bearing_without_lag() {
        let mut yaw = YawPlanner::new(config());
        for k in 0..600 {
            yaw.step(0.005, YawGoal::Toward { yaw: wrap(0.005 * f64::from(k + 1)), rate: 1.0 });
        }
        assert!(wrap(yaw.yaw() - 3.0).abs() < 0.01);
    }

    #[test]
    fn the_command_leads_the_plan_by_the_loops_lag() {
        let mut yaw = YawPlanner::new(YawConfig { lag_s: 0.2, ..config() });
        for _ in 0..200 {
            let command = yaw.step(0.005, YawGoal::Sweep(-1.0));
            assert!(wrap(command - (yaw.yaw() + 0.2 * yaw.rate)).abs() < 1e-12);
        }
        assert!((yaw.rate + 1.0).abs() < 1e-9, "sweeps to the right");
    }

    #[test]
    fn a_target_overhead_keeps_the_heading() {
        assert_eq!(toward(Vec3::new(0.1, 0.1, 3.0), Vec3::zeros()), YawGoal::Keep);
    }

    #[test]
    fn a_target_crossing_to_the_left_turns_left() {
        let YawGoal::Toward { yaw, rate } = toward(Vec3::new(4.0, 0.0, 0.0), Vec3::new(0.0, 2.0, 0.0)) else {
            panic!("expected a bearing");
        };
        assert_eq!((yaw, rate), (0.0, 0.5));
    }

    proptest! {
        #[test]
        fn rate_and_acceleration_stay_within_limits(
            goals in prop::collection::vec((-10.0..10.0f64, -20.0..20.0f64), 1..50), dt in 0.001..0.1
        ) {
            let mut planner = YawPlanner::new(config());
            for (yaw, rate) in goals {
                let (before, before_rate) = (planner.yaw, planner.rate);
                planner.step(dt, YawGoal::Toward { yaw, rate });
                prop_assert!((planner.rate - before_rate).abs() <= config().max_acc_radps2 * dt + 1e-9);
                prop_assert!(wrap(planner.yaw - before).abs() <= config().max_rate_radps * dt + 1e-9);
            }
        }
    }
}
