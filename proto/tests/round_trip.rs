//! Rust and Python agree on the bytes of every message with every field set: `tests/proto/*.bin` hold Python's
//! encoding of `tests/proto/messages.json`; the literals below say the same by hand.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::path::PathBuf;

use goshawk_proto::v1::*;
use prost::Message;

// Values follow the fixtures' rule: field number n holds n + 0.5, 1000 n, 10 n or its name.
fn vec3() -> Option<Vec3> {
    Some(Vec3 { x: 1.5, y: 2.5, z: 3.5 })
}

fn vec3f() -> Option<Vec3f> {
    Some(Vec3f { x: 1.5, y: 2.5, z: 3.5 })
}

fn quat() -> Option<Quat> {
    Some(Quat { w: 1.5, x: 2.5, y: 3.5, z: 4.5 })
}

fn reply() -> CommandReply {
    CommandReply { command_id: "command_id".into(), accepted: true, reason: "reason".into(), mode: Mode::Track.into() }
}

fn candidate() -> Candidate {
    Candidate {
        end_pos_world: vec3f(),
        end_vel_world: vec3f(),
        end_acc_world: vec3f(),
        cost: 4.5,
        objectness: 5.5,
        target_pos_world: vec3f(),
        rejection: Rejection::Invalid.into(),
        added_obstacle: 8.5,
        added_mover: 9.5,
        added_target: 10.5,
        added_climbing: 11.5,
    }
}

fn plan() -> Plan {
    Plan {
        seq: 1000,
        frame_ns: 2000,
        ready_ns: 3000,
        start_pos_world: vec3(),
        start_vel_world: vec3(),
        start_acc_world: vec3(),
        world_from_cam: quat(),
        duration_s: 8.5,
        alpha: 9.5,
        candidates: vec![candidate()],
        chosen: Some(110),
    }
}

fn obstacle_map() -> ObstacleMap {
    ObstacleMap {
        seq: 1000,
        stamp_ns: 2000,
        origin_world: vec3(),
        voxel_m: 4.5,
        voxels: vec![5, 0, 255],
        depth: Some(depth_blocks()),
    }
}

fn depth_blocks() -> DepthBlocks {
    DepthBlocks {
        frame_ns: 1000,
        cam_world: vec3(),
        world_from_cam: quat(),
        hfov_rad: 4.5,
        vfov_rad: 5.5,
        nearest_dm: vec![6, 0, 255],
    }
}

fn control() -> Control {
    Control {
        seq: 1000,
        stamp_ns: 2000,
        mode: Mode::Takeoff.into(),
        fallback: Fallback::HandBack.into(),
        pos_world: vec3(),
        vel_world: vec3(),
        world_from_body: quat(),
        acc_des_world: vec3(),
        acc_att_world: vec3(),
        acc_disturbance_world: vec3(),
        acc_meas_world: vec3(),
        world_from_body_des: quat(),
        thrust_n: 13.5,
        thrust_norm: 14.5,
        yaw_des_rad: 15.5,
        plan_seq: Some(16000),
        plan_age_s: Some(17.5),
        hover_thrust: 18.5,
        attitude_lag_s: 19.5,
        odometry_fault: OdometryFault::Frozen.into(),
        odometry_doubt: 21.5,
        disturbance_limit_mps2: 23.5,
    }
}

fn target() -> Target {
    Target {
        seq: 1000,
        stamp_ns: 2000,
        pos_world: vec3(),
        vel_world: vec3(),
        confirmed: true,
        since_seen_s: 7.5,
        look: Some(look()),
        covariance_upper: vec![9.5],
    }
}

fn look() -> TargetLook {
    TargetLook {
        detections: 10,
        passed: 20,
        gate_sigmas: 3.5,
        innovation_world: vec3(),
        innovation_sigmas: 5.5,
        objectness: 6.5,
        rival_pos_world: vec3(),
        rival_objectness: 8.5,
        rival_needed: 9.5,
    }
}

fn event() -> Event {
    Event { stamp_ns: 1000, severity: Severity::Warning.into(), kind: "kind".into(), text: "text".into(), seq: 5000 }
}

fn missed() -> Missed {
    Missed {
        session: 1000,
        events: vec![event()],
        controls: vec![control()],
        healths: vec![health()],
        dropped_events: 5000,
        dropped_samples: 6000,
        more: true,
        targets: vec![target()],
    }
}

fn check() -> Check {
    Check { name: "name".into(), ok: true, reason: "reason".into() }
}

fn rate() -> Rate {
    Rate { name: "name".into(), hz: 2.5 }
}

fn latency() -> Latency {
    Latency { name: "name".into(), p50_ms: 2.5, p99_ms: 3.5, max_ms: 4.5, count: 5000, histogram: vec![1, 6_000] }
}

fn drops() -> Drops {
    Drops { name: "name".into(), count: 2000 }
}

fn health() -> Health {
    Health {
        seq: 1000,
        stamp_ns: 2000,
        mode: Mode::Takeoff.into(),
        ready: true,
        checks: vec![check()],
        rates: vec![rate()],
        latencies: vec![latency()],
        drops: vec![drops()],
        faults: vec!["faults".into()],
        vehicle: "vehicle".into(),
        profile: "profile".into(),
        policy_sha256: "policy_sha256".into(),
        version: "version".into(),
        battery_fraction: Some(14.5),
        log_path: "log_path".into(),
        autopilot: "autopilot".into(),
        profiles: vec!["profiles".into()],
        protocol: 18,
        session: 19_000,
        events: 20_000,
        stops: 21_000,
    }
}

fn odometry() -> Odometry {
    Odometry {
        seq: 1000,
        stamp_ns: 2000,
        pos_world: vec3(),
        vel_world: vec3(),
        world_from_body: quat(),
        ang_vel_body: vec3(),
        reset_counter: 70,
    }
}

fn log_header() -> LogHeader {
    LogHeader {
        vehicle: "vehicle".into(),
        vehicle_toml: "vehicle_toml".into(),
        tuning_toml: "tuning_toml".into(),
        policy_sha256: "policy_sha256".into(),
        policy_contract_json: "policy_contract_json".into(),
        version: "version".into(),
        git_revision: "git_revision".into(),
        wall_time: "wall_time".into(),
        stamp_ns: 8000,
        profile: "profile".into(),
        protocol: 10,
    }
}

fn planner_input() -> PlannerInput {
    PlannerInput {
        seq: 1000,
        odometry: Some(odometry()),
        acc_world: vec3(),
        speed_mps: 4.5,
        goal_world: vec3(),
        state: vec![6.5, 60.0],
        prediction: vec![7.5, 70.0],
        nearest_mm: vec![8, 80],
    }
}

fn start_profile() -> StartProfile {
    StartProfile { task: Task::Navigate.into(), speed_mps: 2.5, height_m: 3.5, goal_m: vec3() }
}

fn controller_input() -> ControllerInput {
    ControllerInput {
        seq: 1000,
        stamp_ns: 2000,
        plan_seq: Some(3000),
        connected: true,
        armed: true,
        offboard: true,
        landed: Some(true),
        ready: true,
        start: Some(start_profile()),
        stop: true,
        odometry_ns: Some(11_000),
        battery: Some(12.5),
        position: Some(true),
        imu_ns: Some(14_000),
        hold: true,
        resume: true,
    }
}

fn sim_truth() -> SimTruth {
    SimTruth {
        stamp_ns: 1000,
        pos_world: vec3(),
        world_from_body: quat(),
        vel_world: vec3(),
        target_pos_world: vec3(),
        target_vel_world: vec3(),
        clearance_m: 7.5,
        collisions: 80,
        target_distance_m: 9.5,
        target_path_m: 10.5,
        target_arrived: true,
        target_visible: true,
        moving: vec![sim_box()],
        acc_world: vec3(),
        goal_world: vec3(),
    }
}

fn sim_box() -> SimBox {
    SimBox { centre_world: vec3f(), size_m: vec3f(), yaw_rad: 3.5 }
}

fn tree() -> SimTree {
    SimTree { base_world: vec3f(), top_world: vec3f(), radius_m: 3.5, foliage_radius_m: 4.5 }
}

fn fixture_bytes(name: &str) -> Vec<u8> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("../tests/proto/{name}.bin"));
    std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Decodes Python's bytes, compares, encodes again.
fn agrees<M: Message + Default + PartialEq + std::fmt::Debug>(name: &str, expected: &M) {
    let bytes = fixture_bytes(name);
    assert_eq!(&M::decode(bytes.as_slice()).unwrap(), expected, "{name}");
    assert_eq!(expected.encode_to_vec(), bytes, "{name}");
}

/// Every message, by name.
fn checks() -> BTreeMap<&'static str, Box<dyn Fn()>> {
    fn entry<M: Message + Default + PartialEq + std::fmt::Debug + 'static>(
        name: &'static str,
        expected: M,
    ) -> (&'static str, Box<dyn Fn()>) {
        (name, Box::new(move || agrees(name, &expected)))
    }
    let text = |s: &str| s.to_owned();
    BTreeMap::from([
        entry("Vec3", vec3().unwrap()),
        entry("Vec3f", vec3f().unwrap()),
        entry("Quat", quat().unwrap()),
        entry(
            "StartRequest",
            StartRequest { command_id: text("command_id"), profile: text("profile"), session: 3000, stops: 4000 },
        ),
        entry("StopRequest", StopRequest { command_id: text("command_id") }),
        entry("CommandReply", reply()),
        entry("Candidate", candidate()),
        entry("Plan", plan()),
        entry("Control", control()),
        entry("ObstacleMap", obstacle_map()),
        entry("DepthBlocks", depth_blocks()),
        entry("Imu", Imu { stamp_ns: 1000, specific_force_body: vec3(), ang_vel_body: vec3() }),
        entry("Target", target()),
        entry("Check", check()),
        entry("Rate", rate()),
        entry("Latency", latency()),
        entry("Drops", drops()),
        entry("Health", health()),
        entry("Preview", Preview { seq: 1000, stamp_ns: 2000, width: 30, height: 40, jpeg: vec![5, 0, 255] }),
        entry("Event", event()),
        entry("TargetLook", look()),
        entry("MissedRequest", MissedRequest { session: 1000, after_event: 2000, after_ns: 3000, before_ns: 4000 }),
        entry("Missed", missed()),
        entry(
            "Rgbd",
            Rgbd {
                seq: 1000,
                stamp_ns: 2000,
                width: 30,
                height: 40,
                hfov_rad: 5.5,
                vfov_rad: 6.5,
                rgb: vec![7, 0, 255],
                depth_mm: vec![8, 0, 255],
            },
        ),
        entry("Odometry", odometry()),
        entry("LogHeader", log_header()),
        entry(
            "CompressedRgbd",
            CompressedRgbd {
                seq: 1000,
                stamp_ns: 2000,
                width: 30,
                height: 40,
                hfov_rad: 5.5,
                vfov_rad: 6.5,
                depth_png: vec![8, 0, 255],
                rgb_png: vec![60, 0, 255],
            },
        ),
        entry("PlannerInput", planner_input()),
        entry("ControllerInput", controller_input()),
        entry("StartProfile", start_profile()),
        entry(
            "CommandRecord",
            CommandRecord { stamp_ns: 1000, verb: text("verb"), profile: text("profile"), reply: Some(reply()) },
        ),
        entry("SimTruth", sim_truth()),
        entry("SimTree", tree()),
        entry("SimBox", sim_box()),
        entry(
            "SimWorld",
            SimWorld { trees: vec![tree()], seed: 2000, spacing_m: 3.5, boxes: vec![sim_box()], items: 50 },
        ),
        entry("SimWorldRequest", SimWorldRequest { first: 10 }),
    ])
}

#[test]
fn bytes_of_python_decode_to_the_same_values_and_encode_identically() {
    for check in checks().values() {
        check();
    }
}

#[test]
fn every_message_of_the_descriptor_set_is_checked() {
    let set = prost_types::FileDescriptorSet::decode(goshawk_proto::FILE_DESCRIPTOR_SET).unwrap();
    let mut named: Vec<&str> =
        set.file.iter().flat_map(|f| &f.message_type).map(prost_types::DescriptorProto::name).collect();
    named.sort_unstable();
    assert_eq!(checks().keys().copied().collect::<Vec<_>>(), named);
}

#[test]
fn a_plan_of_fifteen_candidates_fits_in_two_kilobytes() {
    let mut plan = plan();
    plan.candidates = vec![candidate(); 15];
    let large = u64::from(u32::MAX) * 1_000_000; // stamps of an hour and more
    (plan.seq, plan.frame_ns, plan.ready_ns) = (large, large, large);
    assert!(plan.encoded_len() <= 2048, "{} bytes", plan.encoded_len());
}
