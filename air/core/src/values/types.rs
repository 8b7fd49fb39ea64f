//! The values that cross between the modules of the core, and between the core and whoever calls it.
//!
//! World is ENU, body and camera are FLU; SI and radians. Values here are finite: they were checked at the edge.

use schemars::JsonSchema;
use serde::Deserialize;

use nalgebra::{UnitQuaternion, Vector2, Vector3};

/// A world-, body- or camera-frame vector; the name of a value says which.
pub type Vec3 = Vector3<f64>;

/// A horizontal vector.
pub type Flat = Vector2<f64>;

/// A rotation; named `target_from_source`.
pub type Rot = UnitQuaternion<f64>;

/// Standard gravity, m/s².
pub const GRAVITY: f64 = 9.80665;

/// An instant of the vehicle's monotonic clock, integer nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Time(pub u64);

impl Time {
    /// Seconds from `earlier` to `self`; negative if `self` is the earlier.
    #[must_use]
    pub fn since(self, earlier: Time) -> f64 {
        if self.0 >= earlier.0 { (self.0 - earlier.0) as f64 * 1e-9 } else { -((earlier.0 - self.0) as f64 * 1e-9) }
    }

    /// `self` moved by `seconds` (may be negative), saturating at the clock's ends.
    #[must_use]
    pub fn plus(self, seconds: f64) -> Time {
        let ns = (seconds.abs() * 1e9) as u64;
        Time(if seconds < 0.0 { self.0.saturating_sub(ns) } else { self.0.saturating_add(ns) })
    }

    /// The instant `seconds` after the clock's zero.
    #[must_use]
    pub fn from_secs(seconds: f64) -> Time {
        Time(0).plus(seconds)
    }
}

/// A collective force along body z, newtons. Never a normalised thrust.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Newtons(pub f64);

/// Thrust as the autopilot takes it, 0..=1. Never newtons.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct NormalisedThrust(pub f64);

/// The vehicle's estimated motion at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Odometry {
    /// When it was true.
    pub stamp: Time,
    /// Position, m.
    pub pos_world: Vec3,
    /// Velocity, m/s.
    pub vel_world: Vec3,
    /// Attitude.
    pub world_from_body: Rot,
    /// Angular velocity, rad/s.
    pub ang_vel_body: Vec3,
    /// Changes when the estimate jumps.
    pub reset_counter: u32,
}

/// One sample of the autopilot's accelerometer and gyroscope.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Imu {
    /// When it was true.
    pub stamp: Time,
    /// Specific force (what an accelerometer measures; +g along z at rest), m/s².
    pub specific_force_body: Vec3,
    /// Angular velocity, rad/s.
    pub ang_vel_body: Vec3,
}

impl Imu {
    /// The same with no negative zero in it, as a log gives it back.
    #[must_use]
    pub fn with_unsigned_zeros(&self) -> Self {
        let [specific_force_body, ang_vel_body] = [self.specific_force_body, self.ang_vel_body].map(unsigned_zeros);
        Self { specific_force_body, ang_vel_body, ..*self }
    }

    /// The acceleration that was felt, m/s²: turned by the attitude of an `odometry` near by, and without gravity.
    #[must_use]
    pub fn acc_world(&self, odometry: &Odometry) -> Vec3 {
        let since = self.stamp.since(odometry.stamp);
        let turned = Rot::from_scaled_axis(self.ang_vel_body * since);
        odometry.world_from_body * turned * self.specific_force_body - Vec3::z() * GRAVITY
    }
}

/// `v` with no negative zero in it: protobuf does not tell -0 from 0, so neither may what a log gives back.
pub(crate) fn unsigned_zeros(v: Vec3) -> Vec3 {
    v.map(|x| x + 0.0)
}

impl Odometry {
    /// The same with no negative zero in it, as a log gives it back.
    #[must_use]
    pub fn with_unsigned_zeros(&self) -> Self {
        Self {
            stamp: self.stamp,
            pos_world: unsigned_zeros(self.pos_world),
            vel_world: unsigned_zeros(self.vel_world),
            world_from_body: Rot::new_unchecked(self.world_from_body.into_inner().coords.map(|x| x + 0.0).into()),
            ang_vel_body: unsigned_zeros(self.ang_vel_body),
            reset_counter: self.reset_counter,
        }
    }
}

/// Number of anchors, row-major from the image's top left.
pub const ANCHORS: usize = 15;

/// Most output channels that any task has for an anchor.
pub const MAX_CHANNELS: usize = 14;

/// What the policy is asked to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Task {
    /// Chase the detected target.
    Track,
    /// Fly to a goal.
    Navigate,
}

/// The raw network output of one frame: `channels × rows × columns`, row-major, as the contract lays it out
/// (θ, φ, r, v xyz, a xyz, cost, then for tracking objectness, Δu, Δv, distance).
#[derive(Clone, Debug, PartialEq)]
pub struct NetworkOutput {
    /// Channel-major values; only the first `channels × ANCHORS` are meaningful.
    pub values: [f32; MAX_CHANNELS * ANCHORS],
}

/// Position and its derivatives at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FlatState {
    /// f, m.
    pub pos: Vec3,
    /// ḟ, m/s.
    pub vel: Vec3,
    /// f̈, m/s².
    pub acc: Vec3,
}

/// Why a candidate was not chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rejection {
    /// There is no target to chase, and it holds none.
    Objectness,
    /// There is no target to chase yet: its detection is not confirmed, or inconsistent with the target filter.
    Gate,
    /// Another was cheaper.
    Cost,
    /// It would have been the cheapest, but for what it meets, an obstacle or the target, or for its climb over the goal.
    Blocked,
    /// The network's values for it are not finite; `end` is the bare anchor, `objectness` 0.
    Invalid,
}

/// What the planner adds to a candidate's cost, on the cost's scale; none is negative.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Added {
    /// For what stands and was seen.
    pub obstacle: f64,
    /// For what moves.
    pub mover: f64,
    /// For coming too near to the target.
    pub target: f64,
    /// For ending above the goal.
    pub climbing: f64,
    /// All of it.
    pub total: f64,
}

/// One predicted trajectory, decoded to the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// f(T), world frame.
    pub end: FlatState,
    /// Predicted cost; lower is better.
    pub cost: f64,
    /// What the planner adds to it: known of what would be flown otherwise, zero of what is too dear already.
    pub added: Added,
    /// Probability that the cell holds the target, 0..=1; 1 in navigation.
    pub objectness: f64,
    /// The detected target's centre, world frame; none in navigation.
    pub target_world: Option<Vec3>,
    /// None for the chosen one.
    pub rejection: Option<Rejection>,
}

/// The target filter's state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetEstimate {
    /// When it is true.
    pub stamp: Time,
    /// Position, m.
    pub pos_world: Vec3,
    /// Velocity, m/s.
    pub vel_world: Vec3,
    /// Covariance of (position, velocity).
    pub covariance: nalgebra::Matrix6<f64>,
    /// Seen often enough to be believed (M of N).
    pub confirmed: bool,
    /// When a detection last updated it.
    pub last_seen: Time,
}

/// What the target filter made of one frame's detections, compared with what it believed before (eq. 10).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetLook {
    /// Detections with objectness enough to be looked at.
    pub detections: u32,
    /// Of these, how many are within the gate.
    pub passed: u32,
    /// The gate, in standard deviations.
    pub gate_sigmas: f64,
    /// The detection that the filter took; none: none passed.
    pub taken: Option<Taken>,
    /// What is seen beside the target; none: nothing is.
    pub rival: Option<Rival>,
}

/// A detection that the target filter took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taken {
    /// From where the target was expected, m.
    pub innovation_world: Vec3,
    /// The same in standard deviations, to be compared with the gate.
    pub sigmas: f64,
    /// 0..=1.
    pub objectness: f64,
}

/// What may take the target's place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rival {
    /// Where it is, m.
    pub pos_world: Vec3,
    /// The mean of its detections, 0..=1.
    pub objectness: f64,
    /// The mean from which on it takes the place, once it is seen often enough; above 1: as things stand it cannot.
    pub needed: f64,
}

/// What the autopilot takes at the controller's rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeThrust {
    /// Desired attitude.
    pub world_from_body: Rot,
    /// Collective thrust, as the autopilot takes it.
    pub thrust: NormalisedThrust,
}
