//! What must hold at every step of every flight, whatever goes wrong. The judge sees what the controller is given and
//! what it answers, and the truth; of the controller's insides it knows nothing.

use std::fmt;

use goshawk_core::mission::transitions::{Situation, next};
use goshawk_core::{
    AttitudeThrust, Cause, Command, ControllerConfig, ControllerOutput, Mode, Request, StopAction, Task, Time,
    Transition, Vec3,
};
use serde::Serialize;

use crate::commands::chaos::aboard::Stepped;
use crate::commands::chaos::acting::operator::Delivered;
use crate::vehicle::quadrotor::QuadrotorState;

/// The clock begins here, so that nothing lies before its zero.
pub(crate) const BEGIN: Time = Time(1_000_000_000);

/// What must hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Property {
    /// In authority, each step has a setpoint.
    NeverSilent,
    /// Once authority has ended, none has.
    NothingAfterAuthority,
    /// Tilt, thrust, numbers, speed, fence and ceiling.
    LimitsKept,
    /// A Stop ends what is flown, in time and for good.
    StopObeyed,
    /// Only the table's transitions, each for its reason.
    TransitionsOfTheTable,
    /// A start that was refused is not carried out.
    RefusedIsRefused,
    /// What was on the disk can be read.
    LogReadable,
    /// A replay answers as the flight did.
    ReplayExact,
}

impl Property {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::NeverSilent,
        Self::NothingAfterAuthority,
        Self::LimitsKept,
        Self::StopObeyed,
        Self::TransitionsOfTheTable,
        Self::RefusedIsRefused,
        Self::LogReadable,
        Self::ReplayExact,
    ];

    /// Its name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NeverSilent => "never-silent",
            Self::NothingAfterAuthority => "nothing-after-authority",
            Self::LimitsKept => "limits-kept",
            Self::StopObeyed => "stop-obeyed",
            Self::TransitionsOfTheTable => "transitions-of-the-table",
            Self::RefusedIsRefused => "refused-is-refused",
            Self::LogReadable => "log-readable",
            Self::ReplayExact => "replay-exact",
        }
    }
}

/// What does not hold, and when.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Violation {
    /// Which property.
    pub property: Property,
    /// Since the beginning, s.
    pub at_s: f64,
    /// What happened.
    pub text: String,
}

impl Violation {
    pub(crate) fn new(property: Property, at: Time, text: String) -> Self {
        Self { property, at_s: at.since(BEGIN), text }
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at {:.3} s: {}", self.property.name(), self.at_s, self.text)
    }
}

/// A Stop reaches the controller within this, s, while that steps.
const STOP_WITHIN_S: f64 = 0.1;
/// After a Stop, with nothing wrong for so long, s, the vehicle is slower than this, m/s.
const BRAKED: (f64, f64) = (3.0, 1.5);
/// Beyond the speed limit by this share and so much more, m/s: gusts, and the way to the limit.
const SPEED_MARGIN: (f64, f64) = (1.3, 1.0);
/// What an odometry's noise and drift may hide of a fence, m.
const FENCE_MARGIN_M: f64 = 0.5;
/// And what the braking before a fence may overshoot, m.
const OVERSHOT_M: f64 = 1.5;
/// Rounding.
const TINY: f64 = 1e-6;

const UNDER_WAY: [Mode; 5] = [Mode::Takeoff, Mode::Track, Mode::Navigate, Mode::Search, Mode::Hold];

/// What a step is judged by.
pub(crate) struct Facts<'a> {
    pub(crate) now: Time,
    pub(crate) stepped: &'a Stepped,
    pub(crate) delivered: Option<&'a Delivered>,
    pub(crate) truth: &'a QuadrotorState,
    /// How long the controller's thread stood still, in all, s.
    pub(crate) paused_s: f64,
    /// When a Stop arrived that has not been taken yet.
    pub(crate) waiting_stop: Option<Time>,
    /// Since when nothing has been wrong.
    pub(crate) calm_since: Time,
}

/// Watches a flight.
pub(crate) struct Judge {
    config: ControllerConfig,
    /// The odometry is true throughout the flight.
    honest: bool,
    mode: Mode,
    /// Believed, and true.
    start_world: Option<(Vec3, Vec3)>,
    /// In this flight the autopilot was asked to follow us, followed us, and ran its motors.
    asked: bool,
    followed: bool,
    armed: bool,
    stopped: Option<Time>,
    low_since: Option<Time>,
    paused_before_s: f64,
}

impl Judge {
    pub(crate) fn new(config: ControllerConfig, honest: bool) -> Self {
        Self {
            config,
            honest,
            mode: Mode::Idle,
            start_world: None,
            asked: false,
            followed: false,
            armed: false,
            stopped: None,
            low_since: None,
            paused_before_s: 0.0,
        }
    }

    /// Judges a step.
    pub(crate) fn step(&mut self, facts: &Facts<'_>) -> Result<(), Violation> {
        let output = &facts.stepped.output;
        self.observe(facts);
        let judged = self
            .authority(facts)
            .and_then(|()| self.setpoint(output))
            .and_then(|()| self.place(facts))
            .and_then(|()| self.transition(facts))
            .and_then(|()| self.commands(facts));
        self.mode = output.mode;
        self.asked |= output.request == Some(Request::Offboard);
        judged.map_err(|(property, text)| Violation::new(property, facts.now, text))
    }

    fn observe(&mut self, facts: &Facts<'_>) {
        let (stepped, autopilot) = (facts.stepped, &facts.stepped.input.autopilot);
        if stepped.started {
            (self.asked, self.followed, self.armed, self.stopped) = (false, false, false, None);
            self.start_world = stepped.input.odometry.map(|o| (o.pos_world, facts.truth.pos_world));
        }
        self.followed |= self.asked && autopilot.offboard;
        self.armed |= self.asked && autopilot.armed;
        let low = autopilot.battery.is_some_and(|charge| charge < self.config.limits.battery_land);
        self.low_since = self.low_since.or(Some(facts.now)).filter(|_| low);
    }

    fn authority(&self, facts: &Facts<'_>) -> Result<(), (Property, String)> {
        let (output, autopilot) = (&facts.stepped.output, &facts.stepped.input.autopilot);
        let (mode, sends) = (output.mode, output.setpoint.is_some());
        if mode.has_authority() && !sends {
            return Err((Property::NeverSilent, format!("no setpoint in {mode:?}")));
        }
        let taken = self.followed && !autopilot.offboard;
        let disarmed = self.armed && !autopilot.armed;
        let ended = [(taken, "the mode was taken away"), (disarmed, "the motors were stopped")];
        let ended = ended.into_iter().find(|(ended, _)| *ended && self.mode.has_authority()).map(|(_, why)| why);
        let why = ended.or((!mode.has_authority()).then_some("the vehicle flies no more"));
        match why.filter(|_| sends) {
            Some(why) => Err((Property::NothingAfterAuthority, format!("a setpoint in {mode:?} though {why}"))),
            None => Ok(()),
        }
    }

    fn setpoint(&self, output: &ControllerOutput) -> Result<(), (Property, String)> {
        let broken = |text: String| Err((Property::LimitsKept, text));
        let numbers = [output.flat.pos, output.flat.vel, output.flat.acc, output.acc_des_world, output.acc_att_world];
        if !numbers.iter().all(|v| v.iter().all(|x| x.is_finite())) {
            return broken(format!("{:?} flies by numbers that are none", output.mode));
        }
        let Some(AttitudeThrust { world_from_body, thrust }) = output.setpoint else { return Ok(()) };
        let vehicle = &self.config.airframe;
        let tilt = (world_from_body * Vec3::z()).z.clamp(-1.0, 1.0).acos();
        let on_ground = tilt < 1e-3;
        let least = if on_ground { 0.0 } else { vehicle.min_thrust };
        if !(world_from_body.coords.iter().all(|x| x.is_finite()) && (world_from_body.norm() - 1.0).abs() < TINY) {
            broken("an attitude that is none".to_owned())
        } else if tilt > vehicle.max_tilt_deg.to_radians() + TINY {
            broken(format!("a tilt of {:.1} degrees", tilt.to_degrees()))
        } else if !(least - TINY..=vehicle.max_thrust + TINY).contains(&thrust.0) {
            broken(format!("a thrust of {}", thrust.0))
        } else {
            Ok(())
        }
    }

    /// Fence, ceiling and speed, where the odometry is true.
    fn place(&self, facts: &Facts<'_>) -> Result<(), (Property, String)> {
        let (output, limits) = (&facts.stepped.output, &self.config.limits);
        let (Some((start, true_start)), Some(odometry), true) =
            (self.start_world, facts.stepped.input.odometry, self.honest)
        else {
            return Ok(());
        };
        let believed = facts.now.since(odometry.stamp) < self.config.ladder.odometry_stale_s;
        if believed && UNDER_WAY.contains(&output.mode) {
            let from_start = odometry.pos_world - start;
            if from_start.xy().norm() > limits.fence_radius_m + FENCE_MARGIN_M {
                let text = format!("{:?} {:.1} m from the start", output.mode, from_start.xy().norm());
                return Err((Property::LimitsKept, text));
            }
            if from_start.z > limits.ceiling_m + FENCE_MARGIN_M {
                return Err((Property::LimitsKept, format!("{:?} {:.1} m above the start", output.mode, from_start.z)));
            }
        }
        let speed = facts.truth.vel_world.norm();
        let calm = facts.now.since(facts.calm_since) > BRAKED.0;
        let way = facts.truth.pos_world - true_start;
        let beyond = way.xy().norm() > limits.fence_radius_m + OVERSHOT_M || way.z > limits.ceiling_m + OVERSHOT_M;
        if calm && output.mode.has_authority() && beyond {
            return Err((Property::LimitsKept, format!("truly {:.1} m away, {:.1} m high", way.xy().norm(), way.z)));
        }
        if calm && output.mode.has_authority() && speed > limits.max_speed_mps * SPEED_MARGIN.0 + SPEED_MARGIN.1 {
            return Err((Property::LimitsKept, format!("{speed:.1} m/s in {:?}", output.mode)));
        }
        Ok(())
    }

    fn transition(&self, facts: &Facts<'_>) -> Result<(), (Property, String)> {
        let output = &facts.stepped.output;
        let wrong = |text: String| Err((Property::TransitionsOfTheTable, text));
        let Some(t) = output.transition else {
            // The start's own step passes through Ready with a controller that is new.
            let same = output.mode == self.mode || facts.stepped.started;
            return if same { Ok(()) } else { wrong(format!("from {:?} to {:?} untold", self.mode, output.mode)) };
        };
        let restarted = matches!(facts.stepped.input.command, Some(Command::Start(_))) && self.mode == Mode::Ready;
        if (t.from != self.mode && !restarted) || t.to != output.mode {
            return wrong(format!(
                "told as {:?} to {:?}, made from {:?} to {:?}",
                t.from, t.to, self.mode, output.mode
            ));
        }
        if !self.is_in_table(&t) {
            return wrong(format!("{:?} to {:?} because {}", t.from, t.to, t.cause));
        }
        if !self.has_reason(facts, t.cause) {
            return wrong(format!("{:?} to {:?} because {}, which is not so", t.from, t.to, t.cause));
        }
        Ok(())
    }

    fn is_in_table(&self, t: &Transition) -> bool {
        let yes_or_no = [false, true];
        [Task::Track, Task::Navigate].into_iter().any(|task| {
            yes_or_no.into_iter().any(|was_armed| {
                yes_or_no.into_iter().any(|held| {
                    let situation = Situation { task, was_armed, held, on_stop: self.config.mission.on_stop };
                    next(t.from, t.cause, &situation) == Some(t.to)
                })
            })
        })
    }

    /// What the controller was given bears the cause out, as far as that can be told from outside.
    fn has_reason(&self, facts: &Facts<'_>, cause: Cause) -> bool {
        let (input, autopilot) = (&facts.stepped.input, &facts.stepped.input.autopilot);
        match cause {
            Cause::StopCommand => input.command == Some(Command::Stop),
            Cause::HoldCommand => input.command == Some(Command::Hold),
            Cause::ResumeCommand => input.command == Some(Command::Resume),
            Cause::StartCommand => matches!(input.command, Some(Command::Start(_))) && input.ready,
            Cause::TouchedDown | Cause::Disarmed | Cause::FaultOver => !autopilot.armed,
            Cause::ModeTakenAway => !autopilot.offboard,
            Cause::AutopilotLost => !autopilot.connected,
            Cause::PositionLost => autopilot.position == Some(false),
            Cause::BatteryLow => self.low_since.is_some(),
            _ => true,
        }
    }

    fn commands(&mut self, facts: &Facts<'_>) -> Result<(), (Property, String)> {
        let output = &facts.stepped.output;
        let disobeyed = |text: String| Err((Property::StopObeyed, text));
        if let Some(delivered) = facts.delivered {
            if delivered.given_up && facts.stepped.started {
                return Err((Property::RefusedIsRefused, format!("{} was refused, and takes off", delivered.id)));
            }
            let refused = matches!(delivered.command, Command::Start(_)) && matches!(output.reply, Some(Err(_)));
            if refused && output.mode.has_authority() && !self.mode.has_authority() {
                return Err((Property::RefusedIsRefused, format!("{} is refused, and takes off", delivered.id)));
            }
            if delivered.command == Command::Stop {
                let was_flying = UNDER_WAY.contains(&self.mode);
                self.stopped = self.stopped.or(Some(facts.now).filter(|_| was_flying));
                let hovers = self.config.mission.on_stop == StopAction::Hover && self.mode != Mode::Takeoff;
                let flies_on = UNDER_WAY.contains(&output.mode) && !(hovers && output.mode == Mode::Hold);
                if flies_on || output.reply != Some(Ok(())) {
                    return disobeyed(format!("{:?} after a Stop in {:?}", output.mode, self.mode));
                }
            }
        }
        let paused_s = facts.paused_s - self.paused_before_s;
        let waited_s = facts.waiting_stop.map_or(0.0, |since| facts.now.since(since)) - paused_s;
        if facts.waiting_stop.is_none() {
            self.paused_before_s = facts.paused_s;
        } else if waited_s > STOP_WITHIN_S {
            return disobeyed(format!("a Stop has waited for {waited_s:.2} s"));
        }
        let Some(stopped) = self.stopped else { return Ok(()) };
        if UNDER_WAY.contains(&output.mode) && output.mode != Mode::Hold {
            return disobeyed(format!("{:?} again after a Stop", output.mode));
        }
        let calm_s = facts.now.since(stopped.max(facts.calm_since));
        let speed = facts.truth.vel_world.norm();
        if output.mode.has_authority() && self.honest && calm_s > BRAKED.0 && speed > BRAKED.1 {
            return disobeyed(format!("{speed:.1} m/s, {calm_s:.1} s after a Stop"));
        }
        Ok(())
    }
}
