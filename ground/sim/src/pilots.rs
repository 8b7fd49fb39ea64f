//! Flies a flight with the pilot that its configuration names.

use goshawk_core::Task;
use goshawk_vehicle::config::Vehicle;

use crate::classical::Classical;
use crate::trial::airframe::Mount;
use crate::trial::fault::{FaultyNetwork, Injection};
use crate::trial::firmware::InTheLoop;
use crate::trial::lockstep::Lockstep;
use crate::trial::{Fault, Flight, Network, Onboard, Pilot, PilotKind, Scene, TrialConfig, TrialError, Witness};

/// Flies one flight. `network`: the policy; the classical pilot needs it only to see a target.
///
/// # Errors
/// If it cannot be flown at all; see [`TrialError`].
pub fn fly_trial(
    config: &TrialConfig,
    vehicle: &Vehicle,
    network: Option<&mut dyn Network>,
    witness: &mut dyn Witness,
) -> Result<Flight, TrialError> {
    fly_in(&config.scene()?, config, vehicle, network, witness)
}

/// As [`fly_trial`], in a scene that is there already.
///
/// # Errors
/// If it cannot be flown at all; see [`TrialError`].
pub fn fly_in(
    scene: &Scene,
    config: &TrialConfig,
    vehicle: &Vehicle,
    network: Option<&mut dyn Network>,
    witness: &mut dyn Witness,
) -> Result<Flight, TrialError> {
    let mount = Mount::of(vehicle);
    let injection = Injection::new(config.fault, config.seed);
    let wrong = match config.fault {
        Some(Fault::Network(fault)) => Some(fault),
        _ => None,
    };
    let mut network = network.map(|inner| FaultyNetwork::new(inner, wrong, injection.flag(), config.seed));
    let network = network.as_mut().map(|network| network as &mut dyn Network);
    let pilot: Box<dyn Pilot> = match (config.pilot, network) {
        (PilotKind::Policy, Some(network)) => Box::new(Onboard::new(vehicle, &mount, network)?),
        (PilotKind::Classical, None) if config.task == Task::Navigate => {
            Box::new(Classical::new(vehicle, &mount, None)?)
        }
        (PilotKind::Classical, Some(network)) => Box::new(Classical::new(vehicle, &mount, Some(network))?),
        (_, None) => return Err(TrialError::NoPolicy),
    };
    witness.world(&scene.world);
    let firmware = config.firmware.as_ref().map(|which| InTheLoop::start(which, config, vehicle)).transpose()?;
    Lockstep::new(config, vehicle, scene, pilot, injection, firmware).fly(witness)
}
