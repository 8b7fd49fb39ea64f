//! The trajectory: a uniform cubic B-spline.

use goshawk_core::{FlatState, Vec3};

/// A uniform cubic B-spline: `points.len() - 3` spans of `step_s` each.
#[derive(Clone, Debug, PartialEq)]
pub struct Spline {
    /// Control points, world frame, m; at least 4.
    pub points: Vec<Vec3>,
    /// Duration of a span, s.
    pub step_s: f64,
}

/// Weights of a span's four control points for position, at `u` in 0..=1.
#[must_use]
pub fn weights(u: f64) -> [f64; 4] {
    let (u2, u3) = (u * u, u * u * u);
    let w = 1.0 - u;
    [w * w * w, 3.0 * u3 - 6.0 * u2 + 4.0, -3.0 * u3 + 3.0 * u2 + 3.0 * u + 1.0, u3].map(|x| x / 6.0)
}

/// The first three control points of a spline that begins in `start`.
#[must_use]
pub fn opening(start: &FlatState, step_s: f64) -> [Vec3; 3] {
    let (vel, acc) = (start.vel * step_s, start.acc * (step_s * step_s));
    let middle = start.pos - acc / 6.0;
    [middle - vel + acc / 2.0, middle, middle + vel + acc / 2.0]
}

impl Spline {
    /// Number of spans.
    #[must_use]
    pub fn spans(&self) -> usize {
        self.points.len() - 3
    }

    /// From its beginning to its end, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.spans() as f64 * self.step_s
    }

    /// Position, velocity and acceleration `t` seconds after the beginning, and the jerk, m/s³. Before the beginning it
    /// is as there; after the end it rests there.
    #[must_use]
    pub fn at(&self, t: f64) -> (FlatState, Vec3) {
        let place = t.max(0.0) / self.step_s;
        let span = (place as usize).min(self.spans() - 1);
        let u = (place - span as f64).min(1.0);
        let q = &self.points[span..span + 4];
        let pos = q.iter().zip(weights(u)).map(|(q, w)| q * w).sum();
        if t > self.duration() {
            return (FlatState { pos, ..FlatState::default() }, Vec3::zeros());
        }
        let (h, w) = (self.step_s, 1.0 - u);
        let first = [q[1] - q[0], q[2] - q[1], q[3] - q[2]];
        let second = [first[1] - first[0], first[2] - first[1]];
        let vel = (first[0] * (w * w) + first[1] * (1.0 + 2.0 * u * w) + first[2] * (u * u)) / (2.0 * h);
        let acc = (second[0] * w + second[1] * u) / (h * h);
        (FlatState { pos, vel, acc }, (second[1] - second[0]) / (h * h * h))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spline_begins_in_the_state_it_was_opened_with() {
        let start =
            FlatState { pos: Vec3::new(1.0, 2.0, 3.0), vel: Vec3::new(4.0, -1.0, 0.5), acc: Vec3::new(-2.0, 3.0, 1.0) };
        let mut points = opening(&start, 0.2).to_vec();
        points.extend([Vec3::new(3.0, 2.0, 3.0), Vec3::new(4.0, 1.0, 3.0)]);
        let (state, _) = Spline { points, step_s: 0.2 }.at(0.0);
        for (got, want) in [(state.pos, start.pos), (state.vel, start.vel), (state.acc, start.acc)] {
            assert!((got - want).norm() < 1e-9, "{got} {want}");
        }
    }

    #[test]
    fn each_derivative_is_the_slope_of_the_one_below() {
        let points = (0..8).map(|k| Vec3::new(f64::from(k), f64::from(k * k % 5), f64::from(k % 3))).collect();
        let spline = Spline { points, step_s: 0.2 };
        for k in 1..9 {
            let (t, h) = (0.11 * f64::from(k), 1e-5);
            let ((before, _), (now, jerk), (after, _)) = (spline.at(t - h), spline.at(t), spline.at(t + h));
            assert!(((after.pos - before.pos) / (2.0 * h) - now.vel).norm() < 1e-4);
            assert!(((after.vel - before.vel) / (2.0 * h) - now.acc).norm() < 1e-3);
            assert!(((after.acc - before.acc) / (2.0 * h) - jerk).norm() < 1e-2 * (1.0 + jerk.norm()));
        }
    }

    #[test]
    fn past_its_end_the_spline_rests() {
        let points = (0..5).map(|k| Vec3::x() * f64::from(k)).collect();
        let (state, jerk) = Spline { points, step_s: 0.1 }.at(3.0);
        assert_eq!((state.vel, state.acc, jerk), (Vec3::zeros(), Vec3::zeros(), Vec3::zeros()));
        assert!((state.pos - Vec3::x() * 3.0).norm() < 1e-12);
    }
}
