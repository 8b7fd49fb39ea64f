//! The classical baseline: a map-based planner of the Fast-Planner and EGO-Planner kind, flown by the same campaigns as
//! the policy. It is the yardstick, so it does its best with what the vehicle has: depth, odometry, detections.
//!
//! Depth images fill a rolling occupancy map ([`map`]) and its distance field ([`distance`]); a kinodynamic A* finds a
//! way ([`search`]); a B-spline along it is optimised ([`optimise`]) and followed by position control ([`tracker`]).
//! [`pilot`] puts this into the vehicle's own mission.

pub mod distance;
pub mod guide;
mod lbfgs;
pub mod map;
pub mod optimise;
pub mod pilot;
pub mod planner;
pub mod search;
pub mod spline;
#[cfg(test)]
mod tests;
pub mod tracker;

pub use pilot::Classical;
