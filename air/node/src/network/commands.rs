//! Start and stop: queries from the ground, answered by the controller's own decision. A repeated command id gets its
//! first answer again and does nothing.

use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use goshawk_bus::{Bus, BusError};
use goshawk_core::{Command, Refusal};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_vehicle::clock;
use goshawk_vehicle::config::Vehicle;
use goshawk_vehicle::desk::{Decided, Desk, Parsed, Taken, WAIT};
use prost::Message;
use zenoh::Wait;
use zenoh::query::Query;

use crate::flight::shared::{PendingCommand, Report, Shared, lock};

type Verdict = Result<(), Refusal>;

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

/// Decides on queries until the process stops, and leaves the answers to `answers`. `session` is what heartbeats call
/// this process.
pub fn serve(asked: &Receiver<Asked>, answers: &Sender<Answer>, shared: &Shared, vehicle: &Vehicle, session: u64) {
    let mut desk = Desk::default();
    let mut standing = None;
    while !shared.stopping() {
        let Ok(Asked { key, query }) = asked.recv_timeout(Duration::from_millis(100)) else { continue };
        if goshawk_bus::names_another(key, query.encoding()) {
            let _ = answers.send(Answer { query, payload: None }); // it came to another key: a Stop is no Start
            continue;
        }
        let payload = query.payload().map(|p| p.to_bytes().into_owned()).unwrap_or_default();
        let reply = match desk.take(key, &payload, vehicle) {
            Taken::Answered(reply) => Some(reply),
            Taken::New(parsed) => {
                let flew = shared.flies();
                let refused = if key == Key::CmdStart { refused(&parsed, &payload, shared, session) } else { None };
                let decided = match refused {
                    Some(reply) => Decided { reply, settled: true },
                    None => ask_or_go_on(&parsed, shared, &mut standing),
                };
                let decided = if flew { decided } else { nothing_to_stop(&parsed, decided, shared) };
                let Decided { reply, settled } = record(&parsed, decided, shared);
                settled.then(|| {
                    desk.remember(&reply);
                    reply
                })
            }
        };
        // The ground repeats an unanswered stop; the repeat gets the answer.
        let _ = answers.send(Answer { query, payload: reply.map(|reply| reply.encode_to_vec()) });
    }
}

/// The answer to a start that is not put to the controller: the pilot's switch bars it, or a stop has overtaken it. Its
/// question may have been lost and asked again, while somebody else pressed Stop. None: it is put.
fn refused(parsed: &Parsed, payload: &[u8], shared: &Shared, session: u64) -> Option<v1::CommandReply> {
    if shared.barred.load(Ordering::Relaxed) {
        return Some(parsed.barred());
    }
    let known = v1::StartRequest::decode(payload).ok().filter(|known| known.session != 0)?;
    let why = if known.session != session {
        "the vehicle's program has started anew since this was asked: look, and ask again"
    } else if known.stops < shared.stops.load(Ordering::Relaxed) {
        "a Stop came after this was asked: look, and ask again"
    } else {
        return None;
    };
    Some(v1::CommandReply {
        command_id: parsed.id.clone(),
        accepted: false,
        reason: why.to_owned(),
        mode: v1::Mode::Unspecified.into(),
    })
}

/// A stop that the controller had not answered in time, and where its answer comes.
struct Standing {
    id: String,
    verdict: Receiver<Verdict>,
}

/// Puts a command to the controller, but one that stands: of that it waits for the answer, so that it acts once.
fn ask_or_go_on(parsed: &Parsed, shared: &Shared, standing: &mut Option<Standing>) -> Decided {
    let verdict = match standing.take_if(|stop| stop.id == parsed.id) {
        Some(stop) => stop.verdict,
        None => match put(parsed, shared) {
            Ok((_, verdict)) if parsed.command == Command::Stop => verdict,
            Ok((number, verdict)) => return wait_or_take_back(parsed, shared, number, &verdict),
            Err(busy) => return busy,
        },
    };
    let told = verdict.recv_timeout(WAIT);
    // One that another stop replaced will hear nothing; asked again, it is one more.
    if told == Err(RecvTimeoutError::Timeout) {
        *standing = Some(Standing { id: parsed.id.clone(), verdict });
    }
    decided(parsed, told.ok(), shared)
}

/// A stop that finds no flight of ours is heeded, and says that it does nothing.
pub fn nothing_to_stop(parsed: &Parsed, mut decided: Decided, shared: &Shared) -> Decided {
    if parsed.command == Command::Stop && decided.reply.accepted && !shared.flies() {
        decided.reply.reason = if shared.may_be_in_the_air() {
            "nothing is sent: the autopilot or the pilot has the vehicle".to_owned()
        } else {
            "nothing is sent: no flight of ours is under way".to_owned()
        };
    }
    decided
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
    match put(parsed, shared) {
        Ok((number, verdict)) => wait_or_take_back(parsed, shared, number, &verdict),
        Err(busy) => busy,
    }
}

/// Presses Stop for a process that ends: nobody waits for the answer.
pub fn press_stop(shared: &Shared) {
    let stop =
        Parsed { id: "ends".to_owned(), profile: String::new(), command: Command::Stop, accepted: String::new() };
    let _ = put(&stop, shared);
}

/// Leaves a command for the controller: its number, and where the verdict comes.
///
/// # Errors
/// Another one waits, or it is a start that the pilot's switch bars.
fn put(parsed: &Parsed, shared: &Shared) -> Result<(u64, Receiver<Verdict>), Decided> {
    let (answer, verdict) = sync_channel(1);
    let mut slot = lock(&shared.command);
    // A stop is never held up: it replaces what the controller has not taken yet, whose asker is told that it lapsed.
    if slot.is_some() && parsed.command != Command::Stop {
        return Err(Decided { reply: parsed.busy(), settled: true });
    }
    // The switch may have gone to stop since it was looked at, and its own stop been taken already.
    if matches!(parsed.command, Command::Start(_)) && shared.barred.load(Ordering::Relaxed) {
        return Err(Decided { reply: parsed.barred(), settled: true });
    }
    if parsed.command == Command::Stop {
        shared.stops.fetch_add(1, Ordering::Relaxed);
    }
    let number = shared.commands.fetch_add(1, Ordering::Relaxed);
    let profile = parsed.profile.as_str().into();
    *slot = Some(PendingCommand { number, command: parsed.command, profile, answer });
    Ok((number, verdict))
}

fn wait_or_take_back(parsed: &Parsed, shared: &Shared, number: u64, verdict: &Receiver<Verdict>) -> Decided {
    let told = verdict.recv_timeout(WAIT).ok().or_else(|| {
        if !parsed.lapses() {
            return None;
        }
        // What stands in the slot by now may be another's. What the controller has taken it answers within the step.
        let untaken = lock(&shared.command).take_if(|pending| pending.number == number).is_some();
        if untaken { None } else { verdict.recv_timeout(WAIT).ok() }
    });
    decided(parsed, told, shared)
}

/// What the controller's verdict means. It knows that a check fails, but not which one.
fn decided(parsed: &Parsed, told: Option<Verdict>, shared: &Shared) -> Decided {
    let mut decided = parsed.decided(told);
    if told == Some(Err(Refusal::ChecksFailed))
        && let Some(problem) = shared.ready.problem()
    {
        decided.reply.reason = format!("not ready: {problem}");
    }
    decided
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

    fn pending(shared: &Shared) -> Option<Command> {
        lock(&shared.command).as_ref().map(|pending| pending.command)
    }

    #[test]
    fn a_start_that_the_controller_does_not_take_in_time_is_refused_and_taken_back_and_a_stop_stands() {
        let shared = Shared::new(sync_channel(1).0);
        let refused = ask(&parsed(start()), &shared);
        assert!(!refused.reply.accepted && refused.settled);
        assert_eq!(pending(&shared), None);
        assert!(!ask(&parsed(Command::Stop), &shared).settled);
        assert_eq!(pending(&shared), Some(Command::Stop));
    }

    #[test]
    fn a_stop_that_finds_no_flight_says_that_nothing_is_sent() {
        let shared = Shared::new(sync_channel(1).0);
        let said = |mode: v1::Mode, command| {
            shared.mode.store(mode.into(), Ordering::Relaxed);
            let parsed = parsed(command);
            nothing_to_stop(&parsed, parsed.decided(Some(Ok(()))), &shared).reply
        };
        let ready = said(v1::Mode::Ready, Command::Stop);
        assert!(ready.accepted && ready.reason.contains("no flight of ours"), "{ready:?}");
        assert!(said(v1::Mode::Fault, Command::Stop).reason.contains("the pilot has the vehicle"));
        assert_eq!(said(v1::Mode::Ready, start()).reason, "yes");
        assert_eq!(said(v1::Mode::Takeoff, Command::Stop).reason, "yes", "one began meanwhile");
    }

    #[test]
    fn a_start_refused_for_a_check_says_which() {
        let shared = Shared::new(sync_channel(1).0);
        let said = |why| decided(&parsed(start()), Some(Err(why)), &shared).reply.reason;
        assert_eq!(said(Refusal::ChecksFailed), Refusal::ChecksFailed.to_string(), "nobody judges any more");
        shared.ready.judge(Some("camera: no image has come yet".to_owned()), clock::now());
        assert_eq!(said(Refusal::ChecksFailed), "not ready: camera: no image has come yet");
        assert_eq!(said(Refusal::BatteryLow), Refusal::BatteryLow.to_string());
    }

    #[test]
    fn a_start_is_not_put_behind_a_stop_of_the_pilots_switch() {
        let shared = Shared::new(sync_channel(1).0);
        shared.barred.store(true, Ordering::Relaxed);
        let decided = ask(&parsed(start()), &shared);
        assert!(decided.settled && decided.reply.reason == parsed(start()).barred().reason, "{:?}", decided.reply);
        assert_eq!(pending(&shared), None);
    }

    #[test]
    fn whoever_asked_for_what_a_stop_replaced_does_not_take_the_stop_back() {
        let shared = Shared::new(sync_channel(1).0);
        std::thread::scope(|scope| {
            let held = scope.spawn(|| ask(&parsed(Command::Hold), &shared));
            while pending(&shared).is_none() {
                std::thread::yield_now();
            }
            let (_, _verdict) = put(&parsed(Command::Stop), &shared).unwrap();
            assert!(!held.join().unwrap().reply.accepted);
            assert_eq!(pending(&shared), Some(Command::Stop));
        });
    }

    #[test]
    fn a_start_that_a_stop_has_overtaken_is_refused_and_one_that_knows_of_it_is_not() {
        let (shared, mut standing) = (Shared::new(sync_channel(1).0), None);
        let asked = |session, stops| v1::StartRequest { session, stops, ..Default::default() }.encode_to_vec();
        let why =
            |payload: &[u8], shared: &Shared| refused(&parsed(start()), payload, shared, 7).map(|reply| reply.reason);
        assert_eq!(why(&asked(7, 0), &shared), None);
        ask_or_go_on(&parsed(Command::Stop), &shared, &mut standing);
        ask_or_go_on(&parsed(Command::Stop), &shared, &mut standing);
        assert!(why(&asked(7, 0), &shared).unwrap().starts_with("a Stop came after"));
        assert_eq!(why(&asked(7, 1), &shared), None, "a repeated stop counts once");
        assert_eq!(why(&asked(0, 0), &shared), None, "not told");
        assert!(why(&asked(6, 9), &shared).unwrap().contains("started anew"));
    }

    #[test]
    fn a_stop_that_is_repeated_before_it_was_answered_acts_once() {
        let (shared, mut standing) = (Shared::new(sync_channel(1).0), None);
        let stop = parsed(Command::Stop);
        assert!(!ask_or_go_on(&stop, &shared, &mut standing).settled);
        let other = Parsed { id: "b".to_owned(), ..parsed(start()) };
        assert!(!ask_or_go_on(&other, &shared, &mut standing).reply.accepted, "a stop waits");
        let taken = lock(&shared.command).take().unwrap();
        taken.answer.send(Ok(())).unwrap();
        let again = ask_or_go_on(&stop, &shared, &mut standing);
        assert!(again.settled && again.reply.accepted);
        assert_eq!(pending(&shared), None, "the controller was not asked again");
    }
}
