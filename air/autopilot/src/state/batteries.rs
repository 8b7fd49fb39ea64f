//! How much is left in what the vehicle flies on, where there may be several batteries.

use std::collections::BTreeMap;

use goshawk_core::Time;

use crate::messages::{BATTERY_STATUS_DATA, MavBatteryFunction};

/// Silent for so long, s, a battery leaves the word to SYS_STATUS. PX4's tell every two. Chosen by eye.
const SILENT_S: f64 = 10.0;

/// What each battery last told.
#[derive(Clone, Debug, Default)]
pub(crate) struct Batteries {
    /// By id, of those that turn the rotors: when, and 0..1.
    told: BTreeMap<u8, (Time, f64)>,
    /// SYS_STATUS, which does not say of which.
    any: Option<f64>,
}

impl Batteries {
    /// BATTERY_STATUS. One that does not know how full it is says nothing of the others.
    pub(crate) fn take(&mut self, now: Time, status: &BATTERY_STATUS_DATA) {
        use MavBatteryFunction::{MAV_BATTERY_FUNCTION_AVIONICS as AVIONICS, MAV_BATTERY_FUNCTION_PAYLOAD as PAYLOAD};
        match percent(status.battery_remaining) {
            Some(_) if matches!(status.battery_function, AVIONICS | PAYLOAD) => {}
            Some(fraction) => {
                self.told.insert(status.id, (now, fraction));
            }
            None => {
                self.told.remove(&status.id);
            }
        }
    }

    /// SYS_STATUS counts as long as no battery tells of itself. If it knows nothing, what they told last still stands.
    pub(crate) fn take_any(&mut self, now: Time, remaining: i8) {
        self.any = percent(remaining);
        if self.any.is_some() {
            self.told.retain(|_, (told, _)| now.since(*told) < SILENT_S);
        }
    }

    /// What is left in the emptiest, 0..1; none: none knows.
    pub(crate) fn fraction(&self) -> Option<f64> {
        self.told.values().map(|(_, fraction)| *fraction).reduce(f64::min).or(self.any)
    }
}

fn percent(remaining: i8) -> Option<f64> {
    (0..=100).contains(&remaining).then(|| f64::from(remaining) / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(id: u8, battery_remaining: i8) -> BATTERY_STATUS_DATA {
        BATTERY_STATUS_DATA { id, battery_remaining, ..BATTERY_STATUS_DATA::default() }
    }

    #[test]
    fn the_emptiest_battery_counts_whatever_order_they_tell_in() {
        let mut batteries = Batteries::default();
        batteries.take_any(Time(0), 50);
        assert_eq!(batteries.fraction(), Some(0.5));
        for told in [status(0, 5), status(1, 90), status(2, -1)] {
            batteries.take(Time(0), &told);
            batteries.take_any(Time(0), 90);
            assert_eq!(batteries.fraction(), Some(0.05));
        }
    }

    #[test]
    fn what_feeds_no_rotor_does_not_count() {
        let mut batteries = Batteries::default();
        batteries.take(Time(0), &status(0, 80));
        let payload = MavBatteryFunction::MAV_BATTERY_FUNCTION_PAYLOAD;
        batteries.take(Time(0), &BATTERY_STATUS_DATA { battery_function: payload, ..status(1, 3) });
        assert_eq!(batteries.fraction(), Some(0.8));
    }

    #[test]
    fn one_that_no_longer_knows_is_unknown() {
        let mut batteries = Batteries::default();
        batteries.take(Time(0), &status(0, 80));
        batteries.take(Time(0), &status(0, -1));
        assert_eq!(batteries.fraction(), None);
    }

    #[test]
    fn one_that_fell_silent_leaves_the_word_to_the_whole_if_that_knows_any() {
        let (mut batteries, start) = (Batteries::default(), Time(0));
        batteries.take(start, &status(0, 80));
        batteries.take_any(start.plus(SILENT_S - 1.0), 3);
        assert_eq!(batteries.fraction(), Some(0.8));
        batteries.take_any(start.plus(SILENT_S + 1.0), -1);
        assert_eq!(batteries.fraction(), Some(0.8));
        batteries.take_any(start.plus(SILENT_S + 1.0), 3);
        assert_eq!(batteries.fraction(), Some(0.03));
    }
}
