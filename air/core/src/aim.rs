//! Where the trajectories should end: navigation's goal, or where the target will be by then (beyond the paper). The
//! network gets it as the last vector of its state and is trained to end there.

use crate::error::{ConfigError, not_negative, positive};
use crate::quintic::Quintic;
use crate::target::{Expected, LONGEST_CARRY};
use crate::types::Vec3;

/// How a target is chased.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChaseConfig {
    /// Horizontal distance to keep from a target that stands, m (2.5).
    pub standoff: f64,
    /// What is kept beyond that for each m/s of the target's speed, s (0.6): it may turn.
    pub headway: f64,
    /// Above the target's centre, m (0.3).
    pub height: f64,
    /// A target unseen for longer than this is not pursued any more, s (2.5).
    pub pursue_until: f64,
    /// Trajectories that come nearer to the target's centre than this cost more, m (1.5).
    pub keep_off: f64,
}

/// What it costs to meet the target, on the scale of the network's costs: more than a way around.
const MEETING: f64 = 30.0;
/// Looks along a trajectory at so many instants.
const LOOKS: u32 = 8;

impl ChaseConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        not_negative("chase.standoff", self.standoff)?;
        not_negative("chase.headway", self.headway)?;
        not_negative("chase.height", self.height)?;
        not_negative("chase.pursue_until", self.pursue_until)?;
        positive("chase.keep_off", self.keep_off)
    }

    /// The target is worth going after.
    #[must_use]
    pub fn pursues(&self, target: &Expected) -> bool {
        target.unseen <= self.pursue_until
    }

    /// Where a trajectory of `duration` s from `pos_world` should end, relative to there, m: short of where the target
    /// will be then, never behind the vehicle. The longer it is hidden, the less is its last velocity believed.
    #[must_use]
    pub fn aim(&self, pos_world: Vec3, target: &Expected, duration: f64) -> Vec3 {
        let lead = duration * (1.0 - target.unseen / LONGEST_CARRY).clamp(0.0, 1.0);
        let vel_world = Vec3::new(target.vel_world.x, target.vel_world.y, 0.0);
        let line = target.pos_world + vel_world * lead - pos_world;
        let flat = line.xy().norm();
        let kept = (flat - self.standoff - self.headway * vel_world.norm()).max(0.0) / flat.max(1e-6);
        Vec3::new(line.x * kept, line.y * kept, line.z + self.height)
    }

    /// What a trajectory costs for coming near to the target, which the network was never taught to spare.
    #[must_use]
    pub fn crowding(&self, trajectory: &Quintic, target: &Expected) -> f64 {
        let nearest = (1..=LOOKS)
            .map(|k| trajectory.duration() * f64::from(k) / f64::from(LOOKS))
            .map(|t| (trajectory.at(t).pos - target.pos_world - target.vel_world * t).norm_squared())
            .fold(f64::INFINITY, f64::min)
            .sqrt();
        MEETING * (1.0 - nearest / self.keep_off).max(0.0)
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
    use crate::types::FlatState;

    const CHASE: ChaseConfig =
        ChaseConfig { standoff: 2.5, headway: 0.0, height: 0.3, pursue_until: 2.5, keep_off: 1.5 };

    fn target(unseen: f64) -> Expected {
        Expected { pos_world: Vec3::new(6.0, 0.0, 1.0), vel_world: Vec3::new(2.0, 0.0, 0.4), unseen }
    }

    #[test]
    fn it_lies_short_of_where_the_target_will_be_and_a_little_higher() {
        let aim = CHASE.aim(Vec3::new(1.0, 0.0, 1.0), &target(0.0), 1.0);
        assert!((aim - Vec3::new(4.5, 0.0, 0.3)).norm() < 1e-12, "{aim}");
    }

    #[test]
    fn a_fast_target_is_given_more_room() {
        let chase = ChaseConfig { headway: 0.5, ..CHASE };
        let aim = chase.aim(Vec3::new(1.0, 0.0, 1.0), &target(0.0), 1.0);
        assert!((aim - Vec3::new(3.5, 0.0, 0.3)).norm() < 1e-12, "{aim}");
    }

    #[test]
    fn a_hidden_target_is_led_less_and_less() {
        let ahead = |unseen| CHASE.aim(Vec3::zeros(), &target(unseen), 1.0).x;
        assert_eq!([ahead(0.0), ahead(0.75), ahead(2.0)], [5.5, 4.5, 3.5]);
        assert!(CHASE.pursues(&target(2.5)) && !CHASE.pursues(&target(2.6)));
    }

    #[test]
    fn nobody_backs_off_from_a_target_that_is_near() {
        let aim = CHASE.aim(Vec3::new(7.0, 0.0, 1.3), &target(0.0), 0.0);
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
        assert!(CHASE.crowding(&fly(0.0, 8.0), &still) > 20.0);
        assert_eq!(CHASE.crowding(&fly(2.0, 8.0), &still), 0.0);
        // It runs away at 2 m/s: behind it there is room.
        assert_eq!(CHASE.crowding(&fly(0.0, 4.0), &target(0.0)), 0.0);
    }

    #[test]
    fn a_far_aim_is_one_long_and_a_mad_one_is_none() {
        assert_eq!(within_reach(Vec3::new(0.0, 5.0, 0.0), 10.0), Vec3::new(0.0, 0.5, 0.0));
        assert!((within_reach(Vec3::new(30.0, 40.0, 0.0), 10.0).norm() - 1.0).abs() < 1e-12);
        for bad in [f64::NAN, f64::INFINITY] {
            assert_eq!(within_reach(Vec3::new(bad, 1.0, 0.0), 10.0), Vec3::zeros());
        }
    }
}
