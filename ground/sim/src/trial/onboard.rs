//! The vehicle's software in lockstep: the same planner and controller as on board, fed by hand.

use goshawk_air::config::Vehicle;
use goshawk_core::{
    AutopilotStatus, Command, Controller, ControllerInput, ControllerOutput, History, NetworkOutput, Odometry, Plan,
    Planner, PlannerInput, PlanningDemand, Time,
};
use goshawk_policy::{Contract, Policy, PolicyError, Preprocessor, Source};

use super::TrialError;
use super::airframe::Mount;
use crate::sensor::RgbdImage;

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

/// Planner and controller with what the onboard process keeps between them.
pub struct Onboard<'a> {
    controller: Controller,
    planner: Planner,
    history: History,
    preprocessor: Preprocessor,
    network: &'a mut dyn Network,
    odometry: Option<Odometry>,
    demand: Option<PlanningDemand>,
    plan: Option<Plan>,
    frames: u64,
}

impl<'a> Onboard<'a> {
    /// The software of `vehicle` with `network` as its policy.
    ///
    /// # Errors
    /// If the vehicle file cannot be flown with, or does not fit the policy.
    pub fn new(vehicle: &Vehicle, mount: &Mount, network: &'a mut dyn Network) -> Result<Self, TrialError> {
        let camera = mount.camera;
        let source = Source {
            width: camera.width as u32,
            height: camera.height as u32,
            hfov_rad: camera.hfov_rad,
            vfov_rad: camera.vfov_rad(),
        };
        Ok(Self {
            controller: Controller::new(vehicle.controller_config())?,
            planner: Planner::new(vehicle.planner_config(network.contract().model()))?,
            history: History::new(),
            preprocessor: Preprocessor::new(network.contract(), source)?,
            network,
            odometry: None,
            demand: None,
            plan: None,
            frames: 0,
        })
    }

    /// A state estimate has come.
    pub fn take_odometry(&mut self, odometry: &Odometry) {
        self.history.push_odometry(odometry);
        self.odometry = Some(*odometry);
    }

    /// Plans from a frame that was exposed at `stamp`; the plan is flown once it is handed to
    /// [`Onboard::take_plan`]. None: the controller demands no plan, or there is no odometry around the stamp.
    ///
    /// # Errors
    /// If the network fails.
    pub fn plan(&mut self, stamp: Time, image: &RgbdImage) -> Result<Option<Plan>, TrialError> {
        self.frames += 1;
        let (Some(demand), Some(odometry)) = (self.demand, self.history.odometry_at(stamp)) else { return Ok(None) };
        let acc_world = self.history.acceleration_at(stamp);
        let state = self.planner.network_state(&odometry, acc_world, demand.speed, demand.goal_world);
        let rgbd = self.preprocessor.run(&image.rgb, &image.depth_mm)?;
        let state_len = self.network.contract().state_len();
        let network = self.network.infer(rgbd, &state[..state_len])?;
        Ok(Some(self.planner.step(&PlannerInput {
            seq: self.frames,
            odometry: &odometry,
            acc_world,
            speed: demand.speed,
            goal_world: demand.goal_world,
            network: &network,
        })))
    }

    /// A plan has become available to the controller.
    pub fn take_plan(&mut self, plan: Plan) {
        self.plan = Some(plan);
    }

    /// The newest plan.
    #[must_use]
    pub fn newest_plan(&self) -> Option<&Plan> {
        self.plan.as_ref()
    }

    /// The newest state estimate.
    #[must_use]
    pub fn odometry(&self) -> Option<&Odometry> {
        self.odometry.as_ref()
    }

    /// One tick of the controller.
    pub fn control(&mut self, now: Time, autopilot: AutopilotStatus, command: Option<Command>) -> ControllerOutput {
        let output = self.controller.step(
            now,
            &ControllerInput {
                odometry: self.odometry.as_ref(),
                plan: self.plan.as_ref(),
                autopilot,
                command,
                ready: true,
            },
        );
        self.history.push_acceleration(now, output.acc_des_world);
        self.demand = output.planning;
        output
    }
}
