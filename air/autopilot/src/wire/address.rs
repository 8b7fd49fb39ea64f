//! Where the autopilot is reached, as an operator writes it: `udpin:`, `udpout:`, `tcpin:`, `tcpout:` or `serial:`.

use std::fmt;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::str::FromStr;

/// A line to the autopilot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// Listen on UDP; who may be the peer, [`crate::wire::peers`] says.
    UdpIn(SocketAddr),
    /// Send to a UDP peer, `HOST:PORT`, from any port.
    UdpOut(String),
    /// Listen on TCP for one peer at a time.
    TcpIn(SocketAddr),
    /// Connect to a TCP peer, `HOST:PORT`.
    TcpOut(String),
    /// A serial port: 8 data bits, no parity, one stop bit, no flow control.
    Serial {
        /// The device.
        device: PathBuf,
        /// Bits a second.
        baud: u32,
    },
}

/// Slowest and fastest serial port that is believed, bit/s.
const BAUD: std::ops::RangeInclusive<u32> = 9_600..=12_500_000;

/// A text that names no line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{text:?} {why}; write udpin:ADDRESS:PORT, udpout:HOST:PORT, tcpin:ADDRESS:PORT, tcpout:HOST:PORT or \
     serial:DEVICE:BAUD, such as udpin:0.0.0.0:14540 or serial:/dev/ttyACM0:921600"
)]
pub struct AddressError {
    text: String,
    why: &'static str,
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let error = |why| AddressError { text: text.to_owned(), why };
        let (kind, rest) = text.split_once(':').ok_or(error("names no kind of line"))?;
        let numeric = || rest.parse().map_err(|_| error("needs a numeric local address and a port"));
        let named = || {
            let parts = rest.rsplit_once(':').filter(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok());
            parts.map(|_| rest.to_owned()).ok_or(error("needs a host and a port"))
        };
        match kind {
            "udpin" => Ok(Self::UdpIn(numeric()?)),
            "tcpin" => Ok(Self::TcpIn(numeric()?)),
            "udpout" => Ok(Self::UdpOut(named()?)),
            "tcpout" => Ok(Self::TcpOut(named()?)),
            "serial" => {
                let (device, baud) = rest.rsplit_once(':').ok_or(error("needs a device and its speed"))?;
                let baud = baud.parse().ok().filter(|baud| BAUD.contains(baud));
                let baud = baud.ok_or(error("needs a speed of 9600 to 12500000 bit/s after the device"))?;
                if !device.starts_with('/') {
                    return Err(error("needs the device's whole path"));
                }
                Ok(Self::Serial { device: device.into(), baud })
            }
            _ => Err(error("begins with no kind of line that is known")),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UdpIn(address) => write!(f, "udpin:{address}"),
            Self::UdpOut(peer) => write!(f, "udpout:{peer}"),
            Self::TcpIn(address) => write!(f, "tcpin:{address}"),
            Self::TcpOut(peer) => write!(f, "tcpout:{peer}"),
            Self::Serial { device, baud } => write!(f, "serial:{}:{baud}", device.display()),
        }
    }
}

/// Where messages go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Peer {
    /// A UDP address, configured or learned.
    Udp(SocketAddr),
    /// Whoever is at the other end of the serial port or of the TCP connection.
    Line,
}

impl fmt::Display for Peer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udp(address) => address.fmt(f),
            Self::Line => f.write_str("the other end of the line"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_line_is_read_and_written_back() {
        for text in [
            "udpin:0.0.0.0:14540",
            "udpin:[::1]:14540",
            "udpout:px4.local:14580",
            "udpout:192.168.0.4:14550",
            "tcpin:127.0.0.1:5760",
            "tcpout:localhost:5762",
            "serial:/dev/ttyACM0:921600",
            "serial:/dev/serial/by-id/usb-Holybro_Pixhawk6C-if00:115200",
            "serial:/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0:57600",
        ] {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn a_text_that_names_no_line_is_told_why_and_how_to_write_it() {
        for (text, why) in [
            ("", "no kind of line"),
            ("127.0.0.1:14540", "no kind of line that is known"),
            ("udp:127.0.0.1:14540", "no kind of line that is known"),
            ("udpin:14540", "numeric local address"),
            ("udpin:localhost:14540", "numeric local address"),
            ("udpout:192.168.0.4", "host and a port"),
            ("tcpout::5760", "host and a port"),
            ("tcpout:host:99999", "host and a port"),
            ("serial:/dev/ttyACM0", "device and its speed"),
            ("serial:/dev/ttyACM0:fast", "speed of 9600"),
            ("serial:/dev/ttyACM0:300", "speed of 9600"),
            ("serial:ttyACM0:115200", "whole path"),
        ] {
            let error = text.parse::<Address>().unwrap_err().to_string();
            assert!(error.contains(why) && error.contains("serial:DEVICE:BAUD"), "{text}: {error}");
            assert_eq!(error.lines().count(), 1);
        }
    }
}
