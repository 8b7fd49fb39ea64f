//! The simulated airframe and camera of a vehicle file: what the file says where it says it, the paper's vehicle
//! elsewhere.

use goshawk_core::{NormalisedThrust, Rot, Vec3};
use goshawk_vehicle::config::Vehicle;

use crate::vehicle::quadrotor::{QuadrotorParameters, QuadrotorState};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::render::{Camera, CameraPose};
use crate::sense::rgbd::Motion;

/// Radius of the sphere that must not touch anything, m.
pub const BODY_RADIUS_M: f64 = 0.16;

/// The camera as mounted on the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// The image.
    pub camera: Camera,
    /// Attitude of the camera on the body.
    pub body_from_cam: Rot,
    /// The lens, body frame, m.
    pub pos_cam_body: Vec3,
}

impl Mount {
    /// The mount that a vehicle file describes; 160 × 96 px.
    #[must_use]
    pub fn of(vehicle: &Vehicle) -> Self {
        let camera = Camera { hfov_rad: vehicle.camera.hfov_deg.to_radians(), ..Camera::default() };
        Self {
            camera,
            body_from_cam: Rot::from_axis_angle(&Vec3::y_axis(), -vehicle.camera.tilt_deg.to_radians()),
            pos_cam_body: Vec3::from(vehicle.camera.position_m),
        }
    }

    /// How the camera moves when the vehicle is at `state`.
    #[must_use]
    pub fn motion(&self, state: &QuadrotorState) -> Motion {
        let cam_from_body = self.body_from_cam.inverse();
        let vel_body = state.world_from_body.inverse_transform_vector(&state.vel_world);
        Motion {
            vel_cam: cam_from_body * (vel_body + state.ang_vel_body.cross(&self.pos_cam_body)),
            ang_vel_cam: cam_from_body * state.ang_vel_body,
        }
    }

    /// Where the camera is when the vehicle is at `state`.
    #[must_use]
    pub fn pose(&self, state: &QuadrotorState) -> CameraPose {
        CameraPose {
            pos_world: state.pos_world + state.world_from_body * self.pos_cam_body,
            world_from_cam: state.world_from_body * self.body_from_cam,
        }
    }
}

/// The motors lift `factor` times the weight that they lifted: a stronger motor hovers at less, and the curve from
/// normalised thrust to force keeps its shape.
pub(super) fn motors_lift(vehicle: &mut QuadrotorParameters, factor: f64) {
    let hover = vehicle.hover_thrust.0 * factor.powf(-1.0 / vehicle.thrust_exponent());
    vehicle.thrust_to_weight *= factor;
    vehicle.hover_thrust = NormalisedThrust(hover.clamp(0.05, 0.9));
}

/// An airframe that differs from `nominal` as one vehicle does from its data sheet: mass, thrust, rotor lag, drag,
/// inertia, and the inner loops' gains each off by a factor e^(`spread` · n), n drawn from a normal distribution cut at 2.
#[must_use]
pub fn spread(nominal: &QuadrotorParameters, spread: f64, seed: u64) -> QuadrotorParameters {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut factor = || (spread * rng.sample::<f64, _>(StandardNormal).clamp(-2.0, 2.0)).exp();
    let mut vehicle = nominal.clone();
    vehicle.mass_kg *= factor();
    let thrust = factor() * nominal.mass_kg / vehicle.mass_kg;
    motors_lift(&mut vehicle, thrust);
    vehicle.rotor_lag_s *= factor();
    vehicle.rotor_drag_npmps *= factor();
    vehicle.body_drag_npmps2 *= factor();
    vehicle.inertia_kgm2 *= factor();
    vehicle.loops.tilt_gain *= factor();
    vehicle.loops.rate_p *= factor();
    vehicle
}

/// The airframe of a vehicle file: its mass and hover thrust, the paper's thrust-to-weight, rotors and drag.
#[must_use]
pub fn airframe(vehicle: &Vehicle) -> QuadrotorParameters {
    QuadrotorParameters {
        mass_kg: vehicle.airframe.mass_kg,
        hover_thrust: NormalisedThrust(vehicle.airframe.hover_thrust),
        ..QuadrotorParameters::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_vehicle_hovers_where_it_says_and_no_spread_changes_nothing() {
        let nominal = QuadrotorParameters::default();
        assert_eq!(spread(&nominal, 0.0, 3), nominal);
        for seed in 0..20 {
            let vehicle = spread(&nominal, 0.15, seed);
            assert_ne!(vehicle, nominal);
            let hover = vehicle.force(vehicle.hover_thrust).0;
            assert!((hover / vehicle.weight().0 - 1.0).abs() < 1e-9, "seed {seed}: {hover}");
            assert!((vehicle.thrust_exponent() - nominal.thrust_exponent()).abs() < 1e-9, "seed {seed}");
        }
    }
}
