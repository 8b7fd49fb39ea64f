//! The vehicle file's `[autopilot]`: which one it is, and the line to it.

use std::fmt::Display;
use std::path::PathBuf;
use std::str::FromStr;

use goshawk_autopilot::{Address, Firmware, Guided, Pin, VisionMessage};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer};

use super::sections::OdometrySource;

/// Where the autopilot is, which one it is, and who we are.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Autopilot {
    /// The line to it: udpin:ADDRESS:PORT, udpout:, tcpin:, tcpout:, or serial:DEVICE:BAUD.
    #[serde(deserialize_with = "parsed")]
    #[schemars(with = "String")]
    pub link: Address,
    /// On `udpin:`, the only address that may be the autopilot's, with or without its port; absent: whoever speaks first
    /// with its ids.
    #[serde(default, deserialize_with = "parsed_if_any")]
    #[schemars(with = "Option<String>")]
    pub peer: Option<Pin>,
    /// Which autopilot it is.
    #[serde(default)]
    firmware: FirmwareName,
    /// Which mode takes our setpoints, of ArduPilot alone; absent: guided.
    guided: Option<GuidedName>,
    /// Our MAVLink system: the vehicle's own, as an onboard computer.
    #[schemars(range(min = 1, max = 255), extend("x-why" = "in MAVLink 0 is everybody, and a number has one byte", "x-source" = "the autopilot's own; shipped: PX4's default"))]
    pub system_id: u8,
    /// Our MAVLink component; 191 is an onboard computer.
    #[schemars(range(min = 1, max = 255), extend("x-why" = "in MAVLink 0 is everybody, and a number has one byte", "x-source" = "MAVLink's MAV_COMP_ID_ONBOARD_COMPUTER"))]
    pub component_id: u8,
    /// The autopilot's MAVLink system.
    #[schemars(range(min = 0, max = 255), extend("x-why" = "in MAVLink a number has one byte", "x-source" = "the autopilot's own; shipped: PX4's default"))]
    pub target_system: u8,
    /// The autopilot's MAVLink component.
    #[schemars(range(min = 0, max = 255), extend("x-why" = "in MAVLink a number has one byte", "x-source" = "the autopilot's own; shipped: PX4's default"))]
    pub target_component: u8,
    /// The key of MAVLink 2 signing, 32 bytes, relative to this file; absent: nothing is signed.
    pub signing_key_file: Option<PathBuf>,
    /// The message by which the odometry of `in/odometry` goes on to the autopilot's own estimator; absent: it does not.
    vision: Option<VisionName>,
}

#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
enum VisionName {
    Odometry,
    VisionPositionEstimate,
}

#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
enum FirmwareName {
    #[default]
    Px4,
    ArduPilot,
}

#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
enum GuidedName {
    Guided,
    GuidedNogps,
}

impl Autopilot {
    /// The firmware that is to be flown.
    #[must_use]
    pub fn firmware(&self) -> Firmware {
        match (self.firmware, self.guided) {
            (FirmwareName::Px4, _) => Firmware::Px4,
            (FirmwareName::ArduPilot, None | Some(GuidedName::Guided)) => Firmware::ArduPilot(Guided::Guided),
            (FirmwareName::ArduPilot, Some(GuidedName::GuidedNogps)) => Firmware::ArduPilot(Guided::NoGps),
        }
    }

    /// The message by which odometry of our own goes on to the autopilot, if it does.
    #[must_use]
    pub fn vision(&self) -> Option<VisionMessage> {
        self.vision.map(|name| match name {
            VisionName::Odometry => VisionMessage::Odometry,
            VisionName::VisionPositionEstimate => VisionMessage::PositionEstimate,
        })
    }

    /// Checks what its keys do not say alone; `rate_hz`: setpoints a second.
    pub(super) fn validate(&self, rate_hz: f64, odometry: OdometrySource) -> Result<(), String> {
        if self.firmware == FirmwareName::Px4 && self.guided.is_some() {
            return Err(
                "autopilot.guided is a mode of ArduPilot: set firmware = \"ardupilot\" or leave it out".to_owned()
            );
        }
        if self.peer.is_some() && !matches!(self.link, Address::UdpIn(_)) {
            return Err(
                "autopilot.peer is for a udpin: link, others name their other end themselves: leave it out".to_owned()
            );
        }
        if self.vision.is_some() && odometry != OdometrySource::Zenoh {
            return Err("autopilot.vision sends odometry of our own: set sensors.odometry = \"zenoh\" or leave it out"
                .to_owned());
        }
        if let Address::Serial { baud, .. } = self.link {
            let (what, vision) =
                if self.vision.is_some() { (" and odometry", VISION_BYTES * VISION_HZ) } else { ("", 0.0) };
            let needed = (rate_hz * SETPOINT_BYTES + vision) * SERIAL_BITS / SERIAL_SHARE;
            if f64::from(baud) < needed {
                return Err(format!(
                    "autopilot.link: {baud} bit/s is too slow for {rate_hz} setpoints a second{what}, which need {needed:.0}: \
                     raise the port's speed (921600 is usual), here and in the autopilot"
                ));
            }
        }
        Ok(())
    }
}

/// A signed SET_ATTITUDE_TARGET.
const SETPOINT_BYTES: f64 = 64.0;
/// A signed ODOMETRY, the larger of the two that carry odometry of ours.
const VISION_BYTES: f64 = 258.0;
/// Odometry of ours that goes on to the autopilot, most a second: PX4 asks for 30 to 50.
pub const VISION_HZ: f64 = 50.0;
/// On a serial line a byte takes a start and a stop bit.
const SERIAL_BITS: f64 = 10.0;
/// Of a serial line's speed, for setpoints at most: beside them go answers and questions. Chosen by eye.
const SERIAL_SHARE: f64 = 0.8;

fn parsed<'de, T: FromStr<Err: Display>, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
}

fn parsed_if_any<'de, T: FromStr<Err: Display>, D: Deserializer<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    parsed(deserializer).map(Some)
}
