//! The log of the current flight: opened at an accepted start, finished shortly after the landing. Whatever waits for the
//! disk does so on a thread of its own: a disk that hangs must not silence the vehicle.

use std::path::PathBuf;
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, SystemTime};

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
/// A log that is not finished after this waits for a disk that hangs, s. Chosen by eye.
const HANGS_S: f64 = 2.0;
/// And when the process ends, after this, all logs together, s: it must fit into what a service manager waits (10 s).
const LAST_WAIT_S: f64 = 6.0;

/// A log of a flight that is over, being finished.
struct Finishing {
    recorder: Recorder,
    since: Time,
    /// That it failed was told.
    failed: bool,
    /// That it hangs was told.
    hangs: bool,
}

/// Opens, fills and finishes one file a flight.
pub struct FlightLog {
    directory: PathBuf,
    header: v1::LogHeader,
    contract: Arc<Contract>,
    keep_bytes: u64,
    /// A flight is under way, recorded or not.
    under_way: bool,
    recorder: Option<Recorder>,
    finishing: Vec<Finishing>,
    /// Tries whether the disk takes a log again.
    room: Option<JoinHandle<Result<(), String>>>,
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
            under_way: false,
            recorder: None,
            finishing: Vec::new(),
            room: None,
            finish_at: None,
            failed: false,
            dropped_before: 0,
        }
    }

    /// Begins a new file, finishing the one before. What keeps it from being written, [`Self::poll`] tells.
    ///
    /// # Errors
    /// Why it cannot even be begun; the flight goes on without.
    pub fn open(&mut self, profile: &str) -> Result<(), String> {
        let stamp = clock::now();
        self.finish(stamp);
        (self.under_way, self.failed) = (true, false);
        let wall_time = humantime::format_rfc3339_millis(SystemTime::now()).to_string();
        let name = format!("{}-{}.mcap", self.header.vehicle, wall_time.replace([':', '.'], ""));
        let path = self.directory.join(name);
        tracing::info!("recording to {}", path.display());
        let (folder, prefix, keep) = (self.directory.clone(), format!("{}-", self.header.vehicle), self.keep_bytes);
        let make_room = move || {
            for gone in goshawk_recorder::rotate(&folder, &prefix, keep) {
                tracing::info!("removed {} to make room", gone.display());
            }
        };
        self.recorder = Some(Recorder::begin(&path, make_room).map_err(|e| e.to_string())?);
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
        // Readiness that comes and goes does not put it off.
        self.finish_at.get_or_insert(now.plus(TAIL_S));
    }

    /// Has a due file finished; returns why the recording failed, once.
    pub fn poll(&mut self, now: Time) -> Option<String> {
        if self.finish_at.is_some_and(|at| now >= at) {
            self.finish(now);
        }
        let mut failure = self.recorder.as_ref().and_then(Recorder::failure);
        if failure.is_some() && std::mem::replace(&mut self.failed, true) {
            failure = None;
        }
        for Finishing { recorder, failed, .. } in self.finishing.extract_if(.., |log| log.recorder.is_finished()) {
            self.dropped_before += recorder.dropped();
            match recorder.failure() {
                None => tracing::info!("log finished: {}", recorder.path().display()),
                why if !failed => failure = why,
                Some(_) => {}
            }
        }
        failure
    }

    /// The disk does not let a log be finished: why no other one should be begun, once for each.
    pub fn hangs(&mut self, now: Time) -> Option<String> {
        let log = self.finishing.iter_mut().find(|log| !log.hangs && now.since(log.since) > HANGS_S)?;
        log.hangs = true;
        Some(format!("the disk hangs: {} is not finished", log.recorder.path().display()))
    }

    /// The flight is over: its file is finished, which nobody waits for.
    fn finish(&mut self, now: Time) {
        self.finish_at = None;
        self.under_way = false;
        if let Some(mut recorder) = self.recorder.take() {
            recorder.finish();
            self.finishing.push(Finishing { recorder, since: now, failed: self.failed, hangs: false });
        }
    }

    /// The process ends: waits a little until all files are finished.
    pub fn close(&mut self) {
        let now = clock::now();
        self.finish(now);
        for Finishing { mut recorder, .. } in self.finishing.drain(..) {
            let left = (LAST_WAIT_S - clock::now().since(now)).max(0.0);
            let finished = recorder.close_within(Duration::from_secs_f64(left));
            let path = recorder.path().display();
            match recorder.failure() {
                _ if !finished => tracing::error!("the disk hangs: {path} is not finished"),
                Some(why) => tracing::error!("recording stopped: {why}"),
                None => tracing::info!("log finished: {path}"),
            }
        }
    }

    /// Between flights: tries whether the next one can be recorded. None: it is being tried, or a log is not finished yet.
    pub fn has_room(&mut self) -> Option<Result<(), String>> {
        if self.room.as_ref().is_some_and(JoinHandle::is_finished) {
            let panicked = |_| Err("the disk could not be tried".to_owned());
            return self.room.take().map(|trial| trial.join().unwrap_or_else(panicked));
        }
        if self.room.is_none() && self.finishing.is_empty() {
            let folder = self.directory.clone();
            let trial = thread::Builder::new().name("room".to_owned());
            self.room = trial.spawn(move || goshawk_recorder::has_room(&folder)).ok();
        }
        None
    }

    /// A flight is under way, recorded or not.
    #[must_use]
    pub fn under_way(&self) -> bool {
        self.under_way
    }

    /// The file being written; empty where there is none.
    #[must_use]
    pub fn path(&self) -> String {
        let open = self.recorder.as_ref().filter(|recorder| recorder.is_open());
        open.map_or(String::new(), |recorder| recorder.path().display().to_string())
    }

    /// Records dropped since the process began.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        let finishing = self.finishing.iter().map(|log| log.recorder.dropped()).sum::<u64>();
        self.dropped_before + finishing + self.recorder.as_ref().map_or(0, Recorder::dropped)
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
