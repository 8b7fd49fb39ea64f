//! What the core must know of the camera and of the policy.

use crate::policy::state::StateLayout;
use crate::values::types::{Rot, Task, Vec3};

/// The camera as mounted, and the image that the network sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraModel {
    /// Horizontal field of view, rad.
    pub hfov: f64,
    /// Vertical field of view, rad.
    pub vfov: f64,
    /// Network image width, px.
    pub width: u32,
    /// Network image height, px.
    pub height: u32,
    /// Mounting attitude; a camera tilted up by `tilt` is `Ry(-tilt)`.
    pub body_from_cam: Rot,
    /// Lens position in the body frame, m.
    pub pos_cam_body: Vec3,
}

/// What the policy's contract says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolicyModel {
    /// What it was trained for.
    pub task: Task,
    /// What its `state` input holds.
    pub state: StateLayout,
    /// r of eq. 3, m.
    pub radius: f64,
    /// d_phi of eq. 6, rad.
    pub azimuth_offset: f64,
    /// d_theta of eq. 6, rad.
    pub elevation_offset: f64,
    /// Largest speed in training, m/s.
    pub v_max: f64,
    /// Largest acceleration in training, m/s².
    pub a_max: f64,
    /// Metres for one unit of softplus(y_d).
    pub target_depth_scale: f64,
    /// How far apart the costs of an image's candidates are; what the planner adds to them is a multiple of it.
    pub cost_scale: f64,
    /// Horizontal field of view of the training images, rad.
    pub hfov: f64,
    /// Vertical field of view of the training images, rad.
    pub vfov: f64,
    /// Network image width, px.
    pub width: u32,
    /// Network image height, px.
    pub height: u32,
}
