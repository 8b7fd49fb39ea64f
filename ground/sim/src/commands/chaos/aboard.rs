//! The vehicle's software in a chaos flight: its edges, its planner and its controller, with what the onboard process
//! keeps between them, in one thread and on a clock that is told.

use goshawk_autopilot::Status;
use goshawk_core::{
    Command, ControllerOutput, FlightController, FrameRecord, History, Mode, Odometry, Plan, PlanningDemand, Profile,
    StepInput, Time,
};
use goshawk_policy::{AnswerMonitor, Arrival, Moving, StreamMonitor};
use goshawk_vehicle::config::{OdometrySource, Vehicle};
use goshawk_vehicle::sensors::{self, Frame};

use super::bug::Bugged;
use crate::sense::rgbd::RgbdImage;
use crate::trial::TrialError;
use crate::trial::airframe::Mount;
use crate::trial::onboard::{Network, POLICY_S, PolicyPlanner, Seen};

/// A plan under way: it reaches the controller at `ready`.
struct Making {
    ready: Time,
    planned: Planned,
    /// The network is dead: it is recorded and not flown.
    withheld: bool,
}

/// A plan with what it was made from.
pub(super) struct Planned {
    pub(super) plan: Plan,
    pub(super) record: FrameRecord,
}

/// One step of the controller, with all that it was given.
pub(super) struct Stepped {
    pub(super) seq: u64,
    pub(super) input: StepInput,
    pub(super) output: ControllerOutput,
    /// Its odometry is new.
    pub(super) fresh: bool,
    /// A flight begins.
    pub(super) started: bool,
}

/// Edges, planner, controller.
pub(super) struct Aboard<'a> {
    source: OdometrySource,
    controller: Bugged<FlightController>,
    planner: PolicyPlanner<'a>,
    stream: StreamMonitor,
    answers: AnswerMonitor,
    history: History,
    /// The newest of the odometry's slot.
    arrived: Option<Odometry>,
    odometry: Option<Odometry>,
    plan: Option<Plan>,
    demand: PlanningDemand,
    mode: Mode,
    /// Counts accepted starts.
    flight: u64,
    frame: Option<Frame>,
    making: Option<Making>,
    plans: u64,
    steps: u64,
}

impl<'a> Aboard<'a> {
    pub(super) fn new(
        vehicle: &Vehicle,
        network: &'a mut dyn Network,
        wrap: impl FnOnce(FlightController) -> Bugged<FlightController>,
    ) -> Result<Self, TrialError> {
        let answers = AnswerMonitor::new(network.contract());
        let profile = vehicle.profile(None);
        let (task, speed) =
            profile.map_or((goshawk_core::Task::Track, 1.0), |Profile { task, speed, .. }| (task, speed));
        Ok(Self {
            source: vehicle.sensors.odometry,
            controller: wrap(FlightController::new(vehicle.controller_config())?),
            planner: PolicyPlanner::new(vehicle, &Mount::of(vehicle), network)?,
            stream: StreamMonitor::new(vehicle.camera.rates()),
            answers,
            history: History::new(),
            arrived: None,
            odometry: None,
            plan: None,
            demand: PlanningDemand { task, speed, goal_world: None },
            mode: Mode::Idle,
            flight: 0,
            frame: None,
            making: None,
            plans: 0,
            steps: 0,
        })
    }

    pub(super) fn flight(&self) -> u64 {
        self.flight
    }

    /// A message of the odometry's, from the network.
    pub(super) fn receive_odometry(&mut self, payload: &[u8], now: Time) {
        if let Ok(good) = sensors::odometry(payload, now) {
            self.arrived = Some(good);
        }
    }

    /// The autopilot's newest.
    pub(super) fn hear_odometry(&mut self, odometry: Odometry) {
        self.arrived = Some(odometry);
    }

    /// A message of the camera's.
    pub(super) fn receive_frame(&mut self, payload: &[u8], now: Time) {
        let Ok(mut frame) = sensors::frame(payload, now) else { return };
        let standing = matches!(self.mode, Mode::Idle | Mode::Ready | Mode::Landed | Mode::Fault);
        let unknown = Moving { flying: !standing, ..Moving::default() };
        let moving = self.history.odometry_at(frame.stamp).map_or(unknown, |o| sensors::moving(!standing, &o));
        let arrival = Arrival { seq: frame.seq, stamp: frame.stamp, source: 0 };
        frame.fault = self.stream.judge(&arrival, &frame.rgb, &frame.depth_mm, &moving);
        frame.print = self.stream.print();
        self.frame = Some(frame);
    }

    /// The planner's thread, a millisecond; its network takes `late_s` longer. What it has just handed over.
    pub(super) fn plan(&mut self, now: Time, late_s: f64) -> Result<Option<Planned>, TrialError> {
        let mut done = None;
        if let Some(making) = self.making.take_if(|making| now >= making.ready) {
            if !making.withheld {
                self.plan = Some(making.planned.plan.clone());
            }
            done = Some(making.planned);
        }
        if self.making.is_none()
            && let Some(frame) = self.frame.take()
        {
            self.making = self.begin(now.plus(POLICY_S + late_s), frame)?;
        }
        Ok(done)
    }

    fn begin(&mut self, ready: Time, frame: Frame) -> Result<Option<Making>, TrialError> {
        if frame.fault.is_some() {
            return Ok(None);
        }
        let seq = self.plans;
        self.plans += 1;
        let Some(odometry) = self.history.odometry_at(frame.stamp) else { return Ok(None) };
        let acc_world = self.history.acceleration_at(frame.stamp);
        let seen = Seen { flight: self.flight, seq, odometry: &odometry, acc_world, demand: &self.demand };
        let image = RgbdImage { width: frame.width, height: frame.height, rgb: frame.rgb, depth_mm: frame.depth_mm };
        let (plan, record) = self.planner.plan(&seen, &image)?;
        let withheld = self.answers.judge(plan.stamp, frame.print, &record.network).is_some();
        Ok(Some(Making { ready, planned: Planned { plan, record }, withheld }))
    }

    /// The controller's thread, one step.
    pub(super) fn control(&mut self, now: Time, status: &Status, command: Option<Command>, ready: bool) -> Stepped {
        let newer = self.arrived.filter(|o| self.odometry.is_none_or(|last| o.stamp > last.stamp));
        let fresh = newer.and_then(|newest| sensors::plausible(newest).ok()).map(|good| good.with_unsigned_zeros());
        if let Some(good) = fresh {
            self.odometry = Some(good);
            self.history.push_odometry(&good);
        }
        let input = StepInput {
            odometry: self.odometry,
            imu: None,
            plan_seq: self.plan.as_ref().map(|plan| plan.seq),
            autopilot: self.source.concerning(status),
            command,
            ready,
        };
        let output = self.controller.step(now, &input, self.plan.as_ref());
        self.history.push_acceleration(now, output.acc_kept_world);
        let started = matches!(command, Some(Command::Start(_))) && output.reply == Some(Ok(()));
        self.flight += u64::from(started);
        self.demand = output.planning.unwrap_or(self.demand);
        self.mode = output.mode;
        let seq = self.steps;
        self.steps += 1;
        Stepped { seq, input, output, fresh: fresh.is_some(), started }
    }
}
