//! Everything together: a thread for each topic that comes in, the newest message only, and the vehicle's telemetry out.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use color_eyre::eyre::{Result, WrapErr};
use goshawk_bus::Bus;
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use serde::Serialize;

use crate::camera::{Camera, Packing};
use crate::config::{self, Config, Kind};
use crate::images::pairing::Side;
use crate::motion::Motion;
use crate::outputs::Frames;
use crate::tally::{Refused, Tally};
use crate::wire::cdr::decode;
use crate::wire::clock::Clocks;
use crate::wire::messages::{self, CameraInfo, CompressedImage, Image, Message, PoseStamped};
use crate::wire::node::{RosNode, Subscription};

/// Images that may wait: a third means that the newest is late.
const IMAGES_WAITING: usize = 2;
/// Odometry samples that may wait: none is left out, for the vehicle judges their course.
const MOTIONS_WAITING: usize = 16;
const COLOUR: &str = "colour image";
const DEPTH: &str = "depth image";
const ODOMETRY: &str = "odometry";
/// How often it is told what went through, s.
const REPORT_S: u64 = 10;

/// Passes on until `stop`.
///
/// # Errors
/// An endpoint or a name cannot be one.
pub fn run(config: &Config, stop: &AtomicBool) -> Result<()> {
    let tally = Arc::new(Tally::default());
    let bus = Bus::dial(config.vehicle.name.parse()?, &config.vehicle.connect)?;
    let mut node = RosNode::open(&config.ros)?;
    let camera = config.camera.as_ref().map(|camera| take_images(camera, &bus, &mut node, &tally)).transpose()?;
    if let Some(odometry) = &config.odometry {
        take_motion(odometry, &bus, &mut node, &tally)?;
    }
    if let Some(output) = &config.output {
        tell(output, &bus, &mut node, &tally)?;
    }
    tracing::info!(
        "{} between the vehicle {} at {} and ROS 2 domain {} at {}",
        config.ros.node,
        config.vehicle.name,
        config.vehicle.connect,
        config.ros.domain,
        config.ros.connect
    );
    let mut reported = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        thread::sleep(Duration::from_millis(100));
        if reported.elapsed() >= Duration::from_secs(REPORT_S) {
            report(config, camera.as_deref(), &tally);
            reported = Instant::now();
        }
    }
    tracing::info!("stopping");
    node.close();
    Ok(())
}

fn report(config: &Config, camera: Option<&Camera>, tally: &Tally) {
    let report = tally.take();
    for line in &report.refused {
        tracing::warn!("{line}");
    }
    let lost = camera.map_or(0, Camera::take_lost);
    let (images, motions, told) = (report.images, report.motions, report.told);
    tracing::info!(
        "in {REPORT_S} s: {images} images and {motions} odometry samples in, {lost} images without their other half; \
         {told} messages out"
    );
    for (name, topic) in [
        (COLOUR, config.camera.as_ref().map(|camera| &camera.colour)),
        (DEPTH, config.camera.as_ref().map(|camera| &camera.depth)),
        (ODOMETRY, config.odometry.as_ref().map(|odometry| &odometry.topic)),
    ] {
        if let Some(topic) = topic.filter(|_| !report.heard.contains_key(name)) {
            let router = &config.ros.connect;
            tracing::warn!("no {name} in {REPORT_S} s: see that {topic} is published, and rmw_zenohd is at {router}");
        }
    }
    if report.untaken > 0 {
        let config::Vehicle { name, connect } = &config.vehicle;
        tracing::warn!(
            "{} messages not sent: no vehicle {name} at {connect} listens for them. See that goshawk-air runs there, and \
             for odometry that its file says odometry = \"zenoh\"",
            report.untaken
        );
    }
}

/// Counts each message, and calls `take` with it, on a thread of its own.
fn on_each(
    name: &'static str,
    subscription: Subscription,
    tally: &Arc<Tally>,
    mut take: impl FnMut(&[u8]) + Send + 'static,
) -> Result<()> {
    let tally = Arc::clone(tally);
    thread::Builder::new()
        .name(name.to_owned())
        .spawn(move || {
            while let Some(sample) = subscription.recv() {
                tally.heard(name);
                take(&sample.payload().to_bytes());
            }
        })
        .map(drop)
        .wrap_err_with(|| format!("cannot start the {name} thread"))
}

fn take_images(camera: &config::Camera, bus: &Bus, node: &mut RosNode, tally: &Arc<Tally>) -> Result<Arc<Camera>> {
    let shared = Arc::new(Camera::new(camera));
    let (lens, counted) = (Arc::clone(&shared), Arc::clone(tally));
    on_each("camera_info", node.subscribe::<CameraInfo>(&camera.info, 1)?, tally, move |bytes| {
        if let Err(why) = lens.info(bytes) {
            counted.refuse("camera_info", why);
        }
    })?;
    let vehicle = Arc::new(Mutex::new((bus.publisher(Key::Rgbd)?, 0)));
    for (side, name, topic) in [(Side::Colour, COLOUR, &camera.colour), (Side::Depth, DEPTH, &camera.depth)] {
        let packing = Packing::of(topic);
        let subscription = match packing {
            Packing::Raw => node.subscribe::<Image<'_>>(topic, IMAGES_WAITING)?,
            Packing::Compressed => node.subscribe::<CompressedImage<'_>>(topic, IMAGES_WAITING)?,
        };
        let (camera, counted, vehicle) = (Arc::clone(&shared), Arc::clone(tally), Arc::clone(&vehicle));
        on_each(name, subscription, tally, move |bytes| match camera.take(side, packing, bytes, &Clocks::now()) {
            Err(why) => counted.refuse(name, why),
            Ok(None) => {}
            Ok(Some(rgbd)) => {
                let mut vehicle = vehicle.lock().unwrap_or_else(PoisonError::into_inner);
                if !vehicle.0.is_wanted() {
                    return counted.untaken();
                }
                vehicle.1 += 1;
                let seq = vehicle.1;
                if vehicle.0.put(&v1::Rgbd { seq, ..rgbd }).is_some() {
                    counted.image();
                }
            }
        })?;
    }
    Ok(shared)
}

fn take_motion(odometry: &config::Odometry, bus: &Bus, node: &mut RosNode, tally: &Arc<Tally>) -> Result<()> {
    let subscription = match odometry.message {
        Kind::Odometry => node.subscribe::<messages::Odometry>(&odometry.topic, MOTIONS_WAITING)?,
        Kind::Pose => node.subscribe::<PoseStamped>(&odometry.topic, MOTIONS_WAITING)?,
    };
    let (mut motion, mut vehicle) = (Motion::new(odometry), bus.publisher(Key::Odometry)?);
    let (kind, counted) = (odometry.message, Arc::clone(tally));
    on_each(ODOMETRY, subscription, tally, move |bytes| match moved(&mut motion, kind, bytes, &Clocks::now()) {
        Err(why) => counted.refuse(ODOMETRY, why),
        Ok(None) => {}
        Ok(Some(sample)) => {
            if !vehicle.is_wanted() {
                counted.untaken();
            } else if vehicle.put(&sample).is_some() {
                counted.motion();
            }
        }
    })
}

/// The vehicle's motion by a message; none: velocity or rates are differences, and it is the first.
///
/// # Errors
/// It is no such message, or not of now, or cannot be.
pub fn moved(motion: &mut Motion, kind: Kind, bytes: &[u8], now: &Clocks) -> Result<Option<v1::Odometry>, Refused> {
    let (stamp, pose, twist) = match kind {
        Kind::Odometry => {
            let message = decode::<messages::Odometry>(bytes)?;
            (message.header.stamp, message.pose.pose, message.twist.twist)
        }
        Kind::Pose => {
            let message = decode::<PoseStamped>(bytes)?;
            (message.header.stamp, message.pose, messages::Twist::default())
        }
    };
    Ok(motion.take(now.monotonic(stamp)?, &pose, &twist)?)
}

fn tell(output: &config::Output, bus: &Bus, node: &mut RosNode, tally: &Arc<Tally>) -> Result<()> {
    let frames = Frames { world: output.world_frame.clone(), body: output.body_frame.clone() };
    let mut teller = Teller { bus, node, tally, frames };
    teller.tell(output.plan.as_deref(), Key::Plan, |frames, plan: &v1::Plan, now| {
        frames.path(plan, now.ros(plan.frame_ns))
    })?;
    teller.tell(output.candidates.as_deref(), Key::Plan, |frames, plan: &v1::Plan, now| {
        Some(frames.candidates(plan, now.ros(plan.frame_ns)))
    })?;
    teller.tell(output.target.as_deref(), Key::Target, |frames, target: &v1::Target, now| {
        frames.target(target, now.ros(target.stamp_ns))
    })?;
    teller.tell(output.odometry.as_deref(), Key::Control, |frames, control: &v1::Control, now| {
        frames.odometry(control, now.ros(control.stamp_ns))
    })?;
    teller.tell(output.tf.as_deref(), Key::Control, |frames, control: &v1::Control, now| {
        frames.tf(control, now.ros(control.stamp_ns))
    })
}

struct Teller<'a> {
    bus: &'a Bus,
    node: &'a mut RosNode,
    tally: &'a Arc<Tally>,
    frames: Frames,
}

impl Teller<'_> {
    /// Publishes on `topic`, if there is one, what `made` makes of each of the vehicle's messages on `key`.
    fn tell<From, To>(
        &mut self,
        topic: Option<&str>,
        key: Key,
        made: impl Fn(&Frames, &From, &Clocks) -> Option<To> + Send + Sync + 'static,
    ) -> Result<()>
    where
        From: prost::Message + Default,
        To: Message + Serialize + 'static,
    {
        let Some(topic) = topic else { return Ok(()) };
        let publisher = self.node.publisher::<To>(topic)?;
        let (frames, tally) = (self.frames.clone(), Arc::clone(self.tally));
        self.bus.subscribe(key, move |payload, _| {
            let Ok(message) = From::decode(payload) else { return };
            if let Some(made) = made(&frames, &message, &Clocks::now()) {
                publisher.put(&made);
                tally.told();
            }
        })?;
        Ok(())
    }
}
