//! The policies that are shipped still fly: a small campaign of each, judged against what large ones measured.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use std::process::Command;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
const FLIGHTS: u32 = 20;
/// How often a policy as good as measured may miss the bar by luck. The flights are the same in each run, so luck is
/// drawn anew only by what changes them.
const LUCK: f64 = 1e-4;

/// The most successes that fewer are rarer than [`LUCK`], where each flight succeeds with probability `share`.
fn bar(share: f64) -> u32 {
    let mut exactly = (1.0 - share).powi(FLIGHTS as i32);
    let mut at_most = exactly;
    let mut successes = 0;
    while at_most < LUCK {
        exactly *= f64::from(FLIGHTS - successes) / f64::from(successes + 1) * share / (1.0 - share);
        successes += 1;
        at_most += exactly;
    }
    successes
}

/// How many of the flights of the shipped policy succeed; `more`: further options.
fn successes(task: &str, speed: &str, more: &[&str]) -> u64 {
    let folder = tempfile::tempdir().unwrap();
    let json = folder.path().join("flights.json");
    let fly = ["fly", "--task", task, "--speed", speed, "--trials", &FLIGHTS.to_string(), "--seed", "900", "--json"];
    let mut command = Command::new(env!("CARGO_BIN_EXE_goshawk-sim"));
    let output = command.args(fly).arg(&json).args(more).current_dir(ROOT).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    println!("{}", String::from_utf8_lossy(&output.stdout));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    assert_eq!(report["cells"][0]["trials"], FLIGHTS);
    report["cells"][0]["successes"].as_u64().unwrap()
}

#[test]
fn the_bar_is_the_binomial_distributions() {
    assert_eq!([0.5, 0.95, 0.98].map(bar), [2, 14, 16]);
}

#[test]
fn the_tracker_succeeds_as_often_as_measured() {
    // Measured: 100 of 100, and 58 of 60 that also keep the target in view for nine tenths of the time.
    let (flown, bar) = (successes("track", "4", &[]), bar(0.95));
    assert!(flown >= u64::from(bar), "{flown} of {FLIGHTS}, at least {bar}");
}

#[test]
fn the_navigator_succeeds_as_often_as_measured() {
    // Measured: 99 of 100.
    let (flown, bar) = (successes("navigate", "6", &[]), bar(0.98));
    assert!(flown >= u64::from(bar), "{flown} of {FLIGHTS}, at least {bar}");
}

#[test]
fn the_x500_chases_by_what_a_d435_sees() {
    // Measured: 18 and 16 of 20, before and since braking counts on no more than the tilt gives.
    let camera = ["--vehicle-file", "air/vehicles/x500.toml", "--sensors", "ground/sim/sensors/d435.toml"];
    let (flown, bar) = (successes("track", "2", &camera), bar(0.85));
    assert!(flown >= u64::from(bar), "{flown} of {FLIGHTS}, at least {bar}");
}
