//! A policy on the log's images.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use color_eyre::eyre::{Result, bail, eyre};
use goshawk_core::{NetworkOutput, NetworkState, Planner, Time};
use goshawk_policy::{Policy, Preprocessor, Source};
use goshawk_proto::v1;
use goshawk_recorder::{Channel, Entry};
use serde::Serialize;

use super::choices::{Agreement, Choices};
use super::compare::{Count, Difference, first_field, keep_first};
use super::out::PlansLog;
use super::plans::Logged;
use super::{Outcome, Recording};

/// What another policy would have chosen.
#[derive(Clone, Debug, Serialize)]
pub struct Other {
    /// Its file.
    pub policy: PathBuf,
    /// Of its file.
    pub policy_sha256: String,
    /// With what was flown.
    #[serde(flatten)]
    pub agreement: Agreement,
}

/// Images wait here for the input that belongs to them.
const IMAGES: usize = 8;

/// A policy, and the log's last images.
pub(super) struct Seeing {
    pub(super) policy: Policy,
    preprocessor: Option<Preprocessor>,
    depth_rim_px: usize,
    images: VecDeque<v1::CompressedRgbd>,
}

impl Seeing {
    /// Loads a policy for the task that was flown.
    pub(super) fn load(path: &Path, recording: &Recording) -> Result<Self> {
        let policy = Policy::load(path, None, recording.vehicle.policy.threads)?;
        let (task, flown) = (policy.contract().model().task, recording.contract.model().task);
        if task != flown {
            bail!("it was trained to {task:?}, the flight was to {flown:?}: name a policy of the same task");
        }
        let depth_rim_px = recording.vehicle.camera.depth_rim_px;
        Ok(Seeing { policy, preprocessor: None, depth_rim_px, images: VecDeque::new() })
    }

    /// It is the policy that flew.
    pub(super) fn flew(&self, recording: &Recording) -> bool {
        self.policy.sha256() == recording.header.policy_sha256
    }

    /// Keeps the image, if the record is one.
    pub(super) fn keep(&mut self, entry: &Entry) {
        if let Some(image) = entry.decode::<v1::CompressedRgbd>(Channel::RGBD) {
            if self.images.len() == IMAGES {
                self.images.pop_front();
            }
            self.images.push_back(image);
        }
    }

    /// The image of that stamp is kept.
    pub(super) fn has(&self, stamp: Time) -> bool {
        self.images.iter().any(|image| image.stamp_ns == stamp.0)
    }

    /// What the policy answers to the image of that stamp.
    pub(super) fn answer(&mut self, stamp: Time, state: &NetworkState) -> Result<NetworkOutput> {
        let image = self.images.iter().find(|image| image.stamp_ns == stamp.0);
        let image = image.ok_or_else(|| eyre!("the log holds no image of {} ns", stamp.0))?;
        let (rgb, depth_mm) = goshawk_recorder::image::decompress(image)?;
        let source =
            Source { width: image.width, height: image.height, hfov_rad: image.hfov_rad, vfov_rad: image.vfov_rad };
        let preprocessor = match self.preprocessor.take().filter(|p| p.source() == source) {
            Some(fitting) => fitting,
            None => Preprocessor::new(self.policy.contract(), source)?.with_rim(self.depth_rim_px),
        };
        let prepared = self.preprocessor.insert(preprocessor).run(&rgb, &depth_mm)?;
        Ok(self.policy.infer(prepared, state)?)
    }
}

/// Runs a policy on the log's images: the one that flew must answer as it did; of another one, what it would have
/// chosen. Its plans go to `out`, at the logged plans' stamps.
pub(super) fn again(recording: &Recording, path: &Path, out: Option<&Path>, outcome: &mut Outcome) -> Result<()> {
    let mut seeing = Seeing::load(path, recording)?;
    let same_policy = seeing.flew(recording);
    let mut writer = out.map(|out| PlansLog::create(out, recording, Some(&seeing.policy), None)).transpose()?;
    let mut planner = Planner::new(recording.vehicle.planner_config(seeing.policy.contract().model()))?;
    let mut flown = Planner::new(recording.vehicle.planner_config(recording.contract.model()))?;
    let mut choices = Choices::default();
    let (mut network, mut begun) = (Count::default(), false);
    for entry in recording.log.entries() {
        seeing.keep(&entry);
        let Some(message) = entry.decode::<v1::PlannerInput>(Channel::PLANNER_INPUT) else { continue };
        let Some(logged) = Logged::of(&message) else { continue }; // which was told
        let stamp = logged.frame.odometry.stamp;
        let (asked, flown_asked) = (planner.see(&logged.frame), flown.see(&logged.frame));
        let Some(logged_network) = &logged.network else { continue };
        if !seeing.has(stamp) {
            // The first input's image may be of before the log was opened. What was seen is remembered all the same.
            if begun {
                outcome.missing.push(format!("the image of plan {}", message.seq));
            }
            let _ = flown_asked.answer(logged_network);
            if same_policy {
                let _ = asked.answer(logged_network);
            }
            continue;
        }
        begun = true;
        let answer = seeing.answer(stamp, asked.state())?;
        let plan = asked.answer(&answer);
        choices.count(&flown_asked.answer(logged_network), &plan);
        if same_policy {
            network.of += 1;
            let bits = |network: &NetworkOutput| network.values.map(f32::to_bits);
            if bits(&answer) == bits(logged_network) {
                network.same += 1;
            } else {
                let [field, logged, replayed] = first_field(logged_network, &answer);
                let (stamp_ns, at_s) = (entry.time_ns, recording.since_begin(entry.time_ns));
                let what = format!("network's answer for plan {}", plan.seq);
                keep_first(&mut outcome.first_difference, Difference { stamp_ns, at_s, what, field, logged, replayed });
            }
        }
        if let Some(writer) = &mut writer {
            writer.plan(Time(entry.time_ns), &plan)?;
        }
    }
    let agreement = choices.agreement();
    if agreement.frames == 0 {
        bail!("the log holds no image that belongs to a plan");
    }
    if same_policy {
        outcome.network = Some(network);
    } else {
        let policy_sha256 = seeing.policy.sha256().to_owned();
        outcome.other = Some(Other { policy: path.to_owned(), policy_sha256, agreement });
    }
    writer.map_or(Ok(()), PlansLog::finish)
}
