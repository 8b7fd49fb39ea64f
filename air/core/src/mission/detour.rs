//! A navigation that is stuck flies aside before it goes on to its goal (beyond the paper): what is seen from one place
//! alone has local minima, in front of a wall or among bushes, where a policy without memory would hover for ever.

use crate::values::types::{Rot, Time, Vec3};

/// Stuck: not out of a circle of this radius, m, for this long, s. Chosen by eye.
const STUCK: (f64, f64) = (1.0, 2.0);
/// The bearings to try, one after the other, from the goal's, rad, and how far to fly so, m: to both sides, then ever
/// farther back. Chosen by eye.
const TRIES: [(f64, f64); 6] = [(1.0, 4.0), (-1.0, 4.0), (1.8, 6.0), (-1.8, 6.0), (2.6, 8.0), (-2.6, 8.0)];
/// A try is given up at the time in which it could have been flown at this speed, m/s. Chosen by eye.
const SLOWEST: f64 = 2.0;
/// The waypoint lies so far away, m: never near enough to brake for, since a trajectory reaches 10 m at most.
const WAYPOINT_M: f64 = 20.0;
/// Nobody is stuck who is this near to the goal, m. Chosen by eye.
const NEAR_GOAL_M: f64 = 2.0;
/// Over a roof, with the goal below, a try is so many times longer: it must lead beyond the edge. Chosen by eye.
const OFF_A_ROOF: f64 = 3.0;
/// After all of them so many times, without getting nearer, there is no way. Chosen by eye.
const ROUNDS: usize = 2;
/// Nearer to the goal by this, m, than where it was stuck, the next time begins with the first bearing. Chosen by eye.
const PROGRESS_M: f64 = 3.0;

/// Notices that a navigation is stuck, and leads it aside.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Detour {
    /// Since when, and around where, it has not moved.
    circle: Option<(Time, Vec3)>,
    aside: Option<Aside>,
    tries: usize,
    /// Level distance to the goal of the place where it was stuck, m.
    stuck_at_m: f64,
    /// Of the goal, level, 1 long, as long as it had one.
    bearing: Vec3,
    found_none: bool,
}

#[derive(Clone, Copy, Debug)]
struct Aside {
    from: Vec3,
    waypoint: Vec3,
    length: f64,
    until: Time,
}

impl Detour {
    /// Where to fly from `pos` (m) at `now`: the `goal`, or a waypoint at its height aside from the way there.
    pub(crate) fn step(&mut self, now: Time, pos: Vec3, goal: Vec3) -> Vec3 {
        let gone_m = |from: Vec3| (pos - from).xy().norm();
        if let Some(aside) = self.aside {
            if now < aside.until && gone_m(aside.from) < aside.length {
                return aside.waypoint;
            }
            (self.aside, self.circle) = (None, None);
        }
        let to_goal = goal - pos;
        let flat_m = to_goal.xy().norm();
        // Over a roof, with the goal below it, there is no bearing but the one that led there.
        if flat_m > NEAR_GOAL_M || self.bearing == Vec3::zeros() {
            self.bearing = Vec3::new(to_goal.x, to_goal.y, 0.0).try_normalize(1e-6).unwrap_or_else(Vec3::x);
        }
        let (since, centre) = self.circle.filter(|(_, centre)| gone_m(*centre) < STUCK.0).unwrap_or((now, pos));
        self.circle = Some((since, centre));
        if now.since(since) < STUCK.1 || to_goal.norm() < NEAR_GOAL_M {
            return goal;
        }
        if flat_m < self.stuck_at_m - PROGRESS_M {
            self.tries = 0;
        }
        self.stuck_at_m = flat_m;
        if self.tries == ROUNDS * TRIES.len() {
            self.found_none = true;
            return goal;
        }
        let (turn, length) = TRIES[self.tries % TRIES.len()];
        let length = if flat_m > NEAR_GOAL_M { length } else { OFF_A_ROOF * length };
        self.tries += 1;
        let line = Rot::from_axis_angle(&Vec3::z_axis(), turn) * self.bearing * WAYPOINT_M;
        let waypoint = Vec3::new(pos.x + line.x, pos.y + line.y, goal.z);
        self.aside = Some(Aside { from: pos, waypoint, length, until: now.plus(length / SLOWEST) });
        waypoint
    }

    /// All was tried, and no way found.
    pub(crate) fn found_none(&self) -> bool {
        self.found_none
    }

    /// Nobody is led: who is held is not stuck, and tries all again.
    pub(crate) fn rest(&mut self) {
        *self = Self { bearing: self.bearing, ..Self::default() };
    }

    /// The frame of the odometry moved by `jump`, m.
    pub(crate) fn shift(&mut self, jump: Vec3) {
        if let Some((_, centre)) = &mut self.circle {
            *centre += jump;
        }
        if let Some(aside) = &mut self.aside {
            aside.from += jump;
            aside.waypoint += jump;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOAL: Vec3 = Vec3::new(40.0, 0.0, 2.0);

    /// Stands at `pos` from `from_s` to `to_s`; where it is led last.
    fn stand(detour: &mut Detour, pos: Vec3, from_s: f64, to_s: f64) -> Vec3 {
        let steps = ((to_s - from_s) * 200.0) as u32;
        (0..=steps).fold(GOAL, |_, k| detour.step(Time::from_secs(from_s + f64::from(k) * 0.005), pos, GOAL))
    }

    #[test]
    fn who_moves_on_is_led_to_the_goal() {
        let mut detour = Detour::default();
        for k in 0..4000 {
            let pos = Vec3::new(0.8 * 0.005 * f64::from(k), 0.0, 2.0);
            assert_eq!(detour.step(Time::from_secs(0.005 * f64::from(k)), pos, GOAL), GOAL);
        }
    }

    #[test]
    fn who_is_stuck_is_led_to_one_side_then_to_the_other_then_farther_back() {
        let mut detour = Detour::default();
        let at = Vec3::new(10.0, 0.0, 2.3);
        let mut begin = 0.0;
        let mut last = 0.0;
        for (turn, length) in TRIES {
            let aside = stand(&mut detour, at, begin, begin + 2.01) - at;
            assert!((aside.y.atan2(aside.x) - turn).abs() < 1e-9, "{aside} for {turn}");
            assert!((aside.z + 0.3).abs() < 1e-9 && turn.abs() >= last, "{aside}");
            last = turn.abs();
            // A try that leads nowhere ends, too.
            assert_eq!(stand(&mut detour, at, begin + 2.02, begin + 2.1 + length / SLOWEST), GOAL);
            begin += 2.1 + length / SLOWEST;
        }
    }

    #[test]
    fn after_two_rounds_without_getting_nearer_there_is_no_way() {
        let mut detour = Detour::default();
        let at = Vec3::new(10.0, 0.0, 2.0);
        let mut begin = 0.0;
        for (_, length) in TRIES.into_iter().chain(TRIES) {
            assert!(!detour.found_none());
            let end = begin + 2.1 + length / SLOWEST;
            stand(&mut detour, at, begin, end);
            begin = end;
        }
        assert_eq!(stand(&mut detour, at, begin, begin + 2.01), GOAL);
        assert!(detour.found_none());
        detour.rest();
        assert!(!detour.found_none());
        assert_ne!(stand(&mut detour, at, begin, begin + 2.01), GOAL, "tries again");
    }

    #[test]
    fn who_gets_nearer_may_try_all_again() {
        let mut detour = Detour::default();
        for step in 0..30 {
            let (at, begin) =
                (Vec3::new(f64::from(step) * (PROGRESS_M + 0.1) - 60.0, 0.0, 2.0), f64::from(step) * 10.0);
            stand(&mut detour, at, begin, begin + 9.0);
            assert!(!detour.found_none(), "{step}");
        }
    }

    #[test]
    fn far_enough_aside_it_goes_on_and_after_progress_the_first_side_comes_first_again() {
        let mut detour = Detour::default();
        let at = Vec3::new(10.0, 0.0, 2.0);
        assert_ne!(stand(&mut detour, at, 0.0, 2.01), GOAL);
        assert_ne!(detour.step(Time::from_secs(2.5), at + Vec3::new(0.0, 3.9, 0.0), GOAL), GOAL);
        assert_eq!(detour.step(Time::from_secs(2.6), at + Vec3::new(0.0, 4.1, 0.0), GOAL), GOAL);
        let on = Vec3::new(20.0, 0.0, 2.0);
        assert!(stand(&mut detour, on, 3.0, 5.01).y > on.y, "the left, again");
    }

    #[test]
    fn over_a_roof_with_the_goal_below_it_flies_off_by_the_bearing_that_led_there() {
        let mut detour = Detour::default();
        detour.step(Time::from_secs(0.0), GOAL - Vec3::new(10.0, 0.0, 0.0), GOAL);
        let above = GOAL + Vec3::new(0.0, 0.0, 3.0);
        let aside = stand(&mut detour, above, 1.0, 3.01) - above;
        assert!((aside.y.atan2(aside.x) - TRIES[0].0).abs() < 1e-9 && aside.z < -2.9, "{aside}");
        let beyond = above + aside * (3.0 * TRIES[0].1 / aside.xy().norm() - 0.01);
        assert_ne!(detour.step(Time::from_secs(3.1), beyond, GOAL), GOAL, "not yet far enough");
    }

    #[test]
    fn nobody_is_stuck_at_the_goal() {
        assert_eq!(stand(&mut Detour::default(), GOAL + Vec3::new(-1.9, 0.0, 0.0), 0.0, 10.0), GOAL);
    }

    #[test]
    fn who_was_held_is_not_stuck_at_once() {
        let mut detour = Detour::default();
        let at = Vec3::new(10.0, 0.0, 2.0);
        assert_eq!(stand(&mut detour, at, 0.0, 1.0), GOAL);
        detour.rest();
        assert_eq!(stand(&mut detour, at, 30.0, 31.0), GOAL);
        assert_ne!(stand(&mut detour, at, 31.0, 32.1), GOAL);
    }

    #[test]
    fn a_jump_of_the_odometry_moves_all_of_it() {
        let mut detour = Detour::default();
        let (at, jump) = (Vec3::new(10.0, 0.0, 2.0), Vec3::new(0.0, 50.0, 0.0));
        let before = stand(&mut detour, at, 0.0, 2.01);
        detour.shift(jump);
        assert_eq!(detour.step(Time::from_secs(2.1), at + jump, GOAL + jump), before + jump);
    }
}
