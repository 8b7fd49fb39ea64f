//! What the person is to run: to a goal, an ∞, or a recorded path.

use super::field::Point;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;
use thiserror::Error;

/// Half the length of the ∞, m.
const EIGHT_HALF_M: f64 = 14.0;
/// Its nearest point is this far ahead of the vehicle, m.
const EIGHT_AHEAD_M: f64 = 7.0;
const EIGHT_POINTS: usize = 16;

/// The run's shape.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Course {
    /// To a goal ahead; midway another one is chosen.
    #[default]
    Goal,
    /// One lap of an ∞ of 28 × 10 m that lies ahead of the vehicle.
    Eight,
    /// Along these points, m ahead and m to the left of the vehicle at its start, round what stands in the way.
    Waypoints(Vec<[f64; 2]>),
}

/// Why a file is no course.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum CourseError {
    /// It cannot be read.
    #[error("--course {file}: {cause} (goal, eight, or a CSV file with the columns x,y in metres ahead and left)")]
    Read {
        /// The file.
        file: String,
        /// Why not.
        cause: String,
    },
}

impl Course {
    /// `goal`, `eight`, or the path of a CSV file whose first line is `x,y`.
    ///
    /// # Errors
    /// [`CourseError`] if the file is none.
    pub fn parse(text: &str) -> Result<Self, CourseError> {
        match text {
            "goal" => Ok(Self::Goal),
            "eight" => Ok(Self::Eight),
            file => {
                let failed = |cause: String| CourseError::Read { file: file.to_owned(), cause };
                let content = std::fs::read_to_string(Path::new(file)).map_err(|e| failed(e.to_string()))?;
                waypoints(&content).map(Self::Waypoints).map_err(failed)
            }
        }
    }

    /// The points to pass, from the vehicle's start and heading; none: a goal is to be chosen.
    pub(super) fn points(&self, vehicle: Point, heading_rad: f64) -> Option<Vec<Point>> {
        let local: Vec<[f64; 2]> = match self {
            Self::Goal => return None,
            Self::Eight => (1..=EIGHT_POINTS).map(|i| eight(PI + TAU * i as f64 / EIGHT_POINTS as f64)).collect(),
            Self::Waypoints(points) => points.clone(),
        };
        let (sin, cos) = heading_rad.sin_cos();
        Some(local.iter().map(|[x, y]| vehicle + Point::new(cos * x - sin * y, sin * x + cos * y)).collect())
    }
}

/// A point of the lemniscate x = a cos φ / (1 + sin² φ), y = x sin φ, whose nearest end is at φ = π.
fn eight(angle: f64) -> [f64; 2] {
    // Evenly spaced in time, not in angle: the ends would be crowded.
    let phi = angle - 0.18 * (2.0 * (angle - FRAC_PI_2)).sin();
    let x = EIGHT_HALF_M * phi.cos() / (1.0 + phi.sin() * phi.sin());
    [EIGHT_AHEAD_M + EIGHT_HALF_M + x, x * phi.sin()]
}

fn waypoints(content: &str) -> Result<Vec<[f64; 2]>, String> {
    let mut lines = content.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    match lines.next() {
        Some((_, header)) if header.replace(' ', "") == "x,y" => {}
        _ => return Err("its first line is not x,y".to_owned()),
    }
    let points: Vec<[f64; 2]> = lines
        .map(|(index, line)| {
            let numbers: Vec<f64> = line.split(',').filter_map(|n| n.trim().parse().ok()).collect();
            match numbers[..] {
                [x, y] if x.is_finite() && y.is_finite() => Ok([x, y]),
                _ => Err(format!("line {} is not two numbers", index + 1)),
            }
        })
        .collect::<Result<_, String>>()?;
    if points.len() < 2 {
        return Err("it has fewer than two points".to_owned());
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_eight_crosses_itself_and_lies_ahead() {
        let points = Course::Eight.points(Point::zeros(), 0.0).unwrap();
        let most = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let least = |axis: usize| points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        assert!((least(0) - EIGHT_AHEAD_M).abs() < 0.1 && (most(0) - EIGHT_AHEAD_M - 28.0).abs() < 0.5);
        assert!(most(1) > 4.0 && least(1) < -4.0);
        // Near and far lobe are each passed on both sides.
        for far in [false, true] {
            let lobe = points.iter().filter(|p| (p.x > EIGHT_AHEAD_M + EIGHT_HALF_M) == far);
            assert!(lobe.clone().any(|p| p.y > 2.0) && lobe.clone().any(|p| p.y < -2.0));
        }
    }

    #[test]
    fn a_bad_file_is_one_line_that_says_what_is_meant() {
        assert_eq!(waypoints("x, y\n1,2\n\n3.5,-4\n"), Ok(vec![[1.0, 2.0], [3.5, -4.0]]));
        for bad in ["", "1,2\n3,4\n", "x,y\n1,2\n", "x,y\n1,2\n3,way\n", "x,y\n1,2\n3,nan\n"] {
            assert!(waypoints(bad).is_err(), "{bad:?}");
        }
        let message = Course::parse("no/such.csv").unwrap_err().to_string();
        assert!(message.contains("no/such.csv") && message.lines().count() == 1, "{message}");
    }
}
