//! What the stand-in's checks say of arming, told as PX4 tells it: a bit in SYS_STATUS, a report of events when it
//! changes and when it is asked for, and a text for ground stations.

use super::logic::Px4Logic;
use goshawk_autopilot::Px4Mode;
use goshawk_autopilot::events::event_id;
use goshawk_core::types::Time;

/// PX4's navigation states of the modes that it can arm in, as recorded of its simulated airframe.
const ARMING_MODES: u32 = 0x807f_7bb0;
const EVERY_MODE: u32 = u32::MAX;
const OFFBOARD: u32 = 1 << 14;
/// Position, mission, hold, return and land: they need a position.
const NEED_POSITION: u32 = 1 << 2 | 1 << 3 | 1 << 4 | 1 << 5 | 1 << 18;
/// Reports are no closer together than this, s.
const REPORT_S: f64 = 2.0;
/// Log levels of its events: external in the low half, internal in the high one.
const ERROR: u8 = 0x33;
const WARNING: u8 = 0x44;
const PROTOCOL: u8 = 0x88;

/// What goes wrong with the autopilot, for tests of those who fly with it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Px4Faults {
    /// COM_ARMABLE is 0: it refuses to arm, and says why.
    pub unarmable: bool,
    /// No GPS, flow or VIO: the estimator invents a standstill and says so in its flags.
    pub no_position: bool,
    /// It hears no command and no question, as one that wants signatures.
    pub deaf: bool,
    /// It takes so long to arm once it is asked, s.
    pub arming_delay_s: f64,
}

/// The checks that may fail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Checks {
    unarmable: bool,
    no_position: bool,
    no_signal: bool,
}

impl Checks {
    /// The navigation states that could arm now.
    fn can_arm(self) -> u32 {
        let without = |failing: bool, modes: u32| if failing { !modes } else { EVERY_MODE };
        ARMING_MODES
            & without(self.unarmable, EVERY_MODE)
            & without(self.no_position, NEED_POSITION)
            & without(self.no_signal, OFFBOARD)
    }
}

/// When the checks were last told, and what they were.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Told {
    checks: Checks,
    at: Option<Time>,
}

impl Px4Logic {
    fn checks(&self) -> Checks {
        Checks {
            unarmable: self.faults.unarmable,
            no_position: self.faults.no_position,
            no_signal: !self.stream_is_fresh(),
        }
    }

    /// Could it arm in the mode that it is in?
    pub(super) fn can_arm(&self) -> bool {
        let state = match self.mode {
            Px4Mode::Position => 2,
            Px4Mode::Offboard => 14,
            Px4Mode::Hold => 4,
            _ => return false, // landing and the like never arm
        };
        self.checks().can_arm() >> state & 1 == 1
    }

    /// Tells the checks where they have changed.
    pub(super) fn tell_changes(&mut self) {
        let due = self.told.at.is_none_or(|at| self.now.since(at) >= REPORT_S);
        if due && self.told.checks != self.checks() {
            self.tell_checks();
        }
    }

    /// The report: a summary, what fails, a summary.
    pub(super) fn tell_checks(&mut self) {
        let checks = self.checks();
        self.told = Told { checks, at: Some(self.now) };
        let mut summary = [0; 17];
        summary[9..13].copy_from_slice(&checks.can_arm().to_le_bytes());
        summary[13..].copy_from_slice(&checks.can_arm().to_le_bytes());
        self.send_event(event_id("commander_arming_check_summary"), PROTOCOL, &summary);
        for (fails, name, level, modes) in [
            (checks.unarmable, "check_armable_configuration", ERROR, EVERY_MODE),
            (checks.no_position, "check_modes_local_pos", ERROR, NEED_POSITION),
            (checks.no_signal, "check_modes_offboard_signal_lost", ERROR, OFFBOARD),
            (true, "check_modes_manual_control", WARNING, EVERY_MODE), // it flies without a radio
        ] {
            if fails {
                self.send_event(event_id(name), level, &modes.to_le_bytes());
            }
        }
        self.send_event(event_id("commander_health_summary"), PROTOCOL, &[0; 13]);
        if checks.unarmable {
            self.text("Preflight Fail: Vehicle is in safety configuration");
        }
    }
}
