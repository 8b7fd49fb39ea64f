//! The simulated vehicle: its physics in wind, its IMU, and its autopilot: a stand-in, or real firmware.

pub mod firmware;
pub mod imu;
pub mod px4;
pub mod quadrotor;
