//! Networks written by hand, and the flights that they fly.

#![allow(dead_code, unreachable_pub, missing_docs, clippy::unwrap_used, reason = "each test file uses its part of it")]

use goshawk_core::{ANCHORS, MAX_CHANNELS, NetworkOutput, Task};
use goshawk_policy::{Contract, PolicyError};
use goshawk_sim::actors::evader::Course;
pub use goshawk_sim::commands::chaos::standin::{Sectors, contract_json};
use goshawk_sim::pilots::fly_trial;
use goshawk_sim::sense::file::Sensors;
use goshawk_sim::trial::{Difference, EvaderKind, Flight, Network, PilotKind, TrialConfig, Unwatched, WorldSource};
use goshawk_vehicle::config::Vehicle;
use std::path::Path;

const VEHICLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../air/vehicles/sim.toml");

pub fn vehicle() -> Vehicle {
    Vehicle::load(Path::new(VEHICLE)).unwrap()
}

/// The vehicle, but that it remembers nothing of what it saw.
pub fn forgetful_vehicle() -> Vehicle {
    let Vehicle { text, tuning_text, .. } = vehicle();
    let other = tuning_text.replace("remember_within_m = 6.0", "remember_within_m = 0.0");
    assert_ne!(tuning_text, other);
    Vehicle::parse(text, other, Path::new(VEHICLE)).unwrap()
}

pub fn contract(task: &str) -> Contract {
    Contract::from_json(&contract_json(task)).unwrap()
}

pub fn sectors(blind: bool) -> Sectors {
    Sectors { contract: contract("navigate"), blind }
}

/// Always the same answer.
pub struct Constant(pub Contract, pub f32);

impl Network for Constant {
    fn contract(&self) -> &Contract {
        &self.0
    }

    fn infer(&mut self, _rgbd: &[f32], _state: &[f32]) -> Result<NetworkOutput, PolicyError> {
        Ok(NetworkOutput { values: [self.1; MAX_CHANNELS * ANCHORS] })
    }
}

pub fn config(task: Task, speed_mps: f64, spacing_m: f64, seed: u64) -> TrialConfig {
    TrialConfig {
        pilot: PilotKind::Policy,
        task,
        speed_mps,
        speed_margin_mps: 3.0,
        height_m: 1.5,
        world: WorldSource::Forest { spacing_m },
        evader: EvaderKind::Planned,
        course: Course::Goal,
        length_m: 40.0,
        wind_mps: 0.0,
        sensors: Sensors::default(),
        airframe: Difference::default(),
        moving: 0,
        fault: None,
        firmware: None,
        seed,
    }
}

pub fn fly(config: &TrialConfig, network: &mut dyn Network) -> Flight {
    fly_trial(config, &vehicle(), Some(network), &mut Unwatched).unwrap()
}
