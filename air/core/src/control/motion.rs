//! The vehicle's motion as the controller believes it: accepts odometry, notices jumps, and feeds what is learnt of it:
//! the disturbance, the hover thrust, the attitude loop's lag.

use crate::control::disturbance::Observer;
use crate::control::lag::AttitudeLag;
use crate::control::thrust::HoverThrust;
use crate::control::trust::{Distrust, OdometryFault, Step, Trust};
use crate::control::vehicle::Airframe;
use crate::values::jump::{Jump, jump, turned};
use crate::values::types::{GRAVITY, NormalisedThrust, Odometry, Rot, Time, Vec3};

/// What was commanded since the last odometry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Commanded {
    /// As the autopilot took it.
    pub thrust: NormalisedThrust,
    /// Collective thrust per unit mass that was believed of it, m/s².
    pub acc: f64,
    /// The vehicle flies freely and follows what is sent, so that its motion tells of itself.
    pub free: bool,
    /// The motors hold it in the air, so that its estimate must be one motion.
    pub airborne: bool,
}

/// Where the body z axis has come to by what was commanded, world frame: a first-order lag.
#[derive(Clone, Copy, Debug, Default)]
struct Followed {
    /// Since when which axis is commanded, and how far the vehicle had come by then; none: nothing is commanded.
    at: Option<(Time, Vec3, Vec3)>,
}

/// The velocity has repeated itself for so long, s, while the model came to so much, m/s: a slow estimate that is sent
/// more often than it is new.
#[derive(Clone, Copy, Debug, Default)]
struct Repeated {
    time: f64,
    model_world: Vec3,
}

/// Last accepted odometry, and what was learnt.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    last: Option<Odometry>,
    observer: Observer,
    hover_thrust: HoverThrust,
    lag: AttitudeLag,
    followed: Followed,
    repeated: Repeated,
    trust: Trust,
    /// Of the last sample.
    fault: Option<OdometryFault>,
}

/// Cosine of the tilt, 60 degrees, beyond which the vertical says little of the thrust. Chosen by eye.
const LEAST_UPRIGHT: f64 = 0.5;
/// Samples farther apart are not one step of the observer, s. Chosen by eye, as old as the shipped
/// `ladder.odometry_stale_s` lets odometry get.
const LONGEST_STEP: f64 = 0.2;

impl Motion {
    /// Has seen nothing; with what learns from it.
    #[must_use]
    pub fn new(observer: Observer, hover_thrust: HoverThrust, lag: AttitudeLag) -> Self {
        Self {
            last: None,
            observer,
            hover_thrust,
            lag,
            followed: Followed::default(),
            repeated: Repeated::default(),
            trust: Trust::default(),
            fault: None,
        }
    }

    /// The observer.
    #[must_use]
    pub fn observer(&self) -> &Observer {
        &self.observer
    }

    /// `vehicle` with the hover thrust that was learnt.
    #[must_use]
    pub fn vehicle(&self, vehicle: &Airframe) -> Airframe {
        Airframe { hover_thrust: self.hover_thrust.get(), ..*vehicle }
    }

    /// The attitude loop's lag that was learnt, s.
    #[must_use]
    pub fn attitude_lag(&self) -> f64 {
        self.lag.get()
    }

    /// Forgets the disturbance and any distrust: on the ground. What was learnt of the vehicle itself stays.
    pub fn rest(&mut self) {
        self.trust.reset();
        self.observer.reset();
        self.hover_thrust.skip();
        self.lag.skip();
        self.followed = Followed::default();
    }

    /// The vehicle has just left the ground at `thrust`.
    pub fn lift_off(&mut self, thrust: NormalisedThrust) {
        self.hover_thrust.restart(thrust);
    }

    /// From `now` on the attitude is commanded to be `world_from_body`.
    pub fn command(&mut self, now: Time, world_from_body: &Rot) {
        let axis_world = world_from_body * Vec3::z();
        self.lag.command(now, axis_world);
        self.followed.command(now, axis_world, self.lag.get());
    }

    /// Accepts `odometry` if it is finite and newer. Returns a jump of the frame.
    pub fn take(&mut self, odometry: &Odometry, commanded: &Commanded) -> Option<Jump> {
        let parts = [&odometry.pos_world, &odometry.vel_world, &odometry.ang_vel_body];
        let finite = parts.iter().all(|v| v.iter().all(|x| x.is_finite()));
        // A quaternion that is not of unit length is no attitude.
        let unit = (odometry.world_from_body.norm() - 1.0).abs() < 1e-3;
        let newer = self.last.is_none_or(|last| odometry.stamp > last.stamp);
        if !finite || !unit || !newer {
            return None;
        }
        let dt = self.last.map_or(0.0, |last| odometry.stamp.since(last.stamp));
        let model = odometry.world_from_body * Vec3::z() * commanded.acc - Vec3::z() * GRAVITY;
        let mut jump = self.last.and_then(|last| jump(&last, odometry));
        self.fault = self.judge(odometry, dt, commanded, model, jump);
        if self.fault == Some(OdometryFault::AttitudeTurned) {
            jump = jump.or(Some(Jump { about_world: odometry.pos_world, ..Jump::default() }));
            jump = jump.zip(self.last).map(|(jump, last)| Jump { yaw: turned(&last, odometry), ..jump });
            self.followed.turn(jump.map_or(0.0, |jump| jump.yaw));
        }
        let Repeated { time, model_world } = self.repeated;
        let repeats = commanded.free && self.last.is_some_and(|last| last.vel_world == odometry.vel_world);
        self.repeated = if repeats {
            Repeated { time: time + dt, model_world: model_world + model * dt }
        } else {
            Repeated::default()
        };
        if jump.is_some() || dt > LONGEST_STEP || self.trust.distrust().is_some() {
            self.observer.rebase(odometry.vel_world);
            self.hover_thrust.skip();
            self.lag.skip();
        } else if repeats {
            // Numbers that are not new say nothing, least of all that something holds the vehicle back.
            self.hover_thrust.skip();
        } else {
            let since = time + dt;
            let mean = if time > 0.0 { (model_world + model * dt) / since } else { model };
            self.observer.step(since, odometry.vel_world, mean);
            self.learn(odometry, dt, commanded, time > 0.0);
        }
        self.last = Some(*odometry);
        jump
    }

    /// Checks `odometry` against the last one. A fault that was not known before.
    fn judge(
        &mut self,
        odometry: &Odometry,
        dt: f64,
        commanded: &Commanded,
        acc_model: Vec3,
        jump: Option<Jump>,
    ) -> Option<OdometryFault> {
        let last = self.last.filter(|_| commanded.airborne)?;
        if last.reset_counter != odometry.reset_counter || dt > LONGEST_STEP {
            self.trust.skip();
            return None;
        }
        self.trust.step(&Step {
            last: &last,
            new: odometry,
            dt,
            acc_model,
            acc_followed: self
                .followed
                .axis(odometry.stamp, self.lag.get())
                .map_or(acc_model, |axis_world| axis_world * commanded.acc - Vec3::z() * GRAVITY),
            disturbance: self.observer.disturbance(),
            free: commanded.free,
            jumped: jump.is_some(),
        })
    }

    /// `repeated`: the last velocity is older than the last sample.
    fn learn(&mut self, odometry: &Odometry, dt: f64, commanded: &Commanded, repeated: bool) {
        let axis_world = odometry.world_from_body * Vec3::z();
        let Some(last) = self.last.filter(|_| commanded.free && !repeated) else {
            self.hover_thrust.skip();
            return;
        };
        // The thrust whose vertical part is what was felt vertically: wind and drag, which are mostly level, do not enter,
        // as they would along the body's axis, which leans against them.
        let upright = 0.5 * ((last.world_from_body * Vec3::z()).z + axis_world.z);
        if upright > LEAST_UPRIGHT {
            let acc_up = (odometry.vel_world.z - last.vel_world.z) / dt;
            self.hover_thrust.step(dt, commanded.thrust, (acc_up + GRAVITY) / upright);
        } else {
            self.hover_thrust.skip();
        }
        self.lag.measure(odometry.stamp, axis_world);
    }

    /// The last accepted odometry, however old.
    #[must_use]
    pub fn last(&self) -> Option<&Odometry> {
        self.last.as_ref()
    }

    /// The last accepted odometry unless it is not believed, or older than `stale` seconds (or stamped that far in the
    /// future).
    #[must_use]
    pub fn fresh(&self, now: Time, stale: f64) -> Option<&Odometry> {
        let believed = self.trust.distrust().is_none();
        self.last.as_ref().filter(|last| believed && now.since(last.stamp).abs() <= stale)
    }

    /// Why odometry is not believed; none: it is.
    #[must_use]
    pub fn distrust(&self) -> Option<&Distrust> {
        self.trust.distrust()
    }

    /// The largest check of the odometry over its gate.
    #[must_use]
    pub fn doubt(&self) -> f64 {
        self.trust.doubt()
    }

    /// What is false about the odometry: what is not believed, or what the newest sample showed for the first time.
    #[must_use]
    pub fn fault(&self) -> Option<OdometryFault> {
        self.trust.distrust().map(|distrust| distrust.fault).or(self.fault)
    }

    /// Age of the last accepted odometry, s; none: there is none.
    #[must_use]
    pub fn age(&self, now: Time) -> Option<f64> {
        self.last.map(|last| now.since(last.stamp).abs())
    }
}

impl Followed {
    fn command(&mut self, now: Time, axis_world: Vec3, lag: f64) {
        let come = self.axis(now, lag).unwrap_or(axis_world);
        self.at = Some((now, axis_world, come));
    }

    /// At `now`, the loop's lag being `lag` s.
    fn axis(&self, now: Time, lag: f64) -> Option<Vec3> {
        self.at.map(|(since, axis_world, come)| {
            axis_world + (come - axis_world) * (-now.since(since).max(0.0) / lag.max(1e-3)).exp()
        })
    }

    /// The frame that attitudes are told in has turned by `yaw` rad.
    fn turn(&mut self, yaw: f64) {
        let turn = Rot::from_axis_angle(&Vec3::z_axis(), yaw);
        self.at = self.at.map(|(since, axis_world, come)| (since, turn * axis_world, turn * come));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped::controller as config;

    const HOVER: Commanded = Commanded { thrust: NormalisedThrust(0.25), acc: GRAVITY, free: true, airborne: true };

    fn at(stamp: f64, x: f64) -> Odometry {
        Odometry {
            stamp: Time::from_secs(stamp),
            pos_world: Vec3::new(x, 0.0, 2.0),
            vel_world: Vec3::new(5.0, 0.0, 0.0),
            world_from_body: Rot::identity(),
            ang_vel_body: Vec3::zeros(),
            reset_counter: 0,
        }
    }

    #[test]
    fn odometry_that_is_not_finite_or_not_newer_is_ignored() {
        let mut motion = config().motion();
        motion.take(&at(1.0, 0.0), &HOVER);
        for bad in [
            Odometry { pos_world: Vec3::new(f64::NAN, 0.0, 0.0), ..at(1.1, 0.0) },
            Odometry {
                world_from_body: Rot::new_unchecked(nalgebra::Quaternion::new(0.0, 0.0, 0.0, 0.0)),
                ..at(1.1, 0.0)
            },
            at(0.9, 3.0),
        ] {
            motion.take(&bad, &HOVER);
            assert_eq!(motion.last(), Some(&at(1.0, 0.0)));
        }
        assert!(motion.fresh(Time::from_secs(1.15), 0.2).is_some());
        assert!(motion.fresh(Time::from_secs(1.25), 0.2).is_none());
    }

    #[test]
    fn jumps_are_noticed_announced_or_not_and_flight_is_none() {
        let mut motion = config().motion();
        assert_eq!(motion.take(&at(1.0, 0.0), &HOVER), None);
        assert_eq!(motion.take(&at(1.02, 0.1), &HOVER), None);
        let jump = motion.take(&at(1.04, 4.2), &HOVER).unwrap();
        assert!((jump.pos_world - Vec3::new(4.0, 0.0, 0.0)).norm() < 1e-9);
        let turned =
            Odometry { reset_counter: 1, world_from_body: Rot::from_axis_angle(&Vec3::z_axis(), 0.3), ..at(1.06, 4.3) };
        let jump = motion.take(&turned, &HOVER).unwrap();
        assert!(jump.pos_world.norm() < 1e-9 && (jump.yaw - 0.3).abs() < 1e-9);
    }

    #[test]
    fn a_jump_is_no_disturbance() {
        let mut motion = config().motion();
        for k in 0..100 {
            let t = 0.02 * f64::from(k);
            let jumped = if k < 50 { 0.0 } else { 7.0 };
            let odometry = Odometry {
                vel_world: Vec3::new(5.0 + jumped, 0.0, 0.0),
                reset_counter: u32::from(k >= 50),
                ..at(t, (5.0 + jumped) * t)
            };
            motion.take(&odometry, &HOVER);
            assert!(motion.observer().disturbance().norm() < 1e-9);
        }
    }
}
