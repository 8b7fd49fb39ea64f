//! The order of a landing: brake, descend, notice the ground, stop the motors.

use crate::mission::config::MissionConfig;
use crate::mission::interface::{AutopilotStatus, Request};
use crate::mission::takeoff::repeat;
use crate::values::types::Time;

/// How far the landing is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// To a hover.
    Brake,
    /// Downward.
    Descend,
    /// On the ground: no thrust until disarmed.
    Cut,
}

/// One landing.
#[derive(Clone, Copy, Debug)]
pub struct Landing {
    phase: Phase,
    since: Time,
    /// The descent has been seen to move, so that a standstill means the ground.
    moved: bool,
    still_since: Option<Time>,
    asked: Option<Time>,
}

/// A hover that is not reached by then is not waited for, s. From 20 m/s the shipped hold brakes in 3.6 s.
const LONGEST_BRAKE: f64 = 4.0;
/// A descent that has not moved by then stands on the ground, s. Chosen by eye.
const LONGEST_ONSET: f64 = 2.5;
/// Vertical speed that counts as standing, m/s. Chosen by eye.
const STANDING: f64 = 0.1;
/// Falling faster than this with the motors cut means that it was not the ground, m/s. Chosen by eye.
const FALLING: f64 = 1.0;
/// Without a landed detector: how long after the cut to ask for disarming, s. Chosen by eye.
const CUT_BEFORE_DISARM: f64 = 1.0;
/// Who is not falling with the motors cut for so long lies somewhere, whatever the landed detector says, s. ArduPilot's
/// may never notice the ground under a thrust of nothing. Chosen by eye.
const CUT_BEFORE_FORCE: f64 = 5.0;

impl Landing {
    /// Begins at `now`.
    #[must_use]
    pub fn new(now: Time) -> Self {
        Self { phase: Phase::Brake, since: now, moved: false, still_since: None, asked: None }
    }

    /// Begins at `now` on the ground: the vehicle never left it.
    #[must_use]
    pub fn on_ground(now: Time) -> Self {
        Self { phase: Phase::Cut, ..Self::new(now) }
    }

    /// Where it is.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Moves on. `climb` is the vertical speed (m/s, upward); `stopped`: the hover is reached. What to ask now.
    pub fn step(
        &mut self,
        config: &MissionConfig,
        now: Time,
        climb: f64,
        stopped: bool,
        autopilot: &AutopilotStatus,
    ) -> Option<Request> {
        let elapsed = now.since(self.since);
        match self.phase {
            Phase::Brake => {
                if stopped || elapsed > LONGEST_BRAKE || autopilot.landed == Some(true) {
                    self.enter(Phase::Descend, now);
                }
                None
            }
            Phase::Descend => {
                if self.on_the_ground(config, now, climb, autopilot) {
                    self.enter(Phase::Cut, now);
                }
                None
            }
            Phase::Cut => {
                if climb < -FALLING {
                    self.enter(Phase::Descend, now);
                    return None;
                }
                let request = match autopilot.landed {
                    Some(true) => Some(Request::Disarm),
                    Some(false) => (autopilot.offboard && elapsed > CUT_BEFORE_FORCE).then_some(Request::DisarmAnyway),
                    None => (elapsed > CUT_BEFORE_DISARM).then_some(Request::Disarm),
                };
                request.filter(|_| repeat(&mut self.asked, now, config.request_period_s))
            }
        }
    }

    fn on_the_ground(&mut self, config: &MissionConfig, now: Time, climb: f64, autopilot: &AutopilotStatus) -> bool {
        self.moved |= climb < -0.5 * config.touchdown_speed_mps || now.since(self.since) > LONGEST_ONSET;
        if climb.abs() < STANDING {
            self.still_since.get_or_insert(now);
        } else {
            self.still_since = None;
        }
        let still = self.still_since.map_or(0.0, |since| now.since(since));
        let detector = autopilot.landed == Some(true) && climb.abs() < STANDING;
        detector || (self.moved && still >= config.touchdown_time_s)
    }

    fn enter(&mut self, phase: Phase, now: Time) {
        *self = Self { phase, ..Self::new(now) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;

    fn mission() -> MissionConfig {
        shipped::tuning().mission
    }
    const FLYING: AutopilotStatus =
        AutopilotStatus { connected: true, armed: true, offboard: true, landed: None, battery: None, position: None };

    /// Steps of 10 ms at a constant vertical speed, after a first one that ends the braking.
    fn descend(landing: &mut Landing, now: &mut Time, climb: f64, seconds: f64) -> Vec<Request> {
        let mut requests = Vec::new();
        for _ in 0..(seconds * 100.0) as u32 {
            *now = now.plus(0.01);
            requests.extend(landing.step(&mission(), *now, climb, true, &FLYING));
        }
        requests
    }

    #[test]
    fn a_descent_that_has_not_moved_yet_is_not_on_the_ground_until_it_had_time_to() {
        let (mut landing, mut now) = (Landing::new(Time(0)), Time(0));
        descend(&mut landing, &mut now, 0.0, 2.0);
        assert_eq!(landing.phase(), Phase::Descend);
        descend(&mut landing, &mut now, 0.0, 1.0);
        assert_eq!(landing.phase(), Phase::Cut);
    }

    #[test]
    fn a_moving_descent_that_stands_for_long_enough_is_on_the_ground_and_asks_to_disarm() {
        let (mut landing, mut now) = (Landing::new(Time(0)), Time(0));
        descend(&mut landing, &mut now, -0.6, 1.0);
        descend(&mut landing, &mut now, 0.0, 0.3);
        assert_eq!(landing.phase(), Phase::Descend);
        descend(&mut landing, &mut now, 0.0, 0.2);
        assert_eq!(landing.phase(), Phase::Cut);
        assert_eq!(descend(&mut landing, &mut now, 0.0, 3.2), [Request::Disarm; 3]);
    }

    #[test]
    fn a_landed_detector_that_never_notices_the_ground_is_overruled_while_our_thrust_is_followed() {
        for offboard in [true, false] {
            let airborne = AutopilotStatus { landed: Some(false), offboard, ..FLYING };
            let mut landing = Landing::on_ground(Time(0));
            let asked: Vec<_> = (1..=700)
                .filter_map(|k| landing.step(&mission(), Time(0).plus(0.01 * f64::from(k)), 0.0, true, &airborne))
                .collect();
            assert_eq!(asked, [Request::DisarmAnyway; 2][..if offboard { 2 } else { 0 }]);
        }
    }

    #[test]
    fn falling_with_the_motors_cut_descends_again() {
        let (mut landing, mut now) = (Landing::new(Time(0)), Time(0));
        descend(&mut landing, &mut now, -0.6, 1.0);
        descend(&mut landing, &mut now, 0.0, 0.5);
        assert_eq!(landing.phase(), Phase::Cut);
        descend(&mut landing, &mut now, -1.2, 0.02);
        assert_eq!(landing.phase(), Phase::Descend);
    }
}
