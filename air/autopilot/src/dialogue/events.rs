//! PX4's EVENT messages that matter here. An id is the 32-bit FNV-1a hash of the event's name, its low 24 bits, with the
//! component in the top byte. Events come at once where HEARTBEAT is up to a second late.

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
    /// `commander_failsafe_enter…` with an action that leaves the mode: it no longer follows us.
    FailsafeEntered,
    /// `check_modes_offboard_…`: a readiness check complains that no setpoints arrive.
    NoOffboardSignal,
    /// `check_estimator_gnss_fusion_stopped`, in flight.
    GpsLost,
    /// `check_estimator_gnss_fusion_started`, in flight.
    GpsBack,
    /// Another event, by its id.
    Other(u32),
}

/// The event's component in an id: the autopilot itself.
const AUTOPILOT: u32 = 1 << 24;
/// From this on a failsafe's action changes the mode; 0 does nothing, 1 warns.
const LEAVES_THE_MODE: u8 = 2;
/// The failsafes whose action is their second argument, after the mode left (u32).
const FAILSAFE: [u32; 2] = [event_id("commander_failsafe_enter_generic"), event_id("commander_failsafe_enter")];

/// Where several ids mean the same, they are those of several versions; the first is what [`AutopilotEvent::id`] gives.
/// Failsafes that only warn (`…_warn`, `…_low_bat`) are not among them.
const TABLE: [(AutopilotEvent, u32); 14] = [
    (AutopilotEvent::Armed, event_id("commander_armed_by")),
    (AutopilotEvent::Disarmed, event_id("commander_disarmed_by")),
    (AutopilotEvent::TakeoffDetected, event_id("commander_takeoff_detected")),
    (AutopilotEvent::LandingDetected, event_id("commander_landing_detected")),
    (AutopilotEvent::FailsafeEntered, FAILSAFE[0]),
    (AutopilotEvent::FailsafeEntered, FAILSAFE[1]),
    (AutopilotEvent::FailsafeEntered, event_id("commander_failsafe_enter_generic_hold")),
    (AutopilotEvent::FailsafeEntered, event_id("commander_failsafe_enter_hold")),
    (AutopilotEvent::FailsafeEntered, event_id("commander_failsafe_enter_autopilot_disengaged")),
    (AutopilotEvent::NoOffboardSignal, event_id("check_modes_offboard_signal")),
    (AutopilotEvent::NoOffboardSignal, event_id("check_modes_offboard_signal_lost")),
    (AutopilotEvent::NoOffboardSignal, event_id("check_modes_offboard_no_signal")),
    (AutopilotEvent::GpsLost, event_id("check_estimator_gnss_fusion_stopped")),
    (AutopilotEvent::GpsBack, event_id("check_estimator_gnss_fusion_started")),
];

/// The id of the event called `name`.
#[must_use]
pub const fn event_id(name: &str) -> u32 {
    let bytes = name.as_bytes();
    let (mut hash, mut at) = (0x811c_9dc5_u32, 0);
    while at < bytes.len() {
        hash = (hash ^ bytes[at] as u32).wrapping_mul(0x0100_0193);
        at += 1;
    }
    AUTOPILOT | hash & 0x00ff_ffff
}

/// The event says that Offboard lacks setpoints.
pub(crate) fn is_offboard_signal(id: u32) -> bool {
    AutopilotEvent::from_id(id) == AutopilotEvent::NoOffboardSignal
}

impl AutopilotEvent {
    /// The event of an EVENT message's `id`, whatever its arguments.
    #[must_use]
    pub fn from_id(id: u32) -> Self {
        TABLE.iter().find(|row| row.1 == id).map_or(Self::Other(id), |row| row.0)
    }

    /// The event of an EVENT message. A failsafe that only warns is [`Self::Other`].
    #[must_use]
    pub fn of(message: &EVENT_DATA) -> Self {
        let warns = FAILSAFE.contains(&message.id) && message.arguments[4] < LEAVES_THE_MODE;
        if warns { Self::Other(message.id) } else { Self::from_id(message.id) }
    }

    /// The `id` of this event.
    #[must_use]
    pub fn id(self) -> u32 {
        match self {
            Self::Other(id) => id,
            known => TABLE.iter().find(|row| row.0 == known).map_or(0, |row| row.1),
        }
    }

    /// It is trouble.
    #[must_use]
    pub fn is_trouble(self) -> bool {
        matches!(self, Self::FailsafeEntered | Self::GpsLost)
    }

    /// What to tell the operator of it; none: other messages tell it, or it is not known.
    #[must_use]
    pub fn words(self) -> Option<&'static str> {
        match self {
            Self::Armed => Some("the motors are armed"),
            Self::Disarmed => Some("the motors are disarmed"),
            Self::FailsafeEntered => Some("a failsafe of the autopilot took the mode"),
            Self::GpsLost => Some("the autopilot has stopped using its GPS"),
            Self::GpsBack => Some("the autopilot uses its GPS again"),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ids_of_names_are_those_that_px4_sends() {
        // Recorded of a main of mid-2025.
        for (name, id) in [
            ("commander_armed_by", 26_266_355),
            ("commander_disarmed_by", 32_794_487),
            ("commander_takeoff_detected", 21_054_825),
            ("commander_landing_detected", 26_622_124),
            ("commander_failsafe_enter_generic", 31_382_480),
            ("check_modes_offboard_signal", 19_865_031),
        ] {
            assert_eq!(event_id(name), id, "{name}");
        }
        // Seen of a main of August 2026, at the loss of setpoints.
        assert_eq!(AutopilotEvent::from_id(28_241_790), AutopilotEvent::NoOffboardSignal);
    }

    #[test]
    fn every_failsafe_that_leaves_the_mode_is_one_and_a_warning_is_none() {
        let sent = |name: &str, action: u8| {
            let mut arguments = [0; 40];
            arguments[4] = action;
            AutopilotEvent::of(&EVENT_DATA { id: event_id(name), arguments, ..EVENT_DATA::default() })
        };
        for name in ["", "_generic", "_generic_hold", "_hold", "_autopilot_disengaged"] {
            let name = format!("commander_failsafe_enter{name}");
            assert_eq!(sent(&name, 6), AutopilotEvent::FailsafeEntered, "{name}");
        }
        for name in
            ["_generic_warn", "_warn", "_low_bat", "_crit_bat_warn", "_crit_low_bat_warn", "_low_flight_time_warn"]
        {
            let name = format!("commander_failsafe_enter{name}");
            assert_eq!(sent(&name, 6), AutopilotEvent::Other(event_id(&name)), "{name}");
        }
        assert!(matches!(sent("commander_failsafe_enter_generic", 1), AutopilotEvent::Other(_)));
        assert!(matches!(sent("commander_failsafe_enter", 1), AutopilotEvent::Other(_)));
    }
}
