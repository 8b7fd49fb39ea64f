//! The mission's states.

/// What the vehicle is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
    /// Caught up, or the goal is reached.
    Hold,
    /// Braking, descending, touching down.
    Stopping,
    /// On the ground after a flight, motors stopped.
    Landed,
    /// Authority ended; the autopilot or its pilot flies.
    Fault,
}

/// The rung of the fallback ladder, from the best down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fallback {
    /// A fresh plan is flown, or the mode needs none.
    #[default]
    None,
    /// The plan expired: braking.
    PlanExpiredBrake,
    /// Stopped, holding position for want of a plan.
    HoldPosition,
    /// Odometry is stale: level, gently descending.
    OdometryStaleDescend,
    /// Authority is handed back to the autopilot.
    HandBack,
}

/// Why a transition was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// All readiness checks hold.
    ChecksPassed,
    /// A readiness check failed.
    CheckFailed,
    /// The operator's Start.
    StartCommand,
    /// The operator's Stop.
    StopCommand,
    /// The take-off height is reached.
    HeightReached,
    /// The target is confirmed and a trajectory to it is chosen.
    TargetConfirmed,
    /// The target has not been seen for too long.
    TargetLost,
    /// Closer to the target than the hold distance.
    CaughtUp,
    /// The target went away again.
    TargetMovedOff,
    /// Within the goal's radius.
    GoalReached,
    /// No plan for too long.
    NoPlan,
    /// The search found nothing.
    SearchTimeout,
    /// The autopilot did not accept offboard.
    OffboardRefused,
    /// The autopilot did not arm.
    ArmRefused,
    /// The take-off height was not reached in time.
    TakeoffTimeout,
    /// Offboard ended without our asking: pilot or failsafe.
    ModeTakenAway,
    /// Disarmed without our asking.
    Disarmed,
    /// Odometry stayed stale.
    OdometryLost,
    /// Landed and disarmed.
    TouchedDown,
}
