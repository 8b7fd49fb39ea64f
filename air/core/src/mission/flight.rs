//! How each mode is flown, and the fallback ladder.

use crate::control::flatness::{FlatCommand, flat_command};
use crate::control::hover::brake;
use crate::control::lead::lead;
use crate::control::motion::Commanded;
use crate::gaze::Look;
use crate::gaze::threat::Threat;
use crate::mission::controller::Controller;
use crate::mission::interface::{ControllerOutput, Request, StepInput};
use crate::mission::landing::Phase;
use crate::mission::modes::{Fallback, Mode};
use crate::mission::takeoff::{Stage, repeat};
use crate::planning::evade::Evasion;
use crate::values::geometry::yaw_of;
use crate::values::types::{
    AttitudeThrust, FlatState, GRAVITY, Newtons, NormalisedThrust, Odometry, Rot, Task, Time, Vec3,
};

/// What a mode wants to fly.
struct Intent {
    reference: FlatState,
    /// After the lead and the speed's limit,
    led_world: Vec3,
    /// and after what else bends it: the image's edge, the least distance.
    acc_world: Vec3,
    fallback: Fallback,
    /// Sequence and age of the plan flown.
    plan: Option<(u64, f64)>,
}

impl Intent {
    /// The reference's acceleration, as far as the rules leave it: where they bend the command, it asks for little more
    /// than what is commanded. A plan that begins with what is not flown asks for ever more of it.
    fn kept(&self) -> Vec3 {
        let asked = self.reference.acc;
        let Some(bent) = (self.acc_world - self.led_world).try_normalize(1e-9) else { return asked };
        asked + bent * ((self.acc_world - asked).dot(&bent) - UNMET).max(0.0)
    }
}

/// So much more than what the rules allow the next plan may begin with, m/s²: with nothing it sets out after who runs off
/// too late. Tried: the notebook, "Held back, and let go".
const UNMET: f64 = 3.0;
/// Off the ground: above the start by this, m, or rising at this, m/s. Chosen by eye.
const LIFTED: (f64, f64) = (0.15, 0.3);
/// The take-off's thrust rises to this, over the greatest hover thrust that the vehicle file allows. Chosen by eye.
const RAMP_END: f64 = 1.25;
/// Stepping over a target ends so far below the ceiling, m. Chosen by eye.
const BELOW_CEILING: f64 = 1.0;

impl Controller {
    /// The output of the current mode; transition, reply and readiness are the caller's.
    pub(crate) fn fly(&mut self, now: Time, dt: f64, input: &StepInput) -> ControllerOutput {
        let request = self.sequence(now, input);
        if !self.mode.has_authority() {
            self.rest();
            return self.silent(request);
        }
        if !self.motors_wanted() {
            self.rest();
            return self.on_ground(request);
        }
        let Some(odometry) = self.believed(now).copied() else {
            if self.flight.as_ref().is_some_and(|flight| !flight.lifted) {
                self.rest();
                return self.on_ground(request);
            }
            return self.without_odometry(now, dt, request);
        };
        if let Some(thrust) = self.ramp(now, &odometry) {
            self.rest();
            return self.spool(thrust, request);
        }
        self.find_way(now, &odometry);
        let look = self.look(now, &odometry);
        let yaw = self.gaze.look(now, dt, look, &odometry);
        self.hold_apart(now);
        let mut intent = self.intent(now, &odometry);
        intent.acc_world = self.keep_apart(now, dt, &odometry, intent.acc_world);
        let disturbance = self.motion.observer().disturbance();
        let vehicle = self.motion.vehicle(&self.config.airframe);
        let mut command = flat_command(&vehicle, intent.acc_world, disturbance, yaw);
        if self.config.extensions.thrust_along_body {
            command.force = command.force_along(&vehicle, &odometry.world_from_body);
        }
        // A descent may already stand on the ground, which says nothing of how the vehicle flies.
        let descends = self.flight.as_ref().is_some_and(|flight| flight.landing.phase() != Phase::Brake);
        let free = self.mode != Mode::Stopping || !descends;
        self.output(now, request, &intent, &command, yaw, free)
    }

    /// Take-off's, landing's, the fault's and a given-up take-off's requests.
    fn sequence(&mut self, now: Time, input: &StepInput) -> Option<Request> {
        let mission = &self.config.mission;
        match self.mode {
            Mode::Takeoff => self.flight.as_mut()?.takeoff.step(mission, now, &input.autopilot),
            Mode::Stopping => {
                let climb = self.believed(now).map(|o| o.vel_world.z);
                let stopped = self.hover.is_stopped();
                let landing = &mut self.flight.as_mut()?.landing;
                // Without odometry the landing waits, but for a cut that has begun.
                match (climb, landing.phase()) {
                    (None, Phase::Brake | Phase::Descend) => None,
                    (climb, _) => landing.step(mission, now, climb.unwrap_or(0.0), stopped, &input.autopilot),
                }
            }
            Mode::Fault if self.handing_back && input.autopilot.offboard => {
                repeat(&mut self.asked_back, now, mission.request_period_s).then_some(Request::HandBack)
            }
            _ => self.abandoned.as_mut().and_then(|abandoned| abandoned.step(mission, now, &input.autopilot)),
        }
    }

    /// On the ground, or without authority: the observer and the yaw plan follow the vehicle.
    fn rest(&mut self) {
        self.motion.rest();
        self.commanded = Commanded::default();
        if let Some(odometry) = self.motion.last() {
            self.gaze.rest(yaw_of(&odometry.world_from_body));
        }
    }

    fn motors_wanted(&self) -> bool {
        self.flight.as_ref().is_some_and(|flight| match self.mode {
            Mode::Takeoff => flight.takeoff.stage() == Stage::Climb,
            Mode::Stopping => flight.landing.phase() != Phase::Cut,
            _ => true,
        })
    }

    /// Before the vehicle has left the ground: the thrust to try next, which rises until it lifts. How much that takes
    /// is what the vehicle file may have wrong.
    fn ramp(&mut self, now: Time, odometry: &Odometry) -> Option<NormalisedThrust> {
        let ([_, most], ramp) = (self.config.airframe.hover_thrust_range, self.config.mission.takeoff_ramp_s);
        let takes_off = self.mode == Mode::Takeoff;
        let flight = self.flight.as_mut().filter(|flight| takes_off && !flight.lifted)?;
        let end = (RAMP_END * most).min(self.config.airframe.max_thrust);
        let tried = NormalisedThrust(end * (flight.takeoff.elapsed(now) / ramp).min(1.0));
        let height = odometry.pos_world.z - flight.start_world.z;
        if height < LIFTED.0 && odometry.vel_world.z < LIFTED.1 {
            return Some(tried);
        }
        flight.lifted = true;
        self.motion.lift_off(tried);
        None
    }

    fn intent(&mut self, now: Time, odometry: &Odometry) -> Intent {
        let (pos, vel) = (odometry.pos_world, odometry.vel_world);
        let (hold, mission) = (&self.config.hold, &self.config.mission);
        let task = self.flight.as_ref().map_or(Task::Track, |f| f.profile.task);
        let mut fallback = Fallback::None;
        if let Some(evasion) = self.evading(now) {
            self.hover.reset();
            let acc = self.config.limits.within_speed(evasion.acc(&self.config.evasion, pos.z, vel), vel, hold.kv);
            let reference = FlatState { pos, vel: evasion.vel_world, acc };
            return Intent { reference, led_world: acc, acc_world: acc, fallback, plan: None };
        }
        let flies = matches!(self.mode, Mode::Track | Mode::Navigate);
        if let Some(flown) = self.plans.flyable(&self.config.ladder, task, now).filter(|_| flies) {
            self.hover.reset();
            let age = now.since(flown.stamp);
            let reference = flown.quintic.at(age);
            let ahead = self.config.lead.ahead(task, self.motion.attitude_lag());
            let led = lead(&self.config.lead, ahead, reference.acc, flown.quintic.jerk(age));
            let led_world = self.config.limits.within_speed(led, vel, hold.kv);
            let acc_world = match task {
                Task::Track if self.config.extensions.view_limit => {
                    self.gaze.keeping_in_view(now, led_world, self.motion.observer().disturbance(), pos)
                }
                _ => led_world,
            };
            return Intent { reference, led_world, acc_world, fallback, plan: Some((flown.seq, age)) };
        }
        let reference = match (self.mode, self.flight.as_ref()) {
            (Mode::Track | Mode::Navigate, _) => {
                let reference = self.hover.step(hold, pos, vel);
                fallback = self.hover_rung();
                reference
            }
            (Mode::Takeoff, Some(flight)) => {
                if !self.hover.is_stopped() {
                    self.hover.hold(flight.start_world);
                }
                let climb = (hold.kp / hold.kv * (flight.height() - pos.z))
                    .clamp(-mission.climb_speed_mps, mission.climb_speed_mps);
                self.hover.step_vertical(hold, pos, vel, climb)
            }
            (Mode::Stopping, Some(flight)) if flight.landing.phase() == Phase::Descend => {
                let low = pos.z - flight.start_world.z < mission.slow_height_m;
                let speed = if low { mission.touchdown_speed_mps } else { mission.descent_speed_mps };
                self.hover.step_vertical(hold, pos, vel, -speed)
            }
            _ => {
                let reference = self.hover.step(hold, pos, vel);
                // A search needs frames; without them it is a hold for want of plans.
                if self.mode == Mode::Search && !self.plans.frames_arrive(&self.config.ladder, now) {
                    fallback = self.hover_rung();
                }
                reference
            }
        };
        Intent { reference, led_world: reference.acc, acc_world: reference.acc, fallback, plan: None }
    }

    /// The way aside that is flown, if something moves in the vehicle's way.
    pub(crate) fn evading(&self, now: Time) -> Option<Evasion> {
        let may = matches!(self.mode, Mode::Track | Mode::Navigate | Mode::Hold | Mode::Search);
        let mut evasion = self.plans.evading(&self.config.ladder, now).filter(|_| may)?;
        // Not so high that the flight would end.
        let most = self.flight.as_ref().map_or(0.0, |flight| flight.start_world.z) + self.config.limits.ceiling_m
            - BELOW_CEILING;
        evasion.height = evasion.height.map(|height| height.min(most));
        Some(evasion)
    }

    /// What is held keeps its distance from a target that is held beside.
    fn hold_apart(&mut self, now: Time) {
        let stays = matches!(self.mode, Mode::Hold | Mode::Search);
        if let Some(threat) = self.threat(now).filter(|_| stays) {
            self.hover.keep_from(threat.pos_world, self.config.separation.min_distance + threat.pos_doubt);
        }
    }

    /// `acc_world` such that the least distance to the target is kept, and to who looks like it elsewhere.
    fn keep_apart(&mut self, now: Time, dt: f64, odometry: &Odometry, acc_world: Vec3) -> Vec3 {
        let state = [odometry.pos_world, odometry.vel_world];
        let config = &self.config.separation;
        let acc_world = match self.gaze.lookalike(now).filter(|_| self.keeps_apart()) {
            Some(lookalike) => self.separations[1].keep(config, dt, acc_world, state, &lookalike, self.plans.room()),
            None => acc_world,
        };
        let Some(threat) = self.threat(now) else { return acc_world };
        let acc_world = match self.evading(now) {
            Some(evasion) if evasion.from_target => acc_world,
            _ => self.separations[0].keep(config, dt, acc_world, state, &threat, self.plans.room()),
        };
        // A landing is told by its descent.
        if self.mode == Mode::Stopping { acc_world } else { config.stay_above(acc_world, state, &threat) }
    }

    /// The target, where it may have to be kept away from.
    fn threat(&self, now: Time) -> Option<Threat> {
        self.gaze.threat(now).filter(|_| self.keeps_apart())
    }

    /// A distance is to be kept.
    pub(crate) fn keeps_apart(&self) -> bool {
        let chases = self.flight.as_ref().is_some_and(|flight| flight.profile.task == Task::Track);
        chases && self.config.extensions.least_distance
    }

    fn hover_rung(&self) -> Fallback {
        if self.hover.is_stopped() { Fallback::HoldPosition } else { Fallback::PlanExpiredBrake }
    }

    /// What the camera is to look for.
    fn look(&self, now: Time, odometry: &Odometry) -> Look {
        let Some(flight) = &self.flight else { return Look::Keep };
        match self.mode {
            Mode::Track => Look::Chase,
            Mode::Hold => Look::Hold,
            Mode::Search => Look::Search { around: now.since(self.entered) > self.config.yaw.search_delay_s },
            Mode::Navigate => Look::Way(flight.waypoint_world.unwrap_or(odometry.pos_world)),
            _ => Look::Keep,
        }
    }

    /// A navigation that flies toward its goal may be stuck on the way.
    fn find_way(&mut self, now: Time, odometry: &Odometry) {
        let Some(flight) = &mut self.flight else { return };
        let Some(goal) = flight.goal_world else { return };
        flight.waypoint_world = Some(match self.mode {
            Mode::Navigate if self.config.extensions.detours => flight.detour.step(now, odometry.pos_world, goal),
            _ => {
                flight.detour.rest();
                goal
            }
        });
    }

    /// Odometry is stale or not believed: brake by dead reckoning where there is any, then level, slightly below hover
    /// thrust.
    fn without_odometry(&mut self, now: Time, dt: f64, request: Option<Request>) -> ControllerOutput {
        // What is remembered of the place is worthless when odometry comes back.
        self.hover.reset();
        let yaw = self.gaze.keep(dt);
        let (ladder, hold) = (&self.config.ladder, &self.config.hold);
        let live = self.motion.age(now).is_some_and(|age| age <= ladder.odometry_stale_s);
        let distrust = self.motion.distrust().filter(|_| live);
        let disturbance = distrust.map_or_else(|| self.motion.observer().disturbance(), |d| d.disturbance);
        let moving = distrust.and_then(|d| d.moving(hold.stopped_speed_mps).map(|vel_world| (*d, vel_world)));
        let (acc_world, disturbance, fallback) = match moving {
            Some((distrust, vel_world)) => {
                let turn = distrust.loop_from_world();
                (turn * brake(hold, vel_world), turn * disturbance, Fallback::OdometryFalseBrake)
            }
            // Of the disturbance only the vertical part stays: it corrects the hover thrust and tilts nothing.
            None => (
                Vec3::new(0.0, 0.0, -ladder.descend_acc_mps2),
                Vec3::new(0.0, 0.0, disturbance.z),
                Fallback::OdometryStaleDescend,
            ),
        };
        let vehicle = self.motion.vehicle(&self.config.airframe);
        let mut command = flat_command(&vehicle, acc_world, disturbance, yaw);
        // Where the attitude is not known the thrust is that of the attitude which is on its way.
        let tilted = moving.filter(|(distrust, _)| !distrust.attitude_stands);
        if let Some((odometry, (distrust, _))) = self.motion.last().zip(tilted) {
            command.force = command.force_along(&vehicle, &distrust.loop_from_body(&odometry.world_from_body));
        }
        let reference = FlatState { acc: acc_world, ..FlatState::default() };
        let intent = Intent { reference, led_world: acc_world, acc_world, fallback, plan: None };
        self.output(now, request, &intent, &command, yaw, moving.is_some())
    }

    fn output(
        &mut self,
        now: Time,
        request: Option<Request>,
        intent: &Intent,
        command: &FlatCommand,
        yaw: f64,
        free: bool,
    ) -> ControllerOutput {
        let vehicle = self.motion.vehicle(&self.config.airframe);
        let thrust = vehicle.normalised(command.force);
        self.commanded = Commanded { thrust, acc: vehicle.force(thrust).0 / vehicle.mass_kg, free, airborne: true };
        self.motion.command(now, &command.world_from_body);
        ControllerOutput {
            fallback: intent.fallback,
            setpoint: Some(AttitudeThrust { world_from_body: command.world_from_body, thrust }),
            flat: intent.reference,
            acc_des_world: intent.reference.acc,
            acc_kept_world: intent.kept(),
            acc_att_world: command.acc_att_world,
            thrust: command.force,
            yaw_des: yaw,
            plan_seq: intent.plan.map(|p| p.0),
            plan_age: intent.plan.map(|p| p.1),
            ..self.silent(request)
        }
    }

    /// Level, no thrust.
    fn on_ground(&self, request: Option<Request>) -> ControllerOutput {
        self.spool(NormalisedThrust(0.0), request)
    }

    /// Level on the ground, with a thrust that does not lift.
    fn spool(&self, thrust: NormalisedThrust, request: Option<Request>) -> ControllerOutput {
        let world_from_body = Rot::from_axis_angle(&Vec3::z_axis(), self.gaze.yaw());
        let vehicle = self.motion.vehicle(&self.config.airframe);
        let force = vehicle.force(thrust);
        ControllerOutput {
            setpoint: Some(AttitudeThrust { world_from_body, thrust }),
            acc_att_world: Vec3::new(0.0, 0.0, force.0 / vehicle.mass_kg - GRAVITY),
            thrust: force,
            ..self.silent(request)
        }
    }

    /// No setpoint.
    fn silent(&self, request: Option<Request>) -> ControllerOutput {
        ControllerOutput {
            mode: self.mode,
            fallback: if self.handing_back { Fallback::HandBack } else { Fallback::None },
            setpoint: None,
            request,
            flat: FlatState::default(),
            acc_des_world: Vec3::zeros(),
            acc_kept_world: Vec3::zeros(),
            acc_att_world: Vec3::zeros(),
            acc_disturbance_world: self.motion.observer().disturbance(),
            disturbance_limit: self.config.observer.limit_mps2,
            acc_meas_world: None,
            thrust: Newtons(0.0),
            hover_thrust: self.motion.vehicle(&self.config.airframe).hover_thrust,
            attitude_lag: self.motion.attitude_lag(),
            odometry_fault: self.motion.fault(),
            odometry_doubt: self.motion.doubt(),
            yaw_des: self.gaze.yaw(),
            plan_seq: None,
            plan_age: None,
            planning: self.planning(),
            transition: None,
            reply: None,
            readiness: Ok(()),
        }
    }
}
