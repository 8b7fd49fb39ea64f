//! When a flight is a success, and what it fails by otherwise: the one place of the rule.

use goshawk_core::Task;

use super::Outcome;

/// A navigation ends this near to its goal, m.
pub const GOAL_RADIUS_M: f64 = 2.0;
/// A navigation whose cruise speed is below this share of the asked one is slow.
pub const SLOW_SHARE: f64 = 0.6;
/// At the end of a chase the target is at most this far away, m, and was detected within so many seconds.
pub const END_M: f64 = 10.0;
/// See [`END_M`].
pub const SEEN_WITHIN_S: f64 = 1.0;
/// A chase that is farther away than this, m, for longer than [`FAR_S`] at a stretch has fallen behind.
pub const FAR_M: f64 = 12.0;
/// See [`FAR_M`].
pub const FAR_S: f64 = 2.0;
/// The least share of the frames that shows the target.
pub const IN_VIEW: f64 = 0.9;
/// Centre to centre, a vehicle that is nearer to the target than this was too close, m: within two strides of an evader,
/// and a quarter below the least distance that the vehicle file asks for.
pub const TOO_CLOSE_M: f64 = 1.5;
/// Cruise speed is measured between so far after a course's start and so far before its end, m.
const ENDS_M: f64 = 15.0;
/// Or this share of a course shorter than 40 m, so that there is something between.
const ENDS_SHARE: f64 = 0.375;

/// Where cruise speed is measured, m along a course of `length_m`: from, to.
#[must_use]
pub fn cruise_between(length_m: f64) -> [f64; 2] {
    let ends_m = ENDS_M.min(ENDS_SHARE * length_m);
    [ends_m, length_m - ends_m]
}

/// What a chase without a contact is judged by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chase {
    /// How far the target was when it arrived, m.
    pub end_m: f64,
    /// The vehicle had then detected it within [`SEEN_WITHIN_S`].
    pub seen: bool,
    /// The longest stretch farther away than [`FAR_M`], s.
    pub far_s: f64,
    /// Share of the frames that show the target.
    pub in_view: f64,
    /// The least distance to the target, until it had stood for a while, m.
    pub least_m: f64,
}

impl Chase {
    /// By the strict rule.
    #[must_use]
    pub fn outcome(&self) -> Outcome {
        match self {
            chase if chase.end_m > END_M || !chase.seen => Outcome::Lost,
            chase if chase.least_m < TOO_CLOSE_M => Outcome::TooClose,
            chase if chase.far_s > FAR_S => Outcome::Behind,
            chase if chase.in_view < IN_VIEW => Outcome::OutOfView,
            _ => Outcome::Success,
        }
    }

    /// By the lax rule.
    #[must_use]
    pub fn reached(&self) -> bool {
        self.end_m <= FAR_M && self.seen && self.least_m >= TOO_CLOSE_M
    }
}

/// Of a navigation that reached its goal without a contact.
#[must_use]
pub fn navigation(cruise_mps: Option<f64>, asked_mps: f64) -> Outcome {
    let slow = cruise_mps.is_some_and(|cruise| cruise < SLOW_SHARE * asked_mps);
    if slow { Outcome::Slow } else { Outcome::Success }
}

/// The rule in words, a line each for the strict and the lax one.
#[must_use]
pub fn words(task: Task) -> String {
    match task {
        Task::Navigate => format!(
            "success: within {GOAL_RADIUS_M} m of the goal, no contact, and a cruise speed of {:.0} % of the asked one or \
             more (else slow)\nreached: the same, however slowly",
            100.0 * SLOW_SHARE
        ),
        Task::Track => format!(
            "success: no contact; at the end within {END_M} m and seen within the last {SEEN_WITHIN_S} s (else lost); \
             never nearer than {TOO_CLOSE_M} m (else too-close); never farther than {FAR_M} m for more than {FAR_S} s \
             (else behind); in view {:.0} % of the time or more (else out-of-view)\nreached: no contact; at the end within \
             {FAR_M} m and seen within the last {SEEN_WITHIN_S} s; never nearer than {TOO_CLOSE_M} m",
            100.0 * IN_VIEW
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: Chase = Chase { end_m: 10.0, seen: true, far_s: 2.0, in_view: 0.9, least_m: 1.5 };

    #[test]
    fn a_chase_at_every_bound_is_a_success_and_beyond_each_fails_by_its_name() {
        assert_eq!((GOOD.outcome(), GOOD.reached()), (Outcome::Success, true));
        for (chase, outcome, reached) in [
            (Chase { end_m: 10.1, ..GOOD }, Outcome::Lost, true),
            (Chase { end_m: 12.1, ..GOOD }, Outcome::Lost, false),
            (Chase { seen: false, ..GOOD }, Outcome::Lost, false),
            (Chase { least_m: 1.4, ..GOOD }, Outcome::TooClose, false),
            (Chase { far_s: 2.1, ..GOOD }, Outcome::Behind, true),
            (Chase { in_view: 0.89, ..GOOD }, Outcome::OutOfView, true),
        ] {
            assert_eq!((chase.outcome(), chase.reached()), (outcome, reached), "{chase:?}");
        }
    }

    #[test]
    fn a_navigation_below_six_tenths_of_the_asked_speed_is_slow() {
        assert_eq!(navigation(Some(4.8), 8.0), Outcome::Success);
        assert_eq!(navigation(Some(4.79), 8.0), Outcome::Slow);
        assert_eq!(navigation(None, 8.0), Outcome::Success);
    }

    #[test]
    fn cruise_speed_leaves_out_fifteen_metres_at_either_end_of_a_course_that_has_them() {
        assert_eq!(cruise_between(120.0), [15.0, 105.0]);
        assert_eq!(cruise_between(40.0), [15.0, 25.0]);
        assert_eq!(cruise_between(16.0), [6.0, 10.0]);
    }

    #[test]
    fn the_words_name_every_failure() {
        let words = words(Task::Navigate) + &words(Task::Track);
        for name in ["slow", "lost", "too-close", "behind", "out-of-view", "reached"] {
            assert!(words.contains(name), "{name}");
        }
    }
}
