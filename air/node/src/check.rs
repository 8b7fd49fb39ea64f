//! Before a flight: walks every condition and says of each whether it holds and, if not, what to do.

mod autopilot;
mod board;
pub mod frames;
mod live;

use std::path::Path;

use goshawk_policy::Policy;
use goshawk_vehicle::config::Vehicle;
use goshawk_vehicle::errors::one_line;
use goshawk_vehicle::mounting;
use serde::Serialize;

use crate::run::Overrides;

/// How a condition stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// It holds.
    Ok,
    /// It can be flown with, not as well.
    Warning,
    /// It must hold before a flight, and does not.
    Failed,
}

/// One condition.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What was looked at.
    pub name: &'static str,
    /// How it stands.
    pub level: Level,
    /// What was found; where it is not well, what to do.
    pub text: String,
}

/// All that was looked at, in order.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Findings {
    /// Each condition.
    pub conditions: Vec<Finding>,
    /// Nothing failed.
    pub ready: bool,
}

impl Findings {
    fn ok(&mut self, name: &'static str, text: impl Into<String>) {
        self.conditions.push(Finding { name, level: Level::Ok, text: text.into() });
    }

    fn warn(&mut self, name: &'static str, text: impl Into<String>) {
        self.conditions.push(Finding { name, level: Level::Warning, text: text.into() });
    }

    fn fail(&mut self, name: &'static str, text: impl Into<String>) {
        self.conditions.push(Finding { name, level: Level::Failed, text: text.into() });
    }

    /// Says whether anything failed.
    fn settle(&mut self) {
        self.ready = self.conditions.iter().all(|condition| condition.level != Level::Failed);
    }

    /// Ok with one text, or failed with the other.
    fn judge(&mut self, name: &'static str, result: Result<String, String>) {
        match result {
            Ok(text) => self.ok(name, text),
            Err(text) => self.fail(name, text),
        }
    }
}

/// Walks every condition; `wait_s`: how long autopilot and sensors are listened to.
#[must_use]
pub fn check(config: &Path, overrides: Overrides, wait_s: f64) -> Findings {
    let mut findings = Findings::default();
    match Vehicle::load(config) {
        Ok(mut vehicle) => {
            let names = vehicle.profile_names().join(", ");
            findings.ok("vehicle file", format!("{}: {}, profiles {names}", config.display(), vehicle.name));
            let (model, log_dir) = overrides.apply(&mut vehicle);
            let policy: Option<Policy> = board::policy(&vehicle, &model, &mut findings);
            if let Some(standing) = mounting::standing(&vehicle) {
                findings.judge("mounting", standing.map(|()| "the frames were checked by hand".to_owned()));
            }
            if let Some(why) = vehicle.unkept() {
                findings.warn("least distance", why);
            }
            board::tilt(&vehicle, &mut findings);
            board::scheduling(&vehicle, &mut findings);
            board::log_folder(&log_dir, &mut findings);
            live::listen(&vehicle, policy.as_ref(), wait_s, &mut findings);
        }
        Err(error) => findings.fail("vehicle file", one_line(&error)),
    }
    findings.settle();
    findings
}

/// Prints the conditions, but those that were `told` as they came.
pub fn print(findings: &Findings, told: bool) {
    for finding in findings.conditions.iter().filter(|finding| !told || finding.level == Level::Failed) {
        println!("{finding}");
    }
    let failed = findings.conditions.iter().filter(|condition| condition.level == Level::Failed).count();
    if findings.ready {
        println!("ready");
    } else {
        println!("not ready: {failed} of {} conditions failed", findings.conditions.len());
    }
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mark = match self.level {
            Level::Ok => "ok",
            Level::Warning => "warning",
            Level::Failed => "FAILED",
        };
        write!(f, "{mark:<8} {:<16} {}", self.name, self.text)
    }
}
