//! The planner again: from the network's logged answers, or from the log's images through a policy.

use std::collections::{BTreeMap, VecDeque};
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use color_eyre::eyre::{Result, WrapErr, bail, eyre};
use goshawk_core::{FrameRecord, NetworkOutput, Plan, Planner, Time};
use goshawk_policy::{Policy, Preprocessor, Source};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_recorder::{Channel, Entry, LogWriter};
use goshawk_vehicle::convert;
use goshawk_vehicle::inputs::frame_record;
use prost::Message;
use serde::Serialize;

use super::compare::{Count, Difference, first_field, keep_first};
use super::{Outcome, Recording};

/// What another policy would have chosen.
#[derive(Clone, Debug, Serialize)]
pub struct Other {
    /// Its file.
    pub policy: PathBuf,
    /// Of its file.
    pub policy_sha256: String,
    /// Frames that both answered.
    pub frames: u64,
    /// Both chose the same trajectory, or both none.
    pub same: u64,
    /// Only one of the two chose.
    pub one_chose: u64,
    /// Distance between the ends of the two chosen trajectories, m; none: never did both choose.
    pub end_distance_m: Option<Quantiles>,
}

/// Of a distribution.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Quantiles {
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
}

fn key_channel(key: Key) -> Result<Channel> {
    Channel::of(key).ok_or_else(|| eyre!("the key table has no message for {key:?}"))
}

/// Makes each plan again from what the planner was given, and compares. Returns them by their sequence numbers.
pub(super) fn again(recording: &Recording, outcome: &mut Outcome) -> Result<BTreeMap<u64, Plan>> {
    let mut planner = Planner::new(recording.vehicle.planner_config(recording.contract.model()))?;
    let (plan_channel, target_channel) = (key_channel(Key::Plan)?, key_channel(Key::Target)?);
    let mut plans = BTreeMap::new();
    let mut last: Option<u64> = None;
    let first = &mut outcome.first_difference;
    for entry in recording.log.entries() {
        let mut differs = |what: String, [field, logged, replayed]: [String; 3]| {
            let (stamp_ns, at_s) = (entry.time_ns, recording.since_begin(entry.time_ns));
            keep_first(first, Difference { stamp_ns, at_s, what, field, logged, replayed });
        };
        if let Some(message) = entry.decode::<v1::PlannerInput>(Channel::PLANNER_INPUT) {
            let logged = whole(&message)?;
            let asked = planner.see(&logged.frame);
            let same = asked.state().len() == logged.state.len()
                && asked.state().iter().zip(logged.state.iter()).all(|(a, b)| a.to_bits() == b.to_bits());
            if !same {
                differs(format!("network state of plan {}", message.seq), first_field(&logged.state, asked.state()));
            }
            plans.insert(message.seq, asked.answer(&logged.network));
            last = Some(message.seq);
        } else if let Some(logged) = entry.decode::<v1::Plan>(plan_channel) {
            let Some(plan) = plans.get(&logged.seq) else {
                outcome.missing.push(format!("the input of plan {}", logged.seq));
                continue;
            };
            if let Some(field) = outcome.plans.compare(&logged, &convert::plan(plan, Time(logged.ready_ns))) {
                differs(format!("plan {}", logged.seq), field);
            }
        } else if let Some(logged) = entry.decode::<v1::Target>(target_channel) {
            let Some(plan) = last.and_then(|seq| plans.get(&seq)) else { continue };
            let replayed = plan.target.map(|target| convert::target(logged.seq, &target, plan.stamp));
            if let Some(field) = outcome.targets.compare(&logged, &replayed.unwrap_or_default()) {
                differs(format!("target after plan {}", plan.seq), field);
            }
        }
    }
    Ok(plans)
}

fn whole(message: &v1::PlannerInput) -> Result<FrameRecord> {
    frame_record(message).ok_or_else(|| eyre!("frame {}: input cut", message.seq))
}

/// Images wait here for the input that belongs to them.
const IMAGES: usize = 8;

struct Rerun<'a> {
    recording: &'a Recording,
    policy: Policy,
    preprocessor: Option<Preprocessor>,
    planner: Planner,
    images: VecDeque<v1::CompressedRgbd>,
}

impl Rerun<'_> {
    /// Takes images; of each planner's input whose image is there: the input, our network's answer, and our plan.
    fn take(&mut self, entry: &Entry) -> Result<Option<(FrameRecord, NetworkOutput, Plan)>> {
        if let Some(image) = entry.decode::<v1::CompressedRgbd>(Channel::RGBD) {
            if self.images.len() == IMAGES {
                self.images.pop_front();
            }
            self.images.push_back(image);
            return Ok(None);
        }
        let Some(message) = entry.decode::<v1::PlannerInput>(Channel::PLANNER_INPUT) else { return Ok(None) };
        let logged = whole(&message)?;
        let Some(image) = self.images.iter().find(|image| image.stamp_ns == logged.frame.odometry.stamp.0) else {
            return Ok(None);
        };
        let (rgb, depth_mm) = goshawk_recorder::image::decompress(image)?;
        let source =
            Source { width: image.width, height: image.height, hfov_rad: image.hfov_rad, vfov_rad: image.vfov_rad };
        let preprocessor = match self.preprocessor.take().filter(|p| p.source() == source) {
            Some(fitting) => fitting,
            None => {
                Preprocessor::new(self.policy.contract(), source)?.with_rim(self.recording.vehicle.camera.depth_rim_px)
            }
        };
        let prepared = self.preprocessor.insert(preprocessor).run(&rgb, &depth_mm)?;
        let asked = self.planner.see(&logged.frame);
        let network = self.policy.infer(prepared, asked.state())?;
        let plan = asked.answer(&network);
        Ok(Some((logged, network, plan)))
    }
}

/// Runs a policy on the log's images: the one that flew must answer as it did; of another one, what it would have
/// chosen. Its plans go to `out`, at the logged plans' stamps.
pub(super) fn with_policy(recording: &Recording, path: &Path, out: Option<&Path>, outcome: &mut Outcome) -> Result<()> {
    let policy = Policy::load(path, None, recording.vehicle.policy.threads)?;
    let (task, flown) = (policy.contract().model().task, recording.contract.model().task);
    if task != flown {
        bail!("it was trained to {task:?}, the flight was to {flown:?}: name a policy of the same task");
    }
    let same_policy = policy.sha256() == recording.header.policy_sha256;
    let mut writer = out.map(|out| OtherLog::create(out, recording, &policy)).transpose()?;
    let planner = Planner::new(recording.vehicle.planner_config(policy.contract().model()))?;
    let sha256 = policy.sha256().to_owned();
    let mut rerun = Rerun { recording, policy, preprocessor: None, planner, images: VecDeque::new() };
    let mut flown = Planner::new(recording.vehicle.planner_config(recording.contract.model()))?;
    let mut other = Choices::default();
    let mut network = Count::default();
    for entry in rerun.recording.log.entries() {
        let Some((logged, answer, plan)) = rerun.take(&entry)? else { continue };
        other.count(&flown.see(&logged.frame).answer(&logged.network), &plan);
        if same_policy {
            network.of += 1;
            let bits = |network: &NetworkOutput| network.values.map(f32::to_bits);
            if bits(&answer) == bits(&logged.network) {
                network.same += 1;
            } else {
                let [field, logged, replayed] = first_field(&logged.network, &answer);
                let (stamp_ns, at_s) = (entry.time_ns, recording.since_begin(entry.time_ns));
                let what = format!("network's answer for plan {}", plan.seq);
                keep_first(&mut outcome.first_difference, Difference { stamp_ns, at_s, what, field, logged, replayed });
            }
        }
        if let Some(writer) = &mut writer {
            writer.plan(Time(entry.time_ns), &plan)?;
        }
    }
    if other.frames == 0 {
        bail!("the log holds no image that belongs to a plan");
    }
    if same_policy {
        outcome.network = Some(network);
    } else {
        outcome.other = Some(other.summary(path.to_owned(), sha256));
    }
    writer.map_or(Ok(()), OtherLog::finish)
}

#[derive(Default)]
struct Choices {
    frames: u64,
    same: u64,
    one_chose: u64,
    distances_m: Vec<f64>,
}

impl Choices {
    fn count(&mut self, flown: &Plan, other: &Plan) {
        self.frames += 1;
        self.same += u64::from(flown.chosen == other.chosen);
        match (flown.chosen, other.chosen) {
            (Some(a), Some(b)) => {
                self.distances_m.push((flown.candidates[a].end.pos - other.candidates[b].end.pos).norm());
            }
            (None, None) => {}
            _ => self.one_chose += 1,
        }
    }

    fn summary(mut self, policy: PathBuf, policy_sha256: String) -> Other {
        self.distances_m.sort_by(f64::total_cmp);
        let held = self.distances_m.len();
        let at = |q: f64| self.distances_m[((held - 1) as f64 * q).round() as usize];
        let end_distance_m = (held > 0).then(|| Quantiles { p50: at(0.5), p95: at(0.95) });
        let Choices { frames, same, one_chose, .. } = self;
        Other { policy, policy_sha256, frames, same, one_chose, end_distance_m }
    }
}

/// The plans of another policy: a log with the same header but for the policy, and the same stamps.
struct OtherLog {
    path: PathBuf,
    writer: LogWriter<BufWriter<File>>,
}

impl OtherLog {
    fn create(path: &Path, recording: &Recording, policy: &Policy) -> Result<Self> {
        let name = || format!("cannot write {}", path.display());
        let file = OpenOptions::new().write(true).create_new(true).open(path).wrap_err_with(name)?;
        let mut writer = LogWriter::new(BufWriter::new(file)).wrap_err_with(name)?;
        let header = v1::LogHeader {
            policy_sha256: policy.sha256().to_owned(),
            policy_contract_json: policy.contract_json().to_owned(),
            ..recording.header.clone()
        };
        writer.write(Channel::HEADER, header.stamp_ns, &header.encode_to_vec()).wrap_err_with(name)?;
        Ok(OtherLog { path: path.to_owned(), writer })
    }

    fn plan(&mut self, ready: Time, plan: &Plan) -> Result<()> {
        let name = || format!("cannot write {}", self.path.display());
        let message = convert::plan(plan, ready).encode_to_vec();
        self.writer.write(key_channel(Key::Plan)?, ready.0, &message).wrap_err_with(name)?;
        if let Some(target) = &plan.target {
            let message = convert::target(plan.seq, target, plan.stamp).encode_to_vec();
            self.writer.write(key_channel(Key::Target)?, ready.0, &message).wrap_err_with(name)?;
        }
        Ok(())
    }

    fn finish(self) -> Result<()> {
        let OtherLog { path, writer } = self;
        let name = || format!("cannot write {}", path.display());
        writer.finish().wrap_err_with(name)?.flush().wrap_err_with(name)
    }
}
