//! The odometry of a chaos flight: an estimator's errors, the autopilot's belief, and the samples on their way to the
//! vehicle, false, late, swapped or lost.

use goshawk_core::{Odometry, Time};
use goshawk_vehicle::config::OdometrySource;

use super::Acting;
use super::autopilot::Autopilot;
use super::senses::{FalseOdometry, Line, odometry_message};
use crate::commands::chaos::aboard::Aboard;
use crate::commands::chaos::schedule::Kind;
use crate::sense::file::Sensors;
use crate::sense::odometry::Estimator;
use crate::sense::rgbd::mix;
use crate::vehicle::imu::ImuSample;
use crate::vehicle::px4::VehicleState;
use crate::vehicle::quadrotor::Quadrotor;

const STEPS: u64 = 10;
/// An estimate's way to the vehicle where it does not come by the autopilot, s.
const DELAY_S: f64 = 0.010;

/// Estimator, errors and line.
pub(crate) struct Odometer {
    source: OdometrySource,
    estimator: Estimator,
    /// What the autopilot believes of its motion.
    pub(crate) believed: VehicleState,
    errors: FalseOdometry,
    line: Line<Odometry>,
    /// Stamp of the autopilot's last that was heard.
    last: Option<Time>,
}

impl Odometer {
    pub(crate) fn new(source: OdometrySource, sensors: &Sensors, seed: u64, quad: &Quadrotor) -> Self {
        Self {
            source,
            estimator: Estimator::new(sensors.odometry, mix(seed, 11)),
            believed: sensed(quad, None),
            errors: FalseOdometry::new(seed),
            line: Line::default(),
            last: None,
        }
    }

    /// A millisecond: estimates, and hands over what arrives.
    pub(crate) fn step(
        &mut self,
        now: Time,
        step: u64,
        acting: &Acting,
        quad: &Quadrotor,
        autopilot: &Autopilot,
        aboard: &mut Aboard<'_>,
    ) {
        if step.is_multiple_of(STEPS) {
            let estimate = self.estimator.estimate(now, quad.state());
            self.believed = sensed(quad, Some(&estimate));
            if self.source == OdometrySource::Zenoh {
                self.send(now, now.plus(DELAY_S), &estimate, acting);
            }
        } else {
            self.believed = VehicleState { imu: ImuSample::ideal(quad.state()), ..self.believed };
        }
        let heard = match self.source {
            OdometrySource::Autopilot => autopilot.glance(now).1,
            OdometrySource::Zenoh => None,
        };
        if let Some(heard) = heard.filter(|o| self.last != Some(o.stamp)) {
            self.last = Some(heard.stamp);
            self.send(now, now, &heard, acting);
        }
        for odometry in self.line.arrived(now) {
            self.deliver(now, step, &odometry, acting, aboard);
        }
    }

    fn send(&mut self, now: Time, arrives: Time, estimate: &Odometry, acting: &Acting) {
        let false_one = self.errors.apply(now, acting, estimate);
        if acting.any(&Kind::OdometryLost) {
            return;
        }
        let late = acting.number(|kind| if let Kind::OdometryLate(x) = kind { Some(*x) } else { None });
        self.line.send(arrives.plus(late.unwrap_or(0.0)), false_one, acting.any(&Kind::OdometrySwapped));
    }

    fn deliver(&self, now: Time, step: u64, odometry: &Odometry, acting: &Acting, aboard: &mut Aboard<'_>) {
        if self.source == OdometrySource::Autopilot {
            aboard.hear_odometry(*odometry);
            return;
        }
        let off = acting.number(|kind| if let Kind::OdometryStamped(x) = kind { Some(*x) } else { None });
        let nan = acting.any(&Kind::OdometryNan) && !(step / STEPS).is_multiple_of(3);
        aboard.receive_odometry(&odometry_message(odometry, off.unwrap_or(0.0), nan), now);
    }
}

/// What the autopilot senses: the truth, but for the motion by the `estimate`.
fn sensed(quad: &Quadrotor, estimate: Option<&Odometry>) -> VehicleState {
    let truth = quad.state();
    let (pos_world, vel_world, world_from_body) = match estimate {
        Some(o) => (o.pos_world, o.vel_world, o.world_from_body),
        None => (truth.pos_world, truth.vel_world, truth.world_from_body),
    };
    VehicleState {
        pos_world,
        vel_world,
        world_from_body,
        ang_vel_body: truth.ang_vel_body,
        imu: ImuSample::ideal(truth),
        on_ground: truth.on_ground,
        battery_fraction: quad.battery_fraction(),
        reset_counter: 0,
    }
}
