//! From what arrives at the edge to the setpoint: the planner's and the controller's threads, and what threads share.

pub mod camera;
pub mod control;
pub mod planning;
pub mod realtime;
pub mod shared;
pub mod vision;
