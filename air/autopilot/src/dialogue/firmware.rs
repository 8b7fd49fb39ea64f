//! Which autopilot is flown, and what that changes on the wire.

use crate::dialogue::commands::Command;
use crate::dialogue::copter::CopterMode;
use crate::dialogue::mode::{FlightMode, Px4Mode};
use crate::dialogue::rates::StreamRates;
use crate::messages::{
    ATTITUDE_QUATERNION_DATA, CURRENT_MODE_DATA, EKF_STATUS_REPORT_DATA, ESTIMATOR_STATUS_DATA,
    EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA, HIGHRES_IMU_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, MavType,
    ODOMETRY_DATA, RC_CHANNELS_DATA, SYS_STATUS_DATA,
};
use goshawk_core::Request;
use mavlink::MessageData;
use std::fmt;

/// The autopilot's firmware.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Firmware {
    /// PX4, flown in Offboard.
    #[default]
    Px4,
    /// ArduPilot Copter, flown in one of its guided modes.
    ArduPilot(Guided),
}

/// Which of ArduPilot's modes takes our setpoints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Guided {
    /// GUIDED: arms only with a position estimate.
    #[default]
    Guided,
    /// GUIDED_NOGPS: arms without one.
    NoGps,
}

/// What a heartbeat says of its sender.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Identity {
    /// The firmware.
    pub autopilot: MavAutopilot,
    /// The kind of vehicle.
    pub vehicle: MavType,
}

impl Firmware {
    /// The mode in which it follows our setpoints.
    #[must_use]
    pub fn follows(self) -> FlightMode {
        match self {
            Self::Px4 => FlightMode::Px4(Px4Mode::Offboard),
            Self::ArduPilot(Guided::Guided) => FlightMode::Copter(CopterMode::GUIDED),
            Self::ArduPilot(Guided::NoGps) => FlightMode::Copter(CopterMode::GUIDED_NOGPS),
        }
    }

    /// The mode of a `custom_mode` field.
    #[must_use]
    pub fn mode(self, custom_mode: u32) -> FlightMode {
        match self {
            Self::Px4 => FlightMode::Px4(Px4Mode::from_custom_mode(custom_mode)),
            Self::ArduPilot(_) => FlightMode::Copter(CopterMode(custom_mode)),
        }
    }

    /// What the controller's request is for this firmware.
    #[must_use]
    pub fn command(self, request: Request) -> Command {
        match request {
            Request::Offboard => Command::SetMode(self.follows()),
            Request::Arm => Command::Arm,
            Request::Disarm => Command::Disarm { force: false },
            Request::DisarmAnyway => Command::Disarm { force: true },
            Request::HandBack => Command::SetMode(match self {
                Self::Px4 => FlightMode::Px4(Px4Mode::Land),
                Self::ArduPilot(_) => FlightMode::Copter(CopterMode::LAND),
            }),
        }
    }

    /// Messages to ask for when contact is made, with their rates, Hz. ArduPilot denies what it does not have, which
    /// are CURRENT_MODE and ODOMETRY: HEARTBEAT comes as often instead, and position and attitude each by itself.
    #[must_use]
    pub fn streams(self, rates: &StreamRates) -> Vec<(u32, f64)> {
        let mut streams = match self {
            Self::Px4 => vec![
                (CURRENT_MODE_DATA::ID, rates.state_hz),
                (ODOMETRY_DATA::ID, rates.odometry_hz),
                (ATTITUDE_QUATERNION_DATA::ID, rates.attitude_hz),
                (HIGHRES_IMU_DATA::ID, rates.imu_hz),
                (EXTENDED_SYS_STATE_DATA::ID, rates.state_hz),
                (ESTIMATOR_STATUS_DATA::ID, rates.state_hz),
            ],
            Self::ArduPilot(_) => vec![
                (HEARTBEAT_DATA::ID, rates.state_hz),
                (LOCAL_POSITION_NED_DATA::ID, rates.odometry_hz),
                (ATTITUDE_QUATERNION_DATA::ID, rates.attitude_hz),
                (EXTENDED_SYS_STATE_DATA::ID, rates.state_hz),
                (EKF_STATUS_REPORT_DATA::ID, rates.state_hz),
                (SYS_STATUS_DATA::ID, BATTERY_HZ),
            ],
        };
        streams.extend(rates.radio_hz.map(|hz| (RC_CHANNELS_DATA::ID, hz)));
        streams
    }

    /// Parameters that decide how it takes our setpoints, and what it does without them. The link asks for them by
    /// itself, again and again until they are told.
    #[must_use]
    pub fn parameters(self) -> [&'static str; 2] {
        match self {
            Self::Px4 => ["COM_OF_LOSS_T", "COM_OBL_RC_ACT"],
            Self::ArduPilot(_) => [GUIDED_OPTIONS, "GUID_TIMEOUT"],
        }
    }

    /// Parameters of which one tells whether moving a stick takes the mode from us; which, depends on its version.
    /// None for ArduPilot: there only the mode switch does.
    #[must_use]
    pub fn stick_parameters(self) -> &'static [&'static str] {
        match self {
            Self::Px4 => &["MAN_OVERRIDE_SPD", "COM_RC_OVERRIDE"],
            Self::ArduPilot(_) => &[],
        }
    }

    /// Why a vehicle that says `heard` of itself cannot be flown as this firmware.
    #[must_use]
    pub fn mismatch(self, heard: Identity) -> Option<String> {
        let (expected, key) = match self {
            Self::Px4 => (MavAutopilot::MAV_AUTOPILOT_PX4, "px4"),
            Self::ArduPilot(_) => (MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, "ardupilot"),
        };
        if heard.autopilot != expected {
            let other = match heard.autopilot {
                MavAutopilot::MAV_AUTOPILOT_PX4 => "it is PX4: set firmware = \"px4\"".to_owned(),
                MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => "it is ArduPilot: set firmware = \"ardupilot\"".to_owned(),
                other => format!("it calls itself {other:?}: only PX4 and ArduPilot Copter can be flown"),
            };
            return Some(format!("the vehicle file says firmware = {key:?}, but {other}"));
        }
        // ArduPilot numbers the modes of each kind of vehicle anew: what is GUIDED for a copter is ACRO for a plane.
        let copter = COPTERS.contains(&heard.vehicle);
        (matches!(self, Self::ArduPilot(_)) && !copter)
            .then(|| format!("it is ArduPilot, but no multicopter ({:?}): only Copter can be flown", heard.vehicle))
    }
}

/// ArduPilot's bit mask of options of the guided modes.
pub const GUIDED_OPTIONS: &str = "GUID_OPTIONS";
/// The bit of [`GUIDED_OPTIONS`] that makes SET_ATTITUDE_TARGET's thrust a thrust. Without it 0.5 holds the height and
/// more or less than that climbs or sinks.
pub const THRUST_AS_THRUST: i32 = 8;
/// PX4 tells its battery unasked; ArduPilot only what is asked for, or set for the port. Chosen by eye.
const BATTERY_HZ: f64 = 2.0;
/// The kinds of vehicle that are flown.
const COPTERS: [MavType; 7] = [
    MavType::MAV_TYPE_QUADROTOR,
    MavType::MAV_TYPE_HEXAROTOR,
    MavType::MAV_TYPE_OCTOROTOR,
    MavType::MAV_TYPE_TRICOPTER,
    MavType::MAV_TYPE_COAXIAL,
    MavType::MAV_TYPE_DODECAROTOR,
    MavType::MAV_TYPE_DECAROTOR,
];

impl fmt::Display for Firmware {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Px4 => "PX4",
            Self::ArduPilot(_) => "ArduPilot",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_firmware_or_another_vehicle_is_told_with_what_to_set() {
        let quad = |autopilot| Identity { autopilot, vehicle: MavType::MAV_TYPE_QUADROTOR };
        let (px4, ardupilot) = (MavAutopilot::MAV_AUTOPILOT_PX4, MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA);
        let guided = Firmware::ArduPilot(Guided::Guided);
        assert_eq!(Firmware::Px4.mismatch(quad(px4)), None);
        assert_eq!(guided.mismatch(quad(ardupilot)), None);
        assert!(Firmware::Px4.mismatch(quad(ardupilot)).unwrap().contains("set firmware = \"ardupilot\""));
        assert!(guided.mismatch(quad(px4)).unwrap().contains("set firmware = \"px4\""));
        let generic = quad(MavAutopilot::MAV_AUTOPILOT_GENERIC);
        assert!(Firmware::Px4.mismatch(generic).unwrap().contains("only PX4 and ArduPilot"));
        let plane = Identity { vehicle: MavType::MAV_TYPE_FIXED_WING, ..quad(ardupilot) };
        assert!(guided.mismatch(plane).unwrap().contains("no multicopter"));
    }
}
