//! What a flight must not exceed: place, height, speed, time, charge. Tilt and thrust are limited in `flatness.rs`.

use crate::control::hover::HoldConfig;
use crate::mission::interface::Profile;
use crate::values::types::Vec3;
use schemars::JsonSchema;
use serde::Deserialize;

/// What no flight may exceed, from the start, whatever its profile says. What would go beyond lands before it does.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LimitsConfig {
    /// Largest horizontal distance from the start, m.
    #[schemars(range(min = 1.0, max = 10000.0), extend("x-why" = "no small quadrotor comes back from farther on one battery", "x-source" = "the place of the flight; shipped: chosen by eye for the simulator"))]
    pub fence_radius_m: f64,
    /// Largest height above the start, m.
    #[schemars(range(min = 1.0, max = 500.0), extend("x-why" = "above fly others", "x-source" = "the law and the place; shipped: chosen by eye for the simulator"))]
    pub ceiling_m: f64,
    /// Largest speed, m/s.
    #[schemars(range(min = 0.5, max = 30.0), extend("x-why" = "no policy is trained beyond, nor sees far enough", "x-source" = "chosen by eye: beyond the fastest navigation, 15 m/s"))]
    pub max_speed_mps: f64,
    /// Longest time from Start to the landing's beginning, s.
    #[schemars(range(min = 10.0, max = 7200.0), extend("x-why" = "no small quadrotor's battery lasts longer", "x-source" = "measure how long the battery hovers, and leave a fifth; shipped: chosen by eye"))]
    pub max_time_s: f64,
    /// Charge below which Start is refused, 0..1.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-why" = "it is a share of a full battery, and below battery_land a flight would end as it begins", "x-source" = "chosen by eye"))]
    pub battery_start: f64,
    /// Charge below which the vehicle lands, 0..1.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-why" = "it is a share of a full battery", "x-source" = "chosen by eye"))]
    pub battery_land: f64,
    /// Least distance from the vehicle's centre to the target's, m. Kept by braking, stepping aside and climbing.
    #[schemars(range(min = 0.1, max = 20.0), extend("x-why" = "a person is that wide, and farther off the target is not seen well", "x-source" = "chosen by eye for people"))]
    pub min_target_distance_m: f64,
}

/// Between the decision to brake and the braking, s: odometry's delay and the attitude loop's lag, amply.
const REACTION: f64 = 0.3;

impl LimitsConfig {
    /// Which limit the profile goes beyond; none: it can be flown.
    #[must_use]
    pub fn exceeded_by(&self, profile: &Profile) -> Option<&'static str> {
        let goal = profile.goal.unwrap_or_default();
        if profile.speed > self.max_speed_mps {
            Some("its speed is above limits.max_speed_mps")
        } else if profile.height.max(goal.z) > self.ceiling_m {
            Some("its height or its goal is above limits.ceiling_m")
        } else if goal.xy().norm() > self.fence_radius_m {
            Some("its goal is beyond limits.fence_radius_m")
        } else {
            None
        }
    }

    /// A vehicle at `from_start` (m, world axes) with `vel_world` can only just stop inside the fence.
    #[must_use]
    pub fn reaches_fence(&self, hold: &HoldConfig, from_start: Vec3, vel_world: Vec3) -> bool {
        let vel = vel_world.xy();
        let way = stopping_distance(hold, vel.norm(), hold.max_acc_horizontal_mps2);
        (from_start.xy() + vel.try_normalize(1e-6).unwrap_or_default() * way).norm() > self.fence_radius_m
    }

    /// As [`LimitsConfig::reaches_fence`], for the ceiling.
    #[must_use]
    pub fn reaches_ceiling(&self, hold: &HoldConfig, from_start: Vec3, vel_world: Vec3) -> bool {
        from_start.z + stopping_distance(hold, vel_world.z.max(0.0), hold.max_acc_vertical_mps2) > self.ceiling_m
    }

    /// `acc_world` with as much less of it along the velocity as keeps the speed below its limit, which is approached
    /// with the velocity gain `kv`, 1/s.
    #[must_use]
    pub fn within_speed(&self, acc_world: Vec3, vel_world: Vec3, kv: f64) -> Vec3 {
        let speed = vel_world.norm();
        let Some(along) = vel_world.try_normalize(1e-6) else { return acc_world };
        let excess = acc_world.dot(&along) - kv * (self.max_speed_mps - speed);
        if excess > 0.0 { acc_world - along * excess } else { acc_world }
    }
}

/// Way that the hover's braking takes from `speed`: at its most acceleration until the velocity gain asks for less.
fn stopping_distance(hold: &HoldConfig, speed: f64, max_acc: f64) -> f64 {
    let knee = max_acc / hold.kv;
    let hard = if speed > knee { (speed * speed - knee * knee) / (2.0 * max_acc) } else { 0.0 };
    speed * REACTION + hard + speed.min(knee) / hold.kv
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;
    use crate::values::types::Task;
    use proptest::prelude::*;

    fn limits() -> LimitsConfig {
        LimitsConfig { fence_radius_m: 50.0, ceiling_m: 10.0, max_speed_mps: 8.0, ..shipped::limits() }
    }
    fn hold() -> HoldConfig {
        shipped::tuning().hold
    }

    #[test]
    fn a_profile_beyond_a_limit_is_named_by_it() {
        let profile = Profile { task: Task::Track, speed: 8.0, height: 10.0, goal: Some(Vec3::new(30.0, 40.0, 10.0)) };
        assert_eq!(limits().exceeded_by(&profile), None);
        let names = |profile: Profile, limit: &str| assert!(limits().exceeded_by(&profile).unwrap().contains(limit));
        names(Profile { speed: 8.1, ..profile }, "max_speed");
        names(Profile { height: 10.1, ..profile }, "ceiling");
        names(Profile { goal: Some(Vec3::new(0.0, 0.0, 11.0)), ..profile }, "ceiling");
        names(Profile { goal: Some(Vec3::new(31.0, 40.0, 1.0)), ..profile }, "fence_radius");
    }

    #[test]
    fn the_fence_is_reached_earlier_the_faster_and_only_outward() {
        let at = |x: f64, v: f64| limits().reaches_fence(&hold(), Vec3::new(x, 0.0, 2.0), Vec3::new(v, 0.0, 0.0));
        assert!(!at(49.9, 0.0) && at(50.1, 0.0));
        assert!(!at(40.0, 4.0) && at(40.0, 10.0) && !at(45.0, -10.0));
        assert!(limits().reaches_ceiling(&hold(), Vec3::new(0.0, 0.0, 9.0), Vec3::z() * 2.0));
        assert!(!limits().reaches_ceiling(&hold(), Vec3::new(0.0, 0.0, 9.0), Vec3::z() * -2.0));
    }

    proptest! {
        #[test]
        fn at_the_speed_limit_nothing_accelerates_along_the_way_and_nothing_else_changes(
            acc in prop::array::uniform3(-30.0..30.0f64), vel in prop::array::uniform3(-20.0..20.0f64)
        ) {
            let (acc, vel) = (Vec3::from(acc), Vec3::from(vel));
            let limited = limits().within_speed(acc, vel, 2.5);
            let along = vel.normalize();
            prop_assert!(limited.dot(&along) <= 2.5 * (8.0 - vel.norm()) + 1e-6 || limited == acc);
            prop_assert!(((limited - acc) - along * (limited - acc).dot(&along)).norm() < 1e-9);
            prop_assert!((limited - acc).dot(&along) <= 1e-9, "it never pushes");
        }
    }
}
