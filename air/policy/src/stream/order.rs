//! The order in which pictures come: how many, from how many sources, in whose count.

use std::collections::VecDeque;

use super::{Arrival, RateLimits};

/// Pictures are counted over this time before the newest, s. Chosen by eye.
const WINDOW_S: f64 = 0.5;
/// No more arrivals than this are remembered.
const MOST: usize = 128;
/// One camera that is started again goes back once; two that alternate do it all the time. Chosen by eye.
const TURNS: usize = 3;
/// Gaps between pictures that are looked at: their median does not heed a single late one. Chosen by eye.
const GAPS: usize = 5;

/// What the order says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Verdict {
    pub(super) two: bool,
    pub(super) slow: bool,
}

/// The last arrivals.
#[derive(Clone, Debug)]
pub(super) struct Order {
    limits: RateLimits,
    arrivals: VecDeque<Arrival>,
}

impl Order {
    pub(super) fn new(limits: RateLimits) -> Self {
        Self { limits, arrivals: VecDeque::with_capacity(MOST) }
    }

    pub(super) fn take(&mut self, arrival: &Arrival) -> Verdict {
        if self.arrivals.len() == MOST {
            self.arrivals.pop_front();
        }
        self.arrivals.push_back(*arrival);
        Verdict { two: self.too_many() || self.alternate(), slow: self.too_few() }
    }

    /// Those of the last half second, the oldest first.
    fn recent(&self) -> impl Iterator<Item = &Arrival> + Clone {
        let newest = self.arrivals.iter().map(|a| a.stamp).max();
        self.arrivals.iter().filter(move |a| newest.is_some_and(|newest| newest.since(a.stamp) < WINDOW_S))
    }

    fn too_many(&self) -> bool {
        self.recent().count() as f64 > self.limits.most_hz * WINDOW_S + 1.0
    }

    /// Two counts, two clocks or two publishers take turns.
    fn alternate(&self) -> bool {
        let pairs = || self.recent().zip(self.recent().skip(1));
        let back = pairs().filter(|(a, b)| b.seq <= a.seq || b.stamp <= a.stamp).count();
        let other = pairs().filter(|(a, b)| a.source != b.source).count();
        back >= TURNS || other >= TURNS
    }

    fn too_few(&self) -> bool {
        let newest = self.arrivals.iter().rev().take(GAPS + 1);
        let mut gaps = [0.0; GAPS];
        let mut count = 0;
        for (later, earlier) in newest.clone().zip(newest.skip(1)) {
            gaps[count] = later.stamp.since(earlier.stamp);
            count += 1;
        }
        gaps.sort_by(f64::total_cmp);
        count == GAPS && gaps[GAPS / 2] > 1.0 / self.limits.least_hz
    }
}
