//! One camera frame in, one plan out.

use crate::planning::aim::{Chase, ChaseConfig, climbing, within_reach};
use crate::planning::evade::{Evader, Scene};
use crate::planning::movers::meeting;
use crate::planning::nearest::Nearest;
use crate::planning::obstacles::{Ignored, Obstacles};
use crate::planning::plan::Plan;
use crate::planning::select::{SelectConfig, detect, select};
use crate::planning::target::{Expected, TargetConfig, TargetFilter};
use crate::planning::threat::Threat;
use crate::policy::decode::{Decoder, FramePose};
use crate::policy::model::{CameraModel, PolicyModel};
use crate::values::error::{ConfigError, within};
use crate::values::jump::jump;
use crate::values::quintic::Quintic;
use crate::values::types::{ANCHORS, Candidate, FlatState, NetworkOutput, Odometry, Task, Time, Vec3};

/// Everything that the planner needs to know.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannerConfig {
    /// The camera as mounted.
    pub camera: CameraModel,
    /// The policy's contract.
    pub policy: PolicyModel,
    /// How to plan with them.
    pub planning: PlanningConfig,
}

/// How to plan, whatever the policy and the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanningConfig {
    /// The target filter.
    pub target: TargetConfig,
    /// Which detections count.
    pub select: SelectConfig,
    /// How the target is chased.
    pub chase: ChaseConfig,
    /// The acceleration that trajectories may ask of the vehicle, m/s².
    pub max_acc: f64,
    /// And the largest agility, above 0 and at most 1: less flies smoother, more turns quicker.
    pub max_agility: f64,
    /// What is nearer than this is remembered and flown around, m (6; 0: nothing is).
    pub remember: f64,
}

impl PlanningConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.target.validate()?;
        self.select.validate()?;
        self.chase.validate()?;
        within("planner.max_acc_mps2", self.max_acc, 1.0..=30.0, "less turns nowhere, more no airframe gives")?;
        within("planner.max_agility", self.max_agility, 0.05..=1.0, "1 is all that the training asks for")?;
        let far = "what stands farther is not looked through, so it would never be forgotten";
        within("planner.remember_within_m", self.remember, 0.0..=10.0, far)
    }
}

/// One frame.
#[derive(Clone, Copy, Debug)]
pub struct PlannerInput<'a> {
    /// Counts frames.
    pub seq: u64,
    /// Interpolated at the frame's capture stamp; its `stamp` is the frame's.
    pub odometry: &'a Odometry,
    /// Commanded acceleration at the stamp, m/s².
    pub acc_world: Vec3,
    /// Desired largest speed, m/s; sets alpha = speed / v_max.
    pub speed: f64,
    /// Navigation's goal; none while tracking.
    pub goal_world: Option<Vec3>,
    /// The network's raw answer to the frame.
    pub network: &'a NetworkOutput,
}

/// Where the target is, nothing is an obstacle: [`ChaseConfig::crowding`] keeps away from it.
fn about(target: &Expected) -> Ignored {
    Ignored { at_world: target.pos_world, radius: TARGET_RADIUS }
}

/// Aims, decodes, filters the target, remembers obstacles, chooses.
#[derive(Clone, Debug)]
pub struct Planner {
    config: PlannerConfig,
    decoder: Decoder,
    filter: TargetFilter,
    obstacles: Obstacles,
    chase: Chase,
    evader: Evader,
    /// The last frame's motion: stamp, position, velocity, reset counter.
    last: Option<Odometry>,
}

/// Beyond this gap between frames a jump of the odometry cannot be told from the flight itself, s.
const LONGEST_BRIDGED_GAP: f64 = 0.5;
/// A target that is farther off than this is not made room for, m.
const ROOM_MATTERS: f64 = 10.0;
/// What is so near to the target's axis is the target, m: half a person, its stride, and the estimate's error.
const TARGET_RADIUS: f64 = 0.8;

impl Planner {
    /// A planner with an empty target filter.
    ///
    /// # Errors
    /// A value out of range, or a camera that does not match the policy.
    pub fn new(config: PlannerConfig) -> Result<Self, ConfigError> {
        config.planning.validate()?;
        let decoder = Decoder::new(config.policy, &config.camera)?;
        let filter = TargetFilter::new(config.planning.target);
        let obstacles = Obstacles::new(config.camera.hfov, config.camera.vfov, config.planning.remember);
        let chase = Chase::new(config.planning.chase);
        Ok(Self { config, decoder, filter, obstacles, chase, evader: Evader::default(), last: None })
    }

    /// The configuration that it plans with.
    #[must_use]
    pub fn config(&self) -> &PlannerConfig {
        &self.config
    }

    /// alpha for a desired largest speed (m/s): speed / v_max, kept within 0.05..=10.
    #[must_use]
    pub fn alpha(&self, speed: f64) -> f64 {
        let alpha = speed / self.config.policy.v_max;
        if alpha.is_finite() { alpha.clamp(0.05, 10.0) } else { 1.0 }
    }

    /// The network's `state` input (eq. 5), camera frame: velocity / (alpha·v_max), acceleration / (alpha²·a_max), unit
    /// world-up, the aim / 2r, at most 1 long (the goal, or where the target will be; without either 0), and the
    /// agility: the share of alpha²·a_max that the vehicle can give, at most `max_agility`.
    pub fn network_state(
        &mut self,
        odometry: &Odometry,
        acc_world: Vec3,
        speed: f64,
        goal_world: Option<Vec3>,
    ) -> [f32; 13] {
        self.follow_jumps(odometry);
        let (p, how) = (&self.config.policy, &self.config.planning);
        let alpha = self.alpha(speed);
        let cam_from_world = (odometry.world_from_body * self.config.camera.body_from_cam).inverse();
        let vel_cam = cam_from_world * odometry.vel_world / (alpha * p.v_max);
        let acc_cam = cam_from_world * acc_world / (alpha * alpha * p.a_max);
        let up_cam = cam_from_world * Vec3::z();
        let aim_world = match p.task {
            Task::Navigate => goal_world.map(|goal| goal - odometry.pos_world),
            Task::Track => self
                .target(odometry.stamp)
                .map(|target| self.chase.aim(odometry.pos_world, &target, self.decoder.duration(alpha))),
        };
        let aim_cam = cam_from_world * within_reach(aim_world.unwrap_or_default(), 2.0 * p.radius);
        let mut state = [0.0; 13];
        for (i, v) in [vel_cam, acc_cam, up_cam, aim_cam].iter().enumerate() {
            for (axis, x) in v.iter().enumerate() {
                state[3 * i + axis] = *x as f32;
            }
        }
        state[12] = (how.max_acc / (alpha * alpha * p.a_max)).min(how.max_agility) as f32;
        state
    }

    /// Plans from the actual state at the frame's stamp (§III-D).
    pub fn step(&mut self, input: &PlannerInput) -> Plan {
        let odometry = input.odometry;
        self.follow_jumps(odometry);
        let alpha = self.alpha(input.speed);
        let world_from_cam = odometry.world_from_body * self.config.camera.body_from_cam;
        let cam_world = odometry.pos_world + odometry.world_from_body * self.config.camera.pos_cam_body;
        let pose = FramePose { start_world: odometry.pos_world, cam_world, world_from_cam };
        let mut candidates = self.decoder.decode(input.network, alpha, &pose);
        let stamp = odometry.stamp;
        let start = FlatState { pos: odometry.pos_world, vel: odometry.vel_world, acc: input.acc_world };
        let duration = self.decoder.duration(alpha);
        let movers = self.obstacles.movers(odometry.pos_world.z);
        let moving = |way: &Quintic| meeting(&movers, stamp, &|time| way.at(time).pos, way.duration());
        let chosen = match self.config.policy.task {
            Task::Navigate => {
                let avoided = |c: &Candidate| {
                    let climbing = input.goal_world.map_or(0.0, |goal| climbing(c.end.pos, goal));
                    let trajectory = Quintic::new(&start, &c.end, duration);
                    climbing + self.obstacles.meeting(&trajectory, None) + moving(&trajectory)
                };
                select(Some(avoided), &[None; ANCHORS], &mut candidates)
            }
            Task::Track => {
                let unseen = detect(&self.config.planning.select, stamp, cam_world, &mut self.filter, &candidates);
                let crowding = self.target(stamp).map(|target| {
                    let (chase, obstacles, moving) = (&self.config.planning.chase, &self.obstacles, &moving);
                    let ignored = about(&target);
                    move |c: &Candidate| {
                        let trajectory = Quintic::new(&start, &c.end, duration);
                        chase.crowding(&trajectory, &target)
                            + obstacles.meeting(&trajectory, Some(&ignored))
                            + moving(&trajectory)
                    }
                });
                select(crowding, &unseen, &mut candidates)
            }
        };
        let flown = chosen.map(|index| Quintic::new(&start, &candidates[index].end, duration));
        let ignored = self.target(stamp).map(|target| about(&target));
        let scene = Scene {
            stamp,
            obstacles: &self.obstacles,
            movers: &movers,
            ignored: ignored.as_ref(),
            chases: self.config.policy.task == Task::Track,
            threat: self
                .filter
                .estimate()
                .filter(|_| self.config.policy.task == Task::Track)
                .and_then(|target| Threat::of(&target, stamp)),
            keep_off: self.config.planning.chase.keep_off,
            target_acc: self.config.planning.target.max_acc,
        };
        let evasion = self.evader.step(&start, flown.as_ref(), &scene);
        Plan {
            seq: input.seq,
            stamp,
            start,
            world_from_cam,
            duration,
            alpha,
            candidates,
            chosen,
            target: self.filter.estimate(),
            room: self.is_near_target(odometry).then(|| self.obstacles.room(&odometry.pos_world)),
            movers,
            evasion,
        }
    }

    /// The target may be so near that the vehicle must make room.
    fn is_near_target(&self, odometry: &Odometry) -> bool {
        let near = |target: Expected| (target.pos_world - odometry.pos_world).norm() < ROOM_MATTERS;
        self.config.policy.task == Task::Track && self.target(odometry.stamp).is_some_and(near)
    }

    /// Takes in the nearest depths of a frame, before the network answers it; odometry at the frame's stamp.
    pub fn see(&mut self, odometry: &Odometry, nearest: &Nearest) {
        self.follow_jumps(odometry);
        let world_from_cam = odometry.world_from_body * self.config.camera.body_from_cam;
        let cam_world = odometry.pos_world + odometry.world_from_body * self.config.camera.pos_cam_body;
        let ignored = self.target(odometry.stamp).map(|target| about(&target));
        self.obstacles.see(odometry.stamp, (&cam_world, &world_from_cam), nearest, ignored.as_ref());
    }

    /// The target, if it is worth going after at `now`.
    fn target(&self, now: Time) -> Option<Expected> {
        self.filter.expected(now).filter(|target| self.config.planning.chase.pursues(target))
    }

    /// Forgets the target.
    pub fn reset(&mut self) {
        self.filter.reset();
        self.obstacles.reset();
        self.chase = Chase::new(self.config.planning.chase);
        self.evader = Evader::default();
        self.last = None;
    }

    /// When the odometry jumps, the target's place jumps with it.
    fn follow_jumps(&mut self, odometry: &Odometry) {
        if let Some(last) = self.last {
            let bridged = (0.0..=LONGEST_BRIDGED_GAP).contains(&odometry.stamp.since(last.stamp));
            let announced = last.reset_counter != odometry.reset_counter;
            match jump(&last, odometry) {
                Some(jump) if bridged => {
                    self.obstacles.reset();
                    self.filter.shift(jump.pos_world);
                }
                Some(_) if announced => {
                    self.obstacles.reset();
                    self.filter.reset();
                }
                _ => {}
            }
        }
        self.last = Some(*odometry);
    }
}
