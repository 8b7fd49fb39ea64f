//! Where the autopilot is, who we are, and what we ask to be told.

use crate::address::Address;
use crate::error::AutopilotError;
use crate::firmware::Firmware;
use crate::signing::SigningConfig;
use std::net::SocketAddr;

/// As what our heartbeat introduces us.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HeartbeatKind {
    /// A companion computer. PX4 sends it no STATUSTEXT.
    #[default]
    OnboardController,
    /// A ground station: STATUSTEXT comes, but PX4 then counts its ground link as alive as long as we are.
    GroundStation,
}

/// How often each message is asked for when contact is made, Hz, above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamRates {
    /// ODOMETRY of PX4, LOCAL_POSITION_NED of ArduPilot.
    pub odometry_hz: f64,
    /// ATTITUDE_QUATERNION, joined with the position when ODOMETRY does not come.
    pub attitude_hz: f64,
    /// HIGHRES_IMU, of PX4.
    pub imu_hz: f64,
    /// CURRENT_MODE (of ArduPilot: HEARTBEAT), EXTENDED_SYS_STATE and ESTIMATOR_STATUS (of ArduPilot:
    /// EKF_STATUS_REPORT): how late a lost mode is noticed at worst.
    pub state_hz: f64,
}

impl Default for StreamRates {
    fn default() -> Self {
        Self { odometry_hz: 100.0, attitude_hz: 100.0, imu_hz: 100.0, state_hz: 10.0 }
    }
}

/// Where the autopilot is and who we are.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkConfig {
    /// The line to it. PX4 sends to UDP 14540 unless told otherwise.
    pub address: Address,
    /// Which autopilot it is to be.
    pub firmware: Firmware,
    /// What messages are signed with, and must be; none: signatures are not looked at.
    pub signing: Option<SigningConfig>,
    /// Our system id, by custom the vehicle's.
    pub system_id: u8,
    /// Our component id; 191 is the custom for a companion computer.
    pub component_id: u8,
    /// The autopilot's system id.
    pub target_system: u8,
    /// The autopilot's component id, 1 by custom. With a wrong one PX4 silently ignores everything.
    pub target_component: u8,
    /// As what we introduce ourselves.
    pub heartbeat: HeartbeatKind,
    /// What to ask for when contact is made.
    pub rates: StreamRates,
}

impl LinkConfig {
    /// The customary ids, listening for PX4 on UDP at `bind`.
    #[must_use]
    pub fn customary(bind: SocketAddr) -> Self {
        Self {
            address: Address::UdpIn(bind),
            firmware: Firmware::default(),
            signing: None,
            system_id: 1,
            component_id: 191,
            target_system: 1,
            target_component: 1,
            heartbeat: HeartbeatKind::default(),
            rates: StreamRates::default(),
        }
    }

    pub(crate) fn validate(&self) -> Result<(), AutopilotError> {
        let rates = &self.rates;
        let ids = [self.system_id, self.component_id, self.target_system, self.target_component];
        if ids.contains(&0) {
            return Err(AutopilotError::Config("system and component ids are 1 to 255; 0 means everyone".to_owned()));
        }
        for hz in [rates.odometry_hz, rates.attitude_hz, rates.imu_hz, rates.state_hz] {
            if !(hz.is_finite() && hz > 0.0 && hz <= 1000.0) {
                return Err(AutopilotError::Config(format!("stream rate {hz} Hz is not above 0 and up to 1000")));
            }
        }
        Ok(())
    }
}
