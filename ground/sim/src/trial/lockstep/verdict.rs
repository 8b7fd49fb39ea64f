//! When a flight is over, and how it ended.

use goshawk_core::{Mode, Time};

use super::super::Outcome;
use super::super::judge::{Contact, TOO_CLOSE_M, contact};
use super::{CLEARANCE_STEPS, Lockstep};

/// Success of a chase: at most this far behind when the evader arrives, and seen this recently.
const CAUGHT_UP_M: f64 = 12.0;
const SEEN_WITHIN_S: f64 = 1.0;
/// After its arrival the evader stands for so long, s, and the vehicle must not come too close to it.
const STANDS_S: f64 = 5.0;
/// A chase is over when the target has not been seen for so long and is so far away.
const GONE_S: f64 = 8.0;
const GONE_M: f64 = 25.0;
/// Success of a navigation.
const GOAL_RADIUS_M: f64 = 2.0;
/// The take-off may take this long, a navigation this long beyond its way at a quarter of its speed, s.
const TAKEOFF_S: f64 = 25.0;
const NAVIGATION_GRACE_S: f64 = 20.0;

/// After a fault the vehicle is down within this, or it flies on, s: the ladder holds for 20 s before it lands.
const DOWN_AFTER_FAULT_S: f64 = 40.0;

impl Lockstep<'_> {
    /// None: it goes on.
    pub(super) fn verdict(&mut self, now: Time) -> Option<(Outcome, Option<Contact>)> {
        let since_start = now.since(self.started.unwrap_or(Time::from_secs(1.0)));
        if self.up.is_none() {
            let failed = matches!(self.mode, Mode::Fault | Mode::Stopping) || since_start > TAKEOFF_S;
            return failed.then_some((Outcome::Timeout, None));
        }
        let at = self.quad.state().pos_world;
        let evader = self.scene.evader_at(self.running_for(now));
        // Whoever lands is to touch the ground.
        let airborne = !matches!(self.mode, Mode::Stopping | Mode::Landed);
        if self.step.is_multiple_of(CLEARANCE_STEPS)
            && let Some(touched) =
                contact(&self.scene.world, &self.moving, &at, self.clearance_m, evader.as_ref(), airborne)
        {
            return Some((Outcome::Collision, Some(touched)));
        }
        if let Some(begun) = self.injection.begun() {
            let down = matches!(self.mode, Mode::Landed | Mode::Fault);
            let outcome = if down { Some(Outcome::Success) } else { None };
            let flew_on = now.since(begun) > DOWN_AFTER_FAULT_S;
            return outcome.or(flew_on.then_some(Outcome::Timeout)).map(|outcome| (outcome, None));
        }
        let given_up = matches!(self.mode, Mode::Stopping | Mode::Landed | Mode::Fault);
        let outcome = if let Some(evader) = evader {
            let distance = (evader.centre_world() - at).norm();
            if evader.arrived {
                let behind = distance <= CAUGHT_UP_M && self.judge.seen(now, SEEN_WITHIN_S);
                let judged = if behind { Outcome::Success } else { Outcome::Lost };
                let (arrived, judged) = *self.arrived.get_or_insert((now, judged));
                (now.since(arrived) >= STANDS_S).then(|| self.unless_too_close(judged))
            } else {
                let gone = distance > GONE_M && !self.judge.seen(now, GONE_S) && self.in_task(now);
                (gone || given_up).then_some(Outcome::Lost)
            }
        } else {
            let way = (self.scene.goal_world - self.scene.world.start_world()).norm();
            let limit = NAVIGATION_GRACE_S + way / (0.25 * self.config.speed_mps);
            let late = self.up.is_some_and(|up| now.since(up) > limit);
            if (self.goal_world() - at).norm() <= GOAL_RADIUS_M {
                Some(Outcome::Success)
            } else {
                (late || given_up).then_some(Outcome::Timeout)
            }
        };
        outcome.map(|outcome| (outcome, None))
    }

    /// A chase that came too close to its target is no success.
    fn unless_too_close(&self, outcome: Outcome) -> Outcome {
        let too_close = self.judge.metrics.target_distance_min_m.is_some_and(|least| least < TOO_CLOSE_M);
        if outcome == Outcome::Success && too_close { Outcome::TooClose } else { outcome }
    }
}
