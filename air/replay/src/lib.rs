//! Runs planner and controller again on what a log says that they were given, and compares what they answer with what
//! they answered then, bit for bit. With another policy: what that one would have chosen on the same images. Altered from
//! an instant on: what the planner would have chosen then.

mod alter;
mod choices;
mod compare;
mod controls;
mod out;
mod plans;
mod policy;
mod recording;
mod table;

use std::path::{Path, PathBuf};

use color_eyre::eyre::{Result, WrapErr};
use serde::Serialize;

pub use alter::{Alteration, Altered, Choice, alter};
pub use choices::{Agreement, Quantiles};
pub use compare::{Count, Difference};
pub use policy::Other;
pub use recording::Recording;
pub use table::{print, print_altered};

/// What to replay with.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The policy to run on the log's images; none: the network's logged answers are taken as they are.
    pub policy: Option<PathBuf>,
    /// Where the plans of that policy go: a log of their own.
    pub out: Option<PathBuf>,
}

/// What a replay found.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// The log.
    pub log: PathBuf,
    /// What recorded it: version and revision.
    pub recorded_by: String,
    /// What replays it.
    pub replayed_by: String,
    /// Length of the flight, s.
    pub seconds: f64,
    /// Plans made again.
    pub plans: Count,
    /// The target filter after each plan.
    pub targets: Count,
    /// Controller steps made again.
    pub controls: Count,
    /// The network's answers; none: it was not run, or it is another policy's.
    pub network: Option<Count>,
    /// The first difference in the flight's time.
    pub first_difference: Option<Difference>,
    /// What of the log is damaged and was left out, in the flight's time; what follows may differ for want of it.
    pub damaged: Vec<String>,
    /// What should be in the log and is not, so that what follows it may differ for want of it.
    pub missing: Vec<String>,
    /// What another policy would have chosen.
    pub other: Option<Other>,
}

impl Outcome {
    /// The log is whole and nothing differs.
    #[must_use]
    pub fn same(&self) -> bool {
        self.first_difference.is_none() && self.missing.is_empty() && self.damaged.is_empty()
    }
}

/// Replays the log.
///
/// # Errors
/// It cannot be read, holds nothing to replay, or the policy cannot be run on it.
pub fn replay(log: &Path, options: &Options) -> Result<Outcome> {
    replay_recording(&Recording::open(log)?, options)
}

/// Replays a log that is open already.
///
/// # Errors
/// It holds nothing to replay, or the policy cannot be run on it.
pub fn replay_recording(recording: &Recording, options: &Options) -> Result<Outcome> {
    let log = recording.log.path();
    let mut outcome = Outcome {
        log: log.to_owned(),
        recorded_by: by(&recording.header.version, &recording.header.git_revision),
        replayed_by: by(env!("CARGO_PKG_VERSION"), goshawk_vehicle::REVISION),
        seconds: recording.seconds(),
        plans: Count::default(),
        targets: Count::default(),
        controls: Count::default(),
        network: None,
        first_difference: None,
        damaged: recording.damage(),
        missing: Vec::new(),
        other: None,
    };
    let plans = plans::again(recording, &mut outcome)?;
    controls::again(recording, &plans, &mut outcome)?;
    if let Some(policy) = &options.policy {
        policy::again(recording, policy, options.out.as_deref(), &mut outcome)
            .wrap_err_with(|| format!("cannot run {} on {}", policy.display(), log.display()))?;
    }
    Ok(outcome)
}

fn by(version: &str, revision: &str) -> String {
    if revision.is_empty() { version.to_owned() } else { format!("{version} ({revision})") }
}
