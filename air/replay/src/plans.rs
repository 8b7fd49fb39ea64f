//! The planner again, from the network's logged answers.

use std::collections::BTreeMap;

use color_eyre::eyre::{Result, eyre};
use goshawk_core::{ANCHORS, FrameInput, FrameRecord, MAX_CHANNELS, NetworkOutput, NetworkState, Plan, Planner, Time};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_recorder::Channel;
use goshawk_vehicle::convert;
use goshawk_vehicle::inputs::frame_record;

use super::compare::{Difference, first_field, keep_first};
use super::{Outcome, Recording};

pub(super) fn key_channel(key: Key) -> Result<Channel> {
    Channel::of(key).ok_or_else(|| eyre!("the key table has no message for {key:?}"))
}

/// Makes each plan again from what the planner was given, and compares. Returns them by their sequence numbers.
pub(super) fn again(recording: &Recording, outcome: &mut Outcome) -> Result<BTreeMap<u64, Plan>> {
    let mut planner = Planner::new(recording.vehicle.planner_config(recording.contract.model()))?;
    let (plan_channel, target_channel) = (key_channel(Key::Plan)?, key_channel(Key::Target)?);
    let mut plans = BTreeMap::new();
    let mut last: Option<u64> = None;
    let mut unanswered: Option<u64> = None;
    let mut owes_target: Option<u64> = None;
    let lacks = |seq: u64| format!("the plan of input {seq}");
    let lacks_target = |seq: u64| format!("the target after plan {seq}");
    let first = &mut outcome.first_difference;
    for entry in recording.log.entries() {
        let mut differs = |what: String, [field, logged, replayed]: [String; 3]| {
            let (stamp_ns, at_s) = (entry.time_ns, recording.since_begin(entry.time_ns));
            keep_first(first, Difference { stamp_ns, at_s, what, field, logged, replayed });
        };
        if let Some(message) = entry.decode::<v1::PlannerInput>(Channel::PLANNER_INPUT) {
            let Some(logged) = Logged::of(&message) else {
                outcome.missing.push(format!("a part of the input of plan {}", message.seq));
                continue;
            };
            let asked = planner.see(&logged.frame);
            let same = asked.state().len() == logged.state.len()
                && asked.state().iter().zip(logged.state.iter()).all(|(a, b)| a.to_bits() == b.to_bits());
            if !same {
                differs(format!("network state of plan {}", message.seq), first_field(&logged.state, asked.state()));
            }
            let Some(network) = &logged.network else { continue };
            plans.insert(message.seq, asked.answer(network));
            last = Some(message.seq);
            // The last one of a log that was cut off may be without.
            outcome.missing.extend(unanswered.replace(message.seq).map(lacks));
        } else if let Some(logged) = entry.decode::<v1::Plan>(plan_channel) {
            let Some(plan) = plans.get(&logged.seq) else {
                outcome.missing.push(format!("the input of plan {}", logged.seq));
                continue;
            };
            unanswered = unanswered.filter(|seq| *seq != logged.seq);
            let owes = plan.target.is_some().then_some(logged.seq);
            outcome.missing.extend(std::mem::replace(&mut owes_target, owes).map(lacks_target));
            if let Some(field) = outcome.plans.compare(&logged, &convert::plan(plan, Time(logged.ready_ns))) {
                differs(format!("plan {}", logged.seq), field);
            }
        } else if let Some(logged) = entry.decode::<v1::Target>(target_channel) {
            owes_target = None;
            let Some(plan) = last.and_then(|seq| plans.get(&seq)) else {
                outcome.missing.push(format!("the plan of target {}", logged.seq));
                continue;
            };
            let mut replayed = convert::target(logged.seq, plan).unwrap_or_default();
            if logged.look.is_none() {
                replayed.look = None; // a log from before the look was told
            }
            if let Some(field) = outcome.targets.compare(&logged, &replayed) {
                differs(format!("target after plan {}", plan.seq), field);
            }
        }
    }
    let whole = recording.log.is_closed();
    outcome.missing.extend(unanswered.filter(|_| whole).map(lacks));
    outcome.missing.extend(owes_target.filter(|_| whole).map(lacks_target));
    Ok(plans)
}

/// A frame that the planner saw.
pub(super) struct Logged {
    pub(super) frame: FrameInput,
    /// What it told the network.
    pub(super) state: NetworkState,
    /// What the network answered; none: it failed.
    pub(super) network: Option<NetworkOutput>,
}

impl Logged {
    /// None: a part is missing.
    pub(super) fn of(message: &v1::PlannerInput) -> Option<Self> {
        let failed = message.prediction.is_empty();
        let zeros = || v1::PlannerInput { prediction: vec![0.0; MAX_CHANNELS * ANCHORS], ..message.clone() };
        let FrameRecord { frame, state, network } =
            if failed { frame_record(&zeros())? } else { frame_record(message)? };
        Some(Logged { frame, state, network: (!failed).then_some(network) })
    }
}
