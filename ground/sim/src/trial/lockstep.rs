//! The clockwork of a lockstep flight: physics at 1 kHz, odometry at 100 Hz and 10 ms late, the camera at 30 Hz with
//! 15 ms from exposure to the planner and the pilot's own time from there to the plan, the controller at its own rate.

mod camera;
mod verdict;

use std::collections::VecDeque;

use goshawk_core::{Cause, Command, LimitsConfig, Mode, Profile, Refusal, Rot, Task, Time, Vec3};
use goshawk_vehicle::config::Vehicle;

use super::airframe::{Mount, airframe};
use super::autopilot::Obliging;
use super::fault::{Falsified, Injection, Tampered, followed};
use super::firmware::InTheLoop;
use super::judge::{Contact, Follower, Judge, clearance, in_view};
use super::rule::cruise_between;
use super::runner::Runner;
use super::scene::Scene;
use super::{Flight, Pilot, TrialConfig, TrialError, Truth, Witness, within_limits};
use crate::actors::evader::EvaderState;
use crate::render::{Frame, Renderer};
use crate::sense::odometry::Estimator;
use crate::sense::rgbd::{Sensor, mix};
use crate::vehicle::imu::Imu;
use crate::vehicle::quadrotor::{Quadrotor, STEP_S, Wind};
use crate::world::Part;

const STEPS_PER_S: u64 = 1000;
const FRAMES_PER_S: u64 = 30;
const ODOMETRY_STEPS: u64 = 10;
const WIND_STEPS: u64 = 10;
const TRUTH_STEPS: u64 = 50;
const CLEARANCE_STEPS: u64 = 2;

/// The evader begins to run this long after the vehicle first tracks it, s.
const HEAD_START_S: f64 = 0.5;
/// Or, if the vehicle does not find it, this long after the take-off's end, s.
const RUNS_ANYWAY_S: f64 = 5.0;

use camera::InFlight;
use verdict::{Arrived, Ending, TAKEOFF_S};

pub(crate) struct Lockstep<'a> {
    config: TrialConfig,
    limits: LimitsConfig,
    scene: &'a Scene,
    mount: Mount,
    control_steps: u64,
    quad: Quadrotor,
    wind: Wind,
    wind_world: Vec3,
    /// The moving obstacles, now.
    moving: Vec<Part>,
    estimator: Estimator,
    imu: Imu,
    autopilot: Obliging,
    /// In its place, where real firmware flies.
    firmware: Option<InTheLoop>,
    /// When the firmware was ready to be flown.
    ready_at: Time,
    onboard: Box<dyn Pilot + 'a>,
    renderer: Renderer,
    sensor: Sensor,
    frame: Frame,
    frames: u64,
    second_frames: u64,
    pending: VecDeque<InFlight>,
    injection: Injection,
    tampered: Tampered,
    falsified: Falsified,
    /// Faults that the vehicle has named: s since the Start command, and the name.
    named: Vec<(f64, &'static str)>,
    /// Those that it names now.
    naming: Vec<&'static str>,
    judge: Judge,
    follower: Follower,
    /// Of the last `CLEARANCE_STEPS` since the Start; understated where that does not matter.
    clearance_m: f64,
    step: u64,
    mode: Mode,
    modes: Vec<(f64, Mode, Cause)>,
    /// Why the vehicle does not start, as it said last.
    refusal: Option<Refusal>,
    /// When Start was accepted, the take-off ended, the evader begins to run.
    started: Option<Time>,
    up: Option<Time>,
    runs: Option<Time>,
    /// Track: once the evader arrived. It stands there a while, and the vehicle by it.
    arrived: Option<Arrived>,
    /// Track: who runs, and where that is now.
    runner: Option<Runner<'a>>,
    evader: Option<EvaderState>,
    /// Where cruise speed is measured, m along the course.
    cruise_m: [f64; 2],
    /// The take-off may last so long, s.
    takeoff_s: f64,
}

impl<'a> Lockstep<'a> {
    pub(crate) fn new(
        config: &TrialConfig,
        vehicle: &Vehicle,
        scene: &'a Scene,
        onboard: Box<dyn Pilot + 'a>,
        injection: Injection,
        firmware: Option<InTheLoop>,
    ) -> Self {
        let mount = Mount::of(vehicle);
        let parameters = config.airframe.apply(&airframe(vehicle), mix(config.seed, 16));
        let start = scene.vehicle_start(&parameters);
        let runner = scene.evader.as_ref().map(|evader| Runner::new(config, scene, evader));
        let way_m = (scene.goal_world - scene.world.start_world()).xy().norm();
        Self {
            config: config.clone(),
            limits: vehicle.limits,
            scene,
            mount,
            control_steps: (STEPS_PER_S as f64 / vehicle.realtime.controller_rate_hz).round().max(1.0) as u64,
            quad: Quadrotor::new(parameters, start, scene.world.start_heading_rad()),
            wind: Wind::new(config.wind_mps, mix(config.seed, 12)),
            wind_world: Vec3::zeros(),
            moving: scene.moving_at(0.0),
            estimator: Estimator::new(config.sensors.odometry, mix(config.seed, 11)),
            imu: Imu::new(config.sensors.imu, mix(config.seed, 15)),
            autopilot: Obliging::default(),
            firmware,
            ready_at: Time::from_secs(1.0),
            onboard,
            renderer: Renderer::new(mount.camera),
            sensor: config.sensors.sensor(&mount.camera, mix(config.seed, 14)),
            frame: Frame::default(),
            frames: 0,
            second_frames: 0,
            pending: VecDeque::new(),
            injection,
            tampered: Tampered::new(config.seed),
            falsified: Falsified::new(config.seed),
            named: Vec::new(),
            naming: Vec::new(),
            judge: Judge::default(),
            follower: Follower::default(),
            clearance_m: 0.0,
            step: 0,
            mode: Mode::Idle,
            modes: Vec::new(),
            refusal: None,
            started: None,
            up: None,
            runs: None,
            arrived: None,
            cruise_m: cruise_between(runner.as_ref().map_or(way_m, Runner::length_m)),
            runner,
            evader: None,
            takeoff_s: TAKEOFF_S + config.height_m / vehicle.tuning().mission.climb_speed_mps,
        }
    }

    /// Flies to the end.
    pub(crate) fn fly(mut self, witness: &mut dyn Witness) -> Result<Flight, TrialError> {
        self.meet_firmware()?;
        loop {
            let now = self.now();
            self.moving = self.scene.moving_at(self.task_for(now));
            self.injection.advance(now, self.task_for(now));
            let (running_for_s, seen_from) = (self.running_for(now), self.quad.state().pos_world);
            self.evader = self.runner.as_mut().map(|runner| runner.advance(running_for_s, &seen_from));
            self.sense(now);
            self.see(now, witness)?;
            if self.step.is_multiple_of(self.control_steps) {
                self.control(now, witness);
            }
            self.refused(now)?;
            self.move_on(now)?;
            if !self.quad.state().is_finite() {
                return Err(TrialError::NotFinite(self.started.map_or(0.0, |started| now.since(started))));
            }
            if self.step.is_multiple_of(TRUTH_STEPS) {
                witness.truth(now, &self.truth(None));
            }
            if let Some(ending) = self.verdict(now) {
                witness.truth(now, &self.truth(ending.contact));
                witness.verdict(now, ending.outcome, ending.contact);
                return Ok(self.flight(now, ending));
            }
            self.step += 1;
        }
    }

    /// Lets real firmware boot and find itself, until it may be flown.
    fn meet_firmware(&mut self) -> Result<(), TrialError> {
        let world = &self.scene.world;
        if let Some(firmware) = &mut self.firmware {
            self.step = firmware.get_ready(&mut self.quad, |x, y| world.ground_height(x, y))?;
            self.frames = self.step * FRAMES_PER_S / STEPS_PER_S + 1;
            self.ready_at = self.now();
        }
        Ok(())
    }

    fn now(&self) -> Time {
        // The clock begins at 1 s, so that nothing lies before its zero.
        Time((self.step + STEPS_PER_S) * 1_000_000)
    }

    fn running_for(&self, now: Time) -> f64 {
        self.runs.map_or(-1.0, |runs| now.since(runs))
    }

    fn in_task(&self, now: Time) -> bool {
        match self.config.task {
            Task::Track => self.runs.is_some_and(|runs| now >= runs) && self.arrived.is_none(),
            Task::Navigate => self.up.is_some(),
        }
    }

    /// Since the task's beginning, s; 0 before it.
    fn task_for(&self, now: Time) -> f64 {
        let begun = match self.config.task {
            Task::Track => self.runs,
            Task::Navigate => self.up,
        };
        begun.map_or(0.0, |begun| now.since(begun).max(0.0))
    }

    fn sense(&mut self, now: Time) {
        if let Some(firmware) = &mut self.firmware {
            let (odometry, imu) = firmware.news();
            if let Some(imu) = imu {
                self.onboard.take_imu(&imu);
            }
            if let Some(odometry) = odometry {
                let odometry = self.falsified.apply(self.injection.odometry(), &odometry);
                self.onboard.take_odometry(&odometry);
            }
            return;
        }
        if self.step.is_multiple_of(ODOMETRY_STEPS) {
            self.estimator.observe(now, self.quad.state());
            let sample = self.imu.measure(self.quad.state(), ODOMETRY_STEPS as f64 / STEPS_PER_S as f64);
            self.onboard.take_imu(&sample.at(now));
        }
        while let Some(odometry) = self.estimator.known(now) {
            let odometry = self.falsified.apply(self.injection.odometry(), &odometry);
            self.onboard.take_odometry(&odometry);
        }
    }

    fn control(&mut self, now: Time, witness: &mut dyn Witness) {
        let command = (self.mode == Mode::Ready).then(|| Command::Start(self.profile()));
        let status = match &self.firmware {
            Some(firmware) => firmware.status(now),
            None => self.autopilot.status(self.quad.state().on_ground, self.quad.battery_fraction()),
        };
        let output = self.onboard.control(now, status, command);
        match &self.firmware {
            Some(firmware) => firmware.take(&output),
            None => self.autopilot.take(now, &output),
        }
        self.mode = output.mode;
        match output.reply {
            Some(Ok(())) => self.started = self.started.or(Some(now)),
            Some(Err(refusal)) => self.refusal = Some(refusal),
            None if self.started.is_none() => self.refusal = output.readiness.err(),
            None => {}
        }
        if let (Some(change), Some(started)) = (output.transition, self.started) {
            self.modes.push((now.since(started), change.to, change.cause));
            if change.from == Mode::Takeoff && change.to.has_authority() && change.to != Mode::Stopping {
                self.up = Some(now);
                self.runs = Some(now.plus(RUNS_ANYWAY_S));
            }
            if change.to == Mode::Track && self.runs.is_none_or(|runs| runs > now) {
                self.runs = Some(now.plus(HEAD_START_S));
            }
        }
        self.note_faults(now);
        witness.control(now, &output, self.onboard.as_ref());
    }

    /// Whether the flight cannot begin: the profile is refused, or the vehicle is not ready in good time.
    fn refused(&self, now: Time) -> Result<(), TrialError> {
        let never = matches!(self.refusal, Some(Refusal::BadProfile | Refusal::BeyondLimits));
        let late = now.since(self.ready_at) > TAKEOFF_S;
        if self.started.is_some() || !(never || late) {
            return Ok(());
        }
        let profile = self.profile();
        within_limits(&self.limits, &profile)?;
        let why = self.refusal.map_or_else(|| "it was not ready in time".to_owned(), |refusal| refusal.to_string());
        Err(TrialError::Refused { speed_mps: profile.speed, height_m: profile.height, why })
    }

    /// Notes what the vehicle finds wrong that it did not a tick ago.
    fn note_faults(&mut self, now: Time) {
        let (Some(started), naming) = (self.started, self.onboard.faults()) else { return };
        let new = naming.iter().filter(|name| !self.naming.contains(name));
        self.named.extend(new.map(|name| (now.since(started), *name)));
        self.naming = naming;
    }

    fn profile(&self) -> Profile {
        let goal = (self.config.task == Task::Navigate).then(|| self.goal_from_start());
        Profile { goal, ..self.config.profile() }
    }

    fn move_on(&mut self, now: Time) -> Result<(), TrialError> {
        if self.step.is_multiple_of(WIND_STEPS) {
            self.wind_world = self.wind.step(WIND_STEPS as f64 * STEP_S, &self.quad.state().vel_world);
        }
        let error = self.injection.odometry().map(|(error, _)| error);
        let demand = self.autopilot.demand(now).map(|demand| followed(error, demand));
        let world = &self.scene.world;
        let ground = |x, y| world.ground_height(x, y);
        match &mut self.firmware {
            Some(firmware) => firmware.drive(self.step, &mut self.quad, self.wind_world, ground)?,
            None => self.quad.step(STEP_S, demand.as_ref(), self.wind_world, ground),
        }
        if self.in_task(now) {
            self.judge.physics(STEP_S, self.quad.state());
            self.judge.cruise(STEP_S, self.quad.state().vel_world.norm(), self.along_m(), self.cruise_m);
        }
        if self.started.is_some() && self.step.is_multiple_of(CLEARANCE_STEPS) {
            let matters_m = self.judge.metrics.clearance_m.unwrap_or(f64::INFINITY);
            self.clearance_m = self.follower.clearance(world, &self.moving, &self.quad.state().pos_world, matters_m);
            self.judge.clearance(self.clearance_m);
            if let Some(evader) = self.evader.filter(|_| self.up.is_some()) {
                let distance_m = (evader.centre_world() - self.quad.state().pos_world).norm();
                self.judge.target_distance(distance_m);
                if self.in_task(now) {
                    self.judge.pursuit(CLEARANCE_STEPS as f64 * STEP_S, distance_m);
                }
            }
        }
        Ok(())
    }

    /// How far along the course the flight is, m: the evader's way, or the vehicle's toward its goal.
    fn along_m(&self) -> f64 {
        let start = self.scene.world.start_world();
        let toward = (self.scene.goal_world - start).xy().try_normalize(1e-9);
        let flown = (self.quad.state().pos_world - start).xy();
        self.evader.map_or_else(|| toward.map_or(0.0, |toward| flown.dot(&toward)), |evader| evader.path_m)
    }

    fn goal_world(&self) -> Vec3 {
        self.scene.goal_world + Vec3::new(0.0, 0.0, self.quad.parameters().leg_m + self.config.height_m)
    }

    /// As a profile says it: forward, left and up from where the vehicle starts, m.
    fn goal_from_start(&self) -> Vec3 {
        let to_goal = self.goal_world() - self.scene.vehicle_start(self.quad.parameters());
        Rot::from_axis_angle(&Vec3::z_axis(), -self.scene.world.start_heading_rad()) * to_goal
    }

    fn truth(&self, contact: Option<Contact>) -> Truth<'_> {
        let vehicle = self.quad.state();
        Truth {
            vehicle,
            evader: self.evader,
            moving: &self.moving,
            clearance_m: clearance(&self.scene.world, &self.moving, &vehicle.pos_world),
            collisions: u32::from(contact.is_some()),
            visible: in_view(&self.frame, &self.sensor),
            goal_world: self.scene.evader.is_none().then_some(self.scene.goal_world),
        }
    }

    fn flight(self, now: Time, ending: Ending) -> Flight {
        let at = self.quad.state().pos_world;
        let target = self.evader.map_or(self.goal_world(), |e| e.centre_world());
        Flight {
            outcome: ending.outcome,
            reached: ending.reached,
            contact: ending.contact,
            end_world: at,
            end_distance_m: (target - at).norm(),
            unseen_s: self.judge.unseen_s(now),
            stage_s: self.task_for(now),
            flown_s: self.started.map_or(0.0, |started| now.since(started)),
            modes: self.modes,
            fault_at_s: self.injection.begun().zip(self.started).map(|(begun, started)| begun.since(started)),
            named: self.named,
            metrics: self.judge.metrics,
        }
    }
}
