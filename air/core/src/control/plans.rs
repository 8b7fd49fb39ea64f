//! Which plan is flown: the newest that chose a trajectory, for as long as it may be flown.

use crate::planning::evade::Evasion;
use crate::planning::plan::Plan;
use crate::planning::room::Room;
use crate::planning::target::LONGEST_CARRY;
use crate::values::quintic::Quintic;
use crate::values::types::{Candidate, FlatState, TargetEstimate, Task, Time, Vec3};

/// When each rung of the fallback ladder takes over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LadderConfig {
    /// Track: how old the last chosen trajectory may get while frames without a choice arrive, s (0.6).
    pub missed_detection: f64,
    /// How old the last chosen trajectory may get when no frame at all arrives, s (0.3).
    pub plan_stale: f64,
    /// How long to hold without any plan before landing, s (20).
    pub no_plan_land: f64,
    /// Age of odometry beyond which it is not flown on, s (0.2).
    pub odometry_stale: f64,
    /// Net downward acceleration while descending without odometry, m/s² (0.3).
    pub descend_acc: f64,
    /// How long to descend without odometry before handing back, s (1.5).
    pub hand_back: f64,
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

/// What is as likely the target as this is looked at, for so long, s, once the target itself has not been seen for so
/// long, s.
const GLIMPSE: (f64, f64, f64) = (0.9, 0.2, 0.1);
/// It is no farther from where the target was than this, m, and what a target runs meanwhile, m/s.
const GLIMPSE_WITHIN: (f64, f64) = (1.0, 10.0);

/// What has come from the planner in this flight.
#[derive(Clone, Copy, Debug)]
pub struct Plans {
    /// Plans of earlier frames are of another flight.
    since: Time,
    newest: Option<(u64, Time)>,
    flown: Option<Flown>,
    /// Out of the way of what moves, of the newest plan.
    evaded: Option<Evasion>,
    target: Option<TargetEstimate>,
    /// When and where something last looked like the target.
    glimpse: Option<(Time, Vec3)>,
    /// About the vehicle, when the last plan was made.
    room: Option<Room>,
}

impl Plans {
    /// Nothing yet; frames before `since` do not count.
    #[must_use]
    pub fn new(since: Time) -> Self {
        Self { since, newest: None, flown: None, evaded: None, target: None, glimpse: None, room: None }
    }

    /// Takes the newest plan. One that is not finite counts as a frame without a choice.
    pub fn take(&mut self, plan: &Plan) {
        if self.newest.is_some_and(|(seq, _)| seq == plan.seq) || plan.stamp < self.since {
            return;
        }
        self.newest = Some((plan.seq, plan.stamp));
        self.target = plan.target.filter(|t| finite(&t.pos_world) && finite(&t.vel_world));
        self.room = plan.room;
        let likely = |candidate: &&Candidate| candidate.objectness >= GLIMPSE.0;
        let seen = plan.candidates.iter().filter(likely).max_by(|a, b| a.objectness.total_cmp(&b.objectness));
        if let Some(pos_world) = seen.and_then(|candidate| candidate.target_world).filter(finite) {
            self.glimpse = Some((plan.stamp, pos_world));
        }
        let whole = |way: &Evasion| finite(&way.vel_world) && way.height.is_none_or(f64::is_finite);
        self.evaded = plan.evasion.filter(whole);
        let Some(end) = plan.chosen.and_then(|index| plan.candidates.get(index)).map(|chosen| &chosen.end) else {
            return;
        };
        let whole = [&plan.start, end].iter().all(|s| finite(&s.pos) && finite(&s.vel) && finite(&s.acc));
        if whole && plan.duration.is_finite() && plan.duration > 1e-3 {
            let quintic = Quintic::new(&plan.start, end, plan.duration);
            self.flown = Some(Flown { seq: plan.seq, stamp: plan.stamp, quintic });
        }
    }

    /// Moves what is known of the target by `jump_world`, m. The trajectory needs no move: only its acceleration is flown.
    pub fn shift(&mut self, jump_world: Vec3) {
        if let Some(target) = &mut self.target {
            target.pos_world += jump_world;
        }
        if let Some((_, pos_world)) = &mut self.glimpse {
            *pos_world += jump_world;
        }
    }

    /// The trajectory, unless it has expired: it is over, or it is older than the ladder allows, or frames have stopped.
    #[must_use]
    pub fn flyable(&self, ladder: &LadderConfig, task: Task, now: Time) -> Option<&Flown> {
        let longest = if task == Task::Track { ladder.missed_detection } else { ladder.plan_stale };
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
        self.newest.is_some_and(|(_, stamp)| now.since(stamp) <= ladder.plan_stale)
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

    /// The newest target estimate.
    #[must_use]
    pub fn target(&self) -> Option<&TargetEstimate> {
        self.target.as_ref()
    }

    /// Where something has just looked like the target, which itself is not seen: it may be the target.
    #[must_use]
    pub fn glimpse(&self, now: Time) -> Option<Vec3> {
        let (_, latest, missed) = GLIMPSE;
        let ((stamp, pos_world), target) = self.glimpse.zip(self.target)?;
        let unseen = now.since(target.last_seen);
        let reach = GLIMPSE_WITHIN.0 + GLIMPSE_WITHIN.1 * unseen;
        let fits = unseen > missed && (pos_world - target.pos_world).norm() < reach;
        (fits && now.since(stamp) < latest).then_some(pos_world)
    }

    /// The newest estimate carried on to `now` at its velocity, for a while; velocity 0 once it is not believed.
    #[must_use]
    pub fn target_at(&self, now: Time) -> Option<FlatState> {
        self.target.map(|t| {
            let carry = now.since(t.stamp).clamp(0.0, LONGEST_CARRY);
            let vel = if t.confirmed { t.vel_world } else { Vec3::zeros() };
            FlatState { pos: t.pos_world + t.vel_world * carry, vel, acc: Vec3::zeros() }
        })
    }
}

fn finite(v: &Vec3) -> bool {
    v.iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::values::types::{ANCHORS, Candidate, Rot};

    const LADDER: LadderConfig = LadderConfig {
        missed_detection: 0.6,
        plan_stale: 0.3,
        no_plan_land: 20.0,
        odometry_stale: 0.2,
        descend_acc: 0.3,
        hand_back: 1.5,
    };

    fn plan(seq: u64, stamp: f64, duration: f64, chosen: Option<usize>) -> Plan {
        let end = FlatState { pos: Vec3::x(), ..FlatState::default() };
        let candidate = Candidate { end, cost: 0.0, objectness: 1.0, target_world: None, rejection: None };
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
            room: None,
            movers: [None; crate::planning::movers::MOST],
            evasion: None,
        }
    }

    #[test]
    fn a_trajectory_is_not_flown_past_its_end() {
        let mut plans = Plans::new(Time(0));
        plans.take(&plan(1, 1.0, 0.1, Some(7)));
        assert!(plans.flyable(&LADDER, Task::Track, Time::from_secs(1.09)).is_some());
        assert!(plans.flyable(&LADDER, Task::Track, Time::from_secs(1.11)).is_none());
    }

    #[test]
    fn the_newest_plan_with_a_choice_is_flown() {
        let mut plans = Plans::new(Time(0));
        plans.take(&plan(1, 1.0, 2.0, Some(7)));
        plans.take(&plan(2, 1.1, 2.0, Some(3)));
        plans.take(&plan(3, 1.2, 2.0, None));
        assert_eq!(plans.flyable(&LADDER, Task::Track, Time::from_secs(1.3)).map(|f| f.seq), Some(2));
        assert_eq!(plans.silence(Time::from_secs(1.3)), 0.1);
    }

    #[test]
    fn what_looks_like_the_target_is_glimpsed_while_that_is_not_seen_and_where_it_can_be() {
        let target = TargetEstimate {
            stamp: Time::from_secs(1.0),
            pos_world: Vec3::new(5.0, 0.0, 1.0),
            vel_world: Vec3::zeros(),
            covariance: nalgebra::Matrix6::identity(),
            confirmed: true,
            last_seen: Time::from_secs(1.0),
        };
        let glimpse = |objectness: f64, lateral: f64, unseen: f64, later: f64| {
            let mut plan = plan(1, 1.0 + unseen, 2.0, Some(7));
            let at = Vec3::new(5.0, lateral, 1.0);
            plan.candidates[3] = Candidate { objectness, target_world: Some(at), ..plan.candidates[3] };
            for candidate in plan.candidates.iter_mut().filter(|c| c.target_world.is_none()) {
                candidate.objectness = 0.0;
            }
            plan.target = Some(target);
            let mut plans = Plans::new(Time(0));
            plans.take(&plan);
            plans.glimpse(plan.stamp.plus(later))
        };
        assert_eq!(glimpse(0.95, 2.0, 0.2, 0.0), Some(Vec3::new(5.0, 2.0, 1.0)));
        assert_eq!(glimpse(0.85, 2.0, 0.2, 0.0), None, "unlikely");
        assert_eq!(glimpse(0.95, 2.0, 0.0, 0.0), None, "the target itself is seen");
        assert_eq!(glimpse(0.95, 4.0, 0.2, 0.0), None, "too far");
        assert_eq!(glimpse(0.95, 2.0, 0.2, 0.3), None, "too old");
        assert_eq!(glimpse(0.95, f64::NAN, 0.2, 0.0), None);
        assert_eq!(glimpse(f64::NAN, 2.0, 0.2, 0.0), None);
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
        assert!(plans.flyable(&LADDER, Task::Track, now).is_none() && plans.frames_arrive(&LADDER, now));
    }
}
