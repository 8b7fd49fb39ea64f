//! How much is left in what the vehicle flies on, where there may be several batteries.

use std::collections::BTreeMap;

use crate::messages::{BATTERY_STATUS_DATA, MavBatteryFunction};

/// What each battery last told.
#[derive(Clone, Debug, Default)]
pub(crate) struct Batteries {
    /// By id, of those that turn the rotors, 0..1.
    told: BTreeMap<u8, f64>,
    /// SYS_STATUS, which does not say of which.
    any: Option<f64>,
}

impl Batteries {
    /// BATTERY_STATUS. One that does not know how full it is says nothing of the others.
    pub(crate) fn take(&mut self, status: &BATTERY_STATUS_DATA) {
        use MavBatteryFunction::{MAV_BATTERY_FUNCTION_AVIONICS as AVIONICS, MAV_BATTERY_FUNCTION_PAYLOAD as PAYLOAD};
        match percent(status.battery_remaining) {
            Some(_) if matches!(status.battery_function, AVIONICS | PAYLOAD) => {}
            Some(fraction) => {
                self.told.insert(status.id, fraction);
            }
            None => {
                self.told.remove(&status.id);
            }
        }
    }

    /// SYS_STATUS counts as long as no battery has told of itself.
    pub(crate) fn take_any(&mut self, remaining: i8) {
        self.any = percent(remaining);
    }

    /// What is left in the emptiest, 0..1; none: none knows.
    pub(crate) fn fraction(&self) -> Option<f64> {
        self.told.values().copied().reduce(f64::min).or(self.any)
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
        batteries.take_any(50);
        assert_eq!(batteries.fraction(), Some(0.5));
        for told in [status(0, 5), status(1, 90), status(2, -1)] {
            batteries.take(&told);
            batteries.take_any(90);
            assert_eq!(batteries.fraction(), Some(0.05));
        }
    }

    #[test]
    fn what_feeds_no_rotor_does_not_count() {
        let mut batteries = Batteries::default();
        batteries.take(&status(0, 80));
        let payload = MavBatteryFunction::MAV_BATTERY_FUNCTION_PAYLOAD;
        batteries.take(&BATTERY_STATUS_DATA { battery_function: payload, ..status(1, 3) });
        assert_eq!(batteries.fraction(), Some(0.8));
    }

    #[test]
    fn one_that_no_longer_knows_is_unknown() {
        let mut batteries = Batteries::default();
        batteries.take(&status(0, 80));
        batteries.take(&status(0, -1));
        assert_eq!(batteries.fraction(), None);
    }
}
