//! The autopilot of a lockstep flight: it grants every request at once and passes the setpoints on a little late.

use std::collections::VecDeque;

use goshawk_core::{AttitudeThrust, AutopilotStatus, ControllerOutput, Request, Time};

/// From a setpoint being sent to the attitude loop following it, s: what a real PX4 takes.
const SETPOINT_DELAY_S: f64 = 0.003;

/// An obliging autopilot.
#[derive(Clone, Debug, Default)]
pub(super) struct Obliging {
    armed: bool,
    offboard: bool,
    sent: VecDeque<(Time, AttitudeThrust)>,
    followed: Option<AttitudeThrust>,
}

impl Obliging {
    /// Takes what the controller sends and asks.
    pub(super) fn take(&mut self, now: Time, output: &ControllerOutput) {
        match output.request {
            Some(Request::Offboard) => self.offboard = true,
            Some(Request::Arm) => self.armed = true,
            Some(Request::Disarm | Request::DisarmAnyway) => self.armed = false,
            Some(Request::HandBack) => self.offboard = false,
            None => {}
        }
        if let Some(setpoint) = output.setpoint {
            self.sent.push_back((now, setpoint));
        }
    }

    /// What the attitude loop follows at `now`; none: the motors are stopped.
    pub(super) fn demand(&mut self, now: Time) -> Option<AttitudeThrust> {
        while let Some((_, setpoint)) = self.sent.front().filter(|(at, _)| now >= at.plus(SETPOINT_DELAY_S)) {
            self.followed = Some(*setpoint);
            self.sent.pop_front();
        }
        self.followed.filter(|_| self.armed)
    }

    /// Its state, given whether the vehicle stands and the battery's charge.
    pub(super) fn status(&self, on_ground: bool, battery: f64) -> AutopilotStatus {
        let (armed, offboard) = (self.armed, self.offboard);
        let (landed, battery) = (Some(on_ground), Some(battery));
        AutopilotStatus { connected: true, armed, offboard, landed, battery, position: Some(true) }
    }
}
