//! Facts about seeded schedules of faults: what holds in all of them, that they are pure functions, and that what fails
//! is found and made small.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use std::path::PathBuf;
use std::process::{Command, Output};

use goshawk_sim::commands::chaos::draw::draw;
use goshawk_sim::commands::chaos::report::Report;
use goshawk_sim::commands::chaos::schedule::{Fault, Kind, Odometry, OnStop, Schedule, Setting, Task};
use goshawk_sim::commands::chaos::shrink::{Shrunk, shrink};
use goshawk_sim::commands::chaos::{Bug, Flown, Hangar, Property, Violation, campaign};

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

/// A calm navigation with these faults.
fn plain(faults: Vec<Fault>) -> Schedule {
    let setting = Setting {
        task: Task::Navigate,
        scene: 0,
        on_stop: OnStop::Land,
        odometry: Odometry::Zenoh,
        fence_m: 200.0,
        ceiling_m: 30.0,
        wind_mps: 0.0,
        length_s: 9.0,
    };
    Schedule { seed: 1, setting, faults }
}

/// The first schedule in which the bug shows, made small.
fn found(bug: Bug, property: Property) -> Shrunk {
    let flights = flown(Some(bug), 11, 24, 0);
    let fails = |flown: &Flown| flown.violation.as_ref().is_some_and(|violation| violation.property == property);
    let (schedule, flown) = flights.iter().find(|(_, flown)| fails(flown)).expect("the bug is found");
    let hangar = hangar(Some(bug));
    shrink(schedule, flown, property, &|schedule| hangar.fly(schedule))
}

#[test]
fn whatever_goes_wrong_every_property_holds_at_every_step() {
    let flights = flown(None, 21, 48, 0);
    let report = Report::of(21, &flights);
    assert!(report.is_clean(), "{}", report.table());
    assert!(report.steps > 50_000 && report.logs >= 40, "{}", report.table());
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
fn each_injected_bug_fails_its_property_and_none_fails_without_it() {
    let fault = |at_s, for_s, what| vec![Fault { at_s, for_s, what }];
    for (bug, faults, property) in [
        (Bug::SilentWhenBlind, fault(6.0, 0.6, Kind::OdometryLost), Property::NeverSilent),
        (Bug::TiltBeyondLimit, fault(6.0, 1.0, Kind::FramesLost), Property::LimitsKept),
        (Bug::WrongTransition, fault(6.0, 3.0, Kind::BatteryLow(0.05)), Property::TransitionsOfTheTable),
        (Bug::UnloggedStep, vec![], Property::ReplayExact),
        (Bug::RefusedStart, vec![], Property::RefusedIsRefused),
        (Bug::DeafToStop, fault(6.0, 0.0, Kind::Stop(7)), Property::StopObeyed),
        (Bug::SetpointAfterAuthority, fault(6.0, 0.0, Kind::PilotTakesOver), Property::NothingAfterAuthority),
    ] {
        let schedule = plain(faults);
        assert_eq!(hangar(None).fly(&schedule).unwrap().violation, None, "{bug:?}");
        let violation = hangar(Some(bug)).fly(&schedule).unwrap().violation;
        assert_eq!(violation.map(|violation| violation.property), Some(property), "{bug:?}");
    }
}

#[test]
fn a_chase_inside_a_narrow_fence_is_made_small_though_no_navigation_fits_into_it() {
    let hangar = hangar(None);
    let flown = hangar.fly(&plain(vec![])).unwrap();
    let setting = Setting { task: Task::Track, fence_m: 5.0, ..plain(vec![]).setting };
    let chase = Schedule { setting, ..plain(vec![]) };
    // Fails in a chase inside this fence, and in nothing plainer.
    let fails = |schedule: &Schedule| {
        if schedule.setting.task == Task::Track && schedule.setting.fence_m < 6.0 {
            let violation = Violation { property: Property::LimitsKept, at_s: 0.2, text: String::new() };
            return Ok(Flown { violation: Some(violation), ..flown.clone() });
        }
        hangar.fly(schedule)
    };
    let begun = fails(&chase).unwrap();
    let small = shrink(&chase, &begun, Property::LimitsKept, &fails);
    assert_eq!((small.schedule.setting.task, small.schedule.setting.length_s), (Task::Track, 1.0));
    assert!(Schedule::load(&small.schedule.line()).is_ok());
}

#[test]
fn schedules_are_flown_by_every_shipped_vehicle() {
    for name in ["micro-155", "x500", "ardupilot-sitl"] {
        let hangar = Hangar::new(PathBuf::from(VEHICLE).with_file_name(format!("{name}.toml")), None).unwrap();
        for odometry in [Odometry::Autopilot, Odometry::Zenoh] {
            let setting = Setting { odometry, length_s: 2.0, ..plain(vec![]).setting };
            let flown = hangar.fly(&Schedule { setting, ..plain(vec![]) });
            assert_eq!(flown.unwrap().violation, None, "{name}, {odometry:?}");
        }
    }
}

fn chaos(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_goshawk-sim"));
    command.args(["chaos", "--vehicle-file", VEHICLE]).args(arguments).output().unwrap()
}

#[test]
fn the_command_exits_with_1_on_a_violation_and_prints_what_flies_it_again() {
    let [taken, beside] = [Kind::PilotTakesOver, Kind::FramesTwice].map(|what| Fault { at_s: 6.3, for_s: 0.5, what });
    let line = plain(vec![taken, beside]).line();
    let sound = chaos(&["--schedule", &line]);
    assert_eq!(sound.status.code(), Some(0), "{}", String::from_utf8_lossy(&sound.stdout));
    let out = chaos(&["--schedule", &line, "--inject", "setpoint-after-authority"]);
    let text = String::from_utf8_lossy(&out.stdout);
    assert_eq!(out.status.code(), Some(1), "{text}");
    let again = text.lines().find_map(|line| line.trim().strip_prefix("goshawk-sim chaos --inject ")).unwrap();
    let (options, schedule) = again.split_once("--schedule ").unwrap();
    assert!(options.ends_with(&format!(" --vehicle-file {VEHICLE} ")), "{again}");
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
