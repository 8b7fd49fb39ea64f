//! Who is chased in a flight: a planned run, or one that sees the vehicle.

use goshawk_core::Vec3;

use super::scene::Scene;
use super::{EvaderKind, TrialConfig};
use crate::actors::evader::{Evader, EvaderConfig, EvaderState, Reactive};
use crate::actors::person::Person;
use crate::sense::rgbd::mix;
use crate::world::World;

/// The evader of a flight.
pub(super) enum Runner<'a> {
    /// Looked up.
    Planned(&'a Evader, &'a World),
    /// Moved on step by step.
    Reactive(Box<Reactive<'a>>),
}

impl<'a> Runner<'a> {
    /// The one that the configuration wants, standing where `planned` starts.
    pub(super) fn new(config: &TrialConfig, scene: &'a Scene, planned: &'a Evader) -> Self {
        match config.evader {
            EvaderKind::Planned => Self::Planned(planned, &scene.world),
            EvaderKind::Reactive => {
                let (limits, seed) = (EvaderConfig::at_speed(config.speed_mps), mix(config.seed, 31));
                Self::Reactive(Box::new(Reactive::new(&scene.world, &limits, planned, config.length_m, seed)))
            }
        }
    }

    /// How long its way is, m.
    pub(super) fn length_m(&self) -> f64 {
        match self {
            Self::Planned(evader, _) => evader.length_m(),
            Self::Reactive(evader) => evader.length_m(),
        }
    }

    /// Its state `since_start_s` after its run's beginning (negative: it stands), with the vehicle at `vehicle_world`.
    /// Times must not go back.
    pub(super) fn advance(&mut self, since_start_s: f64, vehicle_world: &Vec3) -> EvaderState {
        match self {
            Self::Planned(evader, world) => evader.at(world, since_start_s),
            Self::Reactive(evader) => evader.advance(since_start_s, vehicle_world),
        }
    }

    /// The person to draw in a state.
    pub(super) fn person(&self, state: &EvaderState) -> Person {
        let look = match self {
            Self::Planned(evader, _) => *evader.look(),
            Self::Reactive(evader) => *evader.look(),
        };
        Person { look, pose: state.pose }
    }
}
