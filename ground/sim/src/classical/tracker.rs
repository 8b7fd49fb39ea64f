//! Position control: holds the vehicle to the reference trajectory and turns it into attitude and thrust by the core's
//! flatness, with the core's limits, lead and disturbance observer.

use goshawk_core::control::flatness::flat_command;
use goshawk_core::control::lead::lead;
use goshawk_core::control::motion::{Commanded, Motion};
use goshawk_core::values::geometry::cap;
use goshawk_core::{
    AttitudeThrust, ControllerConfig, ControllerOutput, FlatState, Mode, NormalisedThrust, Odometry, Time, Vec3,
};

/// Acceleration for an error of position, 1/s², and of velocity, 1/s, and the most of both, m/s².
const POSITION_GAIN: f64 = 5.0;
const VELOCITY_GAIN: f64 = 4.0;
const FEEDBACK_MPS2: f64 = 5.0;

/// The reference at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// Position, velocity, acceleration, world frame.
    pub flat: FlatState,
    /// m/s³.
    pub jerk: Vec3,
}

/// Follows references.
#[derive(Clone, Debug)]
pub struct Tracker {
    config: ControllerConfig,
    motion: Motion,
    commanded: Commanded,
    /// On the ground: the thrust last tried.
    spooled: Option<NormalisedThrust>,
}

/// The motion carried on to `now` at its velocity.
#[must_use]
pub fn carried(odometry: &Odometry, now: Time) -> Vec3 {
    odometry.pos_world + odometry.vel_world * now.since(odometry.stamp).clamp(0.0, 0.1)
}

impl Tracker {
    /// A tracker for a vehicle.
    #[must_use]
    pub fn new(config: ControllerConfig) -> Self {
        Self { motion: config.motion(), config, commanded: Commanded::default(), spooled: None }
    }

    /// A state estimate has come: the observer learns from it.
    pub fn take_odometry(&mut self, odometry: &Odometry) {
        self.motion.take(odometry, &self.commanded);
    }

    /// Replaces what the controller commands. It goes on deciding what to do and where to look; the observer here is the
    /// one that knows what was really commanded. `reference`: to be followed; none: the controller's own acceleration.
    pub fn command(&mut self, now: Time, reference: Option<&Reference>, output: &mut ControllerOutput) {
        let on_ground = matches!(output.mode, Mode::Takeoff) && output.acc_disturbance_world == Vec3::zeros();
        if output.thrust.0 <= 0.0 || on_ground {
            self.motion.rest();
            self.commanded = Commanded::default();
            self.spooled = output.setpoint.map(|setpoint| setpoint.thrust);
            return;
        }
        if let Some(thrust) = self.spooled.take() {
            self.motion.lift_off(thrust);
        }
        let Some(odometry) = self.motion.last().copied() else { return };
        let mut acc_world = output.acc_des_world;
        if let Some(Reference { flat, jerk }) = reference {
            let position = (flat.pos - carried(&odometry, now)) * POSITION_GAIN;
            let feedback = cap(position + (flat.vel - odometry.vel_world) * VELOCITY_GAIN, FEEDBACK_MPS2);
            output.flat = *flat;
            output.acc_des_world = flat.acc + feedback;
            acc_world = lead(&self.config.lead, self.motion.attitude_lag(), output.acc_des_world, *jerk);
        }
        let observer = self.motion.observer();
        let vehicle = self.motion.vehicle(&self.config.airframe);
        let command = flat_command(&vehicle, acc_world, observer.disturbance(), output.yaw_des);
        let thrust = vehicle.normalised(command.force_along(&vehicle, &odometry.world_from_body));
        output.setpoint = Some(AttitudeThrust { world_from_body: command.world_from_body, thrust });
        output.acc_att_world = command.acc_att_world;
        output.acc_disturbance_world = observer.disturbance();
        output.thrust = vehicle.force(thrust);
        output.hover_thrust = vehicle.hover_thrust;
        output.attitude_lag = self.motion.attitude_lag();
        let free = output.mode != Mode::Stopping;
        // The baseline believes its odometry whatever it says.
        self.commanded = Commanded { thrust, acc: output.thrust.0 / vehicle.mass_kg, free, airborne: false };
        self.motion.command(now, &command.world_from_body);
    }
}
