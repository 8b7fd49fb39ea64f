//! An evader that sees who chases it: it turns, doubles back, and hides behind what stands about.
//!
//! It sees all round, as far as [`SEES_M`], and through nothing that the true map has. Twenty times a second it chooses an
//! acceleration after which it could still stop short of every obstacle, so it touches none, whatever the chaser does. Its
//! run is a pure function of the world, the seed, and where the chaser was.

use std::f64::consts::TAU;

use goshawk_core::Vec3;
use nalgebra::Rotation2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::field::{Field, Point, column_clearance};
use super::{Evader, EvaderConfig, EvaderState};
use crate::actors::person::{CENTRE_M, PersonLook, PersonPose};
use crate::world::World;

/// How far it sees a chaser, m.
const SEES_M: f64 = 15.0;
/// Between decisions, s.
const TICK_S: f64 = 0.05;
/// It simply runs for so long at first, s.
const CALM_S: f64 = 1.5;
/// Directions that it considers, and how far it looks into each, m.
const DIRECTIONS: u32 = 24;
const LOOKS_M: f64 = 6.0;
/// A hiding place is at most so far away, m; it takes so long to be hidden, and then stands for so long, s.
const HIDES_WITHIN_M: f64 = 8.0;
const HIDES_S: f64 = 3.0;
const STANDS_S: f64 = 1.0;
/// So near its end it no longer hides, m.
const LAST_M: f64 = 10.0;
/// It stands at its hiding place within this, m.
const THERE_M: f64 = 0.3;
/// More clearance than the margin, m: between two samples it may be a little nearer.
const SPARE_M: f64 = 0.1;
/// A run that gets nowhere ends after its way at a quarter of its speed, and this, s.
const GRACE_S: f64 = 10.0;

/// What it is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Doing {
    /// Running into a direction, rad.
    Run(f64),
    /// Running to a place that the chaser cannot see, and standing there.
    Hide(Point),
}

/// A run under way.
pub struct Reactive<'a> {
    world: &'a World,
    field: Field<'a>,
    config: EvaderConfig,
    look: PersonLook,
    length_m: f64,
    rng: ChaCha8Rng,
    /// When it decides next, s since the run's beginning; what follows is of the last decision, `TICK_S` before.
    next_s: f64,
    at: Point,
    vel: Point,
    acc: Point,
    path_m: f64,
    heading_rad: f64,
    doing: Doing,
    until_s: f64,
    /// It comes to rest.
    ending: bool,
}

impl<'a> Reactive<'a> {
    /// Stands where a planned run starts; is to run `length_m` in all.
    #[must_use]
    pub fn new(world: &'a World, config: &EvaderConfig, start: &Evader, length_m: f64, seed: u64) -> Self {
        let pose = start.at(world, -1.0).pose;
        Self {
            world,
            field: Field::new(world),
            config: config.clone(),
            look: *start.look(),
            length_m,
            rng: ChaCha8Rng::seed_from_u64(seed),
            next_s: 0.0,
            at: pose.foot_world.xy(),
            vel: Point::zeros(),
            acc: Point::zeros(),
            path_m: 0.0,
            heading_rad: pose.heading_rad,
            doing: Doing::Run(pose.heading_rad),
            until_s: CALM_S,
            ending: false,
        }
    }

    /// How long the whole way is, m.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Size and clothes.
    #[must_use]
    pub fn look(&self) -> &PersonLook {
        &self.look
    }

    /// Its state `since_start_s` after the run's beginning, before which (negative) it stands; the chaser is at
    /// `chaser_world` then. Times must not go back.
    pub fn advance(&mut self, since_start_s: f64, chaser_world: &Vec3) -> EvaderState {
        while since_start_s >= self.next_s {
            if self.next_s > 0.0 {
                (self.at, self.vel, self.path_m) = self.moved(TICK_S);
                if self.vel.norm() > 0.1 {
                    self.heading_rad = direction(&self.vel);
                }
            }
            self.decide(chaser_world);
            self.next_s += TICK_S;
        }
        let into_s = if self.next_s > 0.0 { since_start_s - (self.next_s - TICK_S) } else { 0.0 };
        let (at, vel, path_m) = self.moved(into_s);
        let speed = vel.norm();
        EvaderState {
            pose: PersonPose {
                foot_world: Vec3::new(at.x, at.y, self.world.ground_height(at.x, at.y)),
                heading_rad: if speed > 0.1 { direction(&vel) } else { self.heading_rad },
                phase_rad: TAU * path_m / (0.9 + 0.3 * self.config.speed_mps),
                stride: (speed / 2.5).min(1.0),
            },
            vel_world: Vec3::new(vel.x, vel.y, 0.0),
            path_m,
            arrived: self.ending && speed < 1e-9,
        }
    }

    /// Place, velocity and way so long after the last decision.
    fn moved(&self, into_s: f64) -> (Point, Point, f64) {
        let step = self.vel * into_s + self.acc * (0.5 * into_s * into_s);
        (self.at + step, self.vel + self.acc * into_s, self.path_m + step.norm())
    }

    fn decide(&mut self, chaser_world: &Vec3) {
        let limit_s = 4.0 * self.length_m / self.config.speed_mps + GRACE_S;
        let braking_m = self.vel.norm_squared() / (2.0 * self.config.acc_mps2);
        self.ending |= self.path_m + braking_m >= self.length_m || self.next_s > limit_s;
        if self.ending {
            self.acc = self.toward(&Point::zeros());
            return;
        }
        let seen = self.sees(chaser_world);
        if matches!(self.doing, Doing::Hide(spot) if !seen && (spot - self.at).norm() < THERE_M) {
            self.until_s = self.until_s.min(self.next_s + STANDS_S);
        }
        if self.next_s >= self.until_s {
            (self.doing, self.until_s) = self.choose(chaser_world, seen);
        } else if seen && self.is_found(chaser_world) {
            // Round the trunk, as the chaser comes round it.
            if let Some(spot) = self.hiding_place(chaser_world) {
                self.doing = Doing::Hide(spot);
            } else {
                (self.doing, self.until_s) = self.choose(chaser_world, seen);
            }
        }
        self.acc = self.steer();
    }

    fn eye(&self, at: &Point) -> Vec3 {
        Vec3::new(at.x, at.y, self.world.ground_height(at.x, at.y) + CENTRE_M)
    }

    fn sees(&self, chaser_world: &Vec3) -> bool {
        let eye = self.eye(&self.at);
        (chaser_world - eye).norm() < SEES_M && !self.world.occluded(&eye, chaser_world)
    }

    /// The chaser sees the place that it hides at or runs to.
    fn is_found(&self, chaser_world: &Vec3) -> bool {
        matches!(self.doing, Doing::Hide(spot) if !self.world.occluded(chaser_world, &self.eye(&spot)))
    }

    /// What to do next, and until when.
    fn choose(&mut self, chaser_world: &Vec3, seen: bool) -> (Doing, f64) {
        let rng = &mut self.rng;
        let (die, side, turn) = (rng.random_range(0.0..1.0), rng.random_bool(0.5), rng.random_range(0.0..1.0));
        let for_s = self.next_s + rng.random_range(1.0..2.2);
        if !seen {
            return (Doing::Run(self.heading_rad + 0.8 * (turn - 0.5)), for_s);
        }
        let side = if side { 1.0 } else { -1.0 };
        let to_chaser = direction(&(chaser_world.xy() - self.at));
        if die > 0.75
            && self.path_m < self.length_m - LAST_M
            && let Some(spot) = self.hiding_place(chaser_world)
        {
            return (Doing::Hide(spot), self.next_s + HIDES_S);
        }
        // Back, well beside the chaser; or aside and away.
        let aside = if die < 0.2 { 0.7 + 0.4 * turn } else { 1.4 + 1.2 * turn };
        (Doing::Run(to_chaser + side * aside), for_s)
    }

    /// The nearest place around that the chaser cannot see.
    fn hiding_place(&self, chaser_world: &Vec3) -> Option<Point> {
        let rings = (4..=(4.0 * HIDES_WITHIN_M) as u32).map(|ring| 0.25 * f64::from(ring));
        rings.flat_map(|radius| (0..DIRECTIONS).map(move |k| radius * unit(angle(k)))).map(|step| self.at + step).find(
            |spot| {
                self.field.clearance(spot) > self.margin_m() + SPARE_M
                    && self.world.contains_xy(spot.x, spot.y, 1.5)
                    && self.world.occluded(chaser_world, &self.eye(spot))
            },
        )
    }

    fn margin_m(&self) -> f64 {
        self.config.margin_m + SPARE_M
    }

    /// The acceleration for the next tick, m/s²: toward the best direction from which it could still stop.
    fn steer(&self) -> Point {
        let (wanted_rad, most_mps) = match self.doing {
            Doing::Run(wanted) => (wanted, self.config.speed_mps),
            Doing::Hide(spot) => {
                let way = spot - self.at;
                (direction(&way), self.config.speed_mps.min((self.config.acc_mps2 * way.norm()).sqrt()))
            }
        };
        let mut velocities: Vec<(f64, Point)> = (0..DIRECTIONS)
            .map(|k| {
                let ahead = unit(wanted_rad + angle(k));
                // As fast as what is free ahead allows, with some of the braking in reserve.
                let speed = most_mps.min((1.4 * self.config.acc_mps2 * self.free_m(&ahead)).sqrt());
                let held = if self.vel.norm() > 0.1 { ahead.dot(&self.vel.normalize()) } else { 0.0 };
                (speed * (angle(k).cos() + 0.3 * held), ahead * speed)
            })
            .collect();
        velocities.sort_by(|a, b| b.0.total_cmp(&a.0));
        let accelerations = velocities.iter().filter(|(worth, _)| *worth > 0.0).map(|(_, vel)| self.toward(vel));
        accelerations.into_iter().find(|acc| self.can_stop_after(acc)).unwrap_or_else(|| self.toward(&Point::zeros()))
    }

    /// The acceleration that comes nearest to a velocity within the next tick, m/s².
    fn toward(&self, vel: &Point) -> Point {
        let acc = (vel - self.vel) / TICK_S;
        acc.cap_magnitude(self.config.acc_mps2)
    }

    /// How far it is free from here into a direction, by the grid, m.
    fn free_m(&self, ahead: &Point) -> f64 {
        let samples = (1..=(4.0 * LOOKS_M) as u32).map(|i| 0.25 * f64::from(i));
        let free = |m: &f64| self.field.clearance(&(self.at + ahead * *m)) > self.margin_m();
        samples.take_while(free).last().unwrap_or(0.0)
    }

    /// Whether, after a tick with an acceleration, braking would bring it to rest with the margin kept everywhere, by the
    /// true map.
    fn can_stop_after(&self, acc: &Point) -> bool {
        let (at, vel) = (self.at + self.vel * TICK_S + acc * (0.5 * TICK_S * TICK_S), self.vel + acc * TICK_S);
        // The last tick of a braking is a whole one.
        let stops_m = vel.norm_squared() / (2.0 * self.config.acc_mps2) + vel.norm() * TICK_S;
        let end = at + vel.try_normalize(1e-9).unwrap_or_else(Point::zeros) * stops_m;
        let free =
            |at: &Point| self.world.contains_xy(at.x, at.y, 1.5) && column_clearance(self.world, at) > self.margin_m();
        let steps = (stops_m / SPARE_M).ceil().max(1.0) as u32;
        free(&self.at.lerp(&at, 0.5)) && (0..=steps).all(|i| free(&at.lerp(&end, f64::from(i) / f64::from(steps))))
    }
}

fn direction(of: &Point) -> f64 {
    of.y.atan2(of.x)
}

fn unit(angle_rad: f64) -> Point {
    Rotation2::new(angle_rad) * Point::x()
}

/// Of the directions all round, from the one ahead, rad.
fn angle(k: u32) -> f64 {
    TAU * f64::from(k) / f64::from(DIRECTIONS)
}
