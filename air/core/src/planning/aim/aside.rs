//! Aside of the chase's aim, where what is remembered would come between the vehicle and the target (beyond the paper).
//!
//! A target runs past trunks, and each of them crosses the line of sight, for half a second or so. All trajectories end
//! near the aim, so it is the aim that steps aside to see past a trunk.

use crate::gaze::expected::Expected;
use crate::gaze::hidden;
use crate::planning::obstacles::{Ignored, Obstacles};
use crate::values::quintic::Quintic;
use crate::values::types::{FlatState, Vec3};

/// Places that are tried, as shares of the farthest, beside the aim itself.
const SHARES: [f64; 4] = [-1.0, -0.5, 0.5, 1.0];
/// The way to each is looked at in so many instants. Chosen by eye.
const LOOKS: u32 = 6;
/// The first of them is later than this, s: nothing changes what is seen sooner. Chosen by eye.
const SOONEST: f64 = 0.2;
/// More than this of the target must be hidden for it not to be found.
const FOUND: f64 = 0.9;
/// What hides it less counts so much of what hides it whole. Chosen by eye.
const IN_PART: f64 = 0.3;
/// A metre aside costs as much as a target that is hidden for this share of the way. Tried: the notebook, "Aside, to see
/// past a trunk".
const METRE: f64 = 0.03;
/// And so does a metre of change from frame to frame. Tried with [`METRE`].
const CHANGE: f64 = 0.02;

/// How far aside of its aim a chase flies.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Aside {
    /// To the left of the line from the aim to the target, m.
    last: f64,
}

impl Aside {
    /// `aim` (m, from where the vehicle is), or a place up to `farthest` m beside it, if from the way there the target is
    /// seen longer. The way lasts `duration` s. `aim` while the target is hidden: nobody knows from where it would be seen.
    pub(super) fn of(
        &mut self,
        (aim, farthest): (Vec3, f64),
        start: &FlatState,
        duration: f64,
        target: &Expected,
        (obstacles, ignored): (&Obstacles, &Ignored),
    ) -> Vec3 {
        let at = |time: f64| target.pos_world + target.vel_world * time;
        let line = at(duration) - start.pos - aim;
        let across = Vec3::new(-line.y, line.x, 0.0) / line.xy().norm();
        let tells = across.iter().all(|x| x.is_finite());
        if !tells || farthest <= 0.0 || target.hidden_for > hidden::BEHIND {
            self.last = 0.0;
            return aim;
        }
        let start = FlatState { acc: Vec3::zeros(), ..*start };
        let cost = |aside: f64| {
            let pos = start.pos + aim + across * aside;
            let way = Quintic::new(&start, &FlatState { pos, vel: target.vel_world, acc: Vec3::zeros() }, duration);
            let hidden: f64 = (1..=LOOKS)
                .map(|k| SOONEST + (duration - SOONEST) * f64::from(k) / f64::from(LOOKS))
                .map(|time| obstacles.hiding(&way.at(time).pos, &at(time), ignored.radius))
                .map(|share| if share > FOUND { 1.0 } else { IN_PART * share })
                .sum();
            let meets = obstacles.meeting(&way, Some(ignored));
            hidden / f64::from(LOOKS) + meets + METRE * aside.abs() + CHANGE * (aside - self.last).abs()
        };
        let (mut least, mut best) = (cost(0.0), 0.0);
        if least > 0.0 {
            for aside in SHARES.map(|share| share * farthest) {
                let found = cost(aside);
                if found < least {
                    (least, best) = (found, aside);
                }
            }
        }
        self.last = best;
        aim + across * best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::nearest::{COLUMNS, Nearest, ROWS};
    use crate::shipped;
    use crate::values::types::{Rot, Time};

    /// A pole straight ahead.
    fn pole(mm: u16) -> Obstacles {
        let how = shipped::tuning().planner;
        let mut obstacles = Obstacles::new(90_f64.to_radians(), 62_f64.to_radians(), 6.0, &how.obstacles, how.movers);
        let mut nearest: Nearest = [9000; COLUMNS * ROWS];
        (0..ROWS).for_each(|row| nearest[row * COLUMNS + COLUMNS / 2 - 4..][..12].fill(mm));
        for _ in 0..4 {
            obstacles.see(Time::from_secs(1.0), (&Vec3::z(), &Rot::identity()), &nearest, None);
        }
        obstacles
    }

    /// It runs ahead of the vehicle, which follows.
    fn target(hidden_for: f64) -> Expected {
        let (pos_world, last_seen) = (Vec3::new(8.0, 0.3, 1.0), Time::from_secs(7.0));
        let vel_world = Vec3::new(3.0, 0.0, 0.0);
        Expected { pos_world, vel_world, hidden_for, last_seen, seen_world: pos_world, pos_doubt: 0.0 }
    }

    fn aside(obstacles: &Obstacles, hidden_for: f64, farthest: f64) -> Vec3 {
        let target = target(hidden_for);
        let start = FlatState { pos: Vec3::z(), vel: Vec3::new(3.0, 0.0, 0.0), acc: Vec3::zeros() };
        let ignored = Ignored { at_world: target.pos_world, radius: 0.8 };
        let aim = Vec3::new(3.0, 0.0, 0.0);
        Aside::default().of((aim, farthest), &start, 1.0, &target, (obstacles, &ignored)) - aim
    }

    #[test]
    fn it_steps_aside_where_a_pole_would_hide_the_target_and_nowhere_else() {
        let stepped = aside(&pole(5500), 0.0, 3.0);
        assert!(stepped.y.abs() > 1.4 && stepped.x.abs() < 0.5, "{stepped}");
        let how = shipped::tuning().planner;
        let empty = Obstacles::new(1.5, 1.0, 6.0, &how.obstacles, how.movers);
        assert_eq!(aside(&empty, 0.0, 3.0), Vec3::zeros(), "nothing is remembered");
        assert_eq!(aside(&pole(5500), 0.5, 3.0), Vec3::zeros(), "hidden already");
        assert_eq!(aside(&pole(5500), 0.0, 0.0), Vec3::zeros(), "switched off");
    }

    #[test]
    fn a_step_once_begun_is_kept_while_two_sides_are_as_good() {
        let (obstacles, target) = (pole(5500), Expected { pos_world: Vec3::new(8.0, 0.0, 1.0), ..target(0.0) });
        let start = FlatState { pos: Vec3::z(), vel: Vec3::new(3.0, 0.0, 0.0), acc: Vec3::zeros() };
        let ignored = Ignored { at_world: target.pos_world, radius: 0.8 };
        for last in [-3.0, 3.0] {
            let mut aside = Aside { last };
            let stepped = aside.of((Vec3::x() * 3.0, 3.0), &start, 1.0, &target, (&obstacles, &ignored));
            assert!(stepped.y * last > 0.0, "{stepped}");
        }
    }

    #[test]
    fn a_mad_target_moves_no_aim() {
        for bad in [f64::NAN, f64::INFINITY] {
            let target = Expected { pos_world: Vec3::repeat(bad), ..target(0.0) };
            let ignored = Ignored { at_world: target.pos_world, radius: 0.8 };
            let start = FlatState::default();
            let stepped = Aside::default().of((Vec3::x(), 3.0), &start, 1.0, &target, (&pole(3000), &ignored));
            assert_eq!(stepped, Vec3::x());
        }
    }
}
