//! Whole records of flights, one a line: what machines that fly the parts of one campaign hand over, so that the cells of
//! all of it are made in one place. Numbers are read back to the last bit.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use goshawk_core::Task;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};
use thiserror::Error;

use super::report::names::{evader_name, pilot_name, task_name};
use super::report::{CellConfig, FlightRow, Report};
use super::{Campaign, Pick};
use crate::seeds::Identity;
use crate::trial::Flight;

const WRITES: &str = "numbers, strings and lists become JSON";

/// Which flight of which campaign a record is of.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)] // as in the report
pub(super) struct Head<'a> {
    pub(super) cell: usize,
    pub(super) trial: usize,
    /// Of the flight.
    pub(super) seed: u64,
    pub(super) pilot: &'static str,
    pub(super) task: &'static str,
    pub(super) speed_mps: f64,
    pub(super) spacing_m: f64,
    pub(super) world: &'a str,
    pub(super) evader: Option<&'static str>,
    pub(super) course: Option<&'a str>,
    pub(super) length_m: f64,
    pub(super) wind_mps: f64,
    pub(super) moving: usize,
    /// Of all else that is given: sensors, airframe, height, what goes wrong, a cloud's file, a course's points, the firmware.
    pub(super) conditions_sha256: String,
    #[serde(flatten)]
    pub(super) identity: &'a Identity,
}

#[derive(Serialize)]
struct Line<'a> {
    head: Head<'a>,
    /// What a report says of the flight: for people and tables. Not read back.
    summary: FlightRow,
    flight: &'a Flight,
}

#[derive(Deserialize)]
struct Read {
    head: Value,
    flight: Flight,
}

/// Why flights that were flown before cannot be taken.
#[derive(Debug, Error)]
pub enum RecordsError {
    /// The file.
    #[error("cannot read {0}: {1}")]
    File(PathBuf, std::io::Error),
    /// A line of it.
    #[error("{0}, line {1}: {2}; goshawk-sim fly --records writes such files")]
    Line(PathBuf, usize, String),
    /// A flight was flown with something else.
    #[error("{0}: flight {1} was flown with another {2}: fly it again, or give the options that it was flown with")]
    Other(PathBuf, Pick, String),
    /// A flight is not there.
    #[error("{0}: flight {1} is not there: fly it with --only {1} --records FILE, and add that file")]
    Missing(PathBuf, Pick),
}

/// The flights of a file.
#[derive(Debug)]
pub struct Known {
    path: PathBuf,
    flights: BTreeMap<Pick, (Value, Flight)>,
}

impl Known {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, or a flight stands there twice.
    pub fn read(path: &Path) -> Result<Self, RecordsError> {
        let failed = |error| RecordsError::File(path.to_owned(), error);
        let mut flights = BTreeMap::new();
        for (place, line) in BufReader::new(std::fs::File::open(path).map_err(failed)?).lines().enumerate() {
            let wrong = |why: String| RecordsError::Line(path.to_owned(), place + 1, why);
            let read: Read = serde_json::from_str(&line.map_err(failed)?).map_err(|error| wrong(error.to_string()))?;
            let number = |name: &str| read.head[name].as_u64().map(|number| number as usize);
            let pick = number("cell").zip(number("trial")).map(|(cell, trial)| Pick { cell, trial });
            let pick = pick.ok_or_else(|| wrong("it says no cell and trial".to_owned()))?;
            if flights.insert(pick, (read.head, read.flight)).is_some() {
                return Err(wrong(format!("flight {pick} stands there twice")));
            }
        }
        Ok(Self { path: path.to_owned(), flights })
    }

    /// The flight of that head.
    pub(super) fn take(&mut self, pick: Pick, head: &Head<'_>) -> Result<Flight, RecordsError> {
        let Some((flown, flight)) = self.flights.remove(&pick) else {
            return Err(RecordsError::Missing(self.path.clone(), pick));
        };
        // Written and read, as the other was: what is no number in Rust may be one in JSON.
        let wanted = serde_json::to_value(head).expect(WRITES);
        let names = wanted.as_object().into_iter().flatten();
        match names.map(|(name, value)| (name, value == &flown[name])).find(|(_, same)| !same) {
            Some((name, _)) => Err(RecordsError::Other(self.path.clone(), pick, name.clone())),
            None => Ok(flight),
        }
    }
}

impl Campaign {
    /// `firmware_sha256`: of the firmware that flies, if one does.
    pub(super) fn head<'a>(
        &self,
        identity: &'a Identity,
        cell: &'a CellConfig,
        pick: Pick,
        seed: u64,
        firmware_sha256: Option<&str>,
    ) -> Head<'a> {
        let tracks = cell.task == Task::Track;
        let given = (self.sensors, self.airframe, self.fault, self.speed_margin_mps, self.height_m);
        // What a file's name does not say: its points, its bytes.
        let course = tracks.then_some(&cell.course);
        let conditions = format!("{:?}", (given, cell.world.sha256(), course, firmware_sha256));
        Head {
            cell: pick.cell,
            trial: pick.trial,
            seed,
            pilot: pilot_name(cell.pilot),
            task: task_name(cell.task),
            speed_mps: cell.speed_mps,
            spacing_m: cell.world.spacing_m(),
            world: cell.world.name(),
            evader: tracks.then(|| evader_name(cell.evader)),
            course: tracks.then(|| cell.course.name()),
            length_m: cell.length_m,
            wind_mps: cell.wind_mps,
            moving: cell.moving,
            conditions_sha256: Sha256::digest(conditions).iter().map(|byte| format!("{byte:02x}")).collect(),
            identity,
        }
    }

    /// All flights of the campaign's report, one a line.
    #[must_use]
    pub fn records(&self, report: &Report) -> Vec<u8> {
        let (cells, mut out) = (self.cells(), Vec::new());
        // Firmware that is gone by now fits none: such records are refused later, not taken for another's.
        let firmware = self.firmware.as_ref().map(|firmware| firmware.sha256().unwrap_or_default());
        for flown in report.flown.iter().flatten() {
            let cell = &cells[flown.pick.cell];
            let line = Line {
                head: self.head(&report.identity, cell, flown.pick, flown.config.seed, firmware.as_deref()),
                summary: FlightRow::of(flown, cell.task == Task::Track),
                flight: &flown.flight,
            };
            serde_json::to_writer(&mut out, &line).expect(WRITES);
            out.push(b'\n');
        }
        out
    }
}
