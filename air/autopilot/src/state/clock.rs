//! The autopilot's clock in ours: TIMESYNC round trips, and until there are any, the fastest arrival.

use goshawk_core::Time;

/// Round trips remembered: 3.2 s at 10 Hz.
const TRIPS: usize = 32;
/// How fast the clocks may drift apart. Quartz does 0.00005; PX4's own simulator, recorded, 0.018.
const DRIFT: f64 = 0.02;
/// Requests in flight that an answer may belong to.
const REQUESTS: usize = 16;
/// A round trip slower than this says nothing. Chosen by eye.
const SLOWEST_TRIP_NS: u64 = 1_000_000_000;
/// The remote clock going back by more than this means that the autopilot started again. Chosen by eye.
const RESTART_NS: u64 = 1_000_000_000;

#[derive(Clone, Copy, Debug)]
struct Trip {
    answered: Time,
    duration_ns: u64,
    offset_ns: i64,
}

impl Trip {
    /// How wrong its offset may be at `now`, ns: half the trip, and the drift since.
    fn uncertainty_ns(&self, now: Time) -> u64 {
        self.duration_ns / 2 + (now.0.saturating_sub(self.answered.0) as f64 * DRIFT) as u64
    }
}

/// Maps the autopilot's stamps (ns since its boot) to ours.
#[derive(Clone, Debug, Default)]
pub struct ClockMap {
    trips: [Option<Trip>; TRIPS],
    next_trip: usize,
    asked: [Option<Time>; REQUESTS],
    next_asked: usize,
    /// Smallest (ours at arrival − theirs) seen and when it was noted; it fades as fast as clocks may drift.
    fastest_arrival: Option<(Time, i64)>,
    newest_remote_ns: u64,
}

impl ClockMap {
    /// Notes that a TIMESYNC request stamped `now` was sent.
    pub fn asked(&mut self, now: Time) {
        self.asked[self.next_asked] = Some(now);
        self.next_asked = (self.next_asked + 1) % REQUESTS;
    }

    /// Takes an answer: `asked` echoes our request's stamp, `remote_ns` is theirs. False: not an answer to us.
    pub fn answered(&mut self, now: Time, asked: Time, remote_ns: u64) -> bool {
        let Some(slot) = self.asked.iter_mut().find(|slot| **slot == Some(asked)) else {
            return false;
        };
        *slot = None;
        let duration_ns = now.0.saturating_sub(asked.0);
        if duration_ns > SLOWEST_TRIP_NS {
            return true;
        }
        self.note_remote(remote_ns);
        let middle = asked.0 + duration_ns / 2;
        self.trips[self.next_trip] =
            Some(Trip { answered: now, duration_ns, offset_ns: difference(middle, remote_ns) });
        self.next_trip = (self.next_trip + 1) % TRIPS;
        true
    }

    /// Our time of the autopilot's stamp of a message that arrived `now`; never later than `now`.
    pub fn local(&mut self, remote_ns: u64, now: Time) -> Time {
        self.note_remote(remote_ns);
        let arrival = difference(now.0, remote_ns);
        let fastest = self.fastest_arrival.map_or(arrival, |(noted, fastest)| {
            let faded = (now.0.saturating_sub(noted.0) as f64 * DRIFT) as i64;
            fastest.saturating_add(faded).min(arrival)
        });
        self.fastest_arrival = Some((now, fastest));
        let offset = self.best(now).map_or(fastest, |trip| trip.offset_ns);
        Time(remote_ns.saturating_add_signed(offset)).min(now)
    }

    /// Round trip of the answer that counts at `now`, s; none: not synchronised, stamps are from arrivals.
    #[must_use]
    pub fn round_trip(&self, now: Time) -> Option<f64> {
        self.best(now).map(|trip| trip.duration_ns as f64 * 1e-9)
    }

    fn best(&self, now: Time) -> Option<&Trip> {
        self.trips.iter().flatten().min_by_key(|trip| trip.uncertainty_ns(now))
    }

    fn note_remote(&mut self, remote_ns: u64) {
        if remote_ns.saturating_add(RESTART_NS) < self.newest_remote_ns {
            *self = Self { asked: self.asked, next_asked: self.next_asked, ..Self::default() };
        }
        self.newest_remote_ns = self.newest_remote_ns.max(remote_ns);
    }
}

/// `ours - theirs`, saturating.
fn difference(ours: u64, theirs: u64) -> i64 {
    i64::try_from(i128::from(ours) - i128::from(theirs)).unwrap_or(if ours > theirs { i64::MAX } else { i64::MIN })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn until_synchronised_the_fastest_arrival_counts() {
        let mut clock = ClockMap::default();
        assert_eq!(clock.local(1_000 * MS, Time(5_008 * MS)), Time(5_008 * MS));
        assert_eq!(clock.local(1_010 * MS, Time(5_012 * MS)), Time(5_012 * MS)); // 2 ms instead of 8
        let slow = clock.local(1_020 * MS, Time(5_060 * MS)).since(Time(5_022 * MS));
        assert!((0.0..0.002).contains(&slow), "a slow one is not believed: {slow}");
    }

    #[test]
    fn the_shortest_round_trip_wins() {
        let mut clock = ClockMap::default();
        let theirs = |ours: u64| ours - 4_000 * MS;
        for (sent, there, back) in [(5_000, 30, 50), (5_100, 1, 2), (5_200, 10, 70)] {
            clock.asked(Time(sent * MS));
            assert!(clock.answered(Time((sent + back) * MS), Time(sent * MS), theirs((sent + there) * MS)));
        }
        assert_eq!(clock.round_trip(Time(5_300 * MS)), Some(0.002));
        assert_eq!(clock.local(theirs(5_300 * MS), Time(5_340 * MS)), Time(5_300 * MS));
    }

    #[test]
    fn a_clock_that_runs_two_percent_slow_is_followed() {
        for synchronised in [false, true] {
            let mut clock = ClockMap::default();
            for tenth in 0..600_u64 {
                let ours = 1_000_000 * MS + tenth * 100 * MS;
                let theirs = |ours: u64| (ours - 1_000_000 * MS) / 100 * 98;
                if synchronised {
                    clock.asked(Time(ours));
                    assert!(clock.answered(Time(ours + MS), Time(ours), theirs(ours + MS / 2)));
                }
                let error = clock.local(theirs(ours + 50 * MS), Time(ours + 53 * MS)).since(Time(ours + 50 * MS));
                assert!(error.abs() < 0.004, "synchronised {synchronised}: {error} s at {tenth}");
            }
        }
    }

    #[test]
    fn an_answer_to_someone_else_is_ignored() {
        let mut clock = ClockMap::default();
        clock.asked(Time(5));
        assert!(!clock.answered(Time(9), Time(6), 1));
        assert!(clock.answered(Time(9), Time(5), 1));
        assert!(!clock.answered(Time(9), Time(5), 1), "an answer counts once");
    }

    #[test]
    fn a_restarted_autopilot_is_mapped_anew() {
        let mut clock = ClockMap::default();
        clock.asked(Time(100_000 * MS));
        clock.answered(Time(100_000 * MS), Time(100_000 * MS), 90_000 * MS);
        assert_eq!(clock.local(90_001 * MS, Time(100_001 * MS)), Time(100_001 * MS));
        assert_eq!(clock.local(2_000 * MS, Time(101_000 * MS)), Time(101_000 * MS));
        let next = clock.local(2_010 * MS, Time(101_012 * MS)).since(Time(101_010 * MS));
        assert!((0.0..0.001).contains(&next), "{next}");
    }

    #[test]
    fn no_stamp_lies_in_the_future() {
        let mut clock = ClockMap::default();
        clock.local(1_000, Time(2_000));
        clock.asked(Time(2_000));
        clock.answered(Time(3_000), Time(2_000), 500);
        assert_eq!(clock.local(u64::MAX, Time(4_000)), Time(4_000));
    }
}
