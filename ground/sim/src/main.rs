//! `goshawk-sim`: the simulator's command line.

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Parser;
use color_eyre::eyre::Result;
use goshawk_sim::commands::{Cli, Command};
use goshawk_vehicle::errors::one_line;
use signal_hook::consts::SIGPIPE;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", one_line(error.as_ref()));
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<()> {
    color_eyre::install()?;
    let cli = Cli::parse();
    // Who reads what is printed may have seen enough, as `head`: that ends this program, as it ends others. But a
    // vehicle that hangs up must not end `serve`.
    if !matches!(cli.command, Command::Serve(_)) {
        signal_hook::flag::register_conditional_default(SIGPIPE, Arc::new(AtomicBool::new(true)))?;
    }
    cli.run()
}
