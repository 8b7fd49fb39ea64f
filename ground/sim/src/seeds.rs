//! Which seeds are for what: three ranges that the tools keep apart, so that no figure of a table is of worlds that
//! something was trained or chosen on. `goshawk-sim seeds` prints them.

use std::fmt;
use std::fs::File;
use std::io::{self, Read};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use color_eyre::eyre::{Result, WrapErr};
use goshawk_vehicle::config::Vehicle;
use serde::Serialize;
use sha2::{Digest, Sha256};
use thiserror::Error;

/// Of data sets.
const TRAINING: RangeInclusive<u64> = 900_000..=999_999;
/// Of tables.
const TABLE: RangeInclusive<u64> = 10_000_000..=19_999_999;
/// SHA-256 of the flight code: the sources that decide a flight, as `build.rs` lists them, and the sensors' files.
const FLIGHT_CODE_SHA256: &str = env!("GOSHAWK_FLIGHT_CODE_SHA256");

/// What a seed is for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Seeds {
    /// Data sets.
    #[value(skip)]
    Training,
    /// Any choice of a number: all seeds that are in neither of the others.
    #[default]
    Tuning,
    /// Tables, on which nothing may be chosen.
    Table,
}

impl Seeds {
    /// What a seed is for.
    #[must_use]
    pub fn of(seed: u64) -> Self {
        match seed {
            seed if TRAINING.contains(&seed) => Self::Training,
            seed if TABLE.contains(&seed) => Self::Table,
            _ => Self::Tuning,
        }
    }

    /// A seed that is for this.
    ///
    /// # Errors
    /// It is for something else; the message says which to use.
    pub fn allow(self, seed: u64) -> Result<u64, WrongSeed> {
        let found = Self::of(seed);
        if found == self { Ok(seed) } else { Err(WrongSeed { seed, found, wanted: self }) }
    }

    fn instead(self) -> &'static str {
        if self == Self::Table { "; a table flies with --seeds table" } else { "" }
    }
}

impl fmt::Display for Seeds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let range = |range: &RangeInclusive<u64>| format!("{} to {}", range.start(), range.end());
        match self {
            Self::Training => write!(f, "training ({})", range(&TRAINING)),
            Self::Tuning => write!(f, "tuning (all other numbers, such as 1 to {})", TRAINING.start() - 1),
            Self::Table => write!(f, "tables ({})", range(&TABLE)),
        }
    }
}

/// A seed for something else.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("--seed {seed} is for {found}, and this needs one for {wanted}{}", .found.instead())]
pub struct WrongSeed {
    seed: u64,
    found: Seeds,
    wanted: Seeds,
}

/// What decides the flights of a table besides its options, as SHA-256.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Identity {
    /// The policy's file; none: nothing of it is flown.
    pub policy_sha256: Option<String>,
    /// The vehicle file with its tuning.
    pub vehicle_sha256: String,
    /// The flight code.
    pub flight_code_sha256: &'static str,
}

impl Identity {
    /// Of this program with a vehicle and a policy.
    #[must_use]
    pub fn new(vehicle: &Vehicle, policy_sha256: Option<String>) -> Self {
        let vehicle_sha256 = hex(format!("{}\0{}", vehicle.text, vehicle.tuning_text));
        Self { policy_sha256, vehicle_sha256, flight_code_sha256: FLIGHT_CODE_SHA256 }
    }

    /// The seed that a table has to fly with: nobody can choose it.
    #[must_use]
    pub fn table_seed(&self) -> u64 {
        let policy = self.policy_sha256.as_deref().unwrap_or_default();
        let digest = Sha256::digest(format!("{policy} {} {}", self.vehicle_sha256, self.flight_code_sha256));
        let number = digest.iter().take(8).fold(0, |number, byte| number << 8 | u64::from(*byte));
        TABLE.start() + number % (TABLE.end() - TABLE.start() + 1)
    }
}

/// SHA-256 of a file, however long it is.
pub(crate) fn sha256_of_file(path: &Path) -> io::Result<String> {
    let (mut file, mut hash, mut buffer) = (File::open(path)?, Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()),
            read => hash.update(&buffer[..read]),
        }
    }
}

fn hex(of: impl AsRef<[u8]>) -> String {
    Sha256::digest(of).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Print which seeds are for what, and which seed a table flies with.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  goshawk-sim seeds --policy air/models/navigate.onnx")]
pub struct SeedsArgs {
    /// The policy of the table; absent: the vehicle file's.
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
    /// The vehicle file of the table.
    #[arg(long, value_name = "FILE", default_value = "air/vehicles/sim.toml")]
    vehicle_file: PathBuf,
    /// Write the table's seed and the hashes that it comes of as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Serialize)]
struct Found<'a> {
    table_seed: u64,
    #[serde(flatten)]
    identity: &'a Identity,
}

impl SeedsArgs {
    /// Prints it.
    ///
    /// # Errors
    /// A file cannot be read, or the JSON not written.
    pub fn run(self) -> Result<()> {
        let vehicle = Vehicle::load(&self.vehicle_file)?;
        let model = self.policy.unwrap_or_else(|| vehicle.resolve(&vehicle.policy.model));
        let policy = std::fs::read(&model).wrap_err_with(|| format!("cannot read policy {}", model.display()))?;
        let identity = Identity::new(&vehicle, Some(hex(policy)));
        let table_seed = identity.table_seed();
        for (what, command) in [
            (Seeds::Training, "goshawk-sim dataset"),
            (Seeds::Tuning, "goshawk-sim fly, goshawk-sim faults"),
            (Seeds::Table, "goshawk-sim fly --seeds table, goshawk campaign"),
        ] {
            println!("{what}: {command}");
        }
        println!("table of {} and {}: {table_seed}", model.display(), self.vehicle_file.display());
        if let Some(path) = self.json {
            let text = serde_json::to_vec_pretty(&Found { table_seed, identity: &identity })?;
            std::fs::write(&path, text).wrap_err_with(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_seed_is_for_one_thing_and_refused_for_the_others_in_one_line_that_says_which_to_use() {
        let all = [Seeds::Training, Seeds::Tuning, Seeds::Table];
        for (seed, is_for) in [
            (0, Seeds::Tuning),
            (899_999, Seeds::Tuning),
            (900_000, Seeds::Training),
            (999_999, Seeds::Training),
            (1_000_000, Seeds::Tuning),
            (10_000_000, Seeds::Table),
            (19_999_999, Seeds::Table),
            (20_000_000, Seeds::Tuning),
        ] {
            assert_eq!(is_for.allow(seed), Ok(seed));
            for other in all.into_iter().filter(|other| *other != is_for) {
                let message = other.allow(seed).unwrap_err().to_string();
                assert!(message.contains(&format!("--seed {seed} is for {is_for}")) && !message.contains('\n'));
                assert!(message.contains(&format!("this needs one for {other}")), "{message}");
            }
        }
    }

    #[test]
    fn a_tables_seed_is_in_its_range_and_another_for_any_other_hash() {
        let plain = Identity { policy_sha256: Some("a".into()), vehicle_sha256: "b".into(), flight_code_sha256: "c" };
        let others = [
            Identity { policy_sha256: None, ..plain.clone() },
            Identity { vehicle_sha256: "d".into(), ..plain.clone() },
            Identity { flight_code_sha256: "d", ..plain.clone() },
        ];
        assert_eq!(plain.table_seed(), plain.clone().table_seed());
        for other in &others {
            assert_eq!(Seeds::of(other.table_seed()), Seeds::Table);
            assert_ne!(other.table_seed(), plain.table_seed());
        }
        assert_eq!(FLIGHT_CODE_SHA256.len(), 64);
    }
}
