//! What of a schedule acts at an instant, and on what.

pub(crate) mod autopilot;
pub(crate) mod camera;
pub(crate) mod odometry;
pub(crate) mod operator;
pub(crate) mod senses;

use super::schedule::{Fault, Kind};

/// The faults that act now, and those that have just begun.
#[derive(Clone, Debug, Default)]
pub(super) struct Acting {
    now: Vec<Kind>,
    begun: Vec<Kind>,
    /// Which faults have begun before.
    seen: Vec<bool>,
}

impl Acting {
    /// It is `t_s` since the beginning. Each fault begins once, also one that is shorter than a step.
    pub(super) fn advance(&mut self, t_s: f64, faults: &[Fault]) {
        self.seen.resize(faults.len(), false);
        self.now.clear();
        self.begun.clear();
        for (fault, seen) in faults.iter().zip(&mut self.seen) {
            if fault.acts(t_s) {
                self.now.push(fault.what);
            }
            let starts = fault.at_s <= t_s && !*seen;
            *seen |= starts;
            if starts {
                self.begun.push(fault.what);
            }
        }
    }

    /// All that acts.
    pub(super) fn now(&self) -> &[Kind] {
        &self.now
    }

    /// What has begun with this step.
    pub(super) fn begun(&self) -> &[Kind] {
        &self.begun
    }

    /// It acts.
    pub(super) fn any(&self, kind: &Kind) -> bool {
        self.now.contains(kind)
    }

    /// The number of the first that acts and for which `of` has one.
    pub(super) fn number(&self, of: impl Fn(&Kind) -> Option<f64>) -> Option<f64> {
        self.now.iter().find_map(of)
    }
}
