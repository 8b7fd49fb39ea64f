//! Reads a chaos flight's logs back, whole or cut off anywhere, and replays them.

use std::path::Path;

use goshawk_core::Time;
use goshawk_recorder::LogReader;
use goshawk_replay::{Options, Outcome, Recording, replay_recording};

use super::properties::{Property, Violation};
use super::recorder::{Flush, Written};

/// What may be lost of a log at its end, s.
const LAST_SECOND_S: f64 = 1.0;

/// Examines `log` of which the disk has the first `kept` bytes; `stalled`: its disk took nothing for a while, at some time.
pub(crate) fn examine(log: &Written, kept: usize, stalled: bool) -> Result<(), Violation> {
    let whole = kept == log.bytes.len();
    let safe = log.flushes.iter().rev().find(|flush| flush.bytes <= kept);
    let safe = if log.closed && whole { Some(&log.total) } else { safe };
    let fails = |property, text: String| Violation::new(property, log.ended, text);
    if whole && log.lost.is_none() && !stalled {
        let reached = if log.closed { log.ended } else { safe.map_or(log.begun, |flush| flush.at) };
        let behind = log.ended.since(reached);
        if behind > LAST_SECOND_S {
            return Err(fails(Property::LogReadable, format!("its last {behind:.2} s are not on the disk")));
        }
    }
    let Some(safe) = safe.filter(|safe| safe.steps > 0) else { return Ok(()) };
    let read = LogReader::of_bytes(Path::new("the flight's log"), log.bytes[..kept].to_vec());
    let read = read.map_err(|e| fails(Property::LogReadable, e.to_string()))?;
    readable(log, &read, safe, whole).map_err(|text| fails(Property::LogReadable, text))?;
    let recording = Recording::of_log(read).map_err(|e| fails(Property::LogReadable, format!("{e:#}")))?;
    let outcome = replay_recording(&recording, &Options::default());
    let outcome = outcome.map_err(|e| fails(Property::ReplayExact, format!("{e:#}")))?;
    exact(log, &outcome).map_err(|text| fails(Property::ReplayExact, text))
}

fn readable(log: &Written, read: &LogReader, safe: &Flush, whole: bool) -> Result<(), String> {
    let records = read.entries().count() as u64;
    if records < safe.records {
        return Err(format!("{} records were safe on the disk, {records} can be read", safe.records));
    }
    if let Some(damage) = read.damage().first() {
        return Err(format!("it was cut off, and counts as damaged at byte {}", damage.bytes.start));
    }
    if read.is_closed() != (log.closed && whole) {
        return Err(format!("it is {}closed, and read as if it were not so", if log.closed { "" } else { "not " }));
    }
    Ok(())
}

fn exact(log: &Written, outcome: &Outcome) -> Result<(), String> {
    let differs = outcome.first_difference.as_ref();
    if let Some(found) = differs.filter(|found| log.lost.is_none_or(|lost| Time(found.stamp_ns) < lost)) {
        let (what, field, logged, replayed) = (&found.what, &found.field, &found.logged, &found.replayed);
        return Err(format!("{what}: {field} was {logged}, and is {replayed} in the replay"));
    }
    match outcome.missing.first().filter(|_| log.lost.is_none()) {
        Some(missing) => Err(format!("the log lacks {missing}")),
        None => Ok(()),
    }
}
