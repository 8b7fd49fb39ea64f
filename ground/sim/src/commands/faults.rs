//! `goshawk-sim faults`: flights with broken senses, and what the vehicle noticed; flights with good ones, and what it
//! only thought that it noticed.

pub mod report;
mod table;

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use color_eyre::eyre::{Result, WrapErr, ensure};
use goshawk_core::Task;
use goshawk_vehicle::config::Vehicle;

use crate::actors::evader::Course;
use crate::commands::fly::Campaign;
use crate::commands::fly::args::{load_policy, positive, spacing};
use crate::commands::fly::files::Files;
use crate::commands::fly::progress::Progress;
use crate::seeds::Seeds;
use crate::sense::file::SensorArgs;
use crate::trial::scene::COURSE_M;
use crate::trial::{Difference, EvaderKind, Fault, Network, PilotKind, WorldSource};
use report::{Ordinary, Report, Row};

/// Wind and spread of the ordinary campaigns that are not calm, m/s and a share.
const ROUGH: (f64, f64) = (5.0, 0.2);

/// Fly with broken senses, and say what the vehicle noticed.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  goshawk-sim faults   # ten flights of each fault, and as many without\n  \
                  goshawk-sim faults --only camera-frozen,network-nan --flights 4 --ordinary 0\n  \
                  goshawk-sim faults --flights 0 --ordinary 500   # false alarms alone, in some ten hours of flight\n  \
                  goshawk-sim faults --list\n\n\
                  The table's columns:\n  named       flights in which the vehicle named the fault after it began\n  \
                  to name     seconds from the one to the other, median and longest\n  \
                  collisions  contacts after the fault began\n  \
                  ended       landed by itself, handed back to the autopilot, collision, or flew on for 40 s\n\n\
                  Flights that ended before their fault began are left out. One of them is flown again, and logged, by\n  \
                  goshawk-sim fly --task track --speed 4 --trials 10 --fault NAME --only 0:TRIAL --log DIR")]
pub struct FaultsArgs {
    /// These faults only.
    #[arg(long, value_name = "NAME[,…]", value_delimiter = ',')]
    only: Option<Vec<Fault>>,
    /// Flights of each fault.
    #[arg(long, value_name = "N", default_value_t = 10)]
    flights: usize,
    /// Flights of each ordinary campaign, in which nothing goes wrong: to track and to navigate, calm and in gusts of
    /// 5 m/s with another airframe each.
    #[arg(long, value_name = "N", default_value_t = 10)]
    ordinary: usize,
    /// What is flown with faults: the evader's speed, m/s. To navigate, the vehicle's own.
    #[arg(long, value_name = "V", default_value_t = 4.0, value_parser = positive)]
    speed: f64,
    /// Seed of everything, of the tuning range (`goshawk-sim seeds`).
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Mean spacing of the trees, 1 to 1000 m.
    #[arg(long, value_name = "M", default_value_t = 4.0, value_parser = spacing)]
    spacing: f64,
    /// The vehicle file.
    #[arg(long, value_name = "FILE", default_value = "air/vehicles/sim.toml")]
    vehicle_file: PathBuf,
    #[command(flatten)]
    sensors: SensorArgs,
    /// Write what came of it as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Flights at once; 0: one for each core.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Only say which faults there are.
    #[arg(long)]
    list: bool,
}

/// The vehicle and the policies of its two tasks.
struct Flying {
    vehicle: Vehicle,
    track: PathBuf,
    navigate: PathBuf,
}

impl Flying {
    fn load(path: &Path) -> Result<Self> {
        let vehicle = Vehicle::load(path)?;
        let [track, navigate] = [Task::Track, Task::Navigate].map(|task| vehicle.model(task));
        Ok(Self { vehicle, track, navigate })
    }

    fn fly(&self, campaign: &Campaign, progress: &Progress) -> Result<crate::commands::fly::report::Report> {
        let model = if campaign.task == Task::Track { &self.track } else { &self.navigate };
        let make = || Ok(Some(Box::new(load_policy(&self.vehicle, model)?) as Box<dyn Network + Send>));
        Ok(campaign.run(&self.vehicle, &make, &|flight| progress.flown(flight.outcome))?)
    }
}

impl FaultsArgs {
    /// Flies, prints the table, writes the JSON.
    ///
    /// # Errors
    /// If it could not be flown; the message says what to do.
    pub fn run(self) -> Result<()> {
        if self.list {
            Fault::all().iter().for_each(|fault| println!("{fault}"));
            return Ok(());
        }
        ensure!(self.flights + self.ordinary > 0, "--flights and --ordinary are 0: there is nothing to fly");
        Seeds::Tuning.allow(self.seed)?;
        let flying = Flying::load(&self.vehicle_file)?;
        let faults = if self.flights == 0 { Vec::new() } else { self.only.clone().unwrap_or_else(Fault::all) };
        let ordinary = self.ordinary_campaigns(&flying)?;
        let named = load_policy(&flying.vehicle, &flying.track)?;
        flying.vehicle.check_pin(&flying.track, &named)?;
        let progress = Progress::new(faults.len() * self.flights + ordinary.len() * self.ordinary)?;
        let files = Files::default();
        progress.end_on_signals(&files)?;
        let begin = |path: &PathBuf| files.begin(path).wrap_err_with(|| format!("cannot write {}", path.display()));
        let json = self.json.as_ref().map(begin).transpose()?;
        let mut report = Report { seed: self.seed, speed_mps: self.speed, faults: Vec::new(), ordinary: Vec::new() };
        for fault in faults {
            let campaign = Campaign { fault: Some(fault), ..self.campaign(&flying, Task::Track)? };
            report.faults.push(Row::of(fault, flying.fly(&campaign, &progress)?.flown.iter().flatten()));
        }
        for (name, campaign) in &ordinary {
            report.ordinary.push(Ordinary::of(name, flying.fly(campaign, &progress)?.flown.iter().flatten()));
        }
        progress.bar.finish_and_clear();
        if let Some((mut file, unfinished)) = json {
            file.write_all(&report.to_json()).and_then(|()| unfinished.finish()).wrap_err("cannot write the JSON")?;
        }
        print!("{}", table::table(&report));
        Ok(())
    }

    fn campaign(&self, flying: &Flying, task: Task) -> Result<Campaign> {
        Ok(Campaign {
            pilots: vec![PilotKind::Policy],
            task,
            speeds_mps: vec![self.speed],
            worlds: vec![WorldSource::Forest { spacing_m: self.spacing }],
            evader: EvaderKind::Planned,
            courses: vec![Course::Goal],
            length_m: COURSE_M,
            trials: self.flights,
            seed: self.seed,
            wind_mps: 0.0,
            speed_margin_mps: 3.0,
            height_m: flying.vehicle.profile(None).map_or(1.5, |profile| profile.height),
            sensors: self.sensors.load()?,
            airframe: Difference::default(),
            moving: 0,
            fault: None,
            firmware: None,
            threads: self.threads,
            only: None,
            traced: false,
            log: None,
        })
    }

    /// What is flown without a fault, by name.
    fn ordinary_campaigns(&self, flying: &Flying) -> Result<Vec<(String, Campaign)>> {
        let mut campaigns = Vec::new();
        if self.ordinary == 0 {
            return Ok(campaigns);
        }
        let (wind_mps, spread) = ROUGH;
        for (task, name) in [(Task::Track, "track"), (Task::Navigate, "navigate")] {
            let calm = Campaign { trials: self.ordinary, ..self.campaign(flying, task)? };
            let airframe = Difference { spread, ..Difference::default() };
            let rough = Campaign { wind_mps, airframe, ..calm.clone() };
            campaigns.push((name.to_owned(), calm));
            campaigns.push((format!("{name}, wind {wind_mps}, spread {spread}"), rough));
        }
        Ok(campaigns)
    }
}
