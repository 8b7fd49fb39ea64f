//! The autopilot of a chaos flight: the PX4 stand-in and the vehicle's own view of it, with the link's commands between
//! them, message by message and without a socket.

use goshawk_autopilot::dialogue::commands::Commands;
use goshawk_autopilot::messages::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavType};
use goshawk_autopilot::session::link::setpoint_message;
use goshawk_autopilot::wire::packet::Packet;
use goshawk_autopilot::{Command, Firmware, Px4Mode, Status, StreamRates, View};
use goshawk_core::{AttitudeThrust, NormalisedThrust, Odometry, Request, Time};
use mavlink::MavHeader;

use super::Acting;
use crate::commands::chaos::schedule::Kind;
use crate::vehicle::px4::{OdometryFault, Px4Config, Px4Logic, VehicleState};

const FIRMWARE: Firmware = Firmware::Px4;
/// System and component, ours and the autopilot's.
const OURS: (u32, u8) = (1, 191);
const THEIRS: (u8, u8) = (1, 1);
/// As the link does it.
const HEARTBEAT_EVERY_S: f64 = 1.0;
const TIMESYNC_EVERY_S: f64 = 0.1;

/// The stand-in, the view of it, and what is under way between them.
pub(crate) struct Autopilot {
    px4: Px4Logic,
    view: View,
    commands: Commands,
    /// On the way to the autopilot; it arrives with the next step.
    outward: Vec<MavMessage>,
    inward: Vec<MavMessage>,
    sequence: u8,
    heartbeat: Option<Time>,
    timesync: Option<Time>,
}

impl Autopilot {
    pub(crate) fn new(hover: NormalisedThrust) -> Self {
        Self {
            px4: Px4Logic::new(Px4Config { hover_thrust: hover, ..Px4Config::default() }),
            view: View::new(THEIRS.0, THEIRS.1, FIRMWARE),
            commands: Commands::default(),
            outward: Vec::new(),
            inward: Vec::new(),
            sequence: 0,
            heartbeat: None,
            timesync: None,
        }
    }

    /// A millisecond: what it was sent arrives, what it answers is taken. What the motors are to do; none: they stand.
    pub(crate) fn step(&mut self, now: Time, vehicle: &VehicleState, acting: &Acting) -> Option<AttitudeThrust> {
        self.suffer(acting);
        let mut told = *vehicle;
        if let Some(charge) = acting.number(|kind| if let Kind::BatteryLow(x) = kind { Some(*x) } else { None }) {
            told.battery_fraction = charge;
        }
        let header = MavHeader { system_id: OURS.0, component_id: OURS.1, sequence: 0 };
        let lost = acting.any(&Kind::SetpointsLost);
        let arrives = |message: &MavMessage| !(lost && matches!(message, MavMessage::SET_ATTITUDE_TARGET(_)));
        let packets: Vec<Packet> =
            self.outward.drain(..).filter(arrives).map(|message| Packet { header, message }).collect();
        let output = self.px4.step(now, &packets, &told, &mut self.inward);
        let heard = std::mem::take(&mut self.inward);
        for message in heard {
            self.sequence = self.sequence.wrapping_add(1);
            if !acting.any(&Kind::Silent) {
                self.hear(now, message);
            }
        }
        self.keep_house(now);
        output.demand
    }

    /// What the schedule does to it.
    fn suffer(&mut self, acting: &Acting) {
        let faults = &mut self.px4.faults;
        faults.unarmable = acting.any(&Kind::Unarmable);
        faults.deaf = acting.any(&Kind::Deaf);
        faults.no_position = acting.any(&Kind::NoPosition);
        faults.arming_delay_s =
            acting.number(|kind| if let Kind::ArmsLate(x) = kind { Some(*x) } else { None }).unwrap_or(0.0);
        let nan = acting.any(&Kind::OdometryNan);
        self.px4.set_odometry_fault(nan.then_some(OdometryFault::NotFinite));
        for kind in acting.begun() {
            match kind {
                Kind::PilotTakesOver => self.px4.pilot_takes_over(Px4Mode::Position),
                Kind::LandsByItself => self.px4.pilot_takes_over(Px4Mode::Land),
                Kind::Restarts(boot_s) => self.px4.restart(*boot_s),
                Kind::Disarms => self.px4.stop_motors(),
                _ => {}
            }
        }
    }

    fn hear(&mut self, now: Time, message: MavMessage) {
        let header = MavHeader { system_id: THEIRS.0.into(), component_id: THEIRS.1, sequence: self.sequence };
        let packet = Packet { header, message };
        let accepted = self.view.accept(now, &packet);
        if accepted.greet || accepted.restarted {
            self.commands.clear();
        }
        if accepted.greet {
            self.commands.submit(Command::TellChecks);
            for (message, hz) in FIRMWARE.streams(&StreamRates::default()) {
                self.commands.submit(Command::Stream { message, hz });
            }
        }
        if let MavMessage::COMMAND_ACK(ack) = &packet.message
            && let Some(settled) = self.commands.answered(now, ack)
        {
            self.view.settled(&settled);
        }
        self.outward.extend(accepted.reply);
    }

    /// What the link's thread does beside receiving.
    fn keep_house(&mut self, now: Time) {
        if self.view.has_fallen_silent(now) {
            self.commands.drop_orders(now);
        }
        if due(&mut self.timesync, now, TIMESYNC_EVERY_S) {
            let asked = self.view.timesync_request(now);
            self.outward.push(asked);
        }
        if due(&mut self.heartbeat, now, HEARTBEAT_EVERY_S) {
            self.outward.push(MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
                autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
                ..HEARTBEAT_DATA::default()
            }));
        }
        while let Some(message) = self.commands.due(now, THEIRS.0, THEIRS.1) {
            self.outward.push(message);
        }
    }

    /// What the controller asks.
    pub(crate) fn request(&mut self, request: Request) {
        self.commands.submit(FIRMWARE.command(request));
    }

    /// What the controller sends. What is no setpoint is not sent, as by the link.
    pub(crate) fn send(&mut self, now: Time, setpoint: &AttitudeThrust) {
        self.outward.extend(setpoint_message(setpoint, now, THEIRS).ok());
    }

    /// As the controller's thread sees it.
    pub(crate) fn glance(&self, now: Time) -> (Status, Option<Odometry>) {
        (self.view.status(now), self.view.odometry())
    }
}

/// True each `every_s`.
fn due(last: &mut Option<Time>, now: Time, every_s: f64) -> bool {
    let due = last.is_none_or(|last| now.since(last) >= every_s);
    if due {
        *last = Some(now);
    }
    due
}
