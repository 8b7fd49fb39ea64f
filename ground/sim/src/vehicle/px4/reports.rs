//! The messages that PX4 streams, made from its state: FLU and ENU go in, FRD and NED go out.

use super::{OdometryFault, VehicleState};
use goshawk_autopilot::Px4Mode;
use goshawk_autopilot::frames::{frd_from_flu, ned_from_enu, ned_from_frd};
use goshawk_autopilot::messages::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, ATTITUDE_TARGET_DATA, AttitudeTargetTypemask, BATTERY_STATUS_DATA,
    CURRENT_MODE_DATA, ESTIMATOR_STATUS_DATA, EXTENDED_SYS_STATE_DATA, EstimatorStatusFlags, HEARTBEAT_DATA,
    HIGHRES_IMU_DATA, HighresImuUpdatedFlags, LOCAL_POSITION_NED_DATA, MavAutopilot, MavEstimatorType, MavFrame,
    MavLandedState, MavMessage, MavModeFlag, MavStandardMode, MavState, MavSysStatusSensor, MavType, ODOMETRY_DATA,
    SYS_STATUS_DATA, TIMESYNC_DATA, VFR_HUD_DATA,
};
use goshawk_core::{AttitudeThrust, Vec3};
use mavlink::MessageData;

/// Voltage of its four-cell pack, empty and full, V.
const EMPTY_V: f64 = 14.0;
const FULL_V: f64 = 16.8;

/// ESTIMATOR_STATUS's flags of a healthy estimate on the ground and in flight, as recorded, and of one without GPS:
/// attitude, vertical velocity, height, and a position that is held constant.
const ESTIMATE_STANDING: u16 = 1023;
const ESTIMATE_FLYING: u16 = 895;
const ESTIMATE_LOST: u16 = 1 | 4 | 32 | 128;
/// How much faster a contradictory ODOMETRY is, m/s.
const CONTRADICTORY_MPS: f32 = 3.0;
/// Variances that its odometry had in the recording, m² and (m/s)².
const POSITION_VARIANCE: [f32; 3] = [0.045, 0.045, 0.09];
const VELOCITY_VARIANCE: [f32; 3] = [0.017, 0.017, 0.014];

/// All that a report may tell.
pub(super) struct Facts<'a> {
    /// Since boot.
    pub(super) boot_ns: u64,
    pub(super) vehicle: &'a VehicleState,
    pub(super) mode: Px4Mode,
    pub(super) intended: Px4Mode,
    pub(super) armed: bool,
    pub(super) landed: bool,
    pub(super) demand: Option<AttitudeThrust>,
    pub(super) fault: Option<OdometryFault>,
    /// The estimator has no horizontal position: `vehicle` is what it makes up.
    pub(super) no_position: bool,
    /// It could arm as it is.
    pub(super) can_arm: bool,
}

impl Facts<'_> {
    /// The message with `id`; none: it is not streamed, or a fault hides it.
    pub(super) fn report(&self, id: u32) -> Option<MavMessage> {
        let hidden = self.fault == Some(OdometryFault::Silent);
        Some(match id {
            HEARTBEAT_DATA::ID => self.heartbeat(),
            CURRENT_MODE_DATA::ID => self.current_mode(),
            EXTENDED_SYS_STATE_DATA::ID => self.extended_state(),
            SYS_STATUS_DATA::ID => self.sys_status(),
            BATTERY_STATUS_DATA::ID => self.battery(),
            TIMESYNC_DATA::ID => {
                MavMessage::TIMESYNC(TIMESYNC_DATA { ts1: self.boot_ns as i64, ..TIMESYNC_DATA::default() })
            }
            HIGHRES_IMU_DATA::ID => self.imu(),
            ATTITUDE_TARGET_DATA::ID => self.attitude_target(),
            VFR_HUD_DATA::ID => self.hud(),
            ESTIMATOR_STATUS_DATA::ID => MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA {
                time_usec: self.boot_ns / 1000,
                flags: EstimatorStatusFlags::from_bits_retain(self.estimator_flags()),
                ..ESTIMATOR_STATUS_DATA::default()
            }),
            ATTITUDE_DATA::ID if !hidden => self.attitude(),
            ATTITUDE_QUATERNION_DATA::ID if !hidden => self.attitude_quaternion(),
            LOCAL_POSITION_NED_DATA::ID if !hidden && !self.no_position => self.local_position(),
            ODOMETRY_DATA::ID if !hidden => self.odometry(),
            _ => return None,
        })
    }

    fn boot_ms(&self) -> u32 {
        (self.boot_ns / 1_000_000) as u32
    }

    fn failsafe(&self) -> bool {
        self.armed && self.mode != self.intended
    }

    fn heartbeat(&self) -> MavMessage {
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
        match self.mode {
            Px4Mode::Hold | Px4Mode::Land | Px4Mode::Takeoff | Px4Mode::Mission | Px4Mode::Return => {
                base_mode |= MavModeFlag::MAV_MODE_FLAG_AUTO_ENABLED
                    | MavModeFlag::MAV_MODE_FLAG_GUIDED_ENABLED
                    | MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED;
            }
            Px4Mode::Offboard => base_mode |= MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED,
            _ => {
                base_mode |=
                    MavModeFlag::MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED;
            }
        }
        if self.armed {
            base_mode |= MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
        }
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: self.mode.custom_mode(),
            mavtype: MavType::MAV_TYPE_QUADROTOR,
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            base_mode,
            system_status: match (self.armed, self.failsafe()) {
                (false, _) => MavState::MAV_STATE_STANDBY,
                (true, false) => MavState::MAV_STATE_ACTIVE,
                (true, true) => MavState::MAV_STATE_CRITICAL,
            },
            mavlink_version: 3,
        })
    }

    fn current_mode(&self) -> MavMessage {
        MavMessage::CURRENT_MODE(CURRENT_MODE_DATA {
            custom_mode: self.mode.custom_mode(),
            intended_custom_mode: self.intended.custom_mode(),
            standard_mode: match self.mode {
                Px4Mode::Position => MavStandardMode::MAV_STANDARD_MODE_POSITION_HOLD,
                Px4Mode::Land => MavStandardMode::MAV_STANDARD_MODE_LAND,
                _ => MavStandardMode::MAV_STANDARD_MODE_NON_STANDARD,
            },
        })
    }

    fn extended_state(&self) -> MavMessage {
        MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
            landed_state: match (self.landed, self.mode) {
                (true, _) => MavLandedState::MAV_LANDED_STATE_ON_GROUND,
                (false, Px4Mode::Land) => MavLandedState::MAV_LANDED_STATE_LANDING,
                (false, _) => MavLandedState::MAV_LANDED_STATE_IN_AIR,
            },
            ..EXTENDED_SYS_STATE_DATA::default()
        })
    }

    fn percent(&self) -> i8 {
        (self.vehicle.battery_fraction.clamp(0.0, 1.0) * 100.0).round() as i8
    }

    fn millivolts(&self) -> u16 {
        ((EMPTY_V + (FULL_V - EMPTY_V) * self.vehicle.battery_fraction.clamp(0.0, 1.0)) * 1000.0).round() as u16
    }

    fn estimator_flags(&self) -> u16 {
        match (self.no_position, self.landed) {
            (false, true) => ESTIMATE_STANDING,
            (false, false) => ESTIMATE_FLYING,
            (true, _) => ESTIMATE_LOST,
        }
    }

    fn sys_status(&self) -> MavMessage {
        let health =
            if self.can_arm { MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK } else { MavSysStatusSensor::empty() };
        MavMessage::SYS_STATUS(SYS_STATUS_DATA {
            onboard_control_sensors_health: health,
            voltage_battery: self.millivolts(),
            current_battery: -1,
            battery_remaining: self.percent(),
            ..SYS_STATUS_DATA::default()
        })
    }

    fn battery(&self) -> MavMessage {
        let mut voltages = [u16::MAX; 10]; // the whole pack in the first, as recorded
        voltages[0] = self.millivolts();
        MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
            voltages,
            current_battery: -1,
            temperature: i16::MAX,
            battery_remaining: self.percent(),
            ..BATTERY_STATUS_DATA::default()
        })
    }

    fn wire_attitude(&self) -> [f32; 4] {
        let q = ned_from_frd(&self.vehicle.world_from_body);
        [q.w as f32, q.i as f32, q.j as f32, q.k as f32]
    }

    fn wire_rates(&self) -> [f32; 3] {
        single(frd_from_flu(self.vehicle.ang_vel_body))
    }

    /// Position and velocity in NED, broken by a fault if there is one.
    fn wire_motion(&self) -> [[f32; 3]; 2] {
        if self.fault == Some(OdometryFault::NotFinite) {
            return [[f32::NAN; 3]; 2];
        }
        [single(ned_from_enu(self.vehicle.pos_world)), single(ned_from_enu(self.vehicle.vel_world))]
    }

    fn imu(&self) -> MavMessage {
        let [xacc, yacc, zacc] = single(frd_from_flu(self.vehicle.imu.force_body));
        let [xgyro, ygyro, zgyro] = single(frd_from_flu(self.vehicle.imu.ang_vel_body));
        MavMessage::HIGHRES_IMU(HIGHRES_IMU_DATA {
            time_usec: self.boot_ns / 1000,
            xacc,
            yacc,
            zacc,
            xgyro,
            ygyro,
            zgyro,
            fields_updated: HighresImuUpdatedFlags::from_bits_retain(63), // accelerometer and gyroscope
            ..HIGHRES_IMU_DATA::default()
        })
    }

    fn attitude_target(&self) -> MavMessage {
        let target = self.demand.map(|demand| (ned_from_frd(&demand.world_from_body), demand.thrust.0 as f32));
        let (q, thrust) = target.unwrap_or_default();
        MavMessage::ATTITUDE_TARGET(ATTITUDE_TARGET_DATA {
            time_boot_ms: self.boot_ms(),
            q: [q.w as f32, q.i as f32, q.j as f32, q.k as f32],
            thrust,
            type_mask: AttitudeTargetTypemask::empty(),
            ..ATTITUDE_TARGET_DATA::default()
        })
    }

    fn hud(&self) -> MavMessage {
        let vel = self.vehicle.vel_world;
        let (_, _, yaw) = ned_from_frd(&self.vehicle.world_from_body).euler_angles();
        MavMessage::VFR_HUD(VFR_HUD_DATA {
            airspeed: f32::NAN, // it has no airspeed sensor; so recorded
            groundspeed: vel.xy().norm() as f32,
            alt: self.vehicle.pos_world.z as f32,
            climb: vel.z as f32,
            heading: yaw.to_degrees().rem_euclid(360.0) as i16,
            throttle: self.demand.map_or(0.0, |demand| demand.thrust.0 * 100.0) as u16,
        })
    }

    fn attitude(&self) -> MavMessage {
        let (roll, pitch, yaw) = ned_from_frd(&self.vehicle.world_from_body).euler_angles();
        let [rollspeed, pitchspeed, yawspeed] = self.wire_rates();
        MavMessage::ATTITUDE(ATTITUDE_DATA {
            time_boot_ms: self.boot_ms(),
            roll: roll as f32,
            pitch: pitch as f32,
            yaw: yaw as f32,
            rollspeed,
            pitchspeed,
            yawspeed,
        })
    }

    fn attitude_quaternion(&self) -> MavMessage {
        let [q1, q2, q3, q4] = self.wire_attitude();
        let [rollspeed, pitchspeed, yawspeed] = self.wire_rates();
        MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms: self.boot_ms(),
            q1,
            q2,
            q3,
            q4,
            rollspeed,
            pitchspeed,
            yawspeed,
            ..ATTITUDE_QUATERNION_DATA::default()
        })
    }

    fn local_position(&self) -> MavMessage {
        let [[x, y, z], [vx, vy, vz]] = self.wire_motion();
        MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA { time_boot_ms: self.boot_ms(), x, y, z, vx, vy, vz })
    }

    fn odometry(&self) -> MavMessage {
        let [[x, y, z], [vx, mut vy, vz]] = self.wire_motion();
        if self.fault == Some(OdometryFault::Contradictory) {
            vy += CONTRADICTORY_MPS;
        }
        let [rollspeed, pitchspeed, yawspeed] = self.wire_rates();
        MavMessage::ODOMETRY(ODOMETRY_DATA {
            time_usec: self.boot_ns / 1000,
            x,
            y,
            z,
            q: self.wire_attitude(),
            vx,
            vy,
            vz,
            rollspeed,
            pitchspeed,
            yawspeed,
            pose_covariance: variances(POSITION_VARIANCE),
            velocity_covariance: variances(VELOCITY_VARIANCE),
            frame_id: MavFrame::MAV_FRAME_LOCAL_NED,
            child_frame_id: MavFrame::MAV_FRAME_LOCAL_NED, // the velocity is NED: so the real one was measured
            reset_counter: self.vehicle.reset_counter,
            estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_AUTOPILOT,
            quality: 0,
        })
    }
}

/// The upper triangle of a covariance with this on its first three places of the diagonal; PX4 leaves the rest open.
fn variances(diagonal: [f32; 3]) -> [f32; 21] {
    let mut triangle = [f32::NAN; 21];
    [triangle[0], triangle[6], triangle[11]] = diagonal;
    triangle
}

fn single(vector: Vec3) -> [f32; 3] {
    [vector.x as f32, vector.y as f32, vector.z as f32]
}
