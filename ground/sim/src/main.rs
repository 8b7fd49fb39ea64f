//! `goshawk-sim`: the simulator's command line.

use clap::Parser;

fn main() -> color_eyre::Result<()> {
    color_eyre::install()?;
    goshawk_sim::cli::Cli::parse().run()
}
