//! What goes beyond the paper, each with its switch. With all of them off the paper's method flies.

use schemars::JsonSchema;
use serde::Deserialize;

/// What goes beyond the paper. `docs/explanation/beyond-the-paper.md` says why each is there, and what it is worth. What
/// the network is told of beyond the paper (up, aim, agility) is the policy's contract, not a switch. What a file leaves out
/// is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[expect(clippy::struct_excessive_bools, reason = "they are independent switches")]
pub struct Extensions {
    /// What was seen near by is remembered: what stands is flown around, and what moves is noticed.
    pub obstacle_memory: bool,
    /// The vehicle steps out of the way of what moves, and of a target that comes.
    pub stepping_aside: bool,
    /// The least distance to the target is kept: ways through it cost more, and the controller brakes before it. Off, nothing
    /// keeps the vehicle from its target, and it says so at each start.
    pub least_distance: bool,
    /// The cheapest of all candidates is flown; off: of those in whose cell the target is seen.
    pub choice_among_all: bool,
    /// A detection is weighed by its objectness, distance and line of sight, and the surest one counts; off: all weigh the
    /// same, and the one that fits best counts (eq. 10).
    pub weighted_detections: bool,
    /// What is seen beside the track may take its place.
    pub rivals: bool,
    /// A detection far from its expectation weighs less.
    pub outliers: bool,
    /// A hidden target is pursued, by the way that it took.
    pub pursuit: bool,
    /// The chase flies aside where what is remembered would come between it and the target.
    pub line_of_sight: bool,
    /// The acceleration toward the target is limited to what keeps it in the image.
    pub view_limit: bool,
    /// Navigation: trajectories that end well above the goal cost more.
    pub no_climbing: bool,
    /// Navigation: a vehicle that is stuck flies some metres aside first.
    pub detours: bool,
    /// Navigation: the network is asked for more than the asked speed, so that this is flown.
    pub pace: bool,
    /// The network is told of less acceleration than training's most.
    pub agility_limit: bool,
    /// The thrust that hovers is learnt in flight.
    pub learnt_hover_thrust: bool,
    /// The attitude loop's lag is learnt in flight.
    pub learnt_attitude_lag: bool,
    /// The attitude is commanded ahead of its lag.
    pub attitude_lead: bool,
    /// The thrust is the demanded force along the body's axis as it is; off: the force's norm (eq. 13).
    pub thrust_along_body: bool,
}

impl Extensions {
    /// All that there is.
    pub const ALL: Self = Self {
        obstacle_memory: true,
        stepping_aside: true,
        least_distance: true,
        choice_among_all: true,
        weighted_detections: true,
        rivals: true,
        outliers: true,
        pursuit: true,
        line_of_sight: true,
        view_limit: true,
        no_climbing: true,
        detours: true,
        pace: true,
        agility_limit: true,
        learnt_hover_thrust: true,
        learnt_attitude_lag: true,
        attitude_lead: true,
        thrust_along_body: true,
    };
}

impl Default for Extensions {
    fn default() -> Self {
        Self::ALL
    }
}
