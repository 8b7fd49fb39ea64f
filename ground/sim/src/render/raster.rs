//! Solids into the depth buffer. The inner loops are branch-free over one row, so that they vectorise.

use super::bounds::{Rect, Slopes, box_slopes, ellipsoid_slopes, hull, sphere_slopes};
use super::camera::{CameraPose, Rays};
use super::{NEAR_M, RANGE_M};
use crate::world::{Cuboid, RoundCone, Spheroid};
use goshawk_core::types::Vec3;
use nalgebra::{Matrix3, Vector3};

type V3 = Vector3<f32>;

/// A round cone in the camera frame. See [`RoundCone`] for the equations; here the ray starts at the origin.
pub(super) struct ViewCone {
    a: V3,
    b: V3,
    radius_a: f32,
    radius_b: f32,
    axis: V3,
    length: f32,
    taper: f32,
}

impl ViewCone {
    pub(super) fn new(cone: &RoundCone, pose: &CameraPose) -> Self {
        let (a, b) = (pose.to_cam(&cone.a), pose.to_cam(&cone.b));
        let length = (b - a).norm();
        let (radius_a, radius_b) = (cone.radius_a as f32, cone.radius_b as f32);
        Self { a, b, radius_a, radius_b, axis: (b - a) / length, length, taper: (radius_a - radius_b) / length }
    }

    fn slopes_at(&self, fraction: f32) -> Option<[Slopes; 2]> {
        let radius = self.radius_a + (self.radius_b - self.radius_a) * fraction;
        sphere_slopes(&(self.a + (self.b - self.a) * fraction), radius)
    }
}

/// A spheroid in the camera frame: the points p with (p − c)ᵀ M (p − c) = 1.
pub(super) struct ViewSpheroid {
    centre: V3,
    form: Matrix3<f32>,
    spread: Matrix3<f32>,
    radius: f32,
}

impl ViewSpheroid {
    pub(super) fn new(spheroid: &Spheroid, pose: &CameraPose) -> Self {
        let up = pose.rotate_to_cam(&Vec3::z());
        let (xy2, z2) =
            ((spheroid.radius_xy * spheroid.radius_xy) as f32, (spheroid.radius_z * spheroid.radius_z) as f32);
        let upward = up * up.transpose();
        Self {
            centre: pose.to_cam(&spheroid.centre),
            form: Matrix3::identity() / xy2 + upward * (1.0 / z2 - 1.0 / xy2),
            spread: Matrix3::identity() * xy2 + upward * (z2 - xy2),
            radius: xy2.max(z2).sqrt(),
        }
    }
}

/// A box in the camera frame.
pub(super) struct ViewCuboid {
    /// Rows: the box's axes in the camera frame.
    axes: Matrix3<f32>,
    /// The camera, along the box's axes from its centre.
    eye: V3,
    half: V3,
}

impl ViewCuboid {
    pub(super) fn new(cuboid: &Cuboid, pose: &CameraPose) -> Self {
        let axis = |v: Vec3| pose.rotate_to_cam(&cuboid.turn_out(&v)).transpose();
        let axes = Matrix3::from_rows(&[axis(Vec3::x()), axis(Vec3::y()), axis(Vec3::z())]);
        let eye = cuboid.turn_in(&(pose.pos_world - cuboid.centre)).cast::<f32>();
        Self { axes, eye, half: cuboid.half.cast::<f32>() }
    }

    fn corners(&self) -> [V3; 8] {
        std::array::from_fn(|i| {
            let sign = |bit: usize, half: f32| if i & bit == 0 { -half } else { half };
            let corner = V3::new(sign(1, self.half.x), sign(2, self.half.y), sign(4, self.half.z));
            self.axes.tr_mul(&(corner - self.eye))
        })
    }
}

/// The depth buffer and the ids that go with it.
pub(super) struct Canvas<'a> {
    pub(super) rays: &'a Rays,
    pub(super) depth: &'a mut [f32],
    pub(super) ids: &'a mut [u32],
}

impl Canvas<'_> {
    /// Draws a round cone; `base_cap`: also the sphere about its end `a`.
    pub(super) fn cone(&mut self, cone: &ViewCone, id: u32, base_cap: bool) {
        // Short stretches have tight rectangles even when the axis runs across the image.
        let nearest = cone.a.norm().min(cone.b.norm()).min(((cone.a + cone.b) * 0.5).norm());
        let stretches = (cone.length / (0.25 + 0.12 * nearest)).ceil().clamp(1.0, 12.0) as usize;
        let mut below = cone.slopes_at(0.0);
        for index in 0..stretches {
            let above = cone.slopes_at((index + 1) as f32 / stretches as f32);
            if let Some(rect) = self.rays.rect(hull(below, above)) {
                self.cone_side(cone, id, rect);
            }
            below = above;
        }
        self.sphere(&cone.b, cone.radius_b, id);
        if base_cap {
            self.sphere(&cone.a, cone.radius_a, id);
        }
    }

    fn row(&mut self, v: usize, rect: Rect) -> impl Iterator<Item = (&f32, (&mut f32, &mut u32))> {
        let (first, last) = (v * self.rays.width + rect.u0, v * self.rays.width + rect.u1);
        let pixels = self.depth[first..last].iter_mut().zip(self.ids[first..last].iter_mut());
        self.rays.dy[rect.u0..rect.u1].iter().zip(pixels)
    }

    fn cone_side(&mut self, cone: &ViewCone, id: u32, rect: Rect) {
        let (a, n, k, r) = (cone.a, cone.axis, cone.taper, cone.radius_a);
        let c2 = 1.0 - k * k;
        let y0 = -n.dot(&a);
        let qc = c2 * a.norm_squared() - y0 * y0 + 2.0 * r * k * y0 - r * r;
        let (low, high) = (k * r, k * r + c2 * cone.length);
        for v in rect.v0..rect.v1 {
            let dz = self.rays.dz[v];
            let (d2_row, nd_row, ad_row) = (1.0 + dz * dz, n.x + n.z * dz, a.x + a.z * dz);
            for (&dy, (depth, pixel)) in self.row(v, rect) {
                let nd = nd_row + n.y * dy;
                let qa = c2 * (d2_row + dy * dy) - nd * nd;
                let qb = (r * k - y0) * nd - c2 * (ad_row + a.y * dy);
                let disc = qb * qb - qa * qc;
                let t = (-qb - disc.max(0.0).sqrt()) / qa;
                let y = y0 + t * nd;
                let hit = (disc >= 0.0) & (y >= low) & (y <= high) & (t > NEAR_M) & (t < *depth);
                *depth = if hit { t } else { *depth };
                *pixel = if hit { id } else { *pixel };
            }
        }
    }

    fn sphere(&mut self, centre: &V3, radius: f32, id: u32) {
        if !self.rays.may_see(centre, radius, RANGE_M) {
            return;
        }
        let Some(rect) = self.rays.rect(sphere_slopes(centre, radius)) else { return };
        let qc = centre.norm_squared() - radius * radius;
        self.quadric(rect, id, &Matrix3::identity(), centre, qc);
    }

    /// Draws a box.
    pub(super) fn cuboid(&mut self, cuboid: &ViewCuboid, id: u32) {
        let Some(rect) = self.rays.rect(box_slopes(&cuboid.corners(), NEAR_M)) else { return };
        let (axes, low, high) = (&cuboid.axes, -cuboid.half - cuboid.eye, cuboid.half - cuboid.eye);
        for v in rect.v0..rect.v1 {
            let start = axes.column(0) + axes.column(2) * self.rays.dz[v];
            let across = axes.column(1).into_owned();
            for (&dy, (depth, pixel)) in self.row(v, rect) {
                let (mut enter, mut leave) = (NEAR_M, f32::INFINITY);
                for axis in 0..3 {
                    let inverse = 1.0 / (start[axis] + across[axis] * dy);
                    let (a, b) = (low[axis] * inverse, high[axis] * inverse);
                    enter = enter.max(a.min(b));
                    leave = leave.min(a.max(b));
                }
                let hit = (enter <= leave) & (enter > NEAR_M) & (enter < *depth);
                *depth = if hit { enter } else { *depth };
                *pixel = if hit { id } else { *pixel };
            }
        }
    }

    /// Draws a spheroid.
    pub(super) fn spheroid(&mut self, spheroid: &ViewSpheroid, id: u32) {
        let Some(rect) = self.rays.rect(ellipsoid_slopes(&spheroid.centre, &spheroid.spread, spheroid.radius)) else {
            return;
        };
        let toward = spheroid.form * spheroid.centre;
        self.quadric(rect, id, &spheroid.form, &toward, spheroid.centre.dot(&toward) - 1.0);
    }

    /// Roots of t² dᵀMd − 2 t d·m + c.
    fn quadric(&mut self, rect: Rect, id: u32, form: &Matrix3<f32>, m: &V3, c: f32) {
        for v in rect.v0..rect.v1 {
            let dz = self.rays.dz[v];
            let a0 = form[(0, 0)] + dz * (2.0 * form[(0, 2)] + dz * form[(2, 2)]);
            let a1 = 2.0 * (form[(0, 1)] + form[(1, 2)] * dz);
            let (a2, b0, b1) = (form[(1, 1)], m.x + m.z * dz, m.y);
            for (&dy, (depth, pixel)) in self.row(v, rect) {
                let qa = a0 + dy * (a1 + dy * a2);
                let qb = b0 + b1 * dy;
                let disc = qb * qb - qa * c;
                let t = (qb - disc.max(0.0).sqrt()) / qa;
                let hit = (disc >= 0.0) & (t > NEAR_M) & (t < *depth);
                *depth = if hit { t } else { *depth };
                *pixel = if hit { id } else { *pixel };
            }
        }
    }
}
