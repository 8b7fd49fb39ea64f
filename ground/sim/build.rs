//! Puts the SHA-256 of the flight code's sources into the binary: campaigns say by it what they were flown with.

use std::path::{Path, PathBuf};
use std::{env, fs, io};

use sha2::{Digest, Sha256};

/// What decides a flight besides policy and vehicle file, from the repository's root.
const FLIGHT_CODE: [&str; 5] =
    ["air/core/src", "air/policy/src", "air/vehicle/src", "ground/sim/src", "ground/sim/sensors"];
/// What of it does not, below `ground/sim/src`: the command line, what is made of flights that were flown, and firmware,
/// whose own program is not known by its hash either.
const NOT: [&str; 3] = ["commands", "main.rs", "vehicle/firmware/"];
/// But of the commands this one decides what is flown.
const BUT: &str = "commands/fly.rs";

fn files(folder: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            files(&path, found)?;
        } else {
            found.push(path);
        }
    }
    Ok(())
}

fn main() -> io::Result<()> {
    // As Cargo says now: a target folder may have been filled from another checkout.
    let package = env::var_os("CARGO_MANIFEST_DIR").ok_or(io::ErrorKind::NotFound)?;
    let root = Path::new(&package).join("../..");
    let mut found = Vec::new();
    for folder in FLIGHT_CODE {
        println!("cargo:rerun-if-changed={}", root.join(folder).display());
        files(&root.join(folder), &mut found)?;
    }
    let sources = root.join("ground/sim/src");
    found.retain(|path| {
        let below = path.strip_prefix(&sources).map(|name| name.to_string_lossy().replace('\\', "/"));
        !below.is_ok_and(|name| name != BUT && NOT.iter().any(|not| name.starts_with(not)))
    });
    found.sort();
    let mut hash = Sha256::new();
    for path in found {
        let contents = fs::read(&path)?;
        let name = path.strip_prefix(&root).unwrap_or(&path).to_string_lossy().replace('\\', "/");
        hash.update(format!("{name} {}\n", contents.len()));
        hash.update(contents);
    }
    let hex: String = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    println!("cargo:rustc-env=GOSHAWK_FLIGHT_CODE_SHA256={hex}");
    Ok(())
}
