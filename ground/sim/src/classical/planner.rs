//! Map, search and optimisation put together: from where the vehicle will be to a trajectory toward an aim.

use std::f64::consts::TAU;

use goshawk_core::{FlatState, Vec3};

use super::distance::DistanceField;
use super::map::{Ignored, Map};
use super::optimise::{Wanted, optimise};
use super::search::{Path, Query, search};
use super::spline::Spline;
use crate::render::{Camera, CameraPose};

/// How far ahead is planned, m.
const HORIZON_M: f64 = 8.0;
/// Most acceleration, m/s²: 37 degrees of tilt, so that feedback has room below the limit of 45.
pub const ACC_MPS2: f64 = 7.5;
/// Least distance to an occupied voxel's centre, m: what the search demands, what a trajectory must have to be flown, and
/// what the optimisation strives for. The body's radius is 0.16, half a voxel's diagonal 0.17.
const SEARCH_M: f64 = 0.45;
const FLY_M: f64 = 0.33;
const STRIVE_M: f64 = 0.9;
/// Where it begins too near to something, a trajectory may be about as near over this way, m.
const ESCAPE_M: f64 = 0.6;
/// Between checks of a trajectory, s.
const CHECK_S: f64 = 0.04;
/// Duration of a span of the spline, about, s, and how many there are.
const SPAN_S: f64 = 0.22;
const SPANS: [usize; 2] = [5, 14];
/// The shortest trajectory, s.
const SHORTEST_S: f64 = 0.8;
/// A spline whose speed (or root of acceleration) exceeds its limit by this factor is stretched in time, by so much at most.
const TOO_FAST: f64 = 1.1;
const STRETCH_MAX: f64 = 1.4;
/// A goal within an obstacle is moved to the free place nearest to it on rings of these radii, m; directions of a ring.
const RINGS_M: [f64; 4] = [0.4, 0.8, 1.2, 1.6];
const DIRECTIONS: usize = 12;

/// Where to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// m.
    pub pos_world: Vec3,
    /// Velocity there, m/s.
    pub vel_world: Vec3,
    /// Not sooner than this, s.
    pub after_s: f64,
}

/// The map-based planner.
#[derive(Clone, Debug, Default)]
pub struct MapPlanner {
    map: Map,
    field: DistanceField,
}

impl MapPlanner {
    /// Takes a depth image into the map.
    pub fn see(&mut self, camera: &Camera, pose: &CameraPose, depth_mm: &[u16], ignored: Option<&Ignored>) {
        self.map.integrate(camera, pose, depth_mm, ignored);
        self.field.update(&self.map);
    }

    /// A way to the goal.
    #[must_use]
    pub fn search(&self, start: &FlatState, goal: &Aim, speed_mps: f64) -> Option<Path> {
        let query =
            Query { start: *start, goal_world: goal.pos_world, speed_mps, acc_mps2: ACC_MPS2, clearance_m: SEARCH_M };
        search(&query, &self.map, &self.field)
    }

    /// What of an aim can be planned to: within the horizon, and free as far as is known.
    #[must_use]
    pub fn local_goal(&self, start: &FlatState, aim: &Aim, speed_mps: f64) -> Aim {
        let line = aim.pos_world - start.pos;
        let distance = line.norm();
        if distance <= HORIZON_M {
            let pos_world = self.freed(start.pos, aim.pos_world);
            return Aim { pos_world, ..*aim };
        }
        let pos_world = self.freed(start.pos, start.pos + line * (HORIZON_M / distance));
        // Beyond the horizon it goes on, no faster than it can stop within it.
        let speed = speed_mps.min((ACC_MPS2 * HORIZON_M).sqrt().max(aim.vel_world.norm()));
        let flat = Vec3::new(line.x, line.y, 0.0).try_normalize(1e-6).unwrap_or_default();
        Aim { pos_world, vel_world: flat * speed, after_s: 0.0 }
    }

    /// The goal, or the free place next to it; of places as near, the one nearest to `from`.
    fn freed(&self, from: Vec3, goal: Vec3) -> Vec3 {
        let free = |at: &Vec3| self.field.coarse(at) > SEARCH_M;
        if free(&goal) {
            return goal;
        }
        let on_ring = |radius: f64, k: usize| {
            let turn = TAU * k as f64 / DIRECTIONS as f64;
            goal + Vec3::new(turn.cos(), turn.sin(), 0.0) * radius
        };
        let nearest = |radius: &f64| {
            let places = (0..DIRECTIONS).map(|k| on_ring(*radius, k)).filter(free);
            places.min_by(|a, b| (a - from).norm().total_cmp(&(b - from).norm()))
        };
        RINGS_M.iter().find_map(nearest).unwrap_or(goal)
    }

    /// The trajectory along a path; none: none that keeps clear of everything was found.
    #[must_use]
    pub fn refine(&self, start: &FlatState, goal: &Aim, path: &Path, speed_mps: f64) -> Option<Spline> {
        let duration = path.duration().max(goal.after_s).max(SHORTEST_S);
        let (end, vel) =
            if path.reached { (goal.pos_world, goal.vel_world) } else { (path.end(), goal.vel_world * 0.3) };
        let wanted = Wanted {
            start: *start,
            end_world: Some(end),
            end_vel_world: vel,
            height_m: goal.pos_world.z,
            speed_mps: speed_mps.max(start.vel.norm()),
            acc_mps2: ACC_MPS2,
            clearance_m: STRIVE_M,
        };
        let pace = path.duration() / duration;
        let mut spline = self.shaped(&wanted, duration, |t| path.at(t * pace));
        let excess = excess(&spline, &wanted);
        if excess > TOO_FAST {
            let (points, step_s) = (spline.points.clone(), spline.step_s * excess.min(STRETCH_MAX));
            spline = optimise(&wanted, &self.field, &points, step_s);
        }
        self.is_clear(&spline, 0.0).then_some(spline)
    }

    /// The trajectory that comes to rest soonest, around what is in the way.
    #[must_use]
    pub fn stop(&self, start: &FlatState) -> Spline {
        let speed = start.vel.norm();
        let duration = (speed / ACC_MPS2 + 0.3).max(SHORTEST_S);
        let wanted = Wanted {
            start: *start,
            end_world: None,
            end_vel_world: Vec3::zeros(),
            height_m: start.pos.z,
            speed_mps: speed.max(1.0),
            acc_mps2: ACC_MPS2,
            clearance_m: STRIVE_M,
        };
        self.shaped(&wanted, duration, |t| {
            let t = t.min(duration);
            start.pos + start.vel * (t - 0.5 * t * t / duration)
        })
    }

    /// The optimised spline of a duration that begins as `seed` leads.
    fn shaped(&self, wanted: &Wanted, duration: f64, seed: impl Fn(f64) -> Vec3) -> Spline {
        let spans = ((duration / SPAN_S).ceil() as usize).clamp(SPANS[0], SPANS[1]);
        let step_s = duration / spans as f64;
        let points: Vec<Vec3> = (0..spans + 3).map(|i| seed((i as f64 - 1.0) * step_s)).collect();
        optimise(wanted, &self.field, &points, step_s)
    }

    /// A trajectory keeps clear of everything that is known, from `after_s` on.
    #[must_use]
    pub fn is_clear(&self, spline: &Spline, after_s: f64) -> bool {
        let begin = spline.at(after_s).0.pos;
        let least = self.field.sample(&begin).0 - 0.05;
        let checks = ((spline.duration() - after_s).max(0.0) / CHECK_S).ceil() as usize;
        (0..=checks).map(|k| spline.at(after_s + CHECK_S * k as f64).0.pos).all(|at| {
            let distance = self.field.sample(&at).0;
            distance >= FLY_M || (distance >= least && (at - begin).norm() < ESCAPE_M)
        })
    }
}

/// By which factor time must be stretched to keep a spline within its limits.
fn excess(spline: &Spline, wanted: &Wanted) -> f64 {
    let checks = (spline.duration() / CHECK_S).ceil() as usize;
    (0..=checks)
        .map(|k| spline.at(CHECK_S * k as f64).0)
        .map(|s| (s.vel.norm() / wanted.speed_mps).max((s.acc.norm() / wanted.acc_mps2).sqrt()))
        .fold(0.0, f64::max)
}
