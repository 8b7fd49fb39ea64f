//! The vehicle's own link against the stand-in: real UDP on loopback, simulated time. Each step waits until the link
//! has taken all that was sent, so nothing depends on how fast the machine is.

use super::flight_tests::{hover_thrust, sensed};
use super::{LossAction, OdometryFault, Px4Config, Px4Udp};
use crate::vehicle::quadrotor::{Quadrotor, QuadrotorParameters, QuadrotorState, STEP_S};
use goshawk_autopilot::{
    Address, AutopilotEvent, AutopilotLink, Command, Firmware, FlightMode, LinkConfig, Outcome, Peer, Px4Mode,
};
use goshawk_core::{AttitudeThrust, GRAVITY, NormalisedThrust, Request, Rot, Time, Vec3};
use nalgebra::Vector3;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

const YAW: f64 = 0.7;

pub(super) struct Bench {
    pub(super) px4: Px4Udp,
    quadrotor: Quadrotor,
    pub(super) link: AutopilotLink,
    clock: Arc<AtomicU64>,
    sent: u64,
    /// Height to hover at by setpoints every 5 ms; none: no stream.
    pub(super) height: Option<f64>,
    /// Turn, pitch and roll about while hovering.
    lively: bool,
    /// The last second's true states.
    truth: VecDeque<(Time, QuadrotorState)>,
    pub(super) steps: u64,
}

impl Bench {
    pub(super) fn new(config: Px4Config) -> Self {
        Self::with_link(config, |_| {})
    }

    fn with_link(config: Px4Config, change: impl Fn(&mut LinkConfig)) -> Self {
        let anywhere = "127.0.0.1:0".parse().unwrap();
        let clock = Arc::new(AtomicU64::new(Time::from_secs(1000.0).0));
        let mut link_config = LinkConfig::customary(anywhere);
        change(&mut link_config);
        let for_link = Arc::clone(&clock);
        let link = AutopilotLink::open(link_config, move || Time(for_link.load(Ordering::SeqCst))).unwrap();
        let parameters = QuadrotorParameters::default();
        let config = Px4Config { hover_thrust: parameters.hover_thrust, ..config };
        Self {
            px4: Px4Udp::open(config, anywhere, Some(link.local_address().unwrap())).unwrap(),
            quadrotor: Quadrotor::new(parameters, Vec3::new(5.0, -3.0, 0.06), YAW),
            link,
            clock,
            sent: 0,
            height: None,
            lively: false,
            truth: VecDeque::new(),
            steps: 0,
        }
    }

    pub(super) fn now(&self) -> Time {
        Time(self.clock.load(Ordering::SeqCst))
    }

    pub(super) fn status(&self) -> goshawk_autopilot::Status {
        self.link.status(self.now())
    }

    pub(super) fn step(&mut self) {
        let now = self.now().plus(STEP_S);
        self.clock.store(now.0, Ordering::SeqCst);
        if let Some(height) = self.height.filter(|_| self.steps.is_multiple_of(5)) {
            let setpoint = AttitudeThrust {
                world_from_body: self.attitude(),
                thrust: NormalisedThrust(hover_thrust(&self.quadrotor, height)),
            };
            self.link.send_setpoint(&setpoint).unwrap();
        }
        let output = self.px4.poll(now, &sensed(&self.quadrotor));
        self.truth.push_back((now, *self.quadrotor.state()));
        if self.truth.len() > 1000 {
            self.truth.pop_front();
        }
        self.quadrotor.step(STEP_S, output.demand.as_ref(), Vec3::zeros(), |_, _| 0.0);
        self.sent += self.px4.outgoing.len() as u64;
        self.steps += 1;
        let patience = Instant::now() + Duration::from_secs(20);
        loop {
            let counters = self.status().counters;
            if counters.received + counters.foreign + counters.strangers == self.sent {
                return;
            }
            assert!(Instant::now() < patience, "the link took {counters:?} of {} packets", self.sent);
            std::thread::yield_now();
        }
    }

    fn attitude(&self) -> Rot {
        let t = if self.lively { self.steps as f64 * STEP_S } else { 0.0 };
        let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
        let pitch = if self.lively { 0.1 + 0.25 * (3.0 * t).sin() } else { 0.0 };
        Rot::from_axis_angle(&z, YAW + 0.8 * (1.7 * t).sin())
            * Rot::from_axis_angle(&y, pitch)
            * Rot::from_axis_angle(&x, 0.2 * (2.5 * t).sin())
    }

    /// The true state at `stamp`, to the step.
    fn truth_at(&self, stamp: Time) -> QuadrotorState {
        self.truth.iter().min_by_key(|(time, _)| time.0.abs_diff(stamp.0)).unwrap().1
    }

    pub(super) fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / STEP_S) as u64 {
            self.step();
        }
    }

    pub(super) fn until(&mut self, what: &str, done: impl Fn(&Self) -> bool) -> f64 {
        let start = self.steps;
        while !done(self) {
            self.step();
            assert!(self.steps - start < 20_000, "not within 20 s: {what}: {:?}", self.status());
        }
        (self.steps - start) as f64 * STEP_S
    }

    /// The outcome of what is asked.
    pub(super) fn ask(&mut self, command: Command) -> Outcome {
        let _ = self.link.take_acks();
        self.link.command(command);
        for _ in 0..3000 {
            self.step();
            if let Some(ack) = self.link.take_acks().into_iter().find(|ack| ack.command == command) {
                return ack.outcome;
            }
        }
        panic!("{command} was never settled");
    }

    pub(super) fn airborne(config: Px4Config) -> Self {
        let mut bench = Self::new(config);
        bench.until("connected", |bench| bench.status().connected);
        bench.height = Some(-10.0); // idle
        bench.run(0.2);
        assert_eq!(bench.ask(Firmware::Px4.command(Request::Offboard)), Outcome::Accepted);
        assert_eq!(bench.ask(Firmware::Px4.command(Request::Arm)), Outcome::Accepted);
        bench.height = Some(2.0);
        bench.run(3.0);
        assert!(bench.status().armed && bench.status().offboard);
        assert_eq!(bench.status().landed, Some(false));
        assert!((bench.quadrotor.state().pos_world.z - 2.0).abs() < 0.3);
        bench
    }
}

#[test]
fn the_link_connects_raises_its_streams_and_reads_the_true_motion() {
    let mut bench = Bench::airborne(Px4Config::default());
    assert_eq!(bench.status().mode, Some(FlightMode::Px4(Px4Mode::Offboard)));
    assert_eq!(bench.status().intended_mode, Some(FlightMode::Px4(Px4Mode::Offboard)));
    bench.lively = true;
    bench.run(1.0);
    let (mut fastest, mut turning) = (0.0_f64, Vec3::zeros());
    let mut stamps = Vec::new();
    for _ in 0..1000 {
        let odometry = bench.link.odometry().unwrap();
        let age = bench.now().since(odometry.stamp);
        assert!((0.0..0.016).contains(&age), "age {age}");
        let truth = bench.truth_at(odometry.stamp);
        assert!((odometry.pos_world - truth.pos_world).norm() < 0.01);
        assert!((odometry.vel_world - truth.vel_world).norm() < 0.03);
        assert!(odometry.world_from_body.angle_to(&truth.world_from_body) < 0.01);
        assert!((odometry.ang_vel_body - truth.ang_vel_body).norm() < 0.1, "{odometry:?} {truth:?}");
        let imu = bench.link.imu().unwrap();
        let truth = bench.truth_at(imu.stamp);
        let force_body = truth.world_from_body.inverse() * (truth.acc_world + Vector3::z() * GRAVITY);
        assert!((imu.specific_force_body - force_body).norm() < 0.5, "{imu:?} {force_body:?}");
        fastest = fastest.max(odometry.vel_world.xy().norm());
        turning = turning.sup(&odometry.ang_vel_body.abs());
        stamps.push(odometry.stamp);
        bench.step();
    }
    assert!(fastest > 0.5 && turning.min() > 0.2, "it moves about each axis: {fastest} {turning:?}");
    stamps.dedup();
    assert!((95..=105).contains(&stamps.len()), "raised to 100 Hz: {}", stamps.len());
    assert!(bench.status().round_trip_s.is_some_and(|trip| trip < 0.003), "{:?}", bench.status());
    assert_eq!(bench.status().counters.lost, 0);
    assert!(bench.status().battery_fraction.is_some_and(|left| left > 0.9));
}

#[test]
fn handing_back_lands_and_disarms() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.link.request(Request::HandBack);
    bench.height = None;
    bench.until("land mode", |bench| bench.status().mode == Some(FlightMode::Px4(Px4Mode::Land)));
    assert!(!bench.status().failsafe, "it was asked for");
    bench.until("landed", |bench| bench.status().landed == Some(true));
    bench.until("disarmed", |bench| !bench.status().armed);
    assert!(bench.quadrotor.state().on_ground);
}

#[test]
fn a_refused_arming_says_so() {
    let mut bench = Bench::new(Px4Config::default());
    bench.until("connected", |bench| bench.status().connected);
    assert_eq!(bench.ask(Firmware::Px4.command(Request::Offboard)), Outcome::Accepted);
    assert_eq!(bench.ask(Firmware::Px4.command(Request::Arm)), Outcome::TemporarilyRejected);
    assert!(!bench.status().armed);
}

#[test]
fn disarming_in_the_air_is_refused() {
    let mut bench = Bench::airborne(Px4Config::default());
    assert_eq!(bench.ask(Firmware::Px4.command(Request::Disarm)), Outcome::TemporarilyRejected);
    assert!(bench.status().armed);
}

#[test]
fn a_lost_stream_is_known_at_once_and_mends_by_itself() {
    let config = Px4Config { loss_s: 0.3, loss_action: LossAction::Hold, ..Px4Config::default() };
    let mut bench = Bench::airborne(config);
    let _ = bench.link.take_events();
    bench.height = None;
    let took = bench.until("failsafe", |bench| bench.status().failsafe);
    assert!((0.345..0.365).contains(&took), "{took}");
    assert!(!bench.status().offboard);
    assert!(bench.link.take_events().iter().any(|(_, event)| *event == AutopilotEvent::FailsafeEntered));
    bench.run(0.2);
    assert_eq!(bench.status().mode, Some(FlightMode::Px4(Px4Mode::Hold)));
    bench.height = Some(2.0);
    let took = bench.until("offboard", |bench| bench.status().offboard);
    assert!(took < 0.15, "40 ms and CURRENT_MODE's 100: {took}");
}

#[test]
fn a_pilot_who_takes_over_is_no_failsafe() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.px4.logic.pilot_takes_over(Px4Mode::Position);
    let took = bench.until("not ours", |bench| !bench.status().offboard);
    assert!(took <= 0.11, "{took}");
    bench.run(2.0);
    let status = bench.status();
    assert!(!status.failsafe && !status.offboard && status.armed, "{status:?}");
}

#[test]
fn silent_odometry_grows_old_and_a_number_that_is_none_is_not_passed_on() {
    let mut bench = Bench::airborne(Px4Config::default());
    bench.px4.logic.set_odometry_fault(Some(OdometryFault::Silent));
    let before = bench.link.odometry().unwrap().stamp;
    bench.run(1.0);
    assert!(bench.link.odometry().unwrap().stamp.since(before) < 0.02);
    assert!(bench.status().connected, "the heartbeat goes on");
    bench.px4.logic.set_odometry_fault(Some(OdometryFault::NotFinite));
    bench.run(0.5);
    assert!(bench.link.odometry().unwrap().stamp.since(before) < 0.02);
    assert!(bench.status().counters.not_finite > 10);
}

#[test]
fn a_wrong_target_component_hears_nothing_and_gets_no_answer() {
    let mut bench = Bench::with_link(Px4Config::default(), |config| {
        config.target_component = 2;
        config.address = Address::UdpOut("127.0.0.1:9".to_owned());
    });
    bench.run(2.0);
    assert!(!bench.status().connected);
    assert!(bench.status().counters.strangers > 0);
    assert_eq!(bench.ask(Firmware::Px4.command(Request::Arm)), Outcome::NoAnswer);
}

#[test]
fn a_stranger_does_not_become_the_peer_and_garbage_is_counted() {
    let mut bench = Bench::airborne(Px4Config::default());
    let stranger = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let before = bench.status().counters.strangers; // what came before its first heartbeat
    let there = bench.link.local_address().unwrap();
    stranger.send_to(&[0x55; 300], there).unwrap();
    stranger.send_to(&[0xFD, 200, 0, 0, 1, 2, 3], there).unwrap();
    let heartbeat = goshawk_autopilot::wire::encode::Encoder::new(1, 1).encode(
        &goshawk_autopilot::messages::MavMessage::HEARTBEAT(goshawk_autopilot::messages::HEARTBEAT_DATA::default()),
    );
    stranger.send_to(heartbeat.raw_bytes(), there).unwrap();
    bench.sent += 1; // counted as a stranger's
    bench.run(1.0);
    let counters = bench.status().counters;
    assert_eq!((counters.strangers - before, counters.garbage, counters.truncated), (1, 1, 1), "{counters:?}");
    assert_eq!(bench.link.peer(), Some(Peer::Udp(bench.px4.local_address().unwrap())));
    assert!(bench.status().offboard);
}
