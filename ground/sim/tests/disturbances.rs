//! What the disturbance observer cancels in closed loop, against the same vehicle without one.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{Constant, config, contract, vehicle};
use goshawk_core::{ControllerOutput, Mode, Task, Time, Vec3};
use goshawk_sim::pilots::fly_trial;
use goshawk_sim::trial::{Difference, Pilot, TrialConfig, Truth, Witness};
use goshawk_vehicle::config::Vehicle;
use std::path::Path;

/// Where the vehicle was while it should have held its place.
#[derive(Default)]
struct Held {
    since: Option<Time>,
    anchor: Vec3,
    offsets: Vec<Vec3>,
}

/// After the take-off the hold settles for so long, s.
const SETTLES_S: f64 = 3.0;

impl Witness for Held {
    fn control(&mut self, now: Time, output: &ControllerOutput, _onboard: &dyn Pilot) {
        if output.mode == Mode::Navigate {
            self.since.get_or_insert(now);
            self.anchor = output.flat.pos;
        }
    }

    fn truth(&mut self, now: Time, truth: &Truth<'_>) {
        if self.since.is_some_and(|since| now.since(since) > SETTLES_S) {
            self.offsets.push(truth.vehicle.pos_world - self.anchor);
        }
    }
}

/// Root mean square distance from the place that is held, m: horizontal and vertical; infinite if it never got up there.
fn hold(airframe: Difference, wind_mps: f64, vehicle: &Vehicle) -> (f64, f64) {
    // At this speed a navigation that goes nowhere is given up after half a minute.
    let mut config = TrialConfig { airframe, wind_mps, ..config(Task::Navigate, 15.0, 12.0, 4) };
    config.sensors.odometry.drift_m = 0.0;
    config.sensors.odometry.velocity_bias_mps = 0.0;
    let mut held = Held::default();
    let mut nowhere = Constant(contract("navigate"), f32::NAN);
    fly_trial(&config, vehicle, Some(&mut nowhere), &mut held).unwrap();
    if held.offsets.len() < 300 {
        return (f64::INFINITY, f64::INFINITY);
    }
    let rms = |of: &dyn Fn(&Vec3) -> f64| {
        (held.offsets.iter().map(|o| of(o).powi(2)).sum::<f64>() / held.offsets.len() as f64).sqrt()
    };
    (rms(&|o| o.xy().norm()), rms(&|o| o.z))
}

/// The vehicle, but that it holds its place for as long as the flight lasts: a network without numbers gives no plan.
fn patient() -> Vehicle {
    edited(&vehicle(), &[("no_plan_land_s = 20.0", "no_plan_land_s = 120.0")])
}

/// The same with an observer that may find nothing, and a hover thrust that may not be learnt.
fn without_observer() -> Vehicle {
    let bare = edited(
        &patient(),
        &[
            ("zeta_s = 0.2\nlimit_mps2 = 6.0", "zeta_s = 0.2\nlimit_mps2 = 0.0"),
            ("hover_thrust_range = [0.20, 0.55]", "hover_thrust_range = [0.35, 0.35]"),
        ],
    );
    assert_eq!(bare.controller_config().observer.limit_mps2, 0.0);
    bare
}

fn edited(vehicle: &Vehicle, changes: &[(&str, &str)]) -> Vehicle {
    let (mut text, mut tuning) = (vehicle.text.clone(), vehicle.tuning_text.clone());
    for (old, new) in changes {
        assert!(text.contains(old) != tuning.contains(old), "{old}");
        (text, tuning) = (text.replace(old, new), tuning.replace(old, new));
    }
    Vehicle::parse(text, tuning, Path::new("edited.toml")).unwrap()
}

#[test]
fn drag_gusts_a_fifth_more_mass_and_a_hanging_load_are_cancelled() {
    let (with, without) = (patient(), without_observer());
    let plain = Difference::default();
    for (name, airframe, wind_mps) in [
        ("wind of 3 m/s with its gusts", plain, 5.0),
        ("20 % more mass", Difference { mass_kg: Some(1.02), ..plain }, 0.0),
        ("20 % less mass", Difference { mass_kg: Some(0.68), ..plain }, 0.0),
        ("a load of 150 g", Difference { load_kg: Some(0.15), ..plain }, 0.0),
    ] {
        let (level, up) = hold(airframe, wind_mps, &with);
        let (bare_level, bare_up) = hold(airframe, wind_mps, &without);
        println!("{name:30} level {level:.3} (without {bare_level:.3}) m, vertical {up:.3} (without {bare_up:.3}) m");
        assert!(level < 0.15 && up < 0.1, "{name}: {level}, {up} m");
        assert!(level.hypot(up) < 0.5 * bare_level.hypot(bare_up), "{name}: no better than without");
    }
}
