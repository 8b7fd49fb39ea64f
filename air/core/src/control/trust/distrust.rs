//! What is flown on while the odometry is not believed: the velocity, reckoned from the last one that was believed, and
//! the frame that the attitude is told in.
//!
//! ```text
//! v' = R(turn)⁻¹ u + d̂        u of the measured attitude, or of the commanded one where that repeats itself too
//! σ' = 0.4 or 1 m/s²           the doubt of v; what is slower than its doubt is not braked any more
//! ```
//!
//! d̂ is of before the fault. The part of it that opposes the motion is taken for drag, and fades with the speed.

use super::{AGAIN, OdometryFault, Step};
use crate::values::geometry::yaw_of;
use crate::values::types::{Rot, Time, Vec3};

/// Doubt of a velocity that was believed until now, m/s. Chosen by eye.
const DOUBT: f64 = 0.3;
/// How it grows, m/s²: with the attitude measured, and with the attitude only commanded. Chosen by eye.
const DOUBT_GROWS: (f64, f64) = (0.4, 1.0);
/// An attitude that turned by a tilt of more than this, rad, is none to reckon with; a heading is. Chosen by eye.
const MOST_TILTED: f64 = 0.3;
/// The attitude loop may fly by another heading than the one that is told: it shows from so long on, s. Chosen by eye.
const LOOP_SHOWS_AFTER: f64 = 0.25;
/// It shows by so much, ∫ |Δu|² dt in m²/s³, and by this many times. Chosen by eye.
const LOOP_SHOWS: (f64, f64) = (0.5, 2.0);

/// What is flown on while the odometry is not believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distrust {
    /// The check that failed first.
    pub fault: OdometryFault,
    /// When.
    pub since: Time,
    /// Dead reckoning from the last velocity that was believed, m/s; none: the attitude cannot be believed either.
    pub vel_world: Option<Vec3>,
    /// Of it, m/s.
    pub doubt: f64,
    /// As it was before, less the drag that braking has taken away, m/s².
    pub disturbance: Vec3,
    /// The attitude that is told repeats itself, and says nothing of where the vehicle leans.
    pub attitude_stands: bool,
    /// The told headings less the true ones, rad: as the motion shows them, and as the rates do.
    shown: f64,
    turned: f64,
    /// ∫ |Δu|² dt between what was commanded and what is measured: as it is told, and turned back. m²/s³.
    unlike: [f64; 2],
    held_since: Option<Time>,
}

impl Distrust {
    /// `vel_world` and `disturbance` are the last ones to be believed; `turn`: by how much the motion is turned away from
    /// what heading and tilt say, rad.
    pub(super) fn new(fault: OdometryFault, since: Time, vel_world: Vec3, disturbance: Vec3, turn: f64) -> Self {
        let heading = fault == OdometryFault::HeadingDisagrees;
        Self {
            fault,
            since,
            vel_world: Some(vel_world),
            doubt: DOUBT,
            // What was learnt by a wrong heading is wrong but for its height.
            disturbance: if heading { Vec3::new(0.0, 0.0, disturbance.z) } else { disturbance },
            attitude_stands: false,
            shown: if heading { -turn } else { 0.0 },
            turned: 0.0,
            unlike: [0.0; 2],
            held_since: None,
        }
    }

    /// What to brake, m/s; none: there is nothing to brake by, or too little that is sure.
    #[must_use]
    pub fn moving(&self, stopped_speed: f64) -> Option<Vec3> {
        self.vel_world.filter(|vel| vel.xy().norm() > stopped_speed.max(self.doubt))
    }

    /// The frame that the attitude loop flies in, seen from the world: commanded vectors are to be turned by it.
    #[must_use]
    pub fn loop_from_world(&self) -> Rot {
        let [told, back] = self.unlike;
        let own = told > LOOP_SHOWS.0 + LOOP_SHOWS.1 * back;
        if own { Rot::identity() } else { self.told_from_world() }
    }

    /// A told attitude, in the frame that the attitude loop flies in.
    #[must_use]
    pub fn loop_from_body(&self, told_from_body: &Rot) -> Rot {
        self.loop_from_world() * self.told_from_world().inverse() * told_from_body
    }

    fn told_from_world(&self) -> Rot {
        Rot::from_axis_angle(&Vec3::z_axis(), self.shown + self.turned)
    }

    /// What comes before and after the attitude turned by `turned` without its rates.
    pub(super) fn turn(&mut self, turned: &Rot) {
        self.turned = yaw_of(turned);
        if (turned * Vec3::z()).z < MOST_TILTED.cos() {
            self.vel_world = None;
        }
    }

    /// Nothing to brake by any more.
    pub(super) fn lose(&mut self) {
        self.vel_world = None;
    }

    /// The step as the true heading has it.
    pub(super) fn corrected<'a>(&self, step: &Step<'a>) -> Step<'a> {
        let followed = self.loop_from_world().inverse() * step.acc_followed;
        let acc_model = self.told_from_world().inverse() * step.acc_model;
        Step { acc_model, acc_followed: followed, disturbance: self.disturbance, ..*step }
    }

    /// Reckons on.
    pub(super) fn go_on(&mut self, step: &Step, failed: Option<OdometryFault>, holds: bool, copied: bool) {
        self.attitude_stands = copied;
        self.compare(step);
        let true_step = self.corrected(step);
        let acc_world = if copied { true_step.acc_followed } else { true_step.acc_model };
        // A wrong heading leaves the velocity true, as long as nothing speaks against it.
        let measured = self.fault == OdometryFault::HeadingDisagrees && failed.is_none() && !copied;
        let dt = step.dt;
        self.doubt += dt * if copied { DOUBT_GROWS.1 } else { DOUBT_GROWS.0 };
        if measured {
            self.doubt = DOUBT;
        }
        if let Some(vel) = &mut self.vel_world {
            let before = *vel;
            *vel = if measured { step.new.vel_world } else { before + (acc_world + self.disturbance) * dt };
            self.disturbance = faded(self.disturbance, before, *vel);
        }
        // A heading that is wrong shows only while the vehicle tilts, which it does not any more.
        let may_hold = self.fault != OdometryFault::HeadingDisagrees && failed != Some(OdometryFault::HeadingDisagrees);
        self.held_since = self.held_since.or(Some(step.new.stamp)).filter(|_| holds && may_hold);
    }

    /// Whether the attitude follows what is commanded as it is told, or as it would be if the loop flew by the true one.
    fn compare(&mut self, step: &Step) {
        if self.attitude_stands || step.new.stamp.since(self.since) < LOOP_SHOWS_AFTER {
            return;
        }
        let back = self.told_from_world().inverse() * step.acc_model;
        for (sum, acc) in self.unlike.iter_mut().zip([step.acc_model, back]) {
            *sum += (acc - step.acc_followed).xy().norm_squared() * step.dt;
        }
    }

    pub(super) fn is_over(&self, now: Time) -> bool {
        self.held_since.is_some_and(|since| now.since(since) >= AGAIN)
    }
}

/// The disturbance after the velocity has become `now` from `before`: what opposed it has fallen with it.
fn faded(disturbance: Vec3, before: Vec3, now: Vec3) -> Vec3 {
    let Some(along) = before.xy().try_normalize(0.1) else { return disturbance };
    let drag = disturbance.xy().dot(&along).min(0.0);
    let left = (now.xy().dot(&along) / before.xy().norm()).clamp(0.0, 1.0);
    let gone = along * (drag * (1.0 - left));
    disturbance - Vec3::new(gone.x, gone.y, 0.0)
}
