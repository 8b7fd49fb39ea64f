//! The order of a take-off: stream setpoints, ask for offboard, ask for arming, climb.

use crate::mission::config::MissionConfig;
use crate::mission::interface::{AutopilotStatus, Request};
use crate::mission::modes::Cause;
use crate::values::types::Time;

/// How far the take-off is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Setpoints stream, so that offboard will be accepted.
    Stream,
    /// Offboard is asked for.
    Offboard,
    /// Arming is asked for.
    Arm,
    /// The motors run.
    Climb,
}

/// One take-off.
#[derive(Clone, Copy, Debug)]
pub struct Takeoff {
    stage: Stage,
    since: Time,
    asked: Option<Time>,
}

impl Takeoff {
    /// Begins at `now`.
    #[must_use]
    pub fn new(now: Time) -> Self {
        Self { stage: Stage::Stream, since: now, asked: None }
    }

    /// Where it is.
    #[must_use]
    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// Seconds in this stage.
    #[must_use]
    pub fn elapsed(&self, now: Time) -> f64 {
        now.since(self.since)
    }

    /// Moves on as the autopilot follows; what to ask of it now.
    pub fn step(&mut self, config: &MissionConfig, now: Time, autopilot: &AutopilotStatus) -> Option<Request> {
        match self.stage {
            Stage::Stream if self.elapsed(now) >= config.stream_before_offboard_s => self.enter(Stage::Offboard, now),
            Stage::Offboard if autopilot.offboard => self.enter(Stage::Arm, now),
            Stage::Arm if autopilot.armed => self.enter(Stage::Climb, now),
            _ => {}
        }
        let request = match self.stage {
            Stage::Offboard => Request::Offboard,
            Stage::Arm => Request::Arm,
            Stage::Stream | Stage::Climb => return None,
        };
        repeat(&mut self.asked, now, config.request_period_s).then_some(request)
    }

    /// The motors have been asked for: they may start at any time.
    #[must_use]
    pub fn has_asked_to_arm(&self) -> bool {
        matches!(self.stage, Stage::Arm | Stage::Climb)
    }

    /// Which request the autopilot did not follow in time.
    #[must_use]
    pub fn refused(&self, config: &MissionConfig, now: Time) -> Option<Cause> {
        let cause = match self.stage {
            Stage::Offboard => Cause::OffboardRefused,
            Stage::Arm => Cause::ArmRefused,
            Stage::Stream | Stage::Climb => return None,
        };
        (self.elapsed(now) > config.request_timeout_s).then_some(cause)
    }

    fn enter(&mut self, stage: Stage, now: Time) {
        *self = Self { stage, since: now, asked: None };
    }
}

/// After this a vehicle that arms was armed by somebody else, s: our link repeats a request for one second.
const LATE_ARMING: f64 = 3.0;

/// A take-off that was given up on the ground after the motors had been asked for. They are stopped again, and also
/// where the autopilot starts them only now.
#[derive(Clone, Copy, Debug)]
pub struct Abandoned {
    since: Time,
    asked: Option<Time>,
    over: bool,
}

impl Abandoned {
    /// Given up at `now`.
    #[must_use]
    pub fn new(now: Time) -> Self {
        Self { since: now, asked: None, over: false }
    }

    /// What to ask of the autopilot now. The first request goes out even if the motors stand: in the link it takes the
    /// place of the one to arm. One that seems to fly is handed back, and one that somebody else flies is theirs.
    pub fn step(&mut self, config: &MissionConfig, now: Time, autopilot: &AutopilotStatus) -> Option<Request> {
        let flies = autopilot.armed && autopilot.landed == Some(false);
        self.over |= !autopilot.armed && now.since(self.since) > LATE_ARMING || flies && !autopilot.offboard;
        let wanted = autopilot.armed || self.asked.is_none();
        if self.over || !autopilot.connected || !wanted {
            return None;
        }
        let request = if flies { Request::HandBack } else { Request::Disarm };
        repeat(&mut self.asked, now, config.request_period_s).then_some(request)
    }
}

/// True at once and then every `period` seconds.
pub(crate) fn repeat(asked: &mut Option<Time>, now: Time, period: f64) -> bool {
    let due = asked.is_none_or(|at| now.since(at) >= period);
    if due {
        *asked = Some(now);
    }
    due
}
