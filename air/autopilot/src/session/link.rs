//! The link to the autopilot, as the control thread uses it.

use crate::dialogue::commands::{Ack, Command};
use crate::dialogue::events::AutopilotEvent;
use crate::dialogue::parameters::{self, Parameter};
use crate::frames::ned_from_frd;
use crate::messages::{AttitudeTargetTypemask, MavMessage, SET_ATTITUDE_TARGET_DATA};
use crate::session::config::LinkConfig;
use crate::session::endpoint::Endpoint;
use crate::session::vision::{VisionMessage, vision_message};
use crate::state::radio::Radio;
use crate::state::status::{Status, StatusText};
use crate::wire::address::Peer;
use crate::wire::error::AutopilotError;
use crate::wire::peers::PeerEvent;
use crate::wire::signing::{self, Stream};
use goshawk_core::{AttitudeThrust, Imu, Odometry, Request, Time};
use mavlink::MAVLinkV2MessageRaw;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;

/// What a control step wants of the link, from one look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glance {
    /// The autopilot's state.
    pub status: Status,
    /// Newest odometry in our clock; none: nothing usable came yet.
    pub odometry: Option<Odometry>,
    /// Newest inertial sample in our clock; none: it sends none.
    pub imu: Option<Imu>,
    /// Where setpoints go; none: not known yet.
    pub peer: Option<Peer>,
}

/// The link to the autopilot. Its own thread receives, keeps heartbeat and clocks going and repeats commands; sending
/// and reading are for the control thread and return at once.
pub struct AutopilotLink {
    endpoint: Arc<Endpoint>,
    receiver: Option<JoinHandle<()>>,
    /// Its end is the end of who keeps the stamps.
    stamps: Option<Sender<()>>,
}

impl AutopilotLink {
    /// Listens, or calls again and again until somebody answers; `clock` is the vehicle's monotonic clock.
    ///
    /// # Errors
    /// The port is in use or cannot be bound, the host is not known, a config value is unusable, the thread does not
    /// start. A serial port that is not there, or a TCP peer that does not answer, is none: see [`Self::line_problem`].
    pub fn open(config: LinkConfig, clock: impl Fn() -> Time + Send + Sync + 'static) -> Result<Self, AutopilotError> {
        config.validate()?;
        let endpoint = Arc::new(Endpoint::new(config, Box::new(clock))?);
        let for_thread = Arc::clone(&endpoint);
        let receiver = std::thread::Builder::new()
            .name("autopilot".to_owned())
            .spawn(move || for_thread.receive())
            .map_err(AutopilotError::Receiver)?;
        // From here on, dropping the link ends the receiver.
        let mut link = Self { endpoint, receiver: Some(receiver), stamps: None };
        link.stamps = link.keep_stamps()?;
        Ok(link)
    }

    /// Saves the newest stamp again and again, where it is kept, on a thread that nobody waits for: the disk may hang.
    fn keep_stamps(&self) -> Result<Option<Sender<()>>, AutopilotError> {
        let path = self.endpoint.config.signing.as_ref().and_then(|signing| signing.stamps.clone());
        let (Some(signer), Some(path)) = (self.endpoint.signer.clone(), path) else { return Ok(None) };
        let (link, ended) = channel();
        let thread = std::thread::Builder::new().name("stamps".to_owned());
        thread.spawn(move || signing::keep_stamps(&path, &signer, &ended)).map_err(AutopilotError::Receiver)?;
        Ok(Some(link))
    }

    /// The address that we listen at, with the port that the system chose if the config said 0.
    ///
    /// # Errors
    /// The socket does not say, or the line has none.
    pub fn local_address(&self) -> Result<SocketAddr, AutopilotError> {
        self.endpoint.transport.local_address()
    }

    /// Why the line to the autopilot is not open, in one line; none: it is.
    #[must_use]
    pub fn line_problem(&self) -> Option<String> {
        self.endpoint.transport.problem()
    }

    /// The autopilot's address, configured or learned.
    #[must_use]
    pub fn peer(&self) -> Option<Peer> {
        self.endpoint.lock().peer
    }

    /// The autopilot's state as known at `now`.
    #[must_use]
    pub fn status(&self, now: Time) -> Status {
        self.endpoint.status(now)
    }

    /// Why the autopilot would refuse to arm, in its own words where it gave any; none: it would not, or does not say.
    #[must_use]
    pub fn refusal(&self, now: Time) -> Option<String> {
        self.endpoint.lock().view.refusal(now)
    }

    /// Newest odometry in our clock; none: nothing usable came yet. Judge its freshness by its stamp.
    #[must_use]
    pub fn odometry(&self) -> Option<Odometry> {
        self.endpoint.lock().view.odometry()
    }

    /// Newest inertial sample in our clock.
    #[must_use]
    pub fn imu(&self) -> Option<Imu> {
        self.endpoint.lock().view.imu()
    }

    /// What the pilot's radio last said; none: the autopilot has told nothing of it.
    #[must_use]
    pub fn radio(&self) -> Option<Radio> {
        self.endpoint.lock().view.radio()
    }

    /// All that a control step wants to know, without waiting: none while another thread of ours is at the state, which
    /// takes microseconds; then what the last glance said is as good.
    #[must_use]
    pub fn glance(&self, now: Time) -> Option<Glance> {
        let state = self.endpoint.try_lock()?;
        let status = Status { unanswered: state.commands.unanswered(), ..state.view.status(now) };
        let (odometry, imu, peer) = (state.view.odometry(), state.view.imu(), state.peer);
        drop(state);
        Some(Glance { status: self.endpoint.counted(status), odometry, imu, peer })
    }

    /// Sends the attitude and thrust (SET_ATTITUDE_TARGET, type mask 7). Call it at the control rate: PX4 wants more
    /// than 2 Hz for a second before it follows, and fails safe when they stop; ArduPilot then levels and holds its
    /// height. From one thread only: of a signed link's setpoints, one that another overtook is not believed.
    ///
    /// # Errors
    /// The setpoint is not finite, no peer is known, or the message did not go out (counted; the next one may).
    pub fn send_setpoint(&self, setpoint: &AttitudeThrust) -> Result<(), AutopilotError> {
        self.send_setpoint_to(self.peer().ok_or(AutopilotError::NoPeer)?, setpoint)
    }

    /// [`Self::send_setpoint`] to a peer that a [`Glance`] has told: waits for no other thread, nor for the line.
    ///
    /// # Errors
    /// As there.
    pub fn send_setpoint_to(&self, peer: Peer, setpoint: &AttitudeThrust) -> Result<(), AutopilotError> {
        self.endpoint.send_hurried(peer, self.setpoint_frame(setpoint)?.raw_bytes())
    }

    /// The frame of [`Self::send_setpoint`], with the next sequence number.
    ///
    /// # Errors
    /// The setpoint is not finite.
    pub fn setpoint_frame(&self, setpoint: &AttitudeThrust) -> Result<MAVLinkV2MessageRaw, AutopilotError> {
        let config = &self.endpoint.config;
        let target = (config.target_system, config.target_component);
        let message = setpoint_message(setpoint, self.endpoint.now(), target)?;
        Ok(self.endpoint.encoder().encode_in(Stream::Setpoints, &message))
    }

    /// Sends an estimate of ours to the autopilot's own estimator. Not for the control thread: it may wait for the line.
    ///
    /// # Errors
    /// No peer is known, or the message did not go out (counted; the next one may).
    pub fn send_vision(&self, message: VisionMessage, estimate: &Odometry) -> Result<(), AutopilotError> {
        self.endpoint.send(
            self.peer().ok_or(AutopilotError::NoPeer)?,
            &vision_message(message, self.endpoint.config.firmware, estimate),
        )
    }

    /// Asks what the controller wants, without waiting: the receiver sends it. Repeated until answered; see
    /// [`Self::take_acks`].
    pub fn request(&self, request: Request) {
        self.command(self.endpoint.config.firmware.command(request));
    }

    /// Asks anything of the autopilot, likewise.
    pub fn command(&self, command: Command) {
        self.endpoint.order(command);
    }

    /// Asks for a parameter by its name; what comes back is [`Self::parameter`]'s. An unknown one gets no answer.
    ///
    /// # Errors
    /// No peer is known, or the message did not go out.
    pub fn request_parameter(&self, name: &str) -> Result<(), AutopilotError> {
        let config = &self.endpoint.config;
        let message = parameters::request(name, config.target_system, config.target_component);
        self.endpoint.send(self.peer().ok_or(AutopilotError::NoPeer)?, &message)
    }

    /// A parameter as the autopilot last told it; none: it has not.
    #[must_use]
    pub fn parameter(&self, name: &str) -> Option<Parameter> {
        self.endpoint.lock().view.parameter(name)
    }

    /// Takes the answers to commands since the last call, oldest first.
    #[must_use]
    pub fn take_acks(&self) -> Vec<Ack> {
        self.endpoint.lock().commands.take_answers()
    }

    /// Takes the autopilot's texts since the last call, oldest first.
    #[must_use]
    pub fn take_texts(&self) -> Vec<StatusText> {
        self.endpoint.lock().view.take_texts()
    }

    /// Takes the autopilot's events since the last call, oldest first.
    #[must_use]
    pub fn take_events(&self) -> Vec<(Time, AutopilotEvent)> {
        self.endpoint.lock().view.take_events()
    }

    /// Takes what happened about the peer since the last call: who else speaks, and whether it moved; oldest first.
    #[must_use]
    pub fn take_peer_events(&self) -> Vec<PeerEvent> {
        self.endpoint.lock().peers.take_events()
    }
}

/// The message of a setpoint, sent at `now` to this system and component.
///
/// # Errors
/// The setpoint is not finite, or its thrust not one.
pub fn setpoint_message(setpoint: &AttitudeThrust, now: Time, target: (u8, u8)) -> Result<MavMessage, AutopilotError> {
    let thrust = setpoint.thrust.0;
    let finite = setpoint.world_from_body.coords.iter().all(|value| value.is_finite());
    if !finite || !(0.0..=1.0).contains(&thrust) {
        return Err(AutopilotError::BadSetpoint);
    }
    let q = ned_from_frd(&setpoint.world_from_body);
    Ok(MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
        time_boot_ms: (now.0 / 1_000_000) as u32, // wraps after 49 days; neither firmware looks at it
        q: [q.w as f32, q.i as f32, q.j as f32, q.k as f32],
        thrust: thrust as f32,
        target_system: target.0,
        target_component: target.1,
        type_mask: AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
            | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
            | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE,
        ..SET_ATTITUDE_TARGET_DATA::default()
    }))
}

impl Drop for AutopilotLink {
    fn drop(&mut self) {
        self.endpoint.stop();
        drop(self.stamps.take());
        if let Some(receiver) = self.receiver.take() {
            // A panicked receiver has already said so on stderr.
            let _ = receiver.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::MavMessage;
    use crate::wire::address::Address;
    use crate::wire::packet::for_each_frame;
    use std::net::UdpSocket;
    use std::time::Duration;

    #[test]
    fn a_request_waits_for_nobody_who_is_at_the_state_and_goes_out_afterwards() {
        let autopilot = UdpSocket::bind("127.0.0.1:0").unwrap();
        autopilot.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let address = Address::UdpOut(autopilot.local_addr().unwrap().to_string());
        let config = LinkConfig { address, ..LinkConfig::customary("127.0.0.1:0".parse().unwrap()) };
        let link = AutopilotLink::open(config, || Time::from_secs(5.0)).unwrap();
        // Held by this very thread: if the request waited for it, it would wait for ever.
        let state = link.endpoint.lock();
        link.request(Request::HandBack);
        drop(state);
        let mut asked = false;
        let mut bytes = [0; 1024];
        while !asked {
            let length = autopilot.recv(&mut bytes).unwrap();
            for_each_frame(&bytes[..length], true, |frame| {
                asked |= frame.is_ok_and(|(packet, _)| matches!(packet.message, MavMessage::COMMAND_LONG(_)));
            });
        }
    }
}
