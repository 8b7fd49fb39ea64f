//! The flights that are shown one by one: what failed, and a few that did not.

use rayon::prelude::*;

use super::super::report::{FlightRow, Report};
use super::super::{Flown, Pick, pick};
use super::cells::Pool;
use super::map;
use super::svg::Svg;
use crate::trial::{Outcome, TrialError};

/// So many failures are shown at most, the first of each cell before the second of any.
const FAILURES: usize = 24;
/// And so many successes, in all and of each cell.
const SUCCESSES: usize = 16;
const SUCCESSES_OF_CELL: usize = 2;

/// One flight on the page.
pub(super) struct Shown<'a> {
    /// Its file's name, without `.svg`.
    pub(super) name: String,
    pub(super) svg: Svg,
    pub(super) row: &'a FlightRow,
    /// Flies it again.
    pub(super) command: String,
}

/// All of them, in the order of the campaign, failures first.
pub(super) struct Flights<'a> {
    pub(super) shown: Vec<Shown<'a>>,
    /// How many of `shown` failed.
    pub(super) failed: usize,
    /// Failures for which there was no room.
    pub(super) more: Vec<Pick>,
}

/// Chooses and draws.
pub(super) fn flights<'a>(report: &'a Report, pools: &[Pool<'a>], command: &str) -> Result<Flights<'a>, TrialError> {
    let (failed, more) = first(pools, usize::MAX, FAILURES, |f| f.flight.outcome != Outcome::Success);
    let (succeeded, _) = first(pools, SUCCESSES_OF_CELL, SUCCESSES, |f| f.flight.outcome == Outcome::Success);
    let chosen: Vec<(usize, usize)> = failed.iter().chain(&succeeded).copied().collect();
    let speeds = chosen.iter().filter_map(|&(c, f)| pools[c].flown[f].trace.as_ref());
    let fastest = speeds.flat_map(|t| &t.samples).map(|s| f64::from(s.speed_mps)).fold(0.0, f64::max);
    let shown = chosen
        .par_iter()
        .map(|&(cell, index)| {
            let flown = &pools[cell].flown[index];
            Ok(Shown {
                name: format!("flight-{}-{}", flown.pick.cell, flown.pick.trial),
                svg: map::map(flown, &pools[cell].label(), fastest)?,
                row: &report.cells[cell].flights[index],
                command: pick::again(command, flown.pick),
            })
        })
        .collect::<Result<_, TrialError>>()?;
    let more = more.into_iter().map(|(cell, index)| pools[cell].flown[index].pick).collect();
    Ok(Flights { shown, failed: failed.len(), more })
}

/// Up to `room` flights of a kind, no more than `of_cell` of each cell, and those for which there was no room; as
/// places in `pools` and in the cell.
type Places = Vec<(usize, usize)>;
fn first(pools: &[Pool<'_>], of_cell: usize, room: usize, kind: impl Fn(&Flown) -> bool) -> (Places, Places) {
    let mut ranked: Vec<(usize, usize, usize)> = Vec::new();
    for (cell, pool) in pools.iter().enumerate() {
        let of_kind = pool.flown.iter().enumerate().filter(|(_, flown)| kind(flown)).take(of_cell);
        ranked.extend(of_kind.enumerate().map(|(rank, (index, _))| (rank, cell, index)));
    }
    ranked.sort_unstable();
    let mut chosen: Places = ranked.iter().map(|&(_, cell, index)| (cell, index)).collect();
    let mut more = chosen.split_off(room.min(chosen.len()));
    chosen.sort_unstable();
    more.sort_unstable();
    (chosen, more)
}
