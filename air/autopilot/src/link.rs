//! The socket, the clock and the receiving thread around [`View`].

use crate::commands::{Ack, Command, Commands, Outcome};
use crate::error::AutopilotError;
use crate::events::AutopilotEvent;
use crate::frames::ned_from_frd;
use crate::messages::{
    ATTITUDE_QUATERNION_DATA, AttitudeTargetTypemask, CURRENT_MODE_DATA, EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA,
    HIGHRES_IMU_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType, ODOMETRY_DATA,
    SET_ATTITUDE_TARGET_DATA,
};
use crate::view::{Imu, Status, StatusText, View};
use crate::wire::{Encoder, Packet, for_each_packet};
use goshawk_core::Request;
use goshawk_core::types::{AttitudeThrust, Odometry, Time};
use mavlink::MessageData;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// How long the receiver waits for a datagram before it looks at the clock.
const RECEIVE_WAIT: Duration = Duration::from_millis(5);
/// How long a send may wait for room in the socket's buffer, which is empty unless the network is stuck.
const SEND_WAIT: Duration = Duration::from_millis(1);
const HEARTBEAT_EVERY_S: f64 = 1.0;
const TIMESYNC_EVERY_S: f64 = 0.1;

/// As what our heartbeat introduces us.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HeartbeatKind {
    /// A companion computer. PX4 sends it no STATUSTEXT.
    #[default]
    OnboardController,
    /// A ground station: STATUSTEXT comes, but PX4 then counts its ground link as alive as long as we are.
    GroundStation,
}

/// How often each message is asked for when contact is made, Hz, above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamRates {
    /// ODOMETRY.
    pub odometry_hz: f64,
    /// ATTITUDE_QUATERNION, used when ODOMETRY does not come.
    pub attitude_hz: f64,
    /// HIGHRES_IMU.
    pub imu_hz: f64,
    /// CURRENT_MODE and EXTENDED_SYS_STATE: how late a lost mode is noticed at worst.
    pub state_hz: f64,
}

impl Default for StreamRates {
    fn default() -> Self {
        Self { odometry_hz: 100.0, attitude_hz: 100.0, imu_hz: 100.0, state_hz: 10.0 }
    }
}

/// Where the autopilot is and who we are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkConfig {
    /// Our local address. PX4 sends to UDP 14540 unless told otherwise.
    pub bind: SocketAddr,
    /// The autopilot's address; none: that of the first heartbeat of the target.
    pub peer: Option<SocketAddr>,
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
    /// The customary ids, listening at `bind`, peer learned.
    #[must_use]
    pub fn customary(bind: SocketAddr) -> Self {
        Self {
            bind,
            peer: None,
            system_id: 1,
            component_id: 191,
            target_system: 1,
            target_component: 1,
            heartbeat: HeartbeatKind::default(),
            rates: StreamRates::default(),
        }
    }

    fn validate(&self) -> Result<(), AutopilotError> {
        let rates = &self.rates;
        let ids = [self.system_id, self.component_id, self.target_system, self.target_component];
        if ids.contains(&0) {
            return Err(AutopilotError::Config("system and component ids are 1 to 255; 0 means everyone".to_owned()));
        }
        for hz in [rates.odometry_hz, rates.attitude_hz, rates.imu_hz, rates.state_hz] {
            if !(hz.is_finite() && hz > 0.0 && hz <= 1000.0) {
                return Err(AutopilotError::Config(format!("stream rate {hz} Hz is not above 0 and up to 1000")));
            }
        }
        if let Some(peer) = self.peer
            && peer.is_ipv4() != self.bind.is_ipv4()
        {
            return Err(AutopilotError::Config(format!("peer {peer} cannot be reached from {}", self.bind)));
        }
        Ok(())
    }
}

struct State {
    view: View,
    commands: Commands,
    peer: Option<SocketAddr>,
    heartbeat_sent: Option<Time>,
    timesync_sent: Option<Time>,
}

struct Shared {
    config: LinkConfig,
    socket: UdpSocket,
    clock: Box<dyn Fn() -> Time + Send + Sync>,
    encoder: Encoder,
    state: Mutex<State>,
    stop: AtomicBool,
    sent: AtomicU64,
    send_errors: AtomicU64,
}

/// The link to the autopilot. Its own thread receives, keeps heartbeat and clocks going and repeats commands; sending
/// and reading are for the control thread and return at once.
pub struct AutopilotLink {
    shared: Arc<Shared>,
    receiver: Option<JoinHandle<()>>,
}

impl AutopilotLink {
    /// Listens at `config.bind`; `clock` is the vehicle's monotonic clock.
    ///
    /// # Errors
    /// The port is in use or cannot be bound, a config value is unusable, the thread does not start.
    pub fn open(config: LinkConfig, clock: impl Fn() -> Time + Send + Sync + 'static) -> Result<Self, AutopilotError> {
        config.validate()?;
        let socket = UdpSocket::bind(config.bind).map_err(|source| match source.kind() {
            ErrorKind::AddrInUse => AutopilotError::PortInUse(config.bind),
            _ => AutopilotError::Bind { address: config.bind, source },
        })?;
        socket.set_read_timeout(Some(RECEIVE_WAIT)).map_err(AutopilotError::Receiver)?;
        socket.set_write_timeout(Some(SEND_WAIT)).map_err(AutopilotError::Receiver)?;
        let shared = Arc::new(Shared {
            config,
            socket,
            clock: Box::new(clock),
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
        });
        let for_thread = Arc::clone(&shared);
        let receiver = std::thread::Builder::new()
            .name("autopilot".to_owned())
            .spawn(move || for_thread.receive())
            .map_err(AutopilotError::Receiver)?;
        Ok(Self { shared, receiver: Some(receiver) })
    }

    /// The address that we listen at, with the port that the system chose if the config said 0.
    ///
    /// # Errors
    /// The socket does not say.
    pub fn local_address(&self) -> Result<SocketAddr, AutopilotError> {
        self.shared.socket.local_addr().map_err(AutopilotError::Receiver)
    }

    /// The autopilot's address, configured or learned.
    #[must_use]
    pub fn peer(&self) -> Option<SocketAddr> {
        self.shared.lock().peer
    }

    /// The autopilot's state as known at `now`.
    #[must_use]
    pub fn status(&self, now: Time) -> Status {
        let mut status = self.shared.lock().view.status(now);
        status.counters.sent = self.shared.sent.load(Ordering::Relaxed);
        status.counters.send_errors = self.shared.send_errors.load(Ordering::Relaxed);
        status
    }

    /// Newest odometry in our clock; none: nothing usable came yet. Judge its freshness by its stamp.
    #[must_use]
    pub fn odometry(&self) -> Option<Odometry> {
        self.shared.lock().view.odometry()
    }

    /// Newest inertial sample in our clock.
    #[must_use]
    pub fn imu(&self) -> Option<Imu> {
        self.shared.lock().view.imu()
    }

    /// Sends the attitude and thrust (SET_ATTITUDE_TARGET, type mask 7). Call it at the control rate: PX4 wants more
    /// than 2 Hz for a second before it follows, and fails safe when they stop.
    ///
    /// # Errors
    /// The setpoint is not finite, no peer is known, or the datagram did not go out (counted; the next one may).
    pub fn send_setpoint(&self, setpoint: &AttitudeThrust) -> Result<(), AutopilotError> {
        let thrust = setpoint.thrust.0;
        let finite = setpoint.world_from_body.coords.iter().all(|value| value.is_finite());
        if !finite || !(0.0..=1.0).contains(&thrust) {
            return Err(AutopilotError::BadSetpoint);
        }
        let q = ned_from_frd(&setpoint.world_from_body);
        let message = MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
            time_boot_ms: ((self.shared.clock)().0 / 1_000_000) as u32, // wraps after 49 days; PX4 ignores it
            q: [q.w as f32, q.i as f32, q.j as f32, q.k as f32],
            thrust: thrust as f32,
            target_system: self.shared.config.target_system,
            target_component: self.shared.config.target_component,
            type_mask: AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
                | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
                | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE,
            ..SET_ATTITUDE_TARGET_DATA::default()
        });
        let peer = self.peer().ok_or(AutopilotError::NoPeer)?;
        self.shared.send(peer, &message)
    }

    /// Asks what the controller wants. Repeated until answered; see [`Self::take_acks`].
    pub fn request(&self, request: Request) {
        self.command(request.into());
    }

    /// Asks anything of the autopilot. Repeated until answered; see [`Self::take_acks`].
    pub fn command(&self, command: Command) {
        self.shared.lock().commands.submit(command);
        self.shared.send_due_commands();
    }

    /// Takes the answers to commands since the last call, oldest first.
    #[must_use]
    pub fn take_acks(&self) -> Vec<Ack> {
        self.shared.lock().commands.take_answers()
    }

    /// Takes the autopilot's texts since the last call, oldest first.
    #[must_use]
    pub fn take_texts(&self) -> Vec<StatusText> {
        self.shared.lock().view.take_texts()
    }

    /// Takes the autopilot's events since the last call, oldest first.
    #[must_use]
    pub fn take_events(&self) -> Vec<(Time, AutopilotEvent)> {
        self.shared.lock().view.take_events()
    }
}

impl Drop for AutopilotLink {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(receiver) = self.receiver.take() {
            // A panicked receiver has already said so on stderr.
            let _ = receiver.join();
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // Every update of the state is complete in itself, so a panicked holder leaves nothing half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now(&self) -> Time {
        (self.clock)()
    }

    fn send(&self, peer: SocketAddr, message: &MavMessage) -> Result<(), AutopilotError> {
        match self.socket.send_to(self.encoder.encode(message).raw_bytes(), peer) {
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

    fn receive(&self) {
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

    fn send_due_commands(&self) {
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
