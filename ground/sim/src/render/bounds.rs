//! Which pixels a sphere or an ellipsoid can cover.

use super::camera::Rays;
use nalgebra::{Matrix3, Vector3};

/// Pixel columns `u0..u1` and rows `v0..v1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Rect {
    pub(super) u0: usize,
    pub(super) u1: usize,
    pub(super) v0: usize,
    pub(super) v1: usize,
}

/// Slopes (low, high) of y/x over a set of points with x > 0; infinite where the set reaches beside the camera.
pub(super) type Slopes = (f32, f32);

/// Slopes of a disc of radius `r` about (x, y), or `None` if no point of it has x > 0. All slopes if the origin is in it.
pub(super) fn disc_slopes(x: f32, y: f32, r: f32) -> Option<Slopes> {
    let s2 = x * x + y * y - r * r;
    if s2 <= 0.0 {
        return Some((f32::NEG_INFINITY, f32::INFINITY));
    }
    // The tangents lie at angle θ ∓ α from the x axis, tan θ = y/x and tan α = r/s.
    let s = s2.sqrt();
    let (low_cos, high_cos) = (x * s + r * y, x * s - r * y);
    let low = if low_cos > 0.0 { (y * s - r * x) / low_cos } else { f32::NEG_INFINITY };
    let high = if high_cos > 0.0 { (y * s + r * x) / high_cos } else { f32::INFINITY };
    // Beyond ±90° on both tangents: nothing is in front.
    if (y > 0.0 && low_cos <= 0.0) || (y < 0.0 && high_cos <= 0.0) { None } else { Some((low, high)) }
}

/// Slopes y/x and z/x of a sphere.
pub(super) fn sphere_slopes(centre: &Vector3<f32>, radius: f32) -> Option<[Slopes; 2]> {
    if centre.x <= -radius {
        return None;
    }
    Some([disc_slopes(centre.x, centre.y, radius)?, disc_slopes(centre.x, centre.z, radius)?])
}

/// Slopes of an ellipsoid about `centre` with covariance-like matrix `spread` (eigenvalues: squared semi-axes).
///
/// `radius` is the longest semi-axis; it stands in where the ellipsoid reaches behind the camera.
pub(super) fn ellipsoid_slopes(centre: &Vector3<f32>, spread: &Matrix3<f32>, radius: f32) -> Option<[Slopes; 2]> {
    if centre.x <= spread[(0, 0)].sqrt() * 1.001 {
        return sphere_slopes(centre, radius);
    }
    // Planes through the camera with normal (m, −1, 0) that touch: (n·c)² = nᵀ S n, a quadratic in m.
    let side = |axis: usize| {
        let c = centre[axis];
        let qa = centre.x * centre.x - spread[(0, 0)];
        let qb = centre.x * c - spread[(0, axis)];
        let qc = c * c - spread[(axis, axis)];
        let root = (qb * qb - qa * qc).max(0.0).sqrt();
        ((qb - root) / qa, (qb + root) / qa)
    };
    Some([side(1), side(2)])
}

/// Slopes of a box with the given corners (corner i has the signs of i's bits along the box's axes), cut off at depth
/// `near`; `None` if no point of it is beyond.
pub(super) fn box_slopes(corners: &[Vector3<f32>; 8], near: f32) -> Option<[Slopes; 2]> {
    let mut slopes: Option<[Slopes; 2]> = None;
    let mut take = |p: &Vector3<f32>| {
        let [y, z] = [p.y / p.x, p.z / p.x];
        let [(y0, y1), (z0, z1)] = slopes.unwrap_or([(y, y), (z, z)]);
        slopes = Some([(y0.min(y), y1.max(y)), (z0.min(z), z1.max(z))]);
    };
    for (index, corner) in corners.iter().enumerate() {
        if corner.x >= near {
            take(corner);
        }
        for bit in [1, 2, 4] {
            let other = &corners[index ^ bit];
            if corner.x >= near && other.x < near {
                take(&(corner + (other - corner) * ((corner.x - near) / (corner.x - other.x))));
            }
        }
    }
    slopes
}

/// The smallest slopes that hold both.
pub(super) fn hull(a: Option<[Slopes; 2]>, b: Option<[Slopes; 2]>) -> Option<[Slopes; 2]> {
    match (a, b) {
        (Some(a), Some(b)) => Some(std::array::from_fn(|i| (a[i].0.min(b[i].0), a[i].1.max(b[i].1)))),
        // One end lies behind: toward it the solid may leave the view on any side.
        (Some(_), None) | (None, Some(_)) => Some([(f32::NEG_INFINITY, f32::INFINITY); 2]),
        (None, None) => None,
    }
}

impl Rays {
    /// The pixels whose centres can lie within `slopes`; `None` if there are none.
    pub(super) fn rect(&self, slopes: Option<[Slopes; 2]>) -> Option<Rect> {
        let [across, upward] = slopes?;
        // Slack of a fiftieth of a pixel for single precision.
        let span = |(low, high): Slopes, n: usize| {
            let half = 0.5 * n as f32;
            // Conversion holds what lies outside at the border; ⌈x⌉ is ⌊x⌋ + 1 but for whole numbers.
            let first = (half - self.focal * high + 0.48) as usize;
            let last = (half - self.focal * low + 0.52) as usize;
            (first, last.min(n))
        };
        let ((u0, u1), (v0, v1)) = (span(across, self.width), span(upward, self.height));
        (u0 < u1 && v0 < v1).then_some(Rect { u0, u1, v0, v1 })
    }
}
