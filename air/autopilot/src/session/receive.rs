//! What the receiving thread does: it takes packets, judges their signatures, keeps heartbeat and clocks going, and
//! repeats commands and questions.

use crate::dialogue::commands::{Command, Commands, Outcome};
use crate::dialogue::firmware::{Firmware, GUIDED_OPTIONS};
use crate::dialogue::parameters;
use crate::messages::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType};
use crate::session::config::HeartbeatKind;
use crate::session::endpoint::{Endpoint, State};
use crate::wire::address::Peer;
use crate::wire::line::{Line, LineReader, Step};
use crate::wire::packet::{self, Packet, Rejected, for_each_frame};
use crate::wire::peers::Circumstances;
use crate::wire::signing::Verdict;
use crate::wire::transport::Transport;
use goshawk_core::Time;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

/// What a packet of MAVLink 1 begins with.
const MAVLINK_1: u8 = 0xFE;
/// Our heartbeat, s: MAVLink's usual 1 Hz.
const HEARTBEAT_EVERY_S: f64 = 1.0;
/// The clocks are compared so often, s. Chosen by eye.
const TIMESYNC_EVERY_S: f64 = 0.1;
/// A parameter that was not told, or is not right, is asked for again after this. Chosen by eye.
const PARAMETERS_EVERY_S: f64 = 0.5;
/// Streams that were asked for in vain are asked for again after this. Chosen by eye.
const STREAMS_EVERY_S: f64 = 2.0;
/// An autopilot that refuses to arm is asked for its reasons so often: they change, and its answer may be lost. By eye.
const CHECKS_EVERY_S: f64 = 5.0;

impl Endpoint {
    /// Receives and keeps house until stopped. Runs on a thread of its own.
    pub(crate) fn receive(&self) {
        match &self.transport {
            Transport::Udp { socket, .. } => self.receive_datagrams(socket),
            Transport::Line(line) => self.receive_line(line),
        }
    }

    fn receive_datagrams(&self, socket: &UdpSocket) {
        let mut buffer = [0_u8; 65_536];
        while !self.stopped() {
            match socket.recv_from(&mut buffer) {
                Ok((length, from)) => {
                    if buffer[..length].first() == Some(&MAVLINK_1) {
                        self.greet(from);
                    }
                    for_each_frame(&buffer[..length], true, |frame| self.frame(frame, Peer::Udp(from)));
                }
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                // What was sent came back: nobody listens there yet.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => {}
                Err(error) => {
                    tracing::warn!(%error, "receiving from the autopilot failed");
                    std::thread::sleep(Duration::from_millis(100));
                }
            }
            self.housekeeping();
        }
    }

    /// A PX4 may begin in MAVLink 1, and changes to MAVLink 2 when it hears some. To be answered makes it nobody's peer.
    fn greet(&self, from: SocketAddr) {
        let now = self.now();
        let greets = {
            let mut state = self.lock();
            let unknown = state.peer.is_none() && self.transport.learns_peer() && state.peers.allows(from);
            unknown && due(&mut state.sent.heartbeat, now, HEARTBEAT_EVERY_S)
        };
        if greets {
            let _ = self.send(Peer::Udp(from), &self.heartbeat());
        }
    }

    fn receive_line(&self, line: &Line) {
        let mut reader = LineReader::new(line);
        while !self.stopped() {
            let now = self.now();
            let silent = !self.lock().view.status(now).connected;
            match reader.step(now, silent) {
                Step::Nothing => {}
                Step::Bytes => {
                    let used = for_each_frame(reader.held(), false, |frame| self.frame(frame, Peer::Line));
                    reader.done_with(used);
                }
                Step::Opened => {
                    tracing::info!(line = %self.config.address, "the line to the autopilot is open");
                    let mut state = self.lock();
                    state.peer = Some(Peer::Line);
                    state.reopened = true;
                    state.sent.heartbeat = None;
                }
                Step::Lost(_) => self.lock().peer = None, // the line has said why
            }
            self.housekeeping();
        }
    }

    fn frame(&self, frame: Result<(Packet, &[u8]), Rejected>, from: Peer) {
        let now = self.now();
        match frame {
            Err(rejected) => {
                let mut state = self.lock();
                let sender = rejected.from.filter(|_| state.peer == Some(from));
                state.view.reject(rejected.why, sender);
            }
            Ok((packet, bytes)) => self.packet(now, &packet, bytes, from),
        }
    }

    fn packet(&self, now: Time, packet: &Packet, bytes: &[u8], from: Peer) {
        let (accepted, contact) = {
            let mut state = self.lock();
            state.take_orders(now); // before the packet, which may say that they are void
            let believed = self.believed(&mut state, bytes);
            if !self.is_peer(&mut state, now, packet, from, believed) {
                self.not_our_peer(&mut state, packet, from, believed);
                return;
            }
            if believed != Some(Verdict::Good) {
                return;
            }
            self.name_beside(&mut state, packet, from);
            let accepted = state.view.accept(now, packet);
            if accepted.greet || accepted.restarted {
                state.commands.clear();
            }
            let heartbeat = matches!(packet.message, MavMessage::HEARTBEAT(_)) && state.view.is_target(packet);
            let contact = accepted.greet || (heartbeat && state.reopened);
            if contact {
                state.reopened = false;
                self.ask_for_streams(&mut state.commands);
            }
            self.settle(&mut state, now, packet);
            (accepted, contact)
        };
        if accepted.restarted {
            tracing::warn!("the autopilot has started again: what it was asked before is void");
        }
        if contact {
            tracing::info!(autopilot = %from, "contact with the autopilot");
        }
        if let Some(reply) = accepted.reply {
            self.send_counted(&reply);
        }
        self.send_due_commands();
    }

    /// Counts a packet that comes from elsewhere, and names who claims to be the autopilot. Where nobody is known yet, an
    /// autopilot of other ids is worth a word.
    fn not_our_peer(&self, state: &mut State, packet: &Packet, from: Peer, believed: Option<Verdict>) {
        let Peer::Udp(address) = from else { return };
        let ours = state.view.is_target(packet);
        let peer = known(state);
        // What streams before its first heartbeat may yet be the autopilot.
        if ours && (peer.is_some() || !state.peers.allows(address)) {
            state.peers.name(address, self.config.target_system, self.config.target_component, peer);
        }
        if believed != Some(Verdict::Good) {
            return; // counted already
        }
        if !ours && state.peer.is_none() && state.peers.allows(address) {
            state.view.foreign(packet);
        } else {
            state.view.counters.strangers += 1;
        }
    }

    /// Names who speaks from the peer's address with other ids than the autopilot's and ours. A telemetry radio's own
    /// status is no other's.
    fn name_beside(&self, state: &mut State, packet: &Packet, from: Peer) {
        let (Peer::Udp(address), Ok(system)) = (from, u8::try_from(packet.header.system_id)) else { return };
        let component = packet.header.component_id;
        let us = (system, component) == (self.config.system_id, self.config.component_id);
        if us || state.view.is_target(packet) || matches!(packet.message, MavMessage::RADIO_STATUS(_)) {
            return;
        }
        let peer = known(state);
        state.peers.name(address, system, component, peer);
    }

    /// Judges and counts a frame's signature. Without a key all are good. None: it is refused for good; a stale one
    /// is not believed, but its sender is answered, so that it may learn the time.
    fn believed(&self, state: &mut State, bytes: &[u8]) -> Option<Verdict> {
        let counters = &mut state.view.counters;
        let Some(signer) = &self.signer else {
            counters.unchecked += u64::from(packet::is_signed(bytes));
            return Some(Verdict::Good);
        };
        let verdict = state.verifier.judge(signer, bytes);
        match verdict {
            Verdict::Good => return Some(verdict),
            Verdict::Unsigned => counters.unsigned += 1,
            Verdict::Wrong => counters.bad_signature += 1,
            Verdict::Stale => {
                counters.stale_signature += 1;
                return Some(verdict);
            }
        }
        None
    }

    /// Learns the peer from the target's heartbeat if the line names none; who may be it, [`crate::wire::peers`] says.
    fn is_peer(&self, state: &mut State, now: Time, packet: &Packet, from: Peer, believed: Option<Verdict>) -> bool {
        if state.peer == Some(from) {
            return true;
        }
        let heartbeat = matches!(packet.message, MavMessage::HEARTBEAT(_)) && state.view.is_target(packet);
        let (Peer::Udp(address), Some(verdict), true) = (from, believed, heartbeat) else { return false };
        let circumstances = Circumstances {
            peer: known(state),
            heard: state.view.is_heard(now),
            in_flight: state.view.may_fly(),
            signed: self.signer.is_some() && verdict == Verdict::Good,
        };
        let admitted = self.transport.learns_peer() && state.peers.admit(address, circumstances);
        if admitted {
            state.peer = Some(from);
        }
        admitted
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
                    tracing::debug!(command = %settled.command, "autopilot accepted");
                }
                outcome => {
                    tracing::warn!(command = %settled.command, %outcome, "autopilot refused");
                }
            }
        }
    }

    /// The streams, and why it would not arm.
    fn ask_for_streams(&self, commands: &mut Commands) {
        if self.config.firmware == Firmware::Px4 {
            commands.submit(Command::TellChecks);
        }
        for (message, hz) in self.config.firmware.streams(&self.config.rates) {
            commands.submit(Command::Stream { message, hz });
        }
    }

    fn housekeeping(&self) {
        let now = self.now();
        let mut messages = Vec::new();
        {
            let mut state = self.lock();
            if state.peer.is_none() {
                return;
            }
            if due(&mut state.sent.timesync, now, TIMESYNC_EVERY_S) {
                messages.push(state.view.timesync_request(now));
            }
            if due(&mut state.sent.heartbeat, now, HEARTBEAT_EVERY_S) {
                messages.push(self.heartbeat());
            }
            if state.commands.unanswered()
                && state.commands.is_idle()
                && due(&mut state.sent.streams, now, STREAMS_EVERY_S)
            {
                self.ask_for_streams(&mut state.commands);
            }
            if state.view.refuses_to_arm(now) && due(&mut state.sent.checks, now, CHECKS_EVERY_S) {
                state.commands.submit(Command::TellChecks);
            }
            if due(&mut state.sent.parameters, now, PARAMETERS_EVERY_S) {
                messages.extend(self.questions(&state, now));
            }
        }
        for message in &messages {
            self.send_counted(message);
        }
        self.send_due_commands();
    }

    /// The parameters to ask for: those not told yet, and ArduPilot's options as long as they are wrong.
    fn questions(&self, state: &State, now: Time) -> Vec<MavMessage> {
        let Firmware::ArduPilot(_) = self.config.firmware else { return Vec::new() };
        let status = state.view.status(now);
        if !status.connected {
            return Vec::new();
        }
        let wanted = |name: &&str| {
            state.view.parameter(name).is_none() || (*name == GUIDED_OPTIONS && status.thrust_problem().is_some())
        };
        let (system, component) = (self.config.target_system, self.config.target_component);
        let names = self.config.firmware.parameters().into_iter().filter(wanted);
        names.map(|name| parameters::request(name, system, component)).collect()
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
}

/// The peer's UDP address, if it has one.
fn known(state: &State) -> Option<SocketAddr> {
    match state.peer {
        Some(Peer::Udp(address)) => Some(address),
        Some(Peer::Line) | None => None,
    }
}

/// `every` seconds have gone since `last`, which becomes `now`.
fn due(last: &mut Option<Time>, now: Time, every: f64) -> bool {
    let due = last.is_none_or(|last| now.since(last) >= every);
    if due {
        *last = Some(now);
    }
    due
}
