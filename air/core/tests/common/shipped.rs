//! The shipped files, of which tests change single keys.

use goshawk_core::{Airframe, ControllerConfig, LimitsConfig, Tuning, ViewConfig};
use serde::de::DeserializeOwned;

/// What the shipped tuning file says.
pub fn tuning() -> Tuning {
    toml::from_str(include_str!("../../../vehicles/tuning.toml")).unwrap()
}

/// What the shipped vehicle file says of the airframe.
pub fn airframe() -> Airframe {
    section("airframe")
}

/// What the shipped vehicle file says of the limits.
pub fn limits() -> LimitsConfig {
    section("limits")
}

fn section<T: DeserializeOwned>(name: &str) -> T {
    let file: toml::Table = toml::from_str(include_str!("../../../vehicles/sim.toml")).unwrap();
    file[name].clone().try_into().unwrap()
}

/// A vehicle with more thrust and less room, whose yaw has no lag, so that what a test expects can be reckoned by hand.
pub fn controller() -> ControllerConfig {
    let airframe = Airframe {
        hover_thrust: 0.25,
        hover_thrust_range: [0.13, 0.42],
        min_thrust: 0.03,
        max_thrust: 1.0,
        max_tilt_deg: 45.0,
        attitude_lag_s: 0.1,
        ..airframe()
    };
    let limits = LimitsConfig {
        fence_radius_m: 100.0,
        ceiling_m: 20.0,
        max_speed_mps: 12.0,
        battery_start: 0.3,
        battery_land: 0.15,
        ..limits()
    };
    let mut tuning = tuning();
    (tuning.yaw.max_rate_radps, tuning.yaw.max_acc_radps2, tuning.yaw.lag_s) = (2.5, 10.0, 0.0);
    (tuning.yaw.search_rate_radps, tuning.yaw.search_delay_s) = (1.0, 1.5);
    (tuning.mission.hold_distance_m, tuning.mission.resume_distance_m) = (3.0, 4.0);
    ControllerConfig::new(airframe, limits, ViewConfig { top: 0.63 }, &tuning)
}
