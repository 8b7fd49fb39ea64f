//! What the link tells of the autopilot: plain values.

use crate::dialogue::firmware::{Firmware, Identity, THRUST_AS_THRUST};
use crate::dialogue::mode::FlightMode;
use crate::dialogue::parameters::Parameter;
use crate::state::validity::PositionFault;
use goshawk_core::{AutopilotStatus, Time};

/// What came and went, counted since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Packets of the autopilot.
    pub received: u64,
    /// Packets of other systems or components.
    pub foreign: u64,
    /// Packets from an address that is not the peer's.
    pub strangers: u64,
    /// Packets without a signature, refused because we have a key.
    pub unsigned: u64,
    /// Packets signed with another key, refused.
    pub bad_signature: u64,
    /// Packets rightly signed with a time that is too old, refused.
    pub stale_signature: u64,
    /// Signed packets that could not be checked because we have no key; taken.
    pub unchecked: u64,
    /// Runs of bytes that were no MAVLink 2.
    pub garbage: u64,
    /// Frames cut short.
    pub truncated: u64,
    /// Frames with a wrong checksum.
    pub checksum: u64,
    /// Messages unknown to the dialect, or with flags or values that we do not know.
    pub unknown: u64,
    /// Motion messages with values that are not finite.
    pub not_finite: u64,
    /// ODOMETRY in frames that cannot be converted.
    pub odometry_frame: u64,
    /// Restarts of the autopilot that were noticed by its clock.
    pub restarts: u64,
    /// The autopilot's packets that never came, by their sequence numbers.
    pub lost: u64,
    /// Packets sent.
    pub sent: u64,
    /// Packets that could not be sent.
    pub send_errors: u64,
}

/// The autopilot's state at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Status {
    /// What it is to be.
    pub firmware: Firmware,
    /// What its heartbeat says that it is; none: not heard yet.
    pub identity: Option<Identity>,
    /// ArduPilot's options of the guided modes; none: not told.
    pub guided_options: Option<Parameter>,
    /// Its heartbeat is younger than 3 s.
    pub connected: bool,
    /// Motors may turn.
    pub armed: bool,
    /// It follows our setpoints: it is in the mode for them, and takes our thrust as thrust.
    pub offboard: bool,
    /// It left the mode that was asked for by itself (lost setpoints, battery, …). A pilot's choice is no failsafe.
    pub failsafe: bool,
    /// Its landed detector; none: unknown.
    pub landed: Option<bool>,
    /// The mode that it flies; none: not heard yet.
    pub mode: Option<FlightMode>,
    /// The mode that was last asked for by anyone; none: not heard yet.
    pub intended_mode: Option<FlightMode>,
    /// Battery left, 0..=1; none: not measured.
    pub battery_fraction: Option<f64>,
    /// Its estimator stands by its horizontal position and velocity; none: it does not say.
    pub position: Option<bool>,
    /// What its position lacks; none: nothing that it tells.
    pub position_fault: Option<PositionFault>,
    /// It would arm if it were asked; none: it does not say, or it is armed.
    pub would_arm: Option<bool>,
    /// What it is asked is not answered.
    pub unanswered: bool,
    /// An autopilot with other ids that is heard instead: system and component.
    pub other: Option<(u8, u8)>,
    /// Age of its newest heartbeat, s; none: never heard.
    pub heartbeat_age_s: Option<f64>,
    /// TIMESYNC round trip that the clocks are set by, s; none: stamps are from arrival times.
    pub round_trip_s: Option<f64>,
    /// Traffic.
    pub counters: Counters,
}

impl Status {
    /// Why it cannot be flown with, and what to do, in one line; none: it can.
    #[must_use]
    pub fn problem(&self) -> Option<String> {
        match self.heartbeat_age_s {
            None => Some(self.unheard()),
            Some(age) if !self.connected => Some(format!("its last heartbeat is {age:.1} s old: check the link")),
            Some(_) => {
                let mismatch = self.identity.and_then(|identity| self.firmware.mismatch(identity));
                mismatch.or_else(|| self.silence()).or_else(|| self.thrust_problem())
            }
        }
    }

    /// Why what it is asked may not be answered; none: it is.
    fn silence(&self) -> Option<String> {
        let what = if self.counters.unchecked > 0 {
            "it does not answer what it is asked, and it signs what it sends: set signing_key_file to its key"
        } else {
            "it is heard, but does not answer what it is asked: see that its port receives, that its MAVLink is not \
             signed with a key that we lack, and that target_component is right"
        };
        self.unanswered.then(|| what.to_owned())
    }

    fn unheard(&self) -> String {
        let counters = &self.counters;
        if let Some((system, component)) = self.other {
            return format!(
                "another autopilot is heard, with system {system} and component {component}: set target_system = \
                 {system} and target_component = {component}, or its ids"
            );
        }
        let what = if counters.bad_signature > 0 {
            "what comes is signed with another key: give the autopilot the key of signing_key_file"
        } else if counters.unsigned > 0 {
            "what comes is not signed: give the autopilot the key of signing_key_file, or do without the file"
        } else if counters.stale_signature > 0 {
            "what comes is signed with a time long past: set this computer's clock, or wait until the autopilot follows it"
        } else if counters.foreign > 0 {
            "others are heard on this link, the autopilot is not: check target_system and target_component"
        } else if counters.strangers > 0 {
            "others speak to our port than the one that `link` or `peer` names: check its address"
        } else if counters.garbage + counters.checksum + counters.truncated > 0 {
            "bytes come that are no MAVLink 2: check the baud rate, and that the autopilot's port speaks MAVLink 2"
        } else {
            "no autopilot has been heard: check the MAVLink port and the wiring"
        };
        what.to_owned()
    }

    /// Why ArduPilot would take our thrust for something else; none: it would not.
    #[must_use]
    pub fn thrust_problem(&self) -> Option<String> {
        match (self.firmware, self.guided_options) {
            (Firmware::Px4, _) => None,
            (_, Some(Parameter::Int(options))) if options & THRUST_AS_THRUST != 0 => None,
            (_, None) => Some(
                "GUID_OPTIONS is not read yet, which tells whether it takes our thrust as thrust: if this stays, see \
                 that the autopilot answers on this link"
                    .to_owned(),
            ),
            (_, Some(Parameter::Int(options))) => Some(format!(
                "GUID_OPTIONS is {options}: it would take our thrust for a climb rate; set it to {}",
                options | THRUST_AS_THRUST
            )),
            (_, Some(Parameter::Real(value))) => {
                Some(format!("GUID_OPTIONS is {value}, no bit mask: set it to {THRUST_AS_THRUST}"))
            }
        }
    }

    /// What the controller wants to know of it.
    #[must_use]
    pub fn core(&self) -> AutopilotStatus {
        AutopilotStatus {
            connected: self.connected,
            armed: self.armed,
            offboard: self.offboard,
            landed: self.landed,
            battery: self.battery_fraction,
            position: self.position,
        }
    }
}

/// A line of text from the autopilot. It sends them only to a ground-station heartbeat.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StatusText {
    /// When it came.
    pub stamp: Time,
    /// 0 emergency … 7 debug.
    pub severity: u8,
    /// What it says.
    pub text: String,
}
