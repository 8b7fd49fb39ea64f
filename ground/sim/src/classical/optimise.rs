//! The back end: the spline that is smooth, clear of obstacles, within limits, and ends where it should.

use goshawk_core::{FlatState, Vec3};

use super::distance::DistanceField;
use super::lbfgs::minimise;
use super::spline::{Spline, opening, weights};

/// What the spline should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// State at the beginning: met exactly.
    pub start: FlatState,
    /// Position at the end, m; none: anywhere.
    pub end_world: Option<Vec3>,
    /// Velocity at the end, m/s.
    pub end_vel_world: Vec3,
    /// Height to keep, m.
    pub height_m: f64,
    /// Most speed, m/s.
    pub speed_mps: f64,
    /// Most acceleration, m/s².
    pub acc_mps2: f64,
    /// Distance to an occupied voxel from which on more is worth nothing, m.
    pub clearance_m: f64,
}

/// Costs: of (m/s³)²·s; of m²·s short of the clearance; of m²·s off the height; of squared relative excess of speed and
/// acceleration over the limits, each of a span; of m² and (m/s)² off the end.
const JERK: f64 = 4e-4;
const CLEARANCE: f64 = 60.0;
const HEIGHT: f64 = 0.3;
const SPEED: f64 = 3.0;
const ACCELERATION: f64 = 3.0;
const END: f64 = 0.6;
const END_SPEED: f64 = 0.08;

/// Points of a span at which obstacles are looked for.
const SAMPLES: usize = 4;
const ITERATIONS: usize = 60;
/// First step of the minimisation, m over all control points.
const FIRST_STEP_M: f64 = 0.1;

/// Improves `points` (m, at least 4, of spans of `step_s`), of which the first three are set by the start.
#[must_use]
pub fn optimise(wanted: &Wanted, field: &DistanceField, points: &[Vec3], step_s: f64) -> Spline {
    let mut spline = Spline { points: points.to_vec(), step_s };
    spline.points[..3].copy_from_slice(&opening(&wanted.start, step_s));
    let mut x: Vec<f64> = spline.points[3..].iter().flat_map(|q| [q.x, q.y, q.z]).collect();
    let mut gradient = vec![Vec3::zeros(); spline.points.len()];
    minimise(&mut x, ITERATIONS, FIRST_STEP_M, |x, g| {
        take(&mut spline.points, x);
        gradient.fill(Vec3::zeros());
        let value = cost(wanted, field, &spline, &mut gradient);
        for (g, from) in g.chunks_exact_mut(3).zip(&gradient[3..]) {
            g.copy_from_slice(from.as_slice());
        }
        value
    });
    take(&mut spline.points, &x);
    spline
}

fn take(points: &mut [Vec3], x: &[f64]) {
    for (point, x) in points[3..].iter_mut().zip(x.chunks_exact(3)) {
        *point = Vec3::new(x[0], x[1], x[2]);
    }
}

/// The cost of a spline; its gradient by the control points is added to `gradient`.
pub(super) fn cost(wanted: &Wanted, field: &DistanceField, spline: &Spline, gradient: &mut [Vec3]) -> f64 {
    smoothness(spline, gradient)
        + limits(wanted, spline, gradient)
        + surroundings(wanted, field, spline, gradient)
        + ending(wanted, spline, gradient)
}

fn smoothness(spline: &Spline, gradient: &mut [Vec3]) -> f64 {
    let scale = JERK / spline.step_s.powi(5);
    let mut value = 0.0;
    for (i, q) in spline.points.windows(4).enumerate() {
        let third = q[3] - q[2] * 3.0 + q[1] * 3.0 - q[0];
        value += scale * third.norm_squared();
        for (k, factor) in [-1.0, 3.0, -3.0, 1.0].into_iter().enumerate() {
            gradient[i + k] += third * (2.0 * scale * factor);
        }
    }
    value
}

/// A spline's derivatives lie within the hull of their own control points: these are held to the limits.
fn limits(wanted: &Wanted, spline: &Spline, gradient: &mut [Vec3]) -> f64 {
    let h = spline.step_s;
    let mut value = 0.0;
    let mut hold = |at: usize, factors: &[f64], most: f64, weight: f64| {
        let derivative: Vec3 = factors.iter().zip(&spline.points[at..]).map(|(f, q)| q * *f).sum();
        let excess = derivative.norm_squared() / (most * most) - 1.0;
        if excess > 0.0 {
            value += weight * excess * excess;
            let slope = derivative * (4.0 * weight * excess / (most * most));
            for (k, factor) in factors.iter().enumerate() {
                gradient[at + k] += slope * *factor;
            }
        }
    };
    for at in 0..spline.points.len() - 1 {
        hold(at, &[-1.0 / h, 1.0 / h], wanted.speed_mps, SPEED);
    }
    for at in 0..spline.points.len() - 2 {
        let f = 1.0 / (h * h);
        hold(at, &[f, -2.0 * f, f], wanted.acc_mps2, ACCELERATION);
    }
    value
}

/// Obstacles and height, at points along the curve.
fn surroundings(wanted: &Wanted, field: &DistanceField, spline: &Spline, gradient: &mut [Vec3]) -> f64 {
    let scale = spline.step_s / SAMPLES as f64;
    let mut value = 0.0;
    for sample in 1..=spline.spans() * SAMPLES {
        // The end of each span, not its beginning: the start is given.
        let span = (sample - 1) / SAMPLES;
        let w = weights((sample - span * SAMPLES) as f64 / SAMPLES as f64);
        let at: Vec3 = spline.points[span..span + 4].iter().zip(w).map(|(q, w)| q * w).sum();
        let (distance, away) = field.sample(&at);
        let short = (wanted.clearance_m - distance).max(0.0);
        let off = at.z - wanted.height_m;
        value += scale * (CLEARANCE * short * short + HEIGHT * off * off);
        let slope = (away * (-2.0 * CLEARANCE * short) + Vec3::z() * (2.0 * HEIGHT * off)) * scale;
        for (k, w) in w.into_iter().enumerate() {
            gradient[span + k] += slope * w;
        }
    }
    value
}

fn ending(wanted: &Wanted, spline: &Spline, gradient: &mut [Vec3]) -> f64 {
    let (end, _) = spline.at(spline.duration());
    let first = spline.points.len() - 3;
    let velocity = end.vel - wanted.end_vel_world;
    let mut value = END_SPEED * velocity.norm_squared();
    let slope = velocity * (END_SPEED / spline.step_s);
    gradient[first] -= slope;
    gradient[first + 2] += slope;
    if let Some(goal) = wanted.end_world {
        let off = end.pos - goal;
        value += END * off.norm_squared();
        for (k, w) in [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0].into_iter().enumerate() {
            gradient[first + k] += off * (2.0 * END * w);
        }
    }
    value
}
