//! The mission's modes, the rungs of the fallback ladder, and the events that the mission heeds.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the vehicle is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Mode {
    /// Not ready.
    #[default]
    Idle,
    /// Start would be accepted.
    Ready,
    /// Streaming, arming, climbing.
    Takeoff,
    /// Chasing the target.
    Track,
    /// Flying to the goal.
    Navigate,
    /// The target is lost: hover, look for it.
    Search,
    /// Caught up, the goal is reached, or no way to it is found.
    Hold,
    /// Braking, descending, touching down.
    Stopping,
    /// On the ground after a flight, motors stopped.
    Landed,
    /// Authority ended; the autopilot or its pilot flies.
    Fault,
}

impl Mode {
    /// All modes.
    pub const ALL: [Mode; 10] = [
        Mode::Idle,
        Mode::Ready,
        Mode::Takeoff,
        Mode::Track,
        Mode::Navigate,
        Mode::Search,
        Mode::Hold,
        Mode::Stopping,
        Mode::Landed,
        Mode::Fault,
    ];

    /// Setpoints are sent: from the take-off's stream to the landing's disarming.
    #[must_use]
    pub fn has_authority(self) -> bool {
        matches!(self, Mode::Takeoff | Mode::Track | Mode::Navigate | Mode::Search | Mode::Hold | Mode::Stopping)
    }
}

/// The rung of the fallback ladder, from the best down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Fallback {
    /// A fresh plan is flown, or the mode needs none.
    #[default]
    None,
    /// The plan expired: braking.
    PlanExpiredBrake,
    /// Stopped, holding position for want of a plan.
    HoldPosition,
    /// Odometry contradicts itself: braking by dead reckoning.
    OdometryFalseBrake,
    /// Odometry is stale, or false and the vehicle stopped or its heading unknown: level, gently descending.
    OdometryStaleDescend,
    /// Authority is handed back to the autopilot.
    HandBack,
}

/// What happens, and why a transition is made; displays as a sentence. The most urgent comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Cause {
    /// Landed and disarmed.
    TouchedDown,
    /// Disarmed without our asking.
    Disarmed,
    /// Offboard ended without our asking: pilot or failsafe.
    ModeTakenAway,
    /// Odometry stayed stale.
    OdometryLost,
    /// Odometry went on contradicting itself.
    OdometryFalse,
    /// The autopilot's position stayed invalid.
    PositionLost,
    /// The operator's Stop.
    StopCommand,
    /// The autopilot has fallen silent.
    AutopilotLost,
    /// The battery is low.
    BatteryLow,
    /// The fence is so near that the vehicle can only just stop.
    FenceReached,
    /// Likewise the ceiling.
    CeilingReached,
    /// The flight has lasted as long as it may.
    TimeUp,
    /// The pilot's hold.
    HoldCommand,
    /// The autopilot did not accept offboard.
    OffboardRefused,
    /// The autopilot did not arm.
    ArmRefused,
    /// The take-off height is reached.
    HeightReached,
    /// The take-off height was not reached in time.
    TakeoffTimeout,
    /// No plan for too long.
    NoPlan,
    /// Closer to the target than the hold distance.
    CaughtUp,
    /// Within the goal's radius.
    GoalReached,
    /// Whatever side was tried led no nearer to the goal.
    NoWay,
    /// The target went away again.
    TargetMovedOff,
    /// The target is confirmed and a trajectory to it is chosen.
    TargetConfirmed,
    /// The target has not been seen for too long.
    TargetLost,
    /// The search found nothing.
    SearchTimeout,
    /// A readiness check failed.
    CheckFailed,
    /// The operator's Start.
    StartCommand,
    /// The pilot lets go of a hold.
    ResumeCommand,
    /// All readiness checks hold.
    ChecksPassed,
    /// A fault is over: disarmed, and shown for long enough.
    FaultOver,
}

impl Cause {
    /// All causes.
    pub const ALL: [Cause; 30] = [
        Cause::TouchedDown,
        Cause::Disarmed,
        Cause::ModeTakenAway,
        Cause::OdometryLost,
        Cause::OdometryFalse,
        Cause::PositionLost,
        Cause::StopCommand,
        Cause::AutopilotLost,
        Cause::BatteryLow,
        Cause::FenceReached,
        Cause::CeilingReached,
        Cause::TimeUp,
        Cause::HoldCommand,
        Cause::OffboardRefused,
        Cause::ArmRefused,
        Cause::HeightReached,
        Cause::TakeoffTimeout,
        Cause::NoPlan,
        Cause::CaughtUp,
        Cause::GoalReached,
        Cause::NoWay,
        Cause::TargetMovedOff,
        Cause::TargetConfirmed,
        Cause::TargetLost,
        Cause::SearchTimeout,
        Cause::CheckFailed,
        Cause::StartCommand,
        Cause::ResumeCommand,
        Cause::ChecksPassed,
        Cause::FaultOver,
    ];
}

impl std::fmt::Display for Cause {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Cause::TouchedDown => "landed and disarmed",
            Cause::Disarmed => "disarmed without our asking",
            Cause::ModeTakenAway => "offboard was taken away by the pilot or a failsafe",
            Cause::OdometryLost => "odometry stayed stale",
            Cause::OdometryFalse => "odometry contradicts itself",
            Cause::PositionLost => "the autopilot has lost its position",
            Cause::StopCommand => "the operator's Stop",
            Cause::HoldCommand => "the pilot's hold",
            Cause::AutopilotLost => "the autopilot has fallen silent",
            Cause::BatteryLow => "the battery is low",
            Cause::FenceReached => "the fence is reached",
            Cause::CeilingReached => "the ceiling is reached",
            Cause::TimeUp => "the flight has lasted as long as it may",
            Cause::OffboardRefused => "the autopilot did not accept offboard",
            Cause::ArmRefused => "the autopilot did not arm",
            Cause::HeightReached => "the take-off height is reached",
            Cause::TakeoffTimeout => "the take-off height was not reached in time",
            Cause::NoPlan => "no plan arrived for too long",
            Cause::CaughtUp => "caught up with the target",
            Cause::GoalReached => "the goal is reached",
            Cause::NoWay => "no way to the goal was found",
            Cause::TargetMovedOff => "the target moved off",
            Cause::TargetConfirmed => "the target is confirmed",
            Cause::TargetLost => "the target has not been seen for too long",
            Cause::SearchTimeout => "the search found nothing",
            Cause::CheckFailed => "a readiness check failed",
            Cause::StartCommand => "the operator's Start",
            Cause::ResumeCommand => "the pilot lets it go on",
            Cause::ChecksPassed => "all readiness checks hold",
            Cause::FaultOver => "the fault is over",
        })
    }
}

/// What Stop does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StopAction {
    /// Brake and land.
    Land,
    /// Brake and hold the place; a second Stop lands.
    Hover,
    /// Hand over to the autopilot.
    HandOver,
}
