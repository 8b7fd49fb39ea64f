//! What the planner is given for one frame. A plan is a function of this, of the network's answer and of the frames
//! before, on board, in lockstep and in a replay alike.

use crate::planning::nearest::Nearest;
use crate::policy::state::NetworkState;
use crate::values::types::{NetworkOutput, Odometry, Task, Vec3, unsigned_zeros};

/// What the planner should plan for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanningDemand {
    /// Chase or fly to a goal.
    pub task: Task,
    /// The speed that is asked for, m/s.
    pub speed: f64,
    /// Navigation's goal, or where it flies on the way there.
    pub goal_world: Option<Vec3>,
}

/// One frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameInput {
    /// Counts flights. With the first frame of another one the planner forgets all that was before; a log holds one
    /// flight, and does not name it.
    pub flight: u64,
    /// Counts frames.
    pub seq: u64,
    /// Interpolated at the frame's capture stamp; its `stamp` is the frame's.
    pub odometry: Odometry,
    /// Acceleration at the stamp of what is flown, before lead and compensation, m/s².
    pub acc_world: Vec3,
    /// Desired speed, m/s; sets alpha ([`crate::Planner::alpha`]).
    pub speed: f64,
    /// Navigation's goal; none while tracking.
    pub goal_world: Option<Vec3>,
    /// The nearest depths of the image.
    pub nearest: Nearest,
}

impl FrameInput {
    /// A frame as a log gives it back: with no negative zero in it.
    #[must_use]
    pub fn new(
        flight: u64,
        seq: u64,
        at_stamp: &Odometry,
        acc_world: Vec3,
        demand: &PlanningDemand,
        nearest: Nearest,
    ) -> Self {
        FrameInput {
            flight,
            seq,
            odometry: at_stamp.with_unsigned_zeros(),
            acc_world: unsigned_zeros(acc_world),
            speed: demand.speed,
            goal_world: demand.goal_world.map(unsigned_zeros),
            nearest,
        }
    }
}

/// All that a plan was made from. A log holds it, so that the plan can be made again.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameRecord {
    /// What the planner was given.
    pub frame: FrameInput,
    /// What it told the network.
    pub state: NetworkState,
    /// What the network answered.
    pub network: NetworkOutput,
}
