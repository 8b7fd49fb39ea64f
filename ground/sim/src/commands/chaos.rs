//! `goshawk-sim chaos`: flights with seeded schedules of faults, properties judged at every step, and the smallest
//! schedule of what fails.

mod aboard;
mod acting;
mod bug;
pub mod draw;
mod flight;
mod hangar;
mod judge;
pub mod report;
pub mod schedule;
pub mod shrink;
pub mod standin;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use color_eyre::eyre::{Result, WrapErr, bail, ensure, eyre};
use rayon::prelude::*;

use crate::commands::fly::files::Files;
use crate::commands::fly::pick::quoted;
use crate::commands::fly::progress::Progress;
use crate::trial::Outcome;
pub use bug::Bug;
use draw::draw;
pub use flight::Flown;
pub use hangar::Hangar;
pub use judge::properties::{Property, Violation};
use report::{Failure, Report, Small};
use schedule::Schedule;
use shrink::shrink;

/// Of many failures so many are shown, and the first of each property is shrunk.
const SHOWN: usize = 5;
/// What is flown with unless another is named.
const VEHICLE_FILE: &str = "air/vehicles/sim.toml";

/// Fly seeded schedules of faults, and judge every step.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  goshawk-sim chaos --seed 1 --schedules 1000\n  \
                  goshawk-sim chaos --schedule failed.json   # or its JSON itself, in quotes\n  \
                  goshawk-sim chaos --inject deaf-to-stop --schedules 100   # is that bug found?\n  \
                  goshawk-sim chaos --seed 1 --only 17 --print   # the schedule alone\n\n\
                  Judged at every step: never silent in authority; no setpoint after it ended; limits kept; a Stop obeyed;\n\
                  the transition table's changes of mode, for its reasons; a refused start refused. Of every log: what was\n\
                  on the disk can be read, also where it was cut; a replay answers the same, bit for bit.\n\n\
                  Exit status:\n  0    every property held\n  1    one did not, or it could not be flown\n  \
                  2    the command line is wrong\n  130  interrupted (143: terminated)")]
pub struct ChaosArgs {
    /// Seed of everything.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Schedules to fly.
    #[arg(long, value_name = "N", default_value_t = 100)]
    schedules: u64,
    /// The number of the first: a campaign can be flown in parts.
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    from: u64,
    /// The schedule of this number only.
    #[arg(long, value_name = "NUMBER", conflicts_with_all = ["schedules", "from"])]
    only: Option<u64>,
    /// Fly this schedule: a file, or the JSON itself.
    #[arg(long, value_name = "FILE|JSON", conflicts_with_all = ["only", "schedules", "seed", "from"])]
    schedule: Option<String>,
    /// Only print the schedules, one a line.
    #[arg(long)]
    print: bool,
    /// Put a bug around the controller, to see that it is found.
    #[arg(long, value_name = "BUG")]
    inject: Option<Bug>,
    /// Do not look for the smallest schedule that fails.
    #[arg(long)]
    no_shrink: bool,
    /// The vehicle file.
    #[arg(long, value_name = "FILE", default_value = VEHICLE_FILE)]
    vehicle_file: PathBuf,
    /// Write what came of it as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Flights at once; 0: one for each core.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
}

/// Flies the schedules over `threads` threads (0: one for each core), in their order; `done` after each.
///
/// # Errors
/// One of them cannot be flown at all.
pub fn campaign(
    hangar: &Hangar,
    schedules: Vec<Schedule>,
    threads: usize,
    done: &(dyn Fn(&Flown) + Sync),
) -> Result<Vec<(Schedule, Flown)>> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    pool.install(|| {
        schedules
            .into_par_iter()
            .with_max_len(1)
            .map(|schedule| {
                let flown = hangar.fly(&schedule).wrap_err_with(|| format!("schedule {}", schedule.line()))?;
                done(&flown);
                Ok((schedule, flown))
            })
            .collect()
    })
}

impl ChaosArgs {
    /// Flies, prints the table, writes the JSON.
    ///
    /// # Errors
    /// If it could not be flown, or a property did not hold; the message says what to do.
    pub fn run(self) -> Result<()> {
        let (first, schedules) = self.chosen()?;
        if self.print {
            schedules.iter().for_each(|schedule| println!("{}", schedule.line()));
            return Ok(());
        }
        let hangar = Hangar::new(self.vehicle_file.clone(), self.inject)?;
        if schedules.iter().any(|schedule| schedule.setting.task == schedule::Task::Track) {
            hangar.check()?;
        }
        let progress = Progress::new(schedules.len())?;
        let files = Files::default();
        progress.end_on_signals(&files)?;
        let begin = |path: &PathBuf| files.begin(path).wrap_err_with(|| format!("cannot write {}", path.display()));
        let json = self.json.as_ref().map(begin).transpose()?;
        let begun = Instant::now();
        let failed = |flown: &Flown| if flown.violation.is_some() { Outcome::Lost } else { Outcome::Success };
        let flights = campaign(&hangar, schedules, self.threads, &|flown| progress.flown(failed(flown)))?;
        progress.bar.finish_and_clear();
        let took_s = begun.elapsed().as_secs_f64();
        let mut report = Report::of(self.seed, &flights);
        report.failures = self.failures(&hangar, first, &flights);
        if let Some((mut file, unfinished)) = json {
            file.write_all(&report.to_json()).and_then(|()| unfinished.finish()).wrap_err("cannot write the JSON")?;
        }
        print!("{}", report.table());
        println!("{:<14}{took_s:.1} s: {:.2} schedules a second", "took", report.schedules as f64 / took_s);
        if report.is_clean() { Ok(()) } else { bail!("a property did not hold: see the schedule above") }
    }

    /// The schedules, and the number of the first.
    fn chosen(&self) -> Result<(u64, Vec<Schedule>)> {
        if let Some(text) = &self.schedule {
            return Ok((0, vec![Schedule::load(text).map_err(|e| eyre!(e))?]));
        }
        if let Some(only) = self.only {
            return Ok((only, vec![draw(self.seed, only)]));
        }
        ensure!(self.schedules > 0, "--schedules is 0: there is nothing to fly");
        let numbers = self.from..self.from.saturating_add(self.schedules);
        Ok((self.from, numbers.map(|index| draw(self.seed, index)).collect()))
    }

    /// What failed, the first of each property shrunk.
    fn failures(&self, hangar: &Hangar, first: u64, flights: &[(Schedule, Flown)]) -> Vec<Failure> {
        let mut failures: Vec<Failure> = Vec::new();
        for (index, (schedule, flown)) in (first..).zip(flights) {
            let Some(violation) = flown.violation.clone() else { continue };
            let known = failures.iter().any(|failure| failure.violation.property == violation.property);
            if known && failures.len() >= SHOWN {
                continue;
            }
            let shrunk = (!known && !self.no_shrink).then(|| {
                // Shrinking takes its time, and may be ended.
                eprintln!("{violation}; it is made small. As it was drawn: --schedule '{}'", schedule.line());
                self.shrunk(hangar, schedule, flown)
            });
            failures.push(Failure { index, schedule: schedule.clone(), violation, shrunk });
        }
        failures
    }

    fn shrunk(&self, hangar: &Hangar, schedule: &Schedule, flown: &Flown) -> Small {
        let property = flown.violation.as_ref().map_or(Property::NeverSilent, |violation| violation.property);
        let small = shrink(schedule, flown, property, &|schedule| hangar.fly(schedule));
        let mut command = "goshawk-sim chaos".to_owned();
        if let Some(bug) = self.inject {
            command += &format!(" --inject {}", bug.name());
        }
        if self.vehicle_file != Path::new(VEHICLE_FILE) {
            command += &format!(" --vehicle-file {}", quoted(self.vehicle_file.display().to_string()));
        }
        command += &format!(" --schedule '{}'", small.schedule.line());
        Small { schedule: small.schedule, violation: small.flown.violation, flights: small.flights, command }
    }
}
