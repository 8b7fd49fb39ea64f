//! The last second of the vehicle's motion and commanded acceleration, looked up at a frame's capture stamp.
//!
//! The network plans from the state at the moment the image was exposed (§III-D), which lies in the past.

use crate::values::jump::jump;
use crate::values::types::{Odometry, Time, Vec3};

/// Samples kept: more than a second of odometry at 200 Hz.
const CAPACITY: usize = 512;

/// How far past its newest sample the history extrapolates, s. Chosen by eye; odometry that is later than this gives no
/// plan.
const EXTRAPOLATION_MAX: f64 = 0.1;

/// Fixed-size ring of odometry samples and of commanded accelerations. Samples are pushed in stamp order; an older or
/// equal stamp is ignored. A jump of the position, announced by `reset_counter` or not, empties the odometry, since
/// interpolating across it invents motion.
#[derive(Clone, Debug)]
pub struct History {
    odometry: Ring<Odometry>,
    acceleration: Ring<Vec3>,
}

impl Default for History {
    fn default() -> Self {
        Self::new()
    }
}

impl History {
    /// An empty history; its memory is taken here.
    #[must_use]
    pub fn new() -> Self {
        Self { odometry: Ring::new(), acceleration: Ring::new() }
    }

    /// Adds an odometry sample.
    pub fn push_odometry(&mut self, sample: &Odometry) {
        let newest = self.odometry.newest().map(|(_, newest)| newest);
        if newest.is_some_and(|newest| sample.stamp > newest.stamp && jump(&newest, sample).is_some()) {
            self.odometry.clear();
        }
        self.odometry.push(sample.stamp, *sample);
    }

    /// Adds the acceleration that the trajectory was left with at `stamp`, m/s².
    pub fn push_acceleration(&mut self, stamp: Time, acc_world: Vec3) {
        self.acceleration.push(stamp, acc_world);
    }

    /// Odometry at `stamp`: interpolated between its neighbours, or extrapolated at constant velocity and angular
    /// velocity by at most 0.1 s. None before the oldest sample, too far after the newest, or while empty.
    #[must_use]
    pub fn odometry_at(&self, stamp: Time) -> Option<Odometry> {
        let (_, newest) = self.odometry.newest()?;
        let ahead = stamp.since(newest.stamp);
        if ahead >= 0.0 {
            return (ahead <= EXTRAPOLATION_MAX).then(|| Odometry {
                stamp,
                pos_world: newest.pos_world + newest.vel_world * ahead,
                world_from_body: newest.world_from_body
                    * nalgebra::UnitQuaternion::from_scaled_axis(newest.ang_vel_body * ahead),
                ..newest
            });
        }
        let (before, after) = self.odometry.around(stamp)?;
        let span = after.stamp.since(before.stamp);
        let k = stamp.since(before.stamp) / span;
        Some(Odometry {
            stamp,
            pos_world: before.pos_world.lerp(&after.pos_world, k),
            vel_world: before.vel_world.lerp(&after.vel_world, k),
            world_from_body: before
                .world_from_body
                .try_slerp(&after.world_from_body, k, 1e-9)
                .unwrap_or(after.world_from_body),
            ang_vel_body: before.ang_vel_body.lerp(&after.ang_vel_body, k),
            reset_counter: after.reset_counter,
        })
    }

    /// The acceleration added last at or before `stamp`; the oldest one known if all are later; zero while empty.
    #[must_use]
    pub fn acceleration_at(&self, stamp: Time) -> Vec3 {
        self.acceleration.last_before(stamp).unwrap_or_else(Vec3::zeros)
    }
}

#[derive(Clone, Debug)]
struct Ring<T> {
    samples: Vec<(Time, T)>,
    next: usize,
}

impl<T: Copy> Ring<T> {
    fn new() -> Self {
        Self { samples: Vec::with_capacity(CAPACITY), next: 0 }
    }

    fn clear(&mut self) {
        self.samples.clear();
        self.next = 0;
    }

    fn newest(&self) -> Option<(Time, T)> {
        self.samples.get(self.index_back(0)?).copied()
    }

    // The index of the k-th newest sample.
    fn index_back(&self, k: usize) -> Option<usize> {
        let len = self.samples.len();
        (k < len).then(|| (self.next + 2 * CAPACITY - 1 - k) % CAPACITY)
    }

    fn push(&mut self, stamp: Time, value: T) {
        if self.newest().is_some_and(|(newest, _)| stamp <= newest) {
            return;
        }
        if self.samples.len() < CAPACITY {
            self.samples.push((stamp, value));
        } else {
            self.samples[self.next] = (stamp, value);
        }
        self.next = (self.next + 1) % CAPACITY;
    }

    fn newest_first(&self) -> impl Iterator<Item = (Time, T)> + '_ {
        (0..self.samples.len()).filter_map(|k| self.index_back(k)).filter_map(|i| self.samples.get(i).copied())
    }

    fn around(&self, stamp: Time) -> Option<(T, T)> {
        let mut after = None;
        for (at, value) in self.newest_first() {
            if at <= stamp {
                return after.map(|after| (value, after));
            }
            after = Some(value);
        }
        None
    }

    fn last_before(&self, stamp: Time) -> Option<T> {
        let mut oldest = None;
        for (at, value) in self.newest_first() {
            if at <= stamp {
                return Some(value);
            }
            oldest = Some(value);
        }
        oldest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::values::types::Rot;

    fn sample(t: f64) -> Odometry {
        Odometry {
            stamp: Time::from_secs(t),
            pos_world: Vec3::new(t, 2.0 * t, 0.0),
            vel_world: Vec3::new(1.0, 2.0, 0.0),
            world_from_body: Rot::from_euler_angles(0.0, 0.0, t),
            ang_vel_body: Vec3::new(0.0, 0.0, 1.0),
            reset_counter: 0,
        }
    }

    fn filled(samples: usize) -> History {
        let mut history = History::new();
        for k in 0..samples {
            history.push_odometry(&sample(10.0 + k as f64 * 0.01));
        }
        history
    }

    #[test]
    fn motion_at_a_past_stamp_is_interpolated() {
        for samples in [2, 100, 511, 512, 513, 1300] {
            let history = filled(samples);
            let t = 10.0 + (samples - 1) as f64 * 0.01 - 0.0034;
            let got = history.odometry_at(Time::from_secs(t)).unwrap();
            assert!((got.pos_world - Vec3::new(t, 2.0 * t, 0.0)).norm() < 1e-6);
            assert!(got.world_from_body.angle_to(&Rot::from_euler_angles(0.0, 0.0, t)) < 1e-6);
        }
    }

    #[test]
    fn motion_just_ahead_is_extrapolated_and_far_ahead_is_unknown() {
        let history = filled(10);
        let got = history.odometry_at(Time::from_secs(10.15)).unwrap();
        assert!((got.pos_world - Vec3::new(10.15, 20.30, 0.0)).norm() < 1e-6);
        assert!(history.odometry_at(Time::from_secs(10.3)).is_none());
        assert!(history.odometry_at(Time::from_secs(9.9)).is_none());
        assert!(History::new().odometry_at(Time::from_secs(1.0)).is_none());
    }

    #[test]
    fn a_jump_of_the_estimate_empties_the_history() {
        let mut history = filled(10);
        history.push_odometry(&Odometry { reset_counter: 1, ..sample(10.2) });
        assert!(history.odometry_at(Time::from_secs(10.05)).is_none());
        assert!(history.odometry_at(Time::from_secs(10.2)).is_some());
    }

    #[test]
    fn a_sample_out_of_order_is_ignored() {
        let mut history = filled(10);
        let newest = history.odometry_at(Time::from_secs(10.09));
        history.push_odometry(&sample(9.0));
        assert_eq!(history.odometry_at(Time::from_secs(10.09)), newest);
    }

    #[test]
    fn the_acceleration_is_the_last_commanded_before_the_stamp() {
        let mut history = History::new();
        assert_eq!(history.acceleration_at(Time(5)), Vec3::zeros());
        history.push_acceleration(Time(10), Vec3::x());
        history.push_acceleration(Time(20), Vec3::y());
        assert_eq!(history.acceleration_at(Time(15)), Vec3::x());
        assert_eq!(history.acceleration_at(Time(25)), Vec3::y());
        assert_eq!(history.acceleration_at(Time(1)), Vec3::x());
    }
}
