//! What goes into a controller step and what comes out of it.

use crate::control::trust::OdometryFault;
use crate::mission::modes::{Cause, Fallback, Mode};
use crate::planning::frame::PlanningDemand;
use crate::values::types::{AttitudeThrust, FlatState, Imu, Newtons, Odometry, Task, Vec3};

/// What a flight is to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// Chase or fly to a goal.
    pub task: Task,
    /// The speed that is asked for, m/s.
    pub speed: f64,
    /// Take-off height above the start, m.
    pub height: f64,
    /// Navigation's goal relative to the start position and yaw: forward, left, up, m.
    pub goal: Option<Vec3>,
}

impl Profile {
    /// Speed and height are above 0 and, for navigation, there is a goal.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let goal = self.goal.map(|g| g.iter().all(|x| x.is_finite()));
        positive(self.speed) && positive(self.height) && goal.unwrap_or(self.task == Task::Track)
    }
}

/// What the operator asks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Take off and fly the profile. Accepted in `Ready`.
    Start(Profile),
    /// End the flight as the vehicle file says: land, hover or hand over. Accepted always; harmless on the ground.
    Stop,
    /// Brake and hold the place, whatever the vehicle file says; in the climb, land. Accepted always.
    Hold,
    /// Go on with a flight that is held. Refused where none is: a Start that comes late must not do this.
    Resume,
}

/// Why Start is, or would be, refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// The autopilot is silent.
    #[error("not ready: the autopilot is silent; check its link")]
    AutopilotSilent,
    /// Motors are armed, or the autopilot says that it flies.
    #[error("not ready: the autopilot is armed or in the air; land and disarm first")]
    NotOnGround,
    /// Nothing is held.
    #[error("no flight is held that could go on")]
    NotHeld,
    /// No fresh odometry.
    #[error("not ready: odometry is missing or stale; check the state estimator")]
    OdometryStale,
    /// The autopilot says that its position or velocity is not valid.
    #[error("not ready: the autopilot has no valid position; see what its estimator lacks (GPS, flow, VIO)")]
    NoPosition,
    /// The battery is too low to begin.
    #[error("not ready: the battery is low; change or charge it")]
    BatteryLow,
    /// A readiness check outside the core fails.
    #[error("not ready: a readiness check fails; see the checks")]
    ChecksFailed,
    /// A flight is in progress.
    #[error("already flying; stop first")]
    Flying,
    /// Authority ended in a fault that is not over.
    #[error("in fault; land and disarm first")]
    Faulted,
    /// The profile cannot be flown.
    #[error("the profile is invalid: speed and height must be above 0, and navigation needs a goal")]
    BadProfile,
    /// The profile asks for more than the vehicle file's limits allow.
    #[error("the profile goes beyond the vehicle's limits: compare its speed, height and goal with [limits]")]
    BeyondLimits,
}

/// The autopilot's state as last reported.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AutopilotStatus {
    /// Its heartbeat is fresh.
    pub connected: bool,
    /// Motors may turn.
    pub armed: bool,
    /// It follows our setpoints.
    pub offboard: bool,
    /// Its landed detector; none: unknown.
    pub landed: Option<bool>,
    /// Charge left, 0..=1; none: not measured.
    pub battery: Option<f64>,
    /// Its estimate of horizontal position and velocity, by which we fly, is valid; none: it does not say, or we fly by
    /// an estimate that is not its own.
    pub position: Option<bool>,
}

/// What one step sees, but for the plan itself: small enough that each step's is reported and logged as it was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepInput {
    /// Newest odometry. One that is not finite, or older than the last, is ignored.
    pub odometry: Option<Odometry>,
    /// The autopilot's newest inertial sample; none: it sends none. It is shown and logged, and nothing is flown by it.
    pub imu: Option<Imu>,
    /// `seq` of the newest plan.
    pub plan_seq: Option<u64>,
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
    /// The same, though it believes to be in the air.
    DisarmAnyway,
    /// Take over and land.
    HandBack,
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
    /// The reference now: the trajectory's, or the hold point's; zero while there is none.
    pub flat: FlatState,
    /// Desired acceleration before lead and compensation, m/s².
    pub acc_des_world: Vec3,
    /// What the image's edge and the least distance leave of it, m/s²: the next plan begins with it.
    pub acc_kept_world: Vec3,
    /// What the commanded attitude and thrust alone would give, m/s².
    pub acc_att_world: Vec3,
    /// The observer's estimate of the lumped disturbance per unit mass, m/s².
    pub acc_disturbance_world: Vec3,
    /// The largest disturbance that the observer believes, m/s².
    pub disturbance_limit: f64,
    /// The acceleration that the autopilot's IMU feels, m/s²; none: it sends nothing fresh.
    pub acc_meas_world: Option<Vec3>,
    /// Commanded collective force.
    pub thrust: Newtons,
    /// The normalised thrust that hovers, as learnt.
    pub hover_thrust: f64,
    /// The attitude loop's lag, as learnt, s.
    pub attitude_lag: f64,
    /// What is false about the odometry; none: it is believed, and nothing new showed in this step's.
    pub odometry_fault: Option<OdometryFault>,
    /// The largest check of the odometry over its gate; from 1 on it fails.
    pub odometry_doubt: f64,
    /// Desired yaw, rad, -pi..=pi.
    pub yaw_des: f64,
    /// The plan flown; none: no plan is flown.
    pub plan_seq: Option<u64>,
    /// Age of the plan flown since its frame's capture, s.
    pub plan_age: Option<f64>,
    /// What the planner should do now; none: nothing.
    pub planning: Option<PlanningDemand>,
    /// The change of mode in this step; there is at most one.
    pub transition: Option<Transition>,
    /// The answer to this step's command; none: there was no command.
    pub reply: Option<Result<(), Refusal>>,
    /// Whether Start would find the vehicle ready, and if not, the first reason.
    pub readiness: Result<(), Refusal>,
}
