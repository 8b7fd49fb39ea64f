//! The autopilot's inner loops: attitude (quaternion P, tilt before yaw) and body rate (PID), to a torque.

use goshawk_core::{Rot, Vec3};
use nalgebra::{Unit, UnitQuaternion, Vector3};

use super::parameters::LoopParameters;

/// The state of the rate loop.
#[derive(Clone, Debug, Default)]
pub(super) struct RateLoop {
    /// Angular acceleration that the integrator asks for, rad/s².
    integral: Vec3,
    /// Low-passed derivative of the measured rate, rad/s².
    derivative: Vec3,
    last_rate: Option<Vec3>,
}

impl RateLoop {
    /// Angular acceleration to ask for, rad/s². The integrator rests while `saturated`.
    pub(super) fn step(
        &mut self,
        gains: &LoopParameters,
        rate_des_body: Vec3,
        rate_body: Vec3,
        saturated: bool,
        dt_s: f64,
    ) -> Vec3 {
        let error = rate_des_body - rate_body;
        if !saturated {
            let limit = gains.integral_max_radps2;
            self.integral = (self.integral + error * (gains.rate_i * dt_s)).map(|x| x.clamp(-limit, limit));
        }
        let raw = self.last_rate.map_or_else(Vec3::zeros, |last| (rate_body - last) / dt_s);
        self.last_rate = Some(rate_body);
        let blend = 1.0 - (-dt_s * std::f64::consts::TAU * gains.rate_d_cutoff_hz).exp();
        self.derivative += (raw - self.derivative) * blend;
        error * gains.rate_p + self.integral - self.derivative * gains.rate_d
    }

    /// Forget the integrator, as an autopilot does on the ground.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }
}

/// The body rate to ask for, rad/s: the tilt error at full gain, the yaw error that is left at its own.
pub(super) fn rate_demand(gains: &LoopParameters, world_from_body: Rot, world_from_body_des: Rot) -> Vec3 {
    // The shortest rotation that points body z where it should point, yaw left as it falls.
    let z_world = world_from_body * Vector3::z();
    let z_des_world = world_from_body_des * Vector3::z();
    let tilted = UnitQuaternion::rotation_between(&z_world, &z_des_world)
        .map_or(world_from_body_des, |tilt_world| tilt_world * world_from_body);
    let yaw_left = wrap(2.0 * yaw_half(tilted.inverse() * world_from_body_des));

    let error = world_from_body.inverse() * tilted;
    let sign = if error.w < 0.0 { -2.0 } else { 2.0 };
    let tilt_rate = Vec3::new(error.i, error.j, error.k) * (sign * gains.tilt_gain);
    // The yaw axis is the desired body z, seen from the body as it is.
    let yaw_axis_body = Unit::new_normalize(world_from_body.inverse() * z_des_world);
    let yaw_rate = (yaw_left * gains.yaw_gain).clamp(-gains.yaw_rate_max_radps, gains.yaw_rate_max_radps);

    let mut rate = tilt_rate + yaw_axis_body.into_inner() * yaw_rate;
    let tilt_norm = rate.xy().norm();
    if tilt_norm > gains.tilt_rate_max_radps {
        let scale = gains.tilt_rate_max_radps / tilt_norm;
        rate.x *= scale;
        rate.y *= scale;
    }
    rate.z = rate.z.clamp(-gains.yaw_rate_max_radps, gains.yaw_rate_max_radps);
    rate
}

/// Half the angle of a rotation about z.
fn yaw_half(about_z: Rot) -> f64 {
    about_z.k.atan2(about_z.w)
}

fn wrap(angle_rad: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle_rad - turn * (angle_rad / turn).round()
}
