//! ArduPilot Copter's flight modes as HEARTBEAT's `custom_mode` numbers them.

use std::fmt;

/// A flight mode of ArduPilot Copter, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct CopterMode(pub u32);

/// ArduCopter's modes by their numbers.
const NAMES: [(u32, &str); 18] = [
    (0, "STABILIZE"),
    (1, "ACRO"),
    (2, "ALT_HOLD"),
    (3, "AUTO"),
    (4, "GUIDED"),
    (5, "LOITER"),
    (6, "RTL"),
    (7, "CIRCLE"),
    (9, "LAND"),
    (11, "DRIFT"),
    (13, "SPORT"),
    (15, "AUTOTUNE"),
    (16, "POSHOLD"),
    (17, "BRAKE"),
    (18, "THROW"),
    (20, "GUIDED_NOGPS"),
    (21, "SMART_RTL"),
    (22, "FLOWHOLD"),
];

impl CopterMode {
    /// Setpoints from a companion computer; needs a position estimate.
    pub const GUIDED: Self = Self(4);
    /// Land here; needs no position estimate.
    pub const LAND: Self = Self(9);
    /// Attitude setpoints from a companion computer without a position estimate.
    pub const GUIDED_NOGPS: Self = Self(20);
}

impl fmt::Display for CopterMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match NAMES.iter().find(|row| row.0 == self.0) {
            Some(row) => f.write_str(row.1),
            None => write!(f, "mode {}", self.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_have_the_names_that_ardupilots_tools_print() {
        assert_eq!(CopterMode::GUIDED.to_string(), "GUIDED");
        assert_eq!(CopterMode::GUIDED_NOGPS.to_string(), "GUIDED_NOGPS");
        assert_eq!(CopterMode::LAND.to_string(), "LAND");
        assert_eq!(CopterMode(99).to_string(), "mode 99");
    }
}
