//! Where a flight takes place: the world, the vehicle's start and goal, and the person who runs.

use std::io;
use std::path::Path;
use std::sync::Arc;

use goshawk_core::{Task, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::TrialError;
use crate::actors::evader::{Course, Evader, EvaderConfig, EvaderState, reachable};
use crate::actors::moving::{Mover, Site};
use crate::actors::person::Person;
use crate::seeds::sha256_of_file;
use crate::sense::rgbd::mix;
use crate::vehicle::quadrotor::QuadrotorParameters;
use crate::world::buildings::{BuildingsConfig, buildings};
use crate::world::cloud::{self, CloudError};
use crate::world::forest::{ForestConfig, forest};
use crate::world::{Part, World};

/// A point cloud's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CloudFile {
    /// Its name, without its folder.
    pub name: String,
    /// SHA-256 of what it holds.
    pub sha256: String,
}

/// What worlds are drawn from.
#[derive(Clone, Debug)]
pub enum WorldSource {
    /// Trees of this mean spacing, m.
    Forest {
        /// Mean spacing, m.
        spacing_m: f64,
    },
    /// Rooms, corridors, courtyards, stairs.
    Buildings,
    /// A point cloud, and its file.
    Cloud(Arc<World>, CloudFile),
}

impl PartialEq for WorldSource {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Forest { spacing_m: a }, Self::Forest { spacing_m: b }) => a == b,
            (Self::Buildings, Self::Buildings) => true,
            (Self::Cloud(a, _), Self::Cloud(b, _)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}

impl WorldSource {
    /// `forest`, `buildings`, or the path of a point cloud; `spacing_m` is the forest's.
    ///
    /// # Errors
    /// [`CloudError`] if the file is none.
    pub fn parse(text: &str, spacing_m: f64) -> Result<Self, CloudError> {
        Ok(match text {
            "forest" => Self::Forest { spacing_m },
            "buildings" => Self::Buildings,
            file => {
                let path = Path::new(file);
                let name = path.file_name().map_or(file.to_owned(), |n| n.to_string_lossy().into_owned());
                let world = Arc::new(cloud::load(path)?);
                let failed = |e: io::Error| CloudError::Read { path: path.to_owned(), cause: e.to_string() };
                Self::Cloud(world, CloudFile { name, sha256: sha256_of_file(path).map_err(failed)? })
            }
        })
    }

    /// `forest`, `buildings`, or the file's name.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Forest { .. } => "forest",
            Self::Buildings => "buildings",
            Self::Cloud(_, file) => &file.name,
        }
    }

    /// SHA-256 of a point cloud's file; none elsewhere.
    #[must_use]
    pub fn sha256(&self) -> Option<&str> {
        if let Self::Cloud(_, file) = self { Some(&file.sha256) } else { None }
    }

    /// The forest's mean spacing, m; 0 elsewhere.
    #[must_use]
    pub fn spacing_m(&self) -> f64 {
        if let Self::Forest { spacing_m } = self { *spacing_m } else { 0.0 }
    }

    /// The world of a seed, with room for a goal `distance_m` ahead of the start where that can be chosen.
    ///
    /// # Errors
    /// If the spacing is unusable.
    pub fn draw(&self, seed: u64, distance_m: f64) -> Result<World, TrialError> {
        let plain = ForestConfig::default();
        let max_x = plain.max_xy[0].max(plain.start_xy[0] + distance_m + 24.0);
        let half_y = plain.max_xy[1].max(0.62 * distance_m);
        let (min_xy, max_xy) = ([plain.min_xy[0], -half_y], [max_x, half_y]);
        Ok(match self {
            Self::Forest { spacing_m } => {
                forest(&ForestConfig { min_xy, max_xy, spacing_m: *spacing_m, ..plain }, seed)?
            }
            Self::Buildings => buildings(&BuildingsConfig { min_xy, max_xy, ..BuildingsConfig::default() }, seed)?,
            Self::Cloud(world, _) => {
                let (start_xy, heading_rad) = start_in(world, seed).ok_or(TrialError::NoRoom)?;
                World::clone(world).started_at(start_xy, heading_rad)
            }
        })
    }
}

/// A free place in a world, and a heading from there toward its middle.
fn start_in(world: &World, seed: u64) -> Option<([f64; 2], f64)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x57a2);
    let (low, high) = (world.min_world(), world.max_world());
    (0..4000).find_map(|attempt| {
        let x = rng.random_range(low.x..high.x);
        let y = rng.random_range(low.y..high.y);
        let heading = (0.5 * (low.y + high.y) - y).atan2(0.5 * (low.x + high.x) - x) + rng.random_range(-0.5..0.5);
        let ground = world.ground_height(x, y);
        // The less room there is, the less is asked for.
        let room = 1.5 - 0.25 * f64::from(attempt / 1000);
        let free = [0.3, 0.9, 1.5, 2.1].iter().all(|h| world.clearance(&Vec3::new(x, y, ground + h)) > room);
        free.then_some(([x, y], heading))
    })
}

/// How far ahead a goal is unless something else is asked for, m.
pub const COURSE_M: f64 = 40.0;

/// What a scene is made from.
#[derive(Clone, Debug)]
pub struct SceneConfig {
    /// Everything is drawn from it.
    pub seed: u64,
    /// Where.
    pub world: WorldSource,
    /// How far ahead the goal is, the evader's or the vehicle's own, m.
    pub distance_m: f64,
    /// What the evader runs, and its most speed, m/s; none: nobody runs.
    pub evader: Option<(Course, f64)>,
    /// Moving obstacles, up to [`crate::actors::moving::MOST`].
    pub moving: usize,
}

impl SceneConfig {
    /// The acceptance's scene for a task at a speed: the evader's, or the vehicle's own. Nothing moves but the evader.
    #[must_use]
    pub fn of_task(task: Task, speed_mps: f64, world: WorldSource, course: Course, seed: u64) -> Self {
        let evader = (task == Task::Track).then_some((course, speed_mps));
        Self { seed, world, distance_m: COURSE_M, evader, moving: 0 }
    }
}

/// A world with its actors. The vehicle looks along the world's start heading.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Obstacles and ground.
    pub world: World,
    /// Where a navigation leads, on the ground.
    pub goal_world: Vec3,
    /// The evader.
    pub evader: Option<Evader>,
    /// Moving obstacles.
    pub movers: Vec<Mover>,
}

/// Worlds in which nobody can run are drawn again, this often at most.
const ATTEMPTS: u64 = 20;
/// Where worlds are too small for the asked distance it shrinks with each attempt, to this at least, m.
const SHRINK: f64 = 0.93;
const DISTANCE_MIN_M: f64 = 12.0;
/// A navigation's goal can be reached with this much room, m.
const GOAL_ROOM_M: f64 = 0.45;

impl Scene {
    /// Draws a scene.
    ///
    /// # Errors
    /// If the world cannot be made, none of it lets the evader run, or there is no room for the moving obstacles.
    pub fn new(config: &SceneConfig) -> Result<Self, TrialError> {
        let mut failure = TrialError::NoRoom;
        let bounded = !matches!(config.world, WorldSource::Forest { .. });
        for attempt in 0..ATTEMPTS {
            let seed = mix(config.seed, attempt);
            let shrunk = (config.distance_m * SHRINK.powi(attempt as i32)).max(DISTANCE_MIN_M.min(config.distance_m));
            let distance_m = if bounded { shrunk } else { config.distance_m };
            let world = config.world.draw(seed, config.distance_m)?;
            let (start, heading) = (world.start_world(), world.start_heading_rad());
            let (goal_world, evader) = match &config.evader {
                None => match goal(&world, distance_m, bounded, seed) {
                    Some(goal_world) => (goal_world, None),
                    None => continue,
                },
                Some((course, speed)) => {
                    let (course, goal_m) = (course.clone(), distance_m);
                    let evader = EvaderConfig { course, goal_m, ..EvaderConfig::at_speed(*speed) };
                    match Evader::plan(&world, &evader, start, heading, mix(seed, 1)) {
                        Ok(evader) => (start, Some(evader)),
                        Err(error) => {
                            failure = error.into();
                            continue;
                        }
                    }
                }
            };
            let site = Site { world: &world, goal_world, evader: evader.as_ref() };
            match site.draw(config.moving, mix(seed, 4)) {
                Some(movers) => return Ok(Self { world, goal_world, evader, movers }),
                None => failure = TrialError::NoRoomToMove(config.moving),
            }
        }
        Err(failure)
    }

    /// Where the vehicle stands at first: its centre of mass.
    #[must_use]
    pub fn vehicle_start(&self, airframe: &QuadrotorParameters) -> Vec3 {
        self.world.start_world() + Vec3::new(0.0, 0.0, airframe.leg_m)
    }

    /// The evader's state; `since_start_s` is negative before the run.
    #[must_use]
    pub fn evader_at(&self, since_start_s: f64) -> Option<EvaderState> {
        self.evader.as_ref().map(|e| e.at(&self.world, since_start_s))
    }

    /// The moving obstacles `since_start_s` after the task's beginning; before it they stand.
    #[must_use]
    pub fn moving_at(&self, since_start_s: f64) -> Vec<Part> {
        self.movers.iter().map(|mover| mover.part(&self.world, since_start_s)).collect()
    }

    /// The evader to draw.
    #[must_use]
    pub fn person_at(&self, since_start_s: f64) -> Option<Person> {
        self.evader.as_ref().map(|e| e.person(&self.world, since_start_s))
    }
}

/// A goal on the ground ahead of the start; in a world of walls (`bounded`) one that can be reached.
fn goal(world: &World, distance_m: f64, bounded: bool, seed: u64) -> Option<Vec3> {
    let (start, heading) = (world.start_world(), world.start_heading_rad());
    let ahead = |bearing: f64| {
        let at = start + Vec3::new((heading + bearing).cos(), (heading + bearing).sin(), 0.0) * distance_m;
        Vec3::new(at.x, at.y, world.ground_height(at.x, at.y))
    };
    if !bounded {
        return Some(ahead(0.0));
    }
    let mut rng = ChaCha8Rng::seed_from_u64(mix(seed, 3));
    (0..6)
        .map(|_| ahead(rng.random_range(-0.5..0.5)))
        .find(|at| world.contains_xy(at.x, at.y, 1.0) && reachable(world, &start, at, GOAL_ROOM_M))
}
