//! What the link tells of the autopilot: plain values.

use crate::mode::Px4Mode;
use goshawk_core::AutopilotStatus;
use goshawk_core::types::{Time, Vec3};

/// What came and went, counted since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Packets of the autopilot.
    pub received: u64,
    /// Packets of other systems or components.
    pub foreign: u64,
    /// Datagrams from an address that is not the peer's.
    pub strangers: u64,
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
    /// The autopilot's packets that never came, by their sequence numbers.
    pub lost: u64,
    /// Datagrams sent.
    pub sent: u64,
    /// Datagrams that could not be sent.
    pub send_errors: u64,
}

/// The autopilot's state at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Status {
    /// Its heartbeat is younger than 3 s.
    pub connected: bool,
    /// Motors may turn.
    pub armed: bool,
    /// It follows our setpoints.
    pub offboard: bool,
    /// It left the mode that was asked for by itself (lost setpoints, battery, …). A pilot's choice is no failsafe.
    pub failsafe: bool,
    /// Its landed detector; none: unknown.
    pub landed: Option<bool>,
    /// The mode that it flies; none: not heard yet.
    pub mode: Option<Px4Mode>,
    /// The mode that was last asked for by anyone; none: not heard yet.
    pub intended_mode: Option<Px4Mode>,
    /// Battery left, 0..=1; none: not measured.
    pub battery_fraction: Option<f64>,
    /// Age of its newest heartbeat, s; none: never heard.
    pub heartbeat_age_s: Option<f64>,
    /// TIMESYNC round trip that the clocks are set by, s; none: stamps are from arrival times.
    pub round_trip_s: Option<f64>,
    /// Traffic.
    pub counters: Counters,
}

impl Status {
    /// What the controller wants to know of it.
    #[must_use]
    pub fn core(&self) -> AutopilotStatus {
        AutopilotStatus {
            connected: self.connected,
            armed: self.armed,
            offboard: self.offboard,
            landed: self.landed,
            battery: self.battery_fraction,
        }
    }
}

/// One inertial sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Imu {
    /// When it was true.
    pub stamp: Time,
    /// Specific force (what an accelerometer measures; +g along z at rest), m/s².
    pub specific_force_body: Vec3,
    /// Angular velocity, rad/s.
    pub ang_vel_body: Vec3,
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
