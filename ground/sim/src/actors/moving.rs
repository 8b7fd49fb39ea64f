//! Moving obstacles: posts and boxes that glide to and fro on straight ways of their own, near the way that is flown.
//!
//! Where one is depends on the time since the task began alone: it stands at one end of its way until then, and swings
//! from there like a pendulum. So a flight stays a pure function of its configuration. Ways are drawn such that nothing
//! fixed stands in them, that none comes near the start, and that the evader, whose whole run is known, never meets
//! one: it has the right of way.

use clap::Args;
use goshawk_core::Vec3;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::actors::evader::Evader;
use crate::world::{CLEARANCE_CAP_M, Cuboid, Kind, Part, RoundCone, Shape, World};

/// A place or an arrow on the ground plane, m.
pub type Flat = nalgebra::Vector2<f64>;

/// More than this many are refused: there would be no room for them.
pub const MOST: usize = 40;

/// From the middle of a way to its ends, from and to, m.
const REACH_M: [f64; 2] = [1.0, 3.5];
/// In the middle of a way, from and to, m/s.
const SPEED_MPS: [f64; 2] = [0.5, 2.0];
/// Ways lie about points of the way that is flown within this distance, m, more with each attempt.
const ASIDE_M: f64 = 2.5;
const ASIDE_GROWS_M: f64 = 0.02;
const ATTEMPTS: u32 = 600;

/// Between samples of a way, along it and upward, m.
const SAMPLE_M: f64 = 0.25;
/// A way stays this far from what is fixed, at its samples, m: between two of them it comes at most 0.18 m nearer.
const WALL_CLEAR_M: f64 = 0.2;
/// No way comes nearer to the line from the vehicle's start to the evader's, m.
const START_CLEAR_M: f64 = 2.0;
/// From one way to another, m.
const APART_M: f64 = 0.2;
/// From the evader's centre to a surface, at every step of its run and where it ends, m.
const EVADER_CLEAR_M: f64 = 0.7;
const EVADER_STEP_S: f64 = 0.02;
/// Ground that rises by more than this from sample to sample is a step, m.
const STEP_M: f64 = 0.1;
/// They reach this far below the ground, m, so that none floats on a slope.
const ROOT_M: f64 = 0.2;

/// The option that asks for them, the same for every subcommand.
#[derive(Clone, Copy, Debug, Args)]
pub struct MovingArgs {
    /// Moving obstacles near the way that is flown: posts and boxes, each gliding to and fro, 0.5 to 2 m/s at its
    /// fastest.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = count, allow_negative_numbers = true)]
    pub moving: usize,
}

fn count(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| *n <= MOST).ok_or_else(|| format!("{text:?} is not a number from 0 to {MOST}"))
}

/// The solid that moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Body {
    /// An upright post.
    Post {
        /// Its radius, m.
        radius_m: f64,
    },
    /// A box that faces along its way.
    Crate {
        /// Half its edges along the way and across it, m.
        half_m: [f64; 2],
    },
}

/// One moving obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mover {
    /// The middle of its way, world frame.
    pub middle: Flat,
    /// From the middle to the end at which it begins; longer than 0.
    pub reach: Flat,
    /// In the middle, where it is fastest, m/s.
    pub speed_mps: f64,
    /// What it is.
    pub body: Body,
    /// Its top above the ground, m.
    pub height_m: f64,
    /// Base colour, linear light, 0..1.
    pub tint: [f32; 3],
}

impl Mover {
    /// Where it is over the ground `since_start_s` after the task's beginning; before it (negative) at its first end.
    #[must_use]
    pub fn at(&self, since_start_s: f64) -> Flat {
        let turn = self.speed_mps / self.reach.norm() * since_start_s.max(0.0);
        self.middle + self.reach * turn.cos()
    }

    /// Both ends of its way, the first one first.
    #[must_use]
    pub fn ends(&self) -> [Flat; 2] {
        [self.middle + self.reach, self.middle - self.reach]
    }

    /// It as a solid of the world at that time.
    #[must_use]
    pub fn part(&self, world: &World, since_start_s: f64) -> Part {
        let at = self.at(since_start_s);
        let ground = world.ground_height(at.x, at.y);
        let point = |up: f64| Vec3::new(at.x, at.y, ground + up);
        let shape = match self.body {
            Body::Post { radius_m } => Shape::Cone(RoundCone {
                a: point(-ROOT_M),
                b: point(self.height_m - radius_m),
                radius_a: radius_m,
                radius_b: radius_m,
            }),
            Body::Crate { half_m: [along, across] } => Shape::Cuboid(Cuboid {
                centre: point(0.5 * (self.height_m - ROOT_M)),
                half: Vec3::new(along, across, 0.5 * (self.height_m + ROOT_M)),
                yaw_rad: self.reach.y.atan2(self.reach.x),
            }),
        };
        Part { shape, kind: Kind::Moving, tint: self.tint }
    }

    /// Radius of the upright cylinder around it, m.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        match self.body {
            Body::Post { radius_m } => radius_m,
            Body::Crate { half_m: [along, across] } => along.hypot(across),
        }
    }

    /// Samples of its way, both ends among them.
    fn way(&self) -> impl Iterator<Item = Flat> {
        let [first, last] = self.ends();
        let steps = (2.0 * self.reach.norm() / SAMPLE_M).ceil() as usize;
        (0..=steps).map(move |i| first.lerp(&last, i as f64 / steps as f64))
    }

    /// From its way to a line, surface to line, m.
    fn gap(&self, [from, to]: [Flat; 2]) -> f64 {
        let along = to - from;
        let nearest = |p: Flat| {
            let part = ((p - from).dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
            (p - from - along * part).norm()
        };
        self.way().map(nearest).fold(f64::INFINITY, f64::min) - self.radius_m()
    }
}

/// Signed distance from a point to the nearest of some parts, m; at most [`CLEARANCE_CAP_M`].
#[must_use]
pub fn clearance(parts: &[Part], point_world: &Vec3) -> f64 {
    parts.iter().map(|part| part.shape.signed_distance(point_world)).fold(CLEARANCE_CAP_M, f64::min)
}

/// What they are drawn into.
#[derive(Clone, Copy, Debug)]
pub struct Site<'a> {
    /// What stands still. Its start is the vehicle's.
    pub world: &'a World,
    /// Where a navigation leads; not looked at where somebody runs.
    pub goal_world: Vec3,
    /// Who runs.
    pub evader: Option<&'a Evader>,
}

impl Site<'_> {
    /// Draws `count` moving obstacles, each from a random stream of its own: fewer are the first of more. None if there
    /// is no room for them.
    #[must_use]
    pub fn draw(&self, count: usize, seed: u64) -> Option<Vec<Mover>> {
        let mut movers: Vec<Mover> = Vec::with_capacity(count);
        for index in 0..count {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(index as u64);
            let mut proposals = (0..ATTEMPTS).map(|attempt| self.propose(attempt, &mut rng));
            movers.push(proposals.find(|mover| self.has_room(mover, &movers))?);
        }
        Some(movers)
    }

    /// A point of the way that is flown, at a share of it from 0 to 1.
    fn along(&self, share: f64) -> Flat {
        let start = self.world.start_world().xy();
        match self.evader {
            Some(evader) => evader.at(self.world, share * evader.duration_s()).pose.foot_world.xy(),
            None => start.lerp(&self.goal_world.xy(), share),
        }
    }

    fn propose<R: Rng>(&self, attempt: u32, rng: &mut R) -> Mover {
        let arrow = |angle: f64, length: f64| Flat::new(angle.cos(), angle.sin()) * length;
        let mut turn = || rng.random_range(0.0..std::f64::consts::TAU);
        let (aside, heading) = (turn(), turn());
        let out = rng.random_range(0.0..1.0) * (ASIDE_M + ASIDE_GROWS_M * f64::from(attempt));
        let middle = self.along(rng.random_range(0.1..1.0)) + arrow(aside, out);
        let reach = arrow(heading, rng.random_range(REACH_M[0]..REACH_M[1]));
        let speed_mps = rng.random_range(SPEED_MPS[0]..SPEED_MPS[1]);
        let body = if rng.random_bool(0.5) {
            Body::Post { radius_m: rng.random_range(0.1..0.25) }
        } else {
            Body::Crate { half_m: [rng.random_range(0.25..0.45), rng.random_range(0.2..0.4)] }
        };
        let paints =
            [[0.55, 0.22, 0.05], [0.08, 0.16, 0.36], [0.42, 0.41, 0.38], [0.50, 0.40, 0.07], [0.13, 0.14, 0.15]];
        let tint = paints[rng.random_range(0..paints.len())];
        Mover { middle, reach, speed_mps, body, height_m: rng.random_range(1.9..2.8), tint }
    }

    fn has_room(&self, mover: &Mover, others: &[Mover]) -> bool {
        let start = self.world.start_world().xy();
        let seen = self.evader.map_or(start, |_| self.along(0.0));
        mover.gap([start, seen]) >= START_CLEAR_M
            && others.iter().all(|other| mover.gap(other.ends()) >= other.radius_m() + APART_M)
            && self.is_free(mover)
            && self.evader.is_none_or(|evader| self.is_missed(mover, evader))
    }

    /// Nothing fixed is in its way, and the ground has no steps there.
    fn is_free(&self, mover: &Mover) -> bool {
        let keep = mover.radius_m() + WALL_CLEAR_M;
        let layers = (mover.height_m / SAMPLE_M).ceil() as usize;
        let mut last: Option<f64> = None;
        mover.way().all(|at| {
            let ground = self.world.ground_height(at.x, at.y);
            let rise = last.replace(ground).map_or(0.0, |last| (ground - last).abs());
            let up = |layer: usize| mover.height_m * (layer as f64 + 0.5) / layers as f64;
            rise < STEP_M
                && self.world.contains_xy(at.x, at.y, keep)
                && (0..layers).all(|l| self.world.clearance(&Vec3::new(at.x, at.y, ground + up(l))) >= keep)
        })
    }

    /// The evader never meets it, nor does it pass where the evader comes to stand.
    fn is_missed(&self, mover: &Mover, evader: &Evader) -> bool {
        let goal = self.along(1.0);
        let steps = (evader.duration_s() / EVADER_STEP_S).ceil() as usize;
        mover.gap([goal, goal]) >= EVADER_CLEAR_M
            && (0..=steps).all(|step| {
                let now = step as f64 * EVADER_STEP_S;
                let centre = evader.at(self.world, now).centre_world();
                mover.part(self.world, now).shape.signed_distance(&centre) >= EVADER_CLEAR_M
            })
    }
}
