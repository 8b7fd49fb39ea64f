//! What `goshawk-sim` cannot do it refuses in one line that says what to change, before it flies anything.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

fn sim(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_goshawk-sim")).args(arguments).current_dir(ROOT).output().unwrap()
}

/// The one line that the command ends with, less what clap adds; its status is `status`.
fn refused(arguments: &[&str], status: i32) -> String {
    let output = sim(arguments);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(status), "{arguments:?}: {said}");
    let lines: Vec<&str> = said.lines().filter(|line| !line.is_empty() && !line.contains("--help")).collect();
    assert_eq!(lines.len(), 1, "{arguments:?}: {said}");
    assert!(lines[0].starts_with("error: "), "{said}");
    lines[0].to_owned()
}

/// A flight without a policy.
const NAVIGATE: [&str; 5] = ["fly", "--task", "navigate", "--pilot", "classical"];

fn navigate(more: &[&str], status: i32) -> String {
    refused(&[&NAVIGATE[..], &["--trials", "1"], more].concat(), status)
}

#[test]
fn a_start_beyond_the_vehicles_limits_is_an_error_that_names_the_limit() {
    let track = ["fly", "--task", "track", "--trials", "1", "--seed", "1", "--speed"];
    for (speed, height, limit) in [("25", "2", "max_speed_mps"), ("20", "2", "max_speed_mps"), ("3", "31", "ceiling_m")]
    {
        let said = refused(&[&track[..], &[speed, "--height", height]].concat(), 1);
        assert!(said.contains("refused to start") && said.contains(&format!("limits.{limit}")), "{said}");
    }
    // Before the first flight, whatever cell it is of.
    let folder = tempfile::tempdir().unwrap();
    let logs = folder.path().join("logs");
    navigate(&["--speed", "4,25", "--log", logs.to_str().unwrap()], 1);
    assert_eq!(fs::read_dir(logs).unwrap().count(), 0);
}

#[test]
fn numbers_outside_their_range_are_refused_with_it() {
    for (arguments, range) in [
        (&["--speed", "4", "--spacing", "1e300"], "1 to 1000 m"),
        (&["--speed", "4", "--spacing", "0.5"], "1 to 1000 m"),
        (&["--speed", "4", "--wind", "1e6"], "0 to 30 m/s"),
        (&["--speed", "4", "--wind", "-1"], "0 to 30 m/s"),
    ] {
        let said = navigate(arguments, 2);
        assert!(said.contains(range), "{said}");
    }
    for speed in ["nan", "inf", "0"] {
        assert!(refused(&["faults", "--speed", speed], 2).contains("is not above 0"));
    }
    for command in ["faults", "world", "serve"] {
        assert!(refused(&[command, "--spacing", "1e300"], 2).contains("1 to 1000 m"));
    }
}

#[test]
fn files_that_cannot_be_written_are_refused_before_the_first_flight() {
    let folder = tempfile::tempdir().unwrap();
    let (dir, file) = (folder.path().to_str().unwrap(), folder.path().join("out"));
    let file = file.to_str().unwrap();
    // As many flights would take longer than anyone waits.
    let many = |more: &[&str]| refused(&[&NAVIGATE[..], &["--speed", "4", "--trials", "100000"], more].concat(), 1);
    for option in ["--json", "--records"] {
        let said = many(&[option, dir]);
        assert!(said.contains(dir) && said.contains("directory"), "{said}");
    }
    let beside = Path::new(dir).join(".").join("out");
    assert!(many(&["--json", file, "--records", beside.to_str().unwrap()]).contains("a file of its own"));
    assert_eq!(fs::read_dir(dir).unwrap().count(), 0);
}

#[test]
fn a_waypoint_outside_the_world_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let course = folder.path().join("mine.csv");
    fs::write(&course, "x,y\n10,0\n500,0\n20,3\n").unwrap();
    let said =
        refused(&["fly", "--task", "track", "--speed", "3", "--trials", "1", "--course", course.to_str().unwrap()], 1);
    assert!(said.contains("course mine: waypoint 2 lies in an obstacle or outside the world"), "{said}");
}

#[test]
fn courses_in_files_of_one_name_have_a_log_each() {
    let folder = tempfile::tempdir().unwrap();
    let files = ["one", "two"].map(|name| {
        fs::create_dir(folder.path().join(name)).unwrap();
        let file = folder.path().join(name).join("mine.csv");
        fs::write(&file, "x,y\n10,0\n14,2\n").unwrap();
        file.to_str().unwrap().to_owned()
    });
    let logs = folder.path().join("logs");
    let arguments = ["fly", "--task", "track", "--speed", "3", "--trials", "1", "--course", &files.join(",")];
    let again = [&arguments[..], &["--log", logs.to_str().unwrap()]].concat();
    assert!(sim(&again).status.success());
    let mut names: Vec<_> =
        fs::read_dir(&logs).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["track-3mps-4m-mine-cell0-000.mcap", "track-3mps-4m-mine-cell1-000.mcap"]);
    // And none is flown into a folder where one of its logs is already.
    fs::remove_file(logs.join(&names[0])).unwrap();
    assert!(refused(&again, 1).contains("there is one already"));
    assert_eq!(fs::read_dir(&logs).unwrap().count(), 1);
}

#[test]
fn records_of_another_world_or_course_in_a_file_of_the_same_name_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (scan, course, records) = (at("scan.ply"), at("mine.csv"), at("records"));
    let world =
        |seed: &str| assert!(sim(&["world", "--seed", seed, "-o", &at("w.png"), "--scan", &scan]).status.success());
    let line = |points: &str| fs::write(&course, points).unwrap();
    world("4");
    line("x,y\n10,0\n14,2\n");
    let clouds = [&NAVIGATE[..], &["--speed", "4", "--trials", "1", "--world", &scan]].concat();
    let courses = ["fly", "--task", "track", "--speed", "3", "--trials", "1", "--course", &course];
    for (flown, change) in [(&clouds[..], &(|| world("5")) as &dyn Fn()), (&courses, &|| line("x,y\n10,0\n14,3\n"))] {
        let with = |option: &'static str| [flown, &[option, &records]].concat();
        assert!(sim(&with("--records")).status.success());
        assert!(sim(&with("--from")).status.success());
        assert!(refused(&[&with("--from")[..], &["--json", &records]].concat(), 1).contains("overwrite"));
        change();
        let said = refused(&with("--from"), 1);
        assert!(said.contains("flight 0:0 was flown with another conditions_sha256"), "{said}");
    }
}

#[test]
fn a_world_says_at_once_where_it_cannot_write() {
    let folder = tempfile::tempdir().unwrap();
    let (dir, picture) = (folder.path().to_str().unwrap(), folder.path().join("w.png"));
    let picture = picture.to_str().unwrap();
    for arguments in [["-o", picture, "--scan", dir], ["-o", dir, "--seed", "1"], ["-o", picture, "--scan", picture]] {
        let said = refused(&[&["world"], &arguments[..]].concat(), 1);
        assert!(said.contains("cannot write"), "{said}");
    }
    assert_eq!(fs::read_dir(dir).unwrap().count(), 0);
}

#[test]
fn a_reader_that_has_seen_enough_ends_the_command_without_a_panic() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_goshawk-sim"));
    command.args(["chaos", "--print", "--schedules", "100000"]).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.signal(), String::from_utf8(output.stderr).unwrap().as_str()), (Some(13), ""));
}
