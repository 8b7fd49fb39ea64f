//! The autopilot's motion messages to ENU and FLU, validated: what leaves here is finite.

use crate::frames::{enu_from_ned, flu_from_frd, world_from_body};
use crate::messages::{ATTITUDE_QUATERNION_DATA, HIGHRES_IMU_DATA, LOCAL_POSITION_NED_DATA, MavFrame, ODOMETRY_DATA};
use goshawk_core::{Imu, Odometry, Rot, Time, Vec3};
use nalgebra::Quaternion;

/// How far from 1 a quaternion's norm may be; single precision and rounding stay far below.
const NORM_TOLERANCE: f64 = 0.01;

/// Why a motion message was not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unusable {
    /// A value is not finite, or the quaternion is not a rotation.
    NotFinite,
    /// Frames that cannot be converted without more knowledge.
    Frame,
}

/// ODOMETRY, whatever frames its fields name. Its rates are always FRD.
pub(crate) fn odometry(message: &ODOMETRY_DATA, stamp: Time) -> Result<Odometry, Unusable> {
    if message.frame_id != MavFrame::MAV_FRAME_LOCAL_NED {
        return Err(Unusable::Frame);
    }
    let world_from_body = attitude(message.q)?;
    let velocity = vector([message.vx, message.vy, message.vz])?;
    #[allow(deprecated)]
    // MAV_FRAME_BODY_NED: the name of BODY_FRD that older autopilots still send
    let vel_world = match message.child_frame_id {
        MavFrame::MAV_FRAME_LOCAL_NED => enu_from_ned(velocity),
        MavFrame::MAV_FRAME_BODY_FRD | MavFrame::MAV_FRAME_BODY_NED => world_from_body * flu_from_frd(velocity),
        _ => return Err(Unusable::Frame),
    };
    Ok(Odometry {
        stamp,
        pos_world: enu_from_ned(vector([message.x, message.y, message.z])?),
        vel_world,
        world_from_body,
        ang_vel_body: flu_from_frd(vector([message.rollspeed, message.pitchspeed, message.yawspeed])?),
        reset_counter: u32::from(message.reset_counter),
    })
}

/// Position and velocity of LOCAL_POSITION_NED, world frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Position {
    pub(crate) stamp: Time,
    pub(crate) pos_world: Vec3,
    pub(crate) vel_world: Vec3,
}

pub(crate) fn position(message: &LOCAL_POSITION_NED_DATA, stamp: Time) -> Result<Position, Unusable> {
    Ok(Position {
        stamp,
        pos_world: enu_from_ned(vector([message.x, message.y, message.z])?),
        vel_world: enu_from_ned(vector([message.vx, message.vy, message.vz])?),
    })
}

/// ATTITUDE_QUATERNION at `stamp` with the newest position carried to it at constant velocity.
pub(crate) fn combined(
    message: &ATTITUDE_QUATERNION_DATA,
    position: &Position,
    stamp: Time,
    reset_counter: u32,
) -> Result<Odometry, Unusable> {
    Ok(Odometry {
        stamp,
        pos_world: position.pos_world + position.vel_world * stamp.since(position.stamp),
        vel_world: position.vel_world,
        world_from_body: attitude([message.q1, message.q2, message.q3, message.q4])?,
        ang_vel_body: flu_from_frd(vector([message.rollspeed, message.pitchspeed, message.yawspeed])?),
        reset_counter,
    })
}

/// HIGHRES_IMU's accelerometer and gyroscope.
pub(crate) fn imu(message: &HIGHRES_IMU_DATA, stamp: Time) -> Result<Imu, Unusable> {
    Ok(Imu {
        stamp,
        specific_force_body: flu_from_frd(vector([message.xacc, message.yacc, message.zacc])?),
        ang_vel_body: flu_from_frd(vector([message.xgyro, message.ygyro, message.zgyro])?),
    })
}

fn vector(values: [f32; 3]) -> Result<Vec3, Unusable> {
    let vector = Vec3::from(values.map(f64::from));
    if vector.iter().all(|value| value.is_finite()) { Ok(vector) } else { Err(Unusable::NotFinite) }
}

fn attitude(wxyz: [f32; 4]) -> Result<Rot, Unusable> {
    let [w, x, y, z] = wxyz.map(f64::from);
    let q = Quaternion::new(w, x, y, z);
    // A NaN fails this comparison too.
    if (q.norm() - 1.0).abs() < NORM_TOLERANCE {
        Ok(world_from_body(&Rot::new_normalize(q)))
    } else {
        Err(Unusable::NotFinite)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Facing east, 10 m north, 20 m east, 30 m up; flying north at 3 m/s, climbing at 1 m/s, turning left.
    fn facing_east(child: MavFrame, velocity: [f32; 3]) -> ODOMETRY_DATA {
        let s = std::f32::consts::FRAC_1_SQRT_2;
        ODOMETRY_DATA {
            frame_id: MavFrame::MAV_FRAME_LOCAL_NED,
            child_frame_id: child,
            x: 10.0,
            y: 20.0,
            z: -30.0,
            q: [s, 0.0, 0.0, s],
            vx: velocity[0],
            vy: velocity[1],
            vz: velocity[2],
            rollspeed: 0.1,
            pitchspeed: 0.2,
            yawspeed: -0.3,
            reset_counter: 15,
            ..ODOMETRY_DATA::default()
        }
    }

    #[test]
    fn the_velocity_is_read_in_the_frame_that_the_message_names() {
        let in_ned = facing_east(MavFrame::MAV_FRAME_LOCAL_NED, [3.0, 0.0, -1.0]);
        // North is to the left of a body that faces east.
        let in_body = facing_east(MavFrame::MAV_FRAME_BODY_FRD, [0.0, -3.0, -1.0]);
        for message in [in_ned, in_body] {
            let odometry = odometry(&message, Time(7)).unwrap();
            assert!((odometry.vel_world - Vec3::new(0.0, 3.0, 1.0)).norm() < 1e-6, "{odometry:?}");
            assert!((odometry.pos_world - Vec3::new(20.0, 10.0, 30.0)).norm() < 1e-6);
            assert!((odometry.ang_vel_body - Vec3::new(0.1, -0.2, 0.3)).norm() < 1e-6);
            assert!(odometry.world_from_body.angle() < 1e-6, "facing east is ENU's zero yaw");
            assert_eq!((odometry.reset_counter, odometry.stamp), (15, Time(7)));
        }
    }

    #[test]
    fn frames_that_cannot_be_converted_are_refused() {
        let mut message = facing_east(MavFrame::MAV_FRAME_LOCAL_FRD, [0.0; 3]);
        assert_eq!(odometry(&message, Time(0)), Err(Unusable::Frame));
        message = facing_east(MavFrame::MAV_FRAME_LOCAL_NED, [0.0; 3]);
        message.frame_id = MavFrame::MAV_FRAME_LOCAL_FRD;
        assert_eq!(odometry(&message, Time(0)), Err(Unusable::Frame));
    }

    #[test]
    fn what_is_not_finite_is_refused() {
        let good = facing_east(MavFrame::MAV_FRAME_LOCAL_NED, [0.0; 3]);
        let bad = [
            ODOMETRY_DATA { x: f32::NAN, ..good.clone() },
            ODOMETRY_DATA { vz: f32::INFINITY, ..good.clone() },
            ODOMETRY_DATA { q: [0.0; 4], ..good.clone() },
            ODOMETRY_DATA { q: [f32::NAN, 0.0, 0.0, 1.0], ..good.clone() },
            ODOMETRY_DATA { yawspeed: f32::NAN, ..good },
        ];
        for message in bad {
            assert_eq!(odometry(&message, Time(0)), Err(Unusable::NotFinite));
        }
    }

    #[test]
    fn the_position_is_carried_to_the_attitude_it_is_joined_with() {
        let at = LOCAL_POSITION_NED_DATA { x: 1.0, vx: 2.0, vz: -4.0, ..LOCAL_POSITION_NED_DATA::default() };
        let position = position(&at, Time::from_secs(1.0)).unwrap();
        let level = ATTITUDE_QUATERNION_DATA { q1: 1.0, ..ATTITUDE_QUATERNION_DATA::default() };
        let odometry = combined(&level, &position, Time::from_secs(1.5), 3).unwrap();
        assert!((odometry.pos_world - Vec3::new(0.0, 2.0, 2.0)).norm() < 1e-9);
        assert_eq!(odometry.stamp, Time::from_secs(1.5));
    }

    #[test]
    fn at_rest_the_accelerometer_points_up() {
        let rest = HIGHRES_IMU_DATA { zacc: -9.8, ..HIGHRES_IMU_DATA::default() };
        assert!(imu(&rest, Time(0)).unwrap().specific_force_body.z > 9.0);
    }
}
