//! PX4's EVENT messages that matter here. The ids are hashes of the events' names with the component in the top byte;
//! these were seen in recorded traffic, where they came at once while HEARTBEAT was up to a second late.

use crate::messages::EVENT_DATA;

/// What PX4 says happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AutopilotEvent {
    /// `commander_armed_by`.
    Armed,
    /// `commander_disarmed_by`.
    Disarmed,
    /// `commander_takeoff_detected`.
    TakeoffDetected,
    /// `commander_landing_detected`.
    LandingDetected,
    /// `commander_failsafe_enter_generic` with an action that leaves the mode: it no longer follows us.
    FailsafeEntered,
    /// `check_modes_offboard_signal`: a readiness check complains that no setpoints arrive.
    NoOffboardSignal,
    /// Another event, by its id.
    Other(u32),
}

const TABLE: [(AutopilotEvent, u32); 6] = [
    (AutopilotEvent::Armed, 26_266_355),
    (AutopilotEvent::Disarmed, 32_794_487),
    (AutopilotEvent::TakeoffDetected, 21_054_825),
    (AutopilotEvent::LandingDetected, 26_622_124),
    (AutopilotEvent::FailsafeEntered, 31_382_480),
    (AutopilotEvent::NoOffboardSignal, 19_865_031),
];

impl AutopilotEvent {
    /// The event of an EVENT message's `id`, whatever its arguments.
    #[must_use]
    pub fn from_id(id: u32) -> Self {
        TABLE.iter().find(|row| row.1 == id).map_or(Self::Other(id), |row| row.0)
    }

    /// The event of an EVENT message. A failsafe that only warns is [`Self::Other`].
    #[must_use]
    pub fn of(message: &EVENT_DATA) -> Self {
        match Self::from_id(message.id) {
            // Arguments: the mode left (u32), the action (u8; 0 none, 1 warn, above it changes the mode).
            Self::FailsafeEntered if message.arguments[4] < 2 => Self::Other(message.id),
            event => event,
        }
    }

    /// The `id` of this event.
    #[must_use]
    pub fn id(self) -> u32 {
        match self {
            Self::Other(id) => id,
            known => TABLE.iter().find(|row| row.0 == known).map_or(0, |row| row.1),
        }
    }
}
