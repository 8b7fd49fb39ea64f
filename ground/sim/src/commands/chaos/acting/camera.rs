//! The camera of a chaos flight: pictures of the scene, as messages, on a line that may lose, delay and swap them.

use goshawk_core::{Rot, Time, Vec3};

use super::Acting;
use super::senses::{FalsePictures, Line, frame_message};
use crate::commands::chaos::schedule::Kind;
use crate::render::{Frame, Renderer};
use crate::sense::file::Sensors;
use crate::sense::rgbd::{RgbdImage, Sensor, mix};
use crate::trial::airframe::Mount;
use crate::trial::fault::CameraFault;
use crate::trial::{FRAME_AT_PLANNER_S, Fault as Sense, Scene};
use crate::vehicle::quadrotor::QuadrotorState;

/// Between two pictures, in steps of 1 ms: 15 Hz, for pictures take most of a flight's time; and 77 Hz of a second
/// camera.
const STEPS: u64 = 66;
const SECOND_STEPS: u64 = 13;
const SECOND_SEQ: u64 = 100_000;
/// The evader begins to run then, s.
const RUNS_FROM_S: f64 = 7.0;

/// The camera with its errors.
pub(crate) struct Camera {
    mount: Mount,
    renderer: Renderer,
    sensor: Sensor,
    frame: Frame,
    errors: FalsePictures,
    line: Line<Vec<u8>>,
    seed: u64,
    frames: u64,
    second_frames: u64,
}

impl Camera {
    pub(crate) fn new(sensors: &Sensors, mount: Mount, seed: u64) -> Self {
        Self {
            renderer: Renderer::new(mount.camera),
            sensor: sensors.sensor(&mount.camera, mix(seed, 14)),
            frame: Frame::default(),
            errors: FalsePictures::new(seed),
            line: Line::default(),
            mount,
            seed,
            frames: 0,
            second_frames: 0,
        }
    }

    /// A millisecond: exposes if it is time.
    pub(crate) fn step(&mut self, now: Time, step: u64, scene: &Scene, vehicle: &QuadrotorState, acting: &Acting) {
        let two = acting.any(&Kind::Sense(Sense::Camera(CameraFault::Two)));
        if step.is_multiple_of(STEPS) {
            self.expose(now, step, scene, vehicle, acting, false);
        }
        if two && step.is_multiple_of(SECOND_STEPS) {
            self.expose(now, step, scene, vehicle, acting, true);
        }
    }

    /// What has arrived at the vehicle.
    pub(crate) fn arrived(&mut self, now: Time) -> Vec<Vec<u8>> {
        self.line.arrived(now)
    }

    fn expose(
        &mut self,
        now: Time,
        step: u64,
        scene: &Scene,
        vehicle: &QuadrotorState,
        acting: &Acting,
        backward: bool,
    ) {
        let counted = if backward { &mut self.second_frames } else { &mut self.frames };
        *counted += 1;
        let (number, noise) = (*counted, if backward { 24 } else { 13 });
        let person = scene.person_at(step as f64 * 1e-3 - RUNS_FROM_S);
        let mut pose = self.mount.pose(vehicle);
        if backward {
            pose.world_from_cam *= Rot::from_axis_angle(&Vec3::z_axis(), std::f64::consts::PI);
        }
        self.renderer.render_with(&scene.world, &[], person.as_ref(), &pose, &mut self.frame);
        let mut image = RgbdImage::default();
        let motion = self.mount.motion(vehicle);
        self.sensor.capture(&self.frame, &motion, mix(mix(self.seed, noise), number), &mut image);
        let delivered = backward || self.errors.apply(self.seed, acting, &mut image);
        if !delivered || acting.any(&Kind::FramesLost) {
            return;
        }
        let of = |pick: fn(&Kind) -> Option<f64>| acting.number(pick).unwrap_or(0.0);
        let late = of(|kind| if let Kind::FramesLate(x) = kind { Some(*x) } else { None });
        let off = of(|kind| if let Kind::FramesStamped(x) = kind { Some(*x) } else { None });
        let seq = if backward { SECOND_SEQ + number } else { number };
        let message = frame_message(seq, now.plus(off), &image, &self.mount.camera);
        let arrives = now.plus(FRAME_AT_PLANNER_S + late);
        let swapped = acting.any(&Kind::FramesSwapped);
        if acting.any(&Kind::FramesTwice) {
            self.line.send(arrives, message.clone(), swapped);
        }
        self.line.send(arrives, message, swapped);
    }
}
