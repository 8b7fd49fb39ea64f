//! One link. The stream is split, so that a lock makes reads and writes take turns: each holds it only while it works on
//! what is there, never while it waits.

use std::net::SocketAddr;
use std::sync::{Arc, Weak};
use std::time::{Duration, SystemTime};

use async_trait::async_trait;
use tokio::io::{AsyncReadExt, AsyncWriteExt, ReadHalf, WriteHalf};
use tokio::net::TcpStream;
use tokio::sync::Mutex;
use tokio_rustls::server::TlsStream;
use tokio_util::sync::CancellationToken;
use zenoh_link_commons::{LinkAuthId, LinkUnicastTrait, get_ip_interface_names};
use zenoh_protocol::core::{Locator, Priority};
use zenoh_protocol::transport::BatchSize;
use zenoh_result::{ZResult, zerror};
use zenoh_runtime::ZRuntime;

use crate::TLS_LOCATOR_PREFIX;
use crate::certificate::{Holder, holder};

/// What may wait inside a link besides its socket, bytes: one record.
const WAITING: usize = 16_384;
/// A farewell that the peer does not take is not waited for longer.
const FAREWELL: Duration = Duration::from_millis(200);
/// The clock is looked at so often while a certificate ages: it may be set.
const CLOCK: Duration = Duration::from_mins(1);

pub(crate) struct Link {
    reader: Mutex<ReadHalf<TlsStream<TcpStream>>>,
    writer: Mutex<WriteHalf<TlsStream<TcpStream>>>,
    local: (SocketAddr, Locator),
    remote: Locator,
    peer: LinkAuthId,
    /// Cancelled when the link is closed, by Zenoh or by the end of the peer's certificate.
    closed: CancellationToken,
}

impl Link {
    /// After the handshake. An error says what is wrong with the peer's certificate.
    pub(crate) fn new(mut stream: TlsStream<TcpStream>, local: SocketAddr, from: SocketAddr) -> ZResult<Arc<Self>> {
        stream.get_mut().1.set_buffer_limit(Some(WAITING));
        let Holder { name, until } = holder(stream.get_ref().1.peer_certificates())?;
        let locator = |address: SocketAddr| Locator::new(TLS_LOCATOR_PREFIX, address.to_string(), "");
        let (reader, writer) = tokio::io::split(stream);
        let link = Arc::new(Link {
            reader: Mutex::new(reader),
            writer: Mutex::new(writer),
            local: (local, locator(local)?),
            remote: locator(from)?,
            peer: LinkAuthId::Tls(Some(name)),
            closed: CancellationToken::new(),
        });
        ZRuntime::Acceptor.spawn(expire(Arc::downgrade(&link), until, link.closed.clone()));
        Ok(link)
    }
}

/// Ends the link with its peer's certificate.
async fn expire(link: Weak<Link>, until: SystemTime, closed: CancellationToken) {
    while let Ok(left) = until.duration_since(SystemTime::now()) {
        tokio::select! {
            () = closed.cancelled() => return,
            () = tokio::time::sleep(left.min(CLOCK)) => {}
        }
    }
    if let Some(link) = link.upgrade() {
        tracing::warn!("the certificate of {:?} has ended: its link is closed", link.peer.get_cert_common_name());
        let _ = link.close().await;
    }
}

#[async_trait]
impl LinkUnicastTrait for Link {
    async fn close(&self) -> ZResult<()> {
        // Whoever reads or writes lets go, then the stream is this function's.
        self.closed.cancel();
        let mut writer = self.writer.lock().await;
        let _ = tokio::time::timeout(FAREWELL, writer.shutdown()).await;
        Ok(())
    }

    async fn write(&self, buffer: &[u8], priority: Option<Priority>) -> ZResult<usize> {
        self.write_all(buffer, priority).await.map(|()| buffer.len())
    }

    async fn write_all(&self, buffer: &[u8], _: Option<Priority>) -> ZResult<()> {
        let mut writer = self.writer.lock().await;
        let write = async {
            writer.write_all(buffer).await?;
            writer.flush().await // what is left inside would wait for the next message
        };
        tokio::select! {
            () = self.closed.cancelled() => Err(closed()),
            written = write => written.map_err(|e| zerror!("{e}").into()),
        }
    }

    async fn read(&self, buffer: &mut [u8], _: Option<Priority>) -> ZResult<usize> {
        let mut reader = self.reader.lock().await;
        tokio::select! {
            () = self.closed.cancelled() => Err(closed()),
            read = reader.read(buffer) => read.map_err(|e| zerror!("{e}").into()),
        }
    }

    async fn read_exact(&self, buffer: &mut [u8], _: Option<Priority>) -> ZResult<()> {
        let mut reader = self.reader.lock().await;
        tokio::select! {
            () = self.closed.cancelled() => Err(closed()),
            read = reader.read_exact(buffer) => read.map(|_| ()).map_err(|e| zerror!("{e}").into()),
        }
    }

    fn get_src(&self) -> &Locator {
        &self.local.1
    }

    fn get_dst(&self) -> &Locator {
        &self.remote
    }

    /// As of any stream: Zenoh writes a batch's length in 16 bits.
    fn get_mtu(&self) -> BatchSize {
        BatchSize::MAX
    }

    fn get_interface_names(&self) -> Vec<String> {
        get_ip_interface_names(&self.local.0)
    }

    fn is_reliable(&self) -> bool {
        true
    }

    fn is_streamed(&self) -> bool {
        true
    }

    fn get_auth_id(&self) -> &LinkAuthId {
        &self.peer
    }
}

fn closed() -> zenoh_result::Error {
    zerror!("the link is closed").into()
}
