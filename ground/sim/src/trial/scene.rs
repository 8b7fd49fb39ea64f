//! Where a flight takes place: the forest, the vehicle's start, and the person who runs.

use goshawk_core::types::{Task, Vec3};

use super::TrialError;
use crate::evader::{Evader, EvaderConfig, EvaderError, EvaderState};
use crate::forest::{ForestConfig, forest};
use crate::person::Person;
use crate::quadrotor::QuadrotorParameters;
use crate::sensor::mix;
use crate::world::World;

/// What a scene is made from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneConfig {
    /// Everything is drawn from it.
    pub seed: u64,
    /// Mean spacing of the trees, m.
    pub spacing_m: f64,
    /// How far ahead the goal is, the evader's or the vehicle's own, m.
    pub distance_m: f64,
    /// Most speed of the evader, m/s; none: nobody runs.
    pub evader_mps: Option<f64>,
}

impl SceneConfig {
    /// The acceptance's scene for a task at a speed: the evader's, or the vehicle's own.
    #[must_use]
    pub fn of_task(task: Task, speed_mps: f64, spacing_m: f64, seed: u64) -> Self {
        let evader_mps = (task == Task::Track).then_some(speed_mps);
        Self { seed, spacing_m, distance_m: 40.0, evader_mps }
    }
}

/// A world with its actors. The vehicle looks east from the world's start.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Obstacles and ground.
    pub world: World,
    /// The runner.
    pub evader: Option<Evader>,
}

/// Forests in which nobody can run are drawn again, this often at most.
const ATTEMPTS: u64 = 20;

impl Scene {
    /// Draws a scene.
    ///
    /// # Errors
    /// If the spacing is unusable, or no forest of it lets the evader run.
    pub fn new(config: &SceneConfig) -> Result<Self, TrialError> {
        let mut failure = EvaderError::NoWay;
        for attempt in 0..ATTEMPTS {
            let seed = mix(config.seed, attempt);
            let plain = ForestConfig { spacing_m: config.spacing_m, ..ForestConfig::default() };
            let max_x = plain.max_xy[0].max(plain.start_xy[0] + config.distance_m + 24.0);
            let half_y = plain.max_xy[1].max(0.62 * config.distance_m);
            let wide = ForestConfig { min_xy: [plain.min_xy[0], -half_y], max_xy: [max_x, half_y], ..plain };
            let world = forest(&wide, seed)?;
            let Some(speed) = config.evader_mps else { return Ok(Self { world, evader: None }) };
            let runner = EvaderConfig { goal_m: config.distance_m, ..EvaderConfig::at_speed(speed) };
            match Evader::plan(&world, &runner, world.start_world(), 0.0, mix(seed, 1)) {
                Ok(evader) => return Ok(Self { world, evader: Some(evader) }),
                Err(error) => failure = error,
            }
        }
        Err(failure.into())
    }

    /// Where the vehicle stands at first: its centre of mass.
    #[must_use]
    pub fn vehicle_start(&self, airframe: &QuadrotorParameters) -> Vec3 {
        self.world.start_world() + Vec3::new(0.0, 0.0, airframe.leg_m)
    }

    /// The runner's state; `since_start_s` is negative before the run.
    #[must_use]
    pub fn evader_at(&self, since_start_s: f64) -> Option<EvaderState> {
        self.evader.as_ref().map(|e| e.at(&self.world, since_start_s))
    }

    /// The runner to draw.
    #[must_use]
    pub fn person_at(&self, since_start_s: f64) -> Option<Person> {
        self.evader.as_ref().map(|e| e.person(&self.world, since_start_s))
    }
}
