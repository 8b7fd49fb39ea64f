//! The camera of a lockstep flight: exposes, lies where it is told to, and hands its pictures to the pilot.

use goshawk_core::{Plan, Rot, Time, Vec3};
use goshawk_policy::stream::Arrival;

use super::super::fault::{CameraFault, Fault};
use super::super::judge::{Exposure, in_view};
use super::super::{FRAME_AT_PLANNER_S, TrialError, Witness};
use super::{FRAMES_PER_S, Lockstep, STEPS_PER_S};
use crate::render::Frame;
use crate::sense::rgbd::{RgbdImage, mix};

/// Where pictures come from, as an [`Arrival`] names it: not said, as by most drivers.
const SOURCE: u64 = 0;
/// Between the pictures of a second camera, in steps of 1 ms: 77 Hz.
const SECOND_STEPS: u64 = 13;
/// The second camera has counted its pictures for longer.
const SECOND_SEQ: u64 = 100_000;

/// A picture on its way through the vehicle.
pub(super) struct InFlight {
    arrival: Arrival,
    image: RgbdImage,
    exposure: Exposure,
    /// The pilot has had it.
    planned: bool,
    plan: Option<Plan>,
}

impl Lockstep<'_> {
    /// Exposes, plans, delivers.
    pub(super) fn see(&mut self, now: Time, witness: &mut dyn Witness) -> Result<(), TrialError> {
        if self.step == self.frames * STEPS_PER_S / FRAMES_PER_S {
            self.frames += 1;
            // On the ground nobody looks at the images.
            if self.started.is_some() {
                self.expose(now, witness);
            }
        }
        let second = self.camera_fault() == Some(CameraFault::Two);
        if second && self.step.is_multiple_of(SECOND_STEPS) {
            self.expose_second(now);
        }
        for frame in &mut self.pending {
            if !frame.planned && now >= frame.arrival.stamp.plus(FRAME_AT_PLANNER_S) {
                frame.planned = true;
                frame.plan = self.onboard.plan(&frame.arrival, &frame.image)?;
                if frame.plan.is_some() {
                    witness.spent(&self.onboard.spent());
                }
            }
        }
        let there = FRAME_AT_PLANNER_S + self.onboard.compute_s();
        while let Some(frame) = self.pending.pop_front_if(|frame| now >= frame.arrival.stamp.plus(there)) {
            if let Some(plan) = frame.plan {
                witness.plan(now, &plan, self.onboard.frame_record());
                self.judge.plan(&plan, &frame.exposure, self.in_task(now));
                self.onboard.take_plan(plan);
            }
        }
        Ok(())
    }

    fn camera_fault(&self) -> Option<CameraFault> {
        match self.injection.acting() {
            Some(Fault::Camera(fault)) => Some(fault),
            _ => None,
        }
    }

    fn exposure(&self) -> Exposure {
        Exposure {
            vehicle_world: self.quad.state().pos_world,
            heading_rad: self.quad.state().world_from_body.euler_angles().2,
            target_world: self.evader.map(|evader| evader.centre_world()),
        }
    }

    fn expose(&mut self, now: Time, witness: &mut dyn Witness) {
        let person = self.runner.as_ref().zip(self.evader).map(|(runner, evader)| runner.person(&evader));
        let pose = self.mount.pose(self.quad.state());
        self.renderer.render_with(&self.scene.world, &self.moving, person.as_ref(), &pose, &mut self.frame);
        let motion = self.mount.motion(self.quad.state());
        let mut image = RgbdImage::default();
        self.sensor.capture(&self.frame, &motion, mix(mix(self.config.seed, 13), self.frames), &mut image);
        let exposure = self.exposure();
        if self.in_task(now) {
            self.judge.frame(in_view(&self.frame, &self.sensor), &exposure);
        }
        let delivered = match self.camera_fault() {
            Some(fault) => self.tampered.apply(fault, self.frames, &mut image),
            None => true,
        };
        if delivered {
            witness.frame(self.frames, now, &image);
            let arrival = Arrival { seq: self.frames, stamp: now, source: SOURCE };
            self.pending.push_back(InFlight { arrival, image, exposure, planned: false, plan: None });
        }
    }

    /// A picture of a camera that looks backwards.
    fn expose_second(&mut self, now: Time) {
        let mut pose = self.mount.pose(self.quad.state());
        pose.world_from_cam *= Rot::from_axis_angle(&Vec3::z_axis(), std::f64::consts::PI);
        let mut frame = Frame::default();
        self.renderer.render_with(&self.scene.world, &self.moving, None, &pose, &mut frame);
        self.second_frames += 1;
        let mut image = RgbdImage::default();
        let motion = self.mount.motion(self.quad.state());
        self.sensor.capture(&frame, &motion, mix(mix(self.config.seed, 24), self.second_frames), &mut image);
        let arrival = Arrival { seq: SECOND_SEQ + self.second_frames, stamp: now, source: SOURCE };
        let exposure = self.exposure();
        self.pending.push_back(InFlight { arrival, image, exposure, planned: false, plan: None });
    }
}
