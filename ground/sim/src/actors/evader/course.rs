//! What the person is to run: to a goal, a named figure, or a recorded path.

use super::field::Point;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;
use thiserror::Error;

/// Half the length of the ∞, m.
const EIGHT_HALF_M: f64 = 14.0;
/// Its nearest point is this far ahead of the vehicle, m.
const EIGHT_AHEAD_M: f64 = 7.0;
const EIGHT_POINTS: usize = 16;

/// Aside again and again: the evader crosses in front of a vehicle that cuts the corner.
const ZIGZAG: [[f64; 3]; 6] =
    [[5.0, 0.0, 0.0], [12.0, 8.0, 0.0], [19.0, -8.0, 0.0], [26.0, 8.0, 0.0], [33.0, -8.0, 0.0], [40.0, 0.0, 0.0]];
/// Out, and straight back into whoever follows.
const U_TURN: [[f64; 3]; 3] = [[6.0, 0.0, 0.0], [22.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
const SQUARE: [[f64; 3]; 6] =
    [[6.0, 0.0, 0.0], [6.0, -7.0, 0.0], [20.0, -7.0, 0.0], [20.0, 7.0, 0.0], [6.0, 7.0, 0.0], [6.0, 0.0, 0.0]];
const STOP_AND_GO: [[f64; 3]; 5] =
    [[6.0, 0.0, 0.0], [13.0, 0.0, 1.5], [21.0, 0.0, 1.5], [29.0, 0.0, 1.5], [37.0, 0.0, 0.0]];

/// The run's shape.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Course {
    /// To a goal ahead; midway another one is chosen.
    #[default]
    Goal,
    /// One lap of an ∞ of 28 × 10 m that lies ahead of the vehicle.
    Eight,
    /// A figure of this name, along these points, as [`Course::Waypoints`]; those with no room near them are left out.
    Figure(String, &'static [[f64; 3]]),
    /// Along these points, round what stands in the way: m ahead and m to the left of the vehicle at its start, and how
    /// long the person stands there, s. With its name. All of them are passed.
    Waypoints(String, Vec<[f64; 3]>),
}

/// A point to pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pass {
    /// World frame, m.
    pub(super) at: Point,
    /// How long the person stands there, s.
    pub(super) stand_s: f64,
}

/// Why a file is no course.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum CourseError {
    /// It cannot be read.
    #[error(
        "--course {file}: {cause} (goal, eight, zigzag, u-turn, square, stop-and-go, or a CSV file with the columns x,y in metres ahead and left)"
    )]
    Read {
        /// The file.
        file: String,
        /// Why not.
        cause: String,
    },
}

impl Course {
    /// A figure's name, or the path of a CSV file whose first line is `x,y` or `x,y,stand_s`.
    ///
    /// # Errors
    /// [`CourseError`] if the file is none.
    pub fn parse(text: &str) -> Result<Self, CourseError> {
        let named = |points| Ok(Self::Figure(text.to_owned(), points));
        match text {
            "goal" => Ok(Self::Goal),
            "eight" => Ok(Self::Eight),
            "zigzag" => named(&ZIGZAG),
            "u-turn" => named(&U_TURN),
            "square" => named(&SQUARE),
            "stop-and-go" => named(&STOP_AND_GO),
            file => {
                let failed = |cause: String| CourseError::Read { file: file.to_owned(), cause };
                let path = Path::new(file);
                let content = std::fs::read_to_string(path).map_err(|e| failed(e.to_string()))?;
                let name = path.file_stem().map_or(file.to_owned(), |name| name.to_string_lossy().into_owned());
                waypoints(&content).map(|points| Self::Waypoints(name, points)).map_err(failed)
            }
        }
    }

    /// A figure's name, or the file's without its ending.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Goal => "goal",
            Self::Eight => "eight",
            Self::Figure(name, _) | Self::Waypoints(name, _) => name,
        }
    }

    /// Whether points with no room near them may be left out.
    pub(super) fn may_leave_out(&self) -> bool {
        !matches!(self, Self::Waypoints(..))
    }

    /// The points to pass, from the vehicle's start and heading; none: a goal is to be chosen.
    pub(super) fn points(&self, vehicle: Point, heading_rad: f64) -> Option<Vec<Pass>> {
        let lap = |i: usize| {
            let [x, y] = eight(PI + TAU * i as f64 / EIGHT_POINTS as f64);
            [x, y, 0.0]
        };
        let local: Vec<[f64; 3]> = match self {
            Self::Goal => return None,
            Self::Eight => (1..=EIGHT_POINTS).map(lap).collect(),
            Self::Figure(_, points) => points.to_vec(),
            Self::Waypoints(_, points) => points.clone(),
        };
        let (sin, cos) = heading_rad.sin_cos();
        let turned = |x: f64, y: f64| vehicle + Point::new(cos * x - sin * y, sin * x + cos * y);
        Some(local.iter().map(|&[x, y, stand_s]| Pass { at: turned(x, y), stand_s }).collect())
    }
}

/// A point of the lemniscate x = a cos φ / (1 + sin² φ), y = x sin φ, whose nearest end is at φ = π.
fn eight(angle: f64) -> [f64; 2] {
    // Evenly spaced in time, not in angle: the ends would be crowded.
    let phi = angle - 0.18 * (2.0 * (angle - FRAC_PI_2)).sin();
    let x = EIGHT_HALF_M * phi.cos() / (1.0 + phi.sin() * phi.sin());
    [EIGHT_AHEAD_M + EIGHT_HALF_M + x, x * phi.sin()]
}

/// A person stands at a waypoint no longer than this, s: a flight has an end.
const LONGEST_STAND_S: f64 = 60.0;

fn waypoints(content: &str) -> Result<Vec<[f64; 3]>, String> {
    let mut lines = content.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let header = lines.next().map(|(_, header)| header.replace(' ', ""));
    let stands = header.as_deref() == Some("x,y,stand_s");
    if !stands && header.as_deref() != Some("x,y") {
        return Err("its first line is not x,y".to_owned());
    }
    let points: Vec<[f64; 3]> = lines
        .map(|(index, line)| {
            let numbers: Vec<f64> = line.split(',').map_while(|n| n.trim().parse().ok()).collect();
            let stand_ok = |s: f64| (0.0..=LONGEST_STAND_S).contains(&s);
            match numbers[..] {
                [x, y] if !stands && x.is_finite() && y.is_finite() => Ok([x, y, 0.0]),
                [x, y, s] if stands && x.is_finite() && y.is_finite() && stand_ok(s) => Ok([x, y, s]),
                _ if stands => Err(format!("line {} is not two numbers and 0 to {LONGEST_STAND_S} s", index + 1)),
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
        let passes = Course::Eight.points(Point::zeros(), 0.0).unwrap();
        let points: Vec<Point> = passes.iter().map(|pass| pass.at).collect();
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
        assert_eq!(waypoints("x, y\n1,2\n\n3.5,-4\n"), Ok(vec![[1.0, 2.0, 0.0], [3.5, -4.0, 0.0]]));
        assert_eq!(waypoints("x,y,stand_s\n1,2,0\n3,4,1.5\n"), Ok(vec![[1.0, 2.0, 0.0], [3.0, 4.0, 1.5]]));
        for bad in
            ["", "1,2\n3,4\n", "x,y\n1,2\n", "x,y\n1,2\n3,way\n", "x,y\n1,2\n3,nan\n", "x,y,stand_s\n1,2,0\n3,4,-1\n"]
        {
            assert!(waypoints(bad).is_err(), "{bad:?}");
        }
        let message = Course::parse("no/such.csv").unwrap_err().to_string();
        assert!(message.contains("no/such.csv") && message.lines().count() == 1, "{message}");
    }
}
