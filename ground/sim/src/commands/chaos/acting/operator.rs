//! The operator, the link to the vehicle, and the vehicle's desk for commands. Whoever gets no answer asks again, under
//! the same id.

use std::collections::VecDeque;

use goshawk_core::{Command, Refusal, Time};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_vehicle::config::Vehicle;
use goshawk_vehicle::desk::{Decided, Desk, Parsed, Taken, WAIT};
use prost::Message;

use super::Acting;
use crate::commands::chaos::draw::START_S;
use crate::commands::chaos::schedule::Kind;

const ASKS_AGAIN_S: f64 = 1.0;
const ASKS: u32 = 6;
/// The vehicle's queue of questions.
const QUEUE: usize = 16;
/// The first start's id, and those of its repetitions after a refusal.
const FIRST_START: u32 = 1;
const LATER_STARTS: u32 = 100;

struct Ask {
    key: Key,
    id: u32,
    at: Time,
    left: u32,
}

/// A question at the vehicle.
#[derive(Clone, Debug)]
struct Asked {
    key: Key,
    payload: Vec<u8>,
    at: Time,
}

/// A command that the controller has taken.
#[derive(Clone, Debug)]
pub(crate) struct Delivered {
    pub(crate) command: Command,
    pub(crate) id: String,
    /// When it arrived at the vehicle.
    pub(crate) at: Time,
    /// It was refused meanwhile, for want of an answer.
    pub(crate) given_up: bool,
}

/// Operator, link, desk.
pub(crate) struct Operator {
    asks: Vec<Ask>,
    link: Vec<(Time, Key, u32)>,
    waiting: VecDeque<Asked>,
    desk: Desk,
    /// The one that the desk waits for: since when, and when it arrived.
    asked: Option<(Parsed, Time)>,
    slot: Option<Delivered>,
    starts: u32,
    /// Stops that were answered before: repeated, they do nothing.
    answered: Vec<Vec<u8>>,
    /// Commands with their answers, for the log.
    pub(crate) records: Vec<v1::CommandRecord>,
}

impl Operator {
    pub(crate) fn new(begin: Time) -> Self {
        let start = Ask { key: Key::CmdStart, id: FIRST_START, at: begin.plus(START_S), left: ASKS };
        Self {
            asks: vec![start],
            link: Vec::new(),
            waiting: VecDeque::new(),
            desk: Desk::default(),
            asked: None,
            slot: None,
            starts: 0,
            answered: Vec::new(),
            records: Vec::new(),
        }
    }

    /// A millisecond.
    pub(crate) fn step(&mut self, now: Time, acting: &Acting, vehicle: &Vehicle) {
        for kind in acting.begun() {
            match kind {
                Kind::Stop(id) => self.asks.push(Ask { key: Key::CmdStop, id: *id, at: now, left: ASKS }),
                Kind::Start(id) => self.asks.push(Ask { key: Key::CmdStart, id: *id, at: now, left: ASKS }),
                _ => {}
            }
        }
        self.ask(now, acting);
        let arrived = self.link.iter().filter(|(at, ..)| now >= *at).copied().collect::<Vec<_>>();
        self.link.retain(|(at, ..)| now < *at);
        for (_, key, id) in arrived {
            if self.waiting.len() < QUEUE {
                self.waiting.push_back(Asked { key, payload: payload(key, id), at: now });
            }
        }
        if self.asked.as_ref().is_some_and(|(_, since)| now.since(*since) > WAIT.as_secs_f64()) {
            self.settle(now, None, acting);
        }
        while self.asked.is_none() {
            let Some(asked) = self.waiting.pop_front() else { break };
            self.serve(now, asked, vehicle, acting);
        }
    }

    fn ask(&mut self, now: Time, acting: &Acting) {
        let lost = acting.any(&Kind::CommandsLost);
        let late = acting.number(|kind| if let Kind::CommandsLate(x) = kind { Some(*x) } else { None });
        let times = acting.number(|kind| if let Kind::CommandsRepeated(n) = kind { Some(f64::from(*n)) } else { None });
        for ask in self.asks.iter_mut().filter(|ask| ask.left > 0 && now >= ask.at) {
            ask.left -= 1;
            ask.at = now.plus(ASKS_AGAIN_S);
            if !lost {
                for copy in 0..times.unwrap_or(1.0) as u32 {
                    self.link.push((now.plus(late.unwrap_or(0.0) + 0.004 * f64::from(copy)), ask.key, ask.id));
                }
            }
        }
        self.asks.retain(|ask| ask.left > 0);
    }

    fn serve(&mut self, now: Time, asked: Asked, vehicle: &Vehicle, acting: &Acting) {
        self.answered.push(asked.payload.clone());
        match self.desk.take(asked.key, &asked.payload, vehicle) {
            Taken::Answered(reply) => self.answer(now, &reply, acting),
            Taken::New(parsed) => {
                // As on board: a stop replaces a start that the controller has not taken yet.
                if self.slot.is_some() && parsed.lapses() {
                    let reply = parsed.busy();
                    self.desk.remember(&reply);
                    self.record(now, &parsed, &reply);
                    self.answer(now, &reply, acting);
                    return;
                }
                self.slot =
                    Some(Delivered { command: parsed.command, id: parsed.id.clone(), at: asked.at, given_up: false });
                self.asked = Some((parsed, now));
            }
        }
    }

    /// When the oldest Stop arrived that the controller has not taken yet.
    pub(crate) fn waiting_stop(&self) -> Option<Time> {
        let known = |asked: &&Asked| asked.key == Key::CmdStop && !self.answered.contains(&asked.payload);
        let queued = self.waiting.iter().filter(known).map(|asked| asked.at);
        let in_slot = self.slot.iter().filter(|slot| slot.command == Command::Stop).map(|slot| slot.at);
        queued.chain(in_slot).min()
    }

    /// What the controller takes with this step.
    pub(crate) fn take(&mut self) -> Option<Delivered> {
        self.slot.take()
    }

    /// The controller's answer to what it took; none: it did not answer in time.
    pub(crate) fn settle(&mut self, now: Time, verdict: Option<Result<(), Refusal>>, acting: &Acting) {
        let Some((parsed, _)) = self.asked.take() else { return };
        if verdict.is_none() {
            self.slot = self.slot.take().filter(|_| !parsed.lapses()).map(|slot| Delivered { given_up: true, ..slot });
        }
        let Decided { reply, settled } = parsed.decided(verdict);
        self.record(now, &parsed, &reply);
        if settled {
            self.desk.remember(&reply);
            self.answer(now, &reply, acting);
        }
    }

    fn record(&mut self, now: Time, parsed: &Parsed, reply: &v1::CommandReply) {
        self.records.push(v1::CommandRecord {
            stamp_ns: now.0,
            verb: if parsed.command == Command::Stop { "stop" } else { "start" }.to_owned(),
            profile: parsed.profile.clone(),
            reply: Some(reply.clone()),
        });
    }

    /// The answer goes back over the same link. A start that was refused is asked anew, under another id.
    fn answer(&mut self, now: Time, reply: &v1::CommandReply, acting: &Acting) {
        if acting.any(&Kind::CommandsLost) {
            return;
        }
        let key = self.asks.iter().find(|ask| name(ask.id) == reply.command_id).map(|ask| (ask.key, ask.id));
        self.asks.retain(|ask| name(ask.id) != reply.command_id);
        let begins = key.is_some_and(|(key, id)| key == Key::CmdStart && (id == FIRST_START || id >= LATER_STARTS));
        if begins && !reply.accepted && self.starts < ASKS {
            self.starts += 1;
            let id = LATER_STARTS + self.starts;
            self.asks.push(Ask { key: Key::CmdStart, id, at: now.plus(ASKS_AGAIN_S), left: ASKS });
        }
    }
}

fn name(id: u32) -> String {
    format!("operator-{id}")
}

fn payload(key: Key, id: u32) -> Vec<u8> {
    if key == Key::CmdStart {
        v1::StartRequest { command_id: name(id), ..Default::default() }.encode_to_vec()
    } else {
        v1::StopRequest { command_id: name(id) }.encode_to_vec()
    }
}
