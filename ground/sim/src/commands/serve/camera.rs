//! The camera's thread: renders what physics exposed and publishes it. Rendering never delays physics.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use color_eyre::eyre::{Result, WrapErr};
use goshawk_bus::Publisher;
use goshawk_core::Time;
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_vehicle::config::Vehicle;
use goshawk_vehicle::slot::Slot;

use super::session::Session;
use crate::actors::person::Person;
use crate::render::{Frame, Renderer};
use crate::sense::file::Sensors;
use crate::sense::rgbd::{RgbdImage, Sensor, mix};
use crate::trial::airframe::Mount;
use crate::trial::fault::{CameraFault, Tampered};
use crate::trial::judge::in_view;
use crate::trial::{Fault, Scene};
use crate::vehicle::quadrotor::QuadrotorState;
use crate::world::Part;

/// What the camera was pointed at.
#[derive(Clone, Debug)]
pub(super) struct Exposure {
    pub(super) stamp: Time,
    pub(super) vehicle: QuadrotorState,
    pub(super) person: Option<Person>,
    pub(super) moving: Vec<Part>,
    /// Since the flight began in earnest; negative before.
    pub(super) running_for_s: f64,
}

/// The running thread.
pub(super) struct Camera {
    exposures: Slot<Exposure>,
    sees_target: Arc<AtomicBool>,
    published: Arc<AtomicU64>,
    thread: JoinHandle<()>,
}

impl Camera {
    pub(super) fn start(
        session: &Session,
        vehicle: &Vehicle,
        sensors: &Sensors,
        scene: &Arc<Scene>,
        seed: u64,
        fault: Option<CameraFault>,
        stop: Arc<AtomicBool>,
    ) -> Result<Self> {
        let exposures = Slot::default();
        let sees_target = Arc::new(AtomicBool::new(false));
        let published = Arc::new(AtomicU64::new(0));
        let mut work = Work {
            publisher: session.publisher(Key::Rgbd)?,
            mount: Mount::of(vehicle),
            vfov_rad: vehicle.camera.vfov_deg.to_radians(),
            scene: Arc::clone(scene),
            seed,
            fault,
            tampered: Tampered::new(seed),
            frame: Frame::default(),
            image: RgbdImage::default(),
        };
        let mut sensor = sensors.sensor(&work.mount.camera, mix(seed, 14));
        let (inbox, seen, count) = (exposures.clone(), Arc::clone(&sees_target), Arc::clone(&published));
        let thread = thread::Builder::new()
            .name("camera".to_owned())
            .spawn(move || {
                let mut renderer = Renderer::new(work.mount.camera);
                let mut newest = 0;
                while !stop.load(Ordering::Relaxed) {
                    if let Some((exposure, _)) = inbox.wait_newer(&mut newest, Duration::from_millis(100)) {
                        let seq = count.fetch_add(1, Ordering::Relaxed);
                        work.shoot(&mut renderer, &mut sensor, &exposure, seq);
                        seen.store(in_view(&work.frame, &sensor), Ordering::Relaxed);
                    }
                }
            })
            .wrap_err("cannot start the camera's thread")?;
        Ok(Self { exposures, sees_target, published, thread })
    }

    /// Hands an exposure over; one that the thread has not begun is replaced.
    pub(super) fn expose(&self, exposure: Exposure) {
        self.exposures.put(Arc::new(exposure));
    }

    /// Whether the last image shows the target.
    pub(super) fn sees_target(&self) -> bool {
        self.sees_target.load(Ordering::Relaxed)
    }

    /// Waits for the thread's end; returns how many images it published.
    pub(super) fn join(self) -> u64 {
        if self.thread.join().is_err() {
            tracing::error!("the camera's thread failed");
        }
        self.published.load(Ordering::Relaxed)
    }
}

struct Work {
    publisher: Publisher,
    mount: Mount,
    vfov_rad: f64,
    scene: Arc<Scene>,
    seed: u64,
    fault: Option<CameraFault>,
    tampered: Tampered,
    frame: Frame,
    image: RgbdImage,
}

impl Work {
    fn shoot(&mut self, renderer: &mut Renderer, sensor: &mut Sensor, exposure: &Exposure, seq: u64) {
        let pose = self.mount.pose(&exposure.vehicle);
        let (moving, person) = (&exposure.moving, exposure.person.as_ref());
        renderer.render_with(&self.scene.world, moving, person, &pose, &mut self.frame);
        sensor.capture(
            &self.frame,
            &self.mount.motion(&exposure.vehicle),
            mix(mix(self.seed, 13), seq),
            &mut self.image,
        );
        let acting = self.fault.filter(|fault| exposure.running_for_s >= Fault::Camera(*fault).onset_s(self.seed));
        if acting.is_some_and(|fault| !self.tampered.apply(fault, seq, &mut self.image)) {
            return;
        }
        let image = &self.image;
        self.publisher.put(&v1::Rgbd {
            seq,
            stamp_ns: exposure.stamp.0,
            width: image.width as u32,
            height: image.height as u32,
            hfov_rad: self.mount.camera.hfov_rad,
            vfov_rad: self.vfov_rad,
            rgb: image.rgb.clone(),
            depth_mm: image.depth_mm.iter().flat_map(|mm| mm.to_le_bytes()).collect(),
        });
    }
}
