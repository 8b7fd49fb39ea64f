//! How far a campaign is, and its end by a signal.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use color_eyre::eyre::{Result, WrapErr};
use indicatif::{ProgressBar, ProgressStyle};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use super::files::Files;
use crate::trial::Outcome;
use crate::vehicle::firmware::Process;

/// How far the campaign is.
pub(crate) struct Progress {
    pub(crate) bar: ProgressBar,
    total: usize,
    flown: Arc<AtomicUsize>,
    failed: AtomicUsize,
}

impl Progress {
    /// For so many flights.
    pub(crate) fn new(total: usize) -> Result<Self> {
        let style = ProgressStyle::with_template("{bar:40} {pos}/{len} flights, {msg}  {elapsed} (left {eta})")?;
        let bar = ProgressBar::new(total as u64).with_style(style).with_message("0 failed");
        Ok(Self { bar, total, flown: Arc::default(), failed: AtomicUsize::new(0) })
    }

    /// One more is flown.
    pub(crate) fn flown(&self, outcome: Outcome) {
        self.flown.fetch_add(1, Ordering::Relaxed);
        if outcome != Outcome::Success {
            let failed = self.failed.fetch_add(1, Ordering::Relaxed) + 1;
            self.bar.set_message(format!("{failed} failed"));
        }
        self.bar.inc(1);
    }

    /// From now on an interrupt ends the process at once, with nothing half-written left behind.
    pub(crate) fn end_on_signals(&self, files: &Files) -> Result<()> {
        let mut signals = Signals::new([SIGINT, SIGTERM]).wrap_err("cannot handle signals")?;
        let (files, bar, flown, total) = (files.clone(), self.bar.clone(), Arc::clone(&self.flown), self.total);
        std::thread::spawn(move || {
            if let Some(signal) = signals.forever().next() {
                let _none_begins = files.abandon();
                Process::end_all();
                bar.finish_and_clear();
                eprintln!("interrupted: {} of {total} flights were flown", flown.load(Ordering::Relaxed));
                // Without the exit handlers: flights are still running.
                signal_hook::low_level::exit(128 + signal);
            }
        });
        Ok(())
    }
}
