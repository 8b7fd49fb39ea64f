//! What a campaign found: the JSON that other people's tools read, made of the flights of each cell.

pub mod compute;
pub mod names;
pub mod stats;
pub mod table;

use std::collections::BTreeMap;
use std::time::Duration;

use goshawk_core::Task;
use serde::Serialize;

use super::{Flown, Pick};
use crate::actors::evader::Course;
use crate::seeds::{Identity, Seeds};
use crate::trial::{EvaderKind, Flight, Metrics, Outcome, PilotKind, WorldSource};
use compute::Compute;
pub use names::{contact_name, evader_name, outcome_name, pilot_name, task_name};
use stats::{quantile, quantiles, wilson};

/// The whole of it. Everything but `timing` is the same for the same seed, vehicle file and policy.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The campaign's seed.
    pub seed: u64,
    /// What it is for.
    pub seeds: Seeds,
    /// Vehicle's name in its file.
    pub vehicle: String,
    /// What was flown, as SHA-256.
    #[serde(flatten)]
    pub identity: Identity,
    /// What a success is.
    pub rule: String,
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
    /// What was asked for.
    pub speed_mps: f64,
    /// What was flown between the ends of the course; none: no flight came so far.
    pub cruise_speed_mps: Option<f64>,
    /// The highest of all flights.
    pub peak_speed_mps: f64,
    pub spacing_m: f64,
    pub world: String,
    /// Who ran, and what; none in navigation.
    pub evader: Option<&'static str>,
    /// See `evader`.
    pub course: Option<String>,
    pub length_m: f64,
    pub wind_mps: f64,
    /// Moving obstacles in each flight.
    pub moving: usize,
    pub trials: usize,
    pub successes: usize,
    /// 95 % interval of the success rate (Wilson).
    pub success_interval: [f64; 2],
    /// Successes by the lax rule.
    pub reached: usize,
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
    /// Navigate: from the take-off's end to the goal, in the flights that reached it.
    pub time_to_goal_s: Option<Quantiles>,
    /// Track: where the target was, in all frames that show it.
    pub target_plane: Option<Plane>,
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
    pub too_close: usize,
    pub behind: usize,
    pub out_of_view: usize,
    pub slow: usize,
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

/// How often something was in each square of the ground about the vehicle, by its heading.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Plane {
    /// A row for each half metre forward, the nearest first; in it a count for each half metre from left to right. What
    /// is farther off counts as at the border.
    pub rows: Vec<String>,
}

impl Plane {
    /// Edge of a square, m; this many squares forward, and to both sides together.
    const SQUARE_M: f64 = 0.5;
    const FORWARD: usize = 24;
    const ACROSS: usize = 24;

    /// Of places forward and left of the vehicle, m.
    #[must_use]
    pub fn of(places: impl Iterator<Item = [f64; 2]>) -> Self {
        let mut counts = [[0u32; Self::ACROSS]; Self::FORWARD];
        let index = |m: f64, most: usize| ((m / Self::SQUARE_M).floor().max(0.0) as usize).min(most - 1);
        for [forward, left] in places {
            let across = 0.5 * Self::ACROSS as f64 * Self::SQUARE_M - left;
            counts[index(forward, Self::FORWARD)][index(across, Self::ACROSS)] += 1;
        }
        let row = |row: &[u32; Self::ACROSS]| row.map(|count| count.to_string()).join(" ");
        Self { rows: counts.iter().map(row).collect() }
    }
}

/// One flight in short.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)]
pub struct FlightRow {
    pub trial: usize,
    pub outcome: &'static str,
    /// A success by the lax rule.
    pub reached: bool,
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
    /// How long the task was flown.
    pub task_s: f64,
    pub flown_speed_mps: Speed,
    pub cruise_speed_mps: Option<f64>,
    /// The longest stretch too far from the target, s; none in navigation.
    pub far_s: Option<f64>,
    /// "12.3 Search: the target has not been seen for too long", one for each change of mode.
    pub modes: Vec<String>,
}

#[derive(Clone, Debug, Default, Serialize)]
#[allow(missing_docs)]
pub struct Timing {
    pub wall_s: f64,
    pub simulated_s: f64,
    /// Simulated over wall time, all threads together.
    pub realtime_factor: f64,
    pub threads: usize,
    /// What the pilots' modules cost, one for each pilot.
    pub compute: Vec<Compute>,
}

impl Timing {
    pub(super) fn of(wall: Duration, flown: &[Flown], threads: usize, compute: Vec<Compute>) -> Self {
        let (wall_s, simulated_s) = (wall.as_secs_f64(), flown.iter().map(|f| f.flight.flown_s).sum::<f64>());
        Self { wall_s, simulated_s, realtime_factor: simulated_s / wall_s.max(1e-9), threads, compute }
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
    /// Track: who runs.
    pub evader: EvaderKind,
    /// Track: what a planned evader runs.
    pub course: Course,
    /// How far ahead the goal is; a reactive evader's whole way, m.
    pub length_m: f64,
    /// m/s.
    pub wind_mps: f64,
    /// Moving obstacles in each flight.
    pub moving: usize,
}

impl CellConfig {
    /// What the logs of its flights are called, but for their numbers.
    pub(super) fn file_name(&self) -> String {
        format!("{}-{}mps-{}", task_name(self.task), self.speed_mps, self.label())
    }

    /// World, course and pilot in short, as in a file's name: `4m`, `buildings`, `hall.ply`, `4m-zigzag-classical`.
    #[must_use]
    pub fn label(&self) -> String {
        let world = match &self.world {
            WorldSource::Forest { spacing_m } => format!("{spacing_m}m"),
            other => other.name().to_owned(),
        };
        let course = (self.course != Course::Goal).then(|| self.course.name());
        let pilot = (self.pilot != PilotKind::Policy).then(|| pilot_name(self.pilot));
        [Some(world.as_str()), course, pilot].into_iter().flatten().collect::<Vec<_>>().join("-")
    }
}

impl Cell {
    /// The world in short: `4 m`, `buildings`, `hall.ply`; with what else is not usual `4 m, zigzag, 8 moving`.
    #[must_use]
    pub fn place(&self) -> String {
        let world = if self.world == "forest" { format!("{} m", self.spacing_m) } else { self.world.clone() };
        let course = self.course.as_deref().filter(|name| *name != Course::Goal.name());
        let evader = self.evader.filter(|name| *name != evader_name(EvaderKind::Planned));
        let moving = (self.moving > 0).then(|| format!("{} moving", self.moving));
        let parts = [Some(world), course.map(str::to_owned), evader.map(str::to_owned), moving];
        parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
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
            cruise_speed_mps: {
                let time_s = sum(&|m| m.cruise_s);
                (time_s > 0.0).then(|| sum(&|m| m.cruise_way_m) / time_s)
            },
            peak_speed_mps: flights().map(|f| f.metrics.speed_max_mps).fold(0.0, f64::max),
            spacing_m: config.world.spacing_m(),
            world: config.world.name().to_owned(),
            evader: tracks.then(|| evader_name(config.evader)),
            course: tracks.then(|| config.course.name().to_owned()),
            length_m: config.length_m,
            wind_mps: config.wind_mps,
            moving: config.moving,
            trials: flown.len(),
            successes,
            success_interval: wilson(successes, flown.len()),
            reached: flights().filter(|f| f.reached).count(),
            failures: Failures {
                collision: count(Outcome::Collision),
                lost: count(Outcome::Lost),
                timeout: count(Outcome::Timeout),
                too_close: count(Outcome::TooClose),
                behind: count(Outcome::Behind),
                out_of_view: count(Outcome::OutOfView),
                slow: count(Outcome::Slow),
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
            time_to_goal_s: {
                let reached = flights().filter(|f| !tracks && f.reached);
                let times: Vec<f64> = reached.map(|f| f.metrics.task_s).collect();
                quantiles(&times, [0.05, 0.5, 0.95]).map(|[p5, p50, p95]| Quantiles { p5, p50, p95 })
            },
            target_plane: tracks.then(|| Plane::of(flights().flat_map(|f| f.metrics.target_plane_m.iter().copied()))),
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
    /// Of a flight in a chase, or in a navigation.
    #[must_use]
    pub fn of(flown: &Flown, tracks: bool) -> Self {
        let (Pick { trial, .. }, flight) = (flown.pick, &flown.flight);
        let m = &flight.metrics;
        let frames = (tracks && m.frames > 0).then_some(m.frames as f64);
        Self {
            trial,
            outcome: outcome_name(flight.outcome),
            reached: flight.reached,
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
            task_s: m.task_s,
            flown_speed_mps: Speed { mean: m.way_m / m.task_s.max(1e-9), max: m.speed_max_mps },
            cruise_speed_mps: m.cruise_mps(),
            far_s: tracks.then_some(m.far_s),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_counts_forward_from_the_vehicle_and_from_left_to_right_and_the_far_at_its_border() {
        let plane = Plane::of([[0.2, 0.1], [0.2, 0.1], [4.6, -1.2], [99.0, 99.0], [-3.0, -99.0]].into_iter());
        let at = |row: usize, column: usize| plane.rows[row].split(' ').nth(column).unwrap().parse::<u32>().unwrap();
        assert_eq!([at(0, 11), at(9, 14), at(23, 0), at(0, 23)], [2, 1, 1, 1]);
        let all: u32 = plane.rows.iter().flat_map(|row| row.split(' ')).map(|n| n.parse::<u32>().unwrap()).sum();
        assert_eq!(all, 5);
    }
}
