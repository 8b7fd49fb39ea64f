//! ODOMETRY's velocity against the accelerometer: what it changes by must have been felt.
//!
//! ```text
//! e' = -e/τ + (v̇ - R f - g - b)        b' = (v̇ - R f - g - b)/τ_b, within its bounds
//! ```
//!
//! f is HIGHRES_IMU's specific force, which holds thrust, wind and drag alike, so that no model of the vehicle is in it.
//! b is the accelerometer's bias, and a tilt that is a little off. Where either message is missing nothing is said.

use goshawk_core::{GRAVITY, Imu, Odometry, Time, Vec3};

/// Samples farther apart than this are not integrated, s: the slowest that is asked for is 10 Hz.
const LONGEST_STEP_S: f64 = 0.15;
/// Time constant of the check, s. Chosen by eye.
const TIME_S: f64 = 0.5;
/// And its gate, m/s: vibration, late stamps and a hard landing stay below. Chosen by eye.
const GATE_MPS: f64 = 1.5;
/// Time constant of the bias, s. Chosen by eye.
const BIAS_TIME_S: f64 = 5.0;
/// And its bound, m/s². Chosen by eye.
const BIAS_MPS2: f64 = 1.5;
/// Less force than this is no accelerometer that works, or a fall, m/s²; more is an impact. Chosen by eye.
const FELT_MPS2: std::ops::Range<f64> = 1.0..60.0;
/// How long the check must hold before the velocity is believed again, s. It was 3. An offset that stays is for the
/// controller, to which the position contradicts it.
const AGAIN_S: f64 = 1.0;

/// What velocity and accelerometer say of each other.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Inertial {
    odometry: Option<Odometry>,
    imu: Option<Imu>,
    /// ∫ (R f + g) dt since the last ODOMETRY, m/s; none: something of it is missing.
    felt_world: Option<Vec3>,
    error_world: Vec3,
    bias_world: Vec3,
    /// When the check last failed, by arrival.
    failed: Option<Time>,
}

impl Inertial {
    /// Takes an inertial sample.
    pub(crate) fn imu(&mut self, new: Imu) {
        let Some(last) = self.imu.replace(new) else { return };
        let dt = new.stamp.since(last.stamp);
        if dt == 0.0 {
            return;
        }
        let fits = (0.0..=LONGEST_STEP_S).contains(&dt) && FELT_MPS2.contains(&new.specific_force_body.norm());
        let tilt = self.odometry.map(|odometry| odometry.world_from_body);
        self.felt_world = self.felt_world.zip(tilt).filter(|_| fits).map(|(felt, world_from_body)| {
            let force_body = (last.specific_force_body + new.specific_force_body) * 0.5;
            felt + (world_from_body * force_body - Vec3::z() * GRAVITY) * dt
        });
    }

    /// Takes an ODOMETRY that arrived `now`.
    pub(crate) fn odometry(&mut self, now: Time, new: &Odometry) {
        let dt = self.odometry.map_or(0.0, |last| new.stamp.since(last.stamp));
        if dt <= 0.0 && dt > -1.0 && self.odometry.is_some() {
            return; // it came late
        }
        let last = self.odometry.replace(*new);
        let fresh = self.imu.is_some_and(|imu| new.stamp.since(imu.stamp).abs() <= LONGEST_STEP_S);
        let felt = self.felt_world.replace(Vec3::zeros()).filter(|_| fresh);
        let last = last.filter(|last| dt <= LONGEST_STEP_S && last.reset_counter == new.reset_counter);
        let Some((last, felt)) = last.zip(felt) else {
            self.error_world = Vec3::zeros();
            return;
        };
        let unfelt = new.vel_world - last.vel_world - felt - self.bias_world * dt;
        self.error_world = self.error_world * (-dt / TIME_S).exp() + unfelt;
        let bias = self.bias_world + unfelt / BIAS_TIME_S;
        self.bias_world = bias * (BIAS_MPS2 / bias.norm().max(BIAS_MPS2));
        if self.error_world.norm() > GATE_MPS {
            self.failed = Some(now);
        }
    }

    /// The velocity has changed as nothing was felt, and not long before `now`.
    pub(crate) fn contradicts(&self, now: Time) -> bool {
        self.failed.is_some_and(|failed| now.since(failed) < AGAIN_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use goshawk_core::Rot;
    use proptest::prelude::*;

    /// A vehicle that accelerates by `acc_world(t)` for 5 s, seen through `imu` and `odometry`. When it first contradicts.
    fn fly(
        acc_world: impl Fn(f64) -> Vec3,
        imu: impl Fn(f64, Vec3) -> Option<Vec3>,
        odometry: impl Fn(f64, Odometry) -> Odometry,
    ) -> Option<f64> {
        let (mut inertial, mut vel_world, mut pos_world) = (Inertial::default(), Vec3::zeros(), Vec3::zeros());
        let world_from_body = Rot::from_euler_angles(0.2, -0.3, 2.0);
        for k in 0..500_u32 {
            let t = 0.01 * f64::from(k);
            vel_world += acc_world(t) * 0.01;
            pos_world += vel_world * 0.01;
            let force = world_from_body.inverse() * (acc_world(t) + Vec3::z() * GRAVITY);
            let stamp = Time::from_secs(1.0 + t);
            if let Some(specific_force_body) = imu(t, force) {
                inertial.imu(Imu { stamp, specific_force_body, ang_vel_body: Vec3::zeros() });
            }
            let ang_vel_body = Vec3::zeros();
            let told = Odometry { stamp, pos_world, vel_world, world_from_body, ang_vel_body, reset_counter: 0 };
            inertial.odometry(stamp, &odometry(t, told));
            if inertial.contradicts(stamp) {
                return Some(t);
            }
        }
        None
    }

    fn weaving(t: f64) -> Vec3 {
        Vec3::new(6.0 * (2.0 * t).sin(), 5.0 * (3.0 * t).cos(), 2.0 * t.sin())
    }

    #[test]
    fn what_is_felt_with_a_bias_and_vibration_is_no_contradiction() {
        let felt = |t: f64, force: Vec3| {
            let shaken = Vec3::new((977.0 * t).sin(), (1571.0 * t).cos(), (2203.0 * t).sin()) * 6.0;
            Some(force + shaken + Vec3::new(0.5, -0.5, 0.4))
        };
        assert_eq!(fly(weaving, felt, |_, told| told), None);
    }

    #[test]
    fn a_velocity_that_steps_or_runs_away_or_stands_was_not_felt() {
        let felt = |_: f64, force: Vec3| Some(force);
        let changed = |by: fn(f64) -> f64| {
            move |t: f64, o: Odometry| Odometry { vel_world: o.vel_world + Vec3::y() * by((t - 2.0).max(0.0)), ..o }
        };
        let after = |at: Option<f64>| at.unwrap() - 2.0;
        assert!(after(fly(weaving, felt, changed(|t| if t > 0.0 { 3.0 } else { 0.0 }))) < 0.05);
        assert!(after(fly(weaving, felt, changed(|t| 5.0 * t))) < 0.6);
        let stands = |t: f64, o: Odometry| if t < 2.0 { o } else { Odometry { vel_world: Vec3::zeros(), ..o } };
        assert!(after(fly(|_| Vec3::x() * 2.0, felt, stands)) < 0.05);
    }

    #[test]
    fn an_announced_reset_and_an_accelerometer_that_is_dead_or_absent_say_nothing() {
        let jumps = |t: f64, o: Odometry| {
            let jumped = t > 2.0;
            let by = if jumped { 3.0 } else { 0.0 };
            Odometry { vel_world: o.vel_world + Vec3::x() * by, reset_counter: u32::from(jumped), ..o }
        };
        assert_eq!(fly(weaving, |_, force| Some(force), jumps), None);
        let wrong = |t: f64, o: Odometry| if t < 2.0 { o } else { Odometry { vel_world: o.vel_world * 3.0, ..o } };
        assert_eq!(fly(weaving, |_, _| None, wrong), None);
        assert_eq!(fly(weaving, |_, _| Some(Vec3::zeros()), wrong), None);
    }

    proptest! {
        #[test]
        fn whatever_comes_the_sums_are_numbers(
            told in prop::collection::vec((0..3_000_000_000_u64, prop::array::uniform3(-1e30..1e30f64), any::<bool>()), 0..60)
        ) {
            let mut inertial = Inertial::default();
            for (stamp, numbers, is_imu) in told {
                let (stamp, vector) = (Time(stamp), Vec3::from(numbers));
                if is_imu {
                    inertial.imu(Imu { stamp, specific_force_body: vector, ang_vel_body: vector });
                } else {
                    let (world_from_body, ang_vel_body) = (Rot::identity(), vector);
                    let (pos_world, vel_world) = (vector, vector);
                    let told = Odometry { stamp, pos_world, vel_world, world_from_body, ang_vel_body, reset_counter: 0 };
                    inertial.odometry(stamp, &told);
                }
                prop_assert!(inertial.error_world.iter().chain(inertial.bias_world.iter()).all(|x| x.is_finite()));
                inertial.contradicts(stamp);
            }
        }
    }
}
