//! What the figures are drawn from: each cell with its flights, and values pooled over them.

use super::super::Flown;
use super::super::report::{Cell, Report};
use super::super::trace::Sample;
use super::svg::n;

/// Characters of a place's name in a figure.
const LABEL_PLACE: usize = 9;

/// A cell and its flights.
#[derive(Clone, Copy)]
pub(super) struct Pool<'a> {
    pub(super) cell: &'a Cell,
    pub(super) flown: &'a [Flown],
}

/// All of a campaign.
pub(super) fn pools(report: &Report) -> Vec<Pool<'_>> {
    report.cells.iter().zip(&report.flown).map(|(cell, flown)| Pool { cell, flown }).collect()
}

impl Pool<'_> {
    /// As in "3 m/s · 5 m"; of a long file name only its beginning, as figures have no room.
    pub(super) fn label(&self) -> String {
        let place = self.cell.place();
        let whole = place.chars().count() <= LABEL_PLACE;
        let short = if whole { place } else { place.chars().take(LABEL_PLACE - 1).chain(['…']).collect() };
        format!("{} m/s · {short}", n(self.cell.speed_mps))
    }

    fn samples(&self) -> impl Iterator<Item = &Sample> {
        self.flown.iter().filter_map(|f| f.trace.as_ref()).flat_map(|trace| &trace.samples)
    }
}

/// To the runner, at each sample, m.
pub(super) fn distances_m(pool: &Pool<'_>) -> Vec<f64> {
    pool.samples().filter_map(Sample::distance_m).collect()
}

/// At each sample, m.
pub(super) fn clearances_m(pool: &Pool<'_>) -> Vec<f64> {
    pool.samples().map(|s| f64::from(s.clearance_m).max(0.0)).collect()
}

/// At each sample, m/s.
pub(super) fn speeds_mps(pool: &Pool<'_>) -> Vec<f64> {
    pool.samples().map(|s| f64::from(s.speed_mps)).collect()
}

/// Where the camera has the runner, px; none where it is behind.
pub(super) fn pixels(pool: &Pool<'_>) -> Vec<Option<[f32; 2]>> {
    pool.samples().filter_map(|s| s.target.map(|target| target.pixel)).collect()
}

/// Of each flight, m; 0 where it touched something.
pub(super) fn closest_m(pool: &Pool<'_>) -> Vec<f64> {
    pool.flown.iter().filter_map(|f| f.flight.metrics.clearance_m).map(|c| c.max(0.0)).collect()
}

/// Of each flight that flew its task, m²/s⁵.
pub(super) fn jerks(pool: &Pool<'_>) -> Vec<f64> {
    pool.flown.iter().map(|f| f.flight.metrics.jerk_integral).filter(|jerk| *jerk > 0.0).collect()
}

/// Of each frame with an estimate, m.
pub(super) fn lateral_m(pool: &Pool<'_>) -> Vec<f64> {
    pool.flown.iter().flat_map(|f| &f.flight.metrics.lateral_m).copied().collect()
}

/// Of each frame with an estimate, m.
pub(super) fn longitudinal_m(pool: &Pool<'_>) -> Vec<f64> {
    pool.flown.iter().flat_map(|f| &f.flight.metrics.longitudinal_m).copied().collect()
}

/// Of each flight that flew its task, %; nothing in navigation.
pub(super) fn in_view_percent(pool: &Pool<'_>) -> Vec<f64> {
    pool.cell.flights.iter().filter_map(|f| f.in_view_fraction).map(|share| 100.0 * share).collect()
}
