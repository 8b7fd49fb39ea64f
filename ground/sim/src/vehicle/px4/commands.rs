//! Commands as PX4 takes them: who is meant, what is refused, and when the answer leaves.

use super::logic::Px4Logic;
use super::{LossAction, StickOverride};
use goshawk_autopilot::dialogue::commands::FORCE_MAGIC;
use goshawk_autopilot::dialogue::parameters;
use goshawk_autopilot::messages::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult, PARAM_REQUEST_READ_DATA,
};
use goshawk_autopilot::wire::packet::Packet;
use goshawk_autopilot::{Parameter, Px4Mode};

/// Acks were measured to take 1–15 ms; these are taken in turn.
const ACK_DELAYS_S: [f64; 5] = [0.003, 0.007, 0.001, 0.015, 0.005];

impl Px4Logic {
    /// Carries out a command and queues its ack. Wrongly addressed: silence.
    pub(super) fn command(&mut self, from: &Packet, command: &COMMAND_LONG_DATA) {
        if !self.addressed(command.target_system, command.target_component) {
            return;
        }
        let result = match command.command {
            MavCmd::MAV_CMD_DO_SET_MODE => self.set_mode(command),
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM if command.param1 == 1.0 => self.arm(),
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => self.disarm_on_request(command.param2 == FORCE_MAGIC),
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
                let (id, interval_us) = (command.param1 as u32, f64::from(command.param2));
                if self.streams.set_interval(self.now, id, interval_us) {
                    MavResult::MAV_RESULT_ACCEPTED
                } else {
                    MavResult::MAV_RESULT_FAILED
                }
            }
            MavCmd::MAV_CMD_RUN_PREARM_CHECKS => {
                self.tell_checks();
                MavResult::MAV_RESULT_ACCEPTED
            }
            _ => MavResult::MAV_RESULT_UNSUPPORTED,
        };
        let ack = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command: command.command,
            result,
            target_system: from.header.system_id as u8,
            target_component: from.header.component_id,
            ..COMMAND_ACK_DATA::default()
        });
        let late = self.arms_at.filter(|_| command.param1 == 1.0).map_or(0.0, |at| at.since(self.now));
        let delay_s = late + ACK_DELAYS_S[self.acks % ACK_DELAYS_S.len()];
        self.acks += 1;
        self.outbox.push((self.now.plus(delay_s), ack));
    }

    /// The parameters that the configuration holds; as PX4 does, it says nothing about one that it does not know.
    pub(super) fn tell_parameter(&mut self, asked: &PARAM_REQUEST_READ_DATA) {
        let name = asked.param_id.to_str().unwrap_or_default().trim_end_matches('\0');
        let value = match name {
            "COM_OF_LOSS_T" => Parameter::Real(self.config.loss_s as f32),
            "COM_OBL_RC_ACT" => Parameter::Int(match self.config.loss_action {
                LossAction::Position => 0,
                LossAction::Land => 4,
                LossAction::Hold => 5,
            }),
            "MAN_OVERRIDE_SPD" => match self.config.sticks {
                StickOverride::Speed(speed) => Parameter::Real(speed as f32),
                StickOverride::Bits(_) => return,
            },
            "COM_RC_OVERRIDE" => match self.config.sticks {
                StickOverride::Bits(bits) => Parameter::Int(bits),
                StickOverride::Speed(_) => return,
            },
            "MPC_THR_HOVER" => Parameter::Real(self.config.hover_thrust.0 as f32),
            _ => return,
        };
        if self.addressed(asked.target_system, asked.target_component) {
            self.outbox.push((self.now, parameters::value(name, value)));
        }
    }

    /// Broadcast or ours.
    pub(super) fn addressed(&self, system: u8, component: u8) -> bool {
        (system == 0 || system == self.config.system_id) && (component == 0 || component == self.config.component_id)
    }

    fn set_mode(&mut self, command: &COMMAND_LONG_DATA) -> MavResult {
        let custom = command.param1 as u32 & 1 == 1;
        let raw = u32::from_le_bytes([0, 0, command.param2 as u8, command.param3 as u8]);
        let mode = Px4Mode::from_custom_mode(raw);
        let flown_here = matches!(mode, Px4Mode::Offboard | Px4Mode::Hold | Px4Mode::Land | Px4Mode::Position);
        if !custom || !flown_here {
            return MavResult::MAV_RESULT_DENIED;
        }
        // Disarmed it believes anything; armed, offboard needs a stream.
        if mode == Px4Mode::Offboard && self.armed && !self.stream_is_fresh() {
            return MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        }
        self.intend(mode);
        MavResult::MAV_RESULT_ACCEPTED
    }

    fn arm(&mut self) -> MavResult {
        if self.armed {
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        if !self.can_arm() {
            self.text("Arming denied: Resolve system health failures first");
            return MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        }
        if self.faults.arming_delay_s > 0.0 {
            self.arms_at.get_or_insert(self.now.plus(self.faults.arming_delay_s));
        } else {
            self.set_armed();
        }
        MavResult::MAV_RESULT_ACCEPTED
    }

    fn disarm_on_request(&mut self, force: bool) -> MavResult {
        if self.armed && !self.landed.landed() && !force {
            self.text("Disarming denied: not landed");
            return MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        }
        self.set_disarmed();
        MavResult::MAV_RESULT_ACCEPTED
    }
}
