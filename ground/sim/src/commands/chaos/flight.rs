//! One chaos flight in lockstep: physics and autopilot at 1 kHz, the vehicle's own software, what the schedule does to
//! all of them, and a judge at every step. No clock and no thread: the flight is a function of its schedule.

use std::rc::Rc;

use goshawk_core::{Cause, Mode, NormalisedThrust, Time, Vec3};
use goshawk_proto::v1;
use goshawk_vehicle::config::Vehicle;

use super::aboard::Aboard;
use super::acting::Acting;
use super::acting::autopilot::Autopilot;
use super::acting::camera::Camera;
use super::acting::odometry::Odometer;
use super::acting::operator::Operator;
use super::acting::senses::{FalseOdometry, Spoilt, Wrong, wrong_network};
use super::bug::{Bug, Bugged};
use super::judge::examine::examine;
use super::judge::properties::{BEGIN, Facts, Judge, Violation};
use super::judge::recorder::{Recorder, Written};
use super::schedule::{Kind, Schedule};
use crate::sense::file::Sensors;
use crate::sense::rgbd::mix;
use crate::trial::airframe::{Mount, airframe};
use crate::trial::fault::followed;
use crate::trial::judge::{Contact, Follower, contact};
use crate::trial::{Fault as Sense, Network, Scene, TrialError};
use crate::vehicle::quadrotor::{Quadrotor, STEP_S, Wind};

const WIND_STEPS: u64 = 10;
const CONTACT_STEPS: u64 = 10;
/// Of a bug.
const UNLOGGED: u64 = 500;
/// A flight that is over is watched for so long, s.
const AFTERWARDS_S: f64 = 1.2;

/// What came of a schedule.
#[derive(Clone, Debug, PartialEq)]
pub struct Flown {
    /// How it ended.
    pub ended: &'static str,
    /// The first property that did not hold; none: all held.
    pub violation: Option<Violation>,
    /// Simulated, s.
    pub flown_s: f64,
    /// Changes of mode: s since the beginning, what to, why.
    pub modes: Vec<(f64, Mode, Cause)>,
    /// Steps of the controller.
    pub steps: u64,
    /// Logs read back and replayed.
    pub logs: usize,
    /// Over all that the controller answered, to the last bit.
    pub digest: u64,
}

/// What all flights of a campaign have in common.
pub(super) struct Ground<'a> {
    /// The vehicle, as the schedule's setting has it.
    pub(super) vehicle: &'a Vehicle,
    /// Where it flies.
    pub(super) scene: &'a Scene,
    /// What each log begins with.
    pub(super) header: &'a v1::LogHeader,
    /// What is wrong around the controller.
    pub(super) bug: Option<Bug>,
}

/// Flies `schedule` to its end, or to the first step at which a property does not hold.
///
/// # Errors
/// It cannot be flown at all.
pub(super) fn fly(schedule: &Schedule, ground: &Ground<'_>, network: &mut dyn Network) -> Result<Flown, TrialError> {
    let wrong = Wrong::default();
    let mut network = Spoilt::new(network, Rc::clone(&wrong), schedule.seed);
    let mut chaos = Chaos::new(schedule, ground, &mut network, wrong)?;
    let mut violation = None;
    while violation.is_none() && !chaos.is_over() {
        violation = chaos.tick()?;
    }
    let (mut flown, logs) = chaos.end();
    flown.violation = violation.or_else(|| logs.iter().find_map(|log| examined(schedule, log).err()));
    flown.logs = logs.len();
    Ok(flown)
}

/// Reads a log back: as the disk has it, and cut off where the schedule says.
fn examined(schedule: &Schedule, log: &Written) -> Result<(), Violation> {
    let stalled = schedule.faults.iter().any(|fault| fault.what == Kind::DiskSlow);
    examine(log, log.bytes.len(), stalled)?;
    for fault in &schedule.faults {
        if let Kind::LogCut(share) = fault.what {
            examine(log, (log.bytes.len() as f64 * share.clamp(0.0, 1.0)) as usize, stalled)?;
        }
    }
    Ok(())
}

/// Faults with which the odometry may be false, or the place of the start another one.
fn is_false(kind: &Kind) -> bool {
    let senses = matches!(kind, Kind::Sense(Sense::Odometry(_)) | Kind::NoPosition | Kind::Restarts(_));
    senses
        || matches!(kind, Kind::OdometryStamped(_) | Kind::OdometrySwapped | Kind::OdometryLate(_) | Kind::OdometryNan)
}

/// The clockwork.
struct Chaos<'a> {
    schedule: &'a Schedule,
    ground: &'a Ground<'a>,
    aboard: Aboard<'a>,
    autopilot: Autopilot,
    operator: Operator,
    recorder: Recorder,
    judge: Judge,
    acting: Acting,
    wrong: Wrong,
    quad: Quadrotor,
    wind: Wind,
    wind_world: Vec3,
    camera: Camera,
    odometer: Odometer,
    follower: Follower,
    control_steps: u64,
    step: u64,
    paused_s: f64,
    calm_since: Time,
    mode: Mode,
    flew: bool,
    /// The motors run: before, nobody looks at the pictures.
    powered: bool,
    contact: Option<Contact>,
    rested: Option<Time>,
    modes: Vec<(f64, Mode, Cause)>,
    steps: u64,
    digest: u64,
}

impl<'a> Chaos<'a> {
    fn new(
        schedule: &'a Schedule,
        ground: &'a Ground<'a>,
        network: &'a mut Spoilt<'_>,
        wrong: Wrong,
    ) -> Result<Self, TrialError> {
        let (vehicle, seed, scene) = (ground.vehicle, schedule.seed, ground.scene);
        let parameters = airframe(vehicle);
        let start = scene.vehicle_start(&parameters);
        let quad = Quadrotor::new(parameters, start, scene.world.start_heading_rad());
        let sensors = Sensors::default();
        let honest = !schedule.faults.iter().any(|fault| is_false(&fault.what));
        Ok(Self {
            schedule,
            ground,
            aboard: Aboard::new(vehicle, network, |controller| Bugged::new(controller, ground.bug))?,
            autopilot: Autopilot::new(NormalisedThrust(vehicle.airframe.hover_thrust)),
            operator: Operator::new(BEGIN),
            recorder: Recorder::new(ground.header.clone()),
            judge: Judge::new(vehicle.controller_config(), honest),
            acting: Acting::default(),
            wrong,
            wind: Wind::new(schedule.setting.wind_mps, mix(seed, 12)),
            wind_world: Vec3::zeros(),
            camera: Camera::new(&sensors, Mount::of(vehicle), seed),
            odometer: Odometer::new(vehicle.sensors.odometry, &sensors, seed, &quad),
            follower: Follower::default(),
            control_steps: (1.0 / (STEP_S * vehicle.realtime.controller_rate_hz)).round().max(1.0) as u64,
            quad,
            step: 0,
            paused_s: 0.0,
            calm_since: BEGIN,
            mode: Mode::Idle,
            flew: false,
            powered: false,
            contact: None,
            rested: None,
            modes: Vec::new(),
            steps: 0,
            digest: 0xcbf2_9ce4_8422_2325,
        })
    }

    fn now(&self) -> Time {
        Time(BEGIN.0 + self.step * 1_000_000)
    }

    fn t_s(&self) -> f64 {
        self.step as f64 * STEP_S
    }

    fn is_over(&self) -> bool {
        let rested = self.rested.is_some_and(|since| self.now().since(since) > AFTERWARDS_S);
        self.contact.is_some() || self.t_s() >= self.schedule.setting.length_s || (rested && self.nothing_follows())
    }

    /// No fault of the schedule is still to come.
    fn nothing_follows(&self) -> bool {
        self.schedule.faults.iter().all(|fault| fault.at_s < self.t_s())
    }

    /// A millisecond. What did not hold in it.
    fn tick(&mut self) -> Result<Option<Violation>, TrialError> {
        let now = self.now();
        self.acting.advance(self.t_s(), &self.schedule.faults);
        if !(self.acting.now().is_empty() && self.acting.begun().is_empty()) {
            self.calm_since = now;
        }
        *self.wrong.borrow_mut() = wrong_network(&self.acting);
        self.operator.step(now, &self.acting, self.ground.vehicle);
        let demand = self.autopilot.step(now, &self.odometer.believed, &self.acting);
        self.powered = demand.is_some();
        let Self { acting, quad, autopilot, aboard, .. } = self;
        self.odometer.step(now, self.step, acting, quad, autopilot, aboard);
        self.see(now)?;
        let judged = self.control(now);
        for record in self.operator.records.drain(..) {
            self.recorder.command(now, &record);
        }
        self.recorder.step(now, self.acting.any(&Kind::DiskFull), self.acting.any(&Kind::DiskSlow));
        self.move_on(demand.map(|demand| followed(FalseOdometry::followed(&self.acting), demand)));
        self.step += 1;
        Ok(judged)
    }

    fn see(&mut self, now: Time) -> Result<(), TrialError> {
        if self.powered {
            self.camera.step(now, self.step, self.ground.scene, self.quad.state(), &self.acting);
        }
        for payload in self.camera.arrived(now) {
            self.aboard.receive_frame(&payload, now);
        }
        if self.acting.any(&Kind::PlannerPaused) {
            return Ok(());
        }
        let late = self.acting.number(|kind| if let Kind::PlansLate(x) = kind { Some(*x) } else { None });
        if let Some(planned) = self.aboard.plan(now, late.unwrap_or(0.0))? {
            self.recorder.plan(now, self.aboard.flight(), &planned);
        }
        Ok(())
    }

    fn control(&mut self, now: Time) -> Option<Violation> {
        if !self.step.is_multiple_of(self.control_steps) {
            return None;
        }
        if self.acting.any(&Kind::ControllerPaused) {
            self.paused_s += self.control_steps as f64 * STEP_S;
            return None;
        }
        let waiting_stop = self.operator.waiting_stop();
        let delivered = self.operator.take();
        let (status, _) = self.autopilot.glance(now);
        let ready = !self.acting.any(&Kind::NotReady);
        let command = delivered.as_ref().map(|delivered| delivered.command);
        let stepped = self.aboard.control(now, &status, command, ready);
        let output = &stepped.output;
        if let Some(reply) = output.reply {
            self.operator.settle(now, Some(reply), &self.acting);
        }
        let unlogged = self.ground.bug == Some(Bug::UnloggedStep) && stepped.seq % UNLOGGED == UNLOGGED - 1;
        if !unlogged {
            self.recorder.control(now, &stepped);
        }
        if let Some(setpoint) = &output.setpoint {
            self.autopilot.send(now, setpoint);
        }
        if let Some(request) = output.request {
            self.autopilot.request(request);
        }
        if let Some(t) = output.transition {
            self.modes.push((self.t_s(), t.to, t.cause));
        }
        self.note(now, &stepped.output);
        let facts = Facts {
            now,
            stepped: &stepped,
            delivered: delivered.as_ref(),
            truth: self.quad.state(),
            paused_s: self.paused_s,
            waiting_stop: waiting_stop.filter(|_| self.operator.waiting_stop().is_some()),
            calm_since: self.calm_since,
        };
        self.judge.step(&facts).err()
    }

    fn note(&mut self, now: Time, output: &goshawk_core::ControllerOutput) {
        self.mode = output.mode;
        self.steps += 1;
        self.flew |= output.mode.has_authority();
        let rests = self.flew && !output.mode.has_authority() && self.quad.state().on_ground;
        self.rested = self.rested.or(Some(now)).filter(|_| rests);
        let setpoint = output.setpoint.map_or([0.0; 5], |s| {
            let q = s.world_from_body.coords;
            [q.x, q.y, q.z, q.w, s.thrust.0]
        });
        for bits in setpoint.map(f64::to_bits).into_iter().chain([output.mode as u64, output.yaw_des.to_bits()]) {
            self.digest = (self.digest ^ bits).wrapping_mul(0x0100_0000_01b3).rotate_left(17);
        }
    }

    fn move_on(&mut self, demand: Option<goshawk_core::AttitudeThrust>) {
        let world = &self.ground.scene.world;
        if self.step.is_multiple_of(WIND_STEPS) {
            self.wind_world = self.wind.step(WIND_STEPS as f64 * STEP_S, &self.quad.state().vel_world);
        }
        self.quad.step(STEP_S, demand.as_ref(), self.wind_world, |x, y| world.ground_height(x, y));
        if self.flew && self.step.is_multiple_of(CONTACT_STEPS) {
            let at = self.quad.state().pos_world;
            let clearance_m = self.follower.clearance(world, &[], &at, 0.0);
            self.contact = contact(world, &[], &at, clearance_m, None, false);
        }
    }

    fn end(self) -> (Flown, Vec<Written>) {
        let on_ground = self.quad.state().on_ground;
        let ended = match (self.contact, self.mode) {
            (Some(_), _) => "touched something",
            _ if !self.flew => "never began",
            (None, Mode::Fault) => "in the autopilot's hands",
            (None, mode) if mode.has_authority() => "under way",
            _ if on_ground => "on the ground",
            _ => "out of authority in the air",
        };
        let flown_s = self.t_s();
        let Self { recorder, modes, steps, digest, .. } = self;
        let flown = Flown { ended, violation: None, flown_s, modes, steps, logs: 0, digest };
        (flown, recorder.cut())
    }
}
