//! What is known of the autopilot, from what it sends.

pub(crate) mod batteries;
pub mod clock;
pub(crate) mod contradiction;
pub(crate) mod estimate;
pub(crate) mod inertial;
pub(crate) mod pose;
pub mod radio;
pub mod status;
pub(crate) mod validity;
pub mod view;
