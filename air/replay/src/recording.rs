//! A flight log as a replay reads it.

use std::path::Path;

use color_eyre::eyre::{Result, WrapErr, bail, eyre};
use goshawk_policy::Contract;
use goshawk_proto::keys::PROTOCOL;
use goshawk_proto::v1;
use goshawk_recorder::{Channel, Damage, LogReader};
use goshawk_vehicle::config::Vehicle;

/// An opened log with what its header says.
pub struct Recording {
    /// The log.
    pub log: LogReader,
    /// Its header.
    pub header: v1::LogHeader,
    /// The vehicle file that was flown with.
    pub vehicle: Vehicle,
    /// The policy's contract.
    pub contract: Contract,
    /// Stamps of the first and the last controller step, ns.
    pub span_ns: (u64, u64),
    /// Of the first record that moves: where the review's timeline begins, ns.
    pub begin_ns: u64,
}

impl Recording {
    /// Reads the log and its header.
    ///
    /// # Errors
    /// No log, or one that holds nothing to replay.
    pub fn open(path: &Path) -> Result<Self> {
        Self::of_log(LogReader::open(path)?)
    }

    /// Reads the header of an opened log.
    ///
    /// # Errors
    /// It holds nothing to replay.
    pub fn of_log(log: LogReader) -> Result<Self> {
        let path = log.path().to_owned();
        let name = path.display();
        let header: v1::LogHeader = log
            .entries()
            .find_map(|entry| entry.decode(Channel::HEADER))
            .ok_or_else(|| eyre!("{name} holds no header: it was cut off or damaged within its first half second"))?;
        if header.protocol != PROTOCOL {
            bail!(
                "{name} is of protocol {}, this software reads {PROTOCOL}: replay it with the version that flew ({})",
                header.protocol,
                header.version
            );
        }
        if header.policy_contract_json.is_empty() {
            bail!("{name} holds nothing to replay: no policy flew");
        }
        let contract = Contract::from_json(&header.policy_contract_json)
            .wrap_err_with(|| format!("the policy's contract in {name}"))?;
        let (text, tuning) = (header.vehicle_toml.clone(), header.tuning_toml.clone());
        let vehicle = Vehicle::parse(text, tuning, Path::new("the vehicle file in the log")).wrap_err_with(|| {
            format!("{name} was flown with other keys: replay it with the version that flew ({})", header.version)
        })?;
        let mut stamps = log
            .entries()
            .filter_map(|entry| entry.decode::<v1::ControllerInput>(Channel::CONTROLLER_INPUT))
            .map(|input| input.stamp_ns);
        let first = stamps.next().ok_or_else(|| {
            eyre!("{name} holds no controller inputs: an older version wrote it, or the classical pilot flew")
        })?;
        let last = stamps.last().unwrap_or(first);
        let moves = |topic: &str| topic != Channel::HEADER.topic && topic != Channel::WORLD.topic;
        let begin_ns = log.entries().filter(|e| moves(&e.topic)).map(|e| e.time_ns).min().unwrap_or(first);
        Ok(Recording { log, header, vehicle, contract, span_ns: (first, last), begin_ns })
    }

    /// What of the log cannot be read, a line each.
    #[must_use]
    pub fn damage(&self) -> Vec<String> {
        let at = |ns: u64| format!("{:.2} s", self.since_begin(ns));
        let line = |damage: &Damage| {
            let from = damage.after_ns.map_or_else(|| "the begin".to_owned(), at);
            let to = damage.before_ns.map_or_else(|| "the end".to_owned(), at);
            format!("{from} to {to}: damaged at byte {}", damage.bytes.start)
        };
        self.log.damage().iter().map(line).collect()
    }

    /// Length of the flight, s.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.span_ns.1.saturating_sub(self.span_ns.0) as f64 * 1e-9
    }

    /// From the log's begin to `stamp_ns`, s, as the review counts it.
    #[must_use]
    pub fn since_begin(&self, stamp_ns: u64) -> f64 {
        (i128::from(stamp_ns) - i128::from(self.begin_ns)) as f64 * 1e-9
    }

    /// The stamp at so many seconds of the review, ns.
    #[must_use]
    pub fn at(&self, seconds: f64) -> u64 {
        self.begin_ns.saturating_add((seconds * 1e9).round() as u64)
    }
}
