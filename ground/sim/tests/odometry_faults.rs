//! An estimator that errs in flight: the vehicle names it within a second, touches nothing, and ends as the ladder says.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{config, fly, sectors};
use goshawk_core::{Cause, Mode, OdometryFault, Task};
use goshawk_sim::trial::fault::OdometryError;
use goshawk_sim::trial::{Fault, Flight, Outcome, TrialConfig};

/// A navigation at 5 m/s among few trees, in which the odometry errs.
fn erring(error: OdometryError, seed: u64) -> TrialConfig {
    TrialConfig { fault: Some(Fault::Odometry(error)), ..config(Task::Navigate, 5.0, 12.0, seed) }
}

/// Six flights with the error.
fn flights(error: OdometryError) -> impl Iterator<Item = Flight> {
    (1..7).map(move |seed| fly(&erring(error, seed), &mut sectors(false)))
}

/// The name and how long it took, s.
fn first_name(flight: &Flight) -> (&'static str, f64) {
    let begun = flight.fault_at_s.unwrap();
    let &(at, name) = flight.named.iter().find(|(at, _)| *at >= begun).expect("it is named");
    (name, at - begun)
}

/// Named so within this, and handed back after 1.5 s more, with nothing touched.
fn is_handed_back(error: OdometryError, fault: OdometryFault, within_s: f64) {
    for flight in flights(error) {
        let (name, after) = first_name(&flight);
        assert_eq!(name, fault.name());
        assert!(after < within_s, "{name} after {after} s");
        assert_eq!((flight.outcome, flight.contact), (Outcome::Success, None));
        let &(at, mode, cause) = flight.modes.last().unwrap();
        assert_eq!((mode, cause), (Mode::Fault, Cause::OdometryFalse));
        let given = at - flight.fault_at_s.unwrap() - after;
        assert!((1.4..1.6).contains(&given), "{given} s later");
    }
}

#[test]
fn a_velocity_3_mps_off_is_handed_back() {
    is_handed_back(OdometryError::Velocity, OdometryFault::VelocityStepped, 0.1);
}

#[test]
fn a_drift_of_1_mps_is_handed_back() {
    is_handed_back(OdometryError::Drift, OdometryFault::PositionDisagrees, 1.0);
}

#[test]
fn a_heading_turned_about_is_handed_back() {
    is_handed_back(OdometryError::Heading, OdometryFault::AttitudeTurned, 0.1);
}

#[test]
fn an_estimate_that_stands_still_is_handed_back() {
    is_handed_back(OdometryError::VelocityFrozen, OdometryFault::Frozen, 1.0);
}

#[test]
fn an_estimate_of_which_nothing_lives_and_a_heading_turned_about_touch_nothing() {
    for error in [OdometryError::Frozen, OdometryError::Heading] {
        for flight in flights(error) {
            let (_, after) = first_name(&flight);
            assert!(after < 0.2, "after {after} s");
            assert_eq!((flight.outcome, flight.contact), (Outcome::Success, None));
            assert_eq!(flight.modes.last().map(|m| (m.1, m.2)), Some((Mode::Fault, Cause::OdometryFalse)));
        }
    }
}

#[test]
fn jumps_of_5_m_and_of_1_m_in_height_are_named_and_flown_on() {
    for error in [OdometryError::Jump, OdometryError::Height] {
        for flight in flights(error) {
            let (name, after) = first_name(&flight);
            assert!(name == OdometryFault::PositionJumped.name() && after < 0.1, "{name} after {after} s");
            assert!(flight.contact.is_none(), "{:?}", flight.contact);
            assert!(flight.modes.iter().all(|(_, _, cause)| *cause != Cause::OdometryFalse));
        }
    }
}

#[test]
fn a_heading_that_was_wrong_from_the_start_is_handed_back_at_the_take_off() {
    for flight in flights(OdometryError::HeadingFromStart) {
        assert_eq!(first_name(&flight).0, OdometryFault::HeadingDisagrees.name());
        assert_eq!(flight.modes.last().map(|m| (m.1, m.2)), Some((Mode::Fault, Cause::OdometryFalse)));
        // Of its way only the take-off has been flown.
        assert!(flight.contact.is_none() && flight.flown_s < 10.0, "{} s", flight.flown_s);
    }
}

#[test]
fn jumps_that_the_estimator_announces_are_no_fault() {
    for seed in 1..5 {
        let mut config = config(Task::Navigate, 5.0, 12.0, seed);
        (config.sensors.odometry.jump_every_s, config.sensors.odometry.jump_m) = (1.0, 2.0);
        let flight = fly(&config, &mut sectors(false));
        assert!(flight.named.is_empty(), "{:?}", flight.named);
    }
}

#[test]
fn gusts_and_an_airframe_a_fifth_off_are_no_fault() {
    for seed in 1..9 {
        let mut config = TrialConfig { wind_mps: 5.0, ..config(Task::Navigate, 7.0, 6.0, seed) };
        (config.airframe.spread, config.airframe.attitude_lag_s) = (0.2, Some(0.2));
        let flight = fly(&config, &mut sectors(false));
        assert!(flight.named.is_empty(), "{:?}", flight.named);
    }
}
