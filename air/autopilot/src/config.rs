//! Where the autopilot is, who we are, and what we ask to be told.

use crate::error::AutopilotError;
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
    /// ODOMETRY.
    pub odometry_hz: f64,
    /// ATTITUDE_QUATERNION, used when ODOMETRY does not come.
    pub attitude_hz: f64,
    /// HIGHRES_IMU.
    pub imu_hz: f64,
    /// CURRENT_MODE and EXTENDED_SYS_STATE: how late a lost mode is noticed at worst.
    pub state_hz: f64,
}

impl Default for StreamRates {
    fn default() -> Self {
        Self { odometry_hz: 100.0, attitude_hz: 100.0, imu_hz: 100.0, state_hz: 10.0 }
    }
}

/// Where the autopilot is and who we are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkConfig {
    /// Our local address. PX4 sends to UDP 14540 unless told otherwise.
    pub bind: SocketAddr,
    /// The autopilot's address; none: that of the first heartbeat of the target.
    pub peer: Option<SocketAddr>,
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
    /// The customary ids, listening at `bind`, peer learned.
    #[must_use]
    pub fn customary(bind: SocketAddr) -> Self {
        Self {
            bind,
            peer: None,
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
        if let Some(peer) = self.peer
            && peer.is_ipv4() != self.bind.is_ipv4()
        {
            return Err(AutopilotError::Config(format!("peer {peer} cannot be reached from {}", self.bind)));
        }
        Ok(())
    }
}
