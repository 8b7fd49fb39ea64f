//! What the pilots' modules cost in a campaign.

use std::collections::BTreeMap;

use goshawk_core::{ControllerOutput, FrameRecord, Plan, Time};
use serde::Serialize;

use super::stats::quantiles;
use crate::sense::rgbd::RgbdImage;
use crate::trial::{Contact, Outcome, Pilot, Spent, Truth, Witness};
use crate::world::World;

/// Keeps what each plan cost and passes everything on to another witness.
pub struct Clerk<'a> {
    inner: &'a mut dyn Witness,
    spent: Vec<Spent>,
}

impl<'a> Clerk<'a> {
    /// Nothing is spent yet.
    pub fn new(inner: &'a mut dyn Witness) -> Self {
        Self { inner, spent: Vec::new() }
    }

    /// Of each plan of the flight.
    #[must_use]
    pub fn finish(self) -> Vec<Spent> {
        self.spent
    }
}

impl Witness for Clerk<'_> {
    fn world(&mut self, world: &World) {
        self.inner.world(world);
    }

    fn control(&mut self, now: Time, output: &ControllerOutput, onboard: &dyn Pilot) {
        self.inner.control(now, output, onboard);
    }

    fn frame(&mut self, seq: u64, stamp: Time, image: &RgbdImage) {
        self.inner.frame(seq, stamp, image);
    }

    fn plan(&mut self, ready: Time, plan: &Plan, record: Option<&FrameRecord>) {
        self.inner.plan(ready, plan, record);
    }

    fn spent(&mut self, spent: &Spent) {
        self.spent.push(*spent);
        self.inner.spent(spent);
    }

    fn truth(&mut self, now: Time, truth: &Truth<'_>) {
        self.inner.truth(now, truth);
    }

    fn verdict(&mut self, now: Time, outcome: Outcome, contact: Option<Contact>) {
        self.inner.verdict(now, outcome, contact);
    }
}

/// A pilot's cost of a frame: processor time of one thread of this machine, ms.
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub struct Compute {
    pub pilot: &'static str,
    pub plans: usize,
    pub perception_ms: Cost,
    pub mapping_ms: Cost,
    pub planning_ms: Cost,
    pub control_ms: Cost,
    /// All four together.
    pub total_ms: Cost,
}

#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub struct Cost {
    pub mean: f64,
    pub p50: f64,
    pub p99: f64,
}

impl Cost {
    fn of(spent: &[Spent], read: fn(&Spent) -> f64) -> Self {
        let ms: Vec<f64> = spent.iter().map(|spent| 1e3 * read(spent)).collect();
        let [p50, p99] = quantiles(&ms, [0.5, 0.99]).unwrap_or_default();
        Self { mean: ms.iter().sum::<f64>() / (ms.len() as f64).max(1.0), p50, p99 }
    }
}

impl Compute {
    /// For each pilot that planned at all.
    #[must_use]
    pub fn of(spent: &BTreeMap<&'static str, Vec<Spent>>) -> Vec<Self> {
        let one = |(&pilot, spent): (&&'static str, &Vec<Spent>)| Self {
            pilot,
            plans: spent.len(),
            perception_ms: Cost::of(spent, |s| s.perception_s),
            mapping_ms: Cost::of(spent, |s| s.mapping_s),
            planning_ms: Cost::of(spent, |s| s.planning_s),
            control_ms: Cost::of(spent, |s| s.control_s),
            total_ms: Cost::of(spent, Spent::total_s),
        };
        spent.iter().filter(|(_, spent)| !spent.is_empty()).map(one).collect()
    }
}
