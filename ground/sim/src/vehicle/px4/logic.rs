//! PX4's state machine at the MAVLink boundary: modes, arming, lost setpoints, landing. Pure; time is an argument.

use super::checks::{Px4Faults, Told};
use super::flight::{Aim, Flight, idle};
use super::landed::{Detected, LandedDetector};
use super::reports::Facts;
use super::streams::Streams;
use super::{LossAction, OdometryFault, Px4Config, Px4Output, VehicleState};
use goshawk_autopilot::frames::world_from_body;
use goshawk_autopilot::messages::{
    AttitudeTargetTypemask, EVENT_DATA, MavMessage, MavSeverity, MavType, SET_ATTITUDE_TARGET_DATA, STATUSTEXT_DATA,
    TIMESYNC_DATA,
};
use goshawk_autopilot::wire::packet::Packet;
use goshawk_autopilot::{AutopilotEvent, Px4Mode};
use goshawk_core::{AttitudeThrust, NormalisedThrust, Rot, Time, Vec3};
use nalgebra::Quaternion;

/// From the loss time running out to the failsafe, measured.
const FAILSAFE_DELAY_S: f64 = 0.05;
/// From the first setpoint again to OFFBOARD again: within 40 ms, measured.
const RESUME_DELAY_S: f64 = 0.02;
/// COM_DISARM_LAND.
const DISARM_AFTER_LANDING_S: f64 = 2.0;
/// COM_DISARM_PRFLT: armed but never taken off.
const DISARM_WITHOUT_FLIGHT_S: f64 = 10.0;
/// MPC_LAND_SPEED.
const LAND_SPEED_MPS: f64 = 0.7;
/// POSCTL without sticks sank at 0.6–1 m/s.
const BLIND_SINK_MPS: f64 = 0.8;

/// The stand-in's whole state.
#[derive(Clone, Debug)]
pub struct Px4Logic {
    pub(super) config: Px4Config,
    pub(super) now: Time,
    booted: Option<Time>,
    pub(super) streams: Streams,
    /// Messages that leave at their time.
    pub(super) outbox: Vec<(Time, MavMessage)>,
    pub(super) acks: usize,
    pub(super) mode: Px4Mode,
    /// What was asked for last; differs from `mode` in a failsafe.
    intended: Px4Mode,
    pub(super) armed: bool,
    armed_at: Time,
    flown: bool,
    landed_at: Time,
    pub(super) landed: LandedDetector,
    setpoint: Option<(Time, AttitudeThrust)>,
    /// First setpoint since the failsafe began.
    resumed_at: Option<Time>,
    flight: Flight,
    ground_station: bool,
    event_sequence: u16,
    odometry_fault: Option<OdometryFault>,
    /// What is wrong with it.
    pub faults: Px4Faults,
    pub(super) told: Told,
    /// It arms then: it was asked, and takes its time.
    pub(super) arms_at: Option<Time>,
    /// It has no power, or boots, until then.
    off_until: Option<Time>,
    /// Where it lost its position.
    held: Option<Vec3>,
}

impl Px4Logic {
    /// A vehicle on the ground, disarmed, in AUTO.LOITER. It boots at the first step.
    #[must_use]
    pub fn new(config: Px4Config) -> Self {
        Self {
            config,
            now: Time(0),
            booted: None,
            streams: Streams::new(Time(0)),
            outbox: Vec::new(),
            acks: 0,
            mode: Px4Mode::Hold,
            intended: Px4Mode::Hold,
            armed: false,
            armed_at: Time(0),
            flown: false,
            landed_at: Time(0),
            landed: LandedDetector::new(),
            setpoint: None,
            resumed_at: None,
            flight: Flight::default(),
            ground_station: false,
            event_sequence: 0,
            odometry_fault: None,
            faults: Px4Faults::default(),
            told: Told::default(),
            arms_at: None,
            off_until: None,
            held: None,
        }
    }

    /// It starts again, as after a brown-out: silent and without motors for `boot_s`, then as new. Its faults stay.
    pub fn restart(&mut self, boot_s: f64) {
        let off_until = Some(self.now.plus(boot_s));
        let (now, faults, odometry_fault) = (self.now, self.faults, self.odometry_fault);
        *self = Self { now, odometry_fault, faults, off_until, ..Self::new(self.config) };
    }

    /// It stops the motors, wherever it is: a kill switch, or a failsafe.
    pub fn stop_motors(&mut self) {
        self.set_disarmed();
    }

    /// The pilot moves the sticks at this speed, travels a second.
    pub fn move_sticks(&mut self, speed: f64) {
        if self.mode == Px4Mode::Offboard && self.config.sticks.takes_over(speed) {
            self.pilot_takes_over(Px4Mode::Position);
        }
    }

    /// The pilot takes the mode away with the sticks. Only [`AutopilotEvent`]s and the mode tell: no failsafe.
    pub fn pilot_takes_over(&mut self, mode: Px4Mode) {
        self.intend(mode);
    }

    /// Breaks, or with none mends, what it says of its motion.
    pub fn set_odometry_fault(&mut self, fault: Option<OdometryFault>) {
        self.odometry_fault = fault;
    }

    /// What it flies.
    #[must_use]
    pub fn mode(&self) -> Px4Mode {
        self.mode
    }

    /// What it believes about the ground.
    #[must_use]
    pub fn landed(&self) -> bool {
        self.landed.landed()
    }

    /// Advances to `now`, having received `packets`, with the vehicle in `vehicle`; appends what it sends to `sent`.
    /// Steps of a few ms keep its timings honest.
    pub fn step(
        &mut self,
        now: Time,
        packets: &[Packet],
        vehicle: &VehicleState,
        sent: &mut Vec<MavMessage>,
    ) -> Px4Output {
        let dt_s = now.since(self.now).clamp(0.0, 0.05);
        self.now = now;
        if self.off_until.is_some_and(|until| now < until) {
            return Px4Output { armed: false, mode: self.mode, demand: None };
        }
        if self.booted.is_none() {
            self.booted = Some(now);
            self.streams = Streams::new(now);
        }
        for packet in packets {
            self.receive(packet);
        }
        if self.arms_at.is_some_and(|at| now >= at) {
            self.arms_at = None;
            self.set_armed();
        }
        self.arbitrate();
        self.tell_changes();
        let demand = self.demand(vehicle, dt_s);
        self.watch_the_ground(vehicle, demand.map_or(0.0, |demand| demand.thrust.0));
        let demand = demand.filter(|_| self.armed);
        self.report(vehicle, demand, sent);
        Px4Output { armed: self.armed, mode: self.mode, demand }
    }

    fn boot_ns(&self) -> u64 {
        self.booted.map_or(0, |booted| self.now.0 - booted.0)
    }

    fn receive(&mut self, packet: &Packet) {
        match &packet.message {
            MavMessage::COMMAND_LONG(_) | MavMessage::PARAM_REQUEST_READ(_) if self.faults.deaf => {}
            MavMessage::COMMAND_LONG(command) => self.command(packet, command),
            MavMessage::SET_ATTITUDE_TARGET(target) => self.take_setpoint(target),
            MavMessage::PARAM_REQUEST_READ(asked) => self.tell_parameter(asked),
            MavMessage::HEARTBEAT(heartbeat) => self.ground_station |= heartbeat.mavtype == MavType::MAV_TYPE_GCS,
            MavMessage::TIMESYNC(sync) if sync.tc1 == 0 => {
                let answer = TIMESYNC_DATA {
                    tc1: self.boot_ns() as i64,
                    ts1: sync.ts1,
                    target_system: packet.header.system_id as u8,
                    target_component: packet.header.component_id,
                };
                self.outbox.push((self.now, MavMessage::TIMESYNC(answer)));
            }
            _ => {}
        }
    }

    /// Attitude and thrust, rates ignored; other masks and wrong addresses are passed over in silence.
    fn take_setpoint(&mut self, target: &SET_ATTITUDE_TARGET_DATA) {
        let attitude_and_thrust = AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
            | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
            | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE;
        let [w, x, y, z] = target.q.map(f64::from);
        let q = Quaternion::new(w, x, y, z);
        let usable = (q.norm() - 1.0).abs() < 0.01 && target.thrust.is_finite();
        if !self.addressed(target.target_system, target.target_component)
            || target.type_mask != attitude_and_thrust
            || !usable
        {
            return;
        }
        let thrust = NormalisedThrust(f64::from(target.thrust).clamp(0.0, 1.0));
        let setpoint = AttitudeThrust { world_from_body: world_from_body(&Rot::new_normalize(q)), thrust };
        self.setpoint = Some((self.now, setpoint));
        if self.mode != Px4Mode::Offboard {
            self.resumed_at.get_or_insert(self.now);
        }
    }

    fn stream_age(&self) -> Option<f64> {
        self.setpoint.map(|(stamp, _)| self.now.since(stamp))
    }

    /// Would it follow setpoints now?
    pub(super) fn stream_is_fresh(&self) -> bool {
        self.stream_age().is_some_and(|age| age < self.config.loss_s)
    }

    /// Someone asked for a mode and got it.
    pub(super) fn intend(&mut self, mode: Px4Mode) {
        self.intended = mode;
        self.enter(mode);
    }

    fn enter(&mut self, mode: Px4Mode) {
        if self.mode != mode {
            self.flight.reset();
        }
        self.mode = mode;
        self.resumed_at = None;
    }

    /// Lost and resumed setpoints.
    fn arbitrate(&mut self) {
        if self.intended != Px4Mode::Offboard {
            return;
        }
        if !self.armed {
            self.enter(Px4Mode::Offboard);
        } else if self.mode == Px4Mode::Offboard {
            let patience_s = self.config.loss_s + FAILSAFE_DELAY_S;
            if self.stream_age().is_none_or(|age| age > patience_s) {
                self.event(AutopilotEvent::NoOffboardSignal, &[]);
                // The mode left, and failsafe_action_t: fall back to POSCTL, hold, land.
                let [a, b, c, d] = Px4Mode::Offboard.custom_mode().to_le_bytes();
                let action = match self.config.loss_action {
                    LossAction::Position => 2,
                    LossAction::Hold => 5,
                    LossAction::Land => 7,
                };
                self.event(AutopilotEvent::FailsafeEntered, &[a, b, c, d, action]);
                self.text("Failsafe activated: offboard signal lost");
                self.enter(match self.config.loss_action {
                    LossAction::Position => Px4Mode::Position,
                    LossAction::Land => Px4Mode::Land,
                    LossAction::Hold => Px4Mode::Hold,
                });
            }
        } else if self.resumed_at.is_some_and(|resumed| self.now.since(resumed) >= RESUME_DELAY_S)
            && self.stream_is_fresh()
        {
            self.enter(Px4Mode::Offboard);
        }
    }

    fn demand(&mut self, vehicle: &VehicleState, dt_s: f64) -> Option<AttitudeThrust> {
        if !self.armed {
            return None;
        }
        let aim = match self.mode {
            Px4Mode::Offboard => return Some(self.setpoint.map_or_else(|| idle(vehicle), |(_, setpoint)| setpoint)),
            _ if self.landed() => return Some(idle(vehicle)),
            Px4Mode::Land => Aim::Land(LAND_SPEED_MPS),
            Px4Mode::Position if self.intended == Px4Mode::Offboard => Aim::SinkBlindly(BLIND_SINK_MPS),
            _ => Aim::Hold, // a pilot is taken to be one who hovers
        };
        Some(self.flight.step(aim, vehicle, self.config.hover_thrust, dt_s))
    }

    fn watch_the_ground(&mut self, vehicle: &VehicleState, thrust: f64) {
        if self.faults.numb && self.armed && !self.landed() {
            return;
        }
        match self.landed.step(self.now, thrust, vehicle) {
            Some(Detected::Takeoff) => {
                self.flown = true;
                self.event(AutopilotEvent::TakeoffDetected, &[]);
            }
            Some(Detected::Landing) => {
                self.landed_at = self.now;
                self.event(AutopilotEvent::LandingDetected, &[]);
            }
            None => {}
        }
        if self.armed && self.landed() {
            let (since, patience_s) = if self.flown {
                (self.landed_at, DISARM_AFTER_LANDING_S)
            } else {
                (self.armed_at, DISARM_WITHOUT_FLIGHT_S)
            };
            if self.now.since(since) >= patience_s {
                self.set_disarmed();
            }
        }
    }

    pub(super) fn set_armed(&mut self) {
        self.armed = true;
        self.armed_at = self.now;
        self.flown = false;
        self.flight.reset();
        self.event(AutopilotEvent::Armed, &[]);
    }

    pub(super) fn set_disarmed(&mut self) {
        if self.armed {
            self.armed = false;
            self.event(AutopilotEvent::Disarmed, &[]);
        }
    }

    fn event(&mut self, event: AutopilotEvent, arguments: &[u8]) {
        self.send_event(event.id(), 0x66, arguments);
    }

    pub(super) fn send_event(&mut self, id: u32, log_levels: u8, arguments: &[u8]) {
        let mut padded = [0; 40];
        padded[..arguments.len()].copy_from_slice(arguments);
        self.event_sequence = self.event_sequence.wrapping_add(1);
        let message = MavMessage::EVENT(EVENT_DATA {
            id,
            event_time_boot_ms: (self.boot_ns() / 1_000_000) as u32,
            sequence: self.event_sequence,
            log_levels,
            arguments: padded,
            ..EVENT_DATA::default()
        });
        self.outbox.push((self.now, message));
    }

    /// Only a ground station hears texts.
    pub(super) fn text(&mut self, text: &str) {
        if self.ground_station {
            let message = MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                severity: MavSeverity::MAV_SEVERITY_CRITICAL,
                text: text.into(),
                ..STATUSTEXT_DATA::default()
            });
            self.outbox.push((self.now, message));
        }
    }

    fn report(&mut self, vehicle: &VehicleState, demand: Option<AttitudeThrust>, sent: &mut Vec<MavMessage>) {
        let now = self.now;
        self.outbox.retain(|(due, message)| {
            let leaves = *due <= now;
            if leaves {
                sent.push(message.clone());
            }
            !leaves
        });
        self.held = self.held.or(Some(vehicle.pos_world)).filter(|_| self.faults.no_position);
        let told = self.held.map_or(*vehicle, |held| invented(vehicle, held));
        let facts = Facts {
            boot_ns: self.boot_ns(),
            vehicle: &told,
            mode: self.mode,
            intended: self.intended,
            armed: self.armed,
            landed: self.landed(),
            demand,
            fault: self.odometry_fault,
            no_position: self.faults.no_position,
            can_arm: self.armed || self.can_arm(),
        };
        self.streams.due(now, |id| sent.extend(facts.report(id)));
    }
}

/// What an estimator without a position makes of it: it stands still where it was, and still knows its height.
fn invented(vehicle: &VehicleState, held: Vec3) -> VehicleState {
    let (pos, vel) = (vehicle.pos_world, vehicle.vel_world);
    VehicleState { pos_world: Vec3::new(held.x, held.y, pos.z), vel_world: Vec3::new(0.0, 0.0, vel.z), ..*vehicle }
}
