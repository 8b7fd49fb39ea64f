//! Facts about a campaign's JSON, and about flying single flights of a campaign again.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use goshawk_core::{ANCHORS, MAX_CHANNELS, NetworkOutput, Task};
use goshawk_policy::{Contract, PolicyError};
use goshawk_sim::actors::evader::Course;
use goshawk_sim::commands::fly::failures::failures;
use goshawk_sim::commands::fly::records::Known;
use goshawk_sim::commands::fly::report::Report;
use goshawk_sim::commands::fly::report::stats::quantile;
use goshawk_sim::commands::fly::{Campaign, CampaignError, Pick, table};
use goshawk_sim::seeds::Identity;
use goshawk_sim::sense::file::Sensors;
use goshawk_sim::trial::{Difference, EvaderKind, Network, PilotKind, TrialError, WorldSource};
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
        pilots: vec![PilotKind::Policy],
        task,
        speeds_mps: vec![4.0, 6.0],
        worlds: vec![WorldSource::Forest { spacing_m: 7.0 }],
        evader: EvaderKind::Planned,
        courses: vec![Course::Goal],
        length_m: 40.0,
        sensors: Sensors::default(),
        airframe: Difference::default(),
        moving: 0,
        fault: None,
        firmware: None,
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

/// The records of some flights of a campaign, flown by themselves.
fn records(of: &Campaign, only: &[&str]) -> Vec<u8> {
    let picks = only.iter().map(|pick| pick.parse().unwrap()).collect();
    let part = Campaign { only: Some(picks), traced: false, threads: 1, ..of.clone() };
    part.records(&fly(&part).unwrap())
}

fn gather(of: &Campaign, lines: &[u8]) -> Result<Report, CampaignError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("records");
    fs::write(&path, lines).unwrap();
    of.gather(&vehicle(), &Identity::new(&vehicle(), None), Known::read(&path)?)
}

#[test]
fn the_cells_of_parts_flown_apart_are_those_of_the_whole_to_the_last_bit() {
    for whole in [campaign(Task::Track), campaign(Task::Navigate)] {
        let lines = [records(&whole, &["1:1", "0:1"]), records(&whole, &["1:0"]), records(&whole, &["0:0"])].concat();
        let cells = |report: &Report| serde_json::to_string(&report.cells).unwrap();
        assert_eq!(cells(&gather(&whole, &lines).unwrap()), cells(&fly(&whole).unwrap()));
    }
}

#[test]
fn a_flight_that_is_missing_twice_there_or_another_campaigns_is_refused_in_words_that_say_which() {
    let whole = Campaign { speeds_mps: vec![4.0], ..campaign(Task::Navigate) };
    let (one, two) = (records(&whole, &["0:0"]), records(&whole, &["0:1"]));
    let refused = |of: &Campaign, lines: &[&[u8]]| gather(of, &lines.concat()).unwrap_err().to_string();
    assert!(refused(&whole, &[&one]).contains("flight 0:1 is not there"));
    assert!(refused(&whole, &[&one, &two, &one]).contains("line 3: flight 0:0 stands there twice"));
    assert!(refused(&whole, &[&one, b"{}\n"]).contains("line 2"));
    for (other, what) in [
        (Campaign { seed: 6, ..whole.clone() }, "another seed"),
        (Campaign { wind_mps: 1.0, ..whole.clone() }, "another wind_mps"),
        (Campaign { height_m: 2.0, ..whole.clone() }, "another conditions_sha256"),
    ] {
        let words = refused(&other, &[&one, &two]);
        assert!(words.contains("flight 0:0 was flown with") && words.contains(what), "{words}");
    }
}

#[test]
fn flights_before_one_that_cannot_be_flown_are_kept_and_are_those_of_the_whole() {
    let of = Campaign { trials: 6, traced: false, ..campaign(Task::Navigate) };
    let (made, flown) = (AtomicUsize::new(0), AtomicUsize::new(0));
    // The second thread's network cannot be had once the first thread has flown.
    let make = || {
        if made.fetch_add(1, Ordering::Relaxed) == 0 {
            return Ok(Some(Box::new(Straight::new(of.task)) as Box<dyn Network + Send>));
        }
        while flown.load(Ordering::Relaxed) == 0 {
            std::thread::sleep(Duration::from_millis(1));
        }
        Err(TrialError::NoPolicy)
    };
    let cut = of.run(&vehicle(), &make, &|_| {
        flown.fetch_add(1, Ordering::Relaxed);
    });
    let Err(CampaignError::Cut { flights, all: 12, flown: kept, why }) = cut else { panic!("it was flown") };
    assert!((1..12).contains(&flights) && flights == flown.load(Ordering::Relaxed));
    assert!(matches!(*why, CampaignError::Network(_)));
    let whole = of.records(&fly(&of).unwrap());
    let lines = |records: &[u8]| String::from_utf8(records.to_vec()).unwrap().lines().map(str::to_owned).collect();
    let (kept, whole): (BTreeSet<String>, BTreeSet<String>) = (lines(&of.records(&kept)), lines(&whole));
    assert!(kept.len() == flights && kept.is_subset(&whole));
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
fn several_pilots_fly_the_same_seeds_side_by_side_each_as_alone() {
    let of = |pilots| Campaign { pilots, speeds_mps: vec![4.0], traced: false, ..campaign(Task::Navigate) };
    let both = fly(&of(vec![PilotKind::Policy, PilotKind::Classical])).unwrap();
    assert_eq!(both.cells.iter().map(|cell| cell.pilot).collect::<Vec<_>>(), ["policy", "classical"]);
    let seeds = |cell: usize| both.flown[cell].iter().map(|flown| flown.config.seed).collect::<Vec<_>>();
    assert_eq!(seeds(0), seeds(1));
    for (cell, pilot) in [PilotKind::Policy, PilotKind::Classical].into_iter().enumerate() {
        let alone = fly(&of(vec![pilot])).unwrap();
        let flights =
            |report: &Report, cell: usize| report.flown[cell].iter().map(|f| f.flight.clone()).collect::<Vec<_>>();
        assert_eq!(flights(&both, cell), flights(&alone, 0));
    }
}

#[test]
fn a_cell_says_what_was_asked_what_was_flown_and_what_was_reached() {
    let pilots = vec![PilotKind::Classical];
    let report = fly(&Campaign { pilots, traced: false, ..campaign(Task::Navigate) }).unwrap();
    let text = table(&report);
    assert!(text.contains("cruise speed of 60 %") && text.contains("reached: the same, however slowly"), "{text}");
    for cell in read(&report)["cells"].as_array().unwrap() {
        let (cruise, peak) = (cell["cruise_speed_mps"].as_f64().unwrap(), cell["peak_speed_mps"].as_f64().unwrap());
        assert!(0.0 < cruise && cruise < peak, "{cruise} of {peak}");
        let flights = cell["flights"].as_array().unwrap();
        let reached = flights.iter().filter(|flight| flight["reached"] == true).count() as u64;
        assert_eq!(cell["reached"].as_u64(), Some(reached));
        assert!(cell["successes"].as_u64().unwrap() <= reached);
    }
}

#[test]
fn a_navigation_says_how_long_it_took_and_what_each_pilots_modules_cost() {
    let pilots = vec![PilotKind::Policy, PilotKind::Classical];
    let report = fly(&Campaign { pilots, traced: false, ..campaign(Task::Navigate) }).unwrap();
    let json = read(&report);
    for cell in json["cells"].as_array().unwrap() {
        let reached = cell["flights"].as_array().unwrap().iter().filter(|flight| flight["reached"] == true);
        let times: Vec<f64> = reached.map(|flight| flight["task_s"].as_f64().unwrap()).collect();
        let median = quantile(&times, 0.5);
        assert_eq!(cell["time_to_goal_s"]["p50"].as_f64(), median, "{times:?}");
        assert!(cell["target_plane"].is_null());
    }
    let compute = json["timing"]["compute"].as_array().unwrap();
    assert_eq!(compute.iter().map(|of| of["pilot"].as_str().unwrap()).collect::<Vec<_>>(), ["classical", "policy"]);
    for of in compute {
        let mean = |module: &str| of[module]["mean"].as_f64().unwrap();
        let parts = ["perception_ms", "mapping_ms", "planning_ms", "control_ms"].map(mean);
        assert!((parts.iter().sum::<f64>() - mean("total_ms")).abs() < 1e-9);
        assert!(of["plans"].as_u64().unwrap() > 100 && parts[1..].iter().all(|ms| *ms > 0.0), "{of}");
        assert!(of["total_ms"]["p50"].as_f64() <= of["total_ms"]["p99"].as_f64());
    }
    assert!(table(&report).contains("ms a plan"));
}

#[test]
fn a_chase_says_where_about_the_vehicle_the_target_was_seen() {
    let report = fly(&campaign(Task::Track)).unwrap();
    for (cell, flown) in read(&report)["cells"].as_array().unwrap().iter().zip(&report.flown) {
        let rows = cell["target_plane"]["rows"].as_array().unwrap();
        let counts = |row: &Value| row.as_str().unwrap().split(' ').map(|n| n.parse().unwrap()).collect::<Vec<u64>>();
        assert!(rows.len() == 24 && rows.iter().all(|row| counts(row).len() == 24));
        let seen = flown.iter().map(|f| f.flight.metrics.frames_in_view).sum::<u64>();
        assert_eq!(rows.iter().flat_map(counts).sum::<u64>(), seen);
        assert!(cell["time_to_goal_s"].is_null());
    }
}

#[test]
fn the_goal_is_as_far_ahead_as_is_asked() {
    let json = read(&fly(&Campaign { length_m: 55.0, trials: 1, ..campaign(Task::Navigate) }).unwrap());
    let (map, place) = (&json["paths"][0]["map"], |point: &Value| [0, 1].map(|i| point[i].as_f64().unwrap()));
    let (start, goal) = (place(&map["start_m"]), place(&map["goal_m"]));
    assert!(((goal[0] - start[0]).hypot(goal[1] - start[1]) - 55.0).abs() < 0.01);
    assert_eq!(json["cells"][0]["length_m"], 55.0);
}

#[test]
fn a_seed_of_another_range_is_refused_in_one_line_that_says_which_to_use() {
    let track = "fly --task track --speed 3";
    for (command, wanted) in [
        (format!("{track} --seed 900001"), "for tuning"),
        (format!("{track} --seed 11000001"), "--seeds table"),
        (format!("{track} --seed 5 --seeds table"), "for tables (10000000 to 19999999)"),
        ("dataset --seed 1".to_owned(), "for training (900000 to 999999)"),
        ("faults --seed 11000001".to_owned(), "for tuning"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_goshawk-sim"))
            .args(command.split(' '))
            .current_dir(ROOT)
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), said.lines().count()), (Some(1), 1), "{command}: {said}");
        assert!(said.starts_with("error: --seed ") && said.contains(wanted), "{command}: {said}");
    }
}

#[test]
fn a_table_flies_with_the_seed_of_its_hashes() {
    let folder = tempfile::tempdir().unwrap();
    let (flown, seeds) = (folder.path().join("flown.json"), folder.path().join("seeds.json"));
    let run = |arguments: &[&str], json: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_goshawk-sim"));
        let output = command.args(arguments).arg("--json").arg(json).current_dir(ROOT).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        serde_json::from_slice::<Value>(&fs::read(json).unwrap()).unwrap()
    };
    let seeds = run(&["seeds"], &seeds);
    let flown = run(&["fly", "--task", "track", "--speed", "3", "--trials", "1", "--seeds", "table"], &flown);
    assert_eq!((&flown["seed"], &flown["seeds"]), (&seeds["table_seed"], &Value::from("table")));
    for hash in ["policy_sha256", "vehicle_sha256", "flight_code_sha256"] {
        assert_eq!((flown[hash].as_str().unwrap().len(), &flown[hash]), (64, &seeds[hash]));
    }
    assert!(flown["command"].as_str().unwrap().ends_with(&format!("--seeds table --seed {}", flown["seed"])));
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
    assert!(
        lengths.clone().all(|n| n < goshawk_sim::commands::fly::path::trace::MOST_SAMPLES)
            && lengths.sum::<usize>() > 20
    );
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

#[test]
fn a_provider_that_is_not_there_is_refused_in_one_line() {
    let (folder, vehicles) = (tempfile::tempdir().unwrap(), Path::new(ROOT).join("air/vehicles"));
    fs::copy(vehicles.join("tuning.toml"), folder.path().join("tuning.toml")).unwrap();
    let shipped = fs::read_to_string(vehicles.join("sim.toml")).unwrap();
    let asked = shipped.replace(r#"provider = "cpu""#, r#"provider = "tensorrt""#);
    let file = folder.path().join("vehicle.toml");
    fs::write(&file, asked.replace("../models", &format!("{ROOT}/air/models"))).unwrap();
    let arguments = ["fly", "--task", "track", "--speed", "3", "--trials", "1", "--vehicle-file"];
    let command = Command::new(env!("CARGO_BIN_EXE_goshawk-sim")).args(arguments).arg(&file).current_dir(ROOT).output();
    let (output, begins) = (command.unwrap(), "error: the network does not run on tensorrt: ");
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), said.lines().count()), (Some(1), 1), "{said}");
    assert!(said.starts_with(begins) && said.contains("policy.library"), "{said}");
}
