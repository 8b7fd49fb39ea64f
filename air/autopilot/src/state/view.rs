//! What is known of the autopilot: packets in, newest values out. Pure; time is an argument.

use crate::dialogue::arming::Arming;
use crate::dialogue::commands::{Ack, Command, Outcome};
use crate::dialogue::events::AutopilotEvent;
use crate::dialogue::firmware::{Firmware, GUIDED_OPTIONS, Identity};
use crate::dialogue::mode::FlightMode;
use crate::dialogue::parameters::{self, Parameter};
use crate::messages::{
    CURRENT_MODE_DATA, EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA, MavLandedState, MavMessage, MavModeFlag, MavState,
    PARAM_VALUE_DATA, STATUSTEXT_DATA, TIMESYNC_DATA,
};
use crate::state::batteries::Batteries;
use crate::state::clock::ClockMap;
use crate::state::estimate::Estimate;
use crate::state::pose::Unusable;
use crate::state::radio::Radio;
use crate::state::status::{Counters, Status, StatusText};
use crate::state::validity::Validity;
use crate::wire::packet::{Packet, Reject};
use goshawk_core::{Imu, Odometry, Time};
use mavlink::MavHeader;
use std::collections::{BTreeMap, VecDeque};

mod contact;

/// Without a heartbeat for this long the autopilot counts as gone: three are missing.
pub const HEARTBEAT_TIMEOUT_S: f64 = 3.0;
/// Texts and events kept for whoever takes them; older ones go first.
const NOTES_KEPT: usize = 64;

/// What taking a packet asks of the link.
#[derive(Clone, Debug, Default)]
pub struct Accepted {
    /// An answer to send.
    pub reply: Option<MavMessage>,
    /// First heartbeat after silence, or after a restart: ask for the streams again.
    pub greet: bool,
    /// It has started again: whatever it was asked before is void.
    pub restarted: bool,
}

/// The newest of everything that the autopilot says.
#[derive(Clone, Debug)]
pub struct View {
    target_system: u8,
    target_component: u8,
    firmware: Firmware,
    identity: Option<Identity>,
    clock: ClockMap,
    heartbeat: Option<Time>,
    sequence: Option<u8>,
    armed: bool,
    offboard: bool,
    failsafe: bool,
    landed: Option<bool>,
    mode: Option<FlightMode>,
    intended_mode: Option<FlightMode>,
    batteries: Batteries,
    estimate: Estimate,
    validity: Validity,
    arming: Arming,
    parameters: BTreeMap<String, Parameter>,
    radio: Option<Radio>,
    texts: VecDeque<StatusText>,
    events: VecDeque<(Time, AutopilotEvent)>,
    /// When anything of it last came.
    heard: Option<Time>,
    /// It fell silent, and nothing has told since whether it has started again.
    unsure: bool,
    /// Its newest time since boot, ms.
    boot_ms: u64,
    /// Its newest time as TIMESYNC tells it, ms.
    sync_ms: u64,
    /// The newest event's number.
    event: Option<u16>,
    /// An autopilot of other ids that is heard: system and component.
    other: Option<(u8, u8)>,
    /// Traffic; the link adds what it alone sees.
    pub counters: Counters,
}

impl View {
    /// Knows nothing yet of the given system and component, which is to be of that firmware.
    #[must_use]
    pub fn new(target_system: u8, target_component: u8, firmware: Firmware) -> Self {
        Self {
            target_system,
            target_component,
            firmware,
            identity: None,
            clock: ClockMap::default(),
            heartbeat: None,
            sequence: None,
            armed: false,
            offboard: false,
            failsafe: false,
            landed: None,
            mode: None,
            intended_mode: None,
            batteries: Batteries::default(),
            estimate: Estimate::default(),
            validity: Validity::default(),
            arming: Arming::default(),
            parameters: BTreeMap::new(),
            radio: None,
            texts: VecDeque::with_capacity(NOTES_KEPT),
            events: VecDeque::with_capacity(NOTES_KEPT),
            heard: None,
            unsure: false,
            boot_ms: 0,
            sync_ms: 0,
            event: None,
            other: None,
            counters: Counters::default(),
        }
    }

    /// Is this packet the autopilot's?
    #[must_use]
    pub fn is_target(&self, packet: &Packet) -> bool {
        self.is_ours(&packet.header)
    }

    fn is_ours(&self, header: &MavHeader) -> bool {
        header.system_id == u32::from(self.target_system) && header.component_id == self.target_component
    }

    /// Counts what was no packet. `from`: the header of one that only we cannot read, which is not lost.
    pub fn reject(&mut self, reject: Reject, from: Option<MavHeader>) {
        if let Some(header) = from.filter(|header| self.is_ours(header)) {
            self.follow(header.sequence);
        }
        let counter = match reject {
            Reject::Garbage => &mut self.counters.garbage,
            Reject::Truncated => &mut self.counters.truncated,
            Reject::Checksum => &mut self.counters.checksum,
            Reject::Flags | Reject::Unknown | Reject::Payload => &mut self.counters.unknown,
        };
        *counter += 1;
    }

    /// Takes a packet that arrived `now`.
    pub fn accept(&mut self, now: Time, packet: &Packet) -> Accepted {
        let mut accepted = Accepted::default();
        if !self.is_target(packet) {
            self.foreign(packet);
            return accepted;
        }
        self.counters.received += 1;
        self.unsure |= self.has_fallen_silent(now);
        self.heard = Some(now);
        accepted.restarted = self.has_restarted(&packet.message);
        self.unsure &= !contact::tells_who(&packet.message);
        self.follow(packet.header.sequence);
        let flies = self.landed == Some(false);
        self.validity.take(now, &packet.message, self.firmware, flies);
        match &packet.message {
            MavMessage::HEARTBEAT(heartbeat) => accepted.greet = self.heartbeat(now, heartbeat),
            MavMessage::CURRENT_MODE(mode) => self.current_mode(mode),
            MavMessage::EXTENDED_SYS_STATE(state) => self.landed = landed(state),
            MavMessage::SYS_STATUS(status) => {
                self.batteries.take_any(now, status.battery_remaining);
                self.arming.sys_status(self.firmware, status);
            }
            MavMessage::BATTERY_STATUS(battery) => self.batteries.take(now, battery),
            // One that came already comes again when another on the line asks for what it missed.
            MavMessage::EVENT(event) if self.is_new_event(event.sequence) => {
                self.arming.event(event);
                self.event(now, AutopilotEvent::of(event));
            }
            MavMessage::EVENT(_) => {}
            MavMessage::STATUSTEXT(text) => self.text(now, text),
            MavMessage::PARAM_VALUE(value) => self.parameter_told(value),
            MavMessage::RC_CHANNELS(channels) => self.radio = Some(Radio::of(now, channels)),
            MavMessage::TIMESYNC(sync) => accepted.reply = self.timesync(now, sync),
            motion => match self.estimate.take(&mut self.clock, now, motion) {
                Ok(()) => {}
                Err(Unusable::NotFinite) => self.counters.not_finite += 1,
                Err(Unusable::Frame) => self.counters.odometry_frame += 1,
            },
        }
        accepted
    }

    /// Notes how a command ended: an accepted arming is known before the next heartbeat says so.
    pub fn settled(&mut self, ack: &Ack) {
        match (ack.command, ack.outcome) {
            (Command::Arm, Outcome::Accepted) => self.armed = true,
            (Command::Disarm { .. }, Outcome::Accepted) => self.armed = false,
            _ => {}
        }
    }

    /// The TIMESYNC request to send `now`.
    pub fn timesync_request(&mut self, now: Time) -> MavMessage {
        self.clock.asked(now);
        MavMessage::TIMESYNC(TIMESYNC_DATA {
            tc1: 0,
            ts1: now.0 as i64,
            target_system: self.target_system,
            target_component: self.target_component,
        })
    }

    /// The state as known at `now`.
    #[must_use]
    pub fn status(&self, now: Time) -> Status {
        let heartbeat_age_s = self.heartbeat.map(|heard| now.since(heard));
        let position_fault = self.validity.fault(now).or_else(|| self.estimate.contradiction(now));
        let mut status = Status {
            firmware: self.firmware,
            identity: self.identity,
            guided_options: self.parameter(GUIDED_OPTIONS),
            connected: heartbeat_age_s.is_some_and(|age| age < HEARTBEAT_TIMEOUT_S),
            armed: self.armed,
            offboard: self.offboard,
            failsafe: self.failsafe,
            landed: self.landed,
            mode: self.mode,
            intended_mode: self.intended_mode,
            battery_fraction: self.batteries.fraction(),
            position: position_fault.map_or_else(|| self.validity.position(now), |_| Some(false)),
            position_fault,
            would_arm: if self.armed { None } else { self.arming.would_arm(self.mode) },
            unanswered: false,
            other: self.other,
            heartbeat_age_s,
            round_trip_s: self.clock.round_trip(now),
            counters: self.counters,
        };
        // In the right mode, but with our thrust taken for a climb rate, it does not follow us.
        status.offboard &= status.thrust_problem().is_none();
        status
    }

    /// Newest odometry, stamped in our clock; none: nothing usable came yet. Freshness is for the caller to judge.
    #[must_use]
    pub fn odometry(&self) -> Option<Odometry> {
        self.estimate.odometry()
    }

    /// Newest inertial sample.
    #[must_use]
    pub fn imu(&self) -> Option<Imu> {
        self.estimate.imu()
    }

    /// What the pilot's radio last said; none: the autopilot has told nothing of it.
    #[must_use]
    pub fn radio(&self) -> Option<Radio> {
        self.radio
    }

    /// A parameter that the autopilot has told; none: it has not.
    #[must_use]
    pub fn parameter(&self, name: &str) -> Option<Parameter> {
        self.parameters.get(name).copied()
    }

    fn parameter_told(&mut self, message: &PARAM_VALUE_DATA) {
        let firmware = self.firmware;
        // Another on the line may have all of them told to it.
        let needed = |name: &str| firmware.parameters().contains(&name) || firmware.stick_parameters().contains(&name);
        if let Some((name, parameter)) = parameters::told(message, firmware)
            && (self.parameters.len() < parameters::KEPT || self.parameters.contains_key(&name) || needed(&name))
        {
            self.parameters.insert(name, parameter);
        }
    }

    /// Takes the texts that came since the last call, oldest first.
    pub fn take_texts(&mut self) -> Vec<StatusText> {
        self.texts.drain(..).collect()
    }

    /// Takes the events that came since the last call, oldest first, with their arrivals.
    pub fn take_events(&mut self) -> Vec<(Time, AutopilotEvent)> {
        self.events.drain(..).collect()
    }

    /// True: contact is new.
    fn heartbeat(&mut self, now: Time, heartbeat: &HEARTBEAT_DATA) -> bool {
        let greet = !self.status(now).connected;
        if greet {
            // After a restart they may be others.
            self.parameters.clear();
            self.event = None;
            (self.validity, self.arming) = (Validity::default(), Arming::default());
            self.estimate.compare_anew();
        }
        self.heartbeat = Some(now);
        self.identity = Some(Identity { autopilot: heartbeat.autopilot, vehicle: heartbeat.mavtype });
        self.armed = heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
        self.enter(heartbeat.custom_mode);
        self.failsafe = matches!(heartbeat.system_status, MavState::MAV_STATE_CRITICAL | MavState::MAV_STATE_EMERGENCY);
        greet
    }

    fn enter(&mut self, custom_mode: u32) {
        let mode = self.firmware.mode(custom_mode);
        self.mode = Some(mode);
        self.offboard = mode == self.firmware.follows();
    }

    fn current_mode(&mut self, current: &CURRENT_MODE_DATA) {
        self.enter(current.custom_mode);
        // 0 stands for "not known" in the message's definition; ArduPilot's STABILIZE is 0 too, and never our wish.
        let intended = (current.intended_custom_mode != 0).then_some(current.intended_custom_mode);
        self.intended_mode = intended.map(|intended| self.firmware.mode(intended));
        self.failsafe = intended.is_some_and(|intended| intended != current.custom_mode);
    }

    fn event(&mut self, now: Time, event: AutopilotEvent) {
        match event {
            AutopilotEvent::Armed => self.armed = true,
            AutopilotEvent::Disarmed => self.armed = false,
            AutopilotEvent::TakeoffDetected => self.landed = Some(false),
            AutopilotEvent::LandingDetected => self.landed = Some(true),
            AutopilotEvent::FailsafeEntered => {
                self.failsafe = true;
                self.offboard = false;
            }
            _ => {}
        }
        keep(&mut self.events, (now, event));
    }

    fn text(&mut self, now: Time, text: &STATUSTEXT_DATA) {
        let line = text.text.to_str().unwrap_or("(text that is not UTF-8)").trim_end_matches('\0').to_owned();
        self.arming.text(now, &line);
        keep(&mut self.texts, StatusText { stamp: now, severity: text.severity as u8, text: line });
    }

    fn timesync(&mut self, now: Time, sync: &TIMESYNC_DATA) -> Option<MavMessage> {
        if sync.tc1 == 0 {
            // Their question: our time beside theirs.
            return Some(MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: now.0 as i64,
                ts1: sync.ts1,
                target_system: self.target_system,
                target_component: self.target_component,
            }));
        }
        if let (Ok(asked), Ok(remote)) = (u64::try_from(sync.ts1), u64::try_from(sync.tc1)) {
            self.clock.answered(now, Time(asked), remote);
        }
        None
    }
}

fn keep<T>(notes: &mut VecDeque<T>, note: T) {
    if notes.len() == NOTES_KEPT {
        notes.pop_front();
    }
    notes.push_back(note);
}

fn landed(state: &EXTENDED_SYS_STATE_DATA) -> Option<bool> {
    match state.landed_state {
        MavLandedState::MAV_LANDED_STATE_ON_GROUND => Some(true),
        MavLandedState::MAV_LANDED_STATE_UNDEFINED => None,
        _ => Some(false),
    }
}

/// Percent on the wire, -1 for unknown.
#[cfg(test)]
mod copter_tests;
#[cfg(test)]
mod tests;
