//! Which detections are the target's: objectness filter → consistency gate (§III-C.2). Which candidate is flown: the one
//! of lowest predicted cost, in whatever cell, since every trajectory is trained to lead to the aim (beyond the paper).

use crate::planning::target::{Detection, TargetFilter};
use crate::values::types::{ANCHORS, Added, Candidate, Rejection, Time, Vec3};
use schemars::JsonSchema;
use serde::Deserialize;

/// Which detections are worth a look.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SelectConfig {
    /// Least objectness of a cell that holds the target, 0..1.
    #[schemars(range(min = 0.01, max = 0.99), extend("x-why" = "at 0 all is a target, at 1 nothing", "x-source" = "chosen by eye"))]
    pub min_objectness: f64,
}

/// Updates the target filter with the candidates' detections at `stamp` and gives, for each candidate, why its detection
/// is not the target's; none: it is.
pub fn detect(
    config: &SelectConfig,
    stamp: Time,
    cam_world: Vec3,
    filter: &mut TargetFilter,
    candidates: &[Candidate; ANCHORS],
) -> [Option<Rejection>; ANCHORS] {
    let detections = std::array::from_fn(|index| detection(config.min_objectness, cam_world, &candidates[index]));
    let mut consistent = [false; ANCHORS];
    filter.step(stamp, &detections, &mut consistent);
    std::array::from_fn(|index| match (detections[index].is_some(), consistent[index]) {
        (false, _) => Some(Rejection::Objectness),
        (true, false) => Some(Rejection::Gate),
        (true, true) => None,
    })
}

/// Marks why each candidate is not flown and returns the index of the one that is: with an aim the valid one of least
/// cost, together with what `added` says, of which the total is never negative; without an aim (none added) none, for `unseen`'s
/// reasons.
pub fn select(
    added: Option<impl Fn(&Candidate) -> Added>,
    unseen: &[Option<Rejection>; ANCHORS],
    candidates: &mut [Candidate; ANCHORS],
) -> Option<usize> {
    let best = added.as_ref().and_then(|added| {
        let mut best: Option<(usize, f64)> = None;
        for (index, candidate) in candidates.iter_mut().enumerate().filter(|(_, c)| c.rejection.is_none()) {
            let cheaper = |cost: f64| best.is_none_or(|(_, least)| cost < least);
            // Most are too dear already.
            if cheaper(candidate.cost) {
                candidate.added = added(candidate);
                let cost = candidate.cost + candidate.added.total;
                best = if cheaper(cost) { Some((index, cost)) } else { best };
            }
        }
        best
    });
    let chosen = best.map(|(index, _)| index);
    for (index, candidate) in candidates.iter_mut().enumerate() {
        if candidate.rejection.is_none() && Some(index) != chosen {
            candidate.rejection = match best {
                // Cheaper by itself than the one that is flown: what was added decided.
                Some((_, least)) if candidate.cost < least => Some(Rejection::Blocked),
                Some(_) => Some(Rejection::Cost),
                None => unseen[index].or(Some(Rejection::Gate)),
            };
        }
    }
    chosen
}

fn detection(least: f64, cam_world: Vec3, candidate: &Candidate) -> Option<Detection> {
    let pos_world = candidate.target_world.filter(|_| candidate.objectness >= least)?;
    Some(Detection { pos_world, sight_world: pos_world - cam_world, objectness: candidate.objectness })
}
