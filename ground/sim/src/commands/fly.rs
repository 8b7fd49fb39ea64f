//! A campaign: many flights in lockstep over all cores, and what they come to.

pub mod args;
pub mod failures;
pub mod files;
pub mod log;
pub mod path;
pub mod pick;
pub(crate) mod progress;
pub mod records;
pub mod report;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use goshawk_core::Task;
use goshawk_proto::v1;
use goshawk_vehicle::config::Vehicle;
use rayon::prelude::*;
use thiserror::Error;

use crate::actors::evader::Course;
use crate::pilots::fly_trial;
use crate::seeds::{Identity, Seeds};
use crate::sense::file::Sensors;
use crate::sense::rgbd::mix;
use crate::trial::airframe::Mount;
use crate::trial::{
    Difference, EvaderKind, Fault, Firmware, Flight, Network, PilotKind, Spent, TrialConfig, TrialError, Unwatched,
    Witness, WorldSource, rule, within_limits,
};
use crate::vehicle::firmware::ProcessError;
use files::Files;
use log::{FlightLog, LogError};
use path::FlightPath;
use path::trace::Tracer;
pub use pick::Pick;
use records::{Known, RecordsError};
use report::compute::{Clerk, Compute};
pub use report::table::table;
use report::{Cell, CellConfig, Report, Timing};

/// What to fly.
#[derive(Clone, Debug)]
pub struct Campaign {
    /// Which software flies; cells for each, on the same seeds.
    pub pilots: Vec<PilotKind>,
    /// Chase or fly to a goal.
    pub task: Task,
    /// A cell for each, m/s.
    pub speeds_mps: Vec<f64>,
    /// And for each world.
    pub worlds: Vec<WorldSource>,
    /// Track: who runs.
    pub evader: EvaderKind,
    /// Track: what a planned evader runs; a cell for each.
    pub courses: Vec<Course>,
    /// How far ahead the goal is; a reactive evader's whole way, m.
    pub length_m: f64,
    /// Flights in each cell.
    pub trials: usize,
    /// Everything is drawn from it.
    pub seed: u64,
    /// m/s.
    pub wind_mps: f64,
    /// Track: how much faster than the evader the vehicle may fly, m/s.
    pub speed_margin_mps: f64,
    /// Height of the flight above the start, m.
    pub height_m: f64,
    /// Camera and odometry.
    pub sensors: Sensors,
    /// How each airframe differs from the vehicle file.
    pub airframe: Difference,
    /// Moving obstacles in each flight.
    pub moving: usize,
    /// What goes wrong in each flight.
    pub fault: Option<Fault>,
    /// Real firmware flies the rotors; none: the autopilot is a model that grants every request.
    pub firmware: Option<Firmware>,
    /// Flights at once.
    pub threads: usize,
    /// Fly these only, each exactly as in the whole campaign.
    pub only: Option<Vec<Pick>>,
    /// Keep each flight's path, up to 300 kB.
    pub traced: bool,
    /// Log each flight.
    pub log: Option<Logs>,
}

/// Where the flights' logs go.
#[derive(Clone, Debug)]
pub struct Logs {
    /// The folder, which exists.
    pub folder: PathBuf,
    /// What all of them begin with.
    pub header: v1::LogHeader,
    /// The files that are not finished.
    pub files: Files,
}

/// One flight of a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Flown {
    /// Which.
    pub pick: Pick,
    /// What was flown.
    pub config: TrialConfig,
    /// What came of it.
    pub flight: Flight,
    /// Its way; none unless the campaign is traced.
    pub path: Option<FlightPath>,
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
    /// There is no such flight.
    #[error(
        "there is no flight {pick}: the campaign's cells are 0 to {last_cell}, the trials of each 0 to {last_trial}"
    )]
    Unknown {
        /// What was asked for.
        pick: Pick,
        /// The last cell.
        last_cell: usize,
        /// The last trial of each.
        last_trial: usize,
    },
    /// A log cannot be written.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The policy cannot be loaded.
    #[error(transparent)]
    Network(TrialError),
    /// What was flown before cannot be taken.
    #[error(transparent)]
    Records(#[from] RecordsError),
    /// The firmware that flew is not there to be compared.
    #[error(transparent)]
    Firmware(#[from] ProcessError),
    /// A flight cannot be flown, and others were.
    #[error("{flights} of {all} flights were flown, then: {why}")]
    Cut {
        /// So many.
        flights: usize,
        /// Of so many.
        all: usize,
        /// What they came to.
        flown: Box<Report>,
        /// Why no more were.
        why: Box<CampaignError>,
    },
    /// Threads cannot be started.
    #[error("cannot start {0} threads: {1}")]
    Threads(usize, rayon::ThreadPoolBuildError),
}

/// Makes the network that a thread flies with; none where the pilot needs none.
pub type MakeNetwork<'a> = dyn Fn() -> Result<Option<Box<dyn Network + Send>>, TrialError> + Sync + 'a;

impl Campaign {
    /// The flights to fly, in order.
    ///
    /// # Errors
    /// If one is asked for that there is not.
    pub fn picks(&self) -> Result<Vec<Pick>, CampaignError> {
        let cells = self.cells().len();
        let Some(only) = &self.only else {
            return Ok((0..cells).flat_map(|cell| (0..self.trials).map(move |trial| Pick { cell, trial })).collect());
        };
        if let Some(&pick) = only.iter().find(|pick| pick.cell >= cells || pick.trial >= self.trials) {
            let (last_cell, last_trial) = (cells.saturating_sub(1), self.trials.saturating_sub(1));
            return Err(CampaignError::Unknown { pick, last_cell, last_trial });
        }
        let mut picks = only.clone();
        picks.sort_unstable();
        picks.dedup();
        Ok(picks)
    }

    /// Flies it. `make` is called at most once a thread; `done` after each flight.
    ///
    /// # Errors
    /// See [`CampaignError`]. Flights that end badly are no error; those before one are in [`CampaignError::Cut`].
    pub fn run(
        &self,
        vehicle: &Vehicle,
        make: &MakeNetwork<'_>,
        done: &(dyn Fn(&Flight) + Sync),
    ) -> Result<Report, CampaignError> {
        let begun = Instant::now();
        let picks = self.picks()?;
        let cells: Vec<CellConfig> = self.cells();
        self.check_limits(&picks, &cells, vehicle)?;
        if let Some(logs) = &self.log {
            picks.iter().try_for_each(|&pick| log::check_new(&logs.folder.join(self.log_name(pick))))?;
        }
        let spare: Mutex<Vec<Option<Box<dyn Network + Send>>>> = Mutex::new(Vec::new());
        let spending: Mutex<BTreeMap<&'static str, Vec<Spent>>> = Mutex::new(BTreeMap::new());
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(self.threads)
            .build()
            .map_err(|e| CampaignError::Threads(self.threads, e))?;
        let one = |pick: Pick| {
            let held = spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
            let mut network = match held {
                Some(network) => network,
                None => make().map_err(CampaignError::Network)?,
            };
            let cell = &cells[pick.cell];
            let (flown, spent) = self.fly(cell, pick, vehicle, network.as_deref_mut())?;
            let mut all = spending.lock().unwrap_or_else(PoisonError::into_inner);
            all.entry(report::pilot_name(cell.pilot)).or_default().extend(spent);
            drop(all);
            spare.lock().unwrap_or_else(PoisonError::into_inner).push(network);
            done(&flown.flight);
            Ok(flown)
        };
        // After one that cannot be flown none begins; those in flight are flown to their end.
        let cut = AtomicBool::new(false);
        let results: Vec<Result<Flown, CampaignError>> = pool.install(|| {
            let begun = picks.par_iter().with_max_len(1).filter(|_| !cut.load(Ordering::Relaxed));
            begun.map(|&pick| one(pick).inspect_err(|_| cut.store(true, Ordering::Relaxed))).collect()
        });
        let (mut flown, mut why) = (Vec::new(), None);
        for result in results {
            match result {
                Ok(flight) => flown.push(flight),
                Err(error) => why = why.or(Some(error)),
            }
        }
        let compute = Compute::of(&spending.into_inner().unwrap_or_else(PoisonError::into_inner));
        let timing = Timing::of(begun.elapsed(), &flown, pool.current_num_threads(), compute);
        match why {
            Some(why) if flown.is_empty() => Err(why),
            Some(why) => {
                let (flights, all) = (flown.len(), picks.len());
                let flown = Box::new(self.report(vehicle, &cells, flown, timing));
                Err(CampaignError::Cut { flights, all, flown, why: Box::new(why) })
            }
            None => Ok(self.report(vehicle, &cells, flown, timing)),
        }
    }

    /// That the vehicle may fly each cell, before the first flight.
    fn check_limits(&self, picks: &[Pick], cells: &[CellConfig], vehicle: &Vehicle) -> Result<(), CampaignError> {
        picks.iter().try_for_each(|&Pick { cell, trial }| {
            let (cell, config) = (&cells[cell], self.config(&cells[cell], trial));
            within_limits(&vehicle.limits, &config.profile()).map_err(|why| failed(cell, trial, why))
        })
    }

    /// The same report of flights that were flown before, perhaps in parts and elsewhere; its timing is empty.
    ///
    /// # Errors
    /// If one of its flights is missing, or was flown as another campaign's.
    pub fn gather(&self, vehicle: &Vehicle, identity: &Identity, mut known: Known) -> Result<Report, CampaignError> {
        let cells = self.cells();
        let firmware_sha256 = self.firmware.as_ref().map(Firmware::sha256).transpose()?;
        let firmware = firmware_sha256.as_deref();
        let flown = self.picks()?.into_iter().map(|pick| {
            let cell = &cells[pick.cell];
            let config = self.config(cell, pick.trial);
            let flight = known.take(pick, &self.head(identity, cell, pick, config.seed, firmware))?;
            Ok(Flown { pick, config, flight, path: None })
        });
        let flown = flown.collect::<Result<_, RecordsError>>()?;
        Ok(self.report(vehicle, &cells, flown, Timing::default()))
    }

    fn report(&self, vehicle: &Vehicle, cells: &[CellConfig], flights: Vec<Flown>, timing: Timing) -> Report {
        let mut flown: Vec<Vec<Flown>> = Vec::new();
        for flight in flights {
            match flown.last_mut() {
                Some(cell) if cell[0].pick.cell == flight.pick.cell => cell.push(flight),
                _ => flown.push(vec![flight]),
            }
        }
        let camera = Mount::of(vehicle).camera;
        let cell = |flown: &Vec<Flown>| Cell::of(flown[0].pick.cell, &cells[flown[0].pick.cell], flown);
        Report {
            seed: self.seed,
            seeds: Seeds::of(self.seed),
            vehicle: vehicle.name.clone(),
            identity: Identity::new(vehicle, None),
            rule: rule::words(self.task),
            command: String::new(),
            version: env!("CARGO_PKG_VERSION"),
            image_px: [camera.width, camera.height],
            speed_margin_mps: self.speed_margin_mps,
            height_m: self.height_m,
            cells: flown.iter().map(cell).collect(),
            timing,
            flown,
        }
    }

    fn cells(&self) -> Vec<CellConfig> {
        let mut cells = Vec::new();
        for (world, course) in self.worlds.iter().flat_map(|w| self.courses.iter().map(move |c| (w, c))) {
            for (&speed_mps, &pilot) in self.speeds_mps.iter().flat_map(|v| self.pilots.iter().map(move |p| (v, p))) {
                cells.push(CellConfig {
                    pilot,
                    task: self.task,
                    speed_mps,
                    world: world.clone(),
                    evader: self.evader,
                    course: course.clone(),
                    length_m: self.length_m,
                    wind_mps: self.wind_mps,
                    moving: self.moving,
                });
            }
        }
        cells
    }

    fn config(&self, cell: &CellConfig, trial: usize) -> TrialConfig {
        TrialConfig {
            pilot: cell.pilot,
            task: cell.task,
            speed_mps: cell.speed_mps,
            speed_margin_mps: self.speed_margin_mps,
            height_m: self.height_m,
            world: cell.world.clone(),
            evader: cell.evader,
            course: cell.course.clone(),
            length_m: cell.length_m,
            wind_mps: cell.wind_mps,
            sensors: self.sensors,
            airframe: self.airframe,
            moving: cell.moving,
            fault: self.fault,
            firmware: self.firmware.clone(),
            // The same forests at every speed and for every pilot, so that they can be compared.
            seed: mix(mix(self.seed, 7), trial as u64),
        }
    }

    /// The file of a flight's log. Cells of one name, such as courses in files of one name, are told apart by number.
    fn log_name(&self, pick: Pick) -> String {
        let names: Vec<String> = self.cells().iter().map(CellConfig::file_name).collect();
        let name = &names[pick.cell];
        let alone = names.iter().filter(|other| *other == name).count() == 1;
        let number = if alone { String::new() } else { format!("-cell{}", pick.cell) };
        format!("{name}{number}-{:03}.mcap", pick.trial)
    }

    fn fly(
        &self,
        cell: &CellConfig,
        pick: Pick,
        vehicle: &Vehicle,
        network: Option<&mut (dyn Network + Send + 'static)>,
    ) -> Result<(Flown, Vec<Spent>), CampaignError> {
        let trial = pick.trial;
        let config = self.config(cell, trial);
        // The classical pilot needs a policy's eyes to chase, and none to navigate.
        let flies = cell.pilot == PilotKind::Policy || cell.task == Task::Track;
        let network = network.filter(|_| flies).map(|network| network as &mut dyn Network);
        let (task, speed_mps) = (report::task_name(cell.task), cell.speed_mps);
        let mut log = match &self.log {
            Some(logs) => {
                let path = logs.folder.join(self.log_name(pick));
                let header = v1::LogHeader { profile: format!("{task} {speed_mps} m/s"), ..logs.header.clone() };
                Some(FlightLog::create(&path, Mount::of(vehicle).camera, &header, &logs.files)?)
            }
            None => None,
        };
        let witness: &mut dyn Witness = match &mut log {
            Some(log) => log,
            None => &mut Unwatched,
        };
        let mut clerk = Clerk::new(witness);
        let (flight, trace) = if self.traced {
            let mut tracer = Tracer::new(Mount::of(vehicle), &mut clerk);
            let flight = fly_trial(&config, vehicle, network, &mut tracer);
            (flight, Some(tracer.finish()))
        } else {
            (fly_trial(&config, vehicle, network, &mut clerk), None)
        };
        let spent = clerk.finish();
        let (flight, path) = flight
            .and_then(|flight| {
                let path = trace.map(|trace| FlightPath::of(pick, &config, &flight, &trace)).transpose()?;
                Ok((flight, path))
            })
            .map_err(|why| failed(cell, trial, why))?;
        if let Some(log) = log {
            log.finish()?;
        }
        Ok((Flown { pick, config, flight, path }, spent))
    }
}

/// Trial `trial` of a cell cannot be flown.
fn failed(cell: &CellConfig, trial: usize, why: TrialError) -> CampaignError {
    let (task, world) = (report::task_name(cell.task), cell.label());
    CampaignError::Trial { task, speed_mps: cell.speed_mps, world, trial, source: Box::new(why) }
}
