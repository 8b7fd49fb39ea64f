//! Where the autopilot is, who we are, and what we ask to be told.

use crate::dialogue::firmware::Firmware;
use crate::dialogue::rates::StreamRates;
use crate::wire::address::Address;
use crate::wire::error::AutopilotError;
use crate::wire::peers::Pin;
use crate::wire::signing::SigningConfig;
use std::net::{IpAddr, SocketAddr};

/// As what our heartbeat introduces us.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HeartbeatKind {
    /// A companion computer. PX4 sends it no STATUSTEXT.
    #[default]
    OnboardController,
    /// A ground station: STATUSTEXT comes, but PX4 then counts its ground link as alive as long as we are.
    GroundStation,
}

/// Where the autopilot is and who we are.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkConfig {
    /// The line to it. PX4 sends to UDP 14540 unless told otherwise.
    pub address: Address,
    /// On `udpin:`, the only address that may be the autopilot's; none: see [`crate::wire::peers`].
    pub peer: Option<Pin>,
    /// Which autopilot it is to be.
    pub firmware: Firmware,
    /// What messages are signed with, and must be; none: signatures are not looked at.
    pub signing: Option<SigningConfig>,
    /// Our system id, by custom the vehicle's.
    pub system_id: u8,
    /// Our component id; 191 is the custom for a companion computer.
    pub component_id: u8,
    /// The autopilot's system id.
    pub target_system: u8,
    /// The autopilot's component id, 1 by custom. With a wrong one PX4 silently ignores everything.
    pub target_component: u8,
    /// As what we introduce ourselves.
    pub heartbeat: HeartbeatKind,
    /// What to ask for when contact is made.
    pub rates: StreamRates,
}

impl LinkConfig {
    /// The customary ids, listening for PX4 on UDP at `bind`.
    #[must_use]
    pub fn customary(bind: SocketAddr) -> Self {
        Self {
            address: Address::UdpIn(bind),
            peer: None,
            firmware: Firmware::default(),
            signing: None,
            system_id: 1,
            component_id: 191,
            target_system: 1,
            target_component: 1,
            heartbeat: HeartbeatKind::default(),
            rates: StreamRates::default(),
        }
    }

    /// Why others may pose as the autopilot, and what to do, in one sentence; none: the line is a wire, this computer's
    /// own, or signed.
    #[must_use]
    pub fn exposure(&self) -> Option<String> {
        let address = &self.address;
        let open = match address {
            Address::UdpIn(local) => !local.ip().is_loopback() && !self.peer.is_some_and(|peer| peer.is_loopback()),
            Address::UdpOut(host) => !on_this_computer(host),
            Address::TcpIn(local) => !local.ip().is_loopback(),
            Address::TcpOut(_) | Address::Serial { .. } => false,
        };
        if !open || self.signing.is_some() {
            return None;
        }
        let pin = match (address, self.peer) {
            (Address::UdpIn(_), None) => ", and `peer` to the autopilot's address",
            _ => "",
        };
        Some(format!(
            "MAVLink at {address} is not signed, so whoever reaches it can pose as the autopilot: set \
             signing_key_file{pin} under [autopilot]"
        ))
    }

    pub(crate) fn validate(&self) -> Result<(), AutopilotError> {
        let rates = &self.rates;
        let ids = [self.system_id, self.component_id, self.target_system, self.target_component];
        if ids.contains(&0) {
            return Err(AutopilotError::Config("system and component ids are 1 to 255; 0 means everyone".to_owned()));
        }
        if let (Some(peer), false) = (self.peer, matches!(self.address, Address::UdpIn(_))) {
            let address = &self.address;
            return Err(AutopilotError::Config(format!(
                "peer = \"{peer}\" is for a udpin: link, and {address} says itself who is at its other end: leave it out"
            )));
        }
        for hz in [rates.odometry_hz, rates.attitude_hz, rates.imu_hz, rates.state_hz] {
            if !(hz.is_finite() && hz > 0.0 && hz <= 1000.0) {
                return Err(AutopilotError::Config(format!("stream rate {hz} Hz is not above 0 and up to 1000")));
            }
        }
        Ok(())
    }
}

/// `HOST:PORT` is a loopback address, or this computer's customary name.
fn on_this_computer(host: &str) -> bool {
    let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
    let numeric = name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    numeric.map_or(name == "localhost", |ip| ip.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::signing::SigningKey;

    #[test]
    fn an_open_port_without_a_key_is_told_with_what_to_do() {
        let at = |address: &str, peer: Option<&str>| LinkConfig {
            address: address.parse().unwrap(),
            peer: peer.map(|peer| peer.parse().unwrap()),
            ..LinkConfig::customary("127.0.0.1:0".parse().unwrap())
        };
        for (address, peer, named) in [
            ("udpin:0.0.0.0:14540", None, "`peer`"),
            ("udpin:192.168.1.2:14540", None, "`peer`"),
            ("udpin:0.0.0.0:14540", Some("192.168.1.5"), "signing_key_file"),
            ("tcpin:0.0.0.0:5760", None, "signing_key_file"),
            ("udpout:px4.local:14580", None, "signing_key_file"),
            ("udpout:192.168.1.5:14580", None, "signing_key_file"),
        ] {
            let open = at(address, peer);
            let told = open.exposure().unwrap();
            assert!(told.contains(named) && told.contains("signing_key_file") && told.contains(address), "{told}");
            assert_eq!(told.contains("`peer`"), named == "`peer`", "{told}");
            let signing = Some(SigningConfig { key: SigningKey::new([7; 32]), stamps: None });
            assert_eq!(LinkConfig { signing, ..open }.exposure(), None, "{address}");
        }
        for (address, peer) in [
            ("udpin:127.0.0.1:14540", None),
            ("udpin:[::1]:14540", None),
            ("udpin:0.0.0.0:14540", Some("127.0.0.1")),
            ("udpout:localhost:14580", None),
            ("udpout:127.0.0.1:14580", None),
            ("udpout:[::1]:14580", None),
            ("tcpin:127.0.0.1:5760", None),
            ("tcpout:192.168.1.5:5760", None),
            ("serial:/dev/ttyACM0:921600", None),
        ] {
            assert_eq!(at(address, peer).exposure(), None, "{address}");
        }
    }

    #[test]
    fn a_peer_is_for_a_port_that_listens() {
        let config = LinkConfig {
            address: "udpout:192.168.1.5:14580".parse().unwrap(),
            peer: Some("192.168.1.5".parse().unwrap()),
            ..LinkConfig::customary("127.0.0.1:0".parse().unwrap())
        };
        assert!(config.validate().unwrap_err().to_string().contains("leave it out"));
    }
}
