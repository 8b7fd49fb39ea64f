//! Where the ground's requests arrive: read, answered once, and what the controller's verdict on them means. Pure, so
//! that the simulator's operator stands before the same desk.

use std::collections::VecDeque;
use std::time::Duration;

use goshawk_core::{Command, Refusal, StopAction};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use prost::Message;

use crate::config::{Position, Vehicle};

/// Answers that are kept for commands that are repeated. Chosen by eye.
const REMEMBERED: usize = 64;
/// The controller's answer is waited for so long. Chosen by eye.
pub const WAIT: Duration = Duration::from_millis(200);

/// A command that can be put to the controller.
#[derive(Clone, Debug, PartialEq)]
pub struct Parsed {
    /// 1 to 64 bytes.
    pub id: String,
    /// A start's; empty for a stop.
    pub profile: String,
    /// For the controller.
    pub command: Command,
    /// What is answered if the controller accepts it.
    pub accepted: String,
}

/// What becomes of a request.
pub enum Taken {
    /// It makes no sense, or was answered before: nothing is done.
    Answered(v1::CommandReply),
    /// The controller is to decide; then [`Desk::remember`].
    New(Parsed),
}

/// What was decided on a request.
#[derive(Debug)]
pub struct Decided {
    /// For whoever asked, and for the log.
    pub reply: v1::CommandReply,
    /// It is final. Else it is only logged, neither remembered nor sent: a stop that stands is not called refused.
    pub settled: bool,
}

/// Where requests arrive. Pure: it knows the answers that were given, so that a repeated id gets its first one again.
#[derive(Debug, Default)]
pub struct Desk {
    answered: VecDeque<v1::CommandReply>,
}

impl Desk {
    /// Takes a request's payload on `key`, the key of starts or that of stops.
    #[must_use]
    pub fn take(&self, key: Key, payload: &[u8], vehicle: &Vehicle) -> Taken {
        match parse(key, payload, vehicle) {
            Err((id, why)) => Taken::Answered(refusal(id, why)),
            Ok(parsed) => match self.answered.iter().find(|reply| reply.command_id == parsed.id) {
                Some(reply) => Taken::Answered(reply.clone()),
                None => Taken::New(parsed),
            },
        }
    }

    /// Remembers an answer; the oldest of many is forgotten.
    pub fn remember(&mut self, reply: &v1::CommandReply) {
        if self.answered.len() == REMEMBERED {
            self.answered.pop_front();
        }
        self.answered.push_back(reply.clone());
    }
}

impl Parsed {
    /// The command in one word, for the log.
    #[must_use]
    pub fn verb(&self) -> &'static str {
        match self.command {
            Command::Start(_) => "start",
            Command::Stop => "stop",
            Command::Hold => "hold",
            Command::Resume => "resume",
        }
    }

    /// The answer where the pilot's switch stands at stop, or nobody knows where.
    #[must_use]
    pub fn barred(&self) -> v1::CommandReply {
        refusal(self.id.clone(), "the pilot's switch stands at stop, or has just been switched on: move it".to_owned())
    }

    /// Unanswered in time it is taken back: a start that was refused must not take off once the controller goes on. A
    /// stop stands.
    #[must_use]
    pub fn lapses(&self) -> bool {
        self.command != Command::Stop
    }

    /// The answer while another command waits for the controller.
    #[must_use]
    pub fn busy(&self) -> v1::CommandReply {
        refusal(self.id.clone(), "another command is being carried out: ask again".to_owned())
    }

    /// What the controller's `verdict` means; none: it gave none in time.
    #[must_use]
    pub fn decided(&self, verdict: Option<Result<(), Refusal>>) -> Decided {
        let refused = |why: String| refusal(self.id.clone(), why);
        let reply = match verdict {
            Some(Ok(())) => v1::CommandReply {
                command_id: self.id.clone(),
                accepted: true,
                reason: self.accepted.clone(),
                mode: v1::Mode::Unspecified.into(),
            },
            Some(Err(why)) => refused(why.to_string()),
            None if self.lapses() => refused("the controller did not answer".to_owned()),
            None => refused("the controller has not answered yet; the stop stands".to_owned()),
        };
        Decided { reply, settled: verdict.is_some() || self.lapses() }
    }
}

/// Reads the request that came to `key`.
///
/// # Errors
/// It is malformed or asks for what there is not: its id, as far as it is known, and why.
pub fn parse(key: Key, payload: &[u8], vehicle: &Vehicle) -> Result<Parsed, (String, String)> {
    let malformed = |_| (String::new(), "malformed request".to_owned());
    let (id, profile, command, accepted) = if key == Key::CmdStart {
        let m = v1::StartRequest::decode(payload).map_err(malformed)?;
        let name = if m.profile.is_empty() { vehicle.default_profile.clone() } else { m.profile };
        let Some(profile) = vehicle.profile(Some(&name)) else {
            let known = vehicle.profile_names().join(", ");
            return Err((m.command_id, format!("no profile {name:?}: the vehicle file has {known}")));
        };
        (m.command_id, name.clone(), Command::Start(profile), taking_off(&name))
    } else {
        let id = v1::StopRequest::decode(payload).map_err(malformed)?.command_id;
        (id, String::new(), Command::Stop, stopping(vehicle).to_owned())
    };
    if id.is_empty() || id.len() > 64 {
        return Err((id.chars().take(64).collect(), "command_id must have 1 to 64 bytes".to_owned()));
    }
    Ok(Parsed { id, profile, command, accepted })
}

fn taking_off(profile: &str) -> String {
    format!("taking off with profile {profile}")
}

fn stopping(vehicle: &Vehicle) -> &'static str {
    match vehicle.tuning().mission.on_stop {
        StopAction::Land => "stopping and landing",
        StopAction::Hover => "stopping; a second stop lands",
        StopAction::HandOver => "handing over to the autopilot",
    }
}

/// What the pilot's switch asks for; `flying`: a flight is under way. None: the vehicle file has no such profile.
#[must_use]
pub fn by_switch(id: String, position: Position, flying: bool, vehicle: &Vehicle) -> Option<Parsed> {
    let name = vehicle.switch.as_ref().and_then(|switch| switch.profile.clone());
    let name = name.unwrap_or_else(|| vehicle.default_profile.clone());
    let (profile, command, accepted) = match position {
        Position::Stop => (String::new(), Command::Stop, stopping(vehicle).to_owned()),
        Position::Hold => (String::new(), Command::Hold, "holding the place".to_owned()),
        Position::Start if flying => (String::new(), Command::Resume, "going on".to_owned()),
        Position::Start => (name.clone(), Command::Start(vehicle.profile(Some(&name))?), taking_off(&name)),
    };
    Some(Parsed { id, profile, command, accepted })
}

fn refusal(command_id: String, reason: String) -> v1::CommandReply {
    v1::CommandReply { command_id, accepted: false, reason, mode: v1::Mode::Unspecified.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_repeated_id_gets_its_first_answer_and_whatever_it_asks_is_not_new() {
        let path = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../vehicles/sim.toml"));
        let vehicle = Vehicle::load(path).unwrap();
        let (mut desk, payload) = (Desk::default(), v1::StopRequest { command_id: "b".to_owned() }.encode_to_vec());
        let Taken::New(stop) = desk.take(Key::CmdStop, &payload, &vehicle) else { panic!("it is new") };
        let reply = stop.decided(Some(Ok(()))).reply;
        desk.remember(&reply);
        for key in [Key::CmdStop, Key::CmdStart] {
            assert!(matches!(desk.take(key, &payload, &vehicle), Taken::Answered(again) if again == reply));
        }
    }
}
