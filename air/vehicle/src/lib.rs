//! What the onboard process and the simulator share, so that both fly the same vehicle: the vehicle file, the messages
//! of the wire and the log as the core's values, the clock, statistics.

/// The git revision that this was built from; "unknown" outside of a repository.
pub const REVISION: &str = env!("GOSHAWK_GIT_REVISION");

pub mod clock;
pub mod config;
pub mod convert;
pub mod desk;
pub mod errors;
pub mod inputs;
pub mod mounting;
pub mod sensors;
pub mod slot;
pub mod stats;
pub mod switch;
