//! The classical pilot: the vehicle's own mission, detector and target filter, its own map, trajectories and control.

use goshawk_core::{
    ANCHORS, Added, AutopilotStatus, Candidate, Command, Controller, ControllerOutput, FlatState, History, Imu,
    Odometry, Plan, PlanningDemand, Rejection, StepInput, TargetEstimate, Task, Time, Vec3, hidden_for,
};
use goshawk_vehicle::config::Vehicle;

use goshawk_policy::stream::Arrival;

use super::map::Ignored;
use super::planner::{Aim, MapPlanner};
use super::spline::Spline;
use super::tracker::{Reference, Tracker, carried};
use crate::render::CameraPose;
use crate::sense::rgbd::RgbdImage;
use crate::trial::airframe::Mount;
use crate::trial::onboard::{Network, POLICY_S, PolicyPlanner, Seen};
use crate::trial::spent::{Spent, Stopwatch};
use crate::trial::{FRAME_AT_PLANNER_S, Pilot, TrialError};

/// From a frame's being there to the trajectory's being there, s; for detecting the target the policy's time is added.
///
/// A constant, so that flights are the same on every machine. It records what `cargo bench -p goshawk-sim --bench
/// classical` measured on one core of a busy 2-core Intel Xeon server (AVX-512): p50 4.5 ms, p99 8.9 ms, of which mapping
/// 2.5 and 3.6, search 1.7 and 5.8, optimisation 0.3 and 0.4; rounded up.
pub const COMPUTE_S: f64 = 0.010;

/// A new trajectory is planned every so many frames (10 Hz), and whenever the one that is flown is no longer clear.
const REPLAN_FRAMES: u32 = 3;
/// A trajectory goes on from the last one unless the vehicle is farther off it than this, m: then from where it is.
const OFF_TRACK_M: f64 = 0.8;
/// The target is followed at this distance, m, and so much more for its speed, s; this much above its centre, m.
const FOLLOW_M: f64 = 2.5;
const FOLLOW_S: f64 = 0.5;
const ABOVE_M: f64 = 0.3;
/// Where the target will be in this time is aimed at, s. A hidden one is carried on for so long, s.
const AHEAD_S: f64 = 0.9;
const CARRY_S: f64 = 1.5;
/// The target itself is no obstacle.
const TARGET_RADIUS_M: f64 = 0.8;
const TARGET_HALF_HEIGHT_M: f64 = 1.4;
/// The anchor that stands for the trajectory in a plan's record.
const MIDDLE: usize = ANCHORS / 2;

/// A trajectory with its place in time.
#[derive(Clone, Debug)]
struct Trajectory {
    begins: Time,
    spline: Spline,
}

impl Trajectory {
    fn at(&self, now: Time) -> Reference {
        let (flat, jerk) = self.spline.at(now.since(self.begins));
        Reference { flat, jerk }
    }
}

/// A map-based planner and a tracking controller in the vehicle's mission.
pub struct Classical<'a> {
    controller: Controller,
    tracker: Tracker,
    planner: MapPlanner,
    /// Finds the target; none in navigation.
    detector: Option<PolicyPlanner<'a>>,
    mount: Mount,
    history: History,
    odometry: Option<Odometry>,
    imu: Option<Imu>,
    demand: Option<PlanningDemand>,
    plan: Option<Plan>,
    flown: Option<Trajectory>,
    /// Planned, but not yet there.
    coming: Option<Trajectory>,
    /// The controller flew a plan in its last step.
    flying: bool,
    frames: u64,
    /// Frames since the last trajectory was planned.
    since_planned: u32,
    spent: Spent,
}

impl<'a> Classical<'a> {
    /// The pilot of `vehicle`; to track it needs a `network` that detects the target.
    ///
    /// # Errors
    /// If the vehicle file cannot be flown with, or does not fit the policy.
    pub fn new(vehicle: &Vehicle, mount: &Mount, network: Option<&'a mut dyn Network>) -> Result<Self, TrialError> {
        let config = vehicle.controller_config();
        Ok(Self {
            controller: Controller::new(config.clone())?,
            tracker: Tracker::new(config),
            planner: MapPlanner::default(),
            detector: network.map(|network| PolicyPlanner::new(vehicle, mount, network)).transpose()?,
            mount: *mount,
            history: History::new(),
            odometry: None,
            imu: None,
            demand: None,
            plan: None,
            flown: None,
            coming: None,
            flying: false,
            frames: 0,
            since_planned: 0,
            spent: Spent::default(),
        })
    }

    /// The frame's record without a trajectory: what it shows of the target.
    fn seen(&mut self, seen: &Seen<'_>, image: &RgbdImage) -> Result<Plan, TrialError> {
        let own = |plan: Plan| Plan { chosen: None, evasion: None, ..plan };
        if let Some(detector) = &mut self.detector {
            return detector.plan(seen, image).map(|(plan, _)| own(plan));
        }
        let odometry = seen.odometry;
        let start = FlatState { pos: odometry.pos_world, vel: odometry.vel_world, acc: seen.acc_world };
        let candidate = Candidate {
            end: start,
            cost: 0.0,
            added: Added::default(),
            objectness: 1.0,
            target_world: None,
            rejection: Some(Rejection::Cost),
        };
        Ok(Plan {
            seq: seen.seq,
            stamp: odometry.stamp,
            start,
            world_from_cam: odometry.world_from_body * self.mount.body_from_cam,
            duration: 1.0,
            alpha: 1.0,
            candidates: [candidate; ANCHORS],
            chosen: None,
            target: None,
            look: None,
            room: None,
            movers: [None; goshawk_core::planning::movers::MOST],
            evasion: None,
        })
    }

    /// Where the target, if it is worth going after, should be `after_s` later: position and velocity.
    fn expected(&self, target: &TargetEstimate, now: Time, after_s: f64) -> Option<(Vec3, Vec3)> {
        let until = self.detector.as_ref()?.pursue_until_s();
        let known = target.confirmed || target.last_seen != target.stamp;
        if !known || hidden_for(target.last_seen, now) > until {
            return None;
        }
        let carry = (now.since(target.stamp) + after_s).clamp(0.0, CARRY_S);
        Some((target.pos_world + target.vel_world * carry, target.vel_world))
    }

    fn aim(&self, demand: &PlanningDemand, plan: &Plan, start: &FlatState) -> Option<Aim> {
        if demand.task == Task::Navigate {
            let pos_world = demand.goal_world?;
            return Some(Aim { pos_world, vel_world: Vec3::zeros(), after_s: 0.0 });
        }
        let (at, vel) = self.expected(plan.target.as_ref()?, plan.stamp, AHEAD_S)?;
        let vel = Vec3::new(vel.x, vel.y, 0.0);
        let now = at - vel * AHEAD_S;
        // No backing off from a target that is near, unless it is very near: what is behind is not seen.
        let follow = FOLLOW_M + FOLLOW_S * vel.norm();
        let distance = (now - start.pos).xy().norm().clamp(0.5 * follow, follow);
        let line = at - start.pos;
        let line = Vec3::new(line.x, line.y, 0.0).try_normalize(1e-6).unwrap_or_default();
        let mut pos_world = at - line * distance;
        pos_world.z = at.z + ABOVE_M;
        Some(Aim { pos_world, vel_world: vel, after_s: AHEAD_S })
    }

    /// The state in which a trajectory that begins at `begins` must begin.
    fn start(&self, seen: &Seen<'_>, begins: Time) -> FlatState {
        let odometry = seen.odometry;
        let stamp = odometry.stamp;
        let on_track = self
            .flown
            .as_ref()
            .filter(|flown| self.flying && (flown.at(stamp).flat.pos - odometry.pos_world).norm() < OFF_TRACK_M);
        if let Some(flown) = on_track {
            return flown.at(begins).flat;
        }
        FlatState { pos: carried(odometry, begins), vel: odometry.vel_world, acc: Vec3::zeros() }
    }

    /// The trajectory to fly from `begins` on: a new one, or the old one while that is clear, or one that stops.
    fn trajectory(&mut self, aim: &Aim, speed_mps: f64, start: &FlatState, begins: Time) -> Trajectory {
        self.since_planned += 1;
        let planner = &self.planner;
        let kept = self.flown.as_ref().filter(|flown| {
            let passed = begins.since(flown.begins);
            self.flying && passed < flown.spline.duration() && planner.is_clear(&flown.spline, passed)
        });
        if let Some(kept) = kept.filter(|_| self.since_planned < REPLAN_FRAMES) {
            return kept.clone();
        }
        let goal = planner.local_goal(start, aim, speed_mps);
        let path = planner.search(start, &goal, speed_mps);
        let spline = path.and_then(|path| planner.refine(start, &goal, &path, speed_mps));
        match (spline, kept) {
            (Some(spline), _) => {
                self.since_planned = 0;
                Trajectory { begins, spline }
            }
            (None, Some(kept)) => kept.clone(),
            (None, None) => Trajectory { begins, spline: planner.stop(start) },
        }
    }
}

impl Pilot for Classical<'_> {
    fn compute_s(&self) -> f64 {
        COMPUTE_S + if self.detector.is_some() { POLICY_S } else { 0.0 }
    }

    fn take_odometry(&mut self, odometry: &Odometry) {
        if self.odometry.is_some_and(|last| last.reset_counter != odometry.reset_counter) {
            // The frame has moved: what was mapped and planned in the old one is in the wrong place.
            self.planner = MapPlanner::default();
            (self.flown, self.coming) = (None, None);
        }
        self.history.push_odometry(odometry);
        self.tracker.take_odometry(odometry);
        self.odometry = Some(*odometry);
    }

    fn take_imu(&mut self, imu: &Imu) {
        self.imu = Some(imu.with_unsigned_zeros());
    }

    fn plan(&mut self, arrival: &Arrival, image: &RgbdImage) -> Result<Option<Plan>, TrialError> {
        let stamp = arrival.stamp;
        self.frames += 1;
        let (Some(demand), Some(odometry)) = (self.demand, self.history.odometry_at(stamp)) else { return Ok(None) };
        let acc_world = self.history.acceleration_at(stamp);
        let seen = Seen { flight: 0, seq: self.frames, odometry: &odometry, acc_world, demand: &demand };
        let mut watch = Stopwatch::start();
        let mut plan = self.seen(&seen, image)?;
        self.spent.perception_s = watch.lap();
        let pose = CameraPose {
            pos_world: odometry.pos_world + odometry.world_from_body * self.mount.pos_cam_body,
            world_from_cam: plan.world_from_cam,
        };
        let ignored = plan.target.and_then(|target| self.expected(&target, stamp, 0.0)).map(|(at_world, _)| Ignored {
            at_world,
            radius_m: TARGET_RADIUS_M,
            half_height_m: TARGET_HALF_HEIGHT_M,
        });
        self.planner.see(&self.mount.camera, &pose, &image.depth_mm, ignored.as_ref());
        self.spent.mapping_s = watch.lap();
        let begins = stamp.plus(FRAME_AT_PLANNER_S + self.compute_s());
        let start = self.start(&seen, begins);
        self.coming = None;
        if let Some(aim) = self.aim(&demand, &plan, &start) {
            let trajectory = self.trajectory(&aim, demand.speed, &start, begins);
            // For the record, and for the controller to know that there is a way.
            plan.duration = (begins.since(trajectory.begins) + trajectory.spline.duration()).max(1.0);
            plan.candidates[MIDDLE].end = trajectory.at(stamp.plus(plan.duration)).flat;
            plan.candidates[MIDDLE].rejection = None;
            plan.chosen = Some(MIDDLE);
            self.coming = Some(trajectory);
        }
        self.spent.planning_s = watch.lap();
        Ok(Some(plan))
    }

    fn take_plan(&mut self, plan: Plan) {
        self.plan = Some(plan);
        if let Some(trajectory) = self.coming.take() {
            self.flown = Some(trajectory);
        }
    }

    fn spent(&self) -> Spent {
        self.spent
    }

    fn odometry(&self) -> Option<&Odometry> {
        self.odometry.as_ref()
    }

    fn control(&mut self, now: Time, autopilot: AutopilotStatus, command: Option<Command>) -> ControllerOutput {
        let mut watch = Stopwatch::start();
        let plan_seq = self.plan.as_ref().map(|plan| plan.seq);
        let input = StepInput { odometry: self.odometry, imu: self.imu, plan_seq, autopilot, command, ready: true };
        let mut output = self.controller.step(now, &input, self.plan.as_ref());
        self.flying = output.plan_seq.is_some();
        let reference = self.flown.as_ref().filter(|_| self.flying).map(|flown| flown.at(now));
        self.tracker.command(now, reference.as_ref(), &mut output);
        self.history.push_acceleration(now, output.acc_des_world);
        self.demand = output.planning;
        self.spent.control_s = watch.lap();
        output
    }
}
