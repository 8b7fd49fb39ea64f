//! `goshawk-sim`: the simulator's command line.

use std::process::ExitCode;

use clap::Parser;
use goshawk_vehicle::errors::one_line;

fn main() -> ExitCode {
    match color_eyre::install().and_then(|()| goshawk_sim::cli::Cli::parse().run()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", one_line(error.as_ref()));
            ExitCode::FAILURE
        }
    }
}
