//! What the planner answers.

use crate::planning::evade::Evasion;
use crate::planning::movers::Movers;
use crate::planning::room::Room;
use crate::values::types::{ANCHORS, Candidate, FlatState, Rot, TargetEstimate, TargetLook, Time};

/// The planner's answer to one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Counts frames.
    pub seq: u64,
    /// The image's capture stamp; t = 0 of the trajectories.
    pub stamp: Time,
    /// f(0): the actual state at the stamp, world frame (§III-D).
    pub start: FlatState,
    /// The camera's attitude at the stamp.
    pub world_from_cam: Rot,
    /// T, s.
    pub duration: f64,
    /// Time scaling (eq. 5).
    pub alpha: f64,
    /// Row-major from the image's top left.
    pub candidates: [Candidate; ANCHORS],
    /// Index of the trajectory to fly; none: nothing was eligible, the controller keeps what it has.
    pub chosen: Option<usize>,
    /// The target filter after this frame; none before the first detection.
    pub target: Option<TargetEstimate>,
    /// What the filter made of this frame's detections; none: it held nothing to compare them with.
    pub look: Option<TargetLook>,
    /// The room about `start`, from what is remembered; none: no target is so near that it matters.
    pub room: Option<Room>,
    /// What moves about the vehicle.
    pub movers: Movers,
    /// What is flown instead of what is chosen, out of the way of what moves; none: nothing comes in the way.
    pub evasion: Option<Evasion>,
}
