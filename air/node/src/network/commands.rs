//! Start and stop: queries from the ground, answered by the controller's own decision. A repeated command id gets its
//! first answer again and does nothing.

use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use goshawk_core::{Command, Refusal, StopAction};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_vehicle::clock;
use goshawk_vehicle::config::Vehicle;
use prost::Message;
use zenoh::Wait;
use zenoh::query::Query;

use crate::flight::shared::{PendingCommand, Report, Shared, lock};
use crate::network::bus::{Bus, BusError};

const REMEMBERED: usize = 64;
/// The controller's answer is waited for so long.
pub const WAIT: Duration = Duration::from_millis(200);

/// A query that waits for its answer.
pub struct Asked {
    key: Key,
    query: Query,
}

/// A query that is done with, for [`send`]. Beside that, and [`serve_pings`] for the pings it answers, nobody may drop a
/// query: the last of it to go tells the asker that no more will come, and where the asker wants that waited with, it
/// waits until the asker's link moves or is given up.
pub struct Answer {
    query: Query,
    /// None: it goes unanswered, and the asker repeats it.
    payload: Option<Vec<u8>>,
}

/// Declares the two queryables; queries wait in a short queue for [`serve`], and go unanswered when it is full.
///
/// # Errors
/// Zenoh refused a declaration.
pub fn declare(bus: &Bus, answers: &Sender<Answer>) -> Result<Receiver<Asked>, BusError> {
    let (sender, receiver) = sync_channel(16);
    for key in [Key::CmdStart, Key::CmdStop] {
        let (sender, answers) = (sender.clone(), answers.clone());
        bus.queryable(key, move |query| queue(&sender, Asked { key, query }, &answers, |asked| asked.query))?;
    }
    Ok(receiver)
}

/// Declares the question that is answered by coming back; more than a few at once go unanswered.
///
/// # Errors
/// Zenoh refused the declaration.
pub fn declare_ping(bus: &Bus, answers: &Sender<Answer>) -> Result<Receiver<Query>, BusError> {
    let (sender, receiver) = sync_channel(4);
    let answers = answers.clone();
    bus.queryable(Key::Ping, move |query| queue(&sender, query, &answers, |query| query))?;
    Ok(receiver)
}

fn queue<T>(sender: &SyncSender<T>, asked: T, answers: &Sender<Answer>, query: impl Fn(T) -> Query) {
    if let Err(TrySendError::Full(asked) | TrySendError::Disconnected(asked)) = sender.try_send(asked) {
        let _ = answers.send(Answer { query: query(asked), payload: None });
    }
}

/// Answers pings until the process stops: apart from the commands, which no flood of them may hold up.
pub fn serve_pings(asked: &Receiver<Query>, shared: &Shared) {
    while !shared.stopping() {
        if let Ok(query) = asked.recv_timeout(Duration::from_millis(100)) {
            let _ = query.reply(query.key_expr().clone(), Vec::new()).wait();
        }
    }
}

/// Sends answers until the process stops: apart from the commands, which must not wait until another ground's link, over
/// which an answer goes, moves again. Zenoh gives up a link that stands still for 5 s; until then what waits here has no
/// bound, for what is too much could only be dropped by waiting.
pub fn send(answers: &Receiver<Answer>, shared: &Shared) {
    while !shared.stopping() {
        let Ok(Answer { query, payload }) = answers.recv_timeout(Duration::from_millis(100)) else { continue };
        let Some(payload) = payload else { continue };
        if let Err(e) = query.reply(query.key_expr().clone(), payload).wait() {
            tracing::warn!("a command's reply could not be sent: {e}");
        }
    }
}

/// Decides on queries until the process stops, and leaves the answers to `answers`.
pub fn serve(asked: &Receiver<Asked>, answers: &Sender<Answer>, shared: &Shared, vehicle: &Vehicle) {
    let mut desk = Desk::default();
    while !shared.stopping() {
        let Ok(Asked { key, query }) = asked.recv_timeout(Duration::from_millis(100)) else { continue };
        let payload = query.payload().map(|p| p.to_bytes().into_owned()).unwrap_or_default();
        let reply = match desk.take(key, &payload, vehicle) {
            Taken::Answered(reply) => reply,
            Taken::New(parsed) => {
                let Decided { mut reply, settled } = ask_controller(&parsed, shared);
                reply.mode = shared.mode.load(Ordering::Relaxed);
                shared.report(Report::Command(v1::CommandRecord {
                    stamp_ns: clock::now().0,
                    verb: if key == Key::CmdStart { "start" } else { "stop" }.to_owned(),
                    profile: parsed.profile,
                    reply: Some(reply.clone()),
                }));
                if !settled {
                    continue; // the ground repeats an unanswered stop; the repeat gets the answer
                }
                desk.remember(&reply);
                reply
            }
        };
        let _ = answers.send(Answer { query, payload: Some(reply.encode_to_vec()) });
    }
}

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
        let accepted = format!("taking off with profile {name}");
        (m.command_id, name, Command::Start(profile), accepted)
    } else {
        let accepted = match vehicle.tuning().mission.on_stop {
            StopAction::Land => "stopping and landing",
            StopAction::Hover => "stopping; a second stop lands",
            StopAction::HandOver => "handing over to the autopilot",
        };
        (
            v1::StopRequest::decode(payload).map_err(malformed)?.command_id,
            String::new(),
            Command::Stop,
            accepted.to_owned(),
        )
    };
    if id.is_empty() || id.len() > 64 {
        return Err((id.chars().take(64).collect(), "command_id must have 1 to 64 bytes".to_owned()));
    }
    Ok(Parsed { id, profile, command, accepted })
}

fn ask_controller(parsed: &Parsed, shared: &Shared) -> Decided {
    let (answer, verdict) = sync_channel(1);
    {
        let mut slot = lock(&shared.command);
        // A stop is never held up: it replaces a start that the controller has not taken yet.
        if slot.is_some() && parsed.command != Command::Stop {
            return Decided { reply: parsed.busy(), settled: true };
        }
        *slot = Some(PendingCommand { command: parsed.command, profile: parsed.profile.as_str().into(), answer });
    }
    let verdict = verdict.recv_timeout(WAIT).ok().or_else(|| {
        // What the controller has taken meanwhile it answers within the step.
        let untaken = parsed.lapses() && lock(&shared.command).take().is_some();
        if parsed.lapses() && !untaken { verdict.recv_timeout(WAIT).ok() } else { None }
    });
    parsed.decided(verdict)
}

fn refusal(command_id: String, reason: String) -> v1::CommandReply {
    v1::CommandReply { command_id, accepted: false, reason, mode: v1::Mode::Unspecified.into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use goshawk_core::{Profile, Task};

    fn parsed(command: Command) -> Parsed {
        Parsed { id: "a".to_owned(), profile: String::new(), command, accepted: "yes".to_owned() }
    }

    fn start() -> Command {
        Command::Start(Profile { task: Task::Track, speed: 3.0, height: 1.5, goal: None })
    }

    #[test]
    fn a_start_that_the_controller_does_not_take_in_time_is_refused_and_taken_back_and_a_stop_stands() {
        let shared = Shared::new(sync_channel(1).0);
        let refused = ask_controller(&parsed(start()), &shared);
        assert!(!refused.reply.accepted && refused.settled);
        assert!(lock(&shared.command).is_none());
        assert!(!ask_controller(&parsed(Command::Stop), &shared).settled);
        assert!(lock(&shared.command).as_ref().is_some_and(|pending| pending.command == Command::Stop));
    }

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
