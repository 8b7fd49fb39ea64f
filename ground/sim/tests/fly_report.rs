//! Facts about a campaign's report, and about flying single flights of a campaign again.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use goshawk_air::config::Vehicle;
use goshawk_core::{ANCHORS, MAX_CHANNELS, NetworkOutput, Task};
use goshawk_policy::{Contract, PolicyError};
use goshawk_sim::actors::evader::Course;
use goshawk_sim::fly::failures::failures;
use goshawk_sim::fly::files::Files;
use goshawk_sim::fly::report::Report;
use goshawk_sim::fly::{Campaign, CampaignError, Pick, page, table};
use goshawk_sim::sense::file::Sensors;
use goshawk_sim::trial::{Difference, Network, Outcome, PilotKind, WorldSource};

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
            r#"{{"version":1,"task":"{task}","image":{{"width":160,"height":96,"hfov_rad":1.5707963,
            "vfov_rad":1.0808390}},"depth":{{"min_m":0.2,"max_m":20.0,"fill_passes":2}},"lattice":{{"rows":3,
            "columns":5,"radius_m":5.0,"elevation_offset_rad":0.2618,"azimuth_offset_rad":0.2618}},"v_max_mps":6.0,
            "a_max_mps2":6.0,"duration_rule":"2r/(alpha*v_max)","target_depth_scale_m":5.0,
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

/// A chase's report with estimates, which the stand-in cannot make.
fn chase(threads: usize) -> Report {
    let mut report = fly(&Campaign { threads, ..campaign(Task::Track) }).unwrap();
    for (index, flown) in report.flown.iter_mut().flatten().enumerate() {
        let spread = |scale: f64| (0..200).map(|i| scale * (f64::from(i) / 100.0 - 1.0 + 0.1 * index as f64)).collect();
        (flown.flight.metrics.lateral_m, flown.flight.metrics.longitudinal_m) = (spread(0.3), spread(0.6));
    }
    report
}

fn written(report: &Report) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    page::write(folder.path(), report, "goshawk-sim fly --task track", &Files::default()).unwrap();
    folder
}

fn names(folder: &Path) -> BTreeSet<String> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// Parses as XML, and asks for nothing outside itself.
fn check(text: &str, elements: &str) -> usize {
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    let document = roxmltree::Document::parse_with_options(text, options).unwrap();
    for node in document.descendants() {
        for name in ["src", "href", "srcset", "data"] {
            assert!(node.attribute(name).is_none(), "{name} of {node:?}");
        }
        assert!(!["script", "link", "iframe", "object", "image", "img"].contains(&node.tag_name().name()), "{node:?}");
    }
    let outside = text.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
    for word in ["http:", "https:", "url(", "@import"] {
        assert!(!outside.contains(word), "{word}");
    }
    assert!(!text.contains("NaN") && !text.contains("inf\""));
    document.descendants().filter(|node| node.has_tag_name(elements) || node.tag_name().name() == elements).count()
}

#[test]
fn the_report_of_a_chase_has_every_figure_and_needs_nothing_else() {
    let report = chase(2);
    let folder = written(&report);
    let names = names(folder.path());
    let figures = [
        "success",
        "failures",
        "view",
        "distance",
        "speed",
        "closest-approach",
        "clearance",
        "in-view",
        "smoothness",
        "error-lateral",
        "error-longitudinal",
    ];
    let flights = ["flight-0-0", "flight-0-1", "flight-1-0", "flight-1-1"];
    let drawings = figures.iter().chain(&flights).map(|name| format!("{name}.svg"));
    let others = ["index.html", "report.json", "cells.csv", "flights.csv", "distributions.csv"].map(str::to_owned);
    assert_eq!(names, drawings.chain(others).collect());

    let page = fs::read_to_string(folder.path().join("index.html")).unwrap();
    assert!(check(&page, "figure") == figures.len() + flights.len());
    for said in ["0 of 4 flights succeeded", "--only 1:1 --log flight-1-1", "4 lost the runner", "a stand-in"] {
        assert!(page.replace("<span>", "").replace("</span>", "").contains(said), "{said}");
    }
    for name in names.iter().filter(|name| name.ends_with(".svg")) {
        check(&fs::read_to_string(folder.path().join(name)).unwrap(), "svg");
    }
    let json = fs::read_to_string(folder.path().join("report.json")).unwrap();
    assert_eq!(json.into_bytes(), report.to_json());
}

#[test]
fn tables_have_a_line_for_each_and_as_many_values_as_heads() {
    let folder = written(&chase(1));
    for (name, lines) in [("cells.csv", 2), ("flights.csv", 4), ("distributions.csv", 2 * 8)] {
        let text = fs::read_to_string(folder.path().join(name)).unwrap();
        let mut rows = text.lines().map(|line| line.split(',').count());
        let heads = rows.next().unwrap();
        assert_eq!(rows.clone().count(), lines, "{name}");
        assert!(rows.all(|values| values == heads), "{name}: {text}");
    }
}

#[test]
fn the_page_is_the_same_for_any_number_of_threads() {
    let page = |threads| fs::read(written(&chase(threads)).path().join("index.html")).unwrap();
    assert_eq!(page(1), page(3));
}

#[test]
fn a_navigation_has_paths_and_obstacles_but_no_runner() {
    let report = fly(&campaign(Task::Navigate)).unwrap();
    let folder = written(&report);
    let names = names(folder.path());
    for absent in ["view.svg", "distance.svg", "in-view.svg", "error-lateral.svg"] {
        assert!(!names.contains(absent), "{absent}");
    }
    for flown in report.flown.iter().flatten() {
        assert!(flown.trace.as_ref().unwrap().samples.iter().all(|sample| sample.target.is_none()));
        let Pick { cell, trial } = flown.pick;
        let map = fs::read_to_string(folder.path().join(format!("flight-{cell}-{trial}.svg"))).unwrap();
        assert!(map.contains("class=\"solid\"") && map.contains("class=\"way s") && !map.contains("class=\"runner"));
        assert!(map.contains(match flown.flight.outcome {
            Outcome::Success => "end-success",
            Outcome::Collision => "end-collision",
            Outcome::Lost => "end-lost",
            Outcome::Timeout => "end-timeout",
            Outcome::TooClose => "end-too-close",
        }));
    }
}

#[test]
fn a_map_shows_each_moving_obstacles_way_and_the_words_say_how_many() {
    let report = fly(&Campaign { moving: 3, ..campaign(Task::Navigate) }).unwrap();
    let folder = written(&report);
    let map = fs::read_to_string(folder.path().join("flight-0-0.svg")).unwrap();
    assert_eq!(map.matches("class=\"moving\"").count(), 3);
    assert!(fs::read_to_string(folder.path().join("index.html")).unwrap().contains("3 moving obstacles"));
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
fn what_a_trace_costs_is_bounded_and_the_flight_does_not_notice_it() {
    let traced = fly(&campaign(Task::Navigate)).unwrap();
    let plain = fly(&Campaign { traced: false, ..campaign(Task::Navigate) }).unwrap();
    assert_eq!(serde_json::to_string(&traced.cells).unwrap(), serde_json::to_string(&plain.cells).unwrap());
    assert!(plain.flown.iter().flatten().all(|flown| flown.trace.is_none()));
    let lengths = traced.flown.iter().flatten().map(|flown| flown.trace.as_ref().unwrap().samples.len());
    assert!(lengths.clone().all(|n| n < goshawk_sim::fly::trace::MOST_SAMPLES) && lengths.sum::<usize>() > 20);
}

#[test]
fn failed_flights_are_named_by_class_with_a_command_that_flies_one_again() {
    let text = failures(&chase(2), "goshawk-sim fly --task track");
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
