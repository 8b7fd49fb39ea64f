//! Solids into the depth buffer: a ray intersection without branches for [`PACK`] pixels of a row at a time, so that it
//! vectorises.

use super::bounds::{Rect, Slopes, box_slopes, ellipsoid_slopes, hull, sphere_slopes};
use super::camera::{Rays, View};
use super::{NEAR_M, RANGE_M};
use crate::render::lanes::{each, least, mask, most};
use crate::world::{Cuboid, RoundCone, Spheroid};
use goshawk_core::Vec3;
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
    pub(super) fn new(cone: &RoundCone, view: &View) -> Self {
        let (a, b) = (view.to_cam(&cone.a), view.to_cam(&cone.b));
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
    pub(super) fn new(spheroid: &Spheroid, view: &View) -> Self {
        let up = view.rotate_to_cam(&Vec3::z());
        let (xy2, z2) =
            ((spheroid.radius_xy * spheroid.radius_xy) as f32, (spheroid.radius_z * spheroid.radius_z) as f32);
        let upward = up * up.transpose();
        Self {
            centre: view.to_cam(&spheroid.centre),
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
    pub(super) fn new(cuboid: &Cuboid, view: &View) -> Self {
        let axis = |v: Vec3| view.rotate_to_cam(&cuboid.turn_out(&v)).transpose();
        let axes = Matrix3::from_rows(&[axis(Vec3::x()), axis(Vec3::y()), axis(Vec3::z())]);
        let eye = cuboid.turn_in(&(view.pos_world - cuboid.centre)).cast::<f32>();
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
        let stretches = (cone.length / (0.25 + 0.12 * nearest)) as usize;
        let stretches = (stretches + 1).min(12);
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

    /// Draws whatever `row` makes of the rows of `rect`: from a row's slope a function from a column's slope to depth,
    /// infinite or NaN where the ray misses. A few columns beside `rect` are asked, too.
    fn cover<F: Fn(f32) -> f32>(&mut self, rect: Rect, id: u32, row: impl Fn(f32) -> F) {
        let width = self.rays.width;
        for v in rect.v0..rect.v1 {
            let depth_at = row(self.rays.dz[v]);
            for u in (rect.u0 / PACK * PACK..rect.u1).step_by(PACK) {
                // The last pack may repeat some columns: they stay as they are.
                let u = u.min(width - PACK);
                let first = v * width + u;
                let dy: &[f32; PACK] = pack(&self.rays.dy[u..]);
                let depth: &mut [f32; PACK] = self.depth[first..].first_chunk_mut().expect(WIDE);
                let ids: &mut [u32; PACK] = self.ids[first..].first_chunk_mut().expect(WIDE);
                let t: [f32; PACK] = each(|i| depth_at(dy[i]));
                let t: [f32; PACK] = each(|i| if t[i] > NEAR_M { t[i] } else { f32::INFINITY });
                let nearer: [u32; PACK] = each(|i| mask(t[i] < depth[i]));
                *ids = each(|i| (id & nearer[i]) | (ids[i] & !nearer[i]));
                *depth = each(|i| least(t[i], depth[i]));
            }
        }
    }

    fn cone_side(&mut self, cone: &ViewCone, id: u32, rect: Rect) {
        let (a, n, k, r) = (cone.a, cone.axis, cone.taper, cone.radius_a);
        let c2 = 1.0 - k * k;
        let y0 = -n.dot(&a);
        let qc = c2 * a.norm_squared() - y0 * y0 + 2.0 * r * k * y0 - r * r;
        let (low, high) = (k * r, k * r + c2 * cone.length);
        self.cover(rect, id, |dz| {
            let (d2_row, nd_row, ad_row) = (1.0 + dz * dz, n.x + n.z * dz, a.x + a.z * dz);
            move |dy| {
                let nd = nd_row + n.y * dy;
                let qa = c2 * (d2_row + dy * dy) - nd * nd;
                let qb = (r * k - y0) * nd - c2 * (ad_row + a.y * dy);
                let disc = qb * qb - qa * qc;
                let t = (-qb - most(disc, 0.0).sqrt()) / qa;
                let y = y0 + t * nd;
                // One comparison for all three.
                if least(least(y - low, high - y), disc) >= 0.0 { t } else { f32::INFINITY }
            }
        });
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
        let across = axes.column(1).into_owned();
        self.cover(rect, id, |dz| {
            let start = axes.column(0) + axes.column(2) * dz;
            move |dy| {
                let (mut enter, mut leave) = (NEAR_M, f32::INFINITY);
                for axis in 0..3 {
                    let inverse = 1.0 / (start[axis] + across[axis] * dy);
                    let (a, b) = (low[axis] * inverse, high[axis] * inverse);
                    enter = most(least(a, b), enter);
                    leave = least(most(a, b), leave);
                }
                if enter <= leave { enter } else { f32::INFINITY }
            }
        });
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
        self.cover(rect, id, |dz| {
            let a0 = form[(0, 0)] + dz * (2.0 * form[(0, 2)] + dz * form[(2, 2)]);
            let a1 = 2.0 * (form[(0, 1)] + form[(1, 2)] * dz);
            let (a2, b0, b1) = (form[(1, 1)], m.x + m.z * dz, m.y);
            move |dy| {
                let qa = a0 + dy * (a1 + dy * a2);
                let qb = b0 + b1 * dy;
                let disc = qb * qb - qa * c;
                let t = (qb - most(disc, 0.0).sqrt()) / qa;
                if disc >= 0.0 { t } else { f32::INFINITY }
            }
        });
    }
}

/// Pixels that are drawn together.
pub(super) const PACK: usize = 8;

const WIDE: &str = "an image is at least a pack wide";

fn pack<T>(values: &[T]) -> &[T; PACK] {
    values.first_chunk().expect(WIDE)
}
