//! An estimate of ours, for the autopilot's own estimator: so that it holds its place too, with no GPS, when we end.

use crate::dialogue::firmware::Firmware;
use crate::frames::{frd_from_flu, ned_from_enu, ned_from_frd};
use crate::messages::{MavEstimatorType, MavFrame, MavMessage, ODOMETRY_DATA, VISION_POSITION_ESTIMATE_DATA};
use goshawk_core::{Odometry, Rot, Vec3};

/// The message that carries it. Both firmwares take both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VisionMessage {
    /// ODOMETRY: pose, velocity, rates.
    Odometry,
    /// VISION_POSITION_ESTIMATE: the pose alone.
    PositionEstimate,
}

/// The message of an estimate. Its stamp is of our clock, as TIMESYNC tells it; its covariance is not known.
#[must_use]
pub fn vision_message(message: VisionMessage, firmware: Firmware, estimate: &Odometry) -> MavMessage {
    let usec = estimate.stamp.0 / 1000;
    let [x, y, z] = single(ned_from_enu(estimate.pos_world));
    let attitude = ned_from_frd(&estimate.world_from_body);
    let reset_counter = (estimate.reset_counter % 256) as u8; // one byte on the wire: that it changed is what counts
    match message {
        VisionMessage::Odometry => {
            let [vx, vy, vz] = single(frd_from_flu(estimate.world_from_body.inverse() * estimate.vel_world));
            let [rollspeed, pitchspeed, yawspeed] = single(frd_from_flu(estimate.ang_vel_body));
            MavMessage::ODOMETRY(ODOMETRY_DATA {
                time_usec: usec,
                x,
                y,
                z,
                q: quaternion(&attitude),
                vx,
                vy,
                vz,
                rollspeed,
                pitchspeed,
                yawspeed,
                pose_covariance: [f32::NAN; 21],
                velocity_covariance: [f32::NAN; 21],
                frame_id: match firmware {
                    Firmware::Px4 => MavFrame::MAV_FRAME_LOCAL_NED,
                    // The same axes: it takes no other name, and drops the message without a word.
                    Firmware::ArduPilot(_) => MavFrame::MAV_FRAME_LOCAL_FRD,
                },
                child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
                reset_counter,
                estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_VIO,
                quality: 0, // not known
            })
        }
        VisionMessage::PositionEstimate => {
            let (roll, pitch, yaw) = attitude.euler_angles();
            MavMessage::VISION_POSITION_ESTIMATE(VISION_POSITION_ESTIMATE_DATA {
                usec,
                x,
                y,
                z,
                roll: roll as f32,
                pitch: pitch as f32,
                yaw: yaw as f32,
                covariance: [f32::NAN; 21],
                reset_counter,
            })
        }
    }
}

fn single(v: Vec3) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

fn quaternion(q: &Rot) -> [f32; 4] {
    [q.w as f32, q.i as f32, q.j as f32, q.k as f32]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialogue::firmware::Guided;
    use goshawk_core::Time;
    use std::f32::consts::FRAC_PI_2;

    /// East 1, north 2, up 3, its nose to the east, moving forward and to its left, turning left.
    fn estimate() -> Odometry {
        Odometry {
            stamp: Time(5_000_000),
            pos_world: Vec3::new(1.0, 2.0, 3.0),
            vel_world: Vec3::new(4.0, 5.0, 6.0),
            world_from_body: Rot::identity(),
            ang_vel_body: Vec3::new(0.1, 0.2, 0.3),
            reset_counter: 257,
        }
    }

    #[test]
    fn odometry_goes_out_north_east_down_and_its_velocity_in_the_body() {
        let sent = vision_message(VisionMessage::Odometry, Firmware::Px4, &estimate());
        let MavMessage::ODOMETRY(m) = sent else { unreachable!() };
        assert_eq!((m.time_usec, m.reset_counter), (5000, 1));
        assert_eq!([m.x, m.y, m.z], [2.0, 1.0, -3.0]);
        assert_eq!([m.vx, m.vy, m.vz], [4.0, -5.0, -6.0]);
        assert_eq!([m.rollspeed, m.pitchspeed, m.yawspeed], [0.1, -0.2, -0.3]);
        let half = 0.5_f32.sqrt();
        assert!(m.q.iter().zip([half, 0.0, 0.0, half]).all(|(got, wanted)| (got - wanted).abs() < 1e-6), "{:?}", m.q);
        assert_eq!((m.frame_id, m.child_frame_id), (MavFrame::MAV_FRAME_LOCAL_NED, MavFrame::MAV_FRAME_BODY_FRD));
        assert!(m.pose_covariance[0].is_nan() && m.velocity_covariance[0].is_nan(), "that is: not known");
    }

    #[test]
    fn ardupilot_gets_the_same_numbers_under_the_one_frame_that_it_takes() {
        let copter = Firmware::ArduPilot(Guided::NoGps);
        let [ours, theirs] = [Firmware::Px4, copter].map(|firmware| {
            let sent = vision_message(VisionMessage::Odometry, firmware, &estimate());
            let MavMessage::ODOMETRY(m) = sent else { unreachable!() };
            m
        });
        assert_eq!((theirs.frame_id, theirs.child_frame_id), (MavFrame::MAV_FRAME_LOCAL_FRD, ours.child_frame_id));
        assert_eq!(([theirs.x, theirs.y, theirs.z], theirs.q), ([ours.x, ours.y, ours.z], ours.q));
        assert_eq!([theirs.vx, theirs.vy, theirs.vz], [ours.vx, ours.vy, ours.vz]);
    }

    #[test]
    fn a_position_estimate_is_the_pose_alone() {
        let sent = vision_message(VisionMessage::PositionEstimate, Firmware::Px4, &estimate());
        let MavMessage::VISION_POSITION_ESTIMATE(m) = sent else { unreachable!() };
        assert_eq!((m.usec, m.reset_counter, [m.x, m.y, m.z]), (5000, 1, [2.0, 1.0, -3.0]));
        assert!(m.roll.abs() + m.pitch.abs() + (m.yaw - FRAC_PI_2).abs() < 1e-6, "east is a quarter turn from north");
    }
}
