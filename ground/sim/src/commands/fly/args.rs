//! `goshawk-sim fly`.

mod help;

use std::io::Write;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use color_eyre::eyre::{Result, WrapErr, bail, ensure, eyre};
use goshawk_autopilot::Firmware as Kind;
use goshawk_core::Task;
use goshawk_policy::{Policy, PolicyError};
use goshawk_vehicle::config::Vehicle;

use super::files::Files;
use super::log::header;
use super::progress::Progress;
use super::records::Known;
use super::{Campaign, CampaignError, Logs, Pick, failures, pick, table};
use crate::actors::evader::Course;
use crate::actors::moving::MovingArgs;
use crate::seeds::{Identity, Seeds};
use crate::sense::file::SensorArgs;
use crate::trial::scene::COURSE_M;
use crate::trial::{Difference, EvaderKind, Fault, Firmware, Network, PilotKind, WorldSource};
use crate::world::forest::SPACING_M;
use help::after_help;

/// The task to fly.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TaskName {
    /// Follow the target, a running person.
    Track,
    /// Fly to a goal straight ahead.
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

/// Who is chased.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum EvaderName {
    /// Its run is planned before it begins: it sees nobody.
    Planned,
    /// It sees the vehicle, turns, doubles back, and hides behind what stands about.
    Reactive,
}

/// What flies the rotors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AutopilotName {
    /// Grants every request at once, and follows attitudes by inner loops of its own.
    Model,
    /// A PX4 that you have built.
    Px4,
    /// An `ArduPilot` Copter that you have built.
    #[value(name = "ardupilot")]
    ArduPilot,
}

/// Fly campaigns in lockstep and report successes.
#[derive(Debug, Args)]
#[command(after_help = after_help())]
pub struct FlyArgs {
    /// What to fly.
    #[arg(long, value_enum)]
    task: TaskName,
    /// What flies it; cells for each, on the same seeds.
    #[arg(long, value_enum, value_name = "PILOT[,…]", value_delimiter = ',', default_value = "policy")]
    pilot: Vec<PilotName>,
    /// Speeds, m/s: the evader's (track) or the vehicle's (navigate); a cell for each.
    #[arg(long, value_name = "V[,V…]", value_delimiter = ',', required = true, value_parser = positive)]
    speed: Vec<f64>,
    /// Flights in each cell.
    #[arg(long, value_name = "N", default_value_t = 10)]
    trials: usize,
    /// Seed of everything, of the range that --seeds names; absent: 1, for a table the one that its hashes lead to.
    #[arg(long)]
    seed: Option<u64>,
    /// What the seed is for: tuning, which is any choice of a number, or a table, on which nothing is chosen. A table's seed
    /// comes of the hashes of policy, vehicle file and flight code (`goshawk-sim seeds`).
    #[arg(long, value_enum, value_name = "RANGE", default_value = "tuning")]
    seeds: Seeds,
    /// Mean spacings of the trees, 1 to 1000 m; cells for each.
    #[arg(long, value_name = "M[,M…]", value_delimiter = ',', default_value = "4", value_parser = spacing)]
    spacing: Vec<f64>,
    /// The world: forest, buildings, or a point cloud (.ply, .pcd).
    #[arg(long, value_name = "WORLD", default_value = "forest")]
    world: String,
    /// How far ahead the goal is, the evader's or the vehicle's own; a reactive evader's whole way, m.
    #[arg(long, value_name = "M", default_value_t = COURSE_M, value_parser = course_length)]
    length: f64,
    /// Track: who is chased.
    #[arg(long, value_enum, default_value = "planned")]
    evader: EvaderName,
    /// Track: what a planned evader runs: goal, eight, zigzag, u-turn, square, stop-and-go, or a CSV file of waypoints (x,y in
    /// m ahead and left, and stand_s); cells for each. All points of a file must be reachable; a figure leaves out those
    /// that have no room near them.
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
    /// What gusts reach, 0 to 30 m/s.
    #[arg(long, value_name = "MPS", default_value_t = 0.0, value_parser = wind, allow_negative_numbers = true)]
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
    /// Who flies the rotors: a model that grants every request, or real firmware, to which the pilot speaks MAVLink. In
    /// lockstep, one flight after the other.
    #[arg(long, value_enum, default_value = "model")]
    autopilot: AutopilotName,
    /// The firmware: the folder of its source tree or of its build.
    #[arg(long, value_name = "DIR")]
    firmware: Option<PathBuf>,
    /// Write all that was found as JSON: cells, flights, and each flight's path and map. `goshawk campaign report FILE`
    /// makes a page of it.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the whole record of each flight, one a line as JSON, for --from. With --only, several machines can fly the
    /// parts of one campaign.
    #[arg(long, value_name = "FILE")]
    records: Option<PathBuf>,
    /// Fly nothing: make the report of the flights in FILE, which --records wrote, of all parts one after the other. Cells
    /// are the same to the last bit.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["records", "log", "threads"])]
    from: Option<PathBuf>,
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

/// A forest's mean spacing, m.
pub(crate) fn spacing(text: &str) -> Result<f64, String> {
    within(text, SPACING_M, "m")
}

/// What gusts reach, m/s.
pub(crate) fn wind(text: &str) -> Result<f64, String> {
    within(text, 0.0..=30.0, "m/s")
}

fn within(text: &str, range: RangeInclusive<f64>, unit: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value| range.contains(value));
    value.ok_or_else(|| format!("give {} to {} {unit}", range.start(), range.end()))
}

pub(crate) fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("{text:?} is not a number"))?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err(format!("{text} is not above 0")) }
}

fn course_length(text: &str) -> Result<f64, String> {
    let length_m = positive(text)?;
    if (10.0..=190.0).contains(&length_m) {
        Ok(length_m)
    } else {
        Err("a course is 10 to 190 m long, within the fence".to_owned())
    }
}

/// The policy as the vehicle's file has it run: flights must not come of another provider than it says.
///
/// # Errors
/// It cannot be loaded, or the provider is not to be had.
pub(crate) fn load_policy(vehicle: &Vehicle, model: &Path) -> Result<Policy, PolicyError> {
    let policy = vehicle.load_policy(model, 1)?;
    match policy.why_not() {
        None => Ok(policy),
        Some(why) => Err(PolicyError::Provider { asked: vehicle.policy.provider.name(), why: why.to_owned() }),
    }
}

impl FlyArgs {
    /// Flies, prints the table, writes the JSON.
    ///
    /// # Errors
    /// If the campaign could not be flown; the message says on what and what to do.
    pub fn run(self) -> Result<()> {
        ensure!(self.trials > 0, "--trials is 0: there is nothing to fly");
        ensure!((0.0..=0.3).contains(&self.spread), "--spread is {}: it must be 0 to 0.3", self.spread);
        let task = match self.task {
            TaskName::Track => Task::Track,
            TaskName::Navigate => Task::Navigate,
        };
        self.check_evader(task)?;
        if let Some(seed) = self.seed {
            self.seeds.allow(seed)?;
        }
        let vehicle = Vehicle::load(&self.vehicle_file)?;
        let mut campaign = self.campaign(task, &vehicle)?;
        // Known now rather than after the policy is loaded and the flights are flown.
        let progress = Progress::new(campaign.picks()?.len())?;
        let files = Files::default();
        progress.end_on_signals(&files)?;
        if let Some(folder) = &self.log {
            std::fs::create_dir_all(folder).wrap_err_with(|| unwritable(folder))?;
        }
        let kept = [self.from.as_ref(), self.json.as_ref()].map(|path| path.and_then(|path| path.canonicalize().ok()));
        ensure!(
            kept[0].is_none() || kept[0] != kept[1],
            "--json would overwrite what --from reads: give it another file"
        );
        let begin = |path: &PathBuf| files.begin(path).wrap_err_with(|| unwritable(path));
        let json = self.json.as_ref().map(begin).transpose()?;
        let records = self.records.as_ref().map(begin).transpose()?;
        let model = self.model(&vehicle);
        // The classical pilot needs a policy's eyes, but not its way.
        let needed = task == Task::Track || campaign.pilots.contains(&PilotKind::Policy);
        ensure!(needed || self.policy.is_none(), "--pilot classical navigates without a policy: leave out --policy");
        let load = || needed.then(|| load_policy(&vehicle, &model)).transpose();
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
        let identity = Identity::new(&vehicle, first.as_ref().map(|policy| policy.sha256().to_owned()));
        if self.seeds == Seeds::Table && self.seed.is_none() {
            campaign.seed = identity.table_seed();
        }
        campaign.log = self.log.clone().map(|folder| Logs {
            folder,
            header: header(&vehicle, first.as_ref()),
            files: files.clone(),
        });
        let make = || Ok(load()?.map(|policy| Box::new(policy) as Box<dyn Network + Send>));
        let flown = match &self.from {
            Some(path) => campaign.gather(&vehicle, &identity, Known::read(path)?),
            None => campaign.run(&vehicle, &make, &|flight| progress.flown(flight.outcome)),
        };
        // What was flown is kept, though it is not all.
        let (mut report, cut) = match flown {
            Err(CampaignError::Cut { flights, all, flown, why }) => {
                (*flown, Some(eyre!("{flights} of {all} flights were flown, then: {why}")))
            }
            flown => (flown?, None),
        };
        progress.bar.finish_and_clear();
        report.identity = identity;
        let mut arguments: Vec<String> = std::env::args_os().map(|a| a.to_string_lossy().into_owned()).collect();
        if self.seed.is_none() {
            arguments.extend(["--seed".to_owned(), report.seed.to_string()]);
        }
        report.command = pick::command(arguments);
        println!("{}{}", table(&report), failures::failures(&report));
        if let Some((mut file, unfinished)) = records {
            let lines = campaign.records(&report);
            file.write_all(&lines).and_then(|()| unfinished.finish()).wrap_err("cannot write the records")?;
        }
        if let Some((mut file, unfinished)) = json {
            file.write_all(&report.to_json()).and_then(|()| unfinished.finish()).wrap_err("cannot write the JSON")?;
        }
        if let Some(path) = &self.json {
            println!("draw it: goshawk campaign report {}", path.display());
        }
        cut.map_or(Ok(()), Err)
    }

    fn campaign(&self, task: Task, vehicle: &Vehicle) -> Result<Campaign> {
        Ok(Campaign {
            pilots: self.pilots(),
            task,
            speeds_mps: self.speed.clone(),
            worlds: self.worlds()?,
            evader: match self.evader {
                EvaderName::Planned => EvaderKind::Planned,
                EvaderName::Reactive => EvaderKind::Reactive,
            },
            length_m: self.length,
            courses: self.course.iter().map(|course| Course::parse(course)).collect::<Result<_, _>>()?,
            trials: self.trials,
            seed: self.seed.unwrap_or(1),
            wind_mps: self.wind,
            speed_margin_mps: self.speed_margin,
            height_m: self.height.or(vehicle.profile(None).map(|p| p.height)).unwrap_or(1.5),
            sensors: self.sensors.load()?,
            airframe: Difference { spread: self.spread, ..Difference::parse(&self.airframe)? },
            moving: self.moving.moving,
            fault: self.fault,
            firmware: self.firmware(vehicle)?,
            // Each would need ports of its own.
            threads: if self.firmware.is_some() { 1 } else { self.threads },
            only: self.only.clone(),
            traced: self.json.is_some(),
            log: None,
        })
    }

    /// The firmware that flies the rotors; none: the model does.
    fn firmware(&self, vehicle: &Vehicle) -> Result<Option<Firmware>> {
        let named = vehicle.autopilot.firmware();
        Ok(match (self.autopilot, &self.firmware, named) {
            (AutopilotName::Model, None, _) => None,
            (AutopilotName::Px4, Some(folder), Kind::Px4) => Some(Firmware::Px4(folder.clone())),
            (AutopilotName::ArduPilot, Some(folder), Kind::ArduPilot(_)) => Some(Firmware::ArduPilot(folder.clone())),
            (AutopilotName::Model, Some(_), _) | (_, None, _) => {
                bail!("--autopilot px4 or ardupilot and --firmware DIR belong together: the folder of its build")
            }
            _ => bail!(
                "the vehicle file's [autopilot] firmware is {named}: give --vehicle-file the file of the firmware that flies"
            ),
        })
    }

    /// Each once, in the order given.
    fn pilots(&self) -> Vec<PilotKind> {
        let mut pilots = Vec::new();
        for name in &self.pilot {
            let pilot = match name {
                PilotName::Policy => PilotKind::Policy,
                PilotName::Classical => PilotKind::Classical,
            };
            if !pilots.contains(&pilot) {
                pilots.push(pilot);
            }
        }
        pilots
    }

    /// A reactive evader runs where it likes, and looks out for what stands, not for what moves.
    fn check_evader(&self, task: Task) -> Result<()> {
        if self.evader == EvaderName::Reactive {
            ensure!(task == Task::Track, "--evader reactive is for --task track");
            ensure!(self.course == ["goal"], "--evader reactive runs where it likes: leave out --course");
            ensure!(self.moving.moving == 0, "--evader reactive does not look out for what moves: leave out --moving");
        }
        ensure!(
            task == Task::Track || self.course == ["goal"],
            "--course is what a target runs: it is for --task track"
        );
        Ok(())
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
