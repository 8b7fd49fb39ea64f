//! What stood about a flight's path, cut at one height: the map that the report's JSON carries.

use goshawk_core::{Task, Vec3};
use serde::Serialize;

use super::contour::{outlines, simplified};
use super::stats::quantile;
use super::trace::{Sample, milli};
use crate::trial::{Flight, Outcome, TrialConfig, TrialError};

/// Shown around the paths, m; and at least so much, across and up.
const AROUND_M: f64 = 2.5;
const LEAST_M: [f64; 2] = [20.0, 8.0];
/// Height over width, at most.
const STEEPEST: f64 = 0.72;
/// Fineness of the outlines, and what is left out of them, m.
const OUTLINE_M: f64 = 0.05;
const TOLERANCE_M: f64 = 0.02;

/// A flight's surroundings in the plane, world frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Map {
    /// Opposite corners of what is mapped.
    pub min_m: [f64; 2],
    /// See `min_m`.
    pub max_m: [f64; 2],
    /// Height of the cut: of the flight; after a collision that of the contact.
    pub cut_m: f64,
    /// Where the vehicle took off.
    pub start_m: [f64; 2],
    /// Where a navigation leads; none in a chase.
    pub goal_m: Option<[f64; 2]>,
    /// Closed outlines of what stands.
    pub solids: Vec<Vec<[f64; 2]>>,
    /// What moves.
    pub movers: Vec<MoverMap>,
}

/// A moving obstacle's way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MoverMap {
    /// It goes to and fro between these.
    pub ends_m: [[f64; 2]; 2],
    /// Where it was at the flight's end.
    pub at_m: [f64; 2],
    /// Of the circle about it.
    pub radius_m: f64,
}

impl Map {
    /// Grows the flight's world again.
    ///
    /// # Errors
    /// If the world cannot be had again.
    pub fn of(config: &TrialConfig, flight: &Flight, samples: &[Sample]) -> Result<Self, TrialError> {
        let scene = config.scene()?;
        let (start, end) = (scene.world.start_world(), flight.end_world);
        let goal = (config.task == Task::Navigate).then(|| [scene.goal_world.x, scene.goal_world.y]);
        let ways = samples.iter().flat_map(|s| [Some(s.pos_world), s.target.map(|t| t.pos_world)]).flatten();
        let mut points = vec![[start.x, start.y], [end.x, end.y]];
        points.extend(goal);
        points.extend(ways.map(|[x, y, _]| [f64::from(x), f64::from(y)]));
        let [min_m, max_m] = around(&points);
        let heights: Vec<f64> = samples.iter().map(|s| f64::from(s.pos_world[2])).collect();
        let cut_m = match flight.outcome {
            // What was hit, where it was hit.
            Outcome::Collision => end.z,
            _ => quantile(&heights, 0.5).unwrap_or(end.z),
        };
        let field = |x: f64, y: f64| scene.world.clearance(&Vec3::new(x, y, cut_m));
        let solids = outlines(&field, min_m, max_m, OUTLINE_M);
        let rounded = |outline: Vec<[f64; 2]>| outline.into_iter().map(|p| p.map(milli)).collect();
        let movers = scene.movers.iter().map(|mover| MoverMap {
            ends_m: mover.ends().map(|end| <[f64; 2]>::from(end).map(milli)),
            at_m: <[f64; 2]>::from(mover.at(flight.metrics.task_s)).map(milli),
            radius_m: milli(mover.radius_m()),
        });
        Ok(Self {
            min_m: min_m.map(milli),
            max_m: max_m.map(milli),
            cut_m: milli(cut_m),
            start_m: [start.x, start.y].map(milli),
            goal_m: goal.map(|goal| goal.map(milli)),
            solids: solids.iter().map(|outline| rounded(simplified(outline, TOLERANCE_M))).collect(),
            movers: movers.collect(),
        })
    }
}

/// Corners of a rectangle with room around the points, not too small and not too steep.
fn around(points: &[[f64; 2]]) -> [[f64; 2]; 2] {
    let span = |axis: usize| {
        let values = || points.iter().map(|p| p[axis]);
        let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        (0.5 * (low + high), (high - low + 2.0 * AROUND_M).max(LEAST_M[axis]))
    };
    let ((x, width), (y, height)) = (span(0), span(1));
    let half = [0.5 * width.max(height / STEEPEST), 0.5 * height];
    [[x - half[0], y - half[1]], [x + half[0], y + half[1]]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_has_room_around_its_paths_and_is_never_steeper_than_a_screen() {
        assert_eq!(around(&[[0.0, 0.0], [40.0, 10.0]]), [[-2.5, -2.5], [42.5, 12.5]]);
        assert_eq!(around(&[[1.0, 1.0]]), [[-9.0, -3.0], [11.0, 5.0]]);
        let [min, max] = around(&[[0.0, 0.0], [0.0, 67.0]]);
        assert!(((max[1] - min[1]) / (max[0] - min[0]) - STEEPEST).abs() < 1e-9);
    }
}
