//! ROS stamps are of the system's clock, the vehicle's of the monotonic one. The offset is measured for every sample, so
//! that a clock that is being set carries over at once.

use rustix::time::{ClockId, clock_gettime};

use crate::wire::messages::Stamp;

/// A sample may be older than now by this, ns: the vehicle refuses older ones.
const MOST_AGE_NS: i64 = 1_000_000_000;
/// It may be ahead of now by this, ns: two clocks that are kept together, and jitter.
const MOST_AHEAD_NS: i64 = 50_000_000;

/// A stamp that cannot be of now.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "its stamp is {age_s:.2} s old by this computer's clock: let chrony or PTP set both clocks, and no node use_sim_time"
)]
pub struct StampError {
    /// s; below zero: of the future.
    pub age_s: f64,
}

/// Both clocks at one instant, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clocks {
    /// Since this computer's start.
    pub monotonic: i64,
    /// Since 1970.
    pub system: i64,
}

impl Clocks {
    /// Now.
    #[must_use]
    pub fn now() -> Self {
        let read = |id| {
            let t = clock_gettime(id);
            t.tv_sec * 1_000_000_000 + t.tv_nsec
        };
        Clocks { monotonic: read(ClockId::Monotonic), system: read(ClockId::Realtime) }
    }

    /// A ROS stamp on the monotonic clock, ns.
    ///
    /// # Errors
    /// It is not of now, give or take.
    pub fn monotonic(&self, stamp: Stamp) -> Result<u64, StampError> {
        let age = self.system - (i64::from(stamp.sec) * 1_000_000_000 + i64::from(stamp.nanosec));
        if !(-MOST_AHEAD_NS..MOST_AGE_NS).contains(&age) {
            return Err(StampError { age_s: age as f64 * 1e-9 });
        }
        u64::try_from(self.monotonic - age).map_err(|_| StampError { age_s: age as f64 * 1e-9 })
    }

    /// A monotonic stamp as ROS has it.
    #[must_use]
    pub fn ros(&self, monotonic_ns: u64) -> Stamp {
        let ns = monotonic_ns as i64 - self.monotonic + self.system;
        Stamp { sec: (ns.div_euclid(1_000_000_000)) as i32, nanosec: ns.rem_euclid(1_000_000_000) as u32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Clocks = Clocks { monotonic: 5_000_000_000, system: 1_700_000_000_250_000_000 };

    #[test]
    fn a_stamp_goes_to_the_other_clock_and_back() {
        let stamp = Stamp { sec: 1_700_000_000, nanosec: 150_000_000 };
        assert_eq!(NOW.monotonic(stamp), Ok(4_900_000_000));
        assert_eq!(NOW.ros(4_900_000_000), stamp);
        assert_eq!(NOW.ros(4_700_000_000), Stamp { sec: 1_699_999_999, nanosec: 950_000_000 });
    }

    #[test]
    fn a_stamp_of_another_clock_is_refused_by_its_age() {
        for (sec, age_s) in [(1_699_999_990, 10.25), (1_700_000_001, -0.75), (0, 1_700_000_000.25)] {
            assert_eq!(NOW.monotonic(Stamp { sec, nanosec: 0 }), Err(StampError { age_s }));
        }
    }

    #[test]
    fn the_two_clocks_are_read_at_one_instant() {
        let (a, b) = (Clocks::now(), Clocks::now());
        assert!(b.monotonic >= a.monotonic && b.system > 1_700_000_000_000_000_000);
    }
}
