//! What was chosen in the flight, and what is chosen otherwise.

use goshawk_core::Plan;
use serde::Serialize;

/// How often something else was chosen than in the flight, and how far apart the ways end.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// Frames that both answered.
    pub frames: u64,
    /// Both chose the same trajectory, or both none.
    pub same: u64,
    /// Only one of the two chose.
    pub one_chose: u64,
    /// Distance between the ends of the two chosen trajectories, m; none: never did both choose.
    pub end_distance_m: Option<Quantiles>,
}

/// Of a distribution.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Quantiles {
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
}

/// Counts them.
#[derive(Default)]
pub(super) struct Choices {
    frames: u64,
    same: u64,
    one_chose: u64,
    distances_m: Vec<f64>,
}

impl Choices {
    pub(super) fn count(&mut self, flown: &Plan, other: &Plan) {
        self.frames += 1;
        self.same += u64::from(flown.chosen == other.chosen);
        match (flown.chosen, other.chosen) {
            (Some(a), Some(b)) => {
                self.distances_m.push((flown.candidates[a].end.pos - other.candidates[b].end.pos).norm());
            }
            (None, None) => {}
            _ => self.one_chose += 1,
        }
    }

    pub(super) fn agreement(mut self) -> Agreement {
        self.distances_m.sort_by(f64::total_cmp);
        let held = self.distances_m.len();
        let at = |q: f64| self.distances_m[((held - 1) as f64 * q).round() as usize];
        let end_distance_m = (held > 0).then(|| Quantiles { p50: at(0.5), p95: at(0.95) });
        let Choices { frames, same, one_chose, .. } = self;
        Agreement { frames, same, one_chose, end_distance_m }
    }
}
