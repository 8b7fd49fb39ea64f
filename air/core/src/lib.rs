//! Goshawk's core: the mathematics of the paper and the flight logic, after YOPOv2-Tracker.
//!
//! Pure: no I/O, clock, thread, random number or global; time and configuration are arguments. Nothing is allocated
//! after construction. Everything hangs on two functions: [`Planner::see`], whose [`Asked::answer`] is a plan, once a
//! camera frame, and [`FlightController::step`] at a fixed rate.

pub mod control;
pub mod gaze;
pub mod mission;
pub mod planning;
pub mod policy;
pub mod values;

#[cfg(test)]
extern crate self as goshawk_core;
#[cfg(test)]
#[path = "../tests/common/shipped.rs"]
#[allow(clippy::unwrap_used, unreachable_pub, reason = "tests share it with the crate's own")]
mod shipped;

pub use control::disturbance::ObserverConfig;
pub use control::hover::HoldConfig;
pub use control::lead::LeadConfig;
pub use control::plans::LadderConfig;
pub use control::separation::{SeparationConfig, SeparationTuning};
pub use control::trust::OdometryFault;
pub use control::vehicle::Airframe;
pub use gaze::GazeConfig;
pub use gaze::hidden::hidden_for;
pub use gaze::view::ViewConfig;
pub use gaze::yaw::YawConfig;
pub use mission::config::{ControllerConfig, MissionConfig, Tuning};
pub use mission::controller::Controller;
pub use mission::fresh::FlightController;
pub use mission::interface::{
    AutopilotStatus, Command, ControllerOutput, Profile, Refusal, Request, StepInput, Transition,
};
pub use mission::limits::LimitsConfig;
pub use mission::modes::{Cause, Fallback, Mode, StopAction};
pub use planning::aim::ChaseConfig;
pub use planning::evade::EvasionConfig;
pub use planning::frame::{FrameInput, FrameRecord, PlanningDemand};
pub use planning::movers::MoversConfig;
pub use planning::obstacles::ObstaclesConfig;
pub use planning::plan::Plan;
pub use planning::planner::{Asked, CostConfig, Planner, PlannerConfig, PlanningConfig};
pub use planning::select::SelectConfig;
pub use planning::target::TargetConfig;
pub use policy::model::{CameraModel, PolicyModel};
pub use policy::state::{NetworkState, StateLayout, StateParts};
pub use values::error::{ConfigError, within};
pub use values::extensions::Extensions;
pub use values::history::History;
pub use values::types::{
    ANCHORS, Added, AttitudeThrust, Candidate, FlatState, GRAVITY, Imu, MAX_CHANNELS, NetworkOutput, Newtons,
    NormalisedThrust, Odometry, Rejection, Rival, Rot, Taken, TargetEstimate, TargetLook, Task, Time, Vec3,
};
