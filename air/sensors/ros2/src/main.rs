//! `goshawk-ros2`: the bridge's command line.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Parser;
use color_eyre::eyre::{Result, WrapErr};
use goshawk_ros2::bridge;
use goshawk_ros2::config::Config;

/// ROS 2 without ROS: hands images and odometry of rmw_zenoh's topics to the vehicle, and publishes what the vehicle
/// tells. Runs on the vehicle's computer, beside goshawk-air, until Ctrl-C.
#[derive(Parser)]
#[command(name = "goshawk-ros2", version, arg_required_else_help = true)]
#[command(after_help = "Examples:\n  goshawk-ros2 --config air/sensors/ros2/ros2.toml\n  \
    goshawk-ros2 --config ros2.toml --check\n\n\
    The router is ROS 2's own: ros2 run rmw_zenoh_cpp rmw_zenohd\n\
    docs/how-to/ros2.md has files for VINS-Fusion, OpenVINS and Isaac ROS Visual SLAM. RUST_LOG=debug shows more.")]
struct Arguments {
    /// The bridge's file: topics, frames, endpoints.
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Read and check the file, and do no more.
    #[arg(long)]
    check: bool,
}

fn main() -> ExitCode {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("info,zenoh=error,cdr_encoding=error"));
    tracing_subscriber::fmt().with_writer(std::io::stderr).with_env_filter(filter).init();
    match start(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("goshawk-ros2: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn start(arguments: &Arguments) -> Result<()> {
    let config = Config::load(&arguments.config)?;
    if arguments.check {
        println!("{} is good", arguments.config.display());
        return Ok(());
    }
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).wrap_err("cannot handle signals")?;
    }
    bridge::run(&config, &stop)
}
