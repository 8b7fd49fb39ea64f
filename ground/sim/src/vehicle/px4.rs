//! A stand-in for the autopilot: it behaves at the MAVLink boundary as a real PX4 (main of mid-2025) was measured to.
//!
//! [`Px4Logic`] is the pure state machine, [`Px4Udp`] the socket around it. Outside both everything is ENU and FLU;
//! the conversions are `goshawk_autopilot::frames`'. What is left out: parameters but for those of [`Px4Config`],
//! missions, GPS, the estimator (it reports the state that it is given, or that it has none) and every stream that a companion computer
//! has no use for.

mod checks;
mod commands;
mod flight;
mod health;
mod landed;
mod logic;
mod reports;
mod streams;
mod udp;

#[cfg(test)]
mod bench;
#[cfg(test)]
mod fault_tests;
#[cfg(test)]
mod flight_tests;
#[cfg(test)]
mod link_tests;
#[cfg(test)]
mod logic_tests;
#[cfg(test)]
mod reports_tests;

use crate::vehicle::imu::ImuSample;
use goshawk_autopilot::Px4Mode;
use goshawk_core::{AttitudeThrust, NormalisedThrust, Rot, Vec3};

pub use checks::Px4Faults;
pub use logic::Px4Logic;
pub use udp::{Px4Udp, Px4UdpError};

/// What the autopilot senses of its vehicle: the truth, or the truth with an estimator's errors added by the caller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleState {
    /// Position, m.
    pub pos_world: Vec3,
    /// Velocity, m/s.
    pub vel_world: Vec3,
    /// Attitude.
    pub world_from_body: Rot,
    /// Angular velocity, rad/s.
    pub ang_vel_body: Vec3,
    /// What the IMU measures.
    pub imu: ImuSample,
    /// The feet touch the ground.
    pub on_ground: bool,
    /// Charge left, 0..=1.
    pub battery_fraction: f64,
    /// Counts the estimator's jumps, as the caller makes them.
    pub reset_counter: u8,
}

/// What the autopilot does to the motors, and its state in words.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Px4Output {
    /// Motors may turn.
    pub armed: bool,
    /// What it flies.
    pub mode: Px4Mode,
    /// What it tracks; none: disarmed, the rotors stop.
    pub demand: Option<AttitudeThrust>,
}

/// COM_OBL_RC_ACT: what to do when setpoints stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LossAction {
    /// 0, PX4's default: POSCTL, which without sticks sinks blindly.
    Position,
    /// 4: land at once.
    #[default]
    Land,
    /// 5: hold position.
    Hold,
}

/// A lie or a silence of the estimator, for tests of those who listen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OdometryFault {
    /// No ODOMETRY, LOCAL_POSITION_NED, ATTITUDE or ATTITUDE_QUATERNION at all.
    Silent,
    /// Positions and velocities are NaN.
    NotFinite,
    /// ODOMETRY's velocity is 3 m/s too fast to the east; LOCAL_POSITION_NED's is right.
    Contradictory,
}

/// Which parameter says whether moving a stick takes the mode from whoever flies offboard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StickOverride {
    /// MAN_OVERRIDE_SPD, since July 2026: sticks moved faster than this, travels a second; below 0: never.
    Speed(f64),
    /// COM_RC_OVERRIDE, before: bit 1 is for offboard, whatever the speed.
    Bits(i32),
}

impl StickOverride {
    /// Do sticks that move at `speed` (travels a second) take over from offboard?
    #[must_use]
    pub fn takes_over(self, speed: f64) -> bool {
        match self {
            Self::Speed(limit) => limit >= 0.0 && speed > limit,
            Self::Bits(bits) => bits & 2 != 0 && speed > 0.0,
        }
    }
}

/// The parameters that are set on the autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Px4Config {
    /// MAV_SYS_ID.
    pub system_id: u8,
    /// MAV_COMP_ID.
    pub component_id: u8,
    /// COM_OF_LOSS_T: how long setpoints may be missing, s, above 0.
    pub loss_s: f64,
    /// COM_OBL_RC_ACT.
    pub loss_action: LossAction,
    /// MPC_THR_HOVER: the thrust that about hovers, for the modes that PX4 flies itself.
    pub hover_thrust: NormalisedThrust,
    /// MAN_OVERRIDE_SPD or COM_RC_OVERRIDE.
    pub sticks: StickOverride,
}

impl Default for Px4Config {
    /// The identity and the loss time of a stock PX4, set to land when setpoints stop; hover thrust 0.49 as measured
    /// on its own model.
    fn default() -> Self {
        Self {
            system_id: 1,
            component_id: 1,
            loss_s: 1.0,
            loss_action: LossAction::default(),
            hover_thrust: NormalisedThrust(0.49),
            sticks: StickOverride::Speed(1.0),
        }
    }
}
