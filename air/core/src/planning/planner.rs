//! One camera frame in, one plan out: [`Planner::see`] takes a frame and says what to ask the network, [`Asked::answer`]
//! takes what that answers and gives the plan. Each step's value is the next one's argument, so the order cannot be wrong.

use crate::gaze::expected::Expected;
use crate::gaze::hidden;
use crate::gaze::threat::Threat;
use crate::planning::aim::{Chase, ChaseConfig, NavigationConfig, climbing, crowding, within_reach};
use crate::planning::evade::{Evading, Evasion, EvasionConfig, Scene};
use crate::planning::frame::FrameInput;
use crate::planning::movers::{Movers, MoversConfig, meeting};
use crate::planning::obstacles::{Ignored, Obstacles, ObstaclesConfig};
use crate::planning::plan::Plan;
use crate::planning::select::{SelectConfig, detect, select};
use crate::planning::target::{TargetConfig, TargetFilter};
use crate::policy::decode::{Decoder, FramePose};
use crate::policy::model::{CameraModel, PolicyModel};
use crate::policy::state::{NetworkState, StateParts};
use crate::values::error::ConfigError;
use crate::values::extensions::Extensions;
use crate::values::jump::jump;
use crate::values::quintic::Quintic;
use crate::values::types::{ANCHORS, Added, Candidate, FlatState, NetworkOutput, Odometry, Task, Time, Vec3};
use schemars::JsonSchema;
use serde::Deserialize;

/// Everything that the planner needs to know.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannerConfig {
    /// The camera as mounted.
    pub camera: CameraModel,
    /// The policy's contract.
    pub policy: PolicyModel,
    /// How to plan with them.
    pub planning: PlanningConfig,
    /// What goes beyond the paper.
    pub extensions: Extensions,
    /// The least distance to the target, m: ways that come nearer cost more.
    pub keep_off: f64,
}

/// How to plan, whatever the policy and the camera.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanningConfig {
    /// Acceleration that trajectories may ask for, m/s²: below g tan(max_tilt), since gusts need some of it.
    #[schemars(range(min = 1.0, max = 30.0), extend("x-why" = "less turns nowhere, more no airframe gives", "x-source" = "tried, notebook: Navigation after the chase"))]
    pub max_acc_mps2: f64,
    /// The chase's largest share of the acceleration for which the speed asks in training: less flies smoother, more
    /// turns quicker.
    #[schemars(range(min = 0.05, max = 1.0), extend("x-why" = "1 is all that the training asks for", "x-source" = "tried, notebook: Navigation after the chase"))]
    pub max_agility: f64,
    /// What is seen nearer than this is remembered and flown around, if it moves too, m. 0: nothing is.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-why" = "what stands farther is not looked through, so it would never be forgotten", "x-source" = "where the D455's depth is good to 10 cm; tried against 0, notebook, What mattered: Memory"))]
    pub remember_within_m: f64,
    /// Which detections are worth a look.
    pub detection: SelectConfig,
    /// The target filter.
    pub target: TargetConfig,
    /// How a goal is flown to.
    pub navigation: NavigationConfig,
    /// How the target is chased.
    pub chase: ChaseConfig,
    /// What is added to the network's costs.
    pub costs: CostConfig,
    /// What is remembered as standing about the vehicle.
    pub obstacles: ObstaclesConfig,
    /// What counts as something that moves, and how far to keep from it.
    pub movers: MoversConfig,
    /// What the airframe can do to get out of the way.
    pub evasion: EvasionConfig,
}

/// What is added to the network's costs, in multiples of the policy's `cost_scale`: how far apart the costs of one image's
/// candidates are. With 4 to 5 whatever is in the way decides over all that the network prefers.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CostConfig {
    /// Meeting at once what stands and was seen; later it costs less.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-why" = "0 flies into it, and with more nothing else counts", "x-source" = "30 at the first, notebook: The costs' scale"))]
    pub obstacle: f64,
    /// Meeting at once what moves and was seen; later it costs less.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-why" = "0 flies into it, and with more nothing else counts", "x-source" = "30 at the first, notebook: The costs' scale"))]
    pub mover: f64,
    /// Flying through the target's centre; nothing at limits.min_target_distance_m.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-why" = "0 flies into it, and with more nothing else counts", "x-source" = "30 at the first, notebook: The costs' scale"))]
    pub target: f64,
    /// Each metre that a navigation ends over its goal, beyond 0.6 m.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-why" = "0 flies over roofs under which the goal lies, and with more nothing else counts", "x-source" = "tried, notebook, What mattered: Not climbing"))]
    pub climbing_per_m: f64,
}

impl PlanningConfig {
    /// Checks what no key says alone.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.target.validate()?;
        self.movers.validate()
    }

    /// With what is switched off at the value that does nothing.
    fn with(self, extensions: &Extensions) -> Self {
        let mut how = self;
        if !extensions.obstacle_memory {
            how.remember_within_m = 0.0;
        }
        if !extensions.least_distance {
            how.costs.target = 0.0;
        }
        if !extensions.no_climbing {
            how.costs.climbing_per_m = 0.0;
        }
        if !extensions.pace {
            how.navigation.pace = 1.0;
        }
        if !extensions.agility_limit {
            (how.max_agility, how.navigation.max_agility, how.max_acc_mps2) = (1.0, 1.0, f64::INFINITY);
        }
        if !extensions.weighted_detections {
            how.target.lateral_variance_m2 = how.target.range_variance_m2;
            (how.target.doubt, how.target.variance_distance_m) = (0.0, f64::INFINITY);
        }
        if !extensions.line_of_sight {
            how.chase.aside_m = 0.0;
        }
        if !extensions.pursuit {
            how.chase.pursue_until_s = hidden::BEHIND;
        }
        how
    }
}

/// Aims, decodes, filters the target, remembers obstacles, chooses.
#[derive(Clone, Debug)]
pub struct Planner {
    config: PlannerConfig,
    decoder: Decoder,
    filter: TargetFilter,
    obstacles: Obstacles,
    chase: Chase,
    evading: Evading,
    /// The last frame's motion: stamp, position, velocity, reset counter.
    last: Option<Odometry>,
    /// The last frame's flight.
    flight: u64,
}

/// A frame that the planner has seen: what it asks the network, whose answer makes the plan.
#[must_use = "a frame without an answer makes no plan"]
#[derive(Debug)]
pub struct Asked<'a> {
    planner: &'a mut Planner,
    frame: &'a FrameInput,
    pose: FramePose,
    state: NetworkState,
}

/// Beyond this gap between frames a jump of the odometry cannot be told from the flight itself, s. Chosen by eye.
const LONGEST_BRIDGED_GAP: f64 = 0.5;
/// A target that is farther off than this is not made room for, m. Chosen by eye.
const ROOM_MATTERS: f64 = 10.0;

impl Planner {
    /// A planner with an empty target filter.
    ///
    /// # Errors
    /// A value out of range, or a camera that does not match the policy.
    pub fn new(config: PlannerConfig) -> Result<Self, ConfigError> {
        config.planning.validate()?;
        let config = PlannerConfig { planning: config.planning.with(&config.extensions), ..config };
        let decoder = Decoder::new(config.policy, &config.camera)?;
        let filter = TargetFilter::new(config.planning.target, config.extensions);
        let (camera, how) = (&config.camera, &config.planning);
        let obstacles = Obstacles::new(camera.hfov, camera.vfov, how.remember_within_m, &how.obstacles, how.movers);
        let chase = Chase::new(config.planning.chase);
        let evading = Evading::new(config.planning.evasion);
        Ok(Self { config, decoder, filter, obstacles, chase, evading, last: None, flight: 0 })
    }

    /// This planner with all that it has seen, from here on with another configuration, for the same camera.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_config(self, config: PlannerConfig) -> Result<Self, ConfigError> {
        let Self { config, decoder, .. } = Self::new(config)?;
        let how = &config.planning;
        Ok(Self {
            filter: self.filter.with(how.target, config.extensions),
            obstacles: self.obstacles.with(how.remember_within_m, &how.obstacles, how.movers),
            chase: self.chase.with(how.chase),
            evading: self.evading.with(how.evasion),
            config,
            decoder,
            ..self
        })
    }

    /// The configuration that it plans with: what is switched off is at the value that does nothing.
    #[must_use]
    pub fn config(&self) -> &PlannerConfig {
        &self.config
    }

    /// What is remembered to stand about the vehicle, as voxels ([`crate::planning::obstacles::VOXEL`]) counted from the place that is returned
    /// (m), into `cells`; none: nothing was seen.
    pub fn remembered(&self, cells: &mut Vec<[u8; 3]>) -> Option<Vec3> {
        self.obstacles.remembered(cells)
    }

    /// alpha for the speed that a profile asks for (m/s): what the network is asked / v_max, kept within 0.05..=10.
    #[must_use]
    pub fn alpha(&self, speed: f64) -> f64 {
        let asked = match self.config.policy.task {
            Task::Navigate => self.config.planning.navigation.asked(speed),
            Task::Track => speed,
        };
        let alpha = asked / self.config.policy.v_max;
        if alpha.is_finite() { alpha.clamp(0.05, 10.0) } else { 1.0 }
    }

    /// Takes in a frame: what stands and moves in it, and what the network is to be asked.
    pub fn see<'a>(&'a mut self, frame: &'a FrameInput) -> Asked<'a> {
        if frame.flight != self.flight {
            self.forget();
            self.flight = frame.flight;
        }
        self.follow_jumps(&frame.odometry);
        let (stamp, pose) = (frame.odometry.stamp, self.pose(&frame.odometry));
        let ignored = self.target(stamp).map(|target| self.about(&target));
        self.obstacles.see(stamp, (&pose.cam_world, &pose.world_from_cam), &frame.nearest, ignored.as_ref());
        let state = self.network_state(frame, &pose);
        Asked { planner: self, frame, pose, state }
    }

    /// Where the lens was, and how it looked.
    fn pose(&self, odometry: &Odometry) -> FramePose {
        let camera = &self.config.camera;
        FramePose {
            start_world: odometry.pos_world,
            cam_world: odometry.pos_world + odometry.world_from_body * camera.pos_cam_body,
            world_from_cam: odometry.world_from_body * camera.body_from_cam,
        }
    }

    /// The network's `state` input, as far as the policy has it. The aim is the goal, or where the target will be; without
    /// either it is zero.
    fn network_state(&mut self, frame: &FrameInput, pose: &FramePose) -> NetworkState {
        let (alpha, odometry) = (self.alpha(frame.speed), &frame.odometry);
        let aim_world = match self.config.policy.task {
            Task::Navigate => frame.goal_world.map(|goal| goal - odometry.pos_world),
            Task::Track => self.target(odometry.stamp).map(|target| {
                let start = FlatState { pos: odometry.pos_world, vel: odometry.vel_world, acc: frame.acc_world };
                let (duration, ignored) = (self.decoder.duration(alpha), self.about(&target));
                self.chase.aim_in_sight(&start, &target, duration, &self.obstacles, &ignored)
            }),
        };
        let (p, how) = (&self.config.policy, &self.config.planning);
        let max_agility = match p.task {
            Task::Navigate => how.navigation.max_agility,
            Task::Track => how.max_agility,
        };
        let cam_from_world = pose.world_from_cam.inverse();
        p.state.state(&StateParts {
            velocity: cam_from_world * odometry.vel_world / (alpha * p.v_max),
            acceleration: cam_from_world * frame.acc_world / (alpha * alpha * p.a_max),
            up: cam_from_world * Vec3::z(),
            aim: cam_from_world * within_reach(aim_world.unwrap_or_default(), 2.0 * p.radius),
            agility: (how.max_acc_mps2 / (alpha * alpha * p.a_max)).min(max_agility),
        })
    }

    /// Takes in the candidates' detections, and chooses among their trajectories, which last `duration` s from `start`.
    fn choose(
        &mut self,
        frame: &FrameInput,
        cam_world: Vec3,
        (start, duration): (&FlatState, f64),
        movers: &Movers,
        candidates: &mut [Candidate; ANCHORS],
    ) -> Option<usize> {
        let stamp = frame.odometry.stamp;
        let (costs, scale) = (self.config.planning.costs, self.config.policy.cost_scale);
        let clearance = self.config.planning.movers.clearance_m;
        let moving =
            |way: &Quintic| costs.mover * meeting(movers, clearance, stamp, &|time| way.at(time).pos, way.duration());
        if self.config.policy.task == Task::Navigate {
            let avoided = |c: &Candidate| {
                let climbing = frame.goal_world.map_or(0.0, |goal| climbing(c.end.pos, goal));
                let trajectory = Quintic::new(start, &c.end, duration);
                let standing = costs.obstacle * self.obstacles.meeting(&trajectory, None);
                let (climbing, moving) = (costs.climbing_per_m * climbing, moving(&trajectory));
                Added {
                    obstacle: scale * standing,
                    mover: scale * moving,
                    target: 0.0,
                    climbing: scale * climbing,
                    total: scale * (climbing + standing + moving),
                }
            };
            return select(Some(avoided), &[None; ANCHORS], candidates);
        }
        let unseen = detect(&self.config.planning.detection, stamp, cam_world, &mut self.filter, candidates);
        if !self.config.extensions.choice_among_all {
            for (candidate, why) in candidates.iter_mut().zip(&unseen) {
                candidate.rejection = candidate.rejection.or(*why);
            }
        }
        let crowding = self.target(stamp).map(|target| {
            let (keep_off, obstacles, ignored) = (self.config.keep_off, &self.obstacles, self.about(&target));
            move |c: &Candidate| {
                let trajectory = Quintic::new(start, &c.end, duration);
                let standing = costs.obstacle * obstacles.meeting(&trajectory, Some(&ignored));
                let crowding = costs.target * crowding(keep_off, &trajectory, &target);
                let moving = moving(&trajectory);
                Added {
                    obstacle: scale * standing,
                    mover: scale * moving,
                    target: scale * crowding,
                    climbing: 0.0,
                    total: scale * (crowding + standing + moving),
                }
            }
        });
        select(crowding, &unseen, candidates)
    }

    /// What is flown instead of `flown`, out of the way of what moves.
    fn evade(&mut self, stamp: Time, start: &FlatState, flown: Option<&Quintic>, movers: &Movers) -> Option<Evasion> {
        let extensions = &self.config.extensions;
        if !extensions.stepping_aside {
            return None;
        }
        let ignored = self.target(stamp).map(|target| self.about(&target));
        let chases = self.config.policy.task == Task::Track;
        let scene = Scene {
            stamp,
            obstacles: &self.obstacles,
            movers,
            clearance: self.config.planning.movers.clearance_m,
            ignored: ignored.as_ref(),
            chases,
            threat: self
                .filter
                .estimate()
                .filter(|_| chases && extensions.least_distance)
                .and_then(|target| Threat::of(&target, stamp)),
            keep_off: self.config.keep_off,
            target_acc: self.config.planning.target.max_acc_mps2,
        };
        self.evading.step(start, flown, &scene)
    }

    /// The target may be so near that the vehicle must make room.
    fn is_near_target(&self, odometry: &Odometry) -> bool {
        let near = |target: Expected| (target.pos_world - odometry.pos_world).norm() < ROOM_MATTERS;
        self.config.policy.task == Task::Track && self.target(odometry.stamp).is_some_and(near)
    }

    /// The target, if it is worth going after at `now`.
    fn target(&self, now: Time) -> Option<Expected> {
        self.filter.expected(now).filter(|target| self.config.planning.chase.pursues(target))
    }

    /// Where the target is, nothing is an obstacle: [`crowding`] keeps away from it.
    fn about(&self, target: &Expected) -> Ignored {
        Ignored { at_world: target.pos_world, radius: self.config.planning.obstacles.target_radius_m }
    }

    /// Forgets all that was seen.
    fn forget(&mut self) {
        self.filter.reset();
        self.obstacles.reset();
        self.chase = Chase::new(self.config.planning.chase);
        self.evading = Evading::new(self.config.planning.evasion);
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
                    self.filter.shift(&jump);
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

impl Asked<'_> {
    /// The network's `state` input, as the contract lays it out.
    #[must_use]
    pub fn state(&self) -> &NetworkState {
        &self.state
    }

    /// Plans from the actual state at the frame's stamp (§III-D), with the network's raw answer.
    #[must_use]
    pub fn answer(self, network: &NetworkOutput) -> Plan {
        let Asked { planner, frame, pose, .. } = self;
        let (odometry, alpha) = (&frame.odometry, planner.alpha(frame.speed));
        let mut candidates = planner.decoder.decode(network, alpha, &pose);
        let start = FlatState { pos: odometry.pos_world, vel: odometry.vel_world, acc: frame.acc_world };
        let duration = planner.decoder.duration(alpha);
        let movers = planner.obstacles.movers(odometry.pos_world.z);
        let chosen = planner.choose(frame, pose.cam_world, (&start, duration), &movers, &mut candidates);
        let flown = chosen.map(|index| Quintic::new(&start, &candidates[index].end, duration));
        let evasion = planner.evade(odometry.stamp, &start, flown.as_ref(), &movers);
        Plan {
            seq: frame.seq,
            stamp: odometry.stamp,
            start,
            world_from_cam: pose.world_from_cam,
            duration,
            alpha,
            candidates,
            chosen,
            target: planner.filter.estimate(),
            look: planner.filter.look(),
            room: planner.is_near_target(odometry).then(|| planner.obstacles.room(&odometry.pos_world)),
            movers,
            evasion,
        }
    }
}
