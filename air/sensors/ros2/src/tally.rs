//! What was passed on and what was refused: a line for the first of a kind at once, and their number every so often.

use std::collections::HashMap;
use std::mem::{Discriminant, discriminant};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::images::lens::LensError;
use crate::images::picture::PictureError;
use crate::motion::MotionError;
use crate::wire::cdr::CdrError;
use crate::wire::clock::StampError;

/// Why a message is as if it had not come.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)]
pub enum Refused {
    #[error("{0}")]
    Cdr(#[from] CdrError),
    #[error("{0}")]
    Stamp(#[from] StampError),
    #[error("the camera {0}")]
    Lens(#[from] LensError),
    #[error("{0}")]
    Picture(#[from] PictureError),
    #[error("{0}")]
    Motion(#[from] MotionError),
    #[error("no camera_info came yet")]
    NoLens,
}

struct Line {
    since: u64,
    last: String,
}

/// The numbers.
#[derive(Default)]
pub struct Tally {
    images: AtomicU64,
    motions: AtomicU64,
    told: AtomicU64,
    untaken: AtomicU64,
    heard: Mutex<HashMap<&'static str, u64>>,
    refused: Mutex<HashMap<(&'static str, Discriminant<Refused>), Line>>,
}

/// What went through since the last report.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Images that the vehicle got.
    pub images: u64,
    /// Odometry samples that the vehicle got.
    pub motions: u64,
    /// Messages of the vehicle that ROS 2 got.
    pub told: u64,
    /// Images and samples that no vehicle listened for.
    pub untaken: u64,
    /// Messages that came on each topic, good or not.
    pub heard: HashMap<&'static str, u64>,
    /// One line a kind.
    pub refused: Vec<String>,
}

impl Tally {
    /// A message of `what` came.
    pub fn heard(&self, what: &'static str) {
        *self.heard.lock().unwrap_or_else(PoisonError::into_inner).entry(what).or_default() += 1;
    }

    /// No vehicle listens for what was to go there.
    pub fn untaken(&self) {
        self.untaken.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a message of `what`; the first of a kind is told.
    pub fn refuse(&self, what: &'static str, why: Refused) {
        let mut refused = self.refused.lock().unwrap_or_else(PoisonError::into_inner);
        let line = refused.entry((what, discriminant(&why))).or_insert_with(|| {
            tracing::warn!("{what} refused: {why}");
            Line { since: 0, last: String::new() }
        });
        line.since += 1;
        line.last = why.to_string();
    }

    /// An image went to the vehicle.
    pub fn image(&self) {
        self.images.fetch_add(1, Ordering::Relaxed);
    }

    /// An odometry sample went to the vehicle.
    pub fn motion(&self) {
        self.motions.fetch_add(1, Ordering::Relaxed);
    }

    /// A message went to ROS 2.
    pub fn told(&self) {
        self.told.fetch_add(1, Ordering::Relaxed);
    }

    /// What was counted since the last time that this was asked.
    pub fn take(&self) -> Report {
        let count = |counter: &AtomicU64| counter.swap(0, Ordering::Relaxed);
        let mut refused = self.refused.lock().unwrap_or_else(PoisonError::into_inner);
        let mut lines: Vec<String> = refused
            .iter()
            .filter(|(_, line)| line.since > 0)
            .map(|((what, _), line)| format!("{} × {what} refused: {}", line.since, line.last))
            .collect();
        refused.values_mut().for_each(|line| line.since = 0);
        lines.sort();
        let (images, motions, told, untaken) =
            (count(&self.images), count(&self.motions), count(&self.told), count(&self.untaken));
        let heard = std::mem::take(&mut *self.heard.lock().unwrap_or_else(PoisonError::into_inner));
        Report { images, motions, told, untaken, heard, refused: lines }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thousand_of_a_kind_are_one_line() {
        let tally = Tally::default();
        for bytes in 0..1000 {
            tally.refuse("colour", CdrError::Short(bytes).into());
        }
        tally.refuse("depth", Refused::NoLens);
        tally.image();
        tally.heard("colour");
        tally.untaken();
        let report = tally.take();
        assert_eq!(
            report.refused,
            ["1 × depth refused: no camera_info came yet", "1000 × colour refused: 999 bytes are no CDR message"]
        );
        assert_eq!((report.images, report.motions, report.untaken), (1, 0, 1));
        assert_eq!(report.heard.get("colour"), Some(&1));
        assert_eq!(tally.take(), Report::default());
    }
}
