//! A bench for the stand-in's tests: no physics, no sockets, a step of 1 ms.

use crate::vehicle::imu::ImuSample;

use super::{Px4Config, Px4Logic, Px4Output, VehicleState};
use goshawk_autopilot::messages::*;
use goshawk_autopilot::wire::packet::Packet;
use goshawk_autopilot::{AutopilotEvent, Px4Mode};
use goshawk_core::{GRAVITY, Rot, Time, Vec3};
use mavlink::MavHeader;

const STEP_S: f64 = 1e-3;

pub(super) fn standing() -> VehicleState {
    VehicleState {
        pos_world: Vec3::zeros(),
        vel_world: Vec3::zeros(),
        world_from_body: Rot::identity(),
        ang_vel_body: Vec3::zeros(),
        imu: ImuSample { force_body: Vec3::new(0.0, 0.0, GRAVITY), ang_vel_body: Vec3::zeros() },
        on_ground: true,
        battery_fraction: 1.0,
        reset_counter: 0,
    }
}

pub(super) fn flying() -> VehicleState {
    VehicleState {
        pos_world: Vec3::new(0.0, 0.0, 3.0),
        vel_world: Vec3::new(1.0, 0.0, 0.0),
        on_ground: false,
        ..standing()
    }
}

pub(super) fn command(command: MavCmd, params: [f32; 3], component: u8) -> MavMessage {
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

pub(super) fn offboard() -> MavMessage {
    command(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 6.0, 0.0], 1)
}

pub(super) fn arm() -> MavMessage {
    command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0], 1)
}

pub(super) fn setpoint(thrust: f32, component: u8) -> MavMessage {
    MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
        q: [1.0, 0.0, 0.0, 0.0],
        thrust,
        target_system: 1,
        target_component: component,
        type_mask: AttitudeTargetTypemask::from_bits_retain(7),
        ..SET_ATTITUDE_TARGET_DATA::default()
    })
}

pub(super) struct Bench {
    pub(super) px4: Px4Logic,
    pub(super) now: Time,
    pub(super) vehicle: VehicleState,
    /// Thrust streamed at 50 Hz; none: no stream.
    pub(super) thrust: Option<f32>,
    pub(super) heard: Vec<(f64, MavMessage)>,
    pub(super) output: Option<Px4Output>,
    pub(super) steps: u64,
}

impl Bench {
    pub(super) fn new(config: Px4Config) -> Self {
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

    pub(super) fn seconds(&self) -> f64 {
        self.steps as f64 * STEP_S
    }

    pub(super) fn step(&mut self, message: Option<MavMessage>) {
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

    pub(super) fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / STEP_S).round() as u64 {
            self.step(None);
        }
    }

    /// Sends, waits for the answer; none: there was none within a second.
    pub(super) fn ask(&mut self, message: MavMessage) -> Option<MavResult> {
        let before = self.heard.len();
        self.step(Some(message));
        self.run(1.0);
        self.heard[before..].iter().find_map(|(_, message)| match message {
            MavMessage::COMMAND_ACK(ack) => Some(ack.result),
            _ => None,
        })
    }

    /// Armed and flying in OFFBOARD with a stream.
    pub(super) fn airborne(config: Px4Config) -> Self {
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

    pub(super) fn armed(&self) -> bool {
        self.output.is_some_and(|output| output.armed)
    }

    pub(super) fn mode(&self) -> Px4Mode {
        self.output.expect("stepped").mode
    }

    /// Runs until `done`, at most 15 s; how long it took, s.
    pub(super) fn until(&mut self, done: impl Fn(&Self) -> bool) -> f64 {
        let start = self.seconds();
        while !done(self) {
            self.step(None);
            assert!(self.seconds() - start < 15.0, "never happened");
        }
        self.seconds() - start
    }

    pub(super) fn events(&self) -> Vec<(f64, AutopilotEvent)> {
        self.heard
            .iter()
            .filter_map(|(stamp, message)| match message {
                MavMessage::EVENT(event) => Some((*stamp, AutopilotEvent::of(event))),
                _ => None,
            })
            .collect()
    }

    pub(super) fn heard_event(&self, event: AutopilotEvent) -> bool {
        self.events().iter().any(|(_, heard)| *heard == event)
    }
}
