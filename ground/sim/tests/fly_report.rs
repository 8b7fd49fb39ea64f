//! Facts about a campaign's JSON, and about flying single flights of a campaign again.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use goshawk_core::{ANCHORS, MAX_CHANNELS, NetworkOutput, Task};
use goshawk_policy::{Contract, PolicyError};
use goshawk_sim::actors::evader::Course;
use goshawk_sim::fly::failures::failures;
use goshawk_sim::fly::report::Report;
use goshawk_sim::fly::{Campaign, CampaignError, Pick, table};
use goshawk_sim::sense::file::Sensors;
use goshawk_sim::trial::{Difference, Network, PilotKind, WorldSource};
use goshawk_vehicle::config::Vehicle;
use serde_json::Value;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

fn vehicle() -> Vehicle {
    Vehicle::load(&Path::new(ROOT).join("air/vehicles/sim.toml")).unwrap()
}

/// Sees nobody, and flies straight for the goal if it has one.
struct Straight(Contract);

impl Straight {
    fn new(task: Task) -> Self {
        let (task, channels) = match task {
            Task::Track => ("track", r#","objectness","du","dv","distance""#),
            Task::Navigate => ("navigate", ""),
        };
        let json = format!(
            r#"{{"version":2,"task":"{task}","image":{{"width":160,"height":96,"hfov_rad":1.5707963,
            "vfov_rad":1.0808390}},"depth":{{"min_m":0.2,"max_m":20.0,"fill_passes":2}},"lattice":{{"rows":3,
            "columns":5,"radius_m":5.0,"elevation_offset_rad":0.2618,"azimuth_offset_rad":0.2618}},"v_max_mps":6.0,
            "a_max_mps2":6.0,"duration_rule":"2r/(alpha*v_max)","target_depth_scale_m":5.0,"cost_scale":6.0,
            "state":["velocity","acceleration","up","aim","agility"],"channels":["theta","phi","r","vx","vy","vz","ax","ay",
            "az","cost"{channels}],"camera_tilt_rad":0.17,"training":{{}}}}"#
        );
        Self(Contract::from_json(&json).unwrap())
    }
}

impl Network for Straight {
    fn contract(&self) -> &Contract {
        &self.0
    }

    fn infer(&mut self, _rgbd: &[f32], state: &[f32]) -> Result<NetworkOutput, PolicyError> {
        let mut values = [-9.0f32; MAX_CHANNELS * ANCHORS];
        values[..9 * ANCHORS].fill(0.0);
        values[9 * ANCHORS..10 * ANCHORS].fill(50.0);
        let azimuth = state[10].atan2(state[9]);
        for column in 0..5 {
            let of_column = std::f32::consts::FRAC_PI_2 * (0.5 - (column as f32 + 0.5) / 5.0);
            values[9 * ANCHORS + 5 + column] = (of_column - azimuth).abs();
        }
        Ok(NetworkOutput { values })
    }
}

fn campaign(task: Task) -> Campaign {
    Campaign {
        pilot: PilotKind::Policy,
        task,
        speeds_mps: vec![4.0, 6.0],
        worlds: vec![WorldSource::Forest { spacing_m: 7.0 }],
        courses: vec![Course::Goal],
        sensors: Sensors::default(),
        airframe: Difference::default(),
        moving: 0,
        fault: None,
        trials: 2,
        seed: 5,
        wind_mps: 0.0,
        speed_margin_mps: 3.0,
        height_m: 1.5,
        threads: 2,
        only: None,
        traced: true,
        log: None,
    }
}

fn fly(campaign: &Campaign) -> Result<Report, CampaignError> {
    let task = campaign.task;
    campaign.run(&vehicle(), &|| Ok(Some(Box::new(Straight::new(task)))), &|_| {})
}

fn names(folder: &Path) -> BTreeSet<String> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// The JSON, read back.
fn read(report: &Report) -> Value {
    serde_json::from_slice(&report.to_json()).unwrap()
}

fn length(value: &Value) -> usize {
    value.as_array().unwrap().len()
}

#[test]
fn the_json_of_a_chase_has_a_path_for_each_flight_with_columns_of_one_length() {
    let report = fly(&campaign(Task::Track)).unwrap();
    let json = read(&report);
    let paths = json["paths"].as_array().unwrap();
    let picks: Vec<_> = paths.iter().map(|p| (p["cell"].as_u64().unwrap(), p["trial"].as_u64().unwrap())).collect();
    assert_eq!(picks, [(0, 0), (0, 1), (1, 0), (1, 1)]);
    for path in paths {
        let samples = length(&path["pos_m"]);
        assert!(samples > 5);
        for column in ["speed_mps", "clearance_m"] {
            assert_eq!(length(&path[column]), samples, "{column}");
        }
        for column in ["pos_m", "pixel", "visible"] {
            assert_eq!(length(&path["target"][column]), samples, "target {column}");
        }
        assert!(path["map"]["goal_m"].is_null() && length(&path["map"]["solids"]) > 0);
    }
    assert_eq!(json["image_px"], serde_json::json!([160, 96]));
    assert_eq!(length(&json["cells"]), 2);
}

#[test]
fn a_path_is_one_line_of_the_json() {
    let text = String::from_utf8(fly(&campaign(Task::Navigate)).unwrap().to_json()).unwrap();
    assert_eq!(text.lines().filter(|line| line.starts_with("{\"cell\":")).count(), 4);
    assert_eq!(text.lines().filter(|line| line.contains("pos_m\":[[")).count(), 4);
}

#[test]
fn the_json_is_the_same_for_any_number_of_threads_but_for_the_timing() {
    let json = |threads| {
        let mut json = read(&fly(&Campaign { threads, ..campaign(Task::Track) }).unwrap());
        json["timing"].take();
        json
    };
    assert_eq!(json(1), json(3));
}

#[test]
fn a_navigation_has_a_goal_and_obstacles_but_no_target() {
    let json = read(&fly(&campaign(Task::Navigate)).unwrap());
    assert_eq!(length(&json["paths"]), 4);
    for path in json["paths"].as_array().unwrap() {
        assert!(path["target"].is_null());
        assert_eq!(length(&path["map"]["goal_m"]), 2);
        assert!(length(&path["map"]["solids"]) > 0);
    }
}

#[test]
fn a_map_shows_each_moving_obstacles_way_and_the_words_say_how_many() {
    let report = fly(&Campaign { moving: 3, ..campaign(Task::Navigate) }).unwrap();
    let json = read(&report);
    assert_eq!(length(&json["paths"][0]["map"]["movers"]), 3);
    assert!(table(&report).contains("7 m, 3 moving"));
}

#[test]
fn a_single_flight_is_the_same_as_in_the_whole_campaign() {
    let whole = fly(&campaign(Task::Navigate)).unwrap();
    let picks = vec![Pick { cell: 1, trial: 1 }, Pick { cell: 0, trial: 1 }, Pick { cell: 1, trial: 1 }];
    let few = fly(&Campaign { only: Some(picks), threads: 1, ..campaign(Task::Navigate) }).unwrap();
    assert_eq!(few.flown, [vec![whole.flown[0][1].clone()], vec![whole.flown[1][1].clone()]]);
    assert_eq!(few.cells.iter().map(|cell| (cell.cell, cell.trials)).collect::<Vec<_>>(), [(0, 1), (1, 1)]);
    assert_eq!(few.cells[1].flights[0].trial, 1);
}

#[test]
fn what_a_path_costs_is_bounded_and_the_flight_does_not_notice_it() {
    let traced = fly(&campaign(Task::Navigate)).unwrap();
    let plain = fly(&Campaign { traced: false, ..campaign(Task::Navigate) }).unwrap();
    assert_eq!(serde_json::to_string(&traced.cells).unwrap(), serde_json::to_string(&plain.cells).unwrap());
    assert_eq!(read(&plain)["paths"], serde_json::json!([]));
    let lengths = traced.flown.iter().flatten().map(|flown| flown.path.as_ref().unwrap().pos_m.len());
    assert!(lengths.clone().all(|n| n < goshawk_sim::fly::trace::MOST_SAMPLES) && lengths.sum::<usize>() > 20);
}

#[test]
fn failed_flights_are_named_by_class_with_a_command_that_flies_one_again() {
    let command = "goshawk-sim fly --task track".to_owned();
    let text = failures(&Report { command, ..fly(&campaign(Task::Track)).unwrap() });
    let lines: Vec<&str> = text.lines().collect();
    let again = "re-fly one: goshawk-sim fly --task track --only 0:0 --log flight-0-0";
    assert_eq!(lines, ["", "failed: lost 0:0,0:1,1:0,1:1", again]);
}

#[test]
fn a_flight_that_there_is_not_is_refused_in_one_line() {
    let only = Some(vec![Pick { cell: 2, trial: 0 }]);
    let error = fly(&Campaign { only, ..campaign(Task::Track) }).unwrap_err().to_string();
    assert!(error.contains("no flight 2:0") && error.contains("0 to 1"), "{error}");

    let command = |only: &str| {
        let arguments = ["fly", "--task", "track", "--speed", "3,5", "--trials", "4", "--only", only];
        Command::new(env!("CARGO_BIN_EXE_goshawk-sim")).args(arguments).current_dir(ROOT).output().unwrap()
    };
    for (only, status) in [("2:0", 1), ("0:4", 1), ("4", 2)] {
        let output = command(only);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(status), "{said}");
        let lines: Vec<&str> = said.lines().filter(|line| !line.is_empty() && !line.contains("--help")).collect();
        assert_eq!(lines.len(), 1, "{said}");
        assert!(lines[0].starts_with("error: ") && lines[0].contains(only), "{said}");
    }
}

#[test]
fn an_interrupt_ends_a_campaign_at_once_and_leaves_only_whole_files() {
    let folder = tempfile::tempdir().unwrap();
    let (logs, json) = (folder.path().join("logs"), folder.path().join("out.json"));
    let mut campaign = Command::new(env!("CARGO_BIN_EXE_goshawk-sim"))
        .args(["fly", "--task", "track", "--speed", "3", "--trials", "500", "--threads", "1"])
        .args([Path::new("--log"), &logs, Path::new("--json"), &json])
        .current_dir(ROOT)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It flies once a log has begun.
    while !logs.is_dir() || names(&logs).is_empty() {
        assert!(campaign.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::yield_now();
    }
    assert!(Command::new("kill").args(["-INT", &campaign.id().to_string()]).status().unwrap().success());
    let output = campaign.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(130), "{said}");
    assert!(said.trim_end().ends_with("of 500 flights were flown"), "{said}");
    assert_eq!(names(folder.path()), BTreeSet::from(["logs".to_owned()]));
    assert!(names(&logs).iter().all(|name| name.ends_with(".mcap") && !name.starts_with('.')));
}
