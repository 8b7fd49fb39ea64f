//! The on-board clock: CLOCK_MONOTONIC in integer nanoseconds, the same for every process of this host.

use goshawk_core::Time;
use rustix::thread::{NanosleepRelativeResult, nanosleep};
use rustix::time::{ClockId, Timespec, clock_gettime};

/// Now.
#[must_use]
pub fn now() -> Time {
    let t = clock_gettime(ClockId::Monotonic);
    Time(t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64)
}

/// Sleeps until `deadline`; returns at once if it has passed.
pub fn sleep_until(deadline: Time) {
    loop {
        let left = deadline.0.saturating_sub(now().0);
        if left == 0 {
            return;
        }
        let request = Timespec { tv_sec: (left / 1_000_000_000) as i64, tv_nsec: (left % 1_000_000_000) as _ };
        if matches!(nanosleep(&request), NanosleepRelativeResult::Ok) {
            return;
        }
    }
}
