//! The stand-in against what the real one was measured to do; no physics, no sockets.

use super::{LossAction, OdometryFault, Px4Config, Px4Logic, Px4Output, VehicleState};
use goshawk_autopilot::messages::*;
use goshawk_autopilot::wire::Packet;
use goshawk_autopilot::{AutopilotEvent, Px4Mode};
use goshawk_core::types::{Rot, Time, Vec3};
use mavlink::{MavHeader, Message, MessageData};
use std::collections::BTreeMap;

const STEP_S: f64 = 1e-3;

pub(super) fn standing() -> VehicleState {
    VehicleState {
        pos_world: Vec3::zeros(),
        vel_world: Vec3::zeros(),
        world_from_body: Rot::identity(),
        ang_vel_body: Vec3::zeros(),
        acc_world: Vec3::zeros(),
        on_ground: true,
        battery_fraction: 1.0,
        reset_counter: 0,
    }
}

fn flying() -> VehicleState {
    VehicleState {
        pos_world: Vec3::new(0.0, 0.0, 3.0),
        vel_world: Vec3::new(1.0, 0.0, 0.0),
        on_ground: false,
        ..standing()
    }
}

fn command(command: MavCmd, params: [f32; 3], component: u8) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command,
        param1: params[0],
        param2: params[1],
        param3: params[2],
        target_system: 1,
        target_component: component,
        ..COMMAND_LONG_DATA::default()
    })
}

fn offboard() -> MavMessage {
    command(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 6.0, 0.0], 1)
}

fn arm() -> MavMessage {
    command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0], 1)
}

fn setpoint(thrust: f32, component: u8) -> MavMessage {
    MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
        q: [1.0, 0.0, 0.0, 0.0],
        thrust,
        target_system: 1,
        target_component: component,
        type_mask: AttitudeTargetTypemask::from_bits_retain(7),
        ..SET_ATTITUDE_TARGET_DATA::default()
    })
}

struct Bench {
    px4: Px4Logic,
    now: Time,
    vehicle: VehicleState,
    /// Thrust streamed at 50 Hz; none: no stream.
    thrust: Option<f32>,
    heard: Vec<(f64, MavMessage)>,
    output: Option<Px4Output>,
    steps: u64,
}

impl Bench {
    fn new(config: Px4Config) -> Self {
        Self {
            px4: Px4Logic::new(config),
            now: Time::from_secs(50.0),
            vehicle: standing(),
            thrust: None,
            heard: Vec::new(),
            output: None,
            steps: 0,
        }
    }

    fn seconds(&self) -> f64 {
        self.steps as f64 * STEP_S
    }

    fn step(&mut self, message: Option<MavMessage>) {
        let mut messages: Vec<MavMessage> = message.into_iter().collect();
        if self.steps.is_multiple_of(20) {
            messages.extend(self.thrust.map(|thrust| setpoint(thrust, 1)));
        }
        let header = MavHeader { system_id: 1, component_id: 191, sequence: 0 };
        let packets: Vec<Packet> = messages.into_iter().map(|message| Packet { header, message }).collect();
        let mut sent = Vec::new();
        self.output = Some(self.px4.step(self.now, &packets, &self.vehicle, &mut sent));
        let stamp = self.seconds();
        self.heard.extend(sent.into_iter().map(|message| (stamp, message)));
        self.now = self.now.plus(STEP_S);
        self.steps += 1;
    }

    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / STEP_S).round() as u64 {
            self.step(None);
        }
    }

    /// Sends, waits for the answer; none: there was none within a second.
    fn ask(&mut self, message: MavMessage) -> Option<MavResult> {
        let before = self.heard.len();
        self.step(Some(message));
        self.run(1.0);
        self.heard[before..].iter().find_map(|(_, message)| match message {
            MavMessage::COMMAND_ACK(ack) => Some(ack.result),
            _ => None,
        })
    }

    /// Armed and flying in OFFBOARD with a stream.
    fn airborne(config: Px4Config) -> Self {
        let mut bench = Self::new(config);
        bench.thrust = Some(0.0);
        bench.run(0.1);
        assert_eq!(bench.ask(offboard()), Some(MavResult::MAV_RESULT_ACCEPTED));
        assert_eq!(bench.ask(arm()), Some(MavResult::MAV_RESULT_ACCEPTED));
        bench.thrust = Some(0.5);
        bench.vehicle = flying();
        bench.run(0.5);
        assert!(bench.armed() && !bench.px4.landed());
        bench
    }

    fn armed(&self) -> bool {
        self.output.is_some_and(|output| output.armed)
    }

    fn mode(&self) -> Px4Mode {
        self.output.expect("stepped").mode
    }

    /// Runs until `done`, at most 15 s; how long it took, s.
    fn until(&mut self, done: impl Fn(&Self) -> bool) -> f64 {
        let start = self.seconds();
        while !done(self) {
            self.step(None);
            assert!(self.seconds() - start < 15.0, "never happened");
        }
        self.seconds() - start
    }

    fn events(&self) -> Vec<(f64, AutopilotEvent)> {
        self.heard
            .iter()
            .filter_map(|(stamp, message)| match message {
                MavMessage::EVENT(event) => Some((*stamp, AutopilotEvent::from_id(event.id))),
                _ => None,
            })
            .collect()
    }

    fn heard_event(&self, event: AutopilotEvent) -> bool {
        self.events().iter().any(|(_, heard)| *heard == event)
    }
}

fn count(bench: &Bench) -> BTreeMap<&'static str, usize> {
    let mut counts = BTreeMap::new();
    for (_, message) in &bench.heard {
        *counts.entry(message.message_name()).or_default() += 1;
    }
    counts
}

#[test]
fn unasked_streams_come_at_the_measured_rates() {
    let mut bench = Bench::new(Px4Config::default());
    bench.run(20.0);
    let counts = count(&bench);
    for (name, hz) in [
        ("ATTITUDE", 100.0),
        ("ATTITUDE_QUATERNION", 50.0),
        ("HIGHRES_IMU", 50.0),
        ("LOCAL_POSITION_NED", 30.0),
        ("ODOMETRY", 30.0),
        ("TIMESYNC", 10.0),
        ("ATTITUDE_TARGET", 10.0),
        ("SYS_STATUS", 5.0),
        ("EXTENDED_SYS_STATE", 5.0),
        ("HEARTBEAT", 1.0),
        ("BATTERY_STATUS", 0.5),
        ("CURRENT_MODE", 0.5),
    ] {
        let expected = hz * 20.0;
        assert!((counts[name] as f64 - expected).abs() <= 1.0, "{name}: {} in 20 s", counts[name]);
    }
}

#[test]
fn a_stream_is_raised_switched_off_and_reset_on_request() {
    let mut bench = Bench::new(Px4Config::default());
    let interval = |us: f32| command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [ODOMETRY_DATA::ID as f32, us, 0.0], 1);
    for (us, expected) in [(8_000.0, 125), (-1.0, 0), (0.0, 30)] {
        assert_eq!(bench.ask(interval(us)), Some(MavResult::MAV_RESULT_ACCEPTED));
        bench.heard.clear();
        bench.run(1.0);
        let counted = count(&bench).get("ODOMETRY").copied().unwrap_or(0);
        assert!(counted.abs_diff(expected) <= 1, "{us}: {counted}");
    }
    let unknown = command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [12_345.0, 8_000.0, 0.0], 1);
    assert_eq!(bench.ask(unknown), Some(MavResult::MAV_RESULT_FAILED));
}

#[test]
fn offboard_is_accepted_disarmed_without_a_stream_but_arming_then_is_not() {
    let mut bench = Bench::new(Px4Config::default());
    assert_eq!(bench.ask(offboard()), Some(MavResult::MAV_RESULT_ACCEPTED));
    assert_eq!(bench.mode(), Px4Mode::Offboard);
    assert_eq!(bench.ask(arm()), Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
    assert!(!bench.armed());
    bench.thrust = Some(0.0);
    bench.run(0.1);
    assert_eq!(bench.ask(arm()), Some(MavResult::MAV_RESULT_ACCEPTED));
    assert!(bench.armed());
}

#[test]
fn offboard_without_a_stream_is_refused_when_armed() {
    let mut bench = Bench::new(Px4Config::default());
    assert_eq!(bench.ask(arm()), Some(MavResult::MAV_RESULT_ACCEPTED));
    assert_eq!(bench.ask(offboard()), Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
    assert_eq!(bench.mode(), Px4Mode::Hold);
    bench.thrust = Some(0.0);
    bench.run(0.1);
    assert_eq!(bench.ask(offboard()), Some(MavResult::MAV_RESULT_ACCEPTED));
}

#[test]
fn acks_take_1_to_15_ms_and_name_who_asked() {
    let mut bench = Bench::new(Px4Config::default());
    for _ in 0..10 {
        bench.heard.clear();
        let asked = bench.seconds();
        bench.step(Some(offboard()));
        bench.run(0.1);
        let acks: Vec<_> = bench
            .heard
            .iter()
            .filter_map(|(stamp, message)| match message {
                MavMessage::COMMAND_ACK(ack) => Some((stamp - asked, ack.target_system, ack.target_component)),
                _ => None,
            })
            .collect();
        assert_eq!(acks.len(), 1);
        assert!((0.0005..0.0165).contains(&acks[0].0), "{acks:?}");
        assert_eq!((acks[0].1, acks[0].2), (1, 191));
    }
}

#[test]
fn a_wrong_component_gets_no_ack_and_its_setpoints_count_for_nothing() {
    let mut bench = Bench::new(Px4Config::default());
    assert_eq!(bench.ask(command(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 6.0, 0.0], 7)), None);
    assert_eq!(bench.mode(), Px4Mode::Hold);
    assert_eq!(bench.ask(offboard()), Some(MavResult::MAV_RESULT_ACCEPTED));
    for _ in 0..50 {
        bench.step(Some(setpoint(0.3, 7)));
    }
    assert_eq!(bench.ask(arm()), Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
}

#[test]
fn lost_setpoints_fail_safe_after_the_loss_time() {
    for loss_s in [0.2, 0.5, 1.0] {
        let mut bench = Bench::airborne(Px4Config { loss_s, ..Px4Config::default() });
        bench.until(|bench| bench.steps % 20 == 1); // right after a setpoint
        bench.thrust = None;
        bench.heard.clear();
        let took = bench.until(|bench| bench.mode() != Px4Mode::Offboard);
        assert!((took - loss_s - 0.05).abs() < 0.005, "{took} for {loss_s}");
        assert_eq!(bench.mode(), Px4Mode::Land);
        assert!(bench.heard_event(AutopilotEvent::FailsafeEntered), "the event comes at once");
        let shown = bench.until(|bench| {
            bench.heard.iter().any(|(_, message)| match message {
                MavMessage::HEARTBEAT(heartbeat) => heartbeat.custom_mode == Px4Mode::Land.custom_mode(),
                _ => false,
            })
        });
        assert!(shown <= 1.0, "the heartbeat is late by up to its interval: {shown}");
    }
}

#[test]
fn the_failsafes_mode_is_shown_as_not_intended() {
    let mut bench = Bench::airborne(Px4Config { loss_action: LossAction::Hold, ..Px4Config::default() });
    let raise = command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [CURRENT_MODE_DATA::ID as f32, 100_000.0, 0.0], 1);
    assert_eq!(bench.ask(raise), Some(MavResult::MAV_RESULT_ACCEPTED));
    bench.thrust = None;
    bench.until(|bench| bench.mode() == Px4Mode::Hold);
    bench.heard.clear();
    let shown = bench.until(|bench| {
        bench.heard.iter().any(|(_, message)| {
            matches!(message, MavMessage::CURRENT_MODE(mode)
                if mode.custom_mode == Px4Mode::Hold.custom_mode()
                    && mode.intended_custom_mode == Px4Mode::Offboard.custom_mode())
        })
    });
    assert!(shown <= 0.1, "{shown}");
}

#[test]
fn a_resumed_stream_returns_to_offboard_within_40_ms() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.thrust = None;
    bench.until(|bench| bench.mode() == Px4Mode::Land);
    bench.run(2.0);
    bench.until(|bench| bench.steps.is_multiple_of(20)); // the next step sends one
    bench.thrust = Some(0.5);
    let took = bench.until(|bench| bench.mode() == Px4Mode::Offboard);
    assert!(took <= 0.04, "{took}");
}

#[test]
fn a_normal_disarm_in_the_air_is_refused_and_a_forced_one_is_not() {
    let mut bench = Bench::airborne(Px4Config::default());
    let disarm = |magic: f32| command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0, magic, 0.0], 1);
    assert_eq!(bench.ask(disarm(0.0)), Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
    assert!(bench.armed());
    assert_eq!(bench.ask(disarm(21196.0)), Some(MavResult::MAV_RESULT_ACCEPTED));
    assert!(!bench.armed());
    assert_eq!(bench.output.unwrap().demand, None);
}

#[test]
fn no_thrust_on_the_ground_is_landed_after_2_to_2_6_s_and_disarmed_2_s_later() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.vehicle = standing();
    bench.thrust = Some(0.0);
    bench.heard.clear();
    let landed = bench.until(|bench| bench.px4.landed());
    assert!((2.0..2.6).contains(&landed), "{landed}");
    let disarmed = bench.until(|bench| !bench.armed());
    assert!((disarmed - 2.0).abs() < 0.01, "{disarmed}");
    let events: Vec<AutopilotEvent> = bench.events().into_iter().map(|(_, event)| event).collect();
    assert_eq!(events, [AutopilotEvent::LandingDetected, AutopilotEvent::Disarmed]);
}

#[test]
fn a_quarter_of_thrust_on_the_ground_is_believed_to_be_flight() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.vehicle = standing();
    bench.thrust = Some(0.25);
    bench.run(10.0);
    assert!(bench.armed() && !bench.px4.landed());
}

#[test]
fn armed_without_a_flight_it_disarms_after_10_s() {
    let mut bench = Bench::new(Px4Config::default());
    assert_eq!(bench.ask(arm()), Some(MavResult::MAV_RESULT_ACCEPTED));
    let took = bench.until(|bench| !bench.armed());
    assert!((took - 9.0).abs() < 0.01, "a second passed while asking: {took}");
}

#[test]
fn a_pilot_takes_over_and_setpoints_do_not_take_it_back() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.px4.pilot_takes_over(Px4Mode::Position);
    bench.heard.clear();
    bench.run(3.0);
    assert_eq!(bench.mode(), Px4Mode::Position);
    assert!(!bench.heard_event(AutopilotEvent::FailsafeEntered));
    let told = bench.heard.iter().filter_map(|(_, message)| match message {
        MavMessage::CURRENT_MODE(mode) => Some(mode.custom_mode == mode.intended_custom_mode),
        _ => None,
    });
    assert!(told.into_iter().all(|same| same));
}

#[test]
fn odometry_names_ned_for_both_frames_and_stamps_are_since_boot() {
    let mut bench = Bench::new(Px4Config::default());
    bench.vehicle = VehicleState {
        pos_world: Vec3::new(1.0, 2.0, 3.0),
        vel_world: Vec3::new(4.0, 5.0, 6.0),
        reset_counter: 9,
        ..flying()
    };
    bench.run(1.0);
    let (stamp, last) = bench.heard.iter().rfind(|(_, message)| matches!(message, MavMessage::ODOMETRY(_))).unwrap();
    let MavMessage::ODOMETRY(odometry) = last else { unreachable!() };
    assert_eq!((odometry.frame_id as u8, odometry.child_frame_id as u8), (1, 1));
    assert_eq!([odometry.x, odometry.y, odometry.z], [2.0, 1.0, -3.0]);
    assert_eq!([odometry.vx, odometry.vy, odometry.vz], [5.0, 4.0, -6.0]);
    assert_eq!(odometry.reset_counter, 9);
    assert!((odometry.time_usec as f64 * 1e-6 - stamp).abs() < 1e-3);
}

#[test]
fn timesync_is_answered_in_boot_nanoseconds() {
    let mut bench = Bench::new(Px4Config::default());
    bench.run(2.0);
    bench.heard.clear();
    bench.step(Some(MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: 77, ..TIMESYNC_DATA::default() })));
    let answers: Vec<_> = bench
        .heard
        .iter()
        .filter_map(|(_, message)| match message {
            MavMessage::TIMESYNC(sync) if sync.ts1 == 77 => Some(sync.tc1),
            _ => None,
        })
        .collect();
    assert_eq!(answers.len(), 1);
    assert!((answers[0] as f64 * 1e-9 - 2.0).abs() < 0.002, "{answers:?}");
}

#[test]
fn texts_come_only_to_a_ground_station() {
    let mut bench = Bench::new(Px4Config::default());
    assert_eq!(bench.ask(offboard()), Some(MavResult::MAV_RESULT_ACCEPTED));
    let texts = |bench: &Bench| count(bench).get("STATUSTEXT").copied().unwrap_or(0);
    let heartbeat = |mavtype| MavMessage::HEARTBEAT(HEARTBEAT_DATA { mavtype, ..HEARTBEAT_DATA::default() });
    bench.step(Some(heartbeat(MavType::MAV_TYPE_ONBOARD_CONTROLLER)));
    bench.ask(arm());
    assert_eq!(texts(&bench), 0);
    bench.step(Some(heartbeat(MavType::MAV_TYPE_GCS)));
    bench.ask(arm());
    assert_eq!(texts(&bench), 1);
}

#[test]
fn the_battery_is_reported_as_the_vehicle_has_it() {
    let mut bench = Bench::new(Px4Config::default());
    bench.vehicle.battery_fraction = 0.42;
    bench.run(1.0);
    let told = bench.heard.iter().find_map(|(_, message)| match message {
        MavMessage::SYS_STATUS(status) => Some((status.battery_remaining, status.voltage_battery)),
        _ => None,
    });
    let (percent, millivolts) = told.unwrap();
    assert_eq!(percent, 42);
    assert!((14_000..16_800).contains(&millivolts));
}

#[test]
fn a_faulty_estimator_is_silent_or_not_a_number() {
    let mut bench = Bench::new(Px4Config::default());
    bench.px4.set_odometry_fault(Some(OdometryFault::Silent));
    bench.run(1.0);
    assert_eq!(count(&bench).get("ODOMETRY"), None);
    bench.px4.set_odometry_fault(Some(OdometryFault::NotFinite));
    bench.run(1.0);
    let told = bench.heard.iter().find_map(|(_, message)| match message {
        MavMessage::ODOMETRY(odometry) => Some(odometry.x.is_nan()),
        _ => None,
    });
    assert_eq!(told, Some(true));
}

#[test]
fn the_demand_is_the_setpoint_in_enu_and_flu() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.step(None);
    let demand = bench.output.unwrap().demand.unwrap();
    // The wire's identity faces north: ENU yaw 90 degrees.
    let forward = demand.world_from_body * Vec3::x();
    assert!((forward - Vec3::y()).norm() < 1e-6, "{forward:?}");
    assert!((demand.thrust.0 - 0.5).abs() < 1e-6);
}
