//! Odometry of a visual estimator, of its camera or IMU in its own frame, into that of the vehicle's body in the world.

use goshawk_proto::v1;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

use crate::config::{Odometry as Setup, Rates, Velocity};
use crate::wire::messages::{self, Twist};

/// Differences over a longer time are no velocity, s.
const MOST_STEP_S: f64 = 0.2;
/// Nor are those over a shorter one, s: two stamps of the same pose.
const LEAST_STEP_S: f64 = 0.001;
/// A pose may be this far from where the motion before leads to, by the noise of positions, m. What is farther off is a
/// jump of the estimator: it closed a loop, or begins anew. Chosen by eye.
const JUMP_M: f64 = 0.1;
/// And this far by an acceleration, m/s²: no vehicle has more. Chosen by eye.
const JUMP_ACC: f64 = 50.0;
/// After such a pause the estimator may have begun anew, in another frame, s.
const PAUSE_S: f64 = 1.0;
/// A quaternion's length may be off by this.
const NOT_UNIT: f64 = 0.01;
/// A position beyond belief, m.
const MOST_AWAY_M: f64 = 1e5;
/// A velocity and a rate of turn beyond belief, m/s and rad/s.
const MOST_SPEED: f64 = 100.0;

/// Why a sample is not passed on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MotionError {
    /// NaN, infinite, or beyond belief.
    #[error("its {0} cannot be")]
    Implausible(&'static str),
    /// As old as the one before, or older.
    #[error("its stamp is not later than that of the one before")]
    Order,
}

#[derive(Clone, Copy)]
struct Last {
    stamp: u64,
    odom_from_child: Isometry3<f64>,
    /// The difference that led here, in the odometry's frame; none: it is the first since a jump or a pause.
    vel_odom: Option<Vector3<f64>>,
}

/// What is kept from sample to sample.
pub struct Motion {
    child_from_body: Isometry3<f64>,
    world_from_odom: UnitQuaternion<f64>,
    velocity: Velocity,
    rates: Rates,
    last: Option<Last>,
    seq: u64,
    resets: u32,
}

impl Motion {
    /// As the file has it.
    #[must_use]
    pub fn new(setup: &Setup) -> Self {
        Motion {
            child_from_body: setup.body_from_child().inverse(),
            world_from_odom: setup.world_from_odom(),
            velocity: setup.velocity,
            rates: setup.rates,
            last: None,
            seq: 0,
            resets: 0,
        }
    }

    /// The body's motion at `stamp`, ns; none: the first pose, where velocity or rates are differences.
    ///
    /// # Errors
    /// The sample cannot be.
    pub fn take(
        &mut self,
        stamp: u64,
        pose: &messages::Pose,
        twist: &Twist,
    ) -> Result<Option<v1::Odometry>, MotionError> {
        let odom_from_child = pose_of(pose)?;
        let last = self.last;
        if last.is_some_and(|last| stamp <= last.stamp) {
            return Err(MotionError::Order);
        }
        let step = last.map(|last| (stamp - last.stamp) as f64 * 1e-9);
        if step.is_some_and(|step| step > PAUSE_S) {
            self.resets += 1;
        }
        let mut difference = last.zip(step.filter(|step| (LEAST_STEP_S..=MOST_STEP_S).contains(step)));
        // With a twist the vehicle itself compares positions with velocities.
        let poses = self.velocity == Velocity::Pose;
        if poses && difference.is_some_and(|(last, step)| jumped(&last, &odom_from_child, step)) {
            self.resets += 1;
            difference = None;
        }
        let vel_odom = difference.map(|(last, step)| difference_of(&last, &odom_from_child, step));
        self.last = Some(Last { stamp, odom_from_child, vel_odom });
        let Some((vel_odom, rate_child)) = self.moving(&odom_from_child, twist, difference) else {
            return Ok(None);
        };
        let odom_from_body = odom_from_child * self.child_from_body;
        // The body is elsewhere than the child frame, which turns about itself.
        let arm = odom_from_child.rotation * self.child_from_body.translation.vector;
        let vel = vel_odom + (odom_from_child.rotation * rate_child).cross(&arm);
        let rate_body = self.child_from_body.rotation.inverse() * rate_child;
        within(vel.norm(), MOST_SPEED, "velocity")?;
        within(rate_body.norm(), MOST_SPEED, "rate of turn")?;
        self.seq += 1;
        let q = self.world_from_odom * odom_from_body.rotation;
        Ok(Some(v1::Odometry {
            seq: self.seq,
            stamp_ns: stamp,
            pos_world: Some(vec3(self.world_from_odom * odom_from_body.translation.vector)),
            vel_world: Some(vec3(self.world_from_odom * vel)),
            world_from_body: Some(v1::Quat { w: q.w, x: q.i, y: q.j, z: q.k }),
            ang_vel_body: Some(vec3(rate_body)),
            reset_counter: self.resets,
        }))
    }

    /// The child frame's velocity, in the odometry's frame, and its rates, in its own.
    fn moving(
        &self,
        now: &Isometry3<f64>,
        twist: &Twist,
        difference: Option<(Last, f64)>,
    ) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let (linear, angular) = (vector(&twist.linear), vector(&twist.angular));
        let vel = match self.velocity {
            Velocity::Child => now.rotation * linear,
            Velocity::Odom => linear,
            Velocity::Pose => difference.map(|(last, step)| difference_of(&last, now, step))?,
        };
        let rate = match self.rates {
            Rates::Twist => angular,
            Rates::Pose => difference
                .map(|(last, step)| (last.odom_from_child.rotation.inverse() * now.rotation).scaled_axis() / step)?,
        };
        Some((vel, rate))
    }
}

/// The velocity between two poses, in the odometry's frame.
fn difference_of(last: &Last, now: &Isometry3<f64>, step: f64) -> Vector3<f64> {
    (now.translation.vector - last.odom_from_child.translation.vector) / step
}

/// The pose is not where the motion before leads to.
fn jumped(last: &Last, now: &Isometry3<f64>, step: f64) -> bool {
    last.vel_odom
        .is_some_and(|vel| (difference_of(last, now, step) - vel).norm() * step > JUMP_M + JUMP_ACC * step * step)
}

fn vector(v: &messages::Vector3) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

fn vec3(v: Vector3<f64>) -> v1::Vec3 {
    v1::Vec3 { x: v.x, y: v.y, z: v.z }
}

/// Refuses what is not below `most`: NaN too.
fn within(value: f64, most: f64, what: &'static str) -> Result<(), MotionError> {
    if value < most { Ok(()) } else { Err(MotionError::Implausible(what)) }
}

fn pose_of(pose: &messages::Pose) -> Result<Isometry3<f64>, MotionError> {
    let pos = vector(&pose.position);
    let q = &pose.orientation;
    let q = Quaternion::new(q.w, q.x, q.y, q.z);
    within(pos.norm(), MOST_AWAY_M, "position")?;
    within((q.norm() - 1.0).abs(), NOT_UNIT, "orientation")?;
    Ok(Isometry3::from_parts(Translation3::from(pos), UnitQuaternion::from_quaternion(q)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Kind;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    fn setup() -> Setup {
        Setup {
            topic: "/odometry".to_owned(),
            message: Kind::Odometry,
            velocity: Velocity::Child,
            rates: Rates::Twist,
            yaw_deg: 0.0,
            position_m: [0.0; 3],
            rpy_deg: [0.0; 3],
        }
    }

    fn pose(pos: [f64; 3], q: UnitQuaternion<f64>) -> messages::Pose {
        messages::Pose {
            position: messages::Vector3 { x: pos[0], y: pos[1], z: pos[2] },
            orientation: messages::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w },
        }
    }

    fn yaw(angle: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
    }

    fn twist(linear: [f64; 3], angular: [f64; 3]) -> Twist {
        let v = |[x, y, z]: [f64; 3]| messages::Vector3 { x, y, z };
        Twist { linear: v(linear), angular: v(angular) }
    }

    fn near(got: Option<v1::Vec3>, [x, y, z]: [f64; 3]) -> bool {
        let got = got.unwrap();
        (Vector3::new(got.x, got.y, got.z) - Vector3::new(x, y, z)).norm() < 1e-9
    }

    // Heading north, moving forward and turning left: the field's definition of the message, by hand.
    #[test]
    fn a_twist_is_in_the_child_frame_unless_the_file_says_otherwise() {
        let sample = (pose([1.0, 2.0, 3.0], yaw(FRAC_PI_2)), twist([2.0, 0.0, 0.5], [0.1, 0.0, 0.4]));
        let child = Motion::new(&setup()).take(9, &sample.0, &sample.1).unwrap().unwrap();
        assert!(near(child.pos_world, [1.0, 2.0, 3.0]) && near(child.vel_world, [0.0, 2.0, 0.5]));
        assert!(near(child.ang_vel_body, [0.1, 0.0, 0.4]));
        assert_eq!((child.stamp_ns, child.seq, child.reset_counter), (9, 1, 0));
        let odom = Setup { velocity: Velocity::Odom, ..setup() };
        let odom = Motion::new(&odom).take(9, &sample.0, &sample.1).unwrap().unwrap();
        assert!(near(odom.vel_world, [2.0, 0.0, 0.5]));
    }

    #[test]
    fn the_odometrys_frame_is_turned_into_the_world() {
        let north = Setup { yaw_deg: 90.0, ..setup() };
        let sample = Motion::new(&north)
            .take(9, &pose([1.0, 0.0, 0.0], yaw(0.0)), &twist([2.0, 0.0, 0.0], [0.0, 0.0, 1.0]))
            .unwrap()
            .unwrap();
        assert!(near(sample.pos_world, [0.0, 1.0, 0.0]) && near(sample.vel_world, [0.0, 2.0, 0.0]));
        let q = sample.world_from_body.unwrap();
        assert!((q.w - q.z).abs() < 1e-9 && (q.z - 0.5_f64.sqrt()).abs() < 1e-9);
    }

    // A camera half a metre ahead of the body, looking left, while the body turns left on the spot at 2 rad/s: the camera
    // moves to the body's left, which is its own forward, at 1 m/s.
    #[test]
    fn the_body_is_found_from_a_sensor_that_is_mounted_elsewhere_and_turned() {
        let mounted = Setup { position_m: [0.5, 0.0, 0.0], rpy_deg: [0.0, 0.0, 90.0], ..setup() };
        let sample = Motion::new(&mounted)
            .take(9, &pose([0.5, 0.0, 0.0], yaw(FRAC_PI_2)), &twist([1.0, 0.0, 0.0], [0.0, 0.0, 2.0]))
            .unwrap()
            .unwrap();
        assert!(near(sample.pos_world, [0.0; 3]) && near(sample.vel_world, [0.0; 3]));
        assert!(near(sample.ang_vel_body, [0.0, 0.0, 2.0]));
        assert!((sample.world_from_body.unwrap().w - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_pitched_sensors_rates_are_turned_into_the_body() {
        let mounted = Setup { rpy_deg: [0.0, 90.0, 0.0], ..setup() };
        let q = UnitQuaternion::from_euler_angles(0.0, FRAC_PI_2, 0.0);
        let sample =
            Motion::new(&mounted).take(9, &pose([0.0; 3], q), &twist([0.0; 3], [-3.0, 0.0, 0.0])).unwrap().unwrap();
        assert!(near(sample.ang_vel_body, [0.0, 0.0, 3.0]), "its x axis points down: it turns to the left");
    }

    #[test]
    fn velocity_and_rates_are_differences_of_poses_where_there_is_no_twist() {
        let poses = Setup { message: Kind::Pose, velocity: Velocity::Pose, rates: Rates::Pose, ..setup() };
        let mut motion = Motion::new(&poses);
        let none = Twist::default();
        assert_eq!(motion.take(1_000_000_000, &pose([0.0; 3], yaw(0.0)), &none), Ok(None));
        let sample = motion.take(1_050_000_000, &pose([0.1, 0.0, -0.05], yaw(0.1)), &none).unwrap().unwrap();
        assert!(near(sample.vel_world, [2.0, 0.0, -1.0]) && near(sample.ang_vel_body, [0.0, 0.0, 2.0]));
        assert_eq!(motion.take(1_500_000_000, &pose([0.2, 0.0, 0.0], yaw(0.1)), &none), Ok(None), "too long ago");
    }

    #[test]
    fn a_jump_of_poses_alone_is_a_new_beginning_and_no_velocity() {
        let poses = Setup { message: Kind::Pose, velocity: Velocity::Pose, rates: Rates::Pose, ..setup() };
        let mut motion = Motion::new(&poses);
        let mut take = |ms: u64, x: f64| motion.take(ms * 1_000_000, &pose([x, 0.0, 0.0], yaw(0.0)), &Twist::default());
        assert_eq!(take(1000, 0.0), Ok(None));
        assert!(near(take(1033, 0.1).unwrap().unwrap().vel_world, [0.1 / 0.033, 0.0, 0.0]));
        assert_eq!(take(1066, 0.7), Ok(None), "it closed a loop");
        let after = take(1099, 0.8).unwrap().unwrap();
        assert!(near(after.vel_world, [0.1 / 0.033, 0.0, 0.0]));
        assert_eq!(after.reset_counter, 1);
        let braking = take(1132, 0.85).unwrap().unwrap();
        assert_eq!(braking.reset_counter, 1, "45 m/s² is motion");
    }

    #[test]
    fn a_pause_counts_as_a_new_beginning_and_an_old_stamp_is_refused() {
        let mut motion = Motion::new(&setup());
        let mut take = |stamp| motion.take(stamp, &pose([0.0; 3], yaw(0.0)), &Twist::default());
        assert_eq!(take(5_000_000_000).unwrap().unwrap().reset_counter, 0);
        assert_eq!(take(5_000_000_000), Err(MotionError::Order));
        assert_eq!(take(4_000_000_000), Err(MotionError::Order));
        assert_eq!(take(5_010_000_000).unwrap().unwrap().reset_counter, 0);
        assert_eq!(take(7_000_000_000).unwrap().unwrap().reset_counter, 1);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let (level, still) = (yaw(0.0), Twist::default());
        let mut motion = Motion::new(&setup());
        let bad = |why| Err(MotionError::Implausible(why));
        assert_eq!(motion.take(1, &pose([f64::NAN, 0.0, 0.0], level), &still), bad("position"));
        assert_eq!(motion.take(2, &pose([0.0, 1e9, 0.0], level), &still), bad("position"));
        assert_eq!(motion.take(3, &messages::Pose::default(), &still), bad("orientation"));
        let fast = twist([f64::INFINITY, 0.0, 0.0], [0.0; 3]);
        assert_eq!(motion.take(4, &pose([0.0; 3], level), &fast), bad("velocity"));
        let turning = twist([0.0; 3], [0.0, f64::NAN, 0.0]);
        assert!(motion.take(5, &pose([0.0; 3], level), &turning).is_err());
    }

    proptest! {
        #[test]
        fn what_is_passed_on_is_finite(numbers in proptest::array::uniform(any::<f64>()), stamp in any::<u64>()) {
            let [x, y, z, a, b, c, w, p, q]: [f64; 9] = numbers;
            let pose = messages::Pose {
                position: messages::Vector3 { x, y, z },
                orientation: messages::Quaternion { x: a, y: b, z: c, w },
            };
            let mut motion = Motion::new(&setup());
            if let Ok(Some(sample)) = motion.take(stamp, &pose, &twist([p, q, 0.0], [q, p, 0.0])) {
                for v in [sample.pos_world, sample.vel_world, sample.ang_vel_body] {
                    let v = v.unwrap();
                    prop_assert!((v.x + v.y + v.z).is_finite());
                }
            }
        }
    }
}
