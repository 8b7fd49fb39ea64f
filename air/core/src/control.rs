//! From a plan to attitude and thrust, and what is learnt of the vehicle on the way.

pub mod disturbance;
pub mod flatness;
pub mod hover;
pub mod lag;
pub mod lead;
pub mod motion;
pub mod plans;
pub mod separation;
pub mod thrust;
pub mod trust;
pub mod vehicle;
