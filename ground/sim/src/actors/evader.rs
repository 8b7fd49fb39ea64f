//! The evader: a person who runs through the true map to a goal, is sent elsewhere midway, and never touches a tree.
//!
//! The whole run is planned before it begins, from the world and a seed; [`Evader::at`] then only looks it up. The
//! turn midway is nevertheless a surprise: until it happens the evader runs as if there were none. Who sees the vehicle and
//! gets away from it is a [`Reactive`].

mod course;
mod field;
mod pace;
mod path;
mod reactive;
#[cfg(test)]
mod tests;

use goshawk_core::Vec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use thiserror::Error;

use crate::actors::person::{CENTRE_M, Person, PersonLook, PersonPose};
use crate::world::World;
use course::Pass;
pub use course::{Course, CourseError};
use field::{Field, Point, column_clearance};
use pace::{Knot, Limits, Stand, place, timetable};
use path::{Path, relax, resample};
pub use reactive::Reactive;

/// How a person runs.
#[derive(Clone, Debug, PartialEq)]
pub struct EvaderConfig {
    /// What is run.
    pub course: Course,
    /// Most speed, m/s; reached where the way is straight enough.
    pub speed_mps: f64,
    /// Most acceleration, all directions together, m/s².
    pub acc_mps2: f64,
    /// Least distance from the body's axis to an obstacle between 0.3 and 1.7 m above the ground, m.
    pub margin_m: f64,
    /// How far ahead of the vehicle the goal is, m.
    pub goal_m: f64,
    /// The person stands this far ahead of the vehicle, from and to, m.
    pub start_m: [f64; 2],
}

impl EvaderConfig {
    /// The acceptance's evader at a speed, m/s.
    #[must_use]
    pub fn at_speed(speed_mps: f64) -> Self {
        Self { course: Course::Goal, speed_mps, acc_mps2: 5.0, margin_m: 0.45, goal_m: 40.0, start_m: [4.0, 6.0] }
    }
}

/// Why no run can be planned; another seed may do.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum EvaderError {
    /// Nowhere to stand in view of the vehicle.
    #[error("no free place in view of the vehicle for the evader to start from: try another seed or spacing")]
    NoStart,
    /// A course's waypoint is in something, or outside.
    #[error(
        "course {course}: waypoint {number} lies in an obstacle or outside the world, with no free place within {NEAR_M} m: move it, or try another --seed, --spacing or --world"
    )]
    NoRoomAt {
        /// The course.
        course: String,
        /// Which waypoint, from 1.
        number: usize,
    },
    /// A course's waypoint cannot be reached.
    #[error("course {course}: no way leads to waypoint {number}: move it, or try another --seed, --spacing or --world")]
    NoWayTo {
        /// The course.
        course: String,
        /// Which waypoint, from 1.
        number: usize,
    },
    /// No way to any goal.
    #[error("no way through the trees to any goal: try another seed or spacing")]
    NoWay,
}

/// Where the person is at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvaderState {
    /// Place and posture.
    pub pose: PersonPose,
    /// Velocity over the ground, m/s.
    pub vel_world: Vec3,
    /// How far it has run, m.
    pub path_m: f64,
    /// It stands at its goal.
    pub arrived: bool,
}

impl EvaderState {
    /// The tracked centre.
    #[must_use]
    pub fn centre_world(&self) -> Vec3 {
        self.pose.centre_world()
    }
}

/// One stretch of the run, with its own way and timetable.
#[derive(Clone, Debug)]
struct Leg {
    path: Path,
    knots: Vec<Knot>,
}

/// A planned run.
#[derive(Clone, Debug)]
pub struct Evader {
    look: PersonLook,
    heading_rad: f64,
    before: Leg,
    after: Leg,
    /// When the goal changes, s after the run's beginning.
    switch_s: f64,
}

/// A course's point is passed so near at least, m.
const NEAR_M: f64 = 3.0;

/// Heights of the camera from which the standing person must be seen, above the vehicle's start, m.
const SEEN_FROM_M: [f64; 2] = [0.8, 1.4];

impl Evader {
    /// Plans a run that begins in view of a vehicle at `vehicle_world` (on the ground) that looks along
    /// `heading_rad`.
    ///
    /// # Errors
    /// If there is no place to start or no way to run.
    pub fn plan(
        world: &World,
        config: &EvaderConfig,
        vehicle_world: Vec3,
        heading_rad: f64,
        seed: u64,
    ) -> Result<Self, EvaderError> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let look = PersonLook::random(&mut rng);
        let planning = Planning { world, field: Field::new(world), config, vehicle: vehicle_world, heading_rad };
        let mut failure = EvaderError::NoWay;
        for _ in 0..8 {
            let start = planning.start(&mut rng).ok_or(EvaderError::NoStart)?;
            match planning.run(start, &mut rng) {
                Ok((before, after, switch_s)) => {
                    let (_, along, _) = before.path.at(0.0);
                    return Ok(Self { look, heading_rad: along.y.atan2(along.x), before, after, switch_s });
                }
                Err(error) => failure = error,
            }
        }
        Err(failure)
    }

    /// Size and clothes.
    #[must_use]
    pub fn look(&self) -> &PersonLook {
        &self.look
    }

    /// How long the run takes, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.after.knots[self.after.knots.len() - 1].time_s
    }

    /// How long the way is, m.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.after.knots[self.after.knots.len() - 1].arc_m
    }

    /// When the goal changes, s after the run's beginning.
    #[must_use]
    pub fn switch_s(&self) -> f64 {
        self.switch_s
    }

    /// Place and posture `since_start_s` after the run's beginning; before it (negative) the person stands.
    #[must_use]
    pub fn at(&self, world: &World, since_start_s: f64) -> EvaderState {
        let leg = if since_start_s < self.switch_s { &self.before } else { &self.after };
        let knot = place(&leg.knots, since_start_s);
        let (position, along, _) = leg.path.at(knot.parameter);
        let moving = since_start_s > 0.0 && since_start_s < self.duration_s();
        let speed = if moving { knot.speed_mps } else { 0.0 };
        let direction = if along.norm() > 1e-6 {
            along.normalize()
        } else {
            Point::new(self.heading_rad.cos(), self.heading_rad.sin())
        };
        let foot_world = Vec3::new(position.x, position.y, world.ground_height(position.x, position.y));
        EvaderState {
            pose: PersonPose {
                foot_world,
                heading_rad: direction.y.atan2(direction.x),
                phase_rad: std::f64::consts::TAU * self.strides(knot.arc_m),
                stride: (speed / 2.5).min(1.0),
            },
            vel_world: Vec3::new(direction.x * speed, direction.y * speed, 0.0),
            path_m: knot.arc_m,
            arrived: since_start_s >= self.duration_s(),
        }
    }

    /// The person to draw `since_start_s` after the run's beginning.
    #[must_use]
    pub fn person(&self, world: &World, since_start_s: f64) -> Person {
        Person { look: self.look, pose: self.at(world, since_start_s).pose }
    }

    /// Full strides (two steps) over a distance: longer ones at speed.
    fn strides(&self, arc_m: f64) -> f64 {
        let mean_speed = self.length_m() / self.duration_s().max(1e-6);
        arc_m / (0.9 + 0.35 * mean_speed)
    }
}

/// Where a run begins.
const REST: Knot = Knot { time_s: 0.0, arc_m: 0.0, parameter: 0.0, speed_mps: 0.0 };

/// What planning needs.
struct Planning<'a> {
    world: &'a World,
    field: Field<'a>,
    config: &'a EvaderConfig,
    vehicle: Vec3,
    heading_rad: f64,
}

impl Planning<'_> {
    /// A wider margin than the evader's, so that smoothing has room.
    fn way_margin(&self) -> f64 {
        self.config.margin_m + 0.12
    }

    fn limits(&self) -> Limits {
        Limits { speed_mps: self.config.speed_mps, acc_mps2: self.config.acc_mps2 }
    }

    fn ahead(&self, distance_m: f64, bearing_rad: f64) -> Point {
        let angle = self.heading_rad + bearing_rad;
        self.vehicle.xy() + Point::new(angle.cos(), angle.sin()) * distance_m
    }

    /// A free place in front of the vehicle, in its view.
    fn start(&self, rng: &mut ChaCha8Rng) -> Option<Point> {
        let [near, far] = self.config.start_m;
        (0..300).find_map(|attempt| {
            let bearing = (12.0 + 0.08 * f64::from(attempt)).to_radians();
            let at = self.ahead(rng.random_range(near..far), rng.random_range(-bearing..bearing));
            let centre = Vec3::new(at.x, at.y, self.world.ground_height(at.x, at.y) + CENTRE_M);
            let seen = SEEN_FROM_M.iter().all(|h| {
                let eye = self.vehicle + Vec3::new(0.0, 0.0, *h);
                [-0.4, 0.0, 0.5].iter().all(|up| !self.world.occluded(&eye, &(centre + Vec3::new(0.0, 0.0, *up))))
            });
            let within = self.world.contains_xy(at.x, at.y, 1.5);
            (within && column_clearance(self.world, &at) > self.way_margin() && seen).then_some(at)
        })
    }

    /// Both legs and when the goal changes.
    fn run(&self, start: Point, rng: &mut ChaCha8Rng) -> Result<(Leg, Leg, f64), EvaderError> {
        match self.config.course.points(self.vehicle.xy(), self.heading_rad) {
            Some(points) => self.along(start, &points).map(|whole| (whole.clone(), whole, 0.0)),
            None => self.to_goals(start, rng).ok_or(EvaderError::NoWay),
        }
    }

    /// The run along a course's points.
    fn along(&self, start: Point, points: &[Pass]) -> Result<Leg, EvaderError> {
        let course = || self.config.course.name().to_owned();
        let mut passes: Vec<(usize, Pass)> = Vec::new();
        for (number, pass) in (1..).zip(points) {
            match self.free_near(&pass.at) {
                Some(at) => passes.push((number, Pass { at, ..*pass })),
                None if self.config.course.may_leave_out() => {}
                None => return Err(EvaderError::NoRoomAt { course: course(), number }),
            }
        }
        let all: Vec<Pass> = passes.iter().map(|(_, pass)| *pass).collect();
        self.leg(&[start], &all, REST).ok_or_else(|| {
            let from = std::iter::once(start).chain(all.iter().map(|pass| pass.at));
            let blocked =
                from.zip(&passes).find(|(at, (_, to))| self.field.way(at, &to.at, self.way_margin()).is_none());
            blocked.map_or(EvaderError::NoWay, |(_, &(number, _))| EvaderError::NoWayTo { course: course(), number })
        })
    }

    /// The run to one goal, and on the way to another.
    fn to_goals(&self, start: Point, rng: &mut ChaCha8Rng) -> Option<(Leg, Leg, f64)> {
        let before = (0..20).find_map(|_| {
            let goal = self.ahead(self.config.goal_m, rng.random_range(-0.3..0.3));
            self.leg(&[start], &[Pass { at: goal, stand_s: 0.0 }], REST)
        })?;
        let length = before.knots[before.knots.len() - 1].arc_m;
        let switch_arc = length * rng.random_range(0.35..0.6);
        let index = before.knots.partition_point(|k| k.arc_m < switch_arc);
        let switch = before.knots[index];
        // It takes the evader its braking distance and a step to turn.
        let mut commit = switch.speed_mps * switch.speed_mps / (1.5 * self.config.acc_mps2) + 0.8;
        for _ in 0..30 {
            let keep = (switch.parameter + commit / path::SPACING_M).ceil() as usize + 1;
            let turn = rng.random_range(0.35..1.0) * if rng.random_bool(0.5) { 1.0 } else { -1.0 };
            if keep + 4 < before.path.control.len() {
                let head = &before.path.control[..keep];
                let at = head[keep - 1];
                let left = (self.config.goal_m - (at - self.vehicle.xy()).norm()).max(14.0);
                let angle = self.heading_rad + turn;
                let goal = at + Point::new(angle.cos(), angle.sin()) * left;
                let elsewhere = (goal - before.path.at(before.path.end()).0).norm() > 5.0;
                if let Some(after) =
                    elsewhere.then(|| self.leg(head, &[Pass { at: goal, stand_s: 0.0 }], switch)).flatten()
                {
                    return Some((before, after, switch.time_s));
                }
            }
            commit = (commit * 1.1).min(0.3 * length);
        }
        None
    }

    /// The nearest place to a point where the evader has room, within [`NEAR_M`].
    fn free_near(&self, at: &Point) -> Option<Point> {
        (0..=12).find_map(|ring| {
            let radius = NEAR_M / 12.0 * f64::from(ring);
            (0..16).find_map(|turn| {
                let angle = std::f64::consts::TAU * f64::from(turn) / 16.0;
                let place = at + Point::new(angle.cos(), angle.sin()) * radius;
                let free = self.world.contains_xy(place.x, place.y, 1.5)
                    && column_clearance(self.world, &place) > self.way_margin() + 0.1;
                free.then_some(place)
            })
        })
    }

    /// From the end of `head` (control points that are kept) by way of all `passes`, entered at `from`: the quickest of
    /// several smoothings that keep the margin.
    fn leg(&self, head: &[Point], passes: &[Pass], from: Knot) -> Option<Leg> {
        let mut way = vec![head[head.len() - 1]];
        // Each pass lies at a share of the way's length.
        let (mut length, mut reached) = (0.0, Vec::new());
        for Pass { at: goal, stand_s } in passes {
            if !self.world.contains_xy(goal.x, goal.y, 1.5) {
                return None;
            }
            let last = way[way.len() - 1];
            let further = self.field.way(&last, goal, self.way_margin())?;
            length += further.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum::<f64>();
            reached.push((length, *stand_s));
            way.extend(further.into_iter().skip(1));
        }
        if way.len() < 2 {
            return None;
        }
        let mut control = head.to_vec();
        control.extend(resample(&way).into_iter().skip(1));
        [(2000.0, 0.25), (400.0, 0.2), (60.0, 0.2), (10.0, 0.15), (2.0, 0.1), (0.3, 0.1)]
            .iter()
            .filter_map(|&(stiffness, extra)| {
                let keep_m = self.config.margin_m + extra;
                let path = Path { control: relax(&self.field, &control, head.len(), stiffness, keep_m) };
                let stand = |&(at, stand_s): &(f64, f64)| {
                    let share = at / length.max(1e-6);
                    Stand { parameter: from.parameter + share * (path.end() - from.parameter), stand_s }
                };
                let stands: Vec<Stand> = reached.iter().filter(|(_, stand_s)| *stand_s > 0.0).map(stand).collect();
                let knots = timetable(&path, from, self.limits(), &stands)?;
                self.is_free(&path, from.parameter).then_some(Leg { path, knots })
            })
            .min_by(|a, b| a.knots[a.knots.len() - 1].time_s.total_cmp(&b.knots[b.knots.len() - 1].time_s))
    }

    /// The margin holds everywhere from a parameter on, by the true map.
    fn is_free(&self, path: &Path, from: f64) -> bool {
        let steps = ((path.end() - from) * path::SPACING_M / 0.1).ceil() as usize;
        (0..=steps).all(|i| {
            let (at, _, _) = path.at(from + (path.end() - from) * i as f64 / steps as f64);
            // Between two samples, and between two heights, it may be a little nearer.
            column_clearance(self.world, &at) >= self.config.margin_m + 0.02
        })
    }
}

/// Whether a body of `margin_m` can get from one place to another over the ground, both in the world frame.
#[must_use]
pub fn reachable(world: &World, from_world: &Vec3, to_world: &Vec3, margin_m: f64) -> bool {
    Field::new(world).way(&from_world.xy(), &to_world.xy(), margin_m).is_some()
}
