//! Where the trajectories should end: navigation's goal, or where the target will be by then (beyond the paper). The
//! network gets it as the last vector of its state and is trained to end there.

use crate::gaze::expected::Expected;
use crate::gaze::hidden;
use crate::planning::obstacles::{Ignored, Obstacles};
use crate::values::quintic::Quintic;
use crate::values::types::{FlatState, Time, Vec3};
use schemars::JsonSchema;
use serde::Deserialize;

mod aside;

/// How a target is chased.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ChaseConfig {
    /// Horizontal distance to keep from a target that stands, m.
    #[schemars(range(min = 0.0, max = 20.0), extend("x-why" = "from farther off the target is not seen well", "x-source" = "chosen by eye: 1 m over the shipped limits.min_target_distance_m"))]
    pub standoff_m: f64,
    /// What is kept beyond that for each m/s of the target's speed, s: it may turn.
    #[schemars(range(min = 0.0, max = 5.0), extend("x-why" = "from farther off the target is not seen well", "x-source" = "tried, notebook: Nearer, for it brakes harder"))]
    pub headway_s: f64,
    /// Height above the target's centre, m.
    #[schemars(range(min = 0.0, max = 20.0), extend("x-why" = "the camera does not look down", "x-source" = "0 was tried and gives the same, notebook, What mattered: What does not help the chase"))]
    pub above_target_m: f64,
    /// So far beside its aim the chase flies at most, m, for the target not to be hidden. 0: not at all.
    #[schemars(range(min = 0.0, max = 6.0), extend("x-why" = "farther aside than it is behind it cuts nothing off", "x-source" = "tried, notebook: Aside, to see past a trunk"))]
    pub aside_m: f64,
    /// A target hidden for longer than this is not pursued any more, s.
    #[schemars(range(min = 0.0, max = 30.0), extend("x-why" = "by then it may be anywhere", "x-source" = "tried, notebook, What mattered: The way that it took"))]
    pub pursue_until_s: f64,
}

/// How a goal is flown to.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NavigationConfig {
    /// What the network is asked for each m/s of the asked speed: among trees it flies more slowly than what it is asked.
    #[schemars(range(min = 0.5, max = 2.0), extend("x-why" = "half and twice of what is asked is another speed", "x-source" = "tried, notebook: The asked speed is flown"))]
    pub pace: f64,
    /// It is asked more than the asked speed up to this, m/s: beyond it the acceleration is what is missing.
    #[schemars(range(min = 0.0, max = 40.0), extend("x-why" = "faster no profile asks", "x-source" = "tried, notebook: The asked speed is flown"))]
    pub pace_up_to_mps: f64,
    /// Its largest share of the acceleration for which the speed asks in training. Above 1 there is acceleration to
    /// spare, and the slow one keeps farther off.
    #[schemars(range(min = 0.05, max = 3.0), extend("x-why" = "3 is all that the training asks for", "x-source" = "tried, notebook: Acceleration to spare"))]
    pub max_agility: f64,
}

impl NavigationConfig {
    /// What the network is asked for a profile that asks `speed`, m/s.
    #[must_use]
    pub fn asked(&self, speed: f64) -> f64 {
        (self.pace * speed).min(self.pace_up_to_mps.max(speed))
    }
}

/// Looks along a trajectory at so many instants. Chosen by eye.
const LOOKS: u32 = 8;

impl ChaseConfig {
    /// The target is worth going after.
    #[must_use]
    pub fn pursues(&self, target: &Expected) -> bool {
        target.hidden_for <= self.pursue_until_s
    }
}

/// How much nearer than `keep_off` (m) a trajectory comes to the target, which the network was never taught to spare:
/// 0 not at all, 1 to its centre.
#[must_use]
pub fn crowding(keep_off: f64, trajectory: &Quintic, target: &Expected) -> f64 {
    let nearest = (1..=LOOKS)
        .map(|k| trajectory.duration() * f64::from(k) / f64::from(LOOKS))
        .map(|t| (trajectory.at(t).pos - target.pos_world - target.vel_world * t).norm_squared())
        .fold(f64::INFINITY, f64::min)
        .sqrt();
    (1.0 - nearest / (keep_off + target.pos_doubt)).max(0.0)
}

/// Navigation: over the goal by more than this, m, a trajectory should not end. Tried: the notebook, What mattered,
/// "Not climbing".
const RISE: f64 = 0.6;

/// How far too high a navigation ends at `end`, m: who flies over a roof finds no way down to the goal under it, which
/// the camera does not show.
#[must_use]
pub fn climbing(end: Vec3, goal: Vec3) -> f64 {
    (end.z - goal.z - RISE).max(0.0)
}

/// At least so far beyond the place where it went, the way that it was heading, the chase aims first, m: farther where
/// it would otherwise get there more slowly than the target ran. Tried: the notebook, What mattered, "The way that it
/// took".
const BEYOND: f64 = 2.0;
/// From so near to that place one sees what lies behind it, m. Tried together with [`BEYOND`].
const PASSED_WITHIN: f64 = 2.5;

/// The chase: where it aims, and whether it has been where the target vanished.
#[derive(Clone, Copy, Debug)]
pub struct Chase {
    config: ChaseConfig,
    /// When the target was last seen whose last place has been reached.
    passed: Option<Time>,
    aside: aside::Aside,
}

impl Chase {
    /// A chase that has not begun.
    #[must_use]
    pub fn new(config: ChaseConfig) -> Self {
        Self { config, passed: None, aside: aside::Aside::default() }
    }

    /// The same chase, from here on by other rules.
    pub(crate) fn with(self, config: ChaseConfig) -> Self {
        Self { config, ..self }
    }

    /// Where a trajectory of `duration` s from `pos_world` should end, relative to there, m: short of where the target
    /// will be then, never behind the vehicle. A target that went behind something is followed by the way that it took:
    /// first to where it was seen last, which lies in the open, for the straight line to where it should be now leads
    /// into the wall beside the doorway. The longer it is hidden, the less is its last velocity believed, and the less
    /// room is kept.
    pub fn aim(&mut self, pos_world: Vec3, target: &Expected, duration: f64) -> Vec3 {
        let up = Vec3::new(0.0, 0.0, self.config.above_target_m);
        let vel_world = Vec3::new(target.vel_world.x, target.vel_world.y, 0.0);
        let corner = target.seen_world - pos_world;
        if corner.xy().norm() < PASSED_WITHIN {
            self.passed = Some(target.last_seen);
        }
        if target.hidden_for > hidden::BEHIND && self.passed != Some(target.last_seen) {
            let beyond = (vel_world.norm() * duration - corner.xy().norm()).max(BEYOND);
            return corner + vel_world.try_normalize(1e-6).unwrap_or_default() * beyond + up;
        }
        let lead = duration * (1.0 - target.hidden_for / hidden::CARRY).clamp(0.0, 1.0);
        let line = target.pos_world + vel_world * lead - pos_world;
        let room = self.config.standoff_m + self.config.headway_s * vel_world.norm();
        let flat = line.xy().norm();
        let kept = (flat - room * (1.0 - target.hidden_for / hidden::ROOM).max(0.0)).max(0.0) / flat.max(1e-6);
        Vec3::new(line.x * kept, line.y * kept, line.z) + up
    }

    /// As [`Chase::aim`], aside of it where what is remembered would hide the target, whose place is `ignored`.
    pub fn aim_in_sight(
        &mut self,
        start: &FlatState,
        target: &Expected,
        duration: f64,
        obstacles: &Obstacles,
        ignored: &Ignored,
    ) -> Vec3 {
        let aim = self.aim(start.pos, target, duration);
        self.aside.of((aim, self.config.aside_m), start, duration, target, (obstacles, ignored))
    }
}

/// An aim as a share of the `reach` (m) of a trajectory, at most 1 long. Not finite: none, which is zero.
#[must_use]
pub fn within_reach(aim: Vec3, reach: f64) -> Vec3 {
    let share = aim / reach.max(aim.norm());
    if share.iter().all(|x| x.is_finite()) { share } else { Vec3::zeros() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;
    use crate::values::types::FlatState;

    fn config() -> ChaseConfig {
        ChaseConfig { standoff_m: 2.5, headway_s: 0.0, pursue_until_s: 2.5, ..shipped::tuning().planner.chase }
    }

    /// It was seen last 1 m before where it should be.
    fn target(hidden_for: f64) -> Expected {
        let pos_world = Vec3::new(6.0, 0.0, 1.0);
        let (last_seen, seen_world) = (Time::from_secs(7.0), pos_world - Vec3::x());
        Expected { pos_world, vel_world: Vec3::new(2.0, 0.0, 0.4), hidden_for, last_seen, seen_world, pos_doubt: 0.0 }
    }

    fn aim(config: ChaseConfig, pos_world: Vec3, target: &Expected, duration: f64) -> Vec3 {
        Chase::new(config).aim(pos_world, target, duration)
    }

    #[test]
    fn it_lies_short_of_where_the_target_will_be_and_a_little_higher() {
        let aim = aim(config(), Vec3::new(1.0, 0.0, 1.0), &target(0.0), 1.0);
        assert!((aim - Vec3::new(4.5, 0.0, 0.3)).norm() < 1e-12, "{aim}");
    }

    #[test]
    fn a_fast_target_is_given_more_room() {
        let chase = ChaseConfig { headway_s: 0.5, ..config() };
        let aim = aim(chase, Vec3::new(1.0, 0.0, 1.0), &target(0.0), 1.0);
        assert!((aim - Vec3::new(3.5, 0.0, 0.3)).norm() < 1e-12, "{aim}");
    }

    #[test]
    fn one_that_went_behind_something_is_followed_to_where_it_was_seen_last_and_from_there_on() {
        let (mut chase, hidden) = (Chase::new(config()), target(0.5));
        let away = Vec3::new(-4.0, -3.0, 1.0);
        let first = chase.aim(away, &hidden, 1.0);
        assert!((away + first - Vec3::new(7.0, 0.0, 1.3)).norm() < 1e-12, "{first}: 2 m beyond, as it was heading");
        let there = Vec3::new(4.0, -2.0, 1.0);
        assert!(chase.aim(there, &hidden, 1.0).x > 0.0);
        let on = chase.aim(away, &hidden, 1.0);
        assert!((on - first).norm() > 0.5, "it has been there: {on}");
        let again = Expected { last_seen: Time::from_secs(8.0), ..hidden };
        assert_eq!(chase.aim(away, &again, 1.0), first, "seen and hidden anew");
    }

    #[test]
    fn the_way_to_where_it_was_seen_last_is_flown_as_fast_as_it_ran() {
        let hidden = Expected { vel_world: Vec3::new(6.0, 0.0, 0.0), ..target(0.5) };
        let aim = aim(config(), Vec3::new(1.0, 0.0, 1.0), &hidden, 1.5);
        assert!((aim.x - 9.0).abs() < 1e-12, "6 m/s for 1.5 s, of which it is 4 m to there: {aim}");
    }

    #[test]
    fn a_hidden_target_is_led_less_and_less_and_given_no_room() {
        let ahead = |unseen| {
            let mut chase = Chase::new(config());
            chase.aim(target(unseen).seen_world, &target(unseen), 1.0); // there is nothing more to see from there
            chase.aim(Vec3::zeros(), &target(unseen), 1.0).x
        };
        assert_eq!([ahead(0.0), ahead(0.75), ahead(2.0)], [5.5, 6.375, 6.0]);
        assert!(config().pursues(&target(2.5)) && !config().pursues(&target(2.6)));
    }

    #[test]
    fn nobody_backs_off_from_a_target_that_is_near() {
        let aim = aim(config(), Vec3::new(7.0, 0.0, 1.3), &target(0.0), 0.0);
        assert!(aim.norm() < 1e-12, "{aim}");
    }

    #[test]
    fn meeting_the_target_costs_and_passing_it_does_not() {
        let fly = |lateral: f64, far: f64| {
            let vel = Vec3::new(4.0, 0.0, 0.0);
            let start = FlatState { pos: Vec3::new(3.0, lateral, 1.0), vel, acc: Vec3::zeros() };
            Quintic::new(&start, &FlatState { pos: start.pos + Vec3::new(far, 0.0, 0.0), ..start }, 2.0)
        };
        let still = Expected { vel_world: Vec3::zeros(), ..target(0.0) };
        assert!(crowding(1.5, &fly(0.0, 8.0), &still) > 0.67);
        assert_eq!(crowding(1.5, &fly(2.0, 8.0), &still), 0.0);
        // It runs away at 2 m/s: behind it there is room.
        assert_eq!(crowding(1.5, &fly(0.0, 4.0), &target(0.0)), 0.0);
    }

    #[test]
    fn a_far_aim_is_one_long_and_a_mad_one_is_none() {
        assert_eq!(within_reach(Vec3::new(0.0, 5.0, 0.0), 10.0), Vec3::new(0.0, 0.5, 0.0));
        assert!((within_reach(Vec3::new(30.0, 40.0, 0.0), 10.0).norm() - 1.0).abs() < 1e-12);
        for bad in [f64::NAN, f64::INFINITY] {
            assert_eq!(within_reach(Vec3::new(bad, 1.0, 0.0), 10.0), Vec3::zeros());
        }
    }

    #[test]
    fn more_than_the_asked_speed_is_asked_up_to_a_limit_and_never_less() {
        let how = NavigationConfig { pace: 1.2, pace_up_to_mps: 9.0, max_agility: 1.0 };
        let asked = [5.0, 8.0, 9.0, 12.0].map(|speed| how.asked(speed));
        assert_eq!(asked, [6.0, 9.0, 9.0, 12.0]);
    }
}
