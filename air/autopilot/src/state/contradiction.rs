//! ODOMETRY against LOCAL_POSITION_NED: two tellings of one motion, which must agree.
//!
//! Only changes of the positions are compared, for the frames may have different origins; the velocities as they are,
//! for both frames are north, east and down. Rates and stamps may differ: the local position is carried to ODOMETRY's
//! stamp by its velocity. If either is absent, nothing is said.
//!
//! ```text
//! position   e' = -e/τ + (ṗ_odometry - ṗ_local)     less what one of them jumped
//! velocity   e' = (v_odometry - v_local - e)/τ
//! ```

use crate::state::pose::Position;
use goshawk_core::{Odometry, Time, Vec3};

/// A local position farther from ODOMETRY's stamp than this is not compared with it, s: it comes at 10 Hz or more.
const NEAR_S: f64 = 0.12;
/// Comparisons farther apart do not belong together, s. Chosen by eye.
const LONGEST_GAP_S: f64 = 0.5;
/// Time constant of the position's check, s. Chosen by eye.
const POSITION_TIME_S: f64 = 3.0;
/// And its gate, m: a drift of a quarter of a metre a second is found in the end. Chosen by eye.
const POSITION_GATE_M: f64 = 0.75;
/// Time constant of the velocity's check, s. Chosen by eye.
const VELOCITY_TIME_S: f64 = 0.5;
/// And its gate, m/s. Chosen by eye.
const VELOCITY_GATE_MPS: f64 = 1.0;
/// More than this at once is a jump of one of them, m: it moves a frame and no more. Chosen by eye.
const JUMP_M: f64 = 0.3;
/// The stamps may be wrong by so much against each other, s: so far apart are both at 1 m/s. Chosen by eye.
const STAMPS_S: f64 = 0.05;
/// They must contradict each other for so long, s. Chosen by eye.
const LASTS_S: f64 = 0.2;
/// And agree for so long before they are believed again, s. Chosen by eye.
const AGAIN_S: f64 = 1.0;
/// A contradiction that was found longer ago is none, s: they come no more. Chosen by eye.
const FRESH_S: f64 = 1.0;

/// One comparison.
#[derive(Clone, Copy, Debug)]
struct Compared {
    stamp: Time,
    reset_counter: u32,
    /// ODOMETRY's less the local position, m.
    difference_world: Vec3,
}

/// What the two say of each other.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Contradiction {
    local: Option<Position>,
    last: Option<Compared>,
    position_world: Vec3,
    velocity_world: Vec3,
    /// When they were last compared, by arrival.
    compared: Option<Time>,
    contradicts: bool,
    /// The contrary has been found since then.
    contrary: Option<Time>,
}

impl Contradiction {
    /// Takes a local position.
    pub(crate) fn local(&mut self, position: Position) {
        self.local = Some(position);
    }

    /// Takes an ODOMETRY that arrived `now`.
    pub(crate) fn odometry(&mut self, now: Time, odometry: &Odometry) {
        let near = |local: &Position| odometry.stamp.since(local.stamp).abs() <= NEAR_S;
        let Some(local) = self.local.filter(near) else { return };
        let apart_s = odometry.stamp.since(local.stamp);
        let difference_world = odometry.pos_world - (local.pos_world + local.vel_world * apart_s);
        let new = Compared { stamp: odometry.stamp, reset_counter: odometry.reset_counter, difference_world };
        let dt = self.last.map_or(0.0, |last| new.stamp.since(last.stamp));
        if dt <= 0.0 && dt > -LONGEST_GAP_S && self.last.is_some() {
            return; // it came late
        }
        let doubt_m = STAMPS_S * odometry.vel_world.norm().min(local.vel_world.norm());
        let last = self.last.replace(new).filter(|_| dt.abs() <= LONGEST_GAP_S);
        let Some(last) = last else {
            (self.position_world, self.velocity_world) = (Vec3::zeros(), Vec3::zeros());
            return;
        };
        let moved_world = new.difference_world - last.difference_world;
        let jumped = new.reset_counter != last.reset_counter || moved_world.norm() > JUMP_M + doubt_m;
        self.position_world *= (-dt / POSITION_TIME_S).exp();
        if !jumped {
            self.position_world += moved_world;
        }
        let share = 1.0 - (-dt / VELOCITY_TIME_S).exp();
        self.velocity_world += (odometry.vel_world - local.vel_world - self.velocity_world) * share;
        let apart = self.position_world.norm() > POSITION_GATE_M + doubt_m;
        self.says(now, apart || self.velocity_world.norm() > VELOCITY_GATE_MPS);
    }

    /// They contradict each other at `now`, and have for a while.
    pub(crate) fn is_there(&self, now: Time) -> bool {
        self.contradicts && self.compared.is_some_and(|compared| now.since(compared) <= FRESH_S)
    }

    fn says(&mut self, now: Time, contradicts: bool) {
        self.compared = Some(now);
        if contradicts == self.contradicts {
            self.contrary = None;
            return;
        }
        let since = *self.contrary.get_or_insert(now);
        if now.since(since) >= if contradicts { LASTS_S } else { AGAIN_S } {
            (self.contradicts, self.contrary) = (contradicts, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use goshawk_core::Rot;
    use proptest::prelude::*;

    /// A weave at 5 m/s and more: position and velocity at `t`.
    fn motion(t: f64) -> (Vec3, Vec3) {
        let pos = Vec3::new(5.0 * t, 3.0 * (1.5 * t).sin(), 2.0 + 0.5 * t.cos());
        (pos, Vec3::new(5.0, 4.5 * (1.5 * t).cos(), -0.5 * t.sin()))
    }

    fn odometry(t: f64) -> Odometry {
        let (pos_world, vel_world) = motion(t);
        Odometry {
            stamp: Time::from_secs(t),
            pos_world,
            vel_world,
            world_from_body: Rot::identity(),
            ang_vel_body: Vec3::zeros(),
            reset_counter: 0,
        }
    }

    fn local(t: f64) -> Position {
        let (pos_world, vel_world) = motion(t);
        Position { stamp: Time::from_secs(t), pos_world: pos_world + Vec3::new(40.0, -7.0, 3.0), vel_world }
    }

    /// 100 Hz of ODOMETRY beside a local position at `hz`, from 10 s to 20 s; from 13 s on changed by `change`. When the
    /// contradiction was first there, and whether it is at the end.
    fn hear(hz: f64, mut change: impl FnMut(f64, Odometry) -> Odometry) -> (Option<f64>, bool) {
        let (mut contradiction, mut first, mut told) = (Contradiction::default(), None, 0.0);
        for k in 1000..2000 {
            let t = 0.01 * f64::from(k);
            if t - told >= 1.0 / hz - 1e-9 {
                contradiction.local(local(t - 0.004));
                told = t;
            }
            let now = Time::from_secs(t + 0.005);
            contradiction.odometry(now, &if t < 13.0 { odometry(t) } else { change(t, odometry(t)) });
            first = first.or(contradiction.is_there(now).then_some(t - 13.0));
        }
        (first, contradiction.is_there(Time::from_secs(20.0)))
    }

    #[test]
    fn one_motion_in_two_frames_and_at_two_rates_is_no_contradiction() {
        for hz in [10.0, 30.0, 50.0, 100.0] {
            assert_eq!(hear(hz, |_, odometry| odometry), (None, false), "{hz}");
        }
    }

    #[test]
    fn a_velocity_3_mps_off_contradicts_within_half_a_second_and_a_drift_of_1_mps_within_two() {
        for hz in [10.0, 30.0] {
            let faster = |_, o: Odometry| Odometry { vel_world: o.vel_world + Vec3::y() * 3.0, ..o };
            let (first, lasts) = hear(hz, faster);
            assert!(first.is_some_and(|after| after < 0.6) && lasts, "{first:?}");
            let drifting = |t: f64, o: Odometry| Odometry { pos_world: o.pos_world + Vec3::x() * (t - 13.0), ..o };
            let (first, lasts) = hear(hz, drifting);
            assert!(first.is_some_and(|after| after < 2.0) && lasts, "{first:?}");
        }
    }

    #[test]
    fn a_jump_of_one_of_them_announced_or_not_moves_a_frame_and_no_more() {
        for reset_counter in [0, 1] {
            let jumped =
                |_, o: Odometry| Odometry { pos_world: o.pos_world + Vec3::new(3.0, 4.0, 1.0), reset_counter, ..o };
            assert_eq!(hear(30.0, jumped), (None, false));
        }
    }

    #[test]
    fn a_contradiction_that_ends_is_believed_for_a_second_more() {
        let wrong = |t: f64, o: Odometry| {
            let by = if t < 14.0 { 3.0 } else { 0.0 };
            Odometry { vel_world: o.vel_world + Vec3::x() * by, ..o }
        };
        let (first, lasts) = hear(30.0, wrong);
        assert!(first.is_some() && !lasts);
    }

    #[test]
    fn without_a_local_position_or_with_an_old_one_nothing_is_said() {
        let mut contradiction = Contradiction::default();
        for k in 0..500 {
            let t = 10.0 + 0.01 * f64::from(k);
            let wrong = Odometry { vel_world: Vec3::x() * 40.0, ..odometry(t) };
            contradiction.odometry(Time::from_secs(t), &wrong);
            assert!(!contradiction.is_there(Time::from_secs(t)));
            if k == 0 {
                contradiction.local(local(t));
            }
        }
    }

    proptest! {
        #[test]
        fn whatever_comes_nothing_breaks(
            told in prop::collection::vec((any::<u64>(), prop::array::uniform3(any::<f32>()), any::<bool>()), 0..60)
        ) {
            let mut contradiction = Contradiction::default();
            for (stamp, numbers, is_local) in told {
                let vector = Vec3::from(numbers.map(|x| if x.is_finite() { f64::from(x) } else { 0.0 }));
                let stamp = Time(stamp % 3_000_000_000);
                if is_local {
                    contradiction.local(Position { stamp, pos_world: vector, vel_world: vector });
                } else {
                    let motion = Odometry { stamp, pos_world: vector, vel_world: -vector, ..odometry(1.0) };
                    contradiction.odometry(stamp, &motion);
                }
                prop_assert!(contradiction.velocity_world.iter().all(|x| x.is_finite()));
                contradiction.is_there(stamp);
            }
        }
    }
}
