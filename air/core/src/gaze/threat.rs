//! The target at its worst: as near and as fast as the filter's covariance and its own legs allow.

use crate::gaze::doubt::{level_deviation, pos_doubt};
use crate::gaze::expected::{carried, carry};
use crate::gaze::hidden::{ANYWHERE, hidden_for};
use crate::values::types::{Flat, TargetEstimate, Time, Vec3};
use nalgebra::Matrix3;

/// A target may get so much faster than it was, m/s, and at least so fast. Chosen by eye.
const FASTER: (f64, f64) = (0.5, 2.0);
/// The filter's velocity is so late, s: meanwhile a target that runs may have gained speed toward the vehicle. By eye.
const LATE: f64 = 0.25;
/// A target counts as running in full at this speed, m/s, and as calming down at this rate after it, m/s². By eye.
const RUNS: (f64, f64) = (3.0, 1.5);
/// The most that one standard deviation of the velocity comes to, m/s. Chosen by eye.
const MOST_SPEED_DOUBT: f64 = 1.0;

/// The target as it may be at its worst.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Threat {
    /// Its centre, m.
    pub pos_world: Vec3,
    /// m/s.
    pub vel_world: Vec3,
    /// It may be nearer by so much, m,
    pub pos_doubt: f64,
    /// and faster by so much, m/s.
    pub vel_doubt: f64,
    /// For how long it has been hidden, s.
    pub hidden_for: f64,
}

impl Threat {
    /// An estimate carried on to `now`; none: the target has been hidden for so long that it may be anywhere.
    #[must_use]
    pub fn of(target: &TargetEstimate, now: Time) -> Option<Self> {
        let hidden_for = hidden_for(target.last_seen, now);
        if !target.covariance.iter().all(|x| x.is_finite()) || hidden_for > ANYWHERE {
            return None;
        }
        let carry = carry(target, now);
        let block = |row, column| -> Matrix3<f64> { target.covariance.fixed_view::<3, 3>(row, column).into() };
        let (pos, cross, vel) = (block(0, 0), block(0, 3), block(3, 3));
        let pos_covariance = pos + (cross + cross.transpose()) * carry + vel * (carry * carry);
        Some(Self {
            pos_world: carried(target, now),
            vel_world: target.vel_world,
            pos_doubt: pos_doubt(&pos_covariance),
            vel_doubt: level_deviation(&vel).min(MOST_SPEED_DOUBT),
            hidden_for,
        })
    }
}

/// The target's speed, m/s; falls slowly, since who turns stands for a moment.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pace(f64);

impl Pace {
    /// `dt` s later.
    pub(crate) fn step(&mut self, dt: f64, threat: &Threat) {
        self.0 = (self.0 - RUNS.1 * dt).max(threat.vel_world.xy().norm());
    }

    /// How fast the target may get, m/s.
    pub(crate) fn fastest(&self) -> f64 {
        (self.0 + FASTER.0).max(FASTER.1)
    }

    /// The target's velocity, m/s, as fast along `away` as it may be by now.
    pub(crate) fn worst(&self, threat: &Threat, target_acc: f64, away: &Flat) -> Flat {
        let seen: Flat = threat.vel_world.xy();
        let gained = target_acc * LATE * (self.0 / RUNS.0).min(1.0) + threat.vel_doubt;
        seen + away * gained.min(self.fastest() - seen.dot(away)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_target_that_has_not_been_seen_for_long_is_no_threat() {
        let estimate = |covariance: f64| TargetEstimate {
            stamp: Time::from_secs(1.0),
            pos_world: Vec3::x(),
            vel_world: Vec3::zeros(),
            covariance: nalgebra::Matrix6::identity() * covariance,
            confirmed: true,
            last_seen: Time::from_secs(1.0),
        };
        assert!(Threat::of(&estimate(0.1), Time::from_secs(1.1)).is_some());
        assert!(Threat::of(&estimate(0.1), Time::from_secs(6.0)).is_none());
        assert!(Threat::of(&estimate(f64::NAN), Time::from_secs(1.1)).is_none());
    }
}
