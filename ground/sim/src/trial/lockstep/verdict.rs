//! When a flight is over, and how it ended.

use goshawk_core::{Mode, Time};

use super::super::Outcome;
use super::super::judge::{Contact, contact};
use super::super::rule::{self, Chase, GOAL_RADIUS_M, SEEN_WITHIN_S};
use super::{CLEARANCE_STEPS, Lockstep};

/// After its arrival the evader stands for so long, s, and the vehicle must not come too close to it.
const STANDS_S: f64 = 5.0;
/// A chase is over when the target has not been seen for so long and is so far away.
const GONE_S: f64 = 8.0;
const GONE_M: f64 = 25.0;
/// The take-off may take this long beyond its climb, a navigation beyond its way at a quarter of its speed, s.
pub(super) const TAKEOFF_S: f64 = 25.0;
const NAVIGATION_GRACE_S: f64 = 20.0;

/// After a fault the vehicle is down within this, or it flies on, s: the ladder holds for 20 s before it lands.
const DOWN_AFTER_FAULT_S: f64 = 40.0;

/// The end of a flight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ending {
    pub(super) outcome: Outcome,
    /// A success by the lax rule.
    pub(super) reached: bool,
    pub(super) contact: Option<Contact>,
}

impl Ending {
    fn failed(outcome: Outcome) -> Self {
        Self { outcome, reached: false, contact: None }
    }
}

/// How a chase stood when the evader arrived.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrived {
    at: Time,
    distance_m: f64,
    seen: bool,
}

impl Lockstep<'_> {
    /// None: it goes on.
    pub(super) fn verdict(&mut self, now: Time) -> Option<Ending> {
        let started = self.started?;
        let at = self.quad.state().pos_world;
        let given_up = !self.mode.has_authority() || self.mode == Mode::Stopping;
        // Whoever lifts off or lands is to touch the ground.
        let airborne = self.up.is_some() && !given_up;
        if self.step.is_multiple_of(CLEARANCE_STEPS)
            && let Some(touched) =
                contact(&self.scene.world, &self.moving, &at, self.clearance_m, self.evader.as_ref(), airborne)
        {
            return Some(Ending { contact: Some(touched), ..Ending::failed(Outcome::Collision) });
        }
        if self.up.is_none() {
            let failed = given_up || now.since(started) > self.takeoff_s;
            return failed.then(|| Ending::failed(Outcome::Timeout));
        }
        if let Some(begun) = self.injection.begun() {
            let down = matches!(self.mode, Mode::Landed | Mode::Fault);
            let flew_on = now.since(begun) > DOWN_AFTER_FAULT_S;
            let ended = down.then_some(Ending { outcome: Outcome::Success, reached: true, contact: None });
            return ended.or(flew_on.then(|| Ending::failed(Outcome::Timeout)));
        }
        if let Some(evader) = self.evader {
            let distance_m = (evader.centre_world() - at).norm();
            if evader.arrived {
                return self.chase_ending(now, distance_m);
            }
            let gone = distance_m > GONE_M && !self.judge.seen(now, GONE_S) && self.in_task(now);
            return (gone || given_up).then(|| Ending::failed(Outcome::Lost));
        }
        if (self.goal_world() - at).norm() <= GOAL_RADIUS_M {
            let outcome = rule::navigation(self.judge.metrics.cruise_mps(), self.config.speed_mps);
            return Some(Ending { outcome, reached: true, contact: None });
        }
        let way = (self.scene.goal_world - self.scene.world.start_world()).norm();
        let limit = NAVIGATION_GRACE_S + way / (0.25 * self.config.speed_mps);
        let late = self.up.is_some_and(|up| now.since(up) > limit);
        (late || given_up).then(|| Ending::failed(Outcome::Timeout))
    }

    /// Of a chase whose target, `distance_m` away, stands at its end; none: it must stand on.
    fn chase_ending(&mut self, now: Time, distance_m: f64) -> Option<Ending> {
        let seen = self.judge.seen(now, SEEN_WITHIN_S);
        let arrived = *self.arrived.get_or_insert(Arrived { at: now, distance_m, seen });
        if now.since(arrived.at) < STANDS_S {
            return None;
        }
        let metrics = &self.judge.metrics;
        let chase = Chase {
            end_m: arrived.distance_m,
            seen: arrived.seen,
            far_s: metrics.far_s,
            in_view: metrics.frames_in_view as f64 / metrics.frames.max(1) as f64,
            least_m: metrics.target_distance_min_m.unwrap_or(f64::INFINITY),
        };
        Some(Ending { outcome: chase.outcome(), reached: chase.reached(), contact: None })
    }
}
