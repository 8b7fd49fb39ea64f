//! Where a target should be that may be hidden.

use crate::gaze::doubt::pos_doubt;
use crate::gaze::hidden::{CARRY, hidden_for};
use crate::values::types::{TargetEstimate, Time, Vec3};

/// A believed target at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Where it should be, m.
    pub pos_world: Vec3,
    /// Its last known velocity, m/s.
    pub vel_world: Vec3,
    /// For how long it has been hidden, s.
    pub hidden_for: f64,
    /// When it was seen last,
    pub last_seen: Time,
    /// and where, m.
    pub seen_world: Vec3,
    /// It may be nearer by so much, as it was believed last, m. ([`crate::gaze::threat::Threat`] is more careful.)
    pub pos_doubt: f64,
}

impl Expected {
    /// The target of an estimate, at `now`.
    #[must_use]
    pub fn of(target: &TargetEstimate, now: Time) -> Self {
        Self {
            pos_world: carried(target, now),
            vel_world: target.vel_world,
            hidden_for: hidden_for(target.last_seen, now),
            last_seen: target.last_seen,
            seen_world: target.pos_world - target.vel_world * target.stamp.since(target.last_seen),
            pos_doubt: pos_doubt(&target.covariance.fixed_view::<3, 3>(0, 0).into()),
        }
    }
}

/// How far an estimate's own time is carried on to `now`, s.
#[must_use]
pub fn carry(target: &TargetEstimate, now: Time) -> f64 {
    now.since(target.stamp).clamp(0.0, CARRY)
}

/// Where the target of an estimate is at `now`, if it goes on as it did, m.
#[must_use]
pub fn carried(target: &TargetEstimate, now: Time) -> Vec3 {
    target.pos_world + target.vel_world * carry(target, now)
}
