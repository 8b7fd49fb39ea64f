//! Flights whose camera or network fails on the way, and flights in which nothing does.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{config, fly, sectors};
use goshawk_core::{Mode, Task};
use goshawk_sim::trial::fault::{CameraFault, NetworkFault};
use goshawk_sim::trial::{Fault, Flight, Outcome, TrialConfig};

/// A fault is named within this, s.
const NAMED_WITHIN_S: f64 = 1.0;
/// The vehicle flies a plan for 0.3 s at most after its frame, and brakes from 4 m/s: so far it goes on, m.
const ROLLS_ON_M: f64 = 6.0;

fn flown_with(fault: Fault, seed: u64) -> Flight {
    fly(&TrialConfig { fault: Some(fault), ..config(Task::Navigate, 4.0, 9.0, seed) }, &mut sectors(false))
}

/// It is named in time by a right name, and the vehicle brakes, holds and lands by itself.
fn assert_noticed(fault: Fault) {
    for seed in [1, 2] {
        let flight = flown_with(fault, seed);
        let begun_s = flight.fault_at_s.unwrap();
        let right = |name: &str| fault.noticed_as().contains(&name);
        let named = flight.named.iter().find(|(_, name)| right(name));
        let after_s = named.unwrap_or_else(|| panic!("{fault} is not named: {:?}", flight.named)).0 - begun_s;
        assert!((0.0..=NAMED_WITHIN_S).contains(&after_s), "{fault} is named after {after_s} s");
        assert!(flight.named.iter().all(|(at, _)| *at >= begun_s), "{fault}: {:?}", flight.named);
        assert_eq!((flight.outcome, flight.contact), (Outcome::Success, None), "{fault}: {:?}", flight.modes);
        let last: Vec<Mode> = flight.modes.iter().rev().take(2).map(|(_, to, _)| *to).collect();
        assert_eq!(last, [Mode::Landed, Mode::Stopping], "{fault}");
    }
}

#[test]
fn a_frozen_camera_is_named_within_a_second_and_the_vehicle_brakes_and_lands() {
    assert_noticed(Fault::Camera(CameraFault::Frozen));
}

#[test]
fn a_blank_or_noisy_camera_is_named_within_a_second_and_the_vehicle_brakes_and_lands() {
    assert_noticed(Fault::Camera(CameraFault::Blank));
    assert_noticed(Fault::Camera(CameraFault::Noise));
}

#[test]
fn one_depth_everywhere_is_named_within_a_second_and_the_vehicle_brakes_and_lands() {
    assert_noticed(Fault::Camera(CameraFault::Near));
    assert_noticed(Fault::Camera(CameraFault::Far));
}

#[test]
fn a_slow_camera_or_a_second_one_is_named_within_a_second_and_the_vehicle_brakes_and_lands() {
    assert_noticed(Fault::Camera(CameraFault::Slow));
    assert_noticed(Fault::Camera(CameraFault::Two));
}

#[test]
fn a_network_that_answers_no_numbers_is_named_and_not_flown() {
    assert_noticed(Fault::Network(NetworkFault::Nan));
    assert_noticed(Fault::Network(NetworkFault::Infinite));
}

#[test]
fn a_network_that_always_answers_the_same_is_named_and_not_flown() {
    assert_noticed(Fault::Network(NetworkFault::Zero));
    assert_noticed(Fault::Network(NetworkFault::Random));
}

#[test]
fn after_a_fault_the_vehicle_does_not_go_on() {
    let fault = Fault::Camera(CameraFault::Frozen);
    let config = TrialConfig { fault: Some(fault), ..config(Task::Navigate, 4.0, 9.0, 3) };
    let flight = fly(&config, &mut sectors(false));
    // The task is flown for the onset's time at 4 m/s at most.
    let way_m = flight.metrics.way_m;
    assert!(way_m < 4.0 * fault.onset_s(3) + ROLLS_ON_M + 3.0, "{way_m} m");
}

#[test]
fn in_flights_without_a_fault_none_is_named_in_wind_near_trees_and_in_buildings() {
    let forest = config(Task::Navigate, 4.0, 6.0, 5);
    let buildings = TrialConfig { world: goshawk_sim::trial::WorldSource::Buildings, ..forest.clone() };
    let windy = TrialConfig { wind_mps: 5.0, ..forest.clone() };
    for config in [forest, buildings, windy] {
        let flight = fly(&config, &mut sectors(false));
        assert_eq!((flight.named, flight.fault_at_s), (vec![], None));
    }
}

#[test]
fn a_flight_with_a_fault_is_the_same_again() {
    let fault = Fault::Camera(CameraFault::Noise);
    let once = flown_with(fault, 4);
    let again = flown_with(fault, 4);
    assert_eq!((once.named, once.end_world, once.flown_s), (again.named, again.end_world, again.flown_s));
}
