//! A jump of the odometry's frame: the estimator announced it, or the position is where no motion leads.

use crate::values::geometry::{wrap, yaw_of};
use crate::values::types::{Odometry, Rot, Vec3};

/// The odometry's frame moved against the world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Jump {
    /// Add to a position of before the jump, m.
    pub pos_world: Vec3,
    /// Add to a yaw of before the jump, rad.
    pub yaw: f64,
    /// Where the vehicle is after it, m: what it sees turns about there.
    pub about_world: Vec3,
}

impl Jump {
    /// A direction or velocity of before the jump, as it is seen from the vehicle after it.
    #[must_use]
    pub fn turned(&self, before: &Vec3) -> Vec3 {
        Rot::from_axis_angle(&Vec3::z_axis(), self.yaw) * before
    }

    /// A place of before the jump, as it lies from the vehicle after it, m.
    #[must_use]
    pub fn seen(&self, before: &Vec3) -> Vec3 {
        self.about_world + self.turned(&(before + self.pos_world - self.about_world))
    }
}

/// A position farther from where the last velocity leads is a jump even if the estimator does not say so, m, and so
/// much more for each second between samples. Chosen by eye.
const UNANNOUNCED_JUMP: (f64, f64) = (0.4, 1.0);

/// A jump of the frame from `last` to `new`, announced or not.
pub(crate) fn jump(last: &Odometry, new: &Odometry) -> Option<Jump> {
    let announced = new.reset_counter != last.reset_counter;
    let pos_world = moved(last, new);
    if !announced && !is_jump(pos_world, new.stamp.since(last.stamp)) {
        return None;
    }
    let yaw = if announced { turned(last, new) } else { 0.0 };
    Some(Jump { pos_world, yaw, about_world: new.pos_world })
}

/// How far from where the velocities lead the position is, m.
fn moved(last: &Odometry, new: &Odometry) -> Vec3 {
    // The mean of both velocities, so that hard braking in a slow stream is no jump.
    let dt = new.stamp.since(last.stamp);
    new.pos_world - (last.pos_world + (last.vel_world + new.vel_world) * (0.5 * dt))
}

/// A position that is `moved_world` (m) from where it should be after `dt` s has jumped, whatever the estimator says.
fn is_jump(moved_world: Vec3, dt: f64) -> bool {
    moved_world.norm() > UNANNOUNCED_JUMP.0 + UNANNOUNCED_JUMP.1 * dt
}

/// By how much more the heading turned than the rate says, rad.
pub(crate) fn turned(last: &Odometry, new: &Odometry) -> f64 {
    let rate = last.ang_vel_body.z;
    wrap(yaw_of(&new.world_from_body) - yaw_of(&last.world_from_body) - rate * new.stamp.since(last.stamp))
}
