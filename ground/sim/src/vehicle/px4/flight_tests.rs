//! The modes that the stand-in flies itself, on the simulated quadrotor.

use super::bench::standing;
use super::{LossAction, Px4Config, Px4Logic, VehicleState};
use crate::vehicle::imu::ImuSample;
use crate::vehicle::quadrotor::{Quadrotor, QuadrotorParameters, STEP_S};
use goshawk_autopilot::Px4Mode;
use goshawk_autopilot::messages::{
    AttitudeTargetTypemask, COMMAND_LONG_DATA, MavCmd, MavMessage, SET_ATTITUDE_TARGET_DATA,
};
use goshawk_autopilot::wire::packet::Packet;
use goshawk_core::{Time, Vec3};
use mavlink::MavHeader;

pub(super) fn sensed(quadrotor: &Quadrotor) -> VehicleState {
    let state = quadrotor.state();
    VehicleState {
        pos_world: state.pos_world,
        vel_world: state.vel_world,
        world_from_body: state.world_from_body,
        ang_vel_body: state.ang_vel_body,
        imu: ImuSample::ideal(state),
        on_ground: state.on_ground,
        battery_fraction: quadrotor.battery_fraction(),
        ..standing()
    }
}

/// Thrust that climbs to `height` and hovers, for a level vehicle.
pub(super) fn hover_thrust(quadrotor: &Quadrotor, height: f64) -> f64 {
    let state = quadrotor.state();
    let hover = quadrotor.parameters().hover_thrust.0;
    (hover * (1.02 + 0.5 * (height - state.pos_world.z).clamp(-1.0, 1.0) - 0.4 * state.vel_world.z)).clamp(0.2, 0.8)
}

struct Flown {
    px4: Px4Logic,
    quadrotor: Quadrotor,
    now: Time,
}

impl Flown {
    /// At 3 m in OFFBOARD, tilted so that it drifts at about 1 m/s.
    fn airborne(loss_action: LossAction) -> Self {
        let parameters = QuadrotorParameters::default();
        let config =
            Px4Config { loss_s: 0.5, loss_action, hover_thrust: parameters.hover_thrust, ..Px4Config::default() };
        let quadrotor = Quadrotor::new(parameters, Vec3::new(0.0, 0.0, 0.06), 0.3);
        let mut flown = Self { px4: Px4Logic::new(config), quadrotor, now: Time::from_secs(9.0) };
        let command = |command, param1, param2| {
            MavMessage::COMMAND_LONG(COMMAND_LONG_DATA { command, param1, param2, ..COMMAND_LONG_DATA::default() })
        };
        flown.stream(0.3, 0.0);
        flown.step(Some(command(MavCmd::MAV_CMD_DO_SET_MODE, 1.0, 6.0)));
        flown.step(Some(command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0)));
        flown.stream(4.0, 0.0);
        flown.stream(1.0, 0.1);
        assert!((flown.height() - 3.0).abs() < 0.5, "{}", flown.height());
        assert!(flown.quadrotor.state().vel_world.xy().norm() > 0.5);
        flown
    }

    fn height(&self) -> f64 {
        self.quadrotor.state().pos_world.z
    }

    fn step(&mut self, message: Option<MavMessage>) -> (bool, Px4Mode) {
        let header = MavHeader { system_id: 1, component_id: 191, sequence: 0 };
        let packets: Vec<Packet> = message.into_iter().map(|message| Packet { header, message }).collect();
        let output = self.px4.step(self.now, &packets, &sensed(&self.quadrotor), &mut Vec::new());
        self.quadrotor.step(STEP_S, output.demand.as_ref(), Vec3::zeros(), |_, _| 0.0);
        self.now = self.now.plus(STEP_S);
        (output.armed, output.mode)
    }

    /// Level but for a nose-down `pitch`, facing north, at 3 m.
    fn stream(&mut self, seconds: f64, pitch: f64) {
        for _ in 0..(seconds / STEP_S) as u64 {
            let half = -pitch / 2.0;
            let setpoint = MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
                q: [half.cos() as f32, 0.0, half.sin() as f32, 0.0],
                thrust: hover_thrust(&self.quadrotor, 3.0) as f32,
                type_mask: AttitudeTargetTypemask::from_bits_retain(7),
                ..SET_ATTITUDE_TARGET_DATA::default()
            });
            self.step(Some(setpoint));
        }
    }

    fn alone(&mut self, seconds: f64) {
        for _ in 0..(seconds / STEP_S) as u64 {
            self.step(None);
        }
    }
}

#[test]
fn left_alone_with_land_it_lands_and_disarms() {
    let mut flown = Flown::airborne(LossAction::Land);
    let mut touch_speed = 0.0;
    for _ in 0..20_000 {
        let falling = -flown.quadrotor.state().vel_world.z;
        let (armed, _) = flown.step(None);
        if flown.quadrotor.state().on_ground && touch_speed == 0.0 {
            touch_speed = falling;
        }
        if !armed {
            assert!((0.3..1.0).contains(&touch_speed), "touched down at {touch_speed} m/s");
            assert!(flown.px4.landed());
            return;
        }
    }
    panic!("still armed at {} m", flown.height());
}

#[test]
fn left_alone_with_hold_it_stops_and_stays() {
    let mut flown = Flown::airborne(LossAction::Hold);
    flown.alone(8.0);
    let before = flown.quadrotor.state().pos_world;
    flown.alone(5.0);
    let after = flown.quadrotor.state();
    assert!((after.pos_world - before).norm() < 0.2, "{before:?} {after:?}");
    assert!(after.vel_world.norm() < 0.1);
}

#[test]
fn left_alone_with_the_default_it_sinks_blindly_at_0_6_to_1_mps() {
    let mut flown = Flown::airborne(LossAction::Position);
    flown.alone(2.5);
    let (_, mode) = flown.step(None);
    assert_eq!(mode, Px4Mode::Position);
    let state = flown.quadrotor.state();
    assert!((0.6..1.0).contains(&-state.vel_world.z), "sinks at {} m/s", -state.vel_world.z);
    assert!(state.vel_world.xy().norm() > 0.05, "nothing stops its drift but drag");
}

#[test]
fn a_pilot_who_takes_over_hovers() {
    let mut flown = Flown::airborne(LossAction::Land);
    flown.px4.pilot_takes_over(Px4Mode::Position);
    flown.alone(8.0);
    let state = flown.quadrotor.state();
    assert!(state.vel_world.norm() < 0.1 && !state.on_ground, "{state:?}");
}
