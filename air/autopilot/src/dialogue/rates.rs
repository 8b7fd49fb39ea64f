//! How often the autopilot is to tell what.

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
    /// RC_CHANNELS, the pilot's sticks and switches; none: nobody reads them.
    pub radio_hz: Option<f64>,
}

impl Default for StreamRates {
    fn default() -> Self {
        Self { odometry_hz: 100.0, attitude_hz: 100.0, imu_hz: 100.0, state_hz: 10.0, radio_hz: None }
    }
}
