//! The log of the current flight: opened at an accepted start, finished shortly after the landing.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::SystemTime;

use goshawk_core::Time;
use goshawk_policy::{Contract, Policy, Preprocessor};
use goshawk_proto::keys::{Key, PROTOCOL};
use goshawk_proto::v1;
use goshawk_recorder::{Channel, Recorder};
use goshawk_vehicle::clock;
use goshawk_vehicle::config::Vehicle;
use goshawk_vehicle::sensors::Frame;
use prost::Message;

/// How long to go on recording after the landing, s. Chosen by eye.
const TAIL_S: f64 = 1.0;

/// Opens, fills and finishes one file a flight.
pub struct FlightLog {
    directory: PathBuf,
    header: v1::LogHeader,
    contract: Arc<Contract>,
    keep_bytes: u64,
    recorder: Option<Recorder>,
    finish_at: Option<Time>,
    failed: bool,
    dropped_before: u64,
}

impl FlightLog {
    /// Files go to `directory`.
    #[must_use]
    pub fn new(directory: PathBuf, vehicle: &Vehicle, policy: &Policy) -> Self {
        let header = v1::LogHeader {
            vehicle: vehicle.name.clone(),
            vehicle_toml: vehicle.text.clone(),
            tuning_toml: vehicle.tuning_text.clone(),
            policy_sha256: policy.sha256().to_owned(),
            policy_contract_json: policy.contract_json().to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            git_revision: goshawk_vehicle::REVISION.to_owned(),
            protocol: PROTOCOL,
            ..Default::default()
        };
        let contract = Arc::new(policy.contract().clone());
        FlightLog {
            directory,
            header,
            contract,
            keep_bytes: (vehicle.recorder.keep_mb * 1e6) as u64,
            recorder: None,
            finish_at: None,
            failed: false,
            dropped_before: 0,
        }
    }

    /// Begins a new file, finishing the one before.
    ///
    /// # Errors
    /// Why it cannot be written; the flight goes on without.
    pub fn open(&mut self, profile: &str) -> Result<(), String> {
        self.close();
        self.failed = false;
        for gone in goshawk_recorder::rotate(&self.directory, &format!("{}-", self.header.vehicle), self.keep_bytes) {
            tracing::info!("removed {} to make room", gone.display());
        }
        let wall_time = humantime::format_rfc3339_millis(SystemTime::now()).to_string();
        let name = format!("{}-{}.mcap", self.header.vehicle, wall_time.replace([':', '.'], ""));
        let recorder = Recorder::create(&self.directory.join(name)).map_err(|e| e.to_string())?;
        tracing::info!("recording to {}", recorder.path().display());
        self.recorder = Some(recorder);
        let stamp = clock::now();
        let header = v1::LogHeader { wall_time, stamp_ns: stamp.0, profile: profile.to_owned(), ..self.header.clone() };
        self.record_on(Channel::HEADER, stamp, header);
        Ok(())
    }

    /// Records a telemetry message under its key's suffix. Nothing happens between flights.
    pub fn record(&self, key: Key, stamp: Time, message: impl Message + 'static) {
        if let Some(channel) = Channel::of(key) {
            self.record_on(channel, stamp, message);
        }
    }

    /// Records a message on a channel of the log alone.
    pub fn record_on(&self, channel: Channel, stamp: Time, message: impl Message + 'static) {
        if let Some(recorder) = &self.recorder {
            recorder.record(channel, stamp.0, Box::new(move || Some(message.encode_to_vec())));
        }
    }

    /// Records an image at the network's size; the recorder's thread makes it.
    pub fn record_frame(&self, frame: &Arc<Frame>) {
        let Some(recorder) = &self.recorder else { return };
        let (stamp, frame, contract) = (frame.stamp, Arc::clone(frame), Arc::clone(&self.contract));
        let encode = move || Some(compressed(&frame, &contract)?.encode_to_vec());
        recorder.record(Channel::RGBD, stamp.0, Box::new(encode));
    }

    /// The flight is over: finish the file a moment later.
    pub fn finish_soon(&mut self, now: Time) {
        self.finish_at = Some(now.plus(TAIL_S));
    }

    /// Finishes a due file; returns why the recording failed, once.
    pub fn poll(&mut self, now: Time) -> Option<String> {
        if self.finish_at.is_some_and(|at| now >= at) {
            self.close();
        }
        let failure = self.recorder.as_ref().and_then(Recorder::failure)?;
        (!std::mem::replace(&mut self.failed, true)).then_some(failure)
    }

    /// Finishes the file, if one is open.
    pub fn close(&mut self) {
        self.finish_at = None;
        if let Some(mut recorder) = self.recorder.take() {
            self.dropped_before += recorder.dropped();
            recorder.close();
            tracing::info!("log finished: {}", recorder.path().display());
        }
    }

    /// Between flights: whether the next one can be recorded. Waits for the disk.
    ///
    /// # Errors
    /// Why it cannot.
    pub fn has_room(&self) -> Result<(), String> {
        goshawk_recorder::has_room(&self.directory)
    }

    /// A file is open.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.recorder.is_some()
    }

    /// The file being written; empty between flights.
    #[must_use]
    pub fn path(&self) -> String {
        self.recorder.as_ref().map_or(String::new(), |recorder| recorder.path().display().to_string())
    }

    /// Records dropped since the process began.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped_before + self.recorder.as_ref().map_or(0, Recorder::dropped)
    }
}

/// The image as the network sees it, without loss; none: it cannot be made one.
fn compressed(frame: &Frame, contract: &Contract) -> Option<v1::CompressedRgbd> {
    let (width, height) = (contract.image.width, contract.image.height);
    let small;
    let (rgb, depth_mm): (&[u8], &[u16]) = if (frame.width, frame.height) == (width, height) {
        (&frame.rgb, &frame.depth_mm)
    } else {
        small = Preprocessor::new(contract, frame.source()).ok()?.at_network_size(&frame.rgb, &frame.depth_mm).ok()?;
        (&small.0, &small.1)
    };
    let message = goshawk_recorder::image::compress(rgb, depth_mm, width as u32, height as u32).ok()?;
    Some(v1::CompressedRgbd {
        seq: frame.seq,
        stamp_ns: frame.stamp.0,
        hfov_rad: frame.hfov,
        vfov_rad: frame.vfov,
        ..message
    })
}
