//! The controller: newest plan and odometry in, attitude and thrust out, at a fixed rate.
//!
//! One step takes in what is new, judges the facts, makes at most one transition of the mission, and then flies the
//! mode ([`Controller::fly`], in `flight.rs`). It answers in every step: while it has authority it is never silent.

use crate::control::hover::Hover;
use crate::control::motion::{Commanded, Motion};
use crate::control::plans::Plans;
use crate::control::separation::Separation;
use crate::gaze::Gaze;
use crate::mission::config::ControllerConfig;
use crate::mission::detour::Detour;
use crate::mission::interface::{AutopilotStatus, Command, ControllerOutput, Profile, Refusal, StepInput, Transition};
use crate::mission::landing::Landing;
use crate::mission::modes::{Cause, Mode, StopAction};
use crate::mission::takeoff::{Abandoned, Stage, Takeoff};
use crate::mission::transitions::transition;
use crate::planning::frame::PlanningDemand;
use crate::planning::plan::Plan;
use crate::values::error::ConfigError;
use crate::values::geometry::yaw_of;
use crate::values::types::{Odometry, Task, Time, Vec3};
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
    pub(crate) gaze: Gaze,
    pub(crate) hover: Hover,
    /// From the target, and from who looks like it elsewhere.
    pub(crate) separations: [Separation; 2],
    pub(crate) flight: Option<Flight>,
    /// Commanded in the last step.
    pub(crate) commanded: Commanded,
    /// In Fault: the autopilot is asked to take over; when last.
    pub(crate) handing_back: bool,
    pub(crate) asked_back: Option<Time>,
    /// The autopilot has called its position invalid since then.
    pub(crate) position_lost: Option<Time>,
    /// A take-off that was given up after the motors had been asked for.
    pub(crate) abandoned: Option<Abandoned>,
}

/// One flight from Start to the motors' stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flight {
    pub(crate) profile: Profile,
    pub(crate) start_world: Vec3,
    pub(crate) goal_world: Option<Vec3>,
    /// The goal, or what leads around a dead end.
    pub(crate) waypoint_world: Option<Vec3>,
    pub(crate) detour: Detour,
    pub(crate) takeoff: Takeoff,
    pub(crate) landing: Landing,
    pub(crate) begun: Time,
    pub(crate) was_offboard: bool,
    pub(crate) was_armed: bool,
    /// It has left the ground.
    pub(crate) lifted: bool,
    /// Stopped by operator or pilot, or for want of a way, to be hovered.
    pub(crate) held: bool,
    /// The battery has been low since then.
    pub(crate) battery_low: Option<Time>,
}

/// What was felt longer ago than this is not what is felt, s: a few samples of 100 Hz.
const LONGEST_FELT: f64 = 0.05;
/// A step longer than this is taken as this, s: 20 steps of 200 Hz. Chosen by eye.
const LONGEST_STEP: f64 = 0.1;

impl Flight {
    fn new(profile: Profile, start: &Odometry, now: Time) -> Self {
        let world_from_start = Rotation3::from_axis_angle(&Vec3::z_axis(), yaw_of(&start.world_from_body));
        let goal_world = profile.goal.map(|goal| start.pos_world + world_from_start * goal);
        Self {
            profile,
            start_world: start.pos_world,
            goal_world,
            waypoint_world: goal_world,
            detour: Detour::default(),
            takeoff: Takeoff::new(now),
            landing: Landing::new(now),
            begun: now,
            was_offboard: false,
            was_armed: false,
            lifted: false,
            held: false,
            battery_low: None,
        }
    }

    fn observe(&mut self, now: Time, autopilot: &AutopilotStatus, battery_land: f64) {
        let low = autopilot.battery.is_some_and(|charge| charge < battery_land);
        self.battery_low = self.battery_low.or(Some(now)).filter(|_| low);
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
            motion: config.motion(),
            plans: Plans::new(Time(0)),
            gaze: Gaze::new(config.gaze, config.yaw, config.view),
            hover: Hover::default(),
            separations: Default::default(),
            flight: None,
            commanded: Commanded::default(),
            handing_back: false,
            asked_back: None,
            position_lost: None,
            abandoned: None,
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

    /// One tick at `now`, with the plan that `input` names; one that it does not name is not looked at.
    pub fn step(&mut self, now: Time, input: &StepInput, plan: Option<&Plan>) -> ControllerOutput {
        let dt = self.last_step.map_or(0.0, |last| now.since(last).clamp(0.0, LONGEST_STEP));
        self.last_step = Some(now);
        self.take_odometry(input);
        let lost = input.autopilot.position == Some(false);
        self.position_lost = self.position_lost.or(Some(now)).filter(|_| lost);
        if let Some(flight) = &mut self.flight {
            flight.observe(now, &input.autopilot, self.config.limits.battery_land);
        }
        let named = plan.filter(|plan| input.plan_seq == Some(plan.seq));
        // A landing and a hover that was asked for follow nobody, but keep their distance from who is there.
        let stays = matches!(self.mode, Mode::Hold | Mode::Stopping) && self.keeps_apart();
        if let Some(plan) = named.filter(|_| stays || self.planning().is_some())
            && self.plans.take(plan)
        {
            self.gaze.take(plan.stamp, plan.target, &plan.candidates);
        }
        let readiness = self.readiness(now, input);
        let reply = input.command.map(|command| self.answer(&command, readiness));
        let happened = self.happened(now, input, readiness, reply);
        let transition = transition(self.mode, happened, &self.situation())
            .map(|(to, cause)| self.enter(now, to, cause, input.command));
        if let Some(flight) = self.flight.as_mut().filter(|_| reply == Some(Ok(()))) {
            match input.command {
                Some(Command::Stop) => flight.held = self.config.mission.on_stop == StopAction::Hover,
                Some(Command::Hold) => flight.held = true,
                Some(Command::Resume) => flight.held = false,
                _ => {}
            }
        }
        let mut output = self.fly(now, dt, input);
        (output.transition, output.reply, output.readiness) = (transition, reply, readiness);
        let fresh = input.imu.filter(|imu| now.since(imu.stamp).abs() < LONGEST_FELT);
        output.acc_meas_world = fresh.zip(self.motion.last()).map(|(imu, odometry)| imu.acc_world(odometry));
        output
    }

    fn take_odometry(&mut self, input: &StepInput) {
        let Some(odometry) = &input.odometry else { return };
        let Some(jump) = self.motion.take(odometry, &self.commanded) else { return };
        // The frame moved, the vehicle did not: move along whatever is remembered in it.
        self.hover.shift(jump.pos_world);
        self.gaze.shift(&jump);
        if let Some(flight) = &mut self.flight {
            flight.start_world += jump.pos_world;
            flight.goal_world = flight.goal_world.map(|goal| goal + jump.pos_world);
            flight.waypoint_world = flight.waypoint_world.map(|way| way + jump.pos_world);
            flight.detour.shift(jump.pos_world);
        }
    }

    /// The odometry to fly by; none: it is stale, or the autopilot whose it is calls it invalid.
    pub(crate) fn believed(&self, now: Time) -> Option<&Odometry> {
        self.motion.fresh(now, self.config.ladder.odometry_stale_s).filter(|_| self.position_lost.is_none())
    }

    fn readiness(&self, now: Time, input: &StepInput) -> Result<(), Refusal> {
        let autopilot = &input.autopilot;
        if !autopilot.connected {
            Err(Refusal::AutopilotSilent)
        } else if autopilot.armed || autopilot.landed == Some(false) {
            Err(Refusal::NotOnGround)
        } else if self.motion.fresh(now, self.config.ladder.odometry_stale_s).is_none() {
            Err(Refusal::OdometryStale)
        } else if self.position_lost.is_some() {
            Err(Refusal::NoPosition)
        } else if autopilot.battery.is_some_and(|charge| charge < self.config.limits.battery_start) {
            Err(Refusal::BatteryLow)
        } else if !input.ready {
            Err(Refusal::ChecksFailed)
        } else {
            Ok(())
        }
    }

    fn answer(&self, command: &Command, readiness: Result<(), Refusal>) -> Result<(), Refusal> {
        match (command, self.mode) {
            (Command::Stop | Command::Hold, _) => Ok(()),
            (Command::Resume, Mode::Hold) if self.flight.as_ref().is_some_and(|flight| flight.held) => Ok(()),
            (Command::Resume, _) => Err(Refusal::NotHeld),
            (Command::Start(_), mode) if mode.has_authority() => Err(Refusal::Flying),
            (Command::Start(_), Mode::Fault) => Err(Refusal::Faulted),
            (Command::Start(profile), _) if !profile.is_valid() => Err(Refusal::BadProfile),
            (Command::Start(profile), _) if self.config.limits.exceeded_by(profile).is_some() => {
                Err(Refusal::BeyondLimits)
            }
            (Command::Start(_), Mode::Ready) => readiness,
            // The next step will have moved on to Ready; ask again.
            (Command::Start(_), _) => readiness.and(Err(Refusal::ChecksFailed)),
        }
    }

    fn enter(&mut self, now: Time, to: Mode, cause: Cause, command: Option<Command>) -> Transition {
        let from = std::mem::replace(&mut self.mode, to);
        self.entered = now;
        let on_ground = self.flight.as_ref().is_some_and(|flight| !flight.lifted && flight.takeoff.has_asked_to_arm());
        let abandoned = on_ground && !to.has_authority() && !matches!(cause, Cause::Disarmed | Cause::TouchedDown);
        match to {
            Mode::Takeoff => {
                self.abandoned = None;
                if let (Some(Command::Start(profile)), Some(odometry)) = (command, self.motion.last()) {
                    self.flight = Some(Flight::new(profile, odometry, now));
                }
                self.plans = Plans::new(now);
                self.gaze.forget();
                self.hover.reset();
            }
            Mode::Search | Mode::Navigate if from == Mode::Takeoff => {
                if let Some(flight) = &self.flight {
                    self.hover.hold(Vec3::new(flight.start_world.x, flight.start_world.y, flight.height()));
                }
            }
            // What was seen before a hold says nothing of now, and its silence is no fault.
            Mode::Search | Mode::Navigate if cause == Cause::ResumeCommand => {
                self.plans = Plans::new(now);
                self.gaze.forget();
            }
            // Who resumes it tries again.
            Mode::Hold if cause == Cause::NoWay => {
                if let Some(flight) = &mut self.flight {
                    flight.held = true;
                }
            }
            Mode::Stopping => {
                if let Some(flight) = &mut self.flight {
                    flight.landing = if flight.lifted { Landing::new(now) } else { Landing::on_ground(now) };
                }
            }
            Mode::Idle | Mode::Ready | Mode::Landed | Mode::Fault => self.flight = None,
            _ => {}
        }
        if abandoned {
            self.abandoned = Some(Abandoned::new(now));
        }
        // Whoever took the mode, or the motors, has them already; what never left the ground is stopped instead.
        let ours = !matches!(cause, Cause::ModeTakenAway | Cause::Disarmed) && !abandoned;
        self.handing_back = to == Mode::Fault && ours;
        self.asked_back = None;
        Transition { from, to, cause }
    }

    /// What the planner should do in this mode.
    pub(crate) fn planning(&self) -> Option<PlanningDemand> {
        let flight = self.flight.as_ref()?;
        let profile = &flight.profile;
        let wanted = match self.mode {
            Mode::Takeoff => flight.takeoff.stage() == Stage::Climb,
            Mode::Track | Mode::Navigate | Mode::Search => true,
            Mode::Hold => profile.task == Task::Track && !flight.held,
            _ => false,
        };
        let goal_world = flight.waypoint_world;
        wanted.then_some(PlanningDemand { task: profile.task, speed: profile.speed, goal_world })
    }
}
