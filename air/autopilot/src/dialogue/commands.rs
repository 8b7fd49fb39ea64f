//! What is asked of the autopilot and how it answered: COMMAND_LONG out, COMMAND_ACK in, repeated until answered.

use crate::dialogue::mode::FlightMode;
use crate::messages::{COMMAND_ACK_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult};
use goshawk_core::Time;
use std::collections::VecDeque;
use std::fmt;

/// PX4 was measured to answer in 1–15 ms; a lost datagram is repeated after this.
const REPEAT_AFTER_S: f64 = 0.25;
/// Then it is given up, after a second in all.
const ATTEMPTS: u8 = 4;
/// Answers kept for whoever takes them.
const ANSWERS_KEPT: usize = 64;
/// Asked commands that may wait their turn.
const WAITING: usize = 32;
/// MAV_CMD_COMPONENT_ARM_DISARM's parameter 2 that disarms in the air too.
pub const FORCE_MAGIC: f32 = 21196.0;

/// Something to ask of the autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// MAV_CMD_DO_SET_MODE.
    SetMode(FlightMode),
    /// MAV_CMD_COMPONENT_ARM_DISARM, arm.
    Arm,
    /// MAV_CMD_COMPONENT_ARM_DISARM, disarm. Refused in the air unless forced; forced, the vehicle falls.
    Disarm {
        /// Cut the motors even in the air.
        force: bool,
    },
    /// MAV_CMD_SET_MESSAGE_INTERVAL.
    Stream {
        /// The message's MAVLink id.
        message: u32,
        /// How often, Hz, above 0.
        hz: f64,
    },
    /// MAV_CMD_RUN_PREARM_CHECKS: says again why it would not arm. Changes nothing.
    TellChecks,
}

impl Command {
    fn id(self) -> MavCmd {
        match self {
            Self::SetMode(_) => MavCmd::MAV_CMD_DO_SET_MODE,
            Self::Arm | Self::Disarm { .. } => MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            Self::Stream { .. } => MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            Self::TellChecks => MavCmd::MAV_CMD_RUN_PREARM_CHECKS,
        }
    }

    /// It changes what the autopilot does: void once it may have started again.
    fn is_order(self) -> bool {
        matches!(self, Self::SetMode(_) | Self::Arm | Self::Disarm { .. })
    }

    fn message(self, target_system: u8, target_component: u8, confirmation: u8) -> MavMessage {
        let (param1, param2, param3) = match self {
            Self::SetMode(mode) => {
                let (second, third) = mode.parameters();
                (1.0, second, third) // 1: custom mode enabled
            }
            Self::Arm => (1.0, 0.0, 0.0),
            Self::Disarm { force } => (0.0, if force { FORCE_MAGIC } else { 0.0 }, 0.0),
            Self::Stream { message, hz } => (message as f32, (1e6 / hz).round() as f32, 0.0),
            Self::TellChecks => (0.0, 0.0, 0.0),
        };
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            param2,
            param3,
            command: self.id(),
            target_system,
            target_component,
            confirmation,
            ..COMMAND_LONG_DATA::default()
        })
    }
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SetMode(mode) => write!(f, "set mode {mode}"),
            Self::Arm => f.write_str("arm"),
            Self::Disarm { force: false } => f.write_str("disarm"),
            Self::Disarm { force: true } => f.write_str("disarm, forced"),
            Self::Stream { message, hz } => write!(f, "stream message {message} at {hz} Hz"),
            Self::TellChecks => f.write_str("tell the pre-arm checks"),
        }
    }
}

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Done.
    Accepted,
    /// Not now: a check fails. Asking again later may succeed.
    TemporarilyRejected,
    /// Known, but not with these parameters.
    Denied,
    /// Unknown to this autopilot.
    Unsupported,
    /// Tried, and it failed.
    Failed,
    /// Another refusal that the protocol knows.
    Refused,
    /// No answer to any attempt: the link, or the target's address, is wrong.
    NoAnswer,
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Accepted => "accepted",
            Self::TemporarilyRejected => "temporarily rejected: a check of the autopilot fails",
            Self::Denied => "denied: the parameters are not allowed",
            Self::Unsupported => "not supported by this autopilot",
            Self::Failed => "failed",
            Self::Refused => "refused",
            Self::NoAnswer => "not answered: check the link and the target system and component",
        })
    }
}

/// A command's end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ack {
    /// What was asked.
    pub command: Command,
    /// How it ended.
    pub outcome: Outcome,
    /// When the answer came, or was given up.
    pub stamp: Time,
}

#[derive(Clone, Copy, Debug)]
struct Pending {
    command: Command,
    attempts: u8,
    sent: Time,
}

/// Commands in flight. An answer names only the command's number, so of each number one is in flight at a time.
#[derive(Clone, Debug, Default)]
pub struct Commands {
    pending: VecDeque<Pending>,
    answers: VecDeque<Ack>,
    unanswered: bool,
}

impl Commands {
    /// Asks. A newer mode, or a newer arm or disarm, replaces one that is not answered yet.
    pub fn submit(&mut self, command: Command) {
        match command {
            Command::Stream { .. } => {}
            _ => self.pending.retain(|pending| pending.command.id() != command.id()),
        }
        if self.pending.len() < WAITING {
            self.pending.push_back(Pending { command, attempts: 0, sent: Time(0) });
        }
    }

    /// The next message that is due now; call until none.
    pub fn due(&mut self, now: Time, target_system: u8, target_component: u8) -> Option<MavMessage> {
        let mut index = 0;
        while index < self.pending.len() {
            let pending = self.pending[index];
            let id = pending.command.id();
            let waits = self.pending.iter().take(index).any(|earlier| earlier.command.id() == id);
            if waits || (pending.attempts > 0 && now.since(pending.sent) < REPEAT_AFTER_S) {
                index += 1;
            } else if pending.attempts == ATTEMPTS {
                // Not every firmware answers that question; all answer the others.
                self.unanswered |= pending.command != Command::TellChecks;
                self.finish(index, Outcome::NoAnswer, now);
            } else {
                self.pending[index].attempts += 1;
                self.pending[index].sent = now;
                return Some(pending.command.message(target_system, target_component, pending.attempts));
            }
        }
        None
    }

    /// Takes an answer; gives what it settled.
    pub fn answered(&mut self, now: Time, ack: &COMMAND_ACK_DATA) -> Option<Ack> {
        let index =
            self.pending.iter().position(|pending| pending.attempts > 0 && pending.command.id() == ack.command)?;
        self.unanswered = false;
        let outcome = match ack.result {
            MavResult::MAV_RESULT_IN_PROGRESS => {
                self.pending[index].sent = now;
                return None;
            }
            MavResult::MAV_RESULT_ACCEPTED => Outcome::Accepted,
            MavResult::MAV_RESULT_TEMPORARILY_REJECTED => Outcome::TemporarilyRejected,
            MavResult::MAV_RESULT_DENIED => Outcome::Denied,
            MavResult::MAV_RESULT_UNSUPPORTED => Outcome::Unsupported,
            MavResult::MAV_RESULT_FAILED => Outcome::Failed,
            _ => Outcome::Refused,
        };
        self.finish(index, outcome, now)
    }

    /// Takes the answers that came since the last call, oldest first.
    pub fn take_answers(&mut self) -> Vec<Ack> {
        self.answers.drain(..).collect()
    }

    /// Forgets what is in flight, as for an autopilot that started again.
    pub fn clear(&mut self) {
        self.pending.clear();
        self.unanswered = false;
    }

    /// Gives up the orders in flight: nobody is heard, and whoever is heard next may have started again.
    pub fn drop_orders(&mut self, now: Time) {
        while let Some(index) = self.pending.iter().position(|pending| pending.command.is_order()) {
            self.finish(index, Outcome::NoAnswer, now);
        }
    }

    /// The last command that was repeated to its end got no answer, and none has been answered since.
    #[must_use]
    pub fn unanswered(&self) -> bool {
        self.unanswered
    }

    /// Nothing is in flight.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.pending.is_empty()
    }

    fn finish(&mut self, index: usize, outcome: Outcome, stamp: Time) -> Option<Ack> {
        let ack = Ack { command: self.pending.remove(index)?.command, outcome, stamp };
        if ack.command == Command::TellChecks {
            return Some(ack); // its answer is what comes beside the ack
        }
        if self.answers.len() == ANSWERS_KEPT {
            self.answers.pop_front();
        }
        self.answers.push_back(ack);
        Some(ack)
    }
}

#[cfg(test)]
mod tests;
