//! Facts about seeded schedules of faults: what holds in all of them, that they are pure functions, and that what fails
//! is found and made small.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use std::path::PathBuf;
use std::process::{Command, Output};

use goshawk_sim::chaos::draw::draw;
use goshawk_sim::chaos::report::Report;
use goshawk_sim::chaos::schedule::{Kind, Schedule, Task};
use goshawk_sim::chaos::shrink::{Shrunk, shrink};
use goshawk_sim::chaos::{Bug, Flown, Hangar, Property, campaign};

const VEHICLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../air/vehicles/sim.toml");

fn hangar(bug: Option<Bug>) -> Hangar {
    Hangar::new(PathBuf::from(VEHICLE), bug).unwrap()
}

/// Schedules of this seed that are flown without a policy's file.
fn navigations(seed: u64, many: usize) -> Vec<Schedule> {
    (0..).map(|index| draw(seed, index)).filter(|s| s.setting.task == Task::Navigate).take(many).collect()
}

fn flown(bug: Option<Bug>, seed: u64, many: usize, threads: usize) -> Vec<(Schedule, Flown)> {
    campaign(&hangar(bug), navigations(seed, many), threads, &|_| {}).unwrap()
}

/// The first schedule in which the bug shows, made small.
fn found(bug: Bug, property: Property) -> Shrunk {
    let flights = flown(Some(bug), 11, 24, 0);
    let fails = |flown: &Flown| flown.violation.as_ref().is_some_and(|violation| violation.property == property);
    let (schedule, flown) = flights.iter().find(|(_, flown)| fails(flown)).expect("the bug is found");
    let hangar = hangar(Some(bug));
    shrink(schedule, flown, property, &|schedule| hangar.fly(schedule)).unwrap()
}

#[test]
fn whatever_goes_wrong_every_property_holds_at_every_step() {
    let flights = flown(None, 21, 60, 0);
    let report = Report::of(21, &flights);
    assert!(report.is_clean(), "{}", report.table());
    assert!(report.steps > 60_000 && report.logs >= 50, "{}", report.table());
    assert!(report.ended.len() >= 3 && report.causes.len() >= 8, "{}", report.table());
}

#[test]
fn a_campaign_is_the_same_for_any_number_of_threads() {
    let (one, three) = (flown(None, 5, 12, 1), flown(None, 5, 12, 3));
    assert_eq!(one, three);
    assert_ne!(Report::of(5, &one).digest, Report::of(5, &flown(None, 6, 12, 3)).digest);
}

#[test]
fn a_vehicle_that_does_not_stop_is_found_and_one_fault_shows_it() {
    let small = found(Bug::DeafToStop, Property::StopObeyed);
    let faults = &small.schedule.faults;
    assert!(faults.len() <= 2 && faults.iter().any(|fault| matches!(fault.what, Kind::Stop(_))), "{faults:?}");
    let sound = hangar(None).fly(&small.schedule).unwrap();
    assert_eq!(sound.violation, None, "without the bug it holds");
}

#[test]
fn a_setpoint_after_the_mode_was_taken_is_found_and_one_fault_shows_it() {
    let small = found(Bug::SetpointAfterAuthority, Property::NothingAfterAuthority);
    let faults = &small.schedule.faults;
    let takes = |kind: &Kind| matches!(kind, Kind::PilotTakesOver | Kind::LandsByItself | Kind::SetpointsLost);
    assert!(faults.len() <= 2 && faults.iter().any(|fault| takes(&fault.what)), "{faults:?}");
    let again: Schedule = small.schedule.line().parse().unwrap();
    assert_eq!(hangar(Some(Bug::SetpointAfterAuthority)).fly(&again).unwrap(), small.flown);
}

#[test]
fn silence_a_wild_tilt_a_wrong_transition_and_a_step_that_is_not_logged_are_each_found() {
    for (bug, property) in [
        (Bug::SilentWhenBlind, Property::NeverSilent),
        (Bug::TiltBeyondLimit, Property::LimitsKept),
        (Bug::UnloggedStep, Property::ReplayExact),
    ] {
        let flights = flown(Some(bug), 13, 10, 0);
        let violations = flights.iter().filter_map(|(_, flown)| flown.violation.as_ref());
        let properties: Vec<Property> = violations.map(|violation| violation.property).collect();
        assert!(properties.contains(&property), "{bug:?}: {properties:?}");
    }
}

fn chaos(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_goshawk-sim"));
    command.args(["chaos", "--vehicle-file", VEHICLE]).args(arguments).output().unwrap()
}

#[test]
fn the_command_exits_with_1_on_a_violation_and_prints_what_flies_it_again() {
    let line = navigations(11, 24).into_iter().find(|s| s.faults.iter().any(|f| f.what == Kind::PilotTakesOver));
    let line = line.unwrap().line();
    let sound = chaos(&["--schedule", &line]);
    assert_eq!(sound.status.code(), Some(0), "{}", String::from_utf8_lossy(&sound.stdout));
    let out = chaos(&["--schedule", &line, "--inject", "setpoint-after-authority"]);
    let text = String::from_utf8_lossy(&out.stdout);
    assert_eq!(out.status.code(), Some(1), "{text}");
    let again = text.lines().find_map(|line| line.trim().strip_prefix("goshawk-sim chaos --inject ")).unwrap();
    let (_, schedule) = again.split_once("--schedule ").unwrap();
    let again =
        chaos(&["--inject", "setpoint-after-authority", "--schedule", schedule.trim_matches('\''), "--no-shrink"]);
    assert_eq!(again.status.code(), Some(1), "{}", String::from_utf8_lossy(&again.stdout));
}

#[test]
fn what_cannot_be_flown_is_refused_in_one_line() {
    for (arguments, word) in [
        (vec!["--schedules", "0"], "nothing to fly"),
        (vec!["--schedule", "{\"seed\":1}"], "missing field"),
        (vec!["--schedule", "no-such-file.json"], "cannot read the schedule"),
    ] {
        let out = chaos(&arguments);
        let text = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(1), "{text}");
        assert!(text.contains(word) && text.trim().lines().count() == 1, "{text}");
    }
}
