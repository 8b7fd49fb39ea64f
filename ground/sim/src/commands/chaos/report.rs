//! What came of a campaign of schedules: counts, and what failed.

use std::collections::BTreeMap;
use std::fmt::Write;

use serde::Serialize;

use super::flight::Flown;
use super::judge::properties::{Property, Violation};
use super::schedule::Schedule;

/// A schedule in which a property did not hold.
#[derive(Clone, Debug, Serialize)]
pub struct Failure {
    /// Its number.
    pub index: u64,
    /// As it was drawn.
    pub schedule: Schedule,
    /// What did not hold.
    pub violation: Violation,
    /// The smallest that still fails; none: it was not shrunk, for others were before it.
    pub shrunk: Option<Small>,
}

/// A shrunk schedule.
#[derive(Clone, Debug, Serialize)]
pub struct Small {
    /// Itself.
    pub schedule: Schedule,
    /// What does not hold in it.
    pub violation: Option<Violation>,
    /// Flights that it took to find it.
    pub flights: usize,
    /// What flies it again.
    pub command: String,
}

/// Everything.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// The campaign's.
    pub seed: u64,
    /// Schedules flown.
    pub schedules: u64,
    /// Faults in them, by name.
    pub faults: BTreeMap<&'static str, u64>,
    /// Flights, by how they ended.
    pub ended: BTreeMap<&'static str, u64>,
    /// Changes of mode, by cause.
    pub causes: BTreeMap<String, u64>,
    /// Steps of the controller, each judged.
    pub steps: u64,
    /// Logs read back and replayed.
    pub logs: u64,
    /// Simulated, h.
    pub flown_h: f64,
    /// Over all answers of all flights: the same seed, the same digest.
    pub digest: String,
    /// How often each property failed.
    pub violations: BTreeMap<&'static str, u64>,
    /// The first that failed, in the order of their numbers.
    pub failures: Vec<Failure>,
}

impl Report {
    /// Counts `flights`, which come in the order of their schedules.
    #[must_use]
    pub fn of(seed: u64, flights: &[(Schedule, Flown)]) -> Self {
        let mut report = Self { seed, schedules: flights.len() as u64, ..Self::default() };
        report.violations = Property::ALL.map(|property| (property.name(), 0)).into();
        let (mut digest, mut flown_s) = (0u64, 0.0);
        for (schedule, flown) in flights {
            for fault in &schedule.faults {
                *report.faults.entry(fault.what.name()).or_default() += 1;
            }
            let ended = if flown.violation.is_some() { "violation" } else { flown.ended };
            *report.ended.entry(ended).or_default() += 1;
            for (_, _, cause) in &flown.modes {
                *report.causes.entry(cause.to_string()).or_default() += 1;
            }
            report.steps += flown.steps;
            report.logs += flown.logs as u64;
            flown_s += flown.flown_s;
            digest = digest.rotate_left(7) ^ flown.digest;
            if let Some(violation) = &flown.violation {
                *report.violations.entry(violation.property.name()).or_default() += 1;
            }
        }
        (report.flown_h, report.digest) = (flown_s / 3600.0, format!("{digest:016x}"));
        report
    }

    /// Nothing failed.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        self.violations.values().all(|count| *count == 0)
    }

    /// As JSON.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        serde_json::to_vec_pretty(self).expect("numbers, strings and lists become JSON")
    }

    /// For the terminal.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = String::new();
        let list = |counts: &mut dyn Iterator<Item = (String, u64)>| {
            counts.map(|(name, count)| format!("{name} {count}")).collect::<Vec<_>>().join(", ")
        };
        let own = |counts: &BTreeMap<&'static str, u64>| {
            list(&mut counts.iter().map(|(name, count)| ((*name).to_owned(), *count)))
        };
        let rows =
            [("faults", own(&self.faults)), ("flights ended", own(&self.ended)), ("violations", own(&self.violations))];
        for (name, row) in rows {
            let _ = writeln!(text, "{name:<14}{row}");
        }
        let causes = list(&mut self.causes.iter().map(|(name, count)| (name.clone(), *count)));
        let _ = writeln!(text, "{:<14}{causes}", "mode changes");
        let _ = writeln!(
            text,
            "{:<14}{} schedules, {:.2} h of flight, {} steps judged, {} logs read back and replayed, digest {}",
            "flown", self.schedules, self.flown_h, self.steps, self.logs, self.digest
        );
        for failure in &self.failures {
            let _ = writeln!(text, "schedule {}: {}", failure.index, failure.violation);
            if let Some(small) = &failure.shrunk {
                let many = small.schedule.faults.len();
                let s = if many == 1 { "" } else { "s" };
                let _ = writeln!(
                    text,
                    "  shrunk to {many} fault{s} in {} flights; again with:\n  {}",
                    small.flights, small.command
                );
            }
        }
        text
    }
}
