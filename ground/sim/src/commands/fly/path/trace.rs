//! Where vehicle and target were in a flight, 20 times a second.

use goshawk_core::{ControllerOutput, FrameRecord, Mode, Plan, Time, Vec3};

use crate::sense::rgbd::RgbdImage;
use crate::trial::airframe::Mount;
use crate::trial::{Contact, Outcome, Pilot, Spent, Truth, Witness};
use crate::world::World;

/// A trace holds no more samples than this (two minutes, 120 kB); a longer flight is sampled less often.
pub const MOST_SAMPLES: usize = 2400;
/// Truths a second.
pub(super) const TRUTHS_HZ: f64 = 20.0;

/// One instant of the task.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The vehicle, m.
    pub pos_world: [f32; 3],
    /// Its speed, m/s.
    pub speed_mps: f32,
    /// From its sphere to the nearest obstacle, m.
    pub clearance_m: f32,
    /// The evader; none in navigation.
    pub target: Option<TargetSample>,
}

/// The evader at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetSample {
    /// Its centre, m.
    pub pos_world: [f32; 3],
    /// Where the camera has the centre (u, v), px, also outside the image; none: behind it.
    pub pixel: Option<[f32; 2]>,
    /// The last frame showed it well enough to count as seen.
    pub visible: bool,
}

/// The samples of a flight, from the task's beginning, evenly spaced in time.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// In order.
    pub samples: Vec<Sample>,
    /// Every how many-th truth is in it.
    pub stride: usize,
}

/// Records a trace and passes everything on to another witness.
pub struct Tracer<'a> {
    mount: Mount,
    inner: &'a mut dyn Witness,
    trace: Trace,
    up: bool,
    truths: usize,
}

impl<'a> Tracer<'a> {
    /// For a vehicle with that camera.
    pub fn new(mount: Mount, inner: &'a mut dyn Witness) -> Self {
        Self { mount, inner, trace: Trace { samples: Vec::new(), stride: 1 }, up: false, truths: 0 }
    }

    /// The trace so far.
    #[must_use]
    pub fn finish(self) -> Trace {
        self.trace
    }

    fn sample(&self, truth: &Truth<'_>) -> Sample {
        let vehicle = truth.vehicle;
        let pose = self.mount.pose(vehicle);
        let place = |v: &Vec3| <[f32; 3]>::from(v.cast::<f32>());
        Sample {
            pos_world: place(&vehicle.pos_world),
            speed_mps: vehicle.vel_world.norm() as f32,
            clearance_m: truth.clearance_m as f32,
            target: truth.evader.as_ref().map(|evader| {
                let centre = evader.centre_world();
                let pos_cam = pose.world_from_cam.inverse_transform_vector(&(centre - pose.pos_world));
                TargetSample {
                    pos_world: place(&centre),
                    pixel: self.mount.camera.project(&pos_cam).map(|(u, v)| [u as f32, v as f32]),
                    visible: truth.visible,
                }
            }),
        }
    }
}

impl Witness for Tracer<'_> {
    fn world(&mut self, world: &World) {
        self.inner.world(world);
    }

    fn control(&mut self, now: Time, output: &ControllerOutput, onboard: &dyn Pilot) {
        self.up |= output.transition.is_some_and(|change| change.from == Mode::Takeoff);
        self.inner.control(now, output, onboard);
    }

    fn verdict(&mut self, now: Time, outcome: Outcome, contact: Option<Contact>) {
        self.inner.verdict(now, outcome, contact);
    }

    fn frame(&mut self, seq: u64, stamp: Time, image: &RgbdImage) {
        self.inner.frame(seq, stamp, image);
    }

    fn plan(&mut self, ready: Time, plan: &Plan, record: Option<&FrameRecord>) {
        self.inner.plan(ready, plan, record);
    }

    fn spent(&mut self, spent: &Spent) {
        self.inner.spent(spent);
    }

    fn truth(&mut self, now: Time, truth: &Truth<'_>) {
        // Tracking begins when the evader runs, a navigation with the take-off's end.
        let in_task = truth.evader.as_ref().map_or(self.up, |evader| evader.path_m > 0.0);
        if in_task {
            if self.truths.is_multiple_of(self.trace.stride) {
                self.trace.samples.push(self.sample(truth));
            }
            self.truths += 1;
            if self.trace.samples.len() == MOST_SAMPLES {
                let mut index = 0;
                self.trace.samples.retain(|_| {
                    index += 1;
                    index % 2 == 1
                });
                self.trace.stride *= 2;
            }
        }
        self.inner.truth(now, truth);
    }
}
