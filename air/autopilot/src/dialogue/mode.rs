//! PX4's flight modes as HEARTBEAT's and CURRENT_MODE's `custom_mode` number them, and a mode of either firmware.

use crate::dialogue::copter::CopterMode;
use std::fmt;

/// A flight mode of whichever firmware flies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FlightMode {
    /// PX4's.
    Px4(Px4Mode),
    /// ArduPilot Copter's.
    Copter(CopterMode),
}

impl FlightMode {
    /// Parameters 2 and 3 of MAV_CMD_DO_SET_MODE: main and sub mode for PX4, `custom_mode` and nothing for ArduPilot.
    #[must_use]
    pub fn parameters(self) -> (f32, f32) {
        match self {
            Self::Px4(mode) => {
                let (main, sub) = mode.main_and_sub();
                (f32::from(main), f32::from(sub))
            }
            Self::Copter(CopterMode(number)) => (number as f32, 0.0),
        }
    }
}

impl fmt::Display for FlightMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Px4(mode) => mode.fmt(f),
            Self::Copter(mode) => mode.fmt(f),
        }
    }
}

/// A PX4 flight mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Px4Mode {
    /// Sticks to attitude, no self-levelling help beyond it.
    Manual,
    /// Sticks to climb rate and tilt.
    Altitude,
    /// Sticks to velocity; without sticks, PX4's default answer to lost setpoints.
    Position,
    /// Sticks to body rates.
    Acro,
    /// Setpoints from a companion computer.
    Offboard,
    /// Sticks to tilt and thrust.
    Stabilized,
    /// AUTO: take off.
    Takeoff,
    /// AUTO: hold position.
    Hold,
    /// AUTO: fly the mission.
    Mission,
    /// AUTO: return to launch.
    Return,
    /// AUTO: land here.
    Land,
    /// AUTO: land without a position.
    Descend,
    /// Any other, as it was on the wire.
    Other(u32),
}

/// Mode, main mode, sub mode, name as PX4's tools print it.
const TABLE: [(Px4Mode, u8, u8, &str); 12] = [
    (Px4Mode::Manual, 1, 0, "MANUAL"),
    (Px4Mode::Altitude, 2, 0, "ALTCTL"),
    (Px4Mode::Position, 3, 0, "POSCTL"),
    (Px4Mode::Acro, 5, 0, "ACRO"),
    (Px4Mode::Offboard, 6, 0, "OFFBOARD"),
    (Px4Mode::Stabilized, 7, 0, "STABILIZED"),
    (Px4Mode::Takeoff, 4, 2, "AUTO.TAKEOFF"),
    (Px4Mode::Hold, 4, 3, "AUTO.LOITER"),
    (Px4Mode::Mission, 4, 4, "AUTO.MISSION"),
    (Px4Mode::Return, 4, 5, "AUTO.RTL"),
    (Px4Mode::Land, 4, 6, "AUTO.LAND"),
    (Px4Mode::Descend, 4, 20, "AUTO.DESCEND"),
];

impl Px4Mode {
    /// The mode of a `custom_mode` field (main mode in bits 16–23, sub mode in bits 24–31).
    #[must_use]
    pub fn from_custom_mode(custom_mode: u32) -> Self {
        let [_, _, main, sub] = custom_mode.to_le_bytes();
        TABLE.iter().find(|row| (row.1, row.2) == (main, sub)).map_or(Self::Other(custom_mode), |row| row.0)
    }

    /// The `custom_mode` field of this mode.
    #[must_use]
    pub fn custom_mode(self) -> u32 {
        match self {
            Self::Other(raw) => raw,
            known => {
                let (main, sub) = known.main_and_sub();
                u32::from_le_bytes([0, 0, main, sub])
            }
        }
    }

    /// Main and sub mode, parameters 2 and 3 of MAV_CMD_DO_SET_MODE.
    #[must_use]
    pub fn main_and_sub(self) -> (u8, u8) {
        if let Self::Other(raw) = self {
            let [_, _, main, sub] = raw.to_le_bytes();
            return (main, sub);
        }
        TABLE.iter().find(|row| row.0 == self).map_or((0, 0), |row| (row.1, row.2))
    }
}

impl fmt::Display for Px4Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match TABLE.iter().find(|row| row.0 == *self) {
            Some(row) => f.write_str(row.3),
            None => write!(f, "mode {:#010x}", self.custom_mode()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_recorded_custom_modes_have_their_names() {
        for (raw, name) in [(0x0006_0000, "OFFBOARD"), (0x0304_0000, "AUTO.LOITER"), (0x0003_0000, "POSCTL")] {
            let mode = Px4Mode::from_custom_mode(raw);
            assert_eq!(mode.to_string(), name);
            assert_eq!(mode.custom_mode(), raw);
        }
    }

    #[test]
    fn an_unknown_mode_survives_the_round_trip() {
        let mode = Px4Mode::from_custom_mode(0x0A04_0000);
        assert_eq!(mode.custom_mode(), 0x0A04_0000);
        assert_eq!(mode.main_and_sub(), (4, 10));
        assert_eq!(mode.to_string(), "mode 0x0a040000");
    }
}
