//! The Zenoh session: explicit endpoints only, and publishers made from the shared key table.

use std::hash::{DefaultHasher, Hash, Hasher};

use goshawk_proto::keys::{Congestion, Key, Priority as KeyPriority, VehicleName};
use prost::Message;
use zenoh::Wait;
use zenoh::bytes::Encoding;
use zenoh::qos::{CongestionControl, Priority};

/// Why the network could not be set up.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// Zenoh refused: commonly a port in use or an endpoint that does not parse.
    #[error("cannot listen on {endpoints}: {cause}; is another goshawk-air running, or is the endpoint misspelt?")]
    Listen {
        /// The endpoints asked for.
        endpoints: String,
        /// Zenoh's own words.
        cause: String,
    },
    /// The endpoint to dial cannot be one.
    #[error("cannot dial {endpoint}: {cause}; an endpoint is such as tls/192.168.1.7:7447")]
    Dial {
        /// The endpoint asked for.
        endpoint: String,
        /// Zenoh's own words.
        cause: String,
    },
    /// A declaration failed.
    #[error("cannot declare {key}: {cause}")]
    Declare {
        /// The key expression.
        key: String,
        /// Zenoh's own words.
        cause: String,
    },
}

/// For a link that carries less than we say. Left to itself the kernel keeps megabytes for it and Zenoh a hundred kB of each
/// urgency, so that the ground sees what was many seconds ago; and the sender waits for it, 1 ms a message and 50 ms an
/// image, from which every other ground and the log suffer. Here 16 kB wait in either, an eighth of a second of telemetry,
/// and what does not fit is dropped at once.
const WEAK_LINK: [(&str, &str); 8] = [
    ("transport/link/tcp/so_sndbuf", "16384"),
    ("transport/link/tx/batch_size", "4096"),
    ("transport/link/tx/queue/size/real_time", "4"),
    ("transport/link/tx/queue/size/interactive_high", "4"),
    ("transport/link/tx/queue/size/interactive_low", "4"),
    ("transport/link/tx/queue/size/background", "8"),
    ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", "0"),
    ("transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments", "0"),
];

/// Whose link came.
pub struct Link<'a> {
    /// Zenoh's number of the peer.
    pub id: String,
    /// The common name of its certificate; none: it showed none.
    pub name: Option<&'a str>,
    /// Where it is.
    pub address: &'a str,
}

/// An open session with the vehicle's name.
pub struct Bus {
    session: zenoh::Session,
    vehicle: VehicleName,
}

impl Bus {
    /// Opens the session of `vehicle` that listens on `endpoints`, as Zenoh's `settings` (path and JSON) say, and dials
    /// nobody.
    ///
    /// # Errors
    /// An endpoint in use or malformed.
    pub fn listen(vehicle: VehicleName, endpoints: &str, settings: &[(&str, String)]) -> Result<Self, BusError> {
        let error = |cause| BusError::Listen { endpoints: endpoints.to_owned(), cause };
        let own = settings.iter().map(|(path, value)| (*path, value.as_str()));
        // What killed processes of this host left in /dev/shm; a segment that somebody still holds stays.
        zenoh::shm::cleanup_orphaned_shm_segments();
        let session = open(&own.chain(WEAK_LINK).collect::<Vec<_>>()).map_err(error)?;
        Ok(Bus { session, vehicle })
    }

    /// Opens a session that dials `endpoint`, listens nowhere, and keeps dialling whenever the other side is away.
    ///
    /// # Errors
    /// The endpoint is malformed.
    pub fn dial(vehicle: VehicleName, endpoint: &str) -> Result<Self, BusError> {
        let error = |cause| BusError::Dial { endpoint: endpoint.to_owned(), cause };
        let listed = serde_json::to_string(&[endpoint]).map_err(|e| error(e.to_string()))?;
        let session = open(&[
            ("connect/endpoints", &listed),
            ("connect/timeout_ms", "-1"),
            ("connect/exit_on_failure", "false"),
            ("connect/retry", r#"{"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5}"#),
            ("listen/endpoints", "[]"),
        ])
        .map_err(error)?;
        Ok(Bus { session, vehicle })
    }

    /// A publisher with the key's QoS.
    ///
    /// # Errors
    /// Zenoh refused the declaration.
    pub fn publisher(&self, key: Key) -> Result<Publisher, BusError> {
        let expression = key.expression(&self.vehicle);
        let row = key.row();
        self.session
            .declare_publisher(expression.clone())
            .encoding(row.message.map_or(Encoding::ZENOH_BYTES, |full| {
                // Without the package: its name would be 2 kB of each second's telemetry.
                Encoding::APPLICATION_PROTOBUF.with_schema(bare(full))
            }))
            .priority(priority(row.priority))
            .congestion_control(if row.congestion == Congestion::Block {
                CongestionControl::Block
            } else {
                CongestionControl::Drop
            })
            .express(row.express)
            .wait()
            .map(|inner| Publisher { inner, buffer: Vec::with_capacity(4096) })
            .map_err(|e| BusError::Declare { key: expression, cause: e.to_string() })
    }

    /// Calls `receive` with each payload on `key` and a number for its publisher (0: it does not say), on Zenoh's receive thread: it must be quick.
    ///
    /// # Errors
    /// Zenoh refused the declaration.
    pub fn subscribe(&self, key: Key, receive: impl Fn(&[u8], u64) + Send + Sync + 'static) -> Result<(), BusError> {
        let expression = key.expression(&self.vehicle);
        let receive = move |sample: zenoh::sample::Sample| {
            if !names_another(key, Some(sample.encoding())) {
                receive(&sample.payload().to_bytes(), source(&sample));
            }
        };
        self.session
            .declare_subscriber(expression.clone())
            .callback(receive)
            .background()
            .wait()
            .map_err(|e| BusError::Declare { key: expression, cause: e.to_string() })
    }

    /// Calls `answer` with each query on `key`, on Zenoh's receive thread: hand the query on.
    ///
    /// # Errors
    /// Zenoh refused the declaration.
    pub fn queryable(
        &self,
        key: Key,
        answer: impl Fn(zenoh::query::Query) + Send + Sync + 'static,
    ) -> Result<(), BusError> {
        let expression = key.expression(&self.vehicle);
        self.session
            .declare_queryable(expression.clone())
            .complete(true)
            .callback(answer)
            .background()
            .wait()
            .map_err(|e| BusError::Declare { key: expression, cause: e.to_string() })
    }

    /// Calls `came` and `went` as links come and go.
    ///
    /// # Errors
    /// Zenoh refused the declaration.
    pub fn watch_links(
        &self,
        came: impl Fn(Link<'_>) + Send + Sync + 'static,
        went: impl Fn(&str) + Send + Sync + 'static,
    ) -> Result<(), BusError> {
        self.session
            .info()
            .link_events_listener()
            .history(true)
            .callback(move |event| {
                let id = event.link().zid().to_string();
                if event.kind() == zenoh::sample::SampleKind::Delete {
                    return went(&id);
                }
                let (name, address) = (event.link().auth_identifier(), event.link().dst().to_string());
                came(Link { id, name, address: &address });
            })
            .background()
            .wait()
            .map_err(|e| BusError::Declare { key: "the links' events".to_owned(), cause: e.to_string() })
    }

    /// Shows this vehicle as alive until the token is dropped.
    ///
    /// # Errors
    /// Zenoh refused the declaration.
    pub fn declare_alive(&self) -> Result<zenoh::liveliness::LivelinessToken, BusError> {
        let expression = Key::AliveAir.expression(&self.vehicle);
        self.session
            .liveliness()
            .declare_token(expression.clone())
            .wait()
            .map_err(|e| BusError::Declare { key: expression, cause: e.to_string() })
    }
}

/// A payload says that it is another message than `key`'s. One that does not say may be it. When a link breaks and comes
/// again at once, Zenoh 1.10 may hand on messages under another key for a while: the numbers that stand for keys are those
/// of the link before.
#[must_use]
pub fn names_another(key: Key, encoding: Option<&Encoding>) -> bool {
    let (Some(told), Some(expected)) = (encoding, key.row().message) else { return false };
    let told = told.to_string();
    let named = told.strip_prefix("application/protobuf;");
    named.is_some_and(|name| name != bare(expected) && name != expected)
}

/// A message's name without its package.
fn bare(full: &str) -> &str {
    full.rsplit_once('.').map_or(full, |(_, name)| name)
}

/// A number for a sample's publisher; 0: it does not say.
fn source(sample: &zenoh::sample::Sample) -> u64 {
    sample.source_info().map_or(0, |info| {
        let mut hasher = DefaultHasher::new();
        info.source_id().hash(&mut hasher);
        hasher.finish().max(1)
    })
}

/// A declared publisher and its encoding buffer.
pub struct Publisher {
    inner: zenoh::pubsub::Publisher<'static>,
    buffer: Vec<u8>,
}

impl Publisher {
    /// Publishes `message`; returns its encoded size, or None if Zenoh refused it.
    pub fn put(&mut self, message: &impl Message) -> Option<usize> {
        self.buffer.clear();
        message.encode(&mut self.buffer).ok()?;
        self.inner.put(self.buffer.as_slice()).wait().ok()?;
        Some(self.buffer.len())
    }

    /// Somebody subscribes to it; true where that cannot be told.
    #[must_use]
    pub fn is_wanted(&self) -> bool {
        self.inner.matching_status().wait().map_or(true, |status| status.matching())
    }
}

// What both sides have in common: no multicast, no connections made by gossip, a lease of 2 s, no shared memory.
fn open(own: &[(&str, &str)]) -> Result<zenoh::Session, String> {
    let mut config = zenoh::Config::default();
    let common = [
        ("mode", r#""peer""#),
        ("listen/exit_on_failure", "true"),
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/autoconnect", r#"{"router": [], "peer": []}"#),
        ("transport/link/tx/lease", "2000"),
        // Zenoh never unmaps the segment of a publisher that went: 17 MB and two descriptors for each restart of the
        // camera's process, for good. Over loopback an image costs no time that can be told beside the network's.
        ("transport/shared_memory/enabled", "false"),
    ];
    for (path, value) in common.iter().chain(own) {
        config.insert_json5(path, value).map_err(|e| refused(path, &e.to_string()))?;
    }
    zenoh::open(config).wait().map_err(|e| without_source_places(&without_settings(&e.to_string())))
}

/// Of an endpoint Zenoh shows where it stands in its own settings, which nobody wrote.
fn refused(path: &str, cause: &str) -> String {
    if path.ends_with("/endpoints") {
        "it is no endpoint".to_owned()
    } else {
        format!("{path}: {}", without_source_places(cause))
    }
}

/// Zenoh's errors name an endpoint with all its settings (`tls/…#so_sndbuf=16384;…`).
fn without_settings(cause: &str) -> String {
    let bare = |word: &str| match word.split_once('#') {
        Some((endpoint, settings)) if endpoint.contains('/') => {
            format!("{endpoint}{}", if settings.ends_with(':') { ":" } else { "" })
        }
        _ => word.to_owned(),
    };
    cause.split_whitespace().map(bare).collect::<Vec<_>>().join(" ")
}

/// Zenoh's errors name the source line of each layer (`… at /path/tcp.rs:61.]`): of no use to an operator.
fn without_source_places(cause: &str) -> String {
    let mut kept: Vec<String> = Vec::new();
    for word in cause.split_whitespace() {
        let Some((_, after)) = word.split_once(".rs:") else {
            kept.push(word.to_owned());
            continue;
        };
        if kept.last().is_some_and(|last| last == "at") {
            kept.pop();
        }
        if let Some(last) = kept.last_mut() {
            last.push_str(after.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.'));
        }
    }
    kept.join(" ")
}

fn priority(priority: KeyPriority) -> Priority {
    match priority {
        KeyPriority::RealTime => Priority::RealTime,
        KeyPriority::InteractiveHigh => Priority::InteractiveHigh,
        KeyPriority::InteractiveLow => Priority::InteractiveLow,
        KeyPriority::DataHigh => Priority::DataHigh,
        KeyPriority::Data => Priority::Data,
        KeyPriority::DataLow => Priority::DataLow,
        KeyPriority::Background => Priority::Background,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use goshawk_proto::v1;

    #[test]
    fn what_is_no_endpoint_is_one_line_without_zenohs_settings() {
        let vehicle = || "kite".parse::<VehicleName>().unwrap();
        let said = Bus::dial(vehicle(), "foo").err().unwrap().to_string();
        assert_eq!(said, "cannot dial foo: it is no endpoint; an endpoint is such as tls/192.168.1.7:7447");
        let listed = [("listen/endpoints", r#"["foo"]"#.to_owned())];
        let said = Bus::listen(vehicle(), "foo", &listed).err().unwrap().to_string();
        assert!(said.starts_with("cannot listen on foo: it is no endpoint; "), "{said}");
    }

    #[test]
    fn a_message_that_comes_under_another_key_is_known_by_its_name_and_left_out() {
        let vehicle = || "kite".parse::<VehicleName>().unwrap();
        let bus = Bus::listen(vehicle(), r#"["tcp/127.0.0.1:0"]"#, &[]).unwrap();
        let (heard, came) = std::sync::mpsc::channel();
        bus.subscribe(Key::Health, move |payload, _| heard.send(payload.to_vec()).unwrap()).unwrap();
        let key = Key::Health.expression(&vehicle());
        let put = |payload: &str, encoding| bus.session.put(&key, payload).encoding(encoding).wait().unwrap();
        put("another", Encoding::APPLICATION_PROTOBUF.with_schema("Event"));
        put("this", Encoding::APPLICATION_PROTOBUF.with_schema("goshawk.v1.Health"));
        put("not told", Encoding::default());
        put("not told either", Encoding::APPLICATION_PROTOBUF);
        let got: Vec<_> = (0..3).map(|_| came.recv().unwrap()).collect();
        assert_eq!(got, [b"this".to_vec(), b"not told".to_vec(), b"not told either".to_vec()]);
        let mut publisher = bus.publisher(Key::Health).unwrap();
        publisher.put(&v1::Health { seq: 7, ..Default::default() }).unwrap();
        assert_eq!(came.recv().unwrap(), [8, 7], "our own are not left out");
    }

    #[test]
    fn an_error_names_an_endpoint_without_its_settings() {
        let cause = "tls/127.0.0.1:1#so_sndbuf=16384;listen_private_key_file=/a/key.pem: Address in use";
        assert_eq!(without_settings(cause), "tls/127.0.0.1:1: Address in use");
    }

    #[test]
    fn an_error_names_no_source_line() {
        let cause =
            "bound to tcp/[::1]:7: [[::1]:7: Address in use (os error 98) at /a/tcp.rs:61.] at /b/unicast.rs:338.";
        assert_eq!(without_source_places(cause), "bound to tcp/[::1]:7: [[::1]:7: Address in use (os error 98)]");
    }
}
