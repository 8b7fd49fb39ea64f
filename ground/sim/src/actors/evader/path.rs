//! A smooth way to run: a cubic B-spline with as little bending as the obstacles allow.

use super::field::{Field, Point};

/// Distance between control points, m.
pub(super) const SPACING_M: f64 = 0.5;

/// A uniform cubic B-spline; curvature is continuous. Parameter 0 is the first control point, 1 the next.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Path {
    pub(super) control: Vec<Point>,
}

impl Path {
    /// Last parameter.
    pub(super) fn end(&self) -> f64 {
        (self.control.len() - 1) as f64
    }

    /// Control point by index; one beyond either end mirrors the next inner one, so that the spline ends on the end.
    fn point(&self, index: isize) -> Point {
        let last = self.control.len() as isize - 1;
        if index < 0 {
            2.0 * self.control[0] - self.control[(-index).min(last) as usize]
        } else if index > last {
            2.0 * self.control[last as usize] - self.control[(2 * last - index).max(0) as usize]
        } else {
            self.control[index as usize]
        }
    }

    /// Position and its first two derivatives by the parameter.
    pub(super) fn at(&self, parameter: f64) -> (Point, Point, Point) {
        let parameter = parameter.clamp(0.0, self.end());
        let segment = parameter.floor().min(self.end() - 1.0).max(0.0);
        let t = parameter - segment;
        let i = segment as isize;
        let [a, b, c, d] = [self.point(i - 1), self.point(i), self.point(i + 1), self.point(i + 2)];
        let position = (a * (1.0 - t).powi(3)
            + b * (3.0 * t.powi(3) - 6.0 * t * t + 4.0)
            + c * (-3.0 * t.powi(3) + 3.0 * t * t + 3.0 * t + 1.0)
            + d * t.powi(3))
            / 6.0;
        let first =
            (-a * (1.0 - t) * (1.0 - t) + b * (3.0 * t * t - 4.0 * t) + c * (-3.0 * t * t + 2.0 * t + 1.0) + d * t * t)
                / 2.0;
        let second = a * (1.0 - t) + b * (3.0 * t - 2.0) + c * (1.0 - 3.0 * t) + d * t;
        (position, first, second)
    }

    /// Curvature, 1/m.
    pub(super) fn curvature(&self, parameter: f64) -> f64 {
        let (_, first, second) = self.at(parameter);
        let speed = first.norm().max(1e-9);
        first.perp(&second).abs() / speed.powi(3)
    }
}

/// Control points every [`SPACING_M`] along a polyline, both ends included.
pub(super) fn resample(polyline: &[Point]) -> Vec<Point> {
    let length: f64 = polyline.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
    let count = (length / SPACING_M).round().max(2.0) as usize;
    let step = length / count as f64;
    let mut points = vec![polyline[0]];
    let (mut segment, mut done) = (0, 0.0);
    for i in 1..count {
        let along = step * i as f64;
        while segment + 2 < polyline.len() {
            let piece = (polyline[segment + 1] - polyline[segment]).norm();
            if done + piece >= along {
                break;
            }
            done += piece;
            segment += 1;
        }
        let (a, b) = (polyline[segment], polyline[segment + 1]);
        let piece = (b - a).norm().max(1e-9);
        points.push(a.lerp(&b, ((along - done) / piece).clamp(0.0, 1.0)));
    }
    points.push(polyline[polyline.len() - 1]);
    points
}

/// Bends `control` as little as possible: alternately relaxes it like a beam of `stiffness` held to where it is, and
/// pushes it off obstacles nearer than `keep_m`. The first `fixed` points and the last stay.
pub(super) fn relax(field: &Field<'_>, control: &[Point], fixed: usize, stiffness: f64, keep_m: f64) -> Vec<Point> {
    let mut points = control.to_vec();
    for _ in 0..ROUNDS {
        let held: Vec<Point> = points
            .iter()
            .enumerate()
            .map(|(index, p)| {
                if index < fixed || index + 1 == points.len() {
                    return *p;
                }
                let lack = keep_m - field.clearance(p);
                let away = field.gradient(p);
                if lack > 0.0 && away.norm() > 0.1 { p + away.normalize() * lack.min(0.3) } else { *p }
            })
            .collect();
        points = beam(&held, fixed, stiffness);
    }
    points
}

const ROUNDS: usize = 60;

/// Minimises Σ|p − held|² + stiffness · Σ|second difference|² with the first `fixed` points and the last pinned:
/// a pentadiagonal system, solved by banded elimination.
fn beam(held: &[Point], fixed: usize, stiffness: f64) -> Vec<Point> {
    let n = held.len();
    if n < fixed + 3 {
        return held.to_vec();
    }
    // Row i holds the coefficients of i-2 ..= i+2.
    let mut matrix = vec![[0.0f64; 5]; n];
    let mut right: Vec<Point> = held.to_vec();
    for row in &mut matrix {
        row[2] = 1.0;
    }
    for middle in 1..n - 1 {
        for (i, wi) in [(middle - 1, 1.0), (middle, -2.0), (middle + 1, 1.0)] {
            for (j, wj) in [(middle - 1, 1.0), (middle, -2.0), (middle + 1, 1.0)] {
                matrix[i][j + 2 - i] += stiffness * wi * wj;
            }
        }
    }
    for pinned in (0..fixed.max(1)).chain([n - 1]) {
        matrix[pinned] = [0.0, 0.0, 1.0, 0.0, 0.0];
        right[pinned] = held[pinned];
    }
    for i in 0..n {
        for below in i + 1..(i + 3).min(n) {
            let factor = matrix[below][i + 2 - below] / matrix[i][2];
            if factor != 0.0 {
                for j in i..(i + 3).min(n) {
                    matrix[below][j + 2 - below] -= factor * matrix[i][j + 2 - i];
                }
                let subtract = right[i] * factor;
                right[below] -= subtract;
            }
        }
    }
    for i in (0..n).rev() {
        let mut value = right[i];
        for j in i + 1..(i + 3).min(n) {
            value -= right[j] * matrix[i][j + 2 - i];
        }
        right[i] = value / matrix[i][2];
    }
    right
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spline_starts_and_ends_on_its_ends_without_curvature_there() {
        let path = Path {
            control: vec![Point::new(0.0, 0.0), Point::new(0.5, 0.1), Point::new(0.9, 0.4), Point::new(1.2, 0.9)],
        };
        assert!((path.at(0.0).0 - path.control[0]).norm() < 1e-12);
        assert!((path.at(path.end()).0 - path.control[3]).norm() < 1e-12);
        assert!(path.curvature(0.0) < 1e-9 && path.curvature(path.end()) < 1e-9);
    }

    #[test]
    fn the_derivatives_are_those_of_the_position() {
        let path =
            Path { control: (0..8).map(|i| Point::new(0.5 * f64::from(i), (0.8 * f64::from(i)).sin())).collect() };
        let h = 1e-5;
        for parameter in [0.3, 1.0, 2.7, 5.5, 6.9] {
            let (before, here, after) = (path.at(parameter - h), path.at(parameter), path.at(parameter + h));
            assert!(((after.0 - before.0) / (2.0 * h) - here.1).norm() < 1e-6);
            assert!(((after.1 - before.1) / (2.0 * h) - here.2).norm() < 1e-6);
        }
    }

    #[test]
    fn a_relaxed_beam_is_straight_when_nothing_holds_it() {
        let mut points: Vec<Point> =
            (0..30).map(|i| Point::new(0.5 * f64::from(i), if i == 15 { 1.0 } else { 0.0 })).collect();
        for _ in 0..200 {
            points = beam(&points, 1, 1000.0);
        }
        assert!(points.iter().all(|p| p.y.abs() < 0.02), "{points:?}");
        assert!((points[0] - Point::new(0.0, 0.0)).norm() < 1e-9 && (points[29].x - 14.5).abs() < 1e-9);
    }

    #[test]
    fn resampling_keeps_the_ends_and_the_spacing() {
        let points = resample(&[Point::new(0.0, 0.0), Point::new(3.0, 0.0), Point::new(3.0, 4.0)]);
        assert_eq!((points[0], points[points.len() - 1]), (Point::new(0.0, 0.0), Point::new(3.0, 4.0)));
        assert!(points.windows(2).all(|w| (w[1] - w[0]).norm() < 0.51));
        assert_eq!(points.len(), 15);
    }
}
