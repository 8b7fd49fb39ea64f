//! Lead: inverts the attitude loop's first-order lag with the trajectory's own jerk. Beyond the paper.

use crate::values::geometry::cap;
use crate::values::types::{Task, Vec3};
use schemars::JsonSchema;
use serde::Deserialize;

/// Lead over the attitude loop: f̈ + tau·f⃛.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LeadConfig {
    /// Largest lead, m/s².
    #[schemars(range(min = 0.0, max = 20.0), extend("x-why" = "more than two g of lead is noise", "x-source" = "chosen by eye"))]
    pub limit_mps2: f64,
    /// A chase: so much of the lag is flown without a lead, s. It smooths what changes from one image to the next.
    #[schemars(range(min = 0.0, max = 0.5), extend("x-why" = "a vehicle that answers later than this flies into what its plans avoid", "x-source" = "tried, notebook: Held back, and let go"))]
    pub chase_lag_s: f64,
    /// Navigation: likewise, s.
    #[schemars(range(min = 0.0, max = 0.5), extend("x-why" = "a vehicle that answers later than this flies into what its plans avoid", "x-source" = "tried, notebook: The asked speed is flown"))]
    pub navigation_lag_s: f64,
}

impl LeadConfig {
    /// How far `task` leads a vehicle of the lag `lag`, s.
    #[must_use]
    pub fn ahead(&self, task: Task, lag: f64) -> f64 {
        match task {
            Task::Track => (lag - self.chase_lag_s).max(0.0),
            Task::Navigate => (lag - self.navigation_lag_s).max(0.0),
        }
    }
}

/// f̈ + tau·f⃛: what to command now so that an acceleration that follows with lag tau is f̈. The lead's norm is bounded.
#[must_use]
pub fn lead(config: &LeadConfig, tau: f64, acc: Vec3, jerk: Vec3) -> Vec3 {
    acc + cap(jerk * tau, config.limit_mps2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lagging_vehicle_led_by_the_jerk_follows_the_acceleration() {
        let (config, dt) = (LeadConfig { limit_mps2: 100.0, chase_lag_s: 0.0, navigation_lag_s: 0.0 }, 1e-4);
        let (mut actual, mut worst) = (0.0_f64, 0.0_f64);
        for k in 0..20_000 {
            let t = f64::from(k) * dt;
            let command = lead(&config, 0.25, Vec3::new(3.0 * t.sin(), 0.0, 0.0), Vec3::new(3.0 * t.cos(), 0.0, 0.0));
            actual += (command.x - actual) / 0.25 * dt;
            worst = worst.max((actual - 3.0 * (t + dt).sin()).abs());
        }
        assert!(worst < 1e-3, "{worst}");
    }

    #[test]
    fn the_lead_is_bounded() {
        let config = LeadConfig { limit_mps2: 2.0, chase_lag_s: 0.0, navigation_lag_s: 0.0 };
        let led = lead(&config, 0.25, Vec3::zeros(), Vec3::new(0.0, 1e9, 0.0));
        assert!((led - Vec3::new(0.0, 2.0, 0.0)).norm() < 1e-9);
        assert_eq!(lead(&config, 0.25, Vec3::x(), Vec3::new(f64::NAN, 0.0, 0.0)), Vec3::x());
    }

    #[test]
    fn each_task_flies_a_short_lag_without_a_lead() {
        let config = LeadConfig { limit_mps2: 6.0, chase_lag_s: 0.04, navigation_lag_s: 0.08 };
        assert_eq!(config.ahead(Task::Navigate, 0.06), 0.0);
        assert!((config.ahead(Task::Navigate, 0.2) - 0.12).abs() < 1e-12);
        assert!((config.ahead(Task::Track, 0.06) - 0.02).abs() < 1e-12);
    }
}
