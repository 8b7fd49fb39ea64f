//! Whole flights of the classical pilot.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use goshawk_core::Task;
use goshawk_sim::actors::evader::Course;
use goshawk_sim::pilots::fly_trial;
use goshawk_sim::sense::file::Sensors;
use goshawk_sim::trial::{
    Difference, EvaderKind, Flight, Outcome, PilotKind, TrialConfig, TrialError, Unwatched, WorldSource,
};
use goshawk_vehicle::config::Vehicle;
use std::path::Path;

fn fly(task: Task) -> Result<Flight, TrialError> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../air/vehicles/sim.toml");
    let config = TrialConfig {
        pilot: PilotKind::Classical,
        task,
        speed_mps: 3.0,
        speed_margin_mps: 3.0,
        height_m: 1.5,
        world: WorldSource::Forest { spacing_m: 6.0 },
        evader: EvaderKind::Planned,
        course: Course::Goal,
        length_m: 40.0,
        wind_mps: 1.0,
        sensors: Sensors::default(),
        airframe: Difference::default(),
        moving: 0,
        fault: None,
        firmware: None,
        seed: 2,
    };
    fly_trial(&config, &Vehicle::load(&file).unwrap(), None, &mut Unwatched)
}

#[test]
fn the_classical_pilot_reaches_the_goal_without_a_policy_and_always_in_the_same_way() {
    let flight = fly(Task::Navigate).unwrap();
    assert_eq!(flight.outcome, Outcome::Success, "{flight:?}");
    assert!(flight.metrics.clearance_m.unwrap() > 0.2, "{flight:?}");
    assert!((2.0..4.0).contains(&flight.metrics.speed_max_mps), "{}", flight.metrics.speed_max_mps);
    assert_eq!(flight, fly(Task::Navigate).unwrap());
}

#[test]
fn without_a_policy_nobody_sees_the_target() {
    assert!(matches!(fly(Task::Track), Err(TrialError::NoPolicy)));
}
