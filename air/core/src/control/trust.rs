//! Whether the odometry may be believed: it is checked against itself and against what thrust and tilt must do. Beyond
//! the paper.
//!
//! Five checks, each an innovation that is summed with forgetting and held against a gate far beyond what sensors, wind
//! and a wrong vehicle file make of it:
//!
//! ```text
//! position   e' = -e/τ + (ṗ - v)            |e| of a position that does not move as the velocity says, if it is more
//!                                           than |e| was of late
//! velocity   e' = -e/τ + (v̇ - u - d̂)        |e| of a velocity that changes as no thrust and no wind change it
//! attitude   one sample's turn less the one that the rates say
//! heading    the angle by which u must be turned to become v̇, once both vary enough
//! repetition a position or a velocity that is the same number again and again, where it should not be
//! ```
//!
//! u is the acceleration that thrust and the measured attitude give, d̂ the disturbance. A position that jumps once by
//! itself moves the frame and no more: velocity and attitude are good, and nothing that is flown needs the place itself.
//! All else is distrust: from the sample on in which a check fails, until all of them have held for [`AGAIN`].
//!
//! `goshawk-sim faults` counts what the checks miss, and their false alarms.

mod distrust;
mod heading;

use crate::values::types::{Odometry, Rot, Vec3};
pub use distrust::Distrust;
use heading::Heading;

/// What is false about the odometry; displays as a sentence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OdometryFault {
    /// Once, without a change of the reset counter.
    PositionJumped,
    /// It drifts, or the velocity has an offset, or it jumps again and again.
    PositionDisagrees,
    /// It made a step that neither thrust nor wind can make.
    VelocityStepped,
    /// In one sample, without a change of the reset counter.
    AttitudeTurned,
    /// Whoever tilts to one side accelerates to another.
    HeadingDisagrees,
    /// Live stamps on old numbers.
    Frozen,
}

impl OdometryFault {
    /// All of them.
    pub const ALL: [OdometryFault; 6] = [
        OdometryFault::PositionJumped,
        OdometryFault::PositionDisagrees,
        OdometryFault::VelocityStepped,
        OdometryFault::AttitudeTurned,
        OdometryFault::HeadingDisagrees,
        OdometryFault::Frozen,
    ];

    /// In one or two words, for tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            OdometryFault::PositionJumped => "position-jumped",
            OdometryFault::PositionDisagrees => "position-disagrees",
            OdometryFault::VelocityStepped => "velocity-stepped",
            OdometryFault::AttitudeTurned => "attitude-turned",
            OdometryFault::HeadingDisagrees => "heading-disagrees",
            OdometryFault::Frozen => "odometry-frozen",
        }
    }

    /// It is over as soon as it has shown: the flight goes on in a frame that has moved.
    #[must_use]
    pub fn is_passing(self) -> bool {
        self == OdometryFault::PositionJumped
    }
}

impl std::fmt::Display for OdometryFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            OdometryFault::PositionJumped => "the position jumped and the estimator did not say so",
            OdometryFault::PositionDisagrees => "the position does not move as the velocity says",
            OdometryFault::VelocityStepped => "the velocity changed as neither thrust nor wind can change it",
            OdometryFault::AttitudeTurned => "the attitude turned and the rates did not",
            OdometryFault::HeadingDisagrees => "the vehicle does not accelerate to where its heading and tilt say",
            OdometryFault::Frozen => "the estimate repeats itself under new stamps",
        })
    }
}

/// The same numbers in position, velocity and attitude for so long: nothing of it is alive, s. Chosen by eye.
const COPIED: f64 = 0.1;
/// Time constant of the position's check, s. Chosen by eye.
const POSITION_TIME: f64 = 1.0;
/// Its gate, m, of an estimate without noise: half a metre a second for long, 3 m/s for 0.2 s. Chosen by eye.
const POSITION_GATE: f64 = 0.45;
/// It is wider by so many times what the sum was of late, root mean square, and at most so wide, m: a PX4 that hovers by
/// GPS alone tells a velocity that is up to 0.8 m/s off for a second, again and again. Chosen by eye.
const POSITION_NOISE: (f64, f64) = (2.0, 1.0);
/// Of late, s. Chosen by eye: a drift is found before it counts as noise.
const POSITION_NOISE_TIME: f64 = 40.0;
/// Time constant of the velocity's check, s. Chosen by eye: longer than the rotors' lag, shorter than a gust.
const VELOCITY_TIME: f64 = 0.2;
/// Its gate, m/s. Chosen by eye.
const VELOCITY_GATE: f64 = 1.5;
/// One sample's turn that the rates do not explain, rad, and so much more for each second between samples. By eye.
const TURN_GATE: (f64, f64) = (0.35, 2.0);
/// A vehicle turns no faster, rad/s. Chosen by eye.
const FASTEST_TURN: f64 = 6.0;
/// Equal numbers in position or velocity for so long are no estimate, s. Chosen by eye.
const FROZEN: f64 = 0.3;
/// An estimate that never changes by less than this is told in steps, m and m/s: PX4's is told in far finer ones.
const STEPS: f64 = 1e-3;
/// Its numbers are equal as long as it moves by less than a step; they should have changed once they are behind by so
/// many steps, and the model's errors are less. Chosen by eye.
const BEHIND: f64 = 10.0;
/// Jumps of the position: each counts one, which fades with this time constant, s; more than this is no single jump.
/// Chosen by eye: three within a few seconds.
const JUMPS: (f64, f64) = (3.0, 2.5);
/// A check holds again below this share of its gate. Chosen by eye.
const HYSTERESIS: f64 = 0.6;
/// How long all checks must hold before the odometry is believed again, s. Chosen by eye.
pub const AGAIN: f64 = 0.5;

/// One step of the odometry with what should have happened in it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step<'a> {
    pub(crate) last: &'a Odometry,
    pub(crate) new: &'a Odometry,
    /// Between them, s; above 0.
    pub(crate) dt: f64,
    /// What the measured attitude and the thrust give, m/s².
    pub(crate) acc_model: Vec3,
    /// What the attitude that was commanded, come to with the loop's lag, and the thrust give, m/s².
    pub(crate) acc_followed: Vec3,
    /// Disturbance before this step, m/s².
    pub(crate) disturbance: Vec3,
    /// The vehicle flies freely and follows what is sent.
    pub(crate) free: bool,
    /// The frame jumped without a word.
    pub(crate) jumped: bool,
}

/// The checks' state.
#[derive(Clone, Copy, Debug, Default)]
pub struct Trust {
    position: Vec3,
    /// Mean of its square, m².
    position_noise: f64,
    velocity: Vec3,
    heading: Heading,
    /// How long the position or the velocity has repeated itself though it should not, and how long all of the estimate,
    /// s.
    repeated: f64,
    copied: f64,
    /// What the position and the velocity have changed while they repeated themselves, m and m/s, and the disturbance of
    /// before, m/s².
    moved: Vec3,
    unseen: Vec3,
    disturbance: Vec3,
    /// The smallest changes of position and velocity, m and m/s; 0: none was seen.
    finest: [f64; 2],
    jumps: f64,
    /// By how much the attitude turned without its rates, all in all.
    turned: Rot,
    distrust: Option<Distrust>,
}

impl Trust {
    /// Why the odometry is not believed; none: it is.
    #[must_use]
    pub fn distrust(&self) -> Option<&Distrust> {
        self.distrust.as_ref()
    }

    /// On the ground, where estimates may settle as they like: all is forgotten.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// What came before does not belong to what comes: an announced jump, or samples that are missing. Distrust stays.
    pub fn skip(&mut self) {
        let Self { position_noise, disturbance, finest, jumps, turned, distrust, .. } = *self;
        *self = Self { position_noise, disturbance, finest, jumps, turned, distrust, ..Self::default() };
        if let Some(distrust) = &mut self.distrust {
            distrust.lose();
        }
    }

    /// The largest check over its gate; from 1 on it fails.
    #[must_use]
    pub fn doubt(&self) -> f64 {
        let position = self.position.norm() / self.position_gate();
        let sums = position.max(self.velocity.norm() / VELOCITY_GATE).max(self.jumps / JUMPS.1);
        sums.max(self.repeated / FROZEN).max(self.copied / COPIED)
    }

    fn position_gate(&self) -> f64 {
        (POSITION_GATE + POSITION_NOISE.0 * self.position_noise.sqrt()).min(POSITION_NOISE.1)
    }

    /// Takes a step in flight. Returns a fault that was not known before it.
    pub(crate) fn step(&mut self, step: &Step) -> Option<OdometryFault> {
        let upright = self.distrust.as_ref().map_or(*step, |distrust| distrust.corrected(step));
        let before = self.velocity_before(&upright);
        let failed = self.check(&upright);
        let holds = failed.is_none() && self.turned.angle() < TURN_GATE.0 && self.doubt() < HYSTERESIS;
        let turn = self.heading.turn();
        let Some(distrust) = &mut self.distrust else {
            self.distrust = failed.filter(|fault| !fault.is_passing()).map(|fault| {
                let stepped = fault == OdometryFault::VelocityStepped;
                // A velocity that stepped is not believed from its step on; one that only the position contradicts
                // changed as thrust and tilt say.
                let vel_world = if stepped { before } else { step.new.vel_world + self.unseen };
                Distrust::new(fault, step.new.stamp, vel_world, self.disturbance, turn)
            });
            if let Some(distrust) = &mut self.distrust {
                distrust.attitude_stands = self.copied > 0.0;
                distrust.turn(&self.turned);
                self.heading = Heading::default();
            }
            return failed;
        };
        // The velocity that comes back steps too, and says nothing of the heading.
        self.heading = Heading::default();
        distrust.turn(&self.turned);
        distrust.go_on(step, failed, holds, self.copied > 0.0);
        if distrust.is_over(step.new.stamp) {
            self.distrust = None;
        }
        None
    }

    /// What the velocity must be after the step by what it was before, whatever the step says, m/s. Notes what it must
    /// have changed while it repeats itself.
    fn velocity_before(&mut self, step: &Step) -> Vec3 {
        let Step { last, new, dt, .. } = *step;
        let same = step.free && new.vel_world == last.vel_world;
        if !same && self.unseen == Vec3::zeros() {
            self.disturbance = step.disturbance;
        }
        let acc_world = if is_copy(last, new) { step.acc_followed } else { step.acc_model };
        let unseen = self.unseen + (acc_world + self.disturbance) * dt;
        self.unseen = if same { unseen } else { Vec3::zeros() };
        last.vel_world + unseen
    }

    /// The most telling check that fails.
    fn check(&mut self, step: &Step) -> Option<OdometryFault> {
        // Before the step: a velocity that steps is no motion that the heading could explain.
        let (suspected, stood) = (self.heading.is_suspected(), self.copied);
        let away = self.sum(step);
        let Step { last, new, dt, .. } = *step;
        let rates = (last.ang_vel_body + new.ang_vel_body) * (0.5 * dt);
        let turned = (last.world_from_body * Rot::from_scaled_axis(rates)).rotation_to(&new.world_from_body);
        // An attitude that stood still has turned meanwhile, and its rates do not say how.
        if turned.angle() > TURN_GATE.0 + TURN_GATE.1 * dt + FASTEST_TURN * stood {
            self.turned = turned * self.turned;
            Some(OdometryFault::AttitudeTurned)
        } else if self.copied > COPIED {
            Some(OdometryFault::Frozen)
        } else if away || (suspected && self.velocity.norm() > VELOCITY_GATE) {
            Some(OdometryFault::HeadingDisagrees)
        } else if self.velocity.norm() > VELOCITY_GATE {
            Some(OdometryFault::VelocityStepped)
        } else if self.repeated > FROZEN {
            Some(OdometryFault::Frozen)
        } else if self.position.norm() > self.position_gate() || self.jumps > JUMPS.1 {
            Some(OdometryFault::PositionDisagrees)
        } else {
            step.jumped.then_some(OdometryFault::PositionJumped)
        }
    }

    /// Adds the step to the sums. Returns whether the motion is turned away from the model.
    fn sum(&mut self, step: &Step) -> bool {
        let Step { last, new, dt, .. } = *step;
        self.position *= (-dt / POSITION_TIME).exp();
        self.velocity *= (-dt / VELOCITY_TIME).exp();
        self.jumps = self.jumps * (-dt / JUMPS.0).exp() + f64::from(u8::from(step.jumped));
        if !step.jumped {
            self.position += new.pos_world - last.pos_world - (last.vel_world + new.vel_world) * (0.5 * dt);
        }
        if self.distrust.is_none() {
            let share = 1.0 - (-dt / POSITION_NOISE_TIME).exp();
            self.position_noise += (self.position.norm_squared() - self.position_noise) * share;
        }
        if !step.free {
            return false;
        }
        self.repeated = if self.repeats(step) { self.repeated + dt } else { 0.0 };
        self.copied = if is_copy(last, new) { self.copied + dt } else { 0.0 };
        let changed = new.vel_world - last.vel_world;
        self.velocity += changed - (step.acc_model + step.disturbance) * dt;
        self.heading.step(dt, step.acc_model, changed)
    }

    /// The position or the velocity is that of before, and should have changed by what it can tell.
    fn repeats(&mut self, step: &Step) -> bool {
        let Step { last, new, dt, .. } = *step;
        let changed = [new.pos_world - last.pos_world, new.vel_world - last.vel_world].map(|by| by.norm());
        for (finest, by) in self.finest.iter_mut().zip(changed) {
            if by > 0.0 && (*finest == 0.0 || by < *finest) {
                *finest = by;
            }
        }
        self.moved = if changed[0] > 0.0 { Vec3::zeros() } else { self.moved + new.vel_world * dt };
        let behind = [self.moved, self.unseen].map(|by| by.norm());
        (0..2).any(|k| changed[k] == 0.0 && (self.finest[k] < STEPS || behind[k] > BEHIND * self.finest[k]))
    }
}

/// Nothing is new but the stamp.
fn is_copy(last: &Odometry, new: &Odometry) -> bool {
    Odometry { stamp: new.stamp, ..*last } == *new
}

#[cfg(test)]
mod tests;
