//! What a campaign found: the JSON that other people's tools read, made of the flights of each cell.

use std::collections::BTreeMap;
use std::time::Duration;

use goshawk_core::Task;
use serde::Serialize;

use super::stats::{quantile, quantiles, wilson};
use super::{Flown, Pick};
use crate::actors::evader::Course;
use crate::trial::{Contact, Flight, Metrics, Outcome, PilotKind, WorldSource};

/// The whole of it. Everything but `timing` is the same for the same seed, vehicle file and policy.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The campaign's seed.
    pub seed: u64,
    /// Vehicle's name in its file.
    pub vehicle: String,
    /// SHA-256 of the policy's file; none for a stand-in.
    pub policy_sha256: Option<String>,
    /// Flies it again.
    pub command: String,
    /// Of this program.
    pub version: &'static str,
    /// Width and height of the camera's image.
    pub image_px: [usize; 2],
    /// Track: how much faster than the evader the vehicle may fly, m/s.
    pub speed_margin_mps: f64,
    /// Height of the flights above the start, m.
    pub height_m: f64,
    /// One for each speed and spacing of which anything was flown.
    pub cells: Vec<Cell>,
    /// How long it took.
    pub timing: Timing,
    /// The flights of each cell; their paths are in the JSON.
    #[serde(skip)]
    pub flown: Vec<Vec<Flown>>,
}

/// Flights of one speed and spacing.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)] // the acceptance document's names
pub struct Cell {
    /// Its place in the campaign, from 0.
    pub cell: usize,
    pub pilot: &'static str,
    pub task: &'static str,
    pub speed_mps: f64,
    pub spacing_m: f64,
    pub world: String,
    /// What the target ran; none in navigation.
    pub course: Option<String>,
    pub wind_mps: f64,
    /// Moving obstacles in each flight.
    pub moving: usize,
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
    /// Of the flights' least distances to the target, centre to centre, until 5 s after its arrival; none in navigation.
    pub min_distance_to_target_m: Option<Closest>,
    /// None in navigation, or if the target was never located.
    pub target_error_m: Option<TargetError>,
    /// Mean over the flights of ∫ jerk² dt, m²/s⁵.
    pub jerk_integral: f64,
    /// Of the flights' ∫ jerk² dt.
    pub jerk_integral_quantiles: Option<Quantiles>,
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
    /// Nearer than 1.5 m to the target, and otherwise a success.
    pub too_close: usize,
}

/// A least distance over some flights, m.
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub struct Closest {
    pub min: f64,
    pub p1: f64,
    pub p50: f64,
}

impl Closest {
    /// Of the flights in which a target was about; none if in none.
    #[must_use]
    pub fn of<'a>(flights: impl Iterator<Item = &'a Flight>) -> Option<Self> {
        let least: Vec<f64> = flights.filter_map(|f| f.metrics.target_distance_min_m).collect();
        quantiles(&least, [0.0, 0.01, 0.5]).map(|[min, p1, p50]| Self { min, p1, p50 })
    }
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
pub struct Quantiles {
    pub p5: f64,
    pub p50: f64,
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
    pub target_distance_m: Option<Distance>,
    /// Least distance to the target, centre to centre.
    pub min_distance_to_target_m: Option<f64>,
    pub jerk_integral: f64,
    pub flown_speed_mps: Speed,
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

impl Timing {
    pub(super) fn of(wall: Duration, flown: &[Flown], threads: usize) -> Self {
        let (wall_s, simulated_s) = (wall.as_secs_f64(), flown.iter().map(|f| f.flight.flown_s).sum::<f64>());
        Self { wall_s, simulated_s, realtime_factor: simulated_s / wall_s.max(1e-9), threads }
    }
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
        Outcome::TooClose => "too-close",
    }
}

/// The contact's name in the report.
#[must_use]
pub fn contact_name(contact: Contact) -> &'static str {
    match contact {
        Contact::Trunk => "trunk",
        Contact::Branch => "branch",
        Contact::Foliage => "foliage",
        Contact::Building => "building",
        Contact::Scan => "scan",
        Contact::Moving => "moving",
        Contact::Ground => "ground",
        Contact::Person => "person",
    }
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
    /// Track: what the target runs.
    pub course: Course,
    /// m/s.
    pub wind_mps: f64,
    /// Moving obstacles in each flight.
    pub moving: usize,
}

impl CellConfig {
    /// World and course in short, as in a file's name: `4m`, `buildings`, `hall.ply`, `4m-zigzag`.
    #[must_use]
    pub fn label(&self) -> String {
        let world = match &self.world {
            WorldSource::Forest { spacing_m } => format!("{spacing_m}m"),
            other => other.name().to_owned(),
        };
        if self.course == Course::Goal { world } else { format!("{world}-{}", self.course.name()) }
    }
}

impl Cell {
    /// The world in short: `4 m`, `buildings`, `hall.ply`; with a course or moving obstacles `4 m, zigzag, 8 moving`.
    #[must_use]
    pub fn place(&self) -> String {
        let world = if self.world == "forest" { format!("{} m", self.spacing_m) } else { self.world.clone() };
        let course = self.course.as_deref().filter(|name| *name != Course::Goal.name());
        let moving = (self.moving > 0).then(|| format!("{} moving", self.moving));
        [Some(world), course.map(str::to_owned), moving].into_iter().flatten().collect::<Vec<_>>().join(", ")
    }

    /// The summary of a cell's flights, in the order of the trials. `cell`: its place in the campaign.
    #[must_use]
    pub fn of(cell: usize, config: &CellConfig, flown: &[Flown]) -> Self {
        let flights = || flown.iter().map(|f| &f.flight);
        let count = |outcome| flights().filter(|f| f.outcome == outcome).count();
        let successes = count(Outcome::Success);
        let mut contacts = BTreeMap::new();
        for contact in flights().filter_map(|f| f.contact) {
            *contacts.entry(contact_name(contact)).or_insert(0) += 1;
        }
        let clearances: Vec<f64> = flights().filter_map(|f| f.metrics.clearance_m).collect();
        let jerks: Vec<f64> = flights().map(|f| f.metrics.jerk_integral).collect();
        let sum = |value: &dyn Fn(&Metrics) -> f64| flights().map(|f| value(&f.metrics)).sum::<f64>();
        let frames = sum(&|m| m.frames as f64).max(1.0);
        let pooled = |part: fn(&Metrics) -> &Vec<f64>| flights().flat_map(|f| part(&f.metrics)).copied().collect();
        let lateral = range(pooled(|m| &m.lateral_m));
        let longitudinal = range(pooled(|m| &m.longitudinal_m));
        let tracks = config.task == Task::Track;
        let [min, p5, p50] = [0.0, 0.05, 0.5].map(|q| quantile(&clearances, q));
        Self {
            cell,
            pilot: pilot_name(config.pilot),
            task: task_name(config.task),
            speed_mps: config.speed_mps,
            spacing_m: config.world.spacing_m(),
            world: config.world.name().to_owned(),
            course: tracks.then(|| config.course.name().to_owned()),
            wind_mps: config.wind_mps,
            moving: config.moving,
            trials: flown.len(),
            successes,
            success_interval: wilson(successes, flown.len()),
            failures: Failures {
                collision: count(Outcome::Collision),
                lost: count(Outcome::Lost),
                timeout: count(Outcome::Timeout),
                too_close: count(Outcome::TooClose),
            },
            contacts,
            clearance_m: Clearance { min, p5, p50 },
            in_view_fraction: tracks.then(|| sum(&|m| m.frames_in_view as f64) / frames),
            target_distance_m: tracks.then(|| Distance {
                mean: sum(&|m| m.distance_sum_m) / frames,
                max: flights().map(|f| f.metrics.distance_max_m).fold(0.0, f64::max),
            }),
            min_distance_to_target_m: Closest::of(flights()),
            target_error_m: lateral
                .zip(longitudinal)
                .map(|(lateral, longitudinal)| TargetError { lateral, longitudinal }),
            jerk_integral: jerks.iter().sum::<f64>() / (flown.len() as f64).max(1.0),
            jerk_integral_quantiles: quantiles(&jerks, [0.05, 0.5, 0.95]).map(|[p5, p50, p95]| Quantiles {
                p5,
                p50,
                p95,
            }),
            flown_speed_mps: Speed {
                mean: sum(&|m| m.way_m) / sum(&|m| m.task_s).max(1e-9),
                max: flights().map(|f| f.metrics.speed_max_mps).fold(0.0, f64::max),
            },
            simulated_s: flights().map(|f| f.flown_s).sum::<f64>(),
            flights: flown.iter().map(|f| FlightRow::of(f, tracks)).collect(),
        }
    }
}

fn range(values: Vec<f64>) -> Option<Range> {
    quantiles(&values, [0.05, 0.95]).map(|[p5, p95]| Range { p5, p95 })
}

impl FlightRow {
    fn of(flown: &Flown, tracks: bool) -> Self {
        let (Pick { trial, .. }, flight) = (flown.pick, &flown.flight);
        let m = &flight.metrics;
        let frames = (tracks && m.frames > 0).then_some(m.frames as f64);
        Self {
            trial,
            outcome: outcome_name(flight.outcome),
            contact: flight.contact.map(contact_name),
            flown_s: flight.flown_s,
            end_pos_m: flight.end_world.into(),
            end_distance_m: flight.end_distance_m,
            unseen_s: flight.unseen_s,
            clearance_m: m.clearance_m,
            in_view_fraction: frames.map(|frames| m.frames_in_view as f64 / frames),
            target_distance_m: frames.map(|frames| Distance { mean: m.distance_sum_m / frames, max: m.distance_max_m }),
            min_distance_to_target_m: m.target_distance_min_m,
            jerk_integral: m.jerk_integral,
            flown_speed_mps: Speed { mean: m.way_m / m.task_s.max(1e-9), max: m.speed_max_mps },
            modes: flight.modes.iter().map(|(at, to, cause)| format!("{at:.2} {to:?}: {cause}")).collect(),
        }
    }
}

impl Report {
    /// As JSON, for people to read too. Each flight's path is one line of it, under `paths`.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        const WRITES: &str = "numbers, strings and lists become JSON";
        let text = serde_json::to_string_pretty(self).expect(WRITES);
        let paths = self.flown.iter().flatten().filter_map(|flown| flown.path.as_ref());
        let lines: Vec<String> = paths.map(|path| serde_json::to_string(path).expect(WRITES)).collect();
        let summary = text.strip_suffix("\n}").unwrap_or(&text);
        format!("{summary},\n  \"paths\": [\n{}\n  ]\n}}\n", lines.join(",\n")).into_bytes()
    }
}
