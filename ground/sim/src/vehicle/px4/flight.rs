//! What PX4 flies by itself: hold a position, sink, land. Plain cascaded control, good enough to be taken over by.

use super::VehicleState;
use goshawk_core::{AttitudeThrust, GRAVITY, NormalisedThrust, Rot, Vec3};
use nalgebra::{UnitQuaternion, Vector3};

const POSITION_GAIN: f64 = 0.95;
const VELOCITY_GAIN: f64 = 1.8;
const INTEGRAL_GAIN: f64 = 0.5;
const INTEGRAL_MAX_MPS2: f64 = 3.0;
const SPEED_MAX_MPS: f64 = 3.0;
const ACC_MAX_MPS2: f64 = 5.0;
const THRUST_MAX: f64 = 0.9;

/// What to fly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Aim {
    /// Stay where the mode was entered.
    Hold,
    /// Hold the horizontal position, sink at this speed, m/s; motors idle once the ground is felt.
    Land(f64),
    /// Level, sink at this speed, m/s, drifting as it may.
    SinkBlindly(f64),
}

#[derive(Clone, Debug, Default)]
pub(super) struct Flight {
    /// Position and yaw where the mode was entered.
    entered: Option<(Vec3, f64)>,
    integral: Vec3,
}

impl Flight {
    /// Another mode begins.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }

    /// Attitude and thrust for `aim`, `dt_s` after the last step.
    pub(super) fn step(
        &mut self,
        aim: Aim,
        vehicle: &VehicleState,
        hover: NormalisedThrust,
        dt_s: f64,
    ) -> AttitudeThrust {
        let (hold, yaw) = *self.entered.get_or_insert((vehicle.pos_world, yaw_of(vehicle.world_from_body)));
        if vehicle.on_ground && aim != Aim::Hold {
            return idle(vehicle);
        }
        let mut vel_des = ((hold - vehicle.pos_world) * POSITION_GAIN).cap_magnitude(SPEED_MAX_MPS);
        if let Aim::Land(sink) | Aim::SinkBlindly(sink) = aim {
            vel_des.z = -sink;
        }
        let mut error = vel_des - vehicle.vel_world;
        if matches!(aim, Aim::SinkBlindly(_)) {
            error = Vec3::new(0.0, 0.0, error.z);
        }
        let limit = INTEGRAL_MAX_MPS2;
        self.integral = (self.integral + error * (INTEGRAL_GAIN * dt_s)).map(|value| value.clamp(-limit, limit));
        let acc_des = (error * VELOCITY_GAIN + self.integral).cap_magnitude(ACC_MAX_MPS2);
        let force = acc_des + Vector3::z() * GRAVITY; // never zero: ACC_MAX is below gravity
        let tilt = UnitQuaternion::rotation_between(&Vector3::z(), &force).unwrap_or_default();
        let thrust = (hover.0 * force.norm() / GRAVITY).clamp(0.0, THRUST_MAX);
        AttitudeThrust { world_from_body: tilt * level(yaw), thrust: NormalisedThrust(thrust) }
    }
}

/// Level where it points, motors idle.
pub(super) fn idle(vehicle: &VehicleState) -> AttitudeThrust {
    AttitudeThrust { world_from_body: level(yaw_of(vehicle.world_from_body)), thrust: NormalisedThrust(0.0) }
}

fn level(yaw: f64) -> Rot {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw)
}

fn yaw_of(world_from_body: Rot) -> f64 {
    let forward = world_from_body * Vector3::x();
    forward.y.atan2(forward.x)
}
