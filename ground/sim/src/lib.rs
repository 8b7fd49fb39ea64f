//! The simulator: world, camera, quadrotor, autopilot stand-in, evader; data sets; campaigns.
//!
//! What flies here is the vehicle's own planner and controller; the simulator supplies everything around them.

pub mod actors;
pub mod chaos;
pub mod classical;
pub mod cli;
pub mod dataset;
pub mod faults;
pub mod fly;
pub mod golden;
pub mod pilots;
pub mod render;
pub mod seeds;
pub mod sense;
pub mod serve;
pub mod trial;
pub mod vehicle;
pub mod world;
pub mod world_preview;
