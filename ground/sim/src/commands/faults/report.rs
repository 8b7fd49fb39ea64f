//! What was noticed, fault by fault, and what was noticed where nothing was wrong.

use std::collections::BTreeMap;

use goshawk_core::Mode;
use serde::Serialize;

use crate::commands::fly::Flown;
use crate::commands::fly::report::stats::quantiles;
use crate::trial::{Fault, Flight, Outcome};

/// The whole of it.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The seed of every campaign.
    pub seed: u64,
    /// The evader's speed, or the vehicle's own, m/s.
    pub speed_mps: f64,
    /// A row a fault.
    pub faults: Vec<Row>,
    /// A row an ordinary campaign.
    pub ordinary: Vec<Ordinary>,
}

/// The flights of one fault.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Its name.
    pub fault: &'static str,
    /// Flights in which it began.
    pub flights: usize,
    /// Of them, those in which the vehicle named it.
    pub named: usize,
    /// From its beginning to its name, s; none: it never was.
    pub seconds_to_name: Option<Times>,
    /// Contacts after it began.
    pub collisions: usize,
    /// How the flights ended, and how many did.
    pub ended: BTreeMap<&'static str, usize>,
    /// The trials that it was not named in or that ended in a contact, to fly again.
    pub failed_trials: Vec<usize>,
}

/// Times of several flights, s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Times {
    pub p50: f64,
    pub max: f64,
}

/// Flights in which nothing went wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ordinary {
    /// What was flown.
    pub campaign: String,
    /// How many.
    pub flights: usize,
    /// How long, h.
    pub flown_h: f64,
    /// How often a fault was named.
    pub false_alarms: usize,
    /// The names, and how often each.
    pub names: BTreeMap<&'static str, usize>,
}

impl Row {
    /// The summary of a fault's flights.
    #[must_use]
    pub fn of<'a>(fault: Fault, flown: impl Iterator<Item = &'a Flown>) -> Self {
        let mut row = Self {
            fault: fault.name(),
            flights: 0,
            named: 0,
            seconds_to_name: None,
            collisions: 0,
            ended: BTreeMap::new(),
            failed_trials: Vec::new(),
        };
        let mut times = Vec::new();
        for Flown { pick, flight, .. } in flown {
            let Some(begun_s) = flight.fault_at_s else { continue };
            row.flights += 1;
            let named_s = named_after(flight, fault, begun_s);
            let hit = flight.outcome == Outcome::Collision;
            times.extend(named_s);
            row.collisions += usize::from(hit);
            *row.ended.entry(ended(flight)).or_insert(0) += 1;
            if named_s.is_none() || hit {
                row.failed_trials.push(pick.trial);
            }
        }
        row.named = times.len();
        row.seconds_to_name = quantiles(&times, [0.5, 1.0]).map(|[p50, max]| Times { p50, max });
        row
    }
}

/// From a fault's beginning to its name, s.
fn named_after(flight: &Flight, fault: Fault, begun_s: f64) -> Option<f64> {
    let right = |name: &str| fault.noticed_as().contains(&name);
    flight.named.iter().find(|(at, name)| *at >= begun_s && right(name)).map(|(at, _)| at - begun_s)
}

fn ended(flight: &Flight) -> &'static str {
    match (flight.outcome, flight.modes.last()) {
        (Outcome::Collision, _) => "collision",
        (Outcome::Success, Some((_, Mode::Landed, _))) => "landed",
        (Outcome::Success, _) => "handed back",
        _ => "flew on",
    }
}

impl Ordinary {
    /// The summary of a campaign's flights.
    #[must_use]
    pub fn of<'a>(campaign: &str, flown: impl Iterator<Item = &'a Flown>) -> Self {
        let mut row =
            Self { campaign: campaign.to_owned(), flights: 0, flown_h: 0.0, false_alarms: 0, names: BTreeMap::new() };
        for Flown { flight, .. } in flown {
            row.flights += 1;
            row.flown_h += flight.flown_s / 3600.0;
            row.false_alarms += flight.named.len();
            for (_, name) in &flight.named {
                *row.names.entry(*name).or_insert(0) += 1;
            }
        }
        row
    }
}

impl Report {
    /// As JSON.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        serde_json::to_vec_pretty(self).expect("numbers, strings and lists become JSON")
    }
}
