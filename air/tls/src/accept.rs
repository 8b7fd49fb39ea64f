//! Takes connections in. Handshakes run beside each other; when too many are open, the oldest is given up, for a peer that
//! means to talk is done in two round trips.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream};
use tokio::task::{AbortHandle, JoinSet};
use tokio_rustls::TlsAcceptor;
use tokio_util::sync::CancellationToken;
use zenoh_link_commons::{LinkUnicast, LinkUnicastTrait, NewLinkChannelSender};
use zenoh_result::ZResult;

use crate::REFUSED;
use crate::certificate::{Claim, NOT_ADMITTED};
use crate::link::Link;
use crate::settings::Identity;

/// Handshakes that may be open. Each holds a socket and some 20 kB.
const OPEN: usize = 256;
/// After the system had no room for a connection, it is asked again so soon.
const NO_ROOM: Duration = Duration::from_millis(20);
/// Characters of a name that nobody has verified.
const LONGEST_CLAIM: usize = 40;

pub(crate) async fn run(
    listener: TcpListener,
    identity: Identity,
    links: NewLinkChannelSender,
    within: Duration,
    token: CancellationToken,
) -> ZResult<()> {
    let mut handshakes = JoinSet::new();
    let mut oldest: VecDeque<AbortHandle> = VecDeque::with_capacity(OPEN);
    loop {
        tokio::select! {
            () = token.cancelled() => return Ok(()),
            Some(_) = handshakes.join_next() => oldest.retain(|handshake| !handshake.is_finished()),
            accepted = listener.accept() => match accepted {
                Ok((stream, from)) => {
                    if oldest.len() >= OPEN && let Some(handshake) = oldest.pop_front() {
                        handshake.abort();
                    }
                    oldest.push_back(handshakes.spawn(admit(stream, from, identity.clone(), links.clone(), within)));
                }
                Err(why) => {
                    tracing::warn!(target: REFUSED, "a connection was refused: {why}");
                    tokio::time::sleep(NO_ROOM).await;
                }
            },
        }
    }
}

/// One handshake; its link goes to Zenoh.
async fn admit(stream: TcpStream, from: SocketAddr, identity: Identity, links: NewLinkChannelSender, within: Duration) {
    let claim = Claim::default();
    let refuse = |why: &str| {
        if let Some(name) = claim.name() {
            let name: String = name.chars().filter(|c| !c.is_control()).take(LONGEST_CLAIM).collect();
            tracing::warn!(target: REFUSED, "{} was refused as {name}: {why}", from.ip());
        } else {
            tracing::warn!(target: REFUSED, "{} was refused: {why}", from.ip());
        }
    };
    let Ok(local) = stream.local_addr() else { return };
    let _ = stream.set_nodelay(true);
    let server = match identity.server(&claim) {
        Ok(server) => server,
        Err(why) => return refuse(&why.to_string()),
    };
    match tokio::time::timeout(within, TlsAcceptor::from(server).accept(stream)).await {
        Err(_) => refuse("no handshake came"),
        Ok(Err(why)) if is_not_admitted(&why) => refuse("it is not admitted"),
        Ok(Err(why)) => refuse(&why.to_string()),
        Ok(Ok(stream)) => match Link::new(stream, local, from) {
            Ok(link) => drop(links.send_async(LinkUnicast::from(link as Arc<dyn LinkUnicastTrait>)).await),
            Err(why) => refuse(&why.to_string()),
        },
    }
}

fn is_not_admitted(why: &std::io::Error) -> bool {
    why.get_ref().and_then(|cause| cause.downcast_ref()) == Some(&NOT_ADMITTED)
}
