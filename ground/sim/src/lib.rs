//! The simulator: world, camera, quadrotor, autopilot stand-in, evader; data sets; campaigns.
//!
//! What flies here is the vehicle's own planner and controller; the simulator supplies everything around them.

pub mod buildings;
pub mod chaos;
pub mod classical;
pub mod cli;
pub mod cloud;
pub mod dataset;
pub mod evader;
pub mod faults;
pub mod fly;
pub mod forest;
pub mod golden;
pub mod imu;
mod lanes;
pub mod moving;
pub mod person;
pub mod px4;
pub mod quadrotor;
pub mod render;
pub mod sensor;
pub mod sensors;
pub mod serve;
pub mod trial;
pub mod world;
pub mod world_preview;
