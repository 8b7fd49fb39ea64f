//! A log of what would have been decided otherwise.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use color_eyre::eyre::{Result, WrapErr};
use goshawk_core::{Plan, Time};
use goshawk_policy::Policy;
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_recorder::{Channel, LogWriter};
use goshawk_vehicle::convert;
use prost::Message;

use super::Recording;
use super::plans::key_channel;

/// The flight's header but for what is altered, then plans at the stamps of those that were flown. One that is not
/// finished leaves no file.
pub(super) struct PlansLog {
    file: Made,
    writer: LogWriter<BufWriter<File>>,
}

/// A file of ours, which goes again unless it is finished.
struct Made {
    path: PathBuf,
    finished: bool,
}

impl Drop for Made {
    fn drop(&mut self) {
        if !self.finished {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

impl PlansLog {
    /// `policy` and `tuning` are what is altered.
    pub(super) fn create(
        path: &Path,
        recording: &Recording,
        policy: Option<&Policy>,
        tuning: Option<&str>,
    ) -> Result<Self> {
        let name = || format!("cannot write {}", path.display());
        let file = OpenOptions::new().write(true).create_new(true).open(path).wrap_err_with(name)?;
        let made = Made { path: path.to_owned(), finished: false };
        let mut writer = LogWriter::new(BufWriter::new(file)).wrap_err_with(name)?;
        let mut header = recording.header.clone();
        if let Some(policy) = policy {
            policy.sha256().clone_into(&mut header.policy_sha256);
            policy.contract_json().clone_into(&mut header.policy_contract_json);
        }
        if let Some(tuning) = tuning {
            tuning.clone_into(&mut header.tuning_toml);
        }
        writer.write(Channel::HEADER, header.stamp_ns, &header.encode_to_vec()).wrap_err_with(name)?;
        Ok(PlansLog { file: made, writer })
    }

    pub(super) fn plan(&mut self, ready: Time, plan: &Plan) -> Result<()> {
        self.write(Key::Plan, ready, &convert::plan(plan, ready))?;
        match convert::target(plan.seq, plan) {
            Some(target) => self.write(Key::Target, ready, &target),
            None => Ok(()),
        }
    }

    pub(super) fn control(&mut self, control: &v1::Control) -> Result<()> {
        self.write(Key::Control, Time(control.stamp_ns), control)
    }

    fn write(&mut self, key: Key, stamp: Time, message: &impl Message) -> Result<()> {
        self.writer
            .write(key_channel(key)?, stamp.0, &message.encode_to_vec())
            .wrap_err_with(|| format!("cannot write {}", self.file.path.display()))
    }

    pub(super) fn finish(self) -> Result<()> {
        let PlansLog { mut file, writer } = self;
        let name = || format!("cannot write {}", file.path.display());
        writer.finish().wrap_err_with(name)?.flush().wrap_err_with(name)?;
        file.finished = true;
        Ok(())
    }
}
