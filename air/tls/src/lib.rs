//! Zenoh's TLS link for the vehicle: it takes connections in, from peers that show a certificate, and dials nobody.
//!
//! It stands in the place of the crate of the same name (`[patch.crates-io]` in the workspace's `Cargo.toml`), whose 1.10
//! reads and writes a link from two threads without a lock, though both change the same state of the connection: a peer
//! that is let in and breaks off while it is written to ends the process within seconds. It also takes in no connection
//! for a tenth of a second after each that fails, and tells of a failure without saying whose. Here
//!
//! - reads and writes of a link take turns (`link`);
//! - handshakes run beside each other, each in bounded time, and so many at most: the oldest gives way (`accept`);
//! - who is refused is told by address and by the name that it claims, under the target [`REFUSED`];
//! - an endpoint may say whose certificates are let in ([`ADMITTED`]): nobody else gets as far as Zenoh.
//!
//! The wire is Zenoh's own: any Zenoh client that has a certificate connects. Drop this crate when Zenoh's is sound.

mod accept;
mod certificate;
mod link;
mod settings;

use async_trait::async_trait;
use zenoh_link_commons::tcp::{TcpSocketConfig, get_tcp_addrs};
use zenoh_link_commons::{
    LinkManagerUnicastTrait, LinkUnicast, ListenersUnicastIP, LocatorInspector, NewLinkChannelSender,
};
use zenoh_protocol::core::{EndPoint, Locator};
use zenoh_result::{ZResult, bail, zerror};

pub use settings::{ADMITTED, TlsConfigurator};

/// The scheme of its endpoints.
pub const TLS_LOCATOR_PREFIX: &str = "tls";
/// The `tracing` target of refused connections. A message begins with the peer's IP address.
pub const REFUSED: &str = "goshawk::refused";

/// What Zenoh may know of a `tls/` locator.
#[derive(Clone, Copy, Debug, Default)]
pub struct TlsLocatorInspector;

#[async_trait]
impl LocatorInspector for TlsLocatorInspector {
    fn protocol(&self) -> &str {
        TLS_LOCATOR_PREFIX
    }

    async fn is_multicast(&self, _: &Locator) -> ZResult<bool> {
        Ok(false)
    }

    fn is_reliable(&self, _: &Locator) -> ZResult<bool> {
        Ok(true)
    }
}

/// Zenoh's handle of this kind of link.
#[derive(Debug)]
pub struct LinkManagerUnicastTls {
    links: NewLinkChannelSender,
    listeners: ListenersUnicastIP,
}

impl LinkManagerUnicastTls {
    /// New links go to `links`.
    #[must_use]
    pub fn new(links: NewLinkChannelSender) -> Self {
        LinkManagerUnicastTls { links, listeners: ListenersUnicastIP::new() }
    }
}

#[async_trait]
impl LinkManagerUnicastTrait for LinkManagerUnicastTls {
    async fn new_link(&self, endpoint: EndPoint) -> ZResult<LinkUnicast> {
        bail!("{endpoint}: this process listens by TLS and dials nobody by it")
    }

    async fn new_listener(&self, endpoint: EndPoint) -> ZResult<Locator> {
        let settings = settings::read(&endpoint.config())?;
        let Some(address) = get_tcp_addrs(endpoint.address()).await?.next() else {
            bail!("{endpoint} has no address");
        };
        let socket = TcpSocketConfig::new(settings.send_buffer, None, None, None, None);
        let (listener, local) = socket.new_listener(&address).map_err(|e| zerror!("{endpoint}: {e}"))?;
        let token = self.listeners.token.child_token();
        let task = accept::run(listener, settings.identity, self.links.clone(), settings.handshake, token.clone());
        let locator = Locator::new(endpoint.protocol(), local.to_string(), endpoint.metadata())?;
        let listed = EndPoint::new(locator.protocol(), locator.address(), locator.metadata(), endpoint.config())?;
        self.listeners.add_listener(listed, local, task, token).await?;
        Ok(locator)
    }

    async fn del_listener(&self, endpoint: &EndPoint) -> ZResult<()> {
        match get_tcp_addrs(endpoint.address()).await?.next() {
            Some(address) => self.listeners.del_listener(address).await,
            None => bail!("{endpoint} has no address"),
        }
    }

    async fn get_listeners(&self) -> Vec<EndPoint> {
        self.listeners.get_endpoints()
    }

    async fn get_locators(&self) -> Vec<Locator> {
        self.listeners.get_locators()
    }

    async fn get_locators_noloopback(&self) -> Vec<Locator> {
        self.listeners.get_locators_noloopback()
    }
}
