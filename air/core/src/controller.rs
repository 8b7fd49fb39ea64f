//! The controller: newest plan and odometry in, attitude and thrust out, at a fixed rate.
//!
//! One step takes in what is new, judges the facts, makes at most one transition of the mission, and then flies the
//! mode ([`Controller::fly`], in `flight.rs`). It answers in every step: while it has authority it is never silent.

use crate::config::ControllerConfig;
use crate::error::ConfigError;
use crate::hover::Hover;
use crate::interface::{
    AutopilotStatus, Command, ControllerInput, ControllerOutput, PlanningDemand, Profile, Refusal, Transition,
};
use crate::landing::{Landing, Phase};
use crate::mission::{Cause, Facts, Mode, transition};
use crate::motion::Motion;
use crate::plans::Plans;
use crate::takeoff::{Stage, Takeoff};
use crate::types::{Newtons, Odometry, Task, Time, Vec3};
use crate::yaw::{YawPlanner, yaw_of};
use nalgebra::Rotation3;

/// Mission, fallback ladder, observer, yaw and flatness in one fixed-rate step.
#[derive(Clone, Debug)]
pub struct Controller {
    pub(crate) config: ControllerConfig,
    pub(crate) mode: Mode,
    pub(crate) entered: Time,
    pub(crate) last_step: Option<Time>,
    pub(crate) motion: Motion,
    pub(crate) plans: Plans,
    pub(crate) yaw: YawPlanner,
    pub(crate) hover: Hover,
    pub(crate) flight: Option<Flight>,
    /// Commanded in the last step.
    pub(crate) force: Newtons,
    /// The sweep's direction; its sign counts.
    pub(crate) sweep: f64,
    /// In Fault: the autopilot is asked to take over; when last.
    pub(crate) handing_back: bool,
    pub(crate) asked_back: Option<Time>,
}

/// One flight from Start to the motors' stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flight {
    pub(crate) profile: Profile,
    pub(crate) start_world: Vec3,
    pub(crate) goal_world: Option<Vec3>,
    pub(crate) takeoff: Takeoff,
    pub(crate) landing: Landing,
    was_offboard: bool,
    was_armed: bool,
}

/// A fault is shown at least this long, s.
const FAULT_SHOWN: f64 = 3.0;
/// A step longer than this is taken as this, s.
const LONGEST_STEP: f64 = 0.1;
/// A target counts as seen for this long, s: a few frames and the planner's time.
const SEEN_NOW: f64 = 0.15;
/// The climb is over this near the height, m, and below this speed, m/s.
const HEIGHT_REACHED: (f64, f64) = (0.2, 0.5);
/// A climb may take twice its time and this much more, s.
const CLIMB_GRACE: f64 = 8.0;

impl Flight {
    fn new(profile: Profile, start: &Odometry, now: Time) -> Self {
        let world_from_start = Rotation3::from_axis_angle(&Vec3::z_axis(), yaw_of(&start.world_from_body));
        Self {
            profile,
            start_world: start.pos_world,
            goal_world: profile.goal.map(|goal| start.pos_world + world_from_start * goal),
            takeoff: Takeoff::new(now),
            landing: Landing::new(now),
            was_offboard: false,
            was_armed: false,
        }
    }

    fn observe(&mut self, autopilot: &AutopilotStatus) {
        self.was_offboard |= autopilot.offboard && self.takeoff.stage() != Stage::Stream;
        self.was_armed |= autopilot.armed && self.takeoff.stage() != Stage::Stream;
    }

    /// Height of the climb's end, m.
    pub(crate) fn height(&self) -> f64 {
        self.start_world.z + self.profile.height
    }
}

impl Controller {
    /// A controller in `Idle`.
    ///
    /// # Errors
    /// A value that cannot be flown with.
    pub fn new(config: ControllerConfig) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self {
            mode: Mode::Idle,
            entered: Time(0),
            last_step: None,
            motion: Motion::new(config.observer),
            plans: Plans::new(Time(0)),
            yaw: YawPlanner::new(config.yaw),
            hover: Hover::default(),
            flight: None,
            force: Newtons(0.0),
            sweep: 1.0,
            handing_back: false,
            asked_back: None,
            config,
        })
    }

    /// The configuration that it flies with.
    #[must_use]
    pub fn config(&self) -> &ControllerConfig {
        &self.config
    }

    /// The mode after the last step.
    #[must_use]
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// One tick at `now`.
    pub fn step(&mut self, now: Time, input: &ControllerInput) -> ControllerOutput {
        let dt = self.last_step.map_or(0.0, |last| now.since(last).clamp(0.0, LONGEST_STEP));
        self.last_step = Some(now);
        self.take_odometry(input);
        if let Some(flight) = &mut self.flight {
            flight.observe(&input.autopilot);
        }
        if let Some(plan) = input.plan.filter(|_| self.planning().is_some()) {
            self.plans.take(plan);
        }
        let readiness = self.readiness(now, input);
        let reply = input.command.map(|command| self.answer(&command, readiness));
        let facts = self.facts(now, input, readiness, reply);
        let transition = transition(self.mode, &facts).map(|(to, cause)| self.enter(now, to, cause, input.command));
        let mut output = self.fly(now, dt, input);
        (output.transition, output.reply, output.readiness) = (transition, reply, readiness);
        output
    }

    fn take_odometry(&mut self, input: &ControllerInput) {
        let Some(odometry) = input.odometry else { return };
        let Some(jump) = self.motion.take(odometry, self.force.0 / self.config.vehicle.mass) else { return };
        // The frame moved, the vehicle did not: move along whatever is remembered in it.
        self.hover.shift(jump.pos_world);
        self.plans.shift(jump.pos_world);
        self.yaw.shift(jump.yaw);
        if let Some(flight) = &mut self.flight {
            flight.start_world += jump.pos_world;
            flight.goal_world = flight.goal_world.map(|goal| goal + jump.pos_world);
        }
    }

    fn readiness(&self, now: Time, input: &ControllerInput) -> Result<(), Refusal> {
        let autopilot = &input.autopilot;
        if !autopilot.connected {
            Err(Refusal::AutopilotSilent)
        } else if autopilot.armed || autopilot.landed == Some(false) {
            Err(Refusal::NotOnGround)
        } else if self.motion.fresh(now, self.config.ladder.odometry_stale).is_none() {
            Err(Refusal::OdometryStale)
        } else if !input.ready {
            Err(Refusal::ChecksFailed)
        } else {
            Ok(())
        }
    }

    fn answer(&self, command: &Command, readiness: Result<(), Refusal>) -> Result<(), Refusal> {
        match (command, self.mode) {
            (Command::Stop, _) => Ok(()),
            (Command::Start(_), mode) if mode.has_authority() => Err(Refusal::Flying),
            (Command::Start(_), Mode::Fault) => Err(Refusal::Faulted),
            (Command::Start(profile), _) if !profile.is_valid() => Err(Refusal::BadProfile),
            (Command::Start(_), Mode::Ready) => readiness,
            // The next step will have moved on to Ready; ask again.
            (Command::Start(_), _) => readiness.and(Err(Refusal::ChecksFailed)),
        }
    }

    fn facts(
        &self,
        now: Time,
        input: &ControllerInput,
        readiness: Result<(), Refusal>,
        reply: Option<Result<(), Refusal>>,
    ) -> Facts {
        let accepted = reply == Some(Ok(()));
        let (ladder, mission) = (&self.config.ladder, &self.config.mission);
        let flight = self.flight.as_ref();
        let task = flight.map_or(Task::Track, |f| f.profile.task);
        let odometry = self.motion.fresh(now, ladder.odometry_stale);
        let frames = self.plans.frames_arrive(ladder, now);
        let flyable = self.plans.flyable(ladder, task, now).is_some();
        let confirmed = self.plans.target().is_some_and(|target| target.confirmed);
        let gap = odometry.and_then(|o| self.gap(now, o)).filter(|_| confirmed);
        let distance = |goal: &Vec3| odometry.map(|o| (goal - o.pos_world).norm());
        let goal_distance = flight.and_then(|f| f.goal_world.as_ref().and_then(distance));
        let climbing = flight.filter(|f| f.takeoff.stage() == Stage::Climb);
        Facts {
            task,
            start: accepted && matches!(input.command, Some(Command::Start(_))),
            stop: accepted && input.command == Some(Command::Stop),
            ready: readiness.is_ok(),
            was_armed: flight.is_some_and(|f| f.was_armed),
            disarmed: flight.is_some_and(|f| f.was_armed && !input.autopilot.armed),
            mode_taken: flight.is_some_and(|f| f.was_offboard && !input.autopilot.offboard),
            odometry_lost: self.odometry_lost(now),
            refused: flight.and_then(|f| f.takeoff.refused(mission, now)),
            takeoff_timeout: climbing
                .is_some_and(|f| f.takeoff.elapsed(now) > 2.0 * f.profile.height / mission.climb_speed + CLIMB_GRACE),
            height_reached: climbing.zip(odometry).is_some_and(|(f, o)| {
                (o.pos_world.z - f.height()).abs() < HEIGHT_REACHED.0 && o.vel_world.norm() < HEIGHT_REACHED.1
            }),
            target_chosen: flyable && confirmed,
            target_lost: frames
                && match self.mode {
                    Mode::Track => !flyable && self.hover.is_stopped(),
                    _ => !confirmed,
                },
            caught_up: gap.is_some_and(|(gap, opening)| gap < mission.hold_distance && opening < 0.0),
            moved_off: gap.is_some_and(|(gap, _)| gap > mission.resume_distance),
            goal_reached: goal_distance.is_some_and(|d| d < mission.goal_radius),
            no_plan: self.plans.silence(now) > ladder.no_plan_land,
            search_timeout: self.mode == Mode::Search && now.since(self.entered) > mission.search_timeout,
            fault_over: !input.autopilot.armed && now.since(self.entered) > FAULT_SHOWN,
        }
    }

    /// Horizontal distance to the target (m) and how fast it opens (m/s).
    fn gap(&self, now: Time, odometry: &Odometry) -> Option<(f64, f64)> {
        let target = self.plans.target_at(now)?;
        let line = (target.pos - odometry.pos_world).xy();
        let opening = (target.vel - odometry.vel_world).xy().dot(&line) / line.norm().max(1e-6);
        Some((line.norm(), opening))
    }

    /// Before the climb stale odometry ends the flight at once; in the air only after the descent without it.
    fn odometry_lost(&self, now: Time) -> bool {
        let Some(flight) = &self.flight else { return false };
        let ladder = &self.config.ladder;
        let grace =
            if self.mode == Mode::Takeoff && flight.takeoff.stage() != Stage::Climb { 0.0 } else { ladder.hand_back };
        let on_ground = self.mode == Mode::Stopping && flight.landing.phase() == Phase::Cut;
        !on_ground && self.motion.age(now).is_none_or(|age| age > ladder.odometry_stale + grace)
    }

    fn enter(&mut self, now: Time, to: Mode, cause: Cause, command: Option<Command>) -> Transition {
        let from = std::mem::replace(&mut self.mode, to);
        self.entered = now;
        match to {
            Mode::Takeoff => {
                if let (Some(Command::Start(profile)), Some(odometry)) = (command, self.motion.last()) {
                    self.flight = Some(Flight::new(profile, odometry, now));
                }
                self.plans = Plans::new(now);
                self.hover.reset();
            }
            Mode::Search | Mode::Navigate if from == Mode::Takeoff => {
                if let Some(flight) = &self.flight {
                    self.hover.hold(Vec3::new(flight.start_world.x, flight.start_world.y, flight.height()));
                }
            }
            Mode::Stopping => {
                if let Some(flight) = &mut self.flight {
                    flight.landing = Landing::new(now);
                }
            }
            Mode::Idle | Mode::Ready | Mode::Landed | Mode::Fault => self.flight = None,
            _ => {}
        }
        let ours = matches!(cause, Cause::OdometryLost | Cause::OffboardRefused | Cause::ArmRefused);
        self.handing_back = to == Mode::Fault && ours;
        self.asked_back = None;
        Transition { from, to, cause }
    }

    /// Remembers to which side a target would leave, as long as it is seen.
    pub(crate) fn watch_side(&mut self, now: Time) {
        if self.plans.target().is_some_and(|target| now.since(target.last_seen) < SEEN_NOW) {
            self.sweep = self.sweep_direction();
        }
    }

    /// Where the target is heading, seen from us; else the side where it is.
    fn sweep_direction(&self) -> f64 {
        let (Some(target), Some(odometry)) = (self.plans.target(), self.motion.last()) else { return self.sweep };
        let line = target.pos_world - odometry.pos_world;
        let crossing = line.x * target.vel_world.y - line.y * target.vel_world.x;
        let side = (odometry.world_from_body.inverse() * line).y;
        if crossing.abs() > 0.5 * line.xy().norm() { crossing } else { side }
    }

    /// What the planner should do in this mode.
    pub(crate) fn planning(&self) -> Option<PlanningDemand> {
        let flight = self.flight.as_ref()?;
        let profile = &flight.profile;
        let wanted = match self.mode {
            Mode::Takeoff => flight.takeoff.stage() == Stage::Climb,
            Mode::Track | Mode::Navigate | Mode::Search => true,
            Mode::Hold => profile.task == Task::Track,
            _ => false,
        };
        wanted.then_some(PlanningDemand { task: profile.task, speed: profile.speed, goal_world: flight.goal_world })
    }
}
