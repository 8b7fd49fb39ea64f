//! The choice among candidates: objectness filter → consistency gate → lowest predicted cost (§III-C.2). While the
//! target is hidden, the one that leads best to where it should be (beyond the paper).

use crate::error::{ConfigError, check, not_negative};
use crate::target::{Detection, TargetFilter};
use crate::types::{ANCHORS, Candidate, Rejection, Task, Time, Vec3};

/// What makes a candidate eligible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SelectConfig {
    /// Least objectness of a candidate that holds the target, 0..1 (0.5).
    pub min_objectness: f64,
    /// Least objectness where a confirmed target is expected, 0..=min_objectness (0.2): there a weak detection that
    /// passes the gate is more likely the target than not. Far or half hidden targets are weak.
    pub keep_objectness: f64,
    /// A target unseen for longer than this is pursued with new plans, s (0.2); until then the last one is flown on.
    pub pursue_after: f64,
    /// A target unseen for longer than this is not pursued any more, s (2.5).
    pub pursue_until: f64,
    /// In pursuit, the cost of a squared metre between a trajectory's end and where the target should be (0.12).
    pub pursue_weight: f64,
}

impl SelectConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        check("select.min_objectness", self.min_objectness, "above 0 and below 1", |x| x > 0.0 && x < 1.0)?;
        check("select.keep_objectness", self.keep_objectness, "above 0 and at most min_objectness", |x| {
            x > 0.0 && x <= self.min_objectness
        })?;
        not_negative("select.pursue_after", self.pursue_after)?;
        not_negative("select.pursue_until", self.pursue_until)?;
        not_negative("select.pursue_weight", self.pursue_weight)
    }
}

/// Updates the target filter with the candidates' detections at `stamp`, marks why each candidate is rejected, and
/// returns the index of the one to fly; none: none was eligible. In navigation every valid candidate is eligible.
pub fn select(
    config: &SelectConfig,
    task: Task,
    stamp: Time,
    cam_world: Vec3,
    filter: &mut TargetFilter,
    candidates: &mut [Candidate; ANCHORS],
) -> Option<usize> {
    if task == Task::Track {
        let strong = |candidate: &Candidate| candidate.objectness >= config.min_objectness;
        // Beside a strong one elsewhere a weak one is worth nothing: it would keep a track alive that has gone astray.
        let weak_counts = filter.is_confirmed() && !candidates.iter().any(strong);
        let least = if weak_counts { config.keep_objectness } else { config.min_objectness };
        let detections = std::array::from_fn(|index| detection(least, cam_world, &candidates[index]));
        let mut consistent = [false; ANCHORS];
        filter.step(stamp, &detections, &mut consistent);
        // A weak one was not trained as one that holds the target: only the likeliest.
        let weak = (0..ANCHORS)
            .filter(|&index| consistent[index])
            .filter(|_| weak_counts)
            .max_by(|&a, &b| candidates[a].objectness.total_cmp(&candidates[b].objectness));
        for (index, candidate) in candidates.iter_mut().enumerate() {
            if candidate.rejection.is_none() && weak != Some(index) {
                candidate.rejection = match (strong(candidate), consistent[index]) {
                    (false, _) => Some(Rejection::Objectness),
                    (true, false) => Some(Rejection::Gate),
                    (true, true) => None,
                };
            }
        }
    }
    let chosen = candidates
        .iter()
        .enumerate()
        .filter(|(_, candidate)| candidate.rejection.is_none())
        .min_by(|(_, a), (_, b)| a.cost.total_cmp(&b.cost))
        .map(|(index, _)| index);
    for (index, candidate) in candidates.iter_mut().enumerate() {
        if candidate.rejection.is_none() && Some(index) != chosen {
            candidate.rejection = Some(Rejection::Cost);
        }
    }
    if chosen.is_some() || task != Task::Track {
        return chosen;
    }
    let pursued = pursue(config, stamp, filter, candidates);
    if let Some(candidate) = pursued.and_then(|index| candidates.get_mut(index)) {
        candidate.rejection = None;
    }
    pursued
}

/// The candidate to fly after a believed target that is out of sight. Trajectories that hold no target keep the speed
/// and avoid obstacles, so the chase goes on around what hides it.
fn pursue(
    config: &SelectConfig,
    stamp: Time,
    filter: &TargetFilter,
    candidates: &[Candidate; ANCHORS],
) -> Option<usize> {
    let (aim, unseen) = filter.expected(stamp)?;
    if unseen <= config.pursue_after || unseen > config.pursue_until {
        return None;
    }
    let cost = |c: &Candidate| c.cost + config.pursue_weight * (c.end.pos - aim).norm_squared();
    (0..ANCHORS)
        .filter(|&index| candidates[index].rejection != Some(Rejection::Invalid))
        .min_by(|&a, &b| cost(&candidates[a]).total_cmp(&cost(&candidates[b])))
}

fn detection(least: f64, cam_world: Vec3, candidate: &Candidate) -> Option<Detection> {
    let pos_world = candidate.target_world.filter(|_| candidate.objectness >= least)?;
    Some(Detection { pos_world, distance: (pos_world - cam_world).norm(), objectness: candidate.objectness })
}
