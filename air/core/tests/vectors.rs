//! The core against `tests/vectors/*.json`: golden values from an independent float64 implementation in Python.
#![allow(clippy::unwrap_used, reason = "a malformed vector file is a failed test")]

use goshawk_core::control::disturbance::Observer;
use goshawk_core::control::flatness::flat_command;
use goshawk_core::control::lead::lead;
use goshawk_core::planning::nearest::{COLUMNS, ROWS};
use goshawk_core::planning::target::{Detection, TargetFilter};
use goshawk_core::policy::decode::channels;
use goshawk_core::policy::lattice::Lattice;
use goshawk_core::values::quintic::Quintic;
use goshawk_core::*;
use serde_json::Value;

mod common;

const TOLERANCE: f64 = 1e-9;
/// The network speaks in single precision, and is decoded in it.
const DECODED: f64 = 2e-6;

fn load(name: &str) -> Value {
    let path = format!("{}/../../tests/vectors/{name}.json", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(&path).expect(&path)).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("not a number: {value}"))
}

fn list(value: &Value) -> &Vec<Value> {
    value.as_array().unwrap_or_else(|| panic!("not a list: {value}"))
}

fn vector(value: &Value) -> Vec3 {
    Vec3::from_iterator(list(value).iter().map(number))
}

fn rotation(value: &Value) -> Rot {
    let q: Vec<f64> = list(value).iter().map(number).collect();
    Rot::new_unchecked(nalgebra::Quaternion::new(q[0], q[1], q[2], q[3]))
}

fn state(value: &Value) -> FlatState {
    FlatState { pos: vector(&value[0]), vel: vector(&value[1]), acc: vector(&value[2]) }
}

#[track_caller]
fn same(what: &str, got: f64, want: &Value) {
    let want = number(want);
    assert!((got - want).abs() <= TOLERANCE * want.abs().max(1.0), "{what}: {got}, wanted {want}");
}

#[track_caller]
fn same_vector(what: &str, got: Vec3, want: &Value) {
    let want = vector(want);
    assert!((got - want).norm() <= TOLERANCE * want.norm().max(1.0), "{what}: {got}, wanted {want}");
}

#[track_caller]
fn decoded(what: &str, got: &[f64], want: &Value) {
    let wants = want.as_array().map_or_else(|| vec![number(want)], |all| all.iter().map(number).collect());
    assert_eq!(got.len(), wants.len(), "{what}");
    for (got, want) in got.iter().zip(wants) {
        assert!((got - want).abs() <= DECODED * want.abs().max(1.0), "{what}: {got}, wanted {want}");
    }
}

#[track_caller]
fn same_rotation(what: &str, got: Rot, want: &Value) {
    // q and -q are one rotation; an angle loses half the digits near zero, so compare the quaternions.
    let (got, want) = (got.coords, rotation(want).coords);
    assert!((got - want).norm().min((got + want).norm()) <= TOLERANCE, "{what}: {got}, wanted {want}");
}

fn policy(vectors: &Value, task: Task) -> PolicyModel {
    let get = |key: &str| number(&vectors["policy"][key]);
    PolicyModel {
        task,
        state: StateLayout { up: true, aim: true, direction: false, agility: true },
        radius: get("radius"),
        azimuth_offset: get("azimuth_offset"),
        elevation_offset: get("elevation_offset"),
        v_max: get("v_max"),
        a_max: get("a_max"),
        target_depth_scale: get("target_depth_scale"),
        cost_scale: 1.0,
        hfov: get("hfov"),
        vfov: get("vfov"),
        width: get("width") as u32,
        height: get("height") as u32,
    }
}

fn target_config(vectors: &Value) -> TargetConfig {
    let get = |key: &str| number(&vectors["filter"][key]);
    TargetConfig {
        acc_variance_mps2: vector(&vectors["filter"]["acc_variance"]).into(),
        lateral_variance_m2: get("lateral_variance"),
        range_variance_m2: get("range_variance"),
        doubt: get("doubt"),
        variance_distance_m: get("variance_distance"),
        gate_sigmas: get("gate"),
        confirm_hits: get("confirm_hits") as u32,
        confirm_of: get("confirm_of") as u32,
        confirm_objectness: 0.0,
        sure_objectness: 1.0,
        max_speed_mps: get("max_speed"),
        max_distance_m: 50.0,
        ..common::planner_config(Task::Track).planning.target
    }
}

#[test]
fn lattice_agrees() {
    let vectors = load("lattice");
    let get = |key: &str| number(&vectors[key]);
    let lattice = Lattice::new(get("hfov"), get("vfov"), get("radius"));
    assert_eq!(list(&vectors["anchors_N"]).len(), ANCHORS);
    for (index, want) in list(&vectors["anchors_N"]).iter().enumerate() {
        let anchor = &lattice.anchors[index];
        same("elevation", anchor.elevation, &want["elevation"]);
        same("azimuth", anchor.azimuth, &want["azimuth"]);
        same_vector("primitive", lattice.primitive(index), &want["primitive_3"]);
    }
}

#[test]
fn quintic_agrees() {
    for case in list(&load("quintic")["cases_B"]) {
        let quintic = Quintic::new(&state(&case["start_33"]), &state(&case["end_33"]), number(&case["duration"]));
        for sample in list(&case["samples_K"]) {
            let t = number(&sample["t"]);
            let got = quintic.at(t);
            same_vector("pos", got.pos, &sample["pos"]);
            same_vector("vel", got.vel, &sample["vel"]);
            same_vector("acc", got.acc, &sample["acc"]);
            same_vector("jerk", quintic.jerk(t), &sample["jerk"]);
        }
    }
}

/// One decoded case through the planner, which finds the camera's pose itself.
fn check_decoding(vectors: &Value, case: &Value, task: Task) {
    let policy = policy(vectors, task);
    let camera = CameraModel {
        hfov: policy.hfov,
        vfov: policy.vfov,
        width: policy.width,
        height: policy.height,
        body_from_cam: Rot::from_axis_angle(&Vec3::y_axis(), -number(&case["tilt"])),
        pos_cam_body: vector(&case["lens_body_3"]),
    };
    let config = PlannerConfig {
        camera,
        policy,
        planning: common::planning(target_config(&load("target"))),
        extensions: Extensions { pace: false, ..Extensions::ALL },
        keep_off: 1.5,
    };
    let mut planner = Planner::new(config).unwrap();
    let mut network = NetworkOutput { values: [0.0; MAX_CHANNELS * ANCHORS] };
    for channel in 0..channels(task) {
        for anchor in 0..ANCHORS {
            network.values[channel * ANCHORS + anchor] = number(&case["raw_CN"][channel][anchor]) as f32;
        }
    }
    let odometry = Odometry {
        stamp: Time::from_secs(1.0),
        pos_world: vector(&case["pos_3"]),
        vel_world: vector(&case["vel_3"]),
        world_from_body: rotation(&case["world_from_body_Q"]),
        ang_vel_body: Vec3::zeros(),
        reset_counter: 0,
    };
    let (acc_world, speed, goal_world) =
        (vector(&case["acc_3"]), number(&case["speed"]), Some(vector(&case["goal_3"])));
    let nearest = [0; COLUMNS * ROWS];
    let frame = FrameInput { flight: 0, seq: 1, odometry, acc_world, speed, goal_world, nearest };
    let asked = planner.see(&frame);
    assert_eq!(asked.state().len(), list(&case["state"]).len());
    for (at, (got, want)) in asked.state().iter().zip(list(&case["state"])).enumerate() {
        // The case's aim is a goal's; a tracker that has seen nobody has none.
        let want = if task == Task::Track && (9..12).contains(&at) { 0.0 } else { number(want) };
        assert!((f64::from(*got) - want).abs() <= DECODED * want.abs().max(1.0), "{got}, wanted {want}");
    }
    let plan = asked.answer(&network);
    same("duration", plan.duration, &case["duration"]);
    same_rotation("camera", plan.world_from_cam, &case["world_from_cam_Q"]);
    assert_eq!(plan.candidates.len(), list(&case["candidates_N"]).len());
    for (got, want) in plan.candidates.iter().zip(list(&case["candidates_N"])) {
        decoded("end pos", got.end.pos.as_slice(), &want["end_pos"]);
        decoded("end vel", got.end.vel.as_slice(), &want["end_vel"]);
        decoded("end acc", got.end.acc.as_slice(), &want["end_acc"]);
        decoded("cost", &[got.cost], &want["cost"]);
        match task {
            Task::Track => {
                decoded("objectness", &[got.objectness], &want["objectness"]);
                decoded("target", got.target_world.unwrap().as_slice(), &want["target"]);
            }
            Task::Navigate => assert_eq!((got.objectness, got.target_world), (1.0, None)),
        }
    }
}

#[test]
fn decoding_agrees_at_other_speeds_and_camera_tilts() {
    let vectors = load("decode");
    for case in list(&vectors["cases_B"]) {
        check_decoding(&vectors, case, Task::Track);
        check_decoding(&vectors, case, Task::Navigate);
    }
}

#[test]
fn target_filter_agrees_frame_by_frame() {
    let vectors = load("target");
    let mut filter = TargetFilter::new(target_config(&vectors), Extensions::ALL);
    let lens = vector(&vectors["lens_3"]);
    for frame in list(&vectors["frames_K"]) {
        let mut detections = [None; 4];
        let (places, objectness) = (list(&frame["detections"]), list(&frame["objectness"]));
        assert_eq!(places.len(), objectness.len());
        let seen = places.iter().zip(objectness);
        for (slot, (pos, objectness)) in detections.iter_mut().zip(seen) {
            let pos_world = vector(pos);
            *slot = Some(Detection { pos_world, sight_world: pos_world - lens, objectness: number(objectness) });
        }
        let mut consistent = [false; 4];
        filter.step(Time(frame["stamp_ns"].as_u64().unwrap()), &detections, &mut consistent);
        let estimate = filter.estimate().unwrap();
        assert_eq!(estimate.confirmed, frame["confirmed"].as_bool().unwrap());
        assert!(places.len() == list(&frame["consistent"]).len() && places.len() <= consistent.len());
        for (got, want) in consistent.iter().zip(list(&frame["consistent"])) {
            assert_eq!(*got, want.as_bool().unwrap());
        }
        same_vector("pos", estimate.pos_world, &frame["pos"]);
        same_vector("vel", estimate.vel_world, &frame["vel"]);
        for row in 0..6 {
            for column in 0..6 {
                same("covariance", estimate.covariance[(row, column)], &frame["covariance"][row][column]);
            }
        }
    }
}

#[test]
fn observer_agrees_at_mixed_steps() {
    for case in list(&load("observer")["cases_B"]) {
        let get = |key: &str| number(&case[key]);
        let mut observer = Observer::new(ObserverConfig {
            alpha1: get("alpha1"),
            alpha2: get("alpha2"),
            zeta_s: get("zeta"),
            limit_mps2: 1e3,
        });
        for step in list(&case["steps_K"]) {
            observer.step(number(&step["dt"]), vector(&step["vel"]), vector(&step["model"]));
            same_vector("disturbance", observer.disturbance(), &step["disturbance"]);
        }
    }
}

#[test]
fn flatness_agrees_within_and_at_its_limits() {
    let vectors = load("flatness");
    let get = |key: &str| number(&vectors["vehicle"][key]);
    let vehicle = Airframe {
        mass_kg: get("mass"),
        hover_thrust: get("hover_thrust"),
        min_thrust: get("min_thrust"),
        max_thrust: get("max_thrust"),
        max_tilt_deg: get("max_tilt").to_degrees(),
        ..common::config().airframe
    };
    for case in list(&vectors["cases_B"]) {
        let got = flat_command(&vehicle, vector(&case["acc_3"]), vector(&case["disturbance_3"]), number(&case["yaw"]));
        same_rotation("attitude", got.world_from_body, &case["world_from_body_Q"]);
        same("force", got.force.0, &case["force_n"]);
        same("thrust", vehicle.normalised(got.force).0, &case["thrust"]);
        same_vector("acceleration", got.acc_att_world, &case["acc_att_3"]);
    }
}

#[test]
fn lead_agrees() {
    let vectors = load("lead");
    let (config, tau) = (
        LeadConfig { limit_mps2: number(&vectors["limit"]), chase_lag_s: 0.0, navigation_lag_s: 0.0 },
        number(&vectors["tau"]),
    );
    for case in list(&vectors["cases_B"]) {
        same_vector("led", lead(&config, tau, vector(&case["acc_3"]), vector(&case["jerk_3"])), &case["led_3"]);
    }
}
