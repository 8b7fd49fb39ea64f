//! The vehicle's software in lockstep: the same planner and controller as on board, fed by hand.

use goshawk_core::{
    AutopilotStatus, Command, ControllerOutput, FlightController, FrameInput, FrameRecord, History, Imu, Mode,
    NetworkOutput, Odometry, OdometryFault, Plan, Planner, PlanningDemand, StepInput, Time, Vec3,
};
use goshawk_policy::{
    AnswerMonitor, Arrival, Contract, Moving, Policy, PolicyError, Preprocessor, Source, StreamMonitor,
};
use goshawk_proto::v1;
use goshawk_vehicle::config::Vehicle;
use goshawk_vehicle::{convert, sensors};

use super::airframe::Mount;
use super::spent::{Spent, Stopwatch};
use super::{Pilot, TrialError};
use crate::sense::rgbd::RgbdImage;

/// From a frame's being there to the plan's being there, s: a network of 3 ms and 2 in reserve.
pub const POLICY_S: f64 = 0.005;

/// What answers a frame: a policy, or something that stands in for one in a test.
pub trait Network {
    /// What it says of itself.
    fn contract(&self) -> &Contract;

    /// Its raw answer to `rgbd` [4, 96, 160] and `state`.
    ///
    /// # Errors
    /// If it cannot answer.
    fn infer(&mut self, rgbd: &[f32], state: &[f32]) -> Result<NetworkOutput, PolicyError>;
}

impl Network for Policy {
    fn contract(&self) -> &Contract {
        Policy::contract(self)
    }

    fn infer(&mut self, rgbd: &[f32], state: &[f32]) -> Result<NetworkOutput, PolicyError> {
        Policy::infer(self, rgbd, state)
    }
}

/// A frame with what the vehicle knows of its exposure.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// Counts flights: the planner forgets what was before another one.
    pub flight: u64,
    /// Counts frames.
    pub seq: u64,
    /// At the exposure.
    pub odometry: &'a Odometry,
    /// Commanded acceleration then, m/s².
    pub acc_world: Vec3,
    /// What to plan for.
    pub demand: &'a PlanningDemand,
}

/// The policy with the core's planner: an image in, a plan out.
pub struct PolicyPlanner<'a> {
    planner: Planner,
    preprocessor: Preprocessor,
    network: &'a mut dyn Network,
    spent: Spent,
}

impl<'a> PolicyPlanner<'a> {
    /// The planner of `vehicle` with `network` as its policy.
    ///
    /// # Errors
    /// If the vehicle file does not fit the policy.
    pub fn new(vehicle: &Vehicle, mount: &Mount, network: &'a mut dyn Network) -> Result<Self, TrialError> {
        let camera = mount.camera;
        let source = Source {
            width: camera.width as u32,
            height: camera.height as u32,
            hfov_rad: camera.hfov_rad,
            vfov_rad: camera.vfov_rad(),
        };
        Ok(Self {
            planner: Planner::new(vehicle.planner_config(network.contract().model()))?,
            preprocessor: Preprocessor::new(network.contract(), source)?.with_rim(vehicle.camera.depth_rim_px),
            network,
            spent: Spent::default(),
        })
    }

    /// What the last plan cost; no control.
    #[must_use]
    pub fn spent(&self) -> Spent {
        self.spent
    }

    /// A target unseen for longer than this is not pursued any more, s.
    #[must_use]
    pub fn pursue_until_s(&self) -> f64 {
        self.planner.config().planning.chase.pursue_until_s
    }

    /// Plans from a frame.
    ///
    /// # Errors
    /// If the network fails.
    pub fn plan(&mut self, seen: &Seen<'_>, image: &RgbdImage) -> Result<(Plan, FrameRecord), TrialError> {
        let Seen { flight, seq, odometry, acc_world, demand } = *seen;
        let (mut watch, mut spent) = (Stopwatch::start(), Spent::default());
        let nearest = self.preprocessor.nearest(&image.depth_mm)?;
        let frame = FrameInput::new(flight, seq, odometry, acc_world, demand, nearest);
        spent.mapping_s += watch.lap();
        let rgbd = self.preprocessor.run(&image.rgb, &image.depth_mm)?;
        spent.perception_s += watch.lap();
        let asked = self.planner.see(&frame);
        let state = *asked.state();
        spent.mapping_s += watch.lap();
        let network = self.network.infer(rgbd, &state)?;
        spent.perception_s += watch.lap();
        let plan = asked.answer(&network);
        spent.planning_s += watch.lap();
        self.spent = spent;
        Ok((plan, FrameRecord { frame, state, network }))
    }
}

/// Planner and controller with what the onboard process keeps between them.
pub struct Onboard<'a> {
    controller: FlightController,
    planner: PolicyPlanner<'a>,
    history: History,
    odometry: Option<Odometry>,
    imu: Option<Imu>,
    demand: Option<PlanningDemand>,
    plan: Option<Plan>,
    frames: u64,
    frame_record: Option<FrameRecord>,
    step_input: Option<StepInput>,
    stream: StreamMonitor,
    answers: AnswerMonitor,
    mode: Mode,
    /// The plan that a dead network made: it is not flown.
    withheld: Option<u64>,
    odometry_fault: Option<OdometryFault>,
    control_s: f64,
}

impl<'a> Onboard<'a> {
    /// The software of `vehicle` with `network` as its policy.
    ///
    /// # Errors
    /// If the vehicle file cannot be flown with, or does not fit the policy.
    pub fn new(vehicle: &Vehicle, mount: &Mount, network: &'a mut dyn Network) -> Result<Self, TrialError> {
        let answers = AnswerMonitor::new(network.contract());
        Ok(Self {
            controller: FlightController::new(vehicle.controller_config())?,
            planner: PolicyPlanner::new(vehicle, mount, network)?,
            history: History::new(),
            odometry: None,
            imu: None,
            demand: None,
            plan: None,
            frames: 0,
            frame_record: None,
            step_input: None,
            stream: StreamMonitor::new(vehicle.camera.rates()),
            answers,
            mode: Mode::Idle,
            withheld: None,
            odometry_fault: None,
            control_s: 0.0,
        })
    }
}

impl Pilot for Onboard<'_> {
    fn compute_s(&self) -> f64 {
        POLICY_S
    }

    fn take_odometry(&mut self, odometry: &Odometry) {
        let odometry = odometry.with_unsigned_zeros();
        self.history.push_odometry(&odometry);
        self.odometry = Some(odometry);
    }

    fn take_imu(&mut self, imu: &Imu) {
        self.imu = Some(imu.with_unsigned_zeros());
    }

    fn plan(&mut self, arrival: &Arrival, image: &RgbdImage) -> Result<Option<Plan>, TrialError> {
        let stamp = arrival.stamp;
        self.frames += 1;
        let flying = !matches!(self.mode, Mode::Idle | Mode::Ready | Mode::Landed | Mode::Fault);
        let moving = self.odometry.as_ref().map_or(Moving::default(), |odometry| sensors::moving(flying, odometry));
        if self.stream.judge(arrival, &image.rgb, &image.depth_mm, &moving).is_some() {
            return Ok(None);
        }
        let (Some(demand), Some(odometry)) = (self.demand, self.history.odometry_at(stamp)) else { return Ok(None) };
        let acc_world = self.history.acceleration_at(stamp);
        let seen = Seen { flight: 0, seq: self.frames, odometry: &odometry, acc_world, demand: &demand };
        let (plan, record) = self.planner.plan(&seen, image)?;
        let dead = self.answers.judge(stamp, self.stream.print(), &record.network);
        self.withheld = dead.map(|_| plan.seq);
        self.frame_record = Some(record);
        Ok(Some(plan))
    }

    fn take_plan(&mut self, plan: Plan) {
        if self.withheld != Some(plan.seq) {
            self.plan = Some(plan);
        }
    }

    fn obstacle_map(&self, seq: u64, now: Time) -> Option<v1::ObstacleMap> {
        convert::obstacle_map(seq, now, &self.planner.planner, &self.frame_record.as_ref()?.frame)
    }

    fn spent(&self) -> Spent {
        Spent { control_s: self.control_s, ..self.planner.spent() }
    }

    fn odometry(&self) -> Option<&Odometry> {
        self.odometry.as_ref()
    }

    fn control(&mut self, now: Time, autopilot: AutopilotStatus, command: Option<Command>) -> ControllerOutput {
        let mut watch = Stopwatch::start();
        let plan_seq = self.plan.as_ref().map(|plan| plan.seq);
        let input = StepInput { odometry: self.odometry, imu: self.imu, plan_seq, autopilot, command, ready: true };
        let output = self.controller.step(now, &input, self.plan.as_ref());
        self.control_s = watch.lap();
        self.step_input = Some(input);
        self.history.push_acceleration(now, output.acc_kept_world);
        // As on board, it goes on seeing for what was demanded last.
        self.demand = output.planning.or(self.demand);
        self.mode = output.mode;
        self.odometry_fault = output.odometry_fault;
        output
    }

    fn faults(&self) -> Vec<&'static str> {
        let stream = self.stream.fault().map(goshawk_policy::StreamFault::name);
        let answers = self.answers.fault().map(goshawk_policy::AnswerFault::name);
        stream.into_iter().chain(answers).chain(self.odometry_fault.map(OdometryFault::name)).collect()
    }

    fn frame_record(&self) -> Option<&FrameRecord> {
        self.frame_record.as_ref()
    }

    fn step_input(&self) -> Option<&StepInput> {
        self.step_input.as_ref()
    }
}
