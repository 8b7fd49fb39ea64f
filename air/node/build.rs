//! Puts the git revision into the binary, for the log's header.

use std::process::Command;

fn main() {
    let output = Command::new("git").args(["describe", "--always", "--dirty", "--abbrev=12"]).output();
    let revision = output
        .ok()
        .filter(|output| output.status.success())
        .and_then(|output| String::from_utf8(output.stdout).ok())
        .map_or_else(|| "unknown".to_owned(), |text| text.trim().to_owned());
    println!("cargo:rustc-env=GOSHAWK_GIT_REVISION={revision}");
    println!("cargo:rerun-if-changed=../../.git/logs/HEAD");
}
