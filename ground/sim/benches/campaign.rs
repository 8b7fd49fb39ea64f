//! Speed of a campaign: whole flights in lockstep with the shipped policy inside, one core.
//!
//! The yardstick, measured in the same run, is the network alone on the frames of those flights: what no simulator
//! around it can be faster than. The figure goes to `target/bench.json` under `campaign_realtime_per_core`.

mod common;

use std::path::Path;

use common::{core_seconds, median, record, tenths, verdict};
use goshawk_core::{NetworkOutput, Task};
use goshawk_policy::{Contract, Policy, PolicyError};
use goshawk_sim::actors::evader::Course;
use goshawk_sim::pilots::fly_trial;
use goshawk_sim::sense::file::Sensors;
use goshawk_sim::trial::{Difference, EvaderKind, Network, PilotKind, TrialConfig, Unwatched, WorldSource};
use goshawk_vehicle::config::Vehicle;

const FLIGHTS: u64 = 6;
const TARGET: f64 = 20.0;

/// The policy, and how long it has had the core.
struct Timed {
    policy: Policy,
    inference_s: f64,
    frames: u64,
}

impl Network for Timed {
    fn contract(&self) -> &Contract {
        self.policy.contract()
    }

    fn infer(&mut self, rgbd: &[f32], state: &[f32]) -> Result<NetworkOutput, PolicyError> {
        let begun = core_seconds();
        let output = self.policy.infer(rgbd, state);
        self.inference_s += core_seconds() - begun;
        self.frames += 1;
        output
    }
}

fn main() -> color_eyre::Result<()> {
    let vehicle = Vehicle::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../air/vehicles/sim.toml"))?;
    let policy = vehicle.load_policy(&vehicle.resolve(&vehicle.policy.model), 1)?;
    let mut network = Timed { policy, inference_s: 0.0, frames: 0 };
    let (mut factors, mut flown_s, mut core_s) = (Vec::new(), 0.0, 0.0);
    for seed in 0..FLIGHTS {
        let config = TrialConfig {
            pilot: PilotKind::Policy,
            task: Task::Track,
            speed_mps: 3.0,
            speed_margin_mps: 3.0,
            height_m: 1.5,
            world: WorldSource::Forest { spacing_m: 4.0 },
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
        };
        let begun = core_seconds();
        let flight = fly_trial(&config, &vehicle, Some(&mut network), &mut Unwatched)?;
        let took = core_seconds() - begun;
        factors.push(flight.flown_s / took);
        (flown_s, core_s) = (flown_s + flight.flown_s, core_s + took);
    }
    let factor = median(&mut factors);
    let per_frame = |seconds: f64| 1e3 * seconds / network.frames.max(1) as f64;
    println!("campaign, tracking in a 4 m forest with the policy inside, one core, median of {FLIGHTS} flights");
    println!("  whole flights       {factor:8.1} x real time   target {TARGET:.0}: {}", verdict(factor >= TARGET));
    println!("  network alone       {:8.1} x real time   yardstick", flown_s / network.inference_s);
    println!(
        "  a frame             {:8.2} ms on the core, {:.2} of it the network",
        per_frame(core_s),
        per_frame(network.inference_s)
    );
    record("campaign_realtime_per_core", tenths(factor))?;
    Ok(())
}
