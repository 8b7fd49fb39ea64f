//! ROS 2 without ROS: a node among those of rmw_zenoh, which hands images and odometry to the vehicle and tells what the
//! vehicle tells.
//!
//! In: [`camera`] and [`motion`]. Out: [`outputs`]. [`bridge`] ties both to Zenoh by [`node`], whose names are those of
//! [`graph`] and whose bytes are those of [`cdr`] and [`messages`].

pub mod bridge;
pub mod camera;
pub mod cdr;
pub mod clock;
pub mod config;
pub mod graph;
pub mod lens;
pub mod messages;
pub mod motion;
pub mod node;
pub mod outputs;
pub mod pairing;
pub mod picture;
pub mod tally;
