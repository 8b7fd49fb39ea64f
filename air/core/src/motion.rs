//! The vehicle's motion as the controller believes it: accepts odometry, notices jumps, feeds the observer.

use crate::config::ObserverConfig;
use crate::disturbance::Observer;
use crate::types::{GRAVITY, Odometry, Time, Vec3};
use crate::yaw::{wrap, yaw_of};

/// The odometry's frame moved against the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// Add to a position of before the jump, m.
    pub pos_world: Vec3,
    /// Add to a yaw of before the jump, rad.
    pub yaw: f64,
}

/// Last accepted odometry and the disturbance observer.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    last: Option<Odometry>,
    observer: Observer,
}

/// A position farther from where the last velocity leads is a jump even if the estimator does not say so, m.
const UNANNOUNCED_JUMP: f64 = 1.0;
/// Samples farther apart are not one step of the observer, s.
const LONGEST_STEP: f64 = 0.2;

impl Motion {
    /// Has seen nothing.
    #[must_use]
    pub fn new(config: ObserverConfig) -> Self {
        Self { last: None, observer: Observer::new(config) }
    }

    /// The observer.
    #[must_use]
    pub fn observer(&self) -> &Observer {
        &self.observer
    }

    /// Forgets the disturbance: on the ground.
    pub fn reset_observer(&mut self) {
        self.observer.reset();
    }

    /// Accepts `odometry` if it is finite and newer. `thrust_acc`: collective thrust per unit mass (m/s²) commanded since
    /// the last one. Returns a jump of the frame.
    pub fn take(&mut self, odometry: &Odometry, thrust_acc: f64) -> Option<Jump> {
        let parts = [&odometry.pos_world, &odometry.vel_world, &odometry.ang_vel_body];
        let finite = parts.iter().all(|v| v.iter().all(|x| x.is_finite()));
        // A quaternion that is not of unit length is no attitude.
        let unit = (odometry.world_from_body.norm() - 1.0).abs() < 1e-3;
        let newer = self.last.is_none_or(|last| odometry.stamp > last.stamp);
        if !finite || !unit || !newer {
            return None;
        }
        let jump = self.last.and_then(|last| jump(&last, odometry));
        let dt = self.last.map_or(0.0, |last| odometry.stamp.since(last.stamp));
        if jump.is_some() || dt > LONGEST_STEP {
            self.observer.rebase(odometry.vel_world);
        } else {
            let model = odometry.world_from_body * Vec3::z() * thrust_acc - Vec3::z() * GRAVITY;
            self.observer.step(dt, odometry.vel_world, model);
        }
        self.last = Some(*odometry);
        jump
    }

    /// The last accepted odometry, however old.
    #[must_use]
    pub fn last(&self) -> Option<&Odometry> {
        self.last.as_ref()
    }

    /// The last accepted odometry unless it is older than `stale` seconds (or stamped that far in the future).
    #[must_use]
    pub fn fresh(&self, now: Time, stale: f64) -> Option<&Odometry> {
        self.last.as_ref().filter(|last| now.since(last.stamp).abs() <= stale)
    }

    /// Age of the last accepted odometry, s; none: there is none.
    #[must_use]
    pub fn age(&self, now: Time) -> Option<f64> {
        self.last.map(|last| now.since(last.stamp).abs())
    }
}

fn jump(last: &Odometry, new: &Odometry) -> Option<Jump> {
    let dt = new.stamp.since(last.stamp);
    // The mean of both velocities, so that hard braking in a slow stream is no jump.
    let moved = new.pos_world - (last.pos_world + (last.vel_world + new.vel_world) * (0.5 * dt));
    let announced = new.reset_counter != last.reset_counter;
    if !announced && moved.norm() <= UNANNOUNCED_JUMP + dt {
        return None;
    }
    let turned = wrap(yaw_of(&new.world_from_body) - yaw_of(&last.world_from_body) - last.ang_vel_body.z * dt);
    Some(Jump { pos_world: moved, yaw: if announced { turned } else { 0.0 } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::Rot;

    const CONFIG: ObserverConfig = ObserverConfig { alpha1: 3.0, alpha2: 2.0, zeta: 0.2, limit: 6.0 };

    fn at(stamp: f64, x: f64) -> Odometry {
        Odometry {
            stamp: Time::from_secs(stamp),
            pos_world: Vec3::new(x, 0.0, 2.0),
            vel_world: Vec3::new(5.0, 0.0, 0.0),
            world_from_body: Rot::identity(),
            ang_vel_body: Vec3::zeros(),
            reset_counter: 0,
        }
    }

    #[test]
    fn odometry_that_is_not_finite_or_not_newer_is_ignored() {
        let mut motion = Motion::new(CONFIG);
        motion.take(&at(1.0, 0.0), GRAVITY);
        for bad in [
            Odometry { pos_world: Vec3::new(f64::NAN, 0.0, 0.0), ..at(1.1, 0.0) },
            Odometry {
                world_from_body: Rot::new_unchecked(nalgebra::Quaternion::new(0.0, 0.0, 0.0, 0.0)),
                ..at(1.1, 0.0)
            },
            at(0.9, 3.0),
        ] {
            motion.take(&bad, GRAVITY);
            assert_eq!(motion.last(), Some(&at(1.0, 0.0)));
        }
        assert!(motion.fresh(Time::from_secs(1.15), 0.2).is_some());
        assert!(motion.fresh(Time::from_secs(1.25), 0.2).is_none());
    }

    #[test]
    fn jumps_are_noticed_announced_or_not_and_flight_is_none() {
        let mut motion = Motion::new(CONFIG);
        assert_eq!(motion.take(&at(1.0, 0.0), GRAVITY), None);
        assert_eq!(motion.take(&at(1.02, 0.1), GRAVITY), None);
        let jump = motion.take(&at(1.04, 4.2), GRAVITY).unwrap();
        assert!((jump.pos_world - Vec3::new(4.0, 0.0, 0.0)).norm() < 1e-9);
        let turned =
            Odometry { reset_counter: 1, world_from_body: Rot::from_axis_angle(&Vec3::z_axis(), 0.3), ..at(1.06, 4.3) };
        let jump = motion.take(&turned, GRAVITY).unwrap();
        assert!(jump.pos_world.norm() < 1e-9 && (jump.yaw - 0.3).abs() < 1e-9);
    }

    #[test]
    fn a_jump_is_no_disturbance() {
        let mut motion = Motion::new(CONFIG);
        for k in 0..100 {
            let t = 0.02 * f64::from(k);
            let jumped = if k < 50 { 0.0 } else { 7.0 };
            let odometry = Odometry {
                vel_world: Vec3::new(5.0 + jumped, 0.0, 0.0),
                reset_counter: u32::from(k >= 50),
                ..at(t, (5.0 + jumped) * t)
            };
            motion.take(&odometry, GRAVITY);
            assert!(motion.observer().disturbance().norm() < 1e-9);
        }
    }
}
