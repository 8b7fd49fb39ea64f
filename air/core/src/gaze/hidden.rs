//! For how long a target has not been seen, and what changes after how long.
//!
//! [`hidden_for`] is the one answer, wherever it is asked. What follows from it differs, and each time has its name here,
//! the shortest first. Three more are the tuning file's, since they say how sure one is of a target and not what to do:
//! `planner.target.blind_time_s` (the filter gives up), `planner.chase.pursue_until_s` (the chase does), and
//! `planner.target.max_speed_mps`, by which a hidden target's place grows.

use crate::values::types::Time;

/// For how long a target that was seen last at `last_seen` has been hidden at `now`, s.
#[must_use]
pub fn hidden_for(last_seen: Time, now: Time) -> f64 {
    now.since(last_seen).max(0.0)
}

/// The side to which it leaves is known no more, s: a few frames and the planner's time.
pub const SIDE: f64 = 0.15;
/// It went behind something, s: the chase follows the way that it took. Chosen by eye.
pub const BEHIND: f64 = 0.2;
/// The chase keeps no room from it any more, s. Tried: the notebook, What mattered, "The way that it took".
pub const ROOM: f64 = 1.0;
/// It is not carried on any farther at its last velocity, s. Tried: chases in buildings hardly change with 0.8
/// (notebook, What mattered, "The way that it took").
pub const CARRY: f64 = 1.5;
/// It may be anywhere, s: no distance is kept from it. As long as the shipped `planner.chase.pursue_until_s`.
pub const ANYWHERE: f64 = 4.0;
