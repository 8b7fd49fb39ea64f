//! What a campaign's page needs of a flight, as the report's JSON has it: its path, and what stood about, cut at one
//! height.

mod contour;
pub mod trace;

use goshawk_core::{Task, Vec3};
use serde::Serialize;

use super::Pick;
use super::report::stats::quantile;
use crate::trial::{Flight, Outcome, TrialConfig, TrialError};
use contour::{outlines, simplified};
use trace::{Sample, TRUTHS_HZ, TargetSample, Trace};

/// Shown around the paths, m; and at least so much, across and up.
const AROUND_M: f64 = 2.5;
const LEAST_M: [f64; 2] = [20.0, 8.0];
/// Height over width, at most.
const STEEPEST: f64 = 0.72;
/// Fineness of the outlines, and what is left out of them, m.
const OUTLINE_M: f64 = 0.05;
const TOLERANCE_M: f64 = 0.02;

/// A flight as the report's JSON has it: columns of one length for its samples, rounded to 1 mm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FlightPath {
    /// Which flight.
    pub cell: usize,
    /// See `cell`.
    pub trial: usize,
    /// Between samples, s; the first one is the task's beginning.
    pub period_s: f64,
    /// The vehicle, world frame.
    pub pos_m: Vec<[f64; 3]>,
    /// Its speed.
    pub speed_mps: Vec<f64>,
    /// From its sphere to the nearest obstacle; below 0: it touched.
    pub clearance_m: Vec<f64>,
    /// The target; none in navigation.
    pub target: Option<TargetPath>,
    /// Errors of the target's estimate across the line of sight, one a frame with an estimate.
    pub lateral_m: Vec<f64>,
    /// And along it.
    pub longitudinal_m: Vec<f64>,
    /// What stood about.
    pub map: Map,
}

/// The target at the samples.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TargetPath {
    /// Its centre, world frame.
    pub pos_m: Vec<[f64; 3]>,
    /// Where the camera has the centre (u, v), also outside the image; none: behind it.
    pub pixel: Vec<Option<[f64; 2]>>,
    /// The last frame showed it well enough to count as seen.
    pub visible: Vec<bool>,
}

/// Rounded to a thousandth: what reads well in JSON.
fn milli(value: f64) -> f64 {
    (1e3 * value).round() / 1e3
}

impl FlightPath {
    /// Of a flight; grows its world again.
    ///
    /// # Errors
    /// If the world cannot be had again.
    pub fn of(pick: Pick, config: &TrialConfig, flight: &Flight, trace: &Trace) -> Result<Self, TrialError> {
        let single = |value: f32| milli(f64::from(value));
        let samples = &trace.samples;
        let targets: Vec<TargetSample> = samples.iter().filter_map(|s| s.target).collect();
        let target = (!targets.is_empty()).then(|| TargetPath {
            pos_m: targets.iter().map(|t| t.pos_world.map(single)).collect(),
            pixel: targets.iter().map(|t| t.pixel.map(|p| p.map(single))).collect(),
            visible: targets.iter().map(|t| t.visible).collect(),
        });
        let rounded = |values: &[f64]| values.iter().copied().map(milli).collect();
        Ok(Self {
            cell: pick.cell,
            trial: pick.trial,
            period_s: trace.stride as f64 / TRUTHS_HZ,
            pos_m: samples.iter().map(|s| s.pos_world.map(single)).collect(),
            speed_mps: samples.iter().map(|s| single(s.speed_mps)).collect(),
            clearance_m: samples.iter().map(|s| single(s.clearance_m)).collect(),
            target,
            lateral_m: rounded(&flight.metrics.lateral_m),
            longitudinal_m: rounded(&flight.metrics.longitudinal_m),
            map: Map::of(config, flight, samples)?,
        })
    }
}

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
            at_m: <[f64; 2]>::from(mover.at(flight.stage_s)).map(milli),
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
