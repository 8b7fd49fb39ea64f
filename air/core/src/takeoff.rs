//! The order of a take-off: stream setpoints, ask for offboard, ask for arming, climb.

use crate::config::MissionConfig;
use crate::interface::{AutopilotStatus, Request};
use crate::mission::Cause;
use crate::types::Time;

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
            Stage::Stream if self.elapsed(now) >= config.stream_before_offboard => self.enter(Stage::Offboard, now),
            Stage::Offboard if autopilot.offboard => self.enter(Stage::Arm, now),
            Stage::Arm if autopilot.armed => self.enter(Stage::Climb, now),
            _ => {}
        }
        let request = match self.stage {
            Stage::Offboard => Request::Offboard,
            Stage::Arm => Request::Arm,
            Stage::Stream | Stage::Climb => return None,
        };
        repeat(&mut self.asked, now, config.request_period).then_some(request)
    }

    /// Which request the autopilot did not follow in time.
    #[must_use]
    pub fn refused(&self, config: &MissionConfig, now: Time) -> Option<Cause> {
        let cause = match self.stage {
            Stage::Offboard => Cause::OffboardRefused,
            Stage::Arm => Cause::ArmRefused,
            Stage::Stream | Stage::Climb => return None,
        };
        (self.elapsed(now) > config.request_timeout).then_some(cause)
    }

    fn enter(&mut self, stage: Stage, now: Time) {
        *self = Self { stage, since: now, asked: None };
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
