//! `goshawk-sim fly`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use color_eyre::eyre::{Result, WrapErr, ensure};
use goshawk_core::Task;
use goshawk_policy::Policy;
use goshawk_vehicle::config::Vehicle;

use super::files::Files;
use super::log::header;
use super::progress::Progress;
use super::{Campaign, Logs, Pick, failures, pick, table};
use crate::actors::evader::Course;
use crate::actors::moving::MovingArgs;
use crate::sense::file::SensorArgs;
use crate::trial::{Difference, Fault, Network, PilotKind, WorldSource};

/// The task to fly.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TaskName {
    /// Follow the target, a running person.
    Track,
    /// Fly to a goal 40 m ahead.
    Navigate,
}

/// The software to fly with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PilotName {
    /// The vehicle's own, with a trained policy.
    Policy,
    /// A map-based planner as a yardstick; to track, a policy finds the target for it.
    Classical,
}

/// Fly campaigns in lockstep and report successes.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  goshawk-sim fly --task track --speed 3,5,7 --trials 100 --seed 1 --spacing 4\n  \
                  goshawk-sim fly --task navigate --speed 8 --trials 20 --seed 1 --json out.json   # then goshawk \
                  campaign report out.json\n  \
                  goshawk-sim fly --task navigate --pilot classical --speed 3,5 --spacing 5\n  \
                  goshawk-sim fly --task track --speed 5 --moving 8   # eight posts and boxes cross the way\n  \
                  goshawk-sim fly --task track --speed 3,5,7 --course goal,zigzag,u-turn,square,eight,stop-and-go   # how \
                  near it comes to who turns on it\n  \
                  goshawk-sim fly --task track --speed 4 --airframe hover_thrust=0.5 --airframe attitude_lag_s=0.2   # the \
                  vehicle file is wrong\n  \
                  goshawk-sim fly --task track --speed 3,5 --seed 3 --only 1:4 --log logs\n\n\
                  Exit status:\n  0    the campaign was flown, however its flights ended\n  \
                  1    it could not be flown, or what it found not written\n  2    the command line is wrong\n  \
                  130  interrupted (143: terminated); what is not whole is removed")]
pub struct FlyArgs {
    /// What to fly.
    #[arg(long, value_enum)]
    task: TaskName,
    /// What flies it.
    #[arg(long, value_enum, default_value = "policy")]
    pilot: PilotName,
    /// Speeds, m/s: the evader's (track) or the vehicle's (navigate); a cell for each.
    #[arg(long, value_name = "V[,V…]", value_delimiter = ',', required = true, value_parser = positive)]
    speed: Vec<f64>,
    /// Flights in each cell.
    #[arg(long, value_name = "N", default_value_t = 10)]
    trials: usize,
    /// Seed of everything.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Mean spacings of the trees, m; cells for each.
    #[arg(long, value_name = "M[,M…]", value_delimiter = ',', default_value = "4", value_parser = positive)]
    spacing: Vec<f64>,
    /// The world: forest, buildings, or a point cloud (.ply, .pcd).
    #[arg(long, value_name = "WORLD", default_value = "forest")]
    world: String,
    /// Track: what the evader runs: goal, eight, zigzag, u-turn, square, stop-and-go, or a CSV file of waypoints (x,y in
    /// m ahead and left, and stand_s); cells for each.
    #[arg(long, value_name = "COURSE[,…]", value_delimiter = ',', default_value = "goal")]
    course: Vec<String>,
    /// The policy; absent: the vehicle file's: policy.model (track), which its SHA-256 must fit, or policy.navigate.
    /// One that is named here needs no SHA-256. Not needed by --pilot classical to
    /// navigate.
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// The vehicle file.
    #[arg(long, value_name = "FILE", default_value = "air/vehicles/sim.toml")]
    vehicle_file: PathBuf,
    /// What gusts reach, m/s.
    #[arg(long, value_name = "MPS", default_value_t = 0.0)]
    wind: f64,
    /// Track: how much faster than the evader the vehicle may fly, m/s.
    #[arg(long, value_name = "MPS", default_value_t = 3.0, value_parser = positive)]
    speed_margin: f64,
    /// Height of the flight above the start, m; absent: that of the vehicle's default profile.
    #[arg(long, value_name = "M", value_parser = positive)]
    height: Option<f64>,
    /// Let each flight's airframe differ from the vehicle file: relative standard deviation of mass, thrust, drag, …
    #[arg(long, value_name = "FRACTION", default_value_t = 0.0)]
    spread: f64,
    /// What the airframe truly is, whatever the vehicle file says, such as hover_thrust=0.5; may be repeated. Keys:
    /// mass_kg, hover_thrust, attitude_lag_s, load_kg (which hangs on half a metre of line).
    #[arg(long, value_name = "KEY=NUMBER")]
    airframe: Vec<String>,
    #[command(flatten)]
    moving: MovingArgs,
    #[command(flatten)]
    sensors: SensorArgs,
    /// What goes wrong in each flight, 1 to 4 s after the task's beginning, such as camera-frozen (`goshawk-sim faults
    /// --list`). A flight then goes on until the vehicle is down, which is its success.
    #[arg(long, value_name = "NAME")]
    fault: Option<Fault>,
    /// Write all that was found as JSON: cells, flights, and each flight's path and map. `goshawk campaign report FILE`
    /// makes a page of it.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Fly these flights of the campaign only, each as in the whole of it; both numbers from 0, cells as in the table.
    #[arg(long, value_name = "CELL:TRIAL[,…]", value_delimiter = ',')]
    only: Option<Vec<Pick>>,
    /// Write a log (MCAP) of each flight into this folder.
    #[arg(long, value_name = "DIR")]
    log: Option<PathBuf>,
    /// Flights at once; 0: one for each core.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
}

fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("{text:?} is not a number"))?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err(format!("{text} is not above 0")) }
}

impl FlyArgs {
    /// Flies, prints the table, writes the JSON.
    ///
    /// # Errors
    /// If the campaign could not be flown; the message says on what and what to do.
    pub fn run(self) -> Result<()> {
        ensure!(self.trials > 0, "--trials is 0: there is nothing to fly");
        ensure!(self.wind.is_finite() && self.wind >= 0.0, "--wind is {}: it must be 0 or more", self.wind);
        ensure!((0.0..=0.3).contains(&self.spread), "--spread is {}: it must be 0 to 0.3", self.spread);
        let vehicle = Vehicle::load(&self.vehicle_file)?;
        let task = match self.task {
            TaskName::Track => Task::Track,
            TaskName::Navigate => Task::Navigate,
        };
        let mut campaign = self.campaign(task, &vehicle)?;
        // Known now rather than after the policy is loaded and the flights are flown.
        let progress = Progress::new(campaign.picks()?.len())?;
        let files = Files::default();
        progress.end_on_signals(&files)?;
        if let Some(folder) = &self.log {
            std::fs::create_dir_all(folder).wrap_err_with(|| unwritable(folder))?;
        }
        let begin = |path: &PathBuf| files.begin(path).wrap_err_with(|| unwritable(path));
        let json = self.json.as_ref().map(begin).transpose()?;
        let model = self.model(&vehicle);
        let library = vehicle.policy.library.as_ref().map(|path| vehicle.resolve(path));
        let pilot = campaign.pilot;
        // The classical pilot needs a policy's eyes, but not its way.
        let needed = pilot == PilotKind::Policy || task == Task::Track;
        ensure!(needed || self.policy.is_none(), "--pilot classical navigates without a policy: leave out --policy");
        let load = || needed.then(|| Policy::load(&model, library.as_deref(), 1)).transpose();
        let first = load()?;
        if let Some(policy) = first.as_ref().filter(|_| self.policy.is_none()) {
            vehicle.check_pin(&model, policy)?;
        }
        ensure!(
            first.as_ref().is_none_or(|policy| policy.contract().model().task == task),
            "policy {} was trained for another task than --task {}: give --policy",
            model.display(),
            super::report::task_name(task)
        );
        campaign.log = self.log.clone().map(|folder| Logs {
            folder,
            header: header(&vehicle, first.as_ref()),
            files: files.clone(),
        });
        let make = || Ok(load()?.map(|policy| Box::new(policy) as Box<dyn Network + Send>));
        let mut report = campaign.run(&vehicle, &make, &|flight| progress.flown(flight.outcome))?;
        progress.bar.finish_and_clear();
        report.policy_sha256 = first.map(|policy| policy.sha256().to_owned());
        report.command = pick::command(std::env::args_os().map(|argument| argument.to_string_lossy().into_owned()));
        if let Some((mut file, unfinished)) = json {
            file.write_all(&report.to_json()).and_then(|()| unfinished.finish()).wrap_err("cannot write the JSON")?;
        }
        println!("{}{}", table(&report), failures::failures(&report));
        if let Some(path) = &self.json {
            println!("draw it: goshawk campaign report {}", path.display());
        }
        Ok(())
    }

    fn campaign(&self, task: Task, vehicle: &Vehicle) -> Result<Campaign> {
        Ok(Campaign {
            pilot: match self.pilot {
                PilotName::Policy => PilotKind::Policy,
                PilotName::Classical => PilotKind::Classical,
            },
            task,
            speeds_mps: self.speed.clone(),
            worlds: self.worlds()?,
            courses: self.course.iter().map(|course| Course::parse(course)).collect::<Result<_, _>>()?,
            trials: self.trials,
            seed: self.seed,
            wind_mps: self.wind,
            speed_margin_mps: self.speed_margin,
            height_m: self.height.or(vehicle.profile(None).map(|p| p.height)).unwrap_or(1.5),
            sensors: self.sensors.load()?,
            airframe: Difference { spread: self.spread, ..Difference::parse(&self.airframe)? },
            moving: self.moving.moving,
            fault: self.fault,
            threads: self.threads,
            only: self.only.clone(),
            traced: self.json.is_some(),
            log: None,
        })
    }

    /// A forest for each spacing, or the one world.
    fn worlds(&self) -> Result<Vec<WorldSource>> {
        if self.world != "forest" {
            return Ok(vec![WorldSource::parse(&self.world, 0.0)?]);
        }
        Ok(self.spacing.iter().map(|&spacing_m| WorldSource::Forest { spacing_m }).collect())
    }

    fn model(&self, vehicle: &Vehicle) -> PathBuf {
        let task = match self.task {
            TaskName::Track => Task::Track,
            TaskName::Navigate => Task::Navigate,
        };
        self.policy.clone().unwrap_or_else(|| vehicle.model(task))
    }
}

fn unwritable(path: &Path) -> String {
    format!("cannot write {}", path.display())
}
