//! What moves about the vehicle, and where it will be (beyond the paper).
//!
//! The network sees one image: it steers around where a thing is, not around where it will be. Two things tell what moves.
//! What stands apart is followed from afar, by its middle ([`scan`], [`apart`]). Near by, what comes to be where the
//! vehicle had looked through is new (`obstacles.rs` marks such voxels), however little of it is in the image
//! ([`emerging`]). Both are followed seen from above, with a filter of constant velocity each ([`track`]). Trajectories
//! that would meet a mover on its way cost more, and where the best one would, the vehicle steps aside (`evade.rs`).

mod apart;
mod emerging;
mod scan;
mod track;

use crate::planning::movers::apart::Apart;
use crate::planning::movers::emerging::Emerging;
pub(crate) use crate::planning::movers::emerging::Fresh;
use crate::planning::movers::scan::Scan;
use crate::planning::nearest::Nearest;
use crate::values::error::{ConfigError, within};
use crate::values::types::{Flat, Rot, Time, Vec3};
use schemars::JsonSchema;
use serde::Deserialize;

/// What counts as something that moves, and how far to keep from it.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MoversConfig {
    /// Kept between the vehicle's centre and the surface of what moves, m.
    #[schemars(range(min = 0.1, max = 5.0), extend("x-why" = "less touches it, with more no way is free", "x-source" = "chosen by eye"))]
    pub clearance_m: f64,
    /// Radius of what moves, at least and at most, m.
    #[schemars(inner(range(min = 0.05, max = 3.0)), extend("x-why" = "the least is at most the most, and what is wider shows but a part of itself", "x-source" = "chosen by eye"))]
    pub radius_m: [f64; 2],
    /// What is seen to be less high than this is taken for leaves, m.
    #[schemars(range(min = 0.0, max = 3.0), extend("x-why" = "nothing near by shows more of its height", "x-source" = "chosen by eye"))]
    pub min_height_m: f64,
    /// What goes slower than this does not move, m/s.
    #[schemars(range(min = 0.05, max = 5.0), extend("x-why" = "slower are errors of depth and odometry, and people walk at 1.4 m/s", "x-source" = "chosen by eye"))]
    pub min_speed_mps: f64,
}

impl MoversConfig {
    /// Checks what no key says alone.
    ///
    /// # Errors
    /// The first value that contradicts another one, by name.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let ordered = "the least is at most the most, and what is wider shows but a part of itself";
        within("planner.movers.radius_m", self.radius_m[0], 0.05..=self.radius_m[1], ordered)
    }
}

/// So many are kept away from at once. Chosen by eye.
pub const MOST: usize = 8;

/// What moves.
pub type Movers = [Option<Mover>; MOST];

/// Something that moves, as an upright cylinder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mover {
    /// When it is true.
    pub stamp: Time,
    /// A point of its axis, at the camera's height, world frame, m.
    pub pos_world: Vec3,
    /// Level, m/s.
    pub vel_world: Vec3,
    /// Of the cylinder, m.
    pub radius: f64,
    /// It may be nearer by so much, m.
    pub pos_doubt: f64,
}

/// Between frames a mover is carried on for so long, s. Chosen by eye.
const LONGEST_CARRY: f64 = 0.3;

impl Mover {
    /// Where it should be, m.
    #[must_use]
    pub fn at(&self, now: Time) -> Vec3 {
        self.pos_world + self.vel_world * now.since(self.stamp).clamp(0.0, LONGEST_CARRY)
    }
}

/// A trajectory is looked at in so many instants. Chosen by eye.
const LOOKS: u32 = 20;
/// And no farther ahead than this, s. Chosen by eye.
const HORIZON: f64 = 2.0;
/// What a mover's place comes to be in doubt by with time, m/s. Chosen by eye.
const DOUBT: f64 = 0.3;

/// Who is nearer to a mover than the clearance keeps what there is, and so much at least, m. Chosen by eye.
const LEAST_ROOM: f64 = 0.2;

/// What emerges so near to something apart is it, m. Chosen by eye.
const ONE: f64 = 0.8;

/// Follows what moves.
#[derive(Clone, Debug)]
pub(crate) struct Followed {
    scan: Scan,
    apart: Apart,
    emerging: Emerging,
}

impl Followed {
    /// Seen through a camera of these fields of view, rad.
    pub(crate) fn new(hfov: f64, vfov: f64, config: MoversConfig) -> Self {
        Self { scan: Scan::new(hfov, vfov), apart: Apart::new(config), emerging: Emerging::new(config) }
    }

    /// The same tracks, from here on by other rules.
    pub(crate) fn with(self, config: MoversConfig) -> Self {
        Self { apart: self.apart.with(config), emerging: self.emerging.with(config), ..self }
    }

    pub(crate) fn reset(&mut self) {
        self.apart.reset();
        self.emerging.reset();
    }

    /// Takes in a frame seen from `pose`, and what is `new` in it. `is_target`: what is there is the target. `through`:
    /// one looks through a place. `known`: one looked through it once.
    pub(crate) fn step(
        &mut self,
        stamp: Time,
        pose: (&Vec3, &Rot),
        (nearest, new): (&Nearest, &mut Fresh),
        is_target: impl Fn(&Flat) -> bool,
        through: impl Fn(&Flat) -> bool,
        known: impl Fn(&Flat) -> bool,
    ) {
        self.emerging.step(stamp, pose.0, new, &through);
        self.apart.advance(stamp, &through);
        self.scan.see(pose, nearest);
        for thing in self.scan.things().filter(|thing| !is_target(&thing.surface)) {
            self.apart.see(stamp, &pose.0.xy(), &thing, &known, |at| self.scan.is_through(at));
        }
    }

    /// A point is where one that moves was in the last frame, or about to be.
    pub(crate) fn covers(&self, at_world: &Vec3) -> bool {
        self.emerging.covers(at_world) || self.apart.covers(at_world)
    }

    /// Those that move, at the height `z` (m).
    pub(crate) fn movers(&self, z: f64) -> Movers {
        let mut movers = [None; MOST];
        for mover in self.apart.movers(z).chain(self.emerging.movers(z)) {
            let near = |other: &Mover| (other.pos_world - mover.pos_world).xy().norm() < ONE;
            if !movers.iter().flatten().any(near)
                && let Some(slot) = movers.iter_mut().find(|slot| slot.is_none())
            {
                *slot = Some(mover);
            }
        }
        movers
    }
}

/// How bad it is whose way a way that begins at `stamp` crosses: 0 nobody's, 1 somebody's at once. `way` gives the place
/// (m) at a time, s, up to `horizon`, s, and keeps `clearance` (m).
#[must_use]
pub fn meeting(movers: &Movers, clearance: f64, stamp: Time, way: &impl Fn(f64) -> Vec3, horizon: f64) -> f64 {
    let horizon = horizon.min(HORIZON);
    let cost = |mover: &Mover| {
        let from = mover.at(stamp);
        let gap = |time: f64| (way(time) - from - mover.vel_world * time).xy().norm() - mover.radius;
        let wanted = (clearance + mover.pos_doubt).min(gap(0.0)).max(LEAST_ROOM);
        let at = |k: u32| {
            let time = horizon * f64::from(k) / f64::from(LOOKS);
            let kept = wanted + DOUBT * time;
            (1.0 - time / HORIZON) * (1.0 - gap(time) / kept).clamp(0.0, 1.0)
        };
        (1..=LOOKS).map(at).fold(0.0, f64::max)
    };
    movers.iter().flatten().map(cost).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests;
