//! What `goshawk-sim` cannot do it refuses in one line that says what to change, before it flies anything.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

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
