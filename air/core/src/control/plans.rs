//! Which plan is flown: the newest that chose a trajectory, for as long as it may be flown.

use crate::planning::evade::Evasion;
use crate::planning::plan::Plan;
use crate::planning::room::Room;
use crate::values::quintic::Quintic;
use crate::values::types::{Task, Time, Vec3};
use schemars::JsonSchema;
use serde::Deserialize;

/// When each rung of the fallback ladder takes over.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LadderConfig {
    /// Track: how old the last chosen trajectory may get while frames without a choice arrive, s.
    #[schemars(range(min = 0.05, max = 2.0), extend("x-why" = "an older trajectory leads through what was not seen", "x-source" = "chosen by eye"))]
    pub missed_detection_s: f64,
    /// How old the last chosen trajectory may get while no frame arrives, s.
    #[schemars(range(min = 0.05, max = 1.0), extend("x-why" = "without a frame for longer it flies blind", "x-source" = "chosen by eye"))]
    pub plan_stale_s: f64,
    /// How long to hold without any plan before landing, s.
    #[schemars(range(min = 1.0, max = 120.0), extend("x-why" = "the battery is for more than waiting", "x-source" = "chosen by eye"))]
    pub no_plan_land_s: f64,
    /// Odometry that is older than this is not flown on, s.
    #[schemars(range(min = 0.02, max = 0.5), extend("x-why" = "less than a few periods is none, and half a second of dead reckoning is metres", "x-source" = "chosen by eye"))]
    pub odometry_stale_s: f64,
    /// Net downward acceleration while descending without odometry, m/s².
    #[schemars(range(min = 0.05, max = 2.0), extend("x-why" = "it is to be a gentle descent", "x-source" = "chosen by eye"))]
    pub descend_acc_mps2: f64,
    /// How long to descend without odometry before handing back to the autopilot, s.
    #[schemars(range(min = 0.1, max = 10.0), extend("x-why" = "without odometry nothing bounds the speed: the autopilot must have it soon", "x-source" = "chosen by eye"))]
    pub hand_back_s: f64,
}

/// The trajectory that is flown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flown {
    /// Its plan.
    pub seq: u64,
    /// Its frame's capture: t = 0.
    pub stamp: Time,
    /// Itself, world frame.
    pub quintic: Quintic,
}

/// What has come from the planner in this flight.
#[derive(Clone, Copy, Debug)]
pub struct Plans {
    /// Plans of earlier frames are of another flight.
    since: Time,
    newest: Option<(u64, Time)>,
    flown: Option<Flown>,
    /// Out of the way of what moves, of the newest plan.
    evaded: Option<Evasion>,
    /// About the vehicle, when the last plan was made.
    room: Option<Room>,
}

impl Plans {
    /// Nothing yet; frames before `since` do not count.
    #[must_use]
    pub fn new(since: Time) -> Self {
        Self { since, newest: None, flown: None, evaded: None, room: None }
    }

    /// Takes the newest plan; false: it is known, or of another flight. One that is not finite counts as a frame without
    /// a choice.
    pub fn take(&mut self, plan: &Plan) -> bool {
        if self.newest.is_some_and(|(seq, _)| seq == plan.seq) || plan.stamp < self.since {
            return false;
        }
        self.newest = Some((plan.seq, plan.stamp));
        self.room = plan.room;
        let whole = |way: &Evasion| finite(&way.vel_world) && way.height.is_none_or(f64::is_finite);
        self.evaded = plan.evasion.filter(whole);
        let Some(end) = plan.chosen.and_then(|index| plan.candidates.get(index)).map(|chosen| &chosen.end) else {
            return true;
        };
        let whole = [&plan.start, end].iter().all(|s| finite(&s.pos) && finite(&s.vel) && finite(&s.acc));
        if whole && plan.duration.is_finite() && plan.duration > 1e-3 {
            let quintic = Quintic::new(&plan.start, end, plan.duration);
            self.flown = Some(Flown { seq: plan.seq, stamp: plan.stamp, quintic });
        }
        true
    }

    /// The trajectory, unless it has expired: it is over, or it is older than the ladder allows, or frames have stopped.
    #[must_use]
    pub fn flyable(&self, ladder: &LadderConfig, task: Task, now: Time) -> Option<&Flown> {
        let longest = if task == Task::Track { ladder.missed_detection_s } else { ladder.plan_stale_s };
        self.flown.as_ref().filter(|flown| {
            let age = now.since(flown.stamp);
            age >= 0.0 && age <= flown.quintic.duration() && age <= longest && self.frames_arrive(ladder, now)
        })
    }

    /// The way aside of the newest plan, while it may be flown.
    #[must_use]
    pub fn evading(&self, ladder: &LadderConfig, now: Time) -> Option<Evasion> {
        self.evaded.filter(|_| self.frames_arrive(ladder, now))
    }

    /// Plans arrive, whether they choose or not.
    #[must_use]
    pub fn frames_arrive(&self, ladder: &LadderConfig, now: Time) -> bool {
        self.newest.is_some_and(|(_, stamp)| now.since(stamp) <= ladder.plan_stale_s)
    }

    /// Seconds since the last plan's frame, or since the beginning.
    #[must_use]
    pub fn silence(&self, now: Time) -> f64 {
        now.since(self.newest.map_or(self.since, |(_, stamp)| stamp))
    }

    /// The room about the vehicle, as far as the newest plan tells it.
    #[must_use]
    pub fn room(&self) -> Option<&Room> {
        self.room.as_ref()
    }
}

fn finite(v: &Vec3) -> bool {
    v.iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;
    use crate::values::types::{ANCHORS, Added, Candidate, FlatState, Rot};

    fn ladder() -> LadderConfig {
        shipped::tuning().ladder
    }

    fn plan(seq: u64, stamp: f64, duration: f64, chosen: Option<usize>) -> Plan {
        let end = FlatState { pos: Vec3::x(), ..FlatState::default() };
        let candidate =
            Candidate { end, cost: 0.0, added: Added::default(), objectness: 1.0, target_world: None, rejection: None };
        Plan {
            seq,
            stamp: Time::from_secs(stamp),
            start: FlatState::default(),
            world_from_cam: Rot::identity(),
            duration,
            alpha: 1.0,
            candidates: [candidate; ANCHORS],
            chosen,
            target: None,
            look: None,
            room: None,
            movers: [None; crate::planning::movers::MOST],
            evasion: None,
        }
    }

    #[test]
    fn a_trajectory_is_not_flown_past_its_end() {
        let mut plans = Plans::new(Time(0));
        plans.take(&plan(1, 1.0, 0.1, Some(7)));
        assert!(plans.flyable(&ladder(), Task::Track, Time::from_secs(1.09)).is_some());
        assert!(plans.flyable(&ladder(), Task::Track, Time::from_secs(1.11)).is_none());
    }

    #[test]
    fn the_newest_plan_with_a_choice_is_flown() {
        let mut plans = Plans::new(Time(0));
        plans.take(&plan(1, 1.0, 2.0, Some(7)));
        plans.take(&plan(2, 1.1, 2.0, Some(3)));
        plans.take(&plan(3, 1.2, 2.0, None));
        assert_eq!(plans.flyable(&ladder(), Task::Track, Time::from_secs(1.3)).map(|f| f.seq), Some(2));
        assert_eq!(plans.silence(Time::from_secs(1.3)), 0.1);
    }

    #[test]
    fn a_plan_that_cannot_be_flown_counts_as_a_frame_without_a_choice() {
        let mut plans = Plans::new(Time(0));
        let mut endless = plan(1, 1.0, f64::INFINITY, Some(7));
        plans.take(&endless);
        endless = plan(2, 1.0, 2.0, Some(7));
        endless.candidates[7].end.vel.y = f64::NAN;
        plans.take(&endless);
        plans.take(&plan(3, 1.0, 2.0, Some(99)));
        let now = Time::from_secs(1.1);
        assert!(plans.flyable(&ladder(), Task::Track, now).is_none() && plans.frames_arrive(&ladder(), now));
    }
}
