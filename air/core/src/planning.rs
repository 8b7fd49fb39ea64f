//! From a frame to a plan: what is chased, what is avoided, what is flown.

pub mod aim;
pub mod evade;
pub mod frame;
pub mod movers;
pub mod nearest;
pub mod obstacles;
pub mod plan;
pub mod planner;
pub mod room;
pub mod select;
pub mod target;
