//! The simulated vehicle: its physics in wind, its IMU, and a stand-in for its autopilot.

pub mod imu;
pub mod px4;
pub mod quadrotor;
