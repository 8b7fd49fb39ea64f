//! What the mission heeds: in every step the events are judged from odometry, plans, autopilot, command and clock.

use crate::mission::controller::Controller;
use crate::mission::interface::{Command, Refusal, StepInput};
use crate::mission::landing::Phase;
use crate::mission::modes::{Cause, Mode};
use crate::mission::takeoff::Stage;
use crate::mission::transitions::{Happened, Situation};
use crate::values::types::{Odometry, Task, Time};

/// A target that moved faster than this when it was seen last, m/s, is not looked for on the spot. Chosen by eye.
const RUNS: f64 = 1.0;
/// A fault is shown at least this long, s. Chosen by eye.
const FAULT_SHOWN: f64 = 3.0;
/// The climb is over this near the height, m, and below this speed, m/s. Chosen by eye.
const HEIGHT_REACHED: (f64, f64) = (0.2, 0.5);
/// A climb may take twice its time and this much more, s. Chosen by eye.
const CLIMB_GRACE: f64 = 8.0;
/// The battery must be low for so long, s: a single report may be wrong, and a landing is for good. Chosen by eye.
const BATTERY_LOW_FOR: f64 = 1.0;

impl Controller {
    /// What the transition table may depend on.
    pub(crate) fn situation(&self) -> Situation {
        let flight = self.flight.as_ref();
        Situation {
            task: flight.map_or(Task::Track, |f| f.profile.task),
            was_armed: flight.is_some_and(|f| f.was_armed),
            held: flight.is_some_and(|f| f.held),
            on_stop: self.config.mission.on_stop,
        }
    }

    /// The events of this step.
    pub(crate) fn happened(
        &self,
        now: Time,
        input: &StepInput,
        readiness: Result<(), Refusal>,
        reply: Option<Result<(), Refusal>>,
    ) -> Happened {
        let accepted = reply == Some(Ok(()));
        let happened = Happened::default()
            .with(Cause::StopCommand, accepted && input.command == Some(Command::Stop))
            .with(Cause::HoldCommand, accepted && input.command == Some(Command::Hold))
            .with(Cause::ResumeCommand, accepted && input.command == Some(Command::Resume))
            .with(Cause::StartCommand, accepted && matches!(input.command, Some(Command::Start(_))))
            .with(Cause::ChecksPassed, readiness.is_ok())
            .with(Cause::CheckFailed, readiness.is_err())
            .with(Cause::FaultOver, !input.autopilot.armed && now.since(self.entered) > FAULT_SHOWN);
        self.task_events(now, self.flight_events(now, input, happened))
    }

    /// What ends a flight, and the take-off's.
    fn flight_events(&self, now: Time, input: &StepInput, happened: Happened) -> Happened {
        let Some(flight) = &self.flight else { return happened };
        let (autopilot, limits, hold) = (&input.autopilot, &self.config.limits, &self.config.hold);
        let odometry = self.believed(now);
        let disarmed = flight.was_armed && !autopilot.armed;
        let refused = flight.takeoff.refused(&self.config.mission, now);
        let climbing = flight.takeoff.stage() == Stage::Climb;
        let longest_climb = 2.0 * flight.profile.height / self.config.mission.climb_speed_mps + CLIMB_GRACE;
        let beyond = odometry.map(|o| {
            let from_start = o.pos_world - flight.start_world;
            let fence = limits.reaches_fence(hold, from_start, o.vel_world);
            // A way over a target ends below the ceiling by itself, and brakes harder than a hover.
            let over = self.evading(now).is_some_and(|evasion| evasion.height.is_some());
            let reaches = limits.reaches_ceiling(hold, from_start, o.vel_world);
            (fence, if over { from_start.z > limits.ceiling_m } else { reaches })
        });
        let height_reached = odometry.is_some_and(|o| {
            (o.pos_world.z - flight.height()).abs() < HEIGHT_REACHED.0 && o.vel_world.norm() < HEIGHT_REACHED.1
        });
        happened
            .with(Cause::TouchedDown, disarmed)
            .with(Cause::Disarmed, disarmed)
            .with(Cause::ModeTakenAway, flight.was_offboard && !autopilot.offboard)
            .with(Cause::OdometryLost, self.odometry_lost(now))
            .with(Cause::OdometryFalse, self.odometry_false(now))
            .with(Cause::PositionLost, self.position_stays_lost(now))
            .with(Cause::AutopilotLost, !autopilot.connected)
            .with(Cause::BatteryLow, flight.battery_low.is_some_and(|since| now.since(since) > BATTERY_LOW_FOR))
            .with(Cause::FenceReached, beyond.is_some_and(|b| b.0))
            .with(Cause::CeilingReached, beyond.is_some_and(|b| b.1))
            .with(Cause::TimeUp, now.since(flight.begun) > limits.max_time_s)
            .with(Cause::OffboardRefused, refused == Some(Cause::OffboardRefused))
            .with(Cause::ArmRefused, refused == Some(Cause::ArmRefused))
            .with(Cause::HeightReached, climbing && flight.lifted && height_reached)
            .with(Cause::TakeoffTimeout, climbing && flight.takeoff.elapsed(now) > longest_climb)
    }

    /// The chase's and the navigation's.
    fn task_events(&self, now: Time, happened: Happened) -> Happened {
        let Some(flight) = &self.flight else { return happened };
        let (ladder, mission) = (&self.config.ladder, &self.config.mission);
        let odometry = self.believed(now);
        // A goal that is held and a hover that was asked for need no plan and follow nobody.
        let planning = self.planning().is_some();
        let flyable = self.plans.flyable(ladder, flight.profile.task, now).is_some();
        let confirmed = self.gaze.target().is_some_and(|target| target.confirmed);
        let gap = odometry.and_then(|o| self.gap(now, o)).filter(|_| confirmed && planning);
        let lost = match self.mode {
            Mode::Track => !flyable && self.hover.is_stopped(),
            _ => !confirmed,
        };
        let last = self.gaze.target().filter(|_| planning && !confirmed);
        let ran = last.is_some_and(|target| target.vel_world.xy().norm() > RUNS);
        let moved_off = ran || gap.is_some_and(|(gap, _)| gap > mission.resume_distance_m);
        let at_goal = odometry
            .zip(flight.goal_world)
            .is_some_and(|(o, goal)| (goal - o.pos_world).norm() < mission.goal_radius_m);
        happened
            .with(Cause::NoPlan, planning && self.plans.silence(now) > ladder.no_plan_land_s)
            .with(Cause::CaughtUp, gap.is_some_and(|(gap, opening)| gap < mission.hold_distance_m && opening < 0.0))
            .with(Cause::GoalReached, at_goal)
            .with(Cause::NoWay, flight.detour.found_none())
            .with(Cause::TargetMovedOff, flyable && moved_off)
            .with(Cause::TargetConfirmed, flyable && confirmed)
            .with(Cause::TargetLost, planning && self.plans.frames_arrive(ladder, now) && lost)
            .with(Cause::SearchTimeout, now.since(self.entered) > mission.search_timeout_s)
    }

    /// Horizontal distance to the target (m) and how fast it opens (m/s).
    fn gap(&self, now: Time, odometry: &Odometry) -> Option<(f64, f64)> {
        let target = self.gaze.target_at(now)?;
        let line = (target.pos - odometry.pos_world).xy();
        let opening = (target.vel - odometry.vel_world).xy().dot(&line) / line.norm().max(1e-6);
        Some((line.norm(), opening))
    }

    /// Before the climb stale odometry ends the flight at once; in the air only after the descent without it.
    fn odometry_lost(&self, now: Time) -> bool {
        let stale = self.config.ladder.odometry_stale_s;
        self.blind_for().is_some_and(|grace| self.motion.age(now).is_none_or(|age| age > stale + grace))
    }

    /// The autopilot's word that its position is not valid, likewise.
    fn position_stays_lost(&self, now: Time) -> bool {
        let lost = self.position_lost.map(|since| now.since(since));
        self.blind_for().zip(lost).is_some_and(|(grace, lost)| lost >= grace)
    }

    /// How long this mode goes on without odometry, s; none: as long as it likes, on the ground with the motors cut.
    fn blind_for(&self) -> Option<f64> {
        let flight = self.flight.as_ref()?;
        let on_ground = self.mode == Mode::Stopping && flight.landing.phase() == Phase::Cut;
        let before_climb = self.mode == Mode::Takeoff && flight.takeoff.stage() != Stage::Climb;
        let grace = if before_climb { 0.0 } else { self.config.ladder.hand_back_s };
        (!on_ground).then_some(grace)
    }

    /// What is not believed for as long as a descent without odometry may take is handed back.
    fn odometry_false(&self, now: Time) -> bool {
        self.motion.distrust().is_some_and(|distrust| now.since(distrust.since) > self.config.ladder.hand_back_s)
    }
}
