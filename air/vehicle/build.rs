//! Puts the git revision into the binary, for the log's header.

use std::path::Path;
use std::process::Command;

/// What git prints; none: there is no git, or no repository.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}

fn main() {
    let revision = git(&["describe", "--always", "--dirty", "--abbrev=12"]).unwrap_or_else(|| "unknown".to_owned());
    println!("cargo:rustc-env=GOSHAWK_GIT_REVISION={revision}");
    println!("cargo:rerun-if-changed=build.rs");
    // Cargo takes a file that is not there for one that changes always; in a linked work tree it lies elsewhere.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]).filter(|log| Path::new(log).exists()) {
        println!("cargo:rerun-if-changed={log}");
    }
}
