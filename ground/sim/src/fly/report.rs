//! What a campaign found: the JSON that other people's tools read, made of the flights of each cell.

use std::collections::BTreeMap;

use goshawk_core::types::Task;
use serde::Serialize;

use crate::trial::{Contact, Flight, Outcome, PilotKind, WorldSource};

/// The whole of it. Everything but `timing` is the same for the same seed, vehicle file and policy.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The campaign's seed.
    pub seed: u64,
    /// Vehicle's name in its file.
    pub vehicle: String,
    /// SHA-256 of the policy's file; none for a stand-in.
    pub policy_sha256: Option<String>,
    /// Track: the vehicle's desired speed over the evader's.
    pub speed_ratio: f64,
    /// One for each speed and spacing.
    pub cells: Vec<Cell>,
    /// How long it took.
    pub timing: Timing,
}

/// Flights of one speed and spacing.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)] // the acceptance document's names
pub struct Cell {
    pub pilot: &'static str,
    pub task: &'static str,
    pub speed_mps: f64,
    pub spacing_m: f64,
    pub world: String,
    pub wind_mps: f64,
    pub trials: usize,
    pub successes: usize,
    /// 95 % interval of the success rate (Wilson).
    pub success_interval: [f64; 2],
    pub failures: Failures,
    /// What was hit, by kind.
    pub contacts: BTreeMap<&'static str, usize>,
    /// Of the flights' closest approaches, sphere to obstacle.
    pub clearance_m: Clearance,
    /// Frames with the target in view; none in navigation.
    pub in_view_fraction: Option<f64>,
    /// Mean and largest distance to the target; none in navigation.
    pub target_distance_m: Option<Distance>,
    /// None in navigation, or if the target was never located.
    pub target_error_m: Option<TargetError>,
    /// Mean over the flights of ∫ jerk² dt, m²/s⁵.
    pub jerk_integral: f64,
    /// Mean over all flown time, and the highest.
    pub flown_speed_mps: Speed,
    /// Simulated time of all flights, s.
    pub simulated_s: f64,
    pub flights: Vec<FlightRow>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[allow(missing_docs)]
pub struct Failures {
    pub collision: usize,
    pub lost: usize,
    pub timeout: usize,
}

#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub struct Clearance {
    pub min: Option<f64>,
    pub p5: Option<f64>,
    pub p50: Option<f64>,
}

#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub struct Distance {
    pub mean: f64,
    pub max: f64,
}

#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub struct TargetError {
    pub lateral: Range,
    pub longitudinal: Range,
}

#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub struct Range {
    pub p5: f64,
    pub p95: f64,
}

#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub struct Speed {
    pub mean: f64,
    pub max: f64,
}

/// One flight in short.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)]
pub struct FlightRow {
    pub trial: usize,
    pub outcome: &'static str,
    pub contact: Option<&'static str>,
    pub flown_s: f64,
    pub end_pos_m: [f64; 3],
    pub end_distance_m: f64,
    pub unseen_s: Option<f64>,
    pub clearance_m: Option<f64>,
    pub in_view_fraction: Option<f64>,
    /// "12.3 Search: the target has not been seen for too long", one for each change of mode.
    pub modes: Vec<String>,
}

#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub struct Timing {
    pub wall_s: f64,
    pub simulated_s: f64,
    /// Simulated over wall time, all threads together.
    pub realtime_factor: f64,
    pub threads: usize,
}

/// The task's name in the report.
#[must_use]
pub fn task_name(task: Task) -> &'static str {
    match task {
        Task::Track => "track",
        Task::Navigate => "navigate",
    }
}

/// The pilot's name in the report.
#[must_use]
pub fn pilot_name(pilot: PilotKind) -> &'static str {
    match pilot {
        PilotKind::Policy => "policy",
        PilotKind::Classical => "classical",
    }
}

/// The outcome's name in the report.
#[must_use]
pub fn outcome_name(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Success => "success",
        Outcome::Collision => "collision",
        Outcome::Lost => "lost",
        Outcome::Timeout => "timeout",
    }
}

fn contact_name(contact: Contact) -> &'static str {
    match contact {
        Contact::Trunk => "trunk",
        Contact::Branch => "branch",
        Contact::Foliage => "foliage",
        Contact::Building => "building",
        Contact::Scan => "scan",
        Contact::Ground => "ground",
        Contact::Person => "person",
    }
}

/// The `q` quantile (0..=1) of values in any order, between neighbours linear; none of nothing.
#[must_use]
pub fn quantile(values: &[f64], q: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    let place = q.clamp(0.0, 1.0) * last as f64;
    let (low, part) = (place.floor() as usize, place.fract());
    Some(sorted[low] + (sorted[(low + 1).min(last)] - sorted[low]) * part)
}

/// The 95 % Wilson interval of a rate.
#[must_use]
pub fn wilson(successes: usize, trials: usize) -> [f64; 2] {
    if trials == 0 {
        return [0.0, 1.0];
    }
    let (n, z) = (trials as f64, 1.96);
    let p = successes as f64 / n;
    let centre = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    [(centre - half).max(0.0), (centre + half).min(1.0)]
}

/// What all flights of a cell have in common.
#[derive(Clone, Debug)]
pub struct CellConfig {
    /// Which software flies.
    pub pilot: PilotKind,
    /// Chase or fly to a goal.
    pub task: Task,
    /// m/s.
    pub speed_mps: f64,
    /// Where.
    pub world: WorldSource,
    /// m/s.
    pub wind_mps: f64,
}

impl CellConfig {
    /// The world in short, as in a file's name: `4m`, `buildings`, `hall.ply`.
    #[must_use]
    pub fn label(&self) -> String {
        match &self.world {
            WorldSource::Forest { spacing_m } => format!("{spacing_m}m"),
            other => other.name().to_owned(),
        }
    }
}

impl Cell {
    /// The summary of a cell's flights, in the order of the trials.
    #[must_use]
    pub fn of(config: &CellConfig, flights: &[Flight]) -> Self {
        let count = |outcome| flights.iter().filter(|f| f.outcome == outcome).count();
        let successes = count(Outcome::Success);
        let mut contacts = BTreeMap::new();
        for contact in flights.iter().filter_map(|f| f.contact) {
            *contacts.entry(contact_name(contact)).or_insert(0) += 1;
        }
        let clearances: Vec<f64> = flights.iter().filter_map(|f| f.metrics.clearance_m).collect();
        let sum = |value: &dyn Fn(&Flight) -> f64| flights.iter().map(value).sum::<f64>();
        let frames = sum(&|f| f.metrics.frames as f64).max(1.0);
        let pooled = |part: fn(&Flight) -> &Vec<f64>| flights.iter().flat_map(part).copied().collect::<Vec<f64>>();
        let lateral = range(&pooled(|f| &f.metrics.lateral_m));
        let longitudinal = range(&pooled(|f| &f.metrics.longitudinal_m));
        let tracks = config.task == Task::Track;
        Self {
            pilot: pilot_name(config.pilot),
            task: task_name(config.task),
            speed_mps: config.speed_mps,
            spacing_m: config.world.spacing_m(),
            world: config.world.name().to_owned(),
            wind_mps: config.wind_mps,
            trials: flights.len(),
            successes,
            success_interval: wilson(successes, flights.len()),
            failures: Failures {
                collision: count(Outcome::Collision),
                lost: count(Outcome::Lost),
                timeout: count(Outcome::Timeout),
            },
            contacts,
            clearance_m: Clearance {
                min: quantile(&clearances, 0.0),
                p5: quantile(&clearances, 0.05),
                p50: quantile(&clearances, 0.5),
            },
            in_view_fraction: tracks.then(|| sum(&|f| f.metrics.frames_in_view as f64) / frames),
            target_distance_m: tracks.then(|| Distance {
                mean: sum(&|f| f.metrics.distance_sum_m) / frames,
                max: flights.iter().map(|f| f.metrics.distance_max_m).fold(0.0, f64::max),
            }),
            target_error_m: lateral
                .zip(longitudinal)
                .map(|(lateral, longitudinal)| TargetError { lateral, longitudinal }),
            jerk_integral: sum(&|f| f.metrics.jerk_integral) / (flights.len() as f64).max(1.0),
            flown_speed_mps: Speed {
                mean: sum(&|f| f.metrics.way_m) / sum(&|f| f.metrics.task_s).max(1e-9),
                max: flights.iter().map(|f| f.metrics.speed_max_mps).fold(0.0, f64::max),
            },
            simulated_s: sum(&|f| f.flown_s),
            flights: flights.iter().enumerate().map(|(trial, f)| FlightRow::of(trial, f, tracks)).collect(),
        }
    }
}

fn range(values: &[f64]) -> Option<Range> {
    Some(Range { p5: quantile(values, 0.05)?, p95: quantile(values, 0.95)? })
}

impl FlightRow {
    fn of(trial: usize, flight: &Flight, tracks: bool) -> Self {
        let m = &flight.metrics;
        Self {
            trial,
            outcome: outcome_name(flight.outcome),
            contact: flight.contact.map(contact_name),
            flown_s: flight.flown_s,
            end_pos_m: flight.end_world.into(),
            end_distance_m: flight.end_distance_m,
            unseen_s: flight.unseen_s,
            clearance_m: m.clearance_m,
            in_view_fraction: (tracks && m.frames > 0).then(|| m.frames_in_view as f64 / m.frames as f64),
            modes: flight.modes.iter().map(|(at, to, cause)| format!("{at:.2} {to:?}: {cause}")).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_neighbours() {
        let values = [3.0, 1.0, 2.0, 5.0, 4.0];
        assert_eq!(quantile(&values, 0.0), Some(1.0));
        assert_eq!(quantile(&values, 0.5), Some(3.0));
        assert_eq!(quantile(&values, 0.875), Some(4.5));
        assert_eq!(quantile(&[], 0.5), None);
    }

    #[test]
    fn the_wilson_interval_is_that_of_the_textbook() {
        let [low, high] = wilson(9, 10);
        assert!((low - 0.5958).abs() < 1e-3 && (high - 0.9821).abs() < 1e-3, "{low} {high}");
        assert_eq!(wilson(0, 0), [0.0, 1.0]);
    }
}
