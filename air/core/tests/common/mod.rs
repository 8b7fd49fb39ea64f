//! A point mass with attitude lag, a stand-in autopilot and a planner that flies straight: enough to close the loop.

#![allow(dead_code, unreachable_pub, missing_docs, clippy::unwrap_used, reason = "each test file uses its part of it")]

use goshawk_core::planning::nearest::{COLUMNS, ROWS};
use goshawk_core::*;

mod shipped;

pub const DT: f64 = 0.005;

pub fn config() -> ControllerConfig {
    shipped::controller()
}

pub fn planner_config(task: Task) -> PlannerConfig {
    let (hfov, vfov) = (90_f64.to_radians(), 2.0 * 0.6_f64.atan());
    PlannerConfig {
        camera: CameraModel {
            hfov,
            vfov,
            width: 160,
            height: 96,
            body_from_cam: Rot::from_axis_angle(&Vec3::y_axis(), -0.17),
            pos_cam_body: Vec3::new(0.06, 0.0, 0.02),
        },
        policy: PolicyModel {
            task,
            state: StateLayout { up: true, aim: true, direction: false, agility: true },
            radius: 5.0,
            azimuth_offset: 15_f64.to_radians(),
            elevation_offset: 15_f64.to_radians(),
            v_max: 6.0,
            a_max: 6.0,
            target_depth_scale: 5.0,
            cost_scale: 6.0,
            hfov,
            vfov,
            width: 160,
            height: 96,
        },
        planning: planning(shipped::tuning().planner.target),
        extensions: Extensions::ALL,
        keep_off: 1.5,
    }
}

/// The shipped planning with a chase that keeps its distance at any speed.
pub fn planning(target: TargetConfig) -> PlanningConfig {
    let mut planner = shipped::tuning().planner;
    planner.navigation.max_agility = 1.0;
    let chase = ChaseConfig { standoff_m: 2.5, headway_s: 0.0, pursue_until_s: 2.5, ..planner.chase };
    PlanningConfig { target, chase, max_acc_mps2: 8.0, max_agility: 1.0, ..planner }
}

pub fn odometry() -> Odometry {
    Odometry {
        stamp: Time::from_secs(100.0),
        pos_world: Vec3::new(1.0, 2.0, 3.0),
        vel_world: Vec3::new(2.0, 0.0, 0.0),
        world_from_body: Rot::identity(),
        ang_vel_body: Vec3::zeros(),
        reset_counter: 0,
    }
}

/// A frame that measured no depth, of a chase that is not accelerating.
pub fn frame(seq: u64, odometry: Odometry) -> FrameInput {
    let nearest = [0; COLUMNS * ROWS];
    FrameInput { flight: 0, seq, odometry, acc_world: Vec3::zeros(), speed: 6.0, goal_world: None, nearest }
}

pub fn track() -> Profile {
    Profile { task: Task::Track, speed: 6.0, height: 1.5, goal: None }
}

pub fn navigate(goal: Vec3) -> Profile {
    Profile { task: Task::Navigate, speed: 6.0, height: 1.5, goal: Some(goal) }
}

/// What the camera frames say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Frames {
    /// The planner is dead.
    None,
    /// Frames without a choice.
    Blank,
    /// A target here.
    Target(Vec3),
    /// A target that is believed to be here, while it is seen there.
    Astray(Vec3, Vec3),
    /// A straight plan to the demand's goal.
    Goal,
}

/// The world, the vehicle and its autopilot.
pub struct Loop {
    pub controller: Controller,
    pub now: Time,
    pub pos: Vec3,
    pub vel: Vec3,
    /// Felt acceleration besides gravity and thrust, m/s².
    pub wind: Vec3,
    /// What the vehicle weighs, relative to what the controller believes.
    pub heaviness: f64,
    pub attitude: Rot,
    /// First-order lag of the attitude, s.
    pub lag: f64,
    pub autopilot: AutopilotStatus,
    pub accepts_offboard: bool,
    pub accepts_arming: bool,
    pub has_landed_detector: bool,
    pub frames: Frames,
    /// How much sooner than they should plans want to be there; 1: as the demand says.
    pub haste: f64,
    /// Every plan leads out of the way by this.
    pub evades: Option<planning::evade::Evasion>,
    /// What the filter believes of the target's velocity.
    pub target_vel: Vec3,
    pub odometry_works: bool,
    /// Added to the odometry's position.
    pub odometry_offset: Vec3,
    /// Turns the odometry's frame about the vertical.
    pub odometry_turn: f64,
    /// Added to the odometry's velocity.
    pub velocity_offset: Vec3,
    /// Turns the odometry's attitude alone about the vertical; the autopilot flies by the same.
    pub heading_error: f64,
    /// The autopilot flies by the true heading instead.
    pub loop_knows: bool,
    /// The odometry repeats itself under new stamps.
    pub frozen: bool,
    pub reset_counter: u32,
    pub ready: bool,
    pub ground: f64,
    pub output: Option<ControllerOutput>,
    /// The last one, as the planner keeps it.
    demand: Option<PlanningDemand>,
    pub transitions: Vec<Transition>,
    pub requests: Vec<(f64, Request)>,
    odometry: Option<Odometry>,
    plan: Option<Plan>,
    ticks: u64,
    thrust: f64,
    rates: Vec3,
    still: f64,
}

impl Loop {
    pub fn new() -> Self {
        Self::with(config())
    }

    pub fn with(config: ControllerConfig) -> Self {
        Self {
            controller: Controller::new(config).unwrap(),
            now: Time::from_secs(100.0),
            pos: Vec3::new(3.0, -2.0, 0.0),
            vel: Vec3::zeros(),
            wind: Vec3::zeros(),
            heaviness: 1.0,
            attitude: Rot::from_axis_angle(&Vec3::z_axis(), 0.5),
            lag: 0.1,
            autopilot: AutopilotStatus {
                connected: true,
                armed: false,
                offboard: false,
                landed: Some(true),
                battery: None,
                position: None,
            },
            accepts_offboard: true,
            accepts_arming: true,
            has_landed_detector: true,
            frames: Frames::None,
            haste: 1.0,
            evades: None,
            target_vel: Vec3::zeros(),
            odometry_works: true,
            odometry_offset: Vec3::zeros(),
            odometry_turn: 0.0,
            velocity_offset: Vec3::zeros(),
            heading_error: 0.0,
            loop_knows: false,
            frozen: false,
            reset_counter: 0,
            ready: true,
            ground: 0.0,
            output: None,
            demand: None,
            transitions: Vec::new(),
            requests: Vec::new(),
            odometry: None,
            plan: None,
            ticks: 0,
            thrust: 0.0,
            rates: Vec3::zeros(),
            still: 0.0,
        }
    }

    pub fn out(&self) -> &ControllerOutput {
        self.output.as_ref().unwrap()
    }

    pub fn mode(&self) -> Mode {
        self.out().mode
    }

    pub fn seconds(&self) -> f64 {
        self.now.since(Time(0))
    }

    /// The last change of mode.
    pub fn last_cause(&self) -> Cause {
        self.transitions.last().unwrap().cause
    }

    pub fn tick(&mut self, command: Option<Command>) -> ControllerOutput {
        self.now = self.now.plus(DT);
        self.ticks += 1;
        let stands = self.odometry.filter(|_| self.frozen);
        if let (true, Some(odometry)) = (self.ticks.is_multiple_of(2), stands) {
            self.odometry = Some(Odometry { stamp: self.now, ..odometry });
        } else if self.ticks.is_multiple_of(2) && self.odometry_works {
            self.odometry = Some(Odometry {
                stamp: self.now,
                pos_world: self.turn() * self.pos + self.odometry_offset,
                vel_world: self.turn() * self.vel + self.velocity_offset,
                world_from_body: self.heading() * self.turn() * self.attitude,
                ang_vel_body: self.rates,
                reset_counter: self.reset_counter,
            });
        }
        if self.ticks.is_multiple_of(6) {
            self.plan = self.make_plan().or(self.plan.take());
        }
        let input = StepInput {
            imu: None,
            odometry: self.odometry,
            plan_seq: self.plan.as_ref().map(|plan| plan.seq),
            autopilot: self.autopilot,
            command,
            ready: self.ready,
        };
        let output = self.controller.step(self.now, &input, self.plan.as_ref());
        self.autopilot_takes(&output);
        self.move_vehicle(&output);
        self.transitions.extend(output.transition);
        self.output = Some(output);
        self.demand = output.planning.or(self.demand);
        output
    }

    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / DT).round() as u32 {
            self.tick(None);
        }
    }

    /// Runs until `what` holds; panics after `limit` s.
    pub fn until(&mut self, limit: f64, what: impl Fn(&Self) -> bool) {
        for _ in 0..(limit / DT).round() as u32 {
            self.tick(None);
            if what(self) {
                return;
            }
        }
        panic!("not within {limit} s; mode {:?}, transitions {:?}", self.mode(), self.transitions);
    }

    pub fn start(&mut self, profile: Profile) {
        self.run(0.1);
        let output = self.tick(Some(Command::Start(profile)));
        assert_eq!(output.reply, Some(Ok(())));
    }

    pub fn stop(&mut self) {
        let output = self.tick(Some(Command::Stop));
        assert_eq!(output.reply, Some(Ok(())));
    }

    fn turn(&self) -> Rot {
        Rot::from_axis_angle(&Vec3::z_axis(), self.odometry_turn)
    }

    fn heading(&self) -> Rot {
        Rot::from_axis_angle(&Vec3::z_axis(), self.heading_error)
    }

    fn autopilot_takes(&mut self, output: &ControllerOutput) {
        if let Some(request) = output.request {
            self.requests.push((self.seconds(), request));
            match request {
                Request::Offboard if self.accepts_offboard => self.autopilot.offboard = true,
                Request::Arm if self.accepts_arming && self.autopilot.offboard => self.autopilot.armed = true,
                Request::Disarm if self.pos.z <= self.ground + 0.01 => self.autopilot.armed = false,
                Request::HandBack => self.autopilot.offboard = false,
                _ => {}
            }
        }
    }

    fn move_vehicle(&mut self, output: &ControllerOutput) {
        let setpoint = output.setpoint.filter(|_| self.autopilot.offboard);
        let running = self.autopilot.armed && setpoint.is_some();
        if let (Some(setpoint), true) = (setpoint, running) {
            let heading = if self.loop_knows { Rot::identity() } else { self.heading() };
            let wanted = (heading * self.turn()).inverse() * setpoint.world_from_body;
            let before = self.attitude;
            self.attitude = before.slerp(&wanted, DT / self.lag);
            self.rates = (before.inverse() * self.attitude).scaled_axis() / DT;
            self.thrust = setpoint.thrust.0 / 0.25 * GRAVITY / self.heaviness;
        } else {
            self.thrust = 0.0;
        }
        let acc = self.attitude * Vec3::z() * self.thrust - Vec3::z() * GRAVITY + self.wind;
        self.vel += acc * DT;
        self.pos += self.vel * DT;
        if self.pos.z <= self.ground {
            self.pos.z = self.ground;
            self.vel = Vec3::zeros();
        }
        let resting = self.pos.z <= self.ground + 1e-9 && self.thrust < 0.5 * GRAVITY;
        self.still = if resting { self.still + DT } else { 0.0 };
        self.autopilot.landed = self.has_landed_detector.then_some(!self.autopilot.armed || self.still > 1.0);
    }

    /// A plan from the vehicle's state straight to what the frames show.
    fn make_plan(&mut self) -> Option<Plan> {
        let demand = self.demand?;
        let pos = self.pos + self.odometry_offset;
        let (aim, target) = match self.frames {
            Frames::None => return None,
            Frames::Blank => (None, None),
            Frames::Target(at) | Frames::Astray(at, _) => (Some(at), Some(at)),
            Frames::Goal => (demand.goal_world, None),
        };
        let alpha = demand.speed / 6.0;
        let end = aim.map_or(FlatState::default(), |aim| {
            let line = aim - pos;
            let reach = line.norm().min(10.0);
            let direction = line.try_normalize(1e-6).unwrap_or_default();
            FlatState { pos: pos + direction * reach, vel: direction * (2.0 * self.haste), acc: Vec3::zeros() }
        });
        let seen = match self.frames {
            Frames::Astray(_, at) => Some(at),
            _ => target,
        };
        let candidate =
            Candidate { end, cost: 1.0, added: Added::default(), objectness: 1.0, target_world: seen, rejection: None };
        let estimate = target.map(|at| TargetEstimate {
            stamp: self.now,
            pos_world: at,
            vel_world: self.target_vel,
            covariance: nalgebra::Matrix6::identity() * 0.04,
            confirmed: true,
            last_seen: self.now,
        });
        let old = self.plan.as_ref().and_then(|plan| plan.target);
        let kept = old.map(|t| TargetEstimate { confirmed: self.now.since(t.last_seen) < 0.5, ..t });
        Some(Plan {
            seq: self.ticks,
            stamp: self.now,
            start: FlatState { pos, vel: self.vel, acc: self.out().acc_kept_world },
            world_from_cam: self.attitude,
            duration: 10.0 / (alpha * 6.0 * self.haste),
            alpha,
            candidates: [candidate; ANCHORS],
            chosen: aim.map(|_| 7),
            target: estimate.or(kept),
            look: None,
            room: None,
            movers: [None; goshawk_core::planning::movers::MOST],
            evasion: self.evades,
        })
    }
}
