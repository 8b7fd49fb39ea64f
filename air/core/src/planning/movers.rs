//! What moves about the vehicle, and where it will be (beyond the paper).
//!
//! The network sees one image: it steers around where a thing is, not around where it will be. What comes to be where
//! the vehicle had looked through is new there (`obstacles.rs` marks such voxels). New points that lie together are
//! followed, seen from above, with a filter of constant velocity each. One that has gone a way of its own is a mover:
//! trajectories that would meet it on its way cost more, and where the best one would, the vehicle steps aside
//! (`evade.rs`).

use crate::values::error::{ConfigError, within};
use crate::values::types::{Flat, Time, Vec3};
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

/// So many are followed at once. Chosen by eye.
pub const MOST: usize = 8;

/// What is followed, each in a place of its own for as long as it is followed.
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
/// Out of sight its velocity fades with this time constant, s. Chosen by eye.
const FADES: f64 = 0.8;
/// Out of sight its place is in doubt by so much more, m/s, up to this, m. Chosen by eye.
const STRAYS: (f64, f64) = (0.5, 1.0);

impl Mover {
    /// Where it should be, m.
    #[must_use]
    pub fn at(&self, now: Time) -> Vec3 {
        self.pos_world + self.vel_world * now.since(self.stamp).clamp(0.0, LONGEST_CARRY)
    }
}

/// A new point is followed together with others within so many cells: as many as the grid is wide.
const CELLS: usize = 128;
/// Fewer points are noise. Chosen by eye.
const LEAST_POINTS: usize = 3;
/// More than so many groups in a frame are not looked at. Chosen by eye.
const MOST_GROUPS: usize = 16;
/// From the middle of what is seen, its surface, to the axis, m. Chosen by eye.
const BEHIND: f64 = 0.1;

/// What comes so near before one that is followed is it, m. Chosen by eye.
const AHEAD: f64 = 0.3;

/// Standard deviation of a group's middle, m. Chosen by eye.
const SIGHTING: f64 = 0.15;
/// White noise of a mover's acceleration, m²/s³. Chosen by eye.
const RESTLESS: f64 = 2.0;
/// Variance of the velocity of what is new, m²/s²: a walker's pace. Chosen by eye.
const ANY_SPEED: f64 = 2.0;
/// A group belongs to what should be within this, m. Chosen by eye.
const GATE: f64 = 0.7;
/// It moves once it was seen for so long, s, in so many frames, and went so far, m. Chosen by eye.
const PROVEN: (f64, u32, f64) = (0.2, 5, 0.25);
/// What does not yet move, and what does, is forgotten when it was not seen for so long, s. Chosen by eye.
const FORGOTTEN: (f64, f64) = (0.2, 3.0);
/// What should be seen and is not, since something behind it is, is gone after this, s. Chosen by eye.
const GONE: f64 = 0.2;

/// A trajectory is looked at in so many instants. Chosen by eye.
const LOOKS: u32 = 20;
/// And no farther ahead than this, s. Chosen by eye.
const HORIZON: f64 = 2.0;
/// What a mover's place comes to be in doubt by with time, m/s. Chosen by eye.
const DOUBT: f64 = 0.3;

/// What has come to be where nothing was, in one frame, seen from above: points in cells of a grid.
#[derive(Clone, Debug)]
pub(crate) struct Fresh {
    /// Where (m) and in which cell.
    points: Vec<([u8; 2], Vec3)>,
    /// A bit for each cell with a point.
    cells: [u128; CELLS],
}

impl Fresh {
    pub(crate) fn new(most: usize) -> Self {
        Self { points: Vec::with_capacity(most), cells: [0; CELLS] }
    }

    pub(crate) fn clear(&mut self) {
        self.points.clear();
        self.cells = [0; CELLS];
    }

    /// A point at `at_world` in a cell of the grid, counted from its lowest.
    pub(crate) fn push(&mut self, [x, y]: [u8; 2], at_world: Vec3) {
        if self.points.len() < self.points.capacity() && usize::from(x.max(y)) < CELLS {
            self.points.push(([x, y], at_world));
            self.cells[usize::from(y)] |= 1 << x;
        }
    }

    /// Takes a group of cells that touch, corners and one cell between included; none: nothing is left.
    fn take_group(&mut self) -> Option<[u128; CELLS]> {
        let first = self.cells.iter().position(|row| *row != 0)?;
        let mut group = [0_u128; CELLS];
        group[first] = 1 << self.cells[first].trailing_zeros();
        loop {
            let mut grown = group;
            for (y, row) in grown.iter_mut().enumerate() {
                let about = y.saturating_sub(2)..=(y + 2).min(CELLS - 1);
                let near = group[about].iter().fold(0, |bits, row| bits | row);
                *row |= self.cells[y] & (near | near << 1 | near >> 1 | near << 2 | near >> 2);
            }
            if grown == group {
                break;
            }
            group = grown;
        }
        self.cells.iter_mut().zip(&group).for_each(|(left, taken)| *left &= !taken);
        Some(group)
    }
}

/// Points that lie together.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Group {
    middle: Flat,
    radius: f64,
}

/// One that is followed: the same filter for x and y.
#[derive(Clone, Copy, Debug)]
struct Track {
    stamp: Time,
    born: (Time, Flat),
    seen: (Time, u32),
    pos: Flat,
    vel: Flat,
    /// Variances of position and velocity, and between them.
    var: [f64; 3],
    radius: f64,
    moves: bool,
    /// For how long one has looked through where it should be, s.
    gone: f64,
}

impl Track {
    fn new(stamp: Time, group: &Group) -> Self {
        Self {
            stamp,
            born: (stamp, group.middle),
            seen: (stamp, 1),
            pos: group.middle,
            vel: Flat::zeros(),
            var: [SIGHTING * SIGHTING, 0.0, ANY_SPEED],
            radius: group.radius,
            moves: false,
            gone: 0.0,
        }
    }

    fn predict(&mut self, now: Time) {
        let dt = now.since(self.stamp).clamp(0.0, 1.0);
        self.stamp = now;
        self.pos += self.vel * dt;
        if self.unmatched() > FORGOTTEN.0 {
            self.vel *= (-dt / FADES).exp();
        }
        let [pos, cross, vel] = self.var;
        let (dt2, dt3) = (dt * dt, dt * dt * dt);
        self.var = [
            pos + 2.0 * dt * cross + dt2 * vel + RESTLESS * dt3 / 3.0,
            cross + dt * vel + RESTLESS * dt2 / 2.0,
            vel + RESTLESS * dt,
        ];
    }

    fn update(&mut self, group: &Group, min_speed: f64) {
        let [pos, cross, vel] = self.var;
        let sum = pos + SIGHTING * SIGHTING;
        let missed = group.middle - self.pos;
        self.pos += missed * (pos / sum);
        self.vel += missed * (cross / sum);
        self.var = [pos - pos * pos / sum, cross - pos * cross / sum, vel - cross * cross / sum];
        self.radius += 0.2 * (group.radius - self.radius);
        self.seen = (self.stamp, self.seen.1 + 1);
        self.gone = 0.0;
        let (time, count, way) = PROVEN;
        let long = self.stamp.since(self.born.0) >= time && self.seen.1 >= count;
        self.moves |= long && (self.pos - self.born.1).norm() >= way && self.vel.norm() >= min_speed;
    }

    fn unmatched(&self) -> f64 {
        self.stamp.since(self.seen.0)
    }

    fn is_forgotten(&self) -> bool {
        self.gone > GONE || self.unmatched() > if self.moves { FORGOTTEN.1 } else { FORGOTTEN.0 }
    }
}

/// Follows what moves.
#[derive(Clone, Debug)]
pub(crate) struct Followed {
    config: MoversConfig,
    tracks: [Option<Track>; MOST],
}

impl Followed {
    pub(crate) fn new(config: MoversConfig) -> Self {
        Self { config, tracks: [None; MOST] }
    }

    /// The same tracks, from here on by other rules.
    pub(crate) fn with(self, config: MoversConfig) -> Self {
        Self { config, ..self }
    }

    pub(crate) fn reset(&mut self) {
        self.tracks = [None; MOST];
    }

    /// Takes in what is new in a frame, seen from `cam_world`. `through`: one looks through a place.
    pub(crate) fn step(&mut self, stamp: Time, cam_world: &Vec3, new: &mut Fresh, through: impl Fn(&Flat) -> bool) {
        for slot in &mut self.tracks {
            if let Some(track) = slot {
                let dt = stamp.since(track.stamp).clamp(0.0, 1.0);
                track.predict(stamp);
                track.gone = if through(&track.pos) { track.gone + dt } else { 0.0 };
            }
            *slot = slot.filter(|track| !track.is_forgotten() && track.pos.iter().all(|x| x.is_finite()));
        }
        let mut taken = [false; MOST];
        for _ in 0..MOST_GROUPS {
            let Some(cells) = new.take_group() else { break };
            if let Some(group) = group(&self.config, &cells, &new.points, &cam_world.xy()) {
                self.see(stamp, &group, &mut taken);
            }
        }
    }

    /// A group belongs to the nearest track, or begins one.
    fn see(&mut self, stamp: Time, group: &Group, taken: &mut [bool; MOST]) {
        let distance = |track: &Option<Track>| track.map_or(f64::INFINITY, |t| (t.pos - group.middle).norm());
        let free = (0..MOST).filter(|k| !taken[*k]);
        let nearest = free.min_by(|a, b| distance(&self.tracks[*a]).total_cmp(&distance(&self.tracks[*b])));
        let Some(slot) = nearest else { return };
        if let Some(track) = self.tracks[slot].as_mut().filter(|t| (t.pos - group.middle).norm() < GATE) {
            track.update(group, self.config.min_speed_mps);
            taken[slot] = true;
        } else if let Some(slot) = (0..MOST).find(|k| self.tracks[*k].is_none()) {
            self.tracks[slot] = Some(Track::new(stamp, group));
            taken[slot] = true;
        }
    }

    /// A point is where one that moves was in the last frame, or about to be.
    pub(crate) fn covers(&self, at_world: &Vec3) -> bool {
        let covers = |track: &Track| track.moves && (track.pos - at_world.xy()).norm() < track.radius + AHEAD;
        self.tracks.iter().flatten().any(covers)
    }

    /// Those that move, at the height `z` (m).
    pub(crate) fn movers(&self, z: f64) -> Movers {
        let mover = |track: Track| Mover {
            stamp: track.stamp,
            pos_world: Vec3::new(track.pos.x, track.pos.y, z),
            vel_world: Vec3::new(track.vel.x, track.vel.y, 0.0),
            radius: track.radius,
            pos_doubt: (STRAYS.0 * track.unmatched()).min(STRAYS.1),
        };
        self.tracks.map(|track| track.filter(|track| track.moves).map(mover))
    }
}

fn group(config: &MoversConfig, cells: &[u128; CELLS], points: &[([u8; 2], Vec3)], cam: &Flat) -> Option<Group> {
    let within = || points.iter().filter(|([x, y], _)| cells[usize::from(*y)] >> x & 1 == 1).map(|(_, at)| at);
    let count = within().count();
    let (low, high) = within().fold((f64::MAX, f64::MIN), |(low, high), at| (low.min(at.z), high.max(at.z)));
    if count < LEAST_POINTS || high - low < config.min_height_m {
        return None;
    }
    let surface = within().fold(Flat::zeros(), |sum, at| sum + at.xy()) / count as f64;
    let away = (surface - cam).try_normalize(1e-3).unwrap_or_default();
    let spread = within().map(|at| (at.xy() - surface).norm()).fold(0.0, f64::max);
    let [least, most] = config.radius_m;
    Some(Group { middle: surface + away * BEHIND, radius: spread.clamp(least, most) })
}

/// How bad it is whose way a way that begins at `stamp` crosses: 0 nobody's, 1 somebody's at once. `way` gives the place
/// (m) at a time, s, up to `horizon`, s, and keeps `clearance` (m).
#[must_use]
pub fn meeting(movers: &Movers, clearance: f64, stamp: Time, way: &impl Fn(f64) -> Vec3, horizon: f64) -> f64 {
    let horizon = horizon.min(HORIZON);
    let cost = |mover: &Mover| {
        let from = mover.at(stamp);
        let at = |k: u32| {
            let time = horizon * f64::from(k) / f64::from(LOOKS);
            let gap = (way(time) - from - mover.vel_world * time).xy().norm() - mover.radius;
            let kept = clearance + mover.pos_doubt + DOUBT * time;
            (1.0 - time / HORIZON) * (1.0 - gap / kept).clamp(0.0, 1.0)
        };
        (1..=LOOKS).map(at).fold(0.0, f64::max)
    };
    movers.iter().flatten().map(cost).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;
    use proptest::prelude::*;

    /// What a camera in the origin sees new of a post of 0.2 m that stands at `at`: its near side, 1.2 m of it.
    fn see(followed: &mut Followed, time: f64, at: Flat) {
        let mut new = Fresh::new(256);
        for (k, z) in [-0.6, -0.2, 0.2, 0.6].iter().enumerate() {
            let side = Flat::new(-0.15, 0.1 * (k as f64 - 1.5));
            let place = at + side;
            let cell = [place.x, place.y].map(|x| (x / 0.2 + 64.0) as u8);
            new.push(cell, Vec3::new(place.x, place.y, *z));
        }
        followed.step(Time::from_secs(time), &Vec3::zeros(), &mut new, |_| false);
    }

    /// Seen at 30 Hz for so many frames, from (5, -1) at `vel`.
    fn followed(vel: Flat, frames: u32) -> Followed {
        let mut followed = Followed::new(shipped::tuning().planner.movers);
        for k in 0..frames {
            let time = f64::from(k) / 30.0;
            see(&mut followed, 1.0 + time, Flat::new(5.0, -1.0) + vel * time);
        }
        followed
    }

    #[test]
    fn what_goes_a_way_of_its_own_is_known_with_its_velocity_within_half_a_second() {
        let vel = Flat::new(-0.5, 1.2);
        let movers = followed(vel, 15).movers(1.5);
        let mover = movers.iter().flatten().next().expect("it moves");
        assert!((mover.vel_world.xy() - vel).norm() < 0.35, "{}", mover.vel_world);
        let at = Flat::new(5.0, -1.0) + vel * (14.0 / 30.0);
        assert!((mover.pos_world.xy() - at).norm() < 0.25 && mover.pos_world.z == 1.5, "{}", mover.pos_world);
    }

    #[test]
    fn what_stands_is_none() {
        assert!(followed(Flat::zeros(), 60).movers(0.0).iter().all(Option::is_none));
    }

    #[test]
    fn out_of_sight_it_fades_is_in_doubt_and_is_forgotten() {
        let mut followed = followed(Flat::new(0.0, 1.2), 15);
        let mut step = |from: u32, to: u32| {
            for k in from..to {
                let stamp = Time::from_secs(1.0 + f64::from(k) / 30.0);
                followed.step(stamp, &Vec3::zeros(), &mut Fresh::new(1), |_| false);
            }
            followed.movers(0.0).into_iter().flatten().next()
        };
        let late = step(15, 75).expect("2 s later it is still about");
        assert!(late.vel_world.norm() < 0.3 && late.pos_doubt > 0.7, "{late:?}");
        assert_eq!(step(75, 120), None);
    }

    #[test]
    fn where_one_looks_through_it_is_gone() {
        let mut followed = followed(Flat::new(0.0, 1.2), 15);
        for k in 15..24 {
            let stamp = Time::from_secs(1.0 + f64::from(k) / 30.0);
            followed.step(stamp, &Vec3::zeros(), &mut Fresh::new(1), |_| true);
        }
        assert!(followed.movers(0.0).iter().all(Option::is_none));
    }

    #[test]
    fn who_crosses_the_way_costs_the_more_the_sooner_and_who_has_passed_nothing() {
        let stamp = Time::from_secs(1.0);
        let mover = |at: f64, vel: f64| {
            let mut movers: Movers = [None; MOST];
            movers[3] = Some(Mover {
                stamp,
                pos_world: Vec3::new(4.0, at, 1.0),
                vel_world: Vec3::y() * vel,
                radius: 0.3,
                pos_doubt: 0.0,
            });
            movers
        };
        let cost = |movers: &Movers, speed: f64| meeting(movers, 0.5, stamp, &|time| Vec3::x() * (speed * time), 3.0);
        let [late, soon] = [cost(&mover(-2.0, 1.0), 2.1), cost(&mover(-1.0, 1.0), 4.0)];
        assert!(late > 0.0 && soon > 2.0 * late, "{late} {soon}");
        assert_eq!(cost(&mover(2.0, 1.5), 4.0), 0.0, "it goes away from the way");
    }

    proptest! {
        #[test]
        fn whatever_comes_nothing_panics(
            points in prop::collection::vec((any::<[u8; 2]>(), prop::array::uniform3(prop::num::f64::ANY)), 0..64),
            times in prop::collection::vec(-1e9..1e9f64, 1..6), at in prop::array::uniform3(prop::num::f64::ANY)
        ) {
            let mut followed = Followed::new(shipped::tuning().planner.movers);
            for time in times {
                let mut new = Fresh::new(64);
                points.iter().for_each(|(cell, at)| new.push(*cell, Vec3::from(*at)));
                followed.step(Time::from_secs(time), &Vec3::from(at), &mut new, |_| false);
                let cost = meeting(&followed.movers(0.0), 0.5, Time::from_secs(time), &|_| Vec3::from(at), 2.0);
                prop_assert!((0.0..=1.0).contains(&cost));
            }
        }
    }
}
