//! Who may do what: from the vehicle file's `[network]`, the vehicle's identity and the roles of the key table, what
//! Zenoh is to ask of whoever connects.
//!
//! Zenoh drops what a peer may not send before it reaches a handler here. Only what comes in is judged: what goes out
//! goes to a subscriber or an asker, which was judged when it declared itself or asked.

mod identity;
mod rules;

use std::fs::Permissions;
use std::net::{IpAddr, SocketAddr};
use std::os::unix::fs::PermissionsExt as _;

use goshawk_bus::{Bus, BusError};
use goshawk_proto::keys::VehicleName;
use goshawk_vehicle::config::Vehicle;
use serde_json::{Value, json};
use zenoh_link_tls::ADMITTED;

pub use identity::{Identity, IdentityError};

/// What `insecure = true` means.
pub const INSECURE: &str = "INSECURE: whoever reaches the vehicle's port may start and stop it, for the vehicle file says \
                            insecure = true; make identities with `goshawk keys pair`";
/// Owner and group may connect to the sensors' socket, nobody else.
const SOCKET_MODE: u32 = 0o660;
/// A handshake that is not over by then is given up, ms: two round trips of a slow link take 2 s.
const HANDSHAKE_MS: u32 = 5000;
/// The largest message, bytes: the largest image that is looked at, 1920 x 1200, has 11.5 MB. A larger message is given
/// up while it comes.
const LARGEST_MESSAGE: usize = 16 << 20;
/// The largest command or ping, bytes.
const LARGEST_QUESTION: usize = 4096;
/// Most questions of a kind that one peer is listened to for, Hz: a ground repeats a command twice a second.
const QUESTIONS_HZ: f64 = 50.0;

/// Why the vehicle may not listen as its file says.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// Whoever reaches the port could fly the vehicle.
    #[error(
        "network.listen {0}: whoever reaches it could start and stop the vehicle. Make an identity with `goshawk keys \
         pair`, name it as network.identity and listen on tls/…; or listen on 127.0.0.1 alone"
    )]
    Open(String),
    /// Encrypted, but without an identity.
    #[error("network.listen {0} needs network.identity: make one with `goshawk keys pair`")]
    NoIdentity(String),
    /// With an identity nothing else may listen.
    #[error("network.listen {0} asks nobody who they are: with network.identity it must be tls/ or unixsock-stream/")]
    BesideIdentity(String),
    /// The identity cannot be used.
    #[error(transparent)]
    Identity(#[from] IdentityError),
}

/// How the listeners are guarded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Guard {
    /// Only this host can connect, and all of it may.
    ThisHost,
    /// Peers show a certificate; this host's sensors use a unix socket.
    Identity(Identity),
    /// Whoever connects is an operator: the vehicle file says `insecure = true`.
    Nobody,
}

/// What the vehicle listens on, and what it asks of whoever connects.
#[derive(Clone, Debug)]
pub struct Access {
    vehicle: VehicleName,
    listen: Vec<String>,
    guard: Guard,
}

impl Access {
    /// What the vehicle file asks for.
    ///
    /// # Errors
    /// Strangers could fly the vehicle, or the identity cannot be used.
    pub fn new(vehicle: &Vehicle, name: VehicleName) -> Result<Self, AccessError> {
        let network = &vehicle.network;
        let folder = network.identity.as_ref().map(|folder| vehicle.resolve(folder));
        let identity = folder.map(|folder| Identity::load(&folder, &name)).transpose()?;
        let guard = guard(&network.listen, network.insecure, identity)?;
        Ok(Access { vehicle: name, listen: network.listen.clone(), guard })
    }

    /// The vehicle's name.
    #[must_use]
    pub fn vehicle(&self) -> &VehicleName {
        &self.vehicle
    }

    /// How the listeners are guarded.
    #[must_use]
    pub fn guard(&self) -> &Guard {
        &self.guard
    }

    /// The endpoints, as the vehicle file has them.
    #[must_use]
    pub fn endpoints(&self) -> String {
        self.listen.join(", ")
    }

    /// Opens the session that listens so.
    ///
    /// # Errors
    /// An endpoint in use or malformed.
    pub fn listen(&self) -> Result<Bus, BusError> {
        let settings: Vec<_> = self.settings().into_iter().map(|(path, value)| (path, value.to_string())).collect();
        let bus = Bus::listen(self.vehicle.clone(), &self.endpoints(), &settings)?;
        for socket in self.listen.iter().filter_map(|endpoint| endpoint.strip_prefix("unixsock-stream/")) {
            // To connect is to write. Under a usual umask the sensors' drivers, which are in its group, could not.
            let path = socket.split(['?', '#']).next().unwrap_or(socket);
            if let Err(error) = std::fs::set_permissions(path, Permissions::from_mode(SOCKET_MODE)) {
                tracing::warn!("{path}: its group may not connect: {error}");
            }
        }
        Ok(bus)
    }

    /// Zenoh's settings, path and JSON.
    fn settings(&self) -> Vec<(&'static str, Value)> {
        let identity = if let Guard::Identity(identity) = &self.guard { Some(identity) } else { None };
        let mut settings = vec![
            ("listen/endpoints", json!(self.listen.iter().map(|e| endpoint(e, identity)).collect::<Vec<_>>())),
            ("connect/endpoints", json!([])),
            ("transport/unicast/accept_timeout", json!(2 * HANDSHAKE_MS)),
            ("transport/unicast/accept_pending", json!(4096)),
            ("transport/link/rx/max_message_size", json!(LARGEST_MESSAGE)),
            ("low_pass_filter", rules::low_pass(&self.vehicle, LARGEST_QUESTION)),
            ("downsampling", rules::downsampling(&self.vehicle, QUESTIONS_HZ)),
        ];
        match &self.guard {
            Guard::ThisHost => {}
            Guard::Nobody => settings.push(("access_control", rules::of_interfaces(&self.vehicle))),
            Guard::Identity(identity) => {
                settings.push(("transport/link/tls", identity.settings()));
                settings.push(("access_control", rules::of_identity(&self.vehicle, identity)));
            }
        }
        settings
    }
}

fn guard(listen: &[String], insecure: bool, identity: Option<Identity>) -> Result<Guard, AccessError> {
    for endpoint in listen {
        let own = local(endpoint);
        match (protocol(endpoint), &identity) {
            ("unixsock-stream", _) | ("tls", Some(_)) => {}
            ("tls", None) => return Err(AccessError::NoIdentity(endpoint.clone())),
            (_, Some(_)) => return Err(AccessError::BesideIdentity(endpoint.clone())),
            (_, None) if !own && !insecure => return Err(AccessError::Open(endpoint.clone())),
            (_, None) => {}
        }
    }
    Ok(match identity {
        Some(identity) => Guard::Identity(identity),
        None if listen.iter().all(|endpoint| local(endpoint)) => Guard::ThisHost,
        None => Guard::Nobody,
    })
}

fn protocol(endpoint: &str) -> &str {
    endpoint.split_once('/').map_or(endpoint, |(protocol, _)| protocol)
}

/// Only this host reaches the endpoint. A name is not looked up: `localhost` is one of this host, others are not.
fn local(endpoint: &str) -> bool {
    let Some((protocol, rest)) = endpoint.split_once('/') else { return false };
    let address = rest.split(['?', '#']).next().unwrap_or(rest);
    match protocol {
        "unixsock-stream" | "unixpipe" => true,
        _ => {
            let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
            let parsed = address.parse::<SocketAddr>().map(|a| a.ip()).or_else(|_| host.parse::<IpAddr>());
            host == "localhost" || parsed.is_ok_and(|ip| ip.is_loopback())
        }
    }
}

/// What to call a peer of this certificate's name and address. None: it is this host's own and showed no certificate.
pub(super) fn visitor(name: Option<&str>, address: &str) -> Option<String> {
    if name.is_none() && local(address) {
        return None;
    }
    // The port is another one each time.
    let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
    Some(name.map_or_else(|| host.to_owned(), |name| format!("{name} ({host})")))
}

/// A stranger's half-open handshake is soon forgotten, and who is not admitted gets no session.
fn endpoint(endpoint: &str, identity: Option<&Identity>) -> String {
    if protocol(endpoint) != "tls" {
        return endpoint.to_owned();
    }
    let (address, own) = endpoint.split_once('#').unwrap_or((endpoint, ""));
    let own = if own.is_empty() { format!("tls_handshake_timeout_ms={HANDSHAKE_MS}") } else { own.to_owned() };
    let admitted = identity.map(|identity| format!(";{ADMITTED}={}", identity.admitted().join("|")));
    format!("{address}#{own}{}", admitted.unwrap_or_default())
}

#[cfg(test)]
mod tests;
