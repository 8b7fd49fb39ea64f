//! The autopilot's estimate of its motion, from whichever messages tell it.

use crate::messages::{ATTITUDE_QUATERNION_DATA, MavMessage, ODOMETRY_DATA};
use crate::state::clock::ClockMap;
use crate::state::contradiction::Contradiction;
use crate::state::inertial::Inertial;
use crate::state::pose::{self, Position, Unusable};
use crate::state::validity::PositionFault;
use goshawk_core::{Imu, Odometry, Time};

/// Without ODOMETRY for this long, position and attitude messages are joined instead. Chosen by eye.
const ODOMETRY_SILENCE_S: f64 = 0.5;
/// A position older than this is not joined with an attitude. Chosen by eye.
const POSITION_AGE_S: f64 = 0.3;
/// Packets that come this much late are old news; more is a restart. Chosen by eye.
const REORDER_NS: u64 = 1_000_000_000;
/// Joined messages have no reset counter. A place that differs by more than this, and more with each second between,
/// from where the motion led is a reset, m. Chosen by eye.
const JUMP_M: f64 = 0.5;
/// So is a heading that differs by more than this, rad. Chosen by eye.
const TURN_RAD: f64 = 0.3;

/// Newest motion, stamped in our clock.
#[derive(Clone, Debug, Default)]
pub(crate) struct Estimate {
    odometry: Option<Odometry>,
    odometry_remote_ns: u64,
    /// When ODOMETRY last came.
    odometry_arrival: Option<Time>,
    position: Option<Position>,
    contradiction: Contradiction,
    inertial: Inertial,
    imu: Option<Imu>,
}

impl Estimate {
    pub(crate) fn odometry(&self) -> Option<Odometry> {
        self.odometry
    }

    pub(crate) fn imu(&self) -> Option<Imu> {
        self.imu
    }

    /// What contradicts ODOMETRY at `now`; none: nothing that is told.
    pub(crate) fn contradiction(&self, now: Time) -> Option<PositionFault> {
        let felt = self.inertial.contradicts(now).then_some(PositionFault::Unfelt);
        self.contradiction.is_there(now).then_some(PositionFault::Contradiction).or(felt)
    }

    /// A new contact: what was compared before does not belong to what comes.
    pub(crate) fn compare_anew(&mut self) {
        (self.contradiction, self.inertial) = (Contradiction::default(), Inertial::default());
    }

    /// Takes a message that arrived `now`; what does not tell of motion changes nothing.
    pub(crate) fn take(&mut self, clock: &mut ClockMap, now: Time, message: &MavMessage) -> Result<(), Unusable> {
        match message {
            MavMessage::ODOMETRY(odometry) => self.odometry_message(clock, now, odometry),
            MavMessage::LOCAL_POSITION_NED(local) => {
                let stamp = clock.local(u64::from(local.time_boot_ms) * 1_000_000, now);
                let position = pose::position(local, stamp)?;
                self.position = Some(position);
                self.contradiction.local(position);
                Ok(())
            }
            MavMessage::ATTITUDE_QUATERNION(attitude) => self.attitude_message(clock, now, attitude),
            MavMessage::HIGHRES_IMU(imu) => {
                let stamp = clock.local(imu.time_usec.saturating_mul(1000), now);
                let imu = pose::imu(imu, stamp)?;
                self.imu = Some(imu);
                self.inertial.imu(imu);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn odometry_message(&mut self, clock: &mut ClockMap, now: Time, message: &ODOMETRY_DATA) -> Result<(), Unusable> {
        let remote_ns = message.time_usec.saturating_mul(1000);
        let odometry = pose::odometry(message, clock.local(remote_ns, now))?;
        self.odometry_arrival = Some(now);
        self.contradiction.odometry(now, &odometry);
        self.inertial.odometry(now, &odometry);
        self.keep(remote_ns, odometry);
        Ok(())
    }

    fn attitude_message(
        &mut self,
        clock: &mut ClockMap,
        now: Time,
        message: &ATTITUDE_QUATERNION_DATA,
    ) -> Result<(), Unusable> {
        let remote_ns = u64::from(message.time_boot_ms) * 1_000_000;
        let stamp = clock.local(remote_ns, now);
        let streamed = self.odometry_arrival.is_some_and(|heard| now.since(heard) < ODOMETRY_SILENCE_S);
        let Some(position) = self.position.filter(|position| stamp.since(position.stamp).abs() < POSITION_AGE_S) else {
            return Ok(());
        };
        if !streamed {
            let mut joined = pose::combined(message, &position, stamp, 0)?;
            if let Some(last) = self.odometry {
                joined.reset_counter = last.reset_counter.wrapping_add(u32::from(jumped(&last, &joined)));
            }
            self.keep(remote_ns, joined);
        }
        Ok(())
    }

    fn keep(&mut self, remote_ns: u64, odometry: Odometry) {
        let late = remote_ns < self.odometry_remote_ns && self.odometry_remote_ns - remote_ns < REORDER_NS;
        if !late {
            self.odometry_remote_ns = remote_ns;
            self.odometry = Some(odometry);
        }
    }
}

fn jumped(last: &Odometry, new: &Odometry) -> bool {
    let dt = new.stamp.since(last.stamp).abs();
    let moved = new.pos_world - (last.pos_world + (last.vel_world + new.vel_world) * (0.5 * dt));
    let (_, _, turned) = (last.world_from_body.inverse() * new.world_from_body).euler_angles();
    let expected = last.ang_vel_body.z * dt;
    moved.norm() > JUMP_M + dt || (turned - expected).abs() > TURN_RAD + dt
}
