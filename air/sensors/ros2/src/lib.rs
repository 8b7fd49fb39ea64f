//! ROS 2 without ROS: a node among those of rmw_zenoh, which hands images and odometry to the vehicle and tells what the
//! vehicle tells.
//!
//! In: [`camera`] and [`motion`]. Out: [`outputs`]. [`bridge`] ties both to Zenoh by [`wire`].

pub mod bridge;
pub mod camera;
pub mod config;
pub mod images;
pub mod motion;
pub mod outputs;
pub mod tally;
pub mod wire;
