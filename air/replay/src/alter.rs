//! The planner altered from an instant on: with another policy, with other parameters, or both.
//!
//! Up to the instant the flight is replayed as it was flown. From there on the altered planner goes on with all that was
//! seen by then, on what the flight saw next; the vehicle's own way stays the recorded one.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use color_eyre::eyre::{Result, WrapErr, bail, eyre};
use goshawk_core::{NetworkOutput, Plan, Planner, Time};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_recorder::Channel;
use goshawk_vehicle::config::{Vehicle, VehicleError};
use goshawk_vehicle::convert;
use serde::Serialize;

use super::Recording;
use super::choices::{Agreement, Choices};
use super::compare::{Count, Difference, keep_first};
use super::controls::Again;
use super::out::PlansLog;
use super::plans::{Logged, key_channel};
use super::policy::Seeing;

/// What is altered, and when.
#[derive(Clone, Debug, Default)]
pub struct Alteration {
    /// The instant, as the review counts it, s.
    pub from_s: f64,
    /// For how long, s.
    pub for_s: f64,
    /// Parameters of the planner: `planner.costs.obstacle=2`.
    pub set: Vec<String>,
    /// The policy that plans; none: the network's logged answers are taken.
    pub policy: Option<PathBuf>,
    /// Where the altered plans and controller steps go: a log of their own.
    pub out: Option<PathBuf>,
}

/// What the altered planner would have flown.
#[derive(Clone, Debug, Serialize)]
pub struct Altered {
    /// The log.
    pub log: PathBuf,
    /// Of the first plan that was made again, s.
    pub from_s: f64,
    /// Of the last one, s.
    pub to_s: f64,
    /// The difference in a line.
    pub words: String,
    /// At the instant.
    pub here: Choice,
    /// Where something else is chosen first; none: nowhere.
    pub first_other: Option<Choice>,
    /// With what was flown.
    #[serde(flatten)]
    pub agreement: Agreement,
    /// Plans of the flight made again as they were flown, up to the last one.
    pub replayed: Count,
    /// The first of them that differs from the log, so that the altered ones differ for that, too.
    pub first_difference: Option<Difference>,
}

/// A plan of the flight, and the one instead.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Choice {
    /// When it was ready, s.
    pub at_s: f64,
    /// Its number.
    pub seq: u64,
    /// The candidate that was flown, from 0; none: nothing was eligible.
    pub flown: Option<usize>,
    /// The one instead.
    pub altered: Option<usize>,
    /// Distance between their ends, m.
    pub apart_m: Option<f64>,
}

impl Choice {
    fn of(at_s: f64, flown: &Plan, altered: &Plan) -> Self {
        let end = |plan: &Plan| plan.chosen.map(|k| plan.candidates[k].end.pos);
        let apart_m = end(flown).zip(end(altered)).map(|(a, b)| (a - b).norm());
        Choice { at_s, seq: flown.seq, flown: flown.chosen, altered: altered.chosen, apart_m }
    }

    fn differs(&self) -> bool {
        self.flown != self.altered
    }

    /// "candidate 4 instead of 7", counted from 1 as people see them.
    fn words(&self) -> String {
        let number = |k: Option<usize>| k.map_or_else(|| "none".to_owned(), |k| (k + 1).to_string());
        let candidate =
            |k: Option<usize>| k.map_or_else(|| "no candidate".to_owned(), |k| format!("candidate {}", k + 1));
        if self.differs() {
            format!("{} instead of {}", candidate(self.altered), number(self.flown))
        } else {
            format!("{} as well", candidate(self.altered))
        }
    }
}

/// Replays the log up to an instant, alters the planner, and goes on for a while.
///
/// # Errors
/// The log cannot be read, a parameter cannot be set, the policy cannot be run, or there is no plan then.
pub fn alter(log: &Path, alteration: &Alteration) -> Result<Altered> {
    if alteration.set.is_empty() && alteration.policy.is_none() {
        bail!("nothing is altered: name --set planner.KEY=VALUE, --policy FILE, or both");
    }
    let recording = Recording::open(log)?;
    let altered = set(&recording, &alteration.set)?;
    let named = alteration.policy.as_deref();
    let on = || format!("cannot run {} on {}", named.unwrap_or(Path::new("")).display(), log.display());
    let seeing = named.map(|path| Seeing::load(path, &recording)).transpose().wrap_err_with(on)?;
    let mut again = Replanning::new(&recording, &altered, seeing, alteration)?;
    again.run()?;
    let Replanning { plans, times, choices, first, first_other, replayed, first_difference, seeing, .. } = again;
    let agreement = choices.agreement();
    let (Some(here), Some(last)) = (first, times.last().copied()) else {
        let (from, to) = (alteration.from_s, alteration.from_s + alteration.for_s);
        bail!("{} holds no plan between {from:.2} s and {to:.2} s that can be made again", log.display());
    };
    if let Some(out) = &alteration.out {
        let policy = seeing.as_ref().map(|seeing| &seeing.policy);
        let mut writer = PlansLog::create(out, &recording, policy, Some(&altered.tuning_text))?;
        for ready in &times {
            writer.plan(ready.0, &plans[&ready.1])?;
        }
        write_controls(&recording, &plans, (times[0].0, last.0), &mut writer)?;
        writer.finish()?;
    }
    let to_s = recording.since_begin(last.0.0);
    let words = words(&here, first_other.as_ref(), &agreement, to_s);
    let (log, from_s) = (log.to_owned(), here.at_s);
    Ok(Altered { log, from_s, to_s, words, here, first_other, agreement, replayed, first_difference })
}

/// Controller steps on the altered plans, each on the odometry that was recorded.
fn write_controls(
    recording: &Recording,
    plans: &BTreeMap<u64, Plan>,
    (from, to): (Time, Time),
    writer: &mut PlansLog,
) -> Result<()> {
    let mut controller = Again::new(recording, plans)?;
    for entry in recording.log.entries().take_while(|entry| entry.time_ns <= to.0) {
        let made = controller.take(&entry, &mut Vec::new());
        if let Some(control) = made.filter(|control| control.stamp_ns >= from.0) {
            writer.control(control)?;
        }
    }
    Ok(())
}

fn words(here: &Choice, first_other: Option<&Choice>, found: &Agreement, to_s: f64) -> String {
    let apart = here.apart_m.filter(|_| here.differs()).map(|m| format!(", ending {m:.2} m apart")).unwrap_or_default();
    let at = format!("at {:.2} s it would have flown {}{apart}", here.at_s, here.words());
    let (others, of) = (found.frames - found.same, found.frames);
    match first_other {
        None => format!("{at}, and so in all {of} plans until {to_s:.2} s"),
        Some(_) if here.differs() => format!("{at}; otherwise in {others} of {of} plans until {to_s:.2} s"),
        Some(first) => {
            let first = format!("at {:.2} s {}", first.at_s, first.words());
            format!("{at}; {first}; otherwise in {others} of {of} plans until {to_s:.2} s")
        }
    }
}

/// The vehicle with other parameters of its planner.
fn set(recording: &Recording, changes: &[String]) -> Result<Vehicle> {
    let mut tuning: toml::Table = recording.header.tuning_toml.parse()?;
    for change in changes {
        set_one(&mut tuning, change).wrap_err_with(|| format!("cannot set {change}"))?;
    }
    let text = toml::to_string(&tuning)?;
    let vehicle = Vehicle::parse(recording.header.vehicle_toml.clone(), text, Path::new("the vehicle file in the log"));
    vehicle.map_err(|error| {
        let cause = match error {
            VehicleError::Parse { cause, .. } | VehicleError::Value { cause, .. } => cause,
            VehicleError::Read { .. } => error.to_string(),
        };
        // The numbers of lines are of a text that nobody sees.
        let cause =
            cause.split_once(": ").filter(|(line, _)| line.starts_with("line ")).map_or(&*cause, |(_, why)| why);
        eyre!("cannot set {}: {cause}", changes.join(", "))
    })
}

fn set_one(tuning: &mut toml::Table, change: &str) -> Result<()> {
    let (key, text) = change.split_once('=').ok_or_else(|| eyre!("write it as planner.KEY=VALUE"))?;
    let sections: Vec<&str> = key.trim().split('.').collect();
    let [first, sections @ .., last] = sections.as_slice() else { bail!("write it as planner.KEY=VALUE") };
    if *first != "planner" {
        bail!("only the planner is altered, whose parameters begin with planner.");
    }
    let said: toml::Table = format!("value = {text}").parse().map_err(|_| eyre!("{} is no value", text.trim()))?;
    let value = said.get("value").filter(|_| said.len() == 1).ok_or_else(|| eyre!("{} is no value", text.trim()))?;
    let mut table = tuning;
    for section in std::iter::once(first).chain(sections) {
        let found = table.get_mut(*section).and_then(toml::Value::as_table_mut);
        table = found.ok_or_else(|| eyre!("the log's tuning has no section {section}"))?;
    }
    // 2 is meant as 2.0 where the parameter is a real number.
    let value = match (table.get(*last), value) {
        (Some(toml::Value::Float(_)), toml::Value::Integer(whole)) => toml::Value::Float(*whole as f64),
        _ => value.clone(),
    };
    table.insert((*last).to_owned(), value);
    Ok(())
}

/// Both planners on the log's records.
struct Replanning<'a> {
    recording: &'a Recording,
    altered: &'a Vehicle,
    seeing: Option<Seeing>,
    span: (u64, u64),
    flown: Planner,
    other: Option<Planner>,
    /// By number: as flown before the instant, altered from there on.
    plans: BTreeMap<u64, Plan>,
    /// When the altered ones were ready, and their numbers.
    times: Vec<(Time, u64)>,
    choices: Choices,
    first: Option<Choice>,
    first_other: Option<Choice>,
    replayed: Count,
    first_difference: Option<Difference>,
}

impl<'a> Replanning<'a> {
    fn new(
        recording: &'a Recording,
        altered: &'a Vehicle,
        seeing: Option<Seeing>,
        alteration: &Alteration,
    ) -> Result<Self> {
        let span = (recording.at(alteration.from_s), recording.at(alteration.from_s + alteration.for_s));
        let flown = Planner::new(recording.vehicle.planner_config(recording.contract.model()))?;
        Ok(Replanning {
            recording,
            altered,
            seeing,
            span,
            flown,
            other: None,
            plans: BTreeMap::new(),
            times: Vec::new(),
            choices: Choices::default(),
            first: None,
            first_other: None,
            replayed: Count::default(),
            first_difference: None,
        })
    }

    fn run(&mut self) -> Result<()> {
        let plan_channel = key_channel(Key::Plan)?;
        let mut last: Option<Plan> = None;
        let (recording, end_ns) = (self.recording, self.span.1);
        for entry in recording.log.entries().take_while(|entry| entry.time_ns <= end_ns) {
            if let Some(seeing) = &mut self.seeing {
                seeing.keep(&entry);
            }
            if let Some(message) = entry.decode::<v1::PlannerInput>(Channel::PLANNER_INPUT) {
                let Some(logged) = Logged::of(&message) else { continue };
                last = self.plan(Time(entry.time_ns), &logged)?;
            } else if let Some(logged) = entry.decode::<v1::Plan>(plan_channel)
                && let Some(plan) = last.as_ref().filter(|plan| plan.seq == logged.seq)
            {
                self.check(&logged, plan);
            }
        }
        Ok(())
    }

    /// Both planners' answers to a frame; gives the flight's own. None: the network had failed.
    fn plan(&mut self, ready: Time, logged: &Logged) -> Result<Option<Plan>> {
        if ready.0 >= self.span.0 && self.other.is_none() {
            let policy =
                self.seeing.as_ref().map_or_else(|| self.recording.contract.model(), |s| s.policy.contract().model());
            self.other = Some(self.flown.clone().with_config(self.altered.planner_config(policy))?);
        }
        let asked = self.flown.see(&logged.frame);
        let Some(network) = &logged.network else {
            if let Some(other) = &mut self.other {
                let _ = other.see(&logged.frame);
            }
            return Ok(None);
        };
        let flown = asked.answer(network);
        if self.other.is_none() {
            self.plans.insert(flown.seq, flown.clone());
        } else if let Some(plan) = self.replan(logged, network)? {
            let choice = Choice::of(self.recording.since_begin(ready.0), &flown, &plan);
            self.choices.count(&flown, &plan);
            self.first.get_or_insert(choice);
            if choice.differs() {
                self.first_other.get_or_insert(choice);
            }
            self.times.push((ready, plan.seq));
            self.plans.insert(plan.seq, plan);
        }
        Ok(Some(flown))
    }

    /// The altered planner's answer; none: the log has no image for it.
    fn replan(&mut self, logged: &Logged, logged_network: &NetworkOutput) -> Result<Option<Plan>> {
        let Some(planner) = &mut self.other else { return Ok(None) };
        let stamp = logged.frame.odometry.stamp;
        // The logged answer counts wherever the network that flew is asked the same.
        let same_network = self.seeing.as_ref().is_none_or(|seeing| seeing.flew(self.recording));
        let asked = planner.see(&logged.frame);
        if !same_network && !self.seeing.as_ref().is_some_and(|seeing| seeing.has(stamp)) {
            return Ok(None);
        }
        let same = same_network
            && asked.state().len() == logged.state.len()
            && asked.state().iter().zip(logged.state.iter()).all(|(a, b)| a.to_bits() == b.to_bits());
        if same {
            return Ok(Some(asked.answer(logged_network)));
        }
        let Some(seeing) = &mut self.seeing else {
            let sha256 = self.recording.header.policy_sha256.get(..12).unwrap_or_default();
            bail!(
                "with these parameters the network is asked something else: name the policy that flew, too, \
                 --policy FILE (its SHA-256 begins with {sha256})"
            );
        };
        let network = seeing.answer(stamp, asked.state())?;
        Ok(Some(asked.answer(&network)))
    }

    /// Whether the flight's own plan is made again as it was.
    fn check(&mut self, logged: &v1::Plan, plan: &Plan) {
        if let Some([field, said, replayed]) =
            self.replayed.compare(logged, &convert::plan(plan, Time(logged.ready_ns)))
        {
            let (stamp_ns, at_s) = (logged.ready_ns, self.recording.since_begin(logged.ready_ns));
            let what = format!("plan {}", logged.seq);
            let found = Difference { stamp_ns, at_s, what, field, logged: said, replayed };
            keep_first(&mut self.first_difference, found);
        }
    }
}
