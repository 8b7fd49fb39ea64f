//! The simulator: world, camera, quadrotor, autopilot stand-in, evader; data sets; campaigns.
//!
//! What flies here is the vehicle's own planner and controller; the simulator supplies everything around them.

pub mod actors;
pub mod classical;
pub mod commands;
pub mod pilots;
pub mod render;
pub mod seeds;
pub mod sense;
pub mod trial;
pub mod vehicle;
pub mod world;
