//! Our node among those of rmw_zenoh: a session like theirs, publishers and subscriptions with their tokens.

use std::marker::PhantomData;
use std::sync::atomic::{AtomicI64, Ordering};

use serde::Serialize;
use zenoh::Wait;
use zenoh::handlers::{IntoHandler, RingChannel, RingChannelHandler};
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::CongestionControl;
use zenoh::sample::Sample;

use crate::config;
use crate::wire::cdr;
use crate::wire::clock::Clocks;
use crate::wire::graph::{self, End, Node, Topic};
use crate::wire::messages::Message;

/// Why the node cannot be.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// Zenoh refused the session.
    #[error("cannot dial ros.connect {endpoint}: {cause}; an endpoint is such as tcp/127.0.0.1:7447")]
    Dial {
        /// The endpoint asked for.
        endpoint: String,
        /// Zenoh's words.
        cause: String,
    },
    /// Zenoh refused a declaration.
    #[error("cannot declare {key}: {cause}")]
    Declare {
        /// The key.
        key: String,
        /// Zenoh's words.
        cause: String,
    },
}

/// The node, its session and its tokens: others see it until it is dropped.
pub struct RosNode {
    session: zenoh::Session,
    node: Node,
    tokens: Vec<LivelinessToken>,
}

impl RosNode {
    /// Opens a session that dials the router, again and again while it is away, and shows the node.
    ///
    /// # Errors
    /// The endpoint is malformed.
    pub fn open(ros: &config::Ros) -> Result<Self, NodeError> {
        let error = |cause: String| NodeError::Dial { endpoint: ros.connect.clone(), cause };
        ros.connect.parse::<zenoh::config::EndPoint>().map_err(|_| error("it is no endpoint".to_owned()))?;
        let endpoints = serde_json::to_string(&[&ros.connect]).map_err(|e| error(e.to_string()))?;
        let mut settings = zenoh::Config::default();
        // As rmw_zenoh's own nodes: peers that learn of each other by the router and then talk without it.
        for (path, value) in [
            ("mode", r#""peer""#),
            ("connect/endpoints", &endpoints),
            ("connect/timeout_ms", "-1"),
            ("connect/exit_on_failure", "false"),
            ("connect/retry", r#"{"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5}"#),
            ("listen/endpoints", r#"["tcp/127.0.0.1:0"]"#),
            ("scouting/multicast/enabled", "false"),
            ("transport/shared_memory/enabled", "false"),
        ] {
            settings.insert_json5(path, value).map_err(|e| error(format!("{path}: {e}")))?;
        }
        let session = zenoh::open(settings).wait().map_err(|e| error(e.to_string()))?;
        let node = Node {
            domain: ros.domain,
            session: session.zid().to_string(),
            name: ros.node.clone(),
            hashes: ros.type_hashes,
        };
        let mut opened = RosNode { session, node, tokens: Vec::new() };
        opened.show(opened.node.token())?;
        Ok(opened)
    }

    fn show(&mut self, token: String) -> Result<(), NodeError> {
        let declared = self.session.liveliness().declare_token(token.clone()).wait();
        self.tokens.push(declared.map_err(|e| NodeError::Declare { key: token, cause: e.to_string() })?);
        Ok(())
    }

    /// A publisher of `topic`, which others see.
    ///
    /// # Errors
    /// Zenoh refused it.
    pub fn publisher<M: Message>(&mut self, topic: &str) -> Result<Publisher<M>, NodeError> {
        let topic = Topic::of::<M>(topic);
        let key = self.node.key(&topic);
        let declared = self.session.declare_publisher(key.clone()).congestion_control(CongestionControl::Drop).wait();
        let inner = declared.map_err(|e| NodeError::Declare { key, cause: e.to_string() })?;
        let token = self.node.end_token(self.tokens.len() as u32, End::Publisher, &topic);
        let gid = graph::gid(&token);
        self.show(token)?;
        Ok(Publisher { inner, gid, sent: AtomicI64::new(0), of: PhantomData })
    }

    /// The newest messages of `topic`, of any release of ROS 2; no more than `waiting` of them wait.
    ///
    /// # Errors
    /// Zenoh refused it.
    pub fn subscribe<M: Message>(&mut self, topic: &str, waiting: usize) -> Result<Subscription, NodeError> {
        let topic = Topic::of::<M>(topic);
        let (put, newest) = RingChannel::new(waiting).into_handler();
        let mut ends = Vec::new();
        for key in self.node.heard_on(&topic) {
            let declared = self.session.declare_subscriber(key.clone()).with((put.clone(), ())).wait();
            ends.push(declared.map_err(|e| NodeError::Declare { key, cause: e.to_string() })?);
        }
        self.show(self.node.end_token(self.tokens.len() as u32, End::Subscription, &topic))?;
        Ok(Subscription { newest, _ends: ends })
    }

    /// Takes the node and all that it has from the network.
    pub fn close(self) {
        drop(self.tokens);
        if let Err(cause) = self.session.close().wait() {
            tracing::debug!("the ROS 2 session did not close: {cause}");
        }
    }
}

/// What comes on a topic, on whichever of its keys.
pub struct Subscription {
    newest: RingChannelHandler<Sample>,
    _ends: Vec<zenoh::pubsub::Subscriber<()>>,
}

impl Subscription {
    /// Waits for the next message; none: the session is closed.
    #[must_use]
    pub fn recv(&self) -> Option<Sample> {
        self.newest.recv().ok()
    }
}

/// Publishes messages of one type.
pub struct Publisher<M> {
    inner: zenoh::pubsub::Publisher<'static>,
    gid: [u8; 16],
    sent: AtomicI64,
    of: PhantomData<fn(M)>,
}

impl<M: Message + Serialize> Publisher<M> {
    /// Publishes `message`; a network that does not take it loses it.
    pub fn put(&self, message: &M) {
        let sequence = 1 + self.sent.fetch_add(1, Ordering::Relaxed);
        let attachment = graph::attachment(sequence, &Clocks::now(), &self.gid);
        if let Err(cause) = self.inner.put(cdr::encode(message)).attachment(attachment.as_slice()).wait() {
            tracing::debug!("{} was not sent: {cause}", self.inner.key_expr());
        }
    }
}
