//! What the stand-in's checks say of arming, told as PX4 tells it: a bit in SYS_STATUS, a report of events when it
//! changes and when it is asked for, and a text for ground stations.

use super::checks::{Checks, EVERY_MODE, NEED_POSITION, OFFBOARD, Told};
use super::logic::Px4Logic;
use goshawk_autopilot::Px4Mode;
use goshawk_autopilot::dialogue::events::event_id;

/// Reports are no closer together than this, s.
const REPORT_S: f64 = 2.0;
/// Log levels of its events: external in the low half, internal in the high one.
const ERROR: u8 = 0x33;
const WARNING: u8 = 0x44;
const PROTOCOL: u8 = 0x88;

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
