//! Goshawk's core: the mathematics of the paper and the flight logic, after YOPOv2-Tracker.
//!
//! Pure: no I/O, clock, thread, random number or global; time and configuration are arguments. Nothing is allocated
//! after construction. Everything hangs on two functions: [`Planner::step`] once a camera frame, and
//! [`Controller::step`] at a fixed rate.

mod activation;
pub mod aim;
pub mod config;
pub mod controller;
pub mod decode;
mod detour;
pub mod disturbance;
pub mod error;
pub mod evade;
pub mod flatness;
mod flight;
pub mod history;
pub mod hover;
pub mod interface;
pub mod lag;
pub mod landing;
pub mod lattice;
pub mod lead;
pub mod limits;
pub mod mission;
pub mod motion;
pub mod movers;
pub mod nearest;
pub mod obstacles;
pub mod planner;
pub mod plans;
pub mod quintic;
pub mod room;
pub mod select;
pub mod separation;
mod situation;
pub mod takeoff;
pub mod target;
pub mod thrust;
pub mod transitions;
pub mod trust;
pub mod types;
pub mod view;
pub mod yaw;

pub use aim::ChaseConfig;
pub use config::{
    ControllerConfig, HoldConfig, LadderConfig, LeadConfig, MissionConfig, ObserverConfig, VehicleModel, YawConfig,
};
pub use controller::Controller;
pub use error::{ConfigError, within};
pub use history::History;
pub use interface::{
    AutopilotStatus, Command, ControllerInput, ControllerOutput, PlanningDemand, Profile, Refusal, Request, Transition,
};
pub use lag::LagConfig;
pub use limits::LimitsConfig;
pub use mission::{Cause, Fallback, Mode, StopAction};
pub use planner::{CameraModel, Planner, PlannerConfig, PlannerInput, PlanningConfig, PolicyModel};
pub use select::SelectConfig;
pub use separation::SeparationConfig;
pub use target::TargetConfig;
pub use thrust::ThrustConfig;
pub use trust::OdometryFault;
pub use types::{
    ANCHORS, AttitudeThrust, Candidate, FlatState, GRAVITY, MAX_CHANNELS, NetworkOutput, Newtons, NormalisedThrust,
    Odometry, Plan, Rejection, Rot, TargetEstimate, Task, Time, Vec3,
};
pub use view::ViewConfig;
