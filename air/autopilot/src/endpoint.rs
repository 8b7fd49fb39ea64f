//! The socket, the clock and what the receiving thread does: it takes packets, keeps heartbeat and clocks going and
//! repeats commands.

use crate::commands::{Command, Commands, Outcome};
use crate::config::{HeartbeatKind, LinkConfig};
use crate::error::AutopilotError;
use crate::messages::{
    ATTITUDE_QUATERNION_DATA, CURRENT_MODE_DATA, EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA, HIGHRES_IMU_DATA,
    MavAutopilot, MavMessage, MavModeFlag, MavState, MavType, ODOMETRY_DATA,
};
use crate::status::Status;
use crate::view::View;
use crate::wire::{Encoder, Packet, for_each_packet};
use goshawk_core::types::Time;
use mavlink::MessageData;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Duration;

/// How long the receiver waits for a datagram before it looks at the clock.
const RECEIVE_WAIT: Duration = Duration::from_millis(5);
/// How long a send may wait for room in the socket's buffer, which is empty unless the network is stuck.
const SEND_WAIT: Duration = Duration::from_millis(1);
const HEARTBEAT_EVERY_S: f64 = 1.0;
const TIMESYNC_EVERY_S: f64 = 0.1;

/// What the threads share.
pub(crate) struct State {
    pub(crate) view: View,
    pub(crate) commands: Commands,
    pub(crate) peer: Option<SocketAddr>,
    heartbeat_sent: Option<Time>,
    timesync_sent: Option<Time>,
}

/// One socket with its state. Every method may be called from any thread.
pub(crate) struct Endpoint {
    config: LinkConfig,
    socket: UdpSocket,
    clock: Box<dyn Fn() -> Time + Send + Sync>,
    encoder: Encoder,
    state: Mutex<State>,
    stop: AtomicBool,
    sent: AtomicU64,
    send_errors: AtomicU64,
}

impl Endpoint {
    /// Listens at `config.bind`.
    pub(crate) fn bind(config: LinkConfig, clock: Box<dyn Fn() -> Time + Send + Sync>) -> Result<Self, AutopilotError> {
        let socket = UdpSocket::bind(config.bind).map_err(|source| match source.kind() {
            ErrorKind::AddrInUse => AutopilotError::PortInUse(config.bind),
            _ => AutopilotError::Bind { address: config.bind, source },
        })?;
        socket.set_read_timeout(Some(RECEIVE_WAIT)).map_err(AutopilotError::Receiver)?;
        socket.set_write_timeout(Some(SEND_WAIT)).map_err(AutopilotError::Receiver)?;
        Ok(Self {
            config,
            socket,
            clock,
            encoder: Encoder::new(config.system_id, config.component_id),
            state: Mutex::new(State {
                view: View::new(config.target_system, config.target_component),
                commands: Commands::default(),
                peer: config.peer,
                heartbeat_sent: None,
                timesync_sent: None,
            }),
            stop: AtomicBool::new(false),
            sent: AtomicU64::new(0),
            send_errors: AtomicU64::new(0),
        })
    }

    pub(crate) fn config(&self) -> &LinkConfig {
        &self.config
    }

    pub(crate) fn local_address(&self) -> Result<SocketAddr, AutopilotError> {
        self.socket.local_addr().map_err(AutopilotError::Receiver)
    }

    pub(crate) fn status(&self, now: Time) -> Status {
        self.counted(self.lock().view.status(now))
    }

    /// `status` with the counters that lie outside the lock.
    pub(crate) fn counted(&self, mut status: Status) -> Status {
        status.counters.sent = self.sent.load(Ordering::Relaxed);
        status.counters.send_errors = self.send_errors.load(Ordering::Relaxed);
        status
    }

    /// Lets [`Self::receive`] return.
    pub(crate) fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
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

    pub(crate) fn send(&self, peer: SocketAddr, message: &MavMessage) -> Result<(), AutopilotError> {
        self.send_bytes(peer, self.encoder.encode(message).raw_bytes())
    }

    pub(crate) fn send_bytes(&self, peer: SocketAddr, bytes: &[u8]) -> Result<(), AutopilotError> {
        match self.socket.send_to(bytes, peer) {
            Ok(_) => {
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
    fn send_counted(&self, message: &MavMessage) {
        let peer = self.lock().peer;
        if let Some(peer) = peer {
            let _ = self.send(peer, message);
        }
    }

    /// Receives and keeps house until stopped. Runs on a thread of its own.
    pub(crate) fn receive(&self) {
        let mut buffer = [0_u8; 65_536];
        while !self.stop.load(Ordering::Relaxed) {
            match self.socket.recv_from(&mut buffer) {
                Ok((length, from)) => self.datagram(&buffer[..length], from),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => {
                    tracing::warn!(%error, "receiving from the autopilot failed");
                    std::thread::sleep(Duration::from_millis(100));
                }
            }
            self.housekeeping();
        }
    }

    fn datagram(&self, bytes: &[u8], from: SocketAddr) {
        for_each_packet(bytes, |result| {
            let now = self.now();
            match result {
                Err(reject) => self.lock().view.reject(reject),
                Ok(packet) => self.packet(now, &packet, from),
            }
        });
    }

    fn packet(&self, now: Time, packet: &Packet, from: SocketAddr) {
        let accepted = {
            let mut state = self.lock();
            if !self.is_peer(&mut state, now, packet, from) {
                state.view.counters.strangers += 1;
                return;
            }
            let accepted = state.view.accept(now, packet);
            if accepted.greet {
                state.commands.clear();
                self.ask_for_streams(&mut state.commands);
            }
            self.settle(&mut state, now, packet);
            accepted
        };
        if accepted.greet {
            tracing::info!(autopilot = %from, "contact with the autopilot");
        }
        if let Some(reply) = accepted.reply {
            self.send_counted(&reply);
        }
        self.send_due_commands();
    }

    /// Learns the peer from the target's heartbeat if none is configured: the first one, and another only when the
    /// old one fell silent.
    fn is_peer(&self, state: &mut State, now: Time, packet: &Packet, from: SocketAddr) -> bool {
        if state.peer == Some(from) {
            return true;
        }
        let heartbeat = matches!(packet.message, MavMessage::HEARTBEAT(_)) && state.view.is_target(packet);
        if self.config.peer.is_none() && heartbeat && !state.view.status(now).connected {
            state.peer = Some(from);
            return true;
        }
        false
    }

    fn settle(&self, state: &mut State, now: Time, packet: &Packet) {
        let MavMessage::COMMAND_ACK(ack) = &packet.message else {
            return;
        };
        let ours = [0, self.config.system_id].contains(&ack.target_system)
            && [0, self.config.component_id].contains(&ack.target_component);
        if !ours || !state.view.is_target(packet) {
            return;
        }
        if let Some(settled) = state.commands.answered(now, ack) {
            state.view.settled(&settled);
            match settled.outcome {
                Outcome::Accepted => {
                    tracing::debug!(command = %settled.command, "autopilot accepted")
                }
                outcome => {
                    tracing::warn!(command = %settled.command, %outcome, "autopilot refused")
                }
            }
        }
    }

    fn ask_for_streams(&self, commands: &mut Commands) {
        let rates = &self.config.rates;
        for (message, hz) in [
            (CURRENT_MODE_DATA::ID, rates.state_hz),
            (ODOMETRY_DATA::ID, rates.odometry_hz),
            (ATTITUDE_QUATERNION_DATA::ID, rates.attitude_hz),
            (HIGHRES_IMU_DATA::ID, rates.imu_hz),
            (EXTENDED_SYS_STATE_DATA::ID, rates.state_hz),
        ] {
            commands.submit(Command::Stream { message, hz });
        }
    }

    fn housekeeping(&self) {
        let now = self.now();
        let is_due = |sent: Option<Time>, every: f64| sent.is_none_or(|sent| now.since(sent) >= every);
        let (heartbeat, timesync) = {
            let mut state = self.lock();
            if state.peer.is_none() {
                return;
            }
            let heartbeat = is_due(state.heartbeat_sent, HEARTBEAT_EVERY_S);
            if heartbeat {
                state.heartbeat_sent = Some(now);
            }
            let timesync = is_due(state.timesync_sent, TIMESYNC_EVERY_S).then(|| {
                state.timesync_sent = Some(now);
                state.view.timesync_request(now)
            });
            (heartbeat, timesync)
        };
        if let Some(request) = timesync {
            self.send_counted(&request);
        }
        if heartbeat {
            self.send_counted(&self.heartbeat());
        }
        self.send_due_commands();
    }

    fn heartbeat(&self) -> MavMessage {
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: match self.config.heartbeat {
                HeartbeatKind::OnboardController => MavType::MAV_TYPE_ONBOARD_CONTROLLER,
                HeartbeatKind::GroundStation => MavType::MAV_TYPE_GCS,
            },
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            base_mode: MavModeFlag::empty(),
            system_status: MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
        })
    }

    pub(crate) fn send_due_commands(&self) {
        loop {
            let now = self.now();
            let message = {
                let mut state = self.lock();
                if state.peer.is_none() {
                    return;
                }
                state.commands.due(now, self.config.target_system, self.config.target_component)
            };
            match message {
                Some(message) => self.send_counted(&message),
                None => return,
            }
        }
    }
}
