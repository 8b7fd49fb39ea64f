//! What the vehicle is doing and why: modes, the flight from Start to the stop of the motors, its limits.

pub mod config;
pub mod controller;
mod detour;
mod flight;
pub mod fresh;
pub mod interface;
pub mod landing;
pub mod limits;
pub mod modes;
mod situation;
pub mod takeoff;
pub mod transitions;
