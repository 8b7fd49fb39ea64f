//! The controller: newest plan and odometry in, attitude and thrust out, at a fixed rate.

use crate::config::ControllerConfig;
use crate::error::ConfigError;
use crate::mission::{Cause, Fallback, Mode};
use crate::types::{AttitudeThrust, FlatState, Newtons, Odometry, Plan, Task, Time, Vec3};

/// What a flight is to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// Chase or fly to a goal.
    pub task: Task,
    /// Desired largest speed, m/s.
    pub speed: f64,
    /// Take-off height above the start, m.
    pub height: f64,
    /// Navigation's goal relative to the start position and yaw: forward, left, up, m.
    pub goal: Option<Vec3>,
}

/// What the operator asks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Take off and fly the profile. Accepted in `Ready`.
    Start(Profile),
    /// Brake and land. Accepted always; harmless on the ground.
    Stop,
}

/// Why a command was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// A readiness check fails.
    #[error("not ready: see the readiness checks")]
    NotReady,
    /// A flight is in progress.
    #[error("already flying: stop first")]
    Flying,
    /// Authority was lost; the vehicle must be disarmed first.
    #[error("authority was handed back: land and disarm first")]
    Faulted,
    /// The profile cannot be flown.
    #[error("the profile is invalid: speed and height must be above 0, navigation needs a goal")]
    BadProfile,
}

/// The autopilot's state as last reported.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AutopilotStatus {
    /// Its heartbeat is fresh.
    pub connected: bool,
    /// Motors may turn.
    pub armed: bool,
    /// It follows our setpoints.
    pub offboard: bool,
    /// Its landed detector; none: unknown.
    pub landed: Option<bool>,
}

/// What one step sees.
#[derive(Clone, Copy, Debug)]
pub struct ControllerInput<'a> {
    /// Newest odometry.
    pub odometry: Option<&'a Odometry>,
    /// Newest plan; new when its `seq` changes.
    pub plan: Option<&'a Plan>,
    /// The autopilot's state.
    pub autopilot: AutopilotStatus,
    /// A command, given in one step only.
    pub command: Option<Command>,
    /// All readiness checks outside the core hold.
    pub ready: bool,
}

/// What the controller asks of the autopilot besides following setpoints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Follow our setpoints.
    Offboard,
    /// Start the motors.
    Arm,
    /// Stop the motors, on the ground.
    Disarm,
    /// Take over and land.
    HandBack,
}

/// What the planner should plan for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanningDemand {
    /// Chase or fly to a goal.
    pub task: Task,
    /// Desired largest speed, m/s.
    pub speed: f64,
    /// Navigation's goal.
    pub goal_world: Option<Vec3>,
}

/// A change of mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transition {
    /// The mode left.
    pub from: Mode,
    /// The mode entered.
    pub to: Mode,
    /// Why.
    pub cause: Cause,
}

/// What one step decided, with all that the telemetry shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControllerOutput {
    /// The mode after this step.
    pub mode: Mode,
    /// The rung of the ladder.
    pub fallback: Fallback,
    /// What to send; none: no authority is wanted, send nothing.
    pub setpoint: Option<AttitudeThrust>,
    /// What to ask of the autopilot, once.
    pub request: Option<Request>,
    /// The reference now: the trajectory's, or the hold point's.
    pub flat: FlatState,
    /// Desired acceleration before lead and compensation, m/s².
    pub acc_des_world: Vec3,
    /// What the commanded attitude and thrust alone would give, m/s².
    pub acc_att_world: Vec3,
    /// The observer's estimate of the lumped disturbance per unit mass, m/s².
    pub acc_disturbance_world: Vec3,
    /// The observer's model of the actual acceleration, m/s².
    pub acc_meas_world: Vec3,
    /// Commanded collective force.
    pub thrust: Newtons,
    /// Desired yaw, rad, -pi..pi.
    pub yaw_des: f64,
    /// The plan flown; none: no plan is flown.
    pub plan_seq: Option<u64>,
    /// Age of the plan flown, s.
    pub plan_age: Option<f64>,
    /// What the planner should do now; none: nothing.
    pub planning: Option<PlanningDemand>,
    /// The last change of mode in this step.
    pub transition: Option<Transition>,
    /// The answer to this step's command; none: there was no command.
    pub reply: Option<Result<(), Refusal>>,
}

/// Mission, fallback ladder, observer, yaw and flatness in one fixed-rate step.
#[derive(Clone, Debug)]
pub struct Controller {
    config: ControllerConfig,
}

impl Controller {
    /// A controller in `Idle`.
    ///
    /// # Errors
    /// A value that cannot be flown with.
    pub fn new(config: ControllerConfig) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self { config })
    }

    /// The configuration that it flies with.
    #[must_use]
    pub fn config(&self) -> &ControllerConfig {
        &self.config
    }

    /// One tick at `now`.
    pub fn step(&mut self, _now: Time, _input: &ControllerInput) -> ControllerOutput {
        todo!()
    }
}
