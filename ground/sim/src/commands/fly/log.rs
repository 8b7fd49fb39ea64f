//! A lockstep flight's log: the same MCAP file as the vehicle writes, with the simulator's truth in it.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use goshawk_core::{ControllerOutput, FrameRecord, Plan, Time};
use goshawk_policy::Policy;
use goshawk_proto::keys::{Key, PROTOCOL};
use goshawk_proto::v1;
use goshawk_recorder::{Channel, LogWriter};
use goshawk_vehicle::config::Vehicle;
use goshawk_vehicle::{convert, inputs};
use prost::Message;

use super::files::{Files, Unfinished};
use super::report::{contact_name, outcome_name};
use crate::render::Camera;
use crate::sense::rgbd::RgbdImage;
use crate::trial::{Contact, Outcome, Pilot, Truth, Witness};
use crate::world::World;

/// The log cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write the flight log {}: {cause}", path.display())]
pub struct LogError {
    path: PathBuf,
    cause: String,
}

/// As on board, s.
const MAP_PERIOD_S: f64 = 1.0;

/// Writes one flight.
pub struct FlightLog {
    path: PathBuf,
    unfinished: Unfinished,
    camera: Camera,
    writer: LogWriter<BufWriter<File>>,
    failure: Option<String>,
    controls: u64,
    odometry: Option<Time>,
    imu: Option<Time>,
    /// Obstacle maps, and when the last one was written.
    maps: u64,
    mapped: Time,
}

/// The header of a campaign's logs: vehicle file and, if one flies, policy.
#[must_use]
pub fn header(vehicle: &Vehicle, policy: Option<&Policy>) -> v1::LogHeader {
    v1::LogHeader {
        vehicle: vehicle.name.clone(),
        vehicle_toml: vehicle.text.clone(),
        tuning_toml: vehicle.tuning_text.clone(),
        policy_sha256: policy.map(Policy::sha256).unwrap_or_default().to_owned(),
        policy_contract_json: policy.map(Policy::contract_json).unwrap_or_default().to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        protocol: PROTOCOL,
        ..Default::default()
    }
}

/// That there is no such file yet.
///
/// # Errors
/// There is.
pub fn check_new(path: &Path) -> Result<(), LogError> {
    let cause = || "there is one already: give another --log, or remove it".to_owned();
    if path.exists() { Err(LogError { path: path.to_owned(), cause: cause() }) } else { Ok(()) }
}

impl FlightLog {
    /// Begins a file, which has its name once it is finished; one of that name is never overwritten.
    ///
    /// # Errors
    /// It exists, or cannot be created.
    pub fn create(path: &Path, camera: Camera, header: &v1::LogHeader, files: &Files) -> Result<Self, LogError> {
        let error = |cause: String| LogError { path: path.to_owned(), cause };
        check_new(path)?;
        let (file, unfinished) = files.begin(path).map_err(|e| error(e.to_string()))?;
        let writer = LogWriter::new(BufWriter::new(file)).map_err(|e| error(e.to_string()))?;
        let mut log = Self {
            path: path.to_owned(),
            unfinished,
            camera,
            writer,
            failure: None,
            controls: 0,
            odometry: None,
            imu: None,
            maps: 0,
            mapped: Time(0),
        };
        log.write(Channel::HEADER, Time(0), header);
        Ok(log)
    }

    /// Ends the file.
    ///
    /// # Errors
    /// Anything of it could not be written.
    pub fn finish(self) -> Result<(), LogError> {
        let Self { path, unfinished, writer, failure, .. } = self;
        let ended = writer.finish().map_err(|e| e.to_string()).and_then(|mut w| w.flush().map_err(|e| e.to_string()));
        let named = failure.map_or(ended, Err).and_then(|()| unfinished.finish().map_err(|e| e.to_string()));
        match named {
            Ok(()) => Ok(()),
            Err(cause) => Err(LogError { path, cause }),
        }
    }

    fn write(&mut self, channel: Channel, stamp: Time, message: &impl Message) {
        if self.failure.is_none() {
            self.failure = self.writer.write(channel, stamp.0, &message.encode_to_vec()).err().map(|e| e.to_string());
        }
    }

    fn tell(&mut self, key: Key, stamp: Time, message: &impl Message) {
        if let Some(channel) = Channel::of(key) {
            self.write(channel, stamp, message);
        }
    }
}

impl Witness for FlightLog {
    fn world(&mut self, world: &World) {
        self.write(Channel::WORLD, Time(0), &world.to_proto());
    }

    fn control(&mut self, now: Time, output: &ControllerOutput, onboard: &dyn Pilot) {
        self.controls += 1;
        let odometry = onboard.odometry();
        if let Some(fresh) = odometry.filter(|o| self.odometry != Some(o.stamp)) {
            self.odometry = Some(fresh.stamp);
            self.write(Channel::ODOMETRY, now, &convert::odometry(self.controls, fresh));
        }
        let imu = onboard.step_input().and_then(|input| input.imu);
        if let Some(fresh) = imu.filter(|imu| self.imu != Some(imu.stamp)) {
            self.imu = Some(fresh.stamp);
            self.write(Channel::IMU, now, &inputs::imu(&fresh));
        }
        if let Some(input) = onboard.step_input() {
            self.write(Channel::CONTROLLER_INPUT, now, &inputs::controller_input(input, self.controls, now));
        }
        self.tell(Key::Control, now, &convert::control(self.controls, now, output, odometry));
        if now.since(self.mapped) >= MAP_PERIOD_S
            && let Some(map) = onboard.obstacle_map(self.maps, now)
        {
            (self.maps, self.mapped) = (self.maps + 1, now);
            self.tell(Key::Map, now, &map);
        }
        if let Some(t) = output.transition {
            let event = v1::Event {
                stamp_ns: now.0,
                severity: v1::Severity::Info.into(),
                kind: "mode".to_owned(),
                text: format!("{:?} → {:?}: {}", t.from, t.to, t.cause),
                ..Default::default()
            };
            self.tell(Key::Event, now, &event);
        }
    }

    fn frame(&mut self, seq: u64, stamp: Time, image: &RgbdImage) {
        let (width, height) = (image.width as u32, image.height as u32);
        match goshawk_recorder::image::compress(&image.rgb, &image.depth_mm, width, height) {
            Ok(message) => {
                let message = v1::CompressedRgbd {
                    seq,
                    stamp_ns: stamp.0,
                    hfov_rad: self.camera.hfov_rad,
                    vfov_rad: self.camera.vfov_rad(),
                    ..message
                };
                self.write(Channel::RGBD, stamp, &message);
            }
            Err(error) => self.failure = Some(error.to_string()),
        }
    }

    fn plan(&mut self, ready: Time, plan: &Plan, record: Option<&FrameRecord>) {
        if let Some(record) = record {
            self.write(Channel::PLANNER_INPUT, ready, &inputs::planner_input(record));
        }
        self.tell(Key::Plan, ready, &convert::plan(plan, ready));
        if let Some(target) = convert::target(plan.seq, plan) {
            self.tell(Key::Target, ready, &target);
        }
    }

    fn truth(&mut self, now: Time, truth: &Truth<'_>) {
        self.tell(Key::SimTruth, now, &truth.to_proto(now));
    }

    fn verdict(&mut self, now: Time, outcome: Outcome, contact: Option<Contact>) {
        let severity = if outcome == Outcome::Success { v1::Severity::Info } else { v1::Severity::Error };
        let touched = contact.map_or_else(String::new, |what| format!(" ({})", contact_name(what)));
        let event = v1::Event {
            stamp_ns: now.0,
            severity: severity.into(),
            kind: "trial".to_owned(),
            text: format!("{}{touched}", outcome_name(outcome)),
            ..Default::default()
        };
        self.tell(Key::Event, now, &event);
    }
}
