//! `goshawk-sim`: the simulator's command line.

use std::process::ExitCode;

use clap::Parser;
use color_eyre::eyre::Report;

fn main() -> ExitCode {
    match color_eyre::install().and_then(|()| goshawk_sim::cli::Cli::parse().run()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", one_line(&error));
            ExitCode::FAILURE
        }
    }
}

/// The error and its causes, each said once: some messages hold their cause already.
fn one_line(error: &Report) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |line, cause| match line.as_str() {
        "" => cause,
        said if said.contains(&cause) => line,
        said => format!("{said}: {cause}"),
    })
}
