//! What the threads of a link share: the transport, the clock, the key and the state.

use crate::dialogue::commands::{Command, Commands};
use crate::messages::MavMessage;
use crate::session::config::LinkConfig;
use crate::state::status::Status;
use crate::state::view::View;
use crate::wire::address::Peer;
use crate::wire::encode::Encoder;
use crate::wire::error::AutopilotError;
use crate::wire::peers::Peers;
use crate::wire::signing::{self, Signer, Verifier};
use crate::wire::transport::Transport;
use goshawk_core::Time;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

/// Commands that may wait for the receiver, which looks every few milliseconds.
const ORDERS: usize = 64;

pub(crate) struct State {
    orders: Receiver<Command>,
    pub(crate) view: View,
    pub(crate) commands: Commands,
    pub(crate) verifier: Verifier,
    pub(crate) peer: Option<Peer>,
    pub(crate) peers: Peers,
    /// The line was opened anew: at the next heartbeat the streams are asked for again, as another line's may be.
    pub(crate) reopened: bool,
    pub(crate) sent: Sent,
}

impl State {
    /// Takes what was asked since the last look; of an autopilot that had fallen silent before, that is nothing.
    pub(crate) fn take_orders(&mut self, now: Time) {
        self.orders.try_iter().for_each(|order| self.commands.submit(order));
        if self.view.has_fallen_silent(now) {
            self.commands.drop_orders(now);
        }
    }
}

/// When what repeats was last done.
#[derive(Default)]
pub(crate) struct Sent {
    pub(crate) heartbeat: Option<Time>,
    pub(crate) timesync: Option<Time>,
    pub(crate) parameters: Option<Time>,
    pub(crate) streams: Option<Time>,
    pub(crate) checks: Option<Time>,
}

/// One link. Every method may be called from any thread.
pub(crate) struct Endpoint {
    pub(crate) config: LinkConfig,
    pub(crate) transport: Transport,
    clock: Box<dyn Fn() -> Time + Send + Sync>,
    encoder: Encoder,
    /// Held from a message's stamp until it is sent.
    sending: Mutex<()>,
    pub(crate) signer: Option<Arc<Signer>>,
    /// To the state, past whoever holds it.
    orders: SyncSender<Command>,
    state: Mutex<State>,
    stop: AtomicBool,
    sent: AtomicU64,
    send_errors: AtomicU64,
}

impl Endpoint {
    /// Listens, or is ready to call.
    pub(crate) fn new(config: LinkConfig, clock: Box<dyn Fn() -> Time + Send + Sync>) -> Result<Self, AutopilotError> {
        let transport = Transport::new(&config.address)?;
        let signer = config.signing.as_ref().map(|signing| {
            let saved = signing.stamps.as_deref().and_then(signing::saved_stamp);
            Arc::new(Signer::new(signing.key.clone(), saved, signing::wall_clock))
        });
        let (orders, taken) = sync_channel(ORDERS);
        Ok(Self {
            clock,
            encoder: Encoder::new(config.system_id, config.component_id).signed(signer.clone()),
            sending: Mutex::new(()),
            signer,
            orders,
            state: Mutex::new(State {
                orders: taken,
                view: View::new(config.target_system, config.target_component, config.firmware),
                commands: Commands::default(),
                verifier: Verifier::default(),
                peer: transport.first_peer(),
                peers: Peers::new(config.peer),
                reopened: false,
                sent: Sent::default(),
            }),
            config,
            transport,
            stop: AtomicBool::new(false),
            sent: AtomicU64::new(0),
            send_errors: AtomicU64::new(0),
        })
    }

    pub(crate) fn status(&self, now: Time) -> Status {
        let state = self.lock();
        let status = Status { unanswered: state.commands.unanswered(), ..state.view.status(now) };
        drop(state);
        self.counted(status)
    }

    /// `status` with the counters that lie outside the lock.
    pub(crate) fn counted(&self, mut status: Status) -> Status {
        status.counters.sent = self.sent.load(Ordering::Relaxed);
        status.counters.send_errors = self.send_errors.load(Ordering::Relaxed);
        status
    }

    /// Leaves a command for the receiver, without waiting.
    pub(crate) fn order(&self, command: Command) {
        if self.orders.try_send(command).is_err() {
            tracing::error!(%command, "not asked of the autopilot: too much waits");
        }
    }

    /// Lets the receiver return.
    pub(crate) fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    pub(crate) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    pub(crate) fn lock(&self) -> MutexGuard<'_, State> {
        // Every update of the state is complete in itself, so a panicked holder leaves nothing half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// As [`Self::lock`], but none while another thread holds it.
    pub(crate) fn try_lock(&self) -> Option<MutexGuard<'_, State>> {
        match self.state.try_lock() {
            Ok(state) => Some(state),
            Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    pub(crate) fn encoder(&self) -> &Encoder {
        &self.encoder
    }

    pub(crate) fn now(&self) -> Time {
        (self.clock)()
    }

    /// Sends a message; one that cannot go out is lost, and counted.
    pub(crate) fn send(&self, peer: Peer, message: &MavMessage) -> Result<(), AutopilotError> {
        let _sending = self.sending.lock().unwrap_or_else(PoisonError::into_inner);
        self.send_frame(peer, self.encoder.encode(message).raw_bytes(), false)
    }

    /// Sends a setpoint's frame; waits for no other thread.
    pub(crate) fn send_hurried(&self, peer: Peer, frame: &[u8]) -> Result<(), AutopilotError> {
        self.send_frame(peer, frame, true)
    }

    fn send_frame(&self, peer: Peer, frame: &[u8], hurried: bool) -> Result<(), AutopilotError> {
        match self.transport.send(peer, frame, hurried) {
            Ok(()) => {
                self.sent.fetch_add(1, Ordering::Relaxed);
                Ok(())
            }
            Err(source) => {
                self.send_errors.fetch_add(1, Ordering::Relaxed);
                Err(AutopilotError::Send { peer, source })
            }
        }
    }

    /// For the housekeeping, whose failures the counters show.
    pub(crate) fn send_counted(&self, message: &MavMessage) {
        let peer = self.lock().peer;
        if let Some(peer) = peer {
            let _ = self.send(peer, message);
        }
    }

    pub(crate) fn send_due_commands(&self) {
        loop {
            let now = self.now();
            let message = {
                let mut state = self.lock();
                if state.peer.is_none() {
                    return;
                }
                state.take_orders(now);
                state.commands.due(now, self.config.target_system, self.config.target_component)
            };
            match message {
                Some(message) => self.send_counted(&message),
                None => return,
            }
        }
    }
}
