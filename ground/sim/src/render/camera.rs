//! The pinhole camera, its pose, and its rays.

use crate::render::lanes::LANES;
use goshawk_core::{Rot, Vec3};
use nalgebra::{Matrix3, Vector3};

/// A pinhole camera with square pixels and the principal point in the middle.
///
/// Pixel centres are at +0.5; u = W/2 − f y/x and v = H/2 − f z/x for a point (x, y, z) of the camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Pixels in a row, at least 8.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Horizontal field of view, rad, in (0, π).
    pub hfov_rad: f64,
}

impl Default for Camera {
    /// 160 × 96, 90°: f = 80 px.
    fn default() -> Self {
        Self { width: 160, height: 96, hfov_rad: std::f64::consts::FRAC_PI_2 }
    }
}

impl Camera {
    /// Focal length, px.
    #[must_use]
    pub fn focal_px(&self) -> f64 {
        0.5 * self.width as f64 / (0.5 * self.hfov_rad).tan()
    }

    /// Vertical field of view, rad.
    #[must_use]
    pub fn vfov_rad(&self) -> f64 {
        2.0 * (0.5 * self.height as f64 / self.focal_px()).atan()
    }

    /// Pixel (u, v) of a point of the camera frame, also outside the image; `None` behind the camera.
    #[must_use]
    pub fn project(&self, pos_cam: &Vec3) -> Option<(f64, f64)> {
        let f = self.focal_px();
        let (cx, cy) = (0.5 * self.width as f64, 0.5 * self.height as f64);
        (pos_cam.x > 1e-6).then(|| (cx - f * pos_cam.y / pos_cam.x, cy - f * pos_cam.z / pos_cam.x))
    }

    /// The ray through image point (u, v), camera frame, with x = 1.
    #[must_use]
    pub fn ray_cam(&self, u: f64, v: f64) -> Vec3 {
        let f = self.focal_px();
        Vec3::new(1.0, (0.5 * self.width as f64 - u) / f, (0.5 * self.height as f64 - v) / f)
    }
}

/// Where the camera is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPose {
    /// The lens, world frame.
    pub pos_world: Vec3,
    /// Attitude.
    pub world_from_cam: Rot,
}

/// A camera's pose as drawing needs it.
#[derive(Debug)]
pub(super) struct View {
    pub(super) pos_world: Vec3,
    /// Columns: the camera's axes in the world.
    pub(super) world_from_cam: Matrix3<f32>,
    cam_from_world: Matrix3<f32>,
}

impl View {
    pub(super) fn new(pose: &CameraPose) -> Self {
        let world_from_cam = pose.world_from_cam.to_rotation_matrix().into_inner().cast::<f32>();
        Self { pos_world: pose.pos_world, world_from_cam, cam_from_world: world_from_cam.transpose() }
    }

    /// A point of the world in the camera frame.
    pub(super) fn to_cam(&self, p_world: &Vec3) -> Vector3<f32> {
        self.rotate_to_cam(&(p_world - self.pos_world))
    }

    /// A vector of the world in the camera frame.
    pub(super) fn rotate_to_cam(&self, v_world: &Vec3) -> Vector3<f32> {
        self.cam_from_world * v_world.cast::<f32>()
    }
}

/// Slopes y/x of the pixel columns and z/x of the rows.
#[derive(Clone, Debug)]
pub(super) struct Rays {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) focal: f32,
    /// One for each column, the last repeated up to a multiple of [`LANES`].
    pub(super) dy: Vec<f32>,
    /// One for each row.
    pub(super) dz: Vec<f32>,
    /// Half-angle tangents and 1/cos of the view's sides.
    side: [(f32, f32); 2],
}

impl Rays {
    pub(super) fn new(camera: &Camera) -> Self {
        let f = camera.focal_px();
        let slope = |n: usize, i: usize| ((0.5 * n as f64 - i.min(n - 1) as f64 - 0.5) / f) as f32;
        let side = |n: usize| {
            let tangent = 0.5 * n as f64 / f;
            (tangent as f32, (1.0 + tangent * tangent).sqrt() as f32)
        };
        Self {
            width: camera.width,
            height: camera.height,
            focal: f as f32,
            dy: (0..camera.width.next_multiple_of(LANES)).map(|u| slope(camera.width, u)).collect(),
            dz: (0..camera.height).map(|v| slope(camera.height, v)).collect(),
            side: [side(camera.width), side(camera.height)],
        }
    }

    /// Whether a sphere may reach into the view within `range` m.
    pub(super) fn may_see(&self, centre: &Vector3<f32>, radius: f32, range: f32) -> bool {
        let [(ty, sy), (tz, sz)] = self.side;
        centre.x > -radius
            && centre.norm_squared() < (range + radius) * (range + radius)
            && centre.y.abs() < centre.x * ty + radius * sy
            && centre.z.abs() < centre.x * tz + radius * sz
    }
}
