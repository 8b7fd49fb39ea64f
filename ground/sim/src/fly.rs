//! A campaign: many flights in lockstep over all cores, and what they come to.

pub mod args;
pub mod log;
pub mod report;
mod table;

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use goshawk_air::config::Vehicle;
use goshawk_core::types::Task;
use goshawk_proto::v1;
use rayon::prelude::*;
use thiserror::Error;

use crate::evader::Course;
use crate::sensor::mix;
use crate::sensors::Sensors;
use crate::trial::airframe::Mount;
use crate::trial::{Flight, Network, PilotKind, TrialConfig, TrialError, Unwatched, WorldSource, fly_trial};
use log::{FlightLog, LogError};
use report::{Cell, CellConfig, Report, Timing};
pub use table::table;

/// What to fly.
#[derive(Clone, Debug)]
pub struct Campaign {
    /// Which software flies.
    pub pilot: PilotKind,
    /// Chase or fly to a goal.
    pub task: Task,
    /// A cell for each, m/s.
    pub speeds_mps: Vec<f64>,
    /// And for each world.
    pub worlds: Vec<WorldSource>,
    /// Track: what the evader runs.
    pub course: Course,
    /// Flights in each cell.
    pub trials: usize,
    /// Everything is drawn from it.
    pub seed: u64,
    /// m/s.
    pub wind_mps: f64,
    /// Track: the vehicle's desired speed over the evader's.
    pub speed_ratio: f64,
    /// Height of the flight above the start, m.
    pub height_m: f64,
    /// Camera and odometry.
    pub sensors: Sensors,
    /// How far each airframe is from the vehicle file: relative standard deviation of its parameters.
    pub spread: f64,
    /// Flights at once.
    pub threads: usize,
    /// Log each flight into this folder.
    pub log: Option<(PathBuf, v1::LogHeader)>,
}

/// Why a campaign cannot be flown.
#[derive(Debug, Error)]
pub enum CampaignError {
    /// A flight cannot be flown at all.
    #[error("{task} at {speed_mps} m/s, {world}, trial {trial}: {source}")]
    Trial {
        /// Its cell.
        task: &'static str,
        /// Its cell.
        speed_mps: f64,
        /// Its cell.
        world: String,
        /// Its number.
        trial: usize,
        /// Why.
        source: Box<TrialError>,
    },
    /// A log cannot be written.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The policy cannot be loaded.
    #[error(transparent)]
    Network(TrialError),
    /// Threads cannot be started.
    #[error("cannot start {0} threads: {1}")]
    Threads(usize, rayon::ThreadPoolBuildError),
}

/// Makes the network that a thread flies with; none where the pilot needs none.
pub type MakeNetwork<'a> = dyn Fn() -> Result<Option<Box<dyn Network + Send>>, TrialError> + Sync + 'a;

impl Campaign {
    /// Flies it. `make` is called at most once a thread; `done` after each flight.
    ///
    /// # Errors
    /// See [`CampaignError`]. Flights that end badly are no error.
    pub fn run(
        &self,
        vehicle: &Vehicle,
        make: &MakeNetwork<'_>,
        done: &(dyn Fn(&Flight) + Sync),
    ) -> Result<Report, CampaignError> {
        let begun = Instant::now();
        let cells: Vec<CellConfig> = self.cells();
        let jobs: Vec<(usize, usize)> = (0..cells.len()).flat_map(|c| (0..self.trials).map(move |t| (c, t))).collect();
        let spare: Mutex<Vec<Option<Box<dyn Network + Send>>>> = Mutex::new(Vec::new());
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(self.threads)
            .build()
            .map_err(|e| CampaignError::Threads(self.threads, e))?;
        let flights: Vec<Flight> = pool.install(|| {
            jobs.par_iter()
                .with_max_len(1)
                .map(|&(cell, trial)| {
                    let held = spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
                    let mut network = match held {
                        Some(network) => network,
                        None => make().map_err(CampaignError::Network)?,
                    };
                    let flight = self.fly(&cells[cell], trial, vehicle, network.as_deref_mut())?;
                    spare.lock().unwrap_or_else(PoisonError::into_inner).push(network);
                    done(&flight);
                    Ok(flight)
                })
                .collect::<Result<_, CampaignError>>()
        })?;
        let cells: Vec<Cell> =
            cells.iter().zip(flights.chunks(self.trials.max(1))).map(|(c, f)| Cell::of(c, f)).collect();
        let (wall_s, simulated_s) = (begun.elapsed().as_secs_f64(), flights.iter().map(|f| f.flown_s).sum::<f64>());
        Ok(Report {
            seed: self.seed,
            vehicle: vehicle.name.clone(),
            policy_sha256: None,
            speed_ratio: self.speed_ratio,
            cells,
            timing: Timing {
                wall_s,
                simulated_s,
                realtime_factor: simulated_s / wall_s.max(1e-9),
                threads: pool.current_num_threads(),
            },
        })
    }

    fn cells(&self) -> Vec<CellConfig> {
        let cell = |speed_mps, world: &WorldSource| CellConfig {
            pilot: self.pilot,
            task: self.task,
            speed_mps,
            world: world.clone(),
            wind_mps: self.wind_mps,
        };
        self.worlds.iter().flat_map(|w| self.speeds_mps.iter().map(move |v| cell(*v, w))).collect()
    }

    fn fly(
        &self,
        cell: &CellConfig,
        trial: usize,
        vehicle: &Vehicle,
        network: Option<&mut (dyn Network + Send + 'static)>,
    ) -> Result<Flight, CampaignError> {
        let config = TrialConfig {
            pilot: cell.pilot,
            task: cell.task,
            speed_mps: cell.speed_mps,
            speed_ratio: self.speed_ratio,
            height_m: self.height_m,
            world: cell.world.clone(),
            course: self.course.clone(),
            wind_mps: cell.wind_mps,
            sensors: self.sensors,
            spread: self.spread,
            // The same forests at every speed, so that speeds can be compared.
            seed: mix(mix(self.seed, 7), trial as u64),
        };
        let network = network.map(|network| network as &mut dyn Network);
        let (task, speed_mps) = (report::task_name(cell.task), cell.speed_mps);
        let world = cell.label();
        let failed = |why| CampaignError::Trial { task, speed_mps, world: world.clone(), trial, source: Box::new(why) };
        let Some((folder, header)) = &self.log else {
            return fly_trial(&config, vehicle, network, &mut Unwatched).map_err(failed);
        };
        let path = folder.join(format!("{task}-{speed_mps}mps-{world}-{trial:03}.mcap"));
        let header = v1::LogHeader { profile: format!("{task} {speed_mps} m/s"), ..header.clone() };
        let mut log = FlightLog::create(&path, Mount::of(vehicle).camera, &header)?;
        let flight = fly_trial(&config, vehicle, network, &mut log).map_err(failed)?;
        log.finish()?;
        Ok(flight)
    }
}
