//! Start and stop: queries from the ground, answered by the controller's own decision. A repeated command id gets its
//! first answer again and does nothing.

use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use goshawk_bus::{Bus, BusError};
use goshawk_core::Command;
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_vehicle::clock;
use goshawk_vehicle::config::Vehicle;
use goshawk_vehicle::desk::{Decided, Desk, Parsed, Taken, WAIT};
use prost::Message;
use zenoh::Wait;
use zenoh::query::Query;

use crate::flight::shared::{PendingCommand, Report, Shared, lock};

/// A query that waits for its answer.
pub struct Asked {
    key: Key,
    query: Query,
}

/// A query that is done with, for [`send`]. Beside that, [`serve_pings`] for the pings it answers and
/// [`super::missed::serve`] for what was missed, nobody may drop a query: the last of it to go tells the asker that no
/// more will come, and where the asker wants that waited with, it waits until the asker's link moves or is given up.
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

/// Declares a question that is no command; more than a few at once go unanswered.
///
/// # Errors
/// Zenoh refused the declaration.
pub fn declare_question(bus: &Bus, key: Key, answers: &Sender<Answer>) -> Result<Receiver<Query>, BusError> {
    let (sender, receiver) = sync_channel(4);
    let answers = answers.clone();
    bus.queryable(key, move |query| queue(&sender, query, &answers, |query| query))?;
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
                let barred = key == Key::CmdStart && shared.barred.load(Ordering::Relaxed);
                let decided =
                    if barred { Decided { reply: parsed.barred(), settled: true } } else { ask(&parsed, shared) };
                let Decided { reply, settled } = record(&parsed, decided, shared);
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

/// Notes what was decided, for the log and whoever watches.
pub fn record(parsed: &Parsed, mut decided: Decided, shared: &Shared) -> Decided {
    decided.reply.mode = shared.mode.load(Ordering::Relaxed);
    shared.report(Report::Command(v1::CommandRecord {
        stamp_ns: clock::now().0,
        verb: parsed.verb().to_owned(),
        profile: parsed.profile.clone(),
        reply: Some(decided.reply.clone()),
    }));
    decided
}

/// Puts a command to the controller, and waits a little for its verdict.
pub fn ask(parsed: &Parsed, shared: &Shared) -> Decided {
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
        let refused = ask(&parsed(start()), &shared);
        assert!(!refused.reply.accepted && refused.settled);
        assert!(lock(&shared.command).is_none());
        assert!(!ask(&parsed(Command::Stop), &shared).settled);
        assert!(lock(&shared.command).as_ref().is_some_and(|pending| pending.command == Command::Stop));
    }
}
