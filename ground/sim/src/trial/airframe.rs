//! The simulated airframe and camera of a vehicle file: what the file says where it says it, the paper's vehicle
//! elsewhere.

use goshawk_air::config::Vehicle;
use goshawk_core::types::{NormalisedThrust, Rot, Vec3};

use crate::quadrotor::{QuadrotorParameters, QuadrotorState};
use crate::render::{Camera, CameraPose};
use crate::sensor::Motion;

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

/// The airframe of a vehicle file: its mass and hover thrust, the paper's thrust-to-weight, rotors and drag.
#[must_use]
pub fn airframe(vehicle: &Vehicle) -> QuadrotorParameters {
    QuadrotorParameters {
        mass_kg: vehicle.airframe.mass_kg,
        hover_thrust: NormalisedThrust(vehicle.airframe.hover_thrust),
        ..QuadrotorParameters::default()
    }
}
