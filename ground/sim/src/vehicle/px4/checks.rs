//! What may keep the stand-in from arming, and in which modes.

use goshawk_core::Time;

/// PX4's navigation states of the modes that it can arm in, as recorded of its simulated airframe.
const ARMING_MODES: u32 = 0x807f_7bb0;
pub(super) const EVERY_MODE: u32 = u32::MAX;
pub(super) const OFFBOARD: u32 = 1 << 14;
/// Position, mission, hold, return and land: they need a position.
pub(super) const NEED_POSITION: u32 = 1 << 2 | 1 << 3 | 1 << 4 | 1 << 5 | 1 << 18;

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
    /// It never notices that it has landed.
    pub numb: bool,
}

/// The checks that may fail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Checks {
    pub(super) unarmable: bool,
    pub(super) no_position: bool,
    pub(super) no_signal: bool,
}

impl Checks {
    /// The navigation states that could arm now.
    pub(super) fn can_arm(self) -> u32 {
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
    pub(super) checks: Checks,
    pub(super) at: Option<Time>,
}
