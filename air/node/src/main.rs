//! `goshawk-air`: the onboard process.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use color_eyre::eyre::{Result, WrapErr, eyre};
use goshawk_air::check;
use goshawk_air::network::visitors::Visitors;
use goshawk_air::run::{Overrides, run};
use goshawk_vehicle::config::{Vehicle, reference};
use goshawk_vehicle::errors::one_line;
use tracing_appender::non_blocking::NonBlockingBuilder;
use tracing_subscriber::Layer as _;
use tracing_subscriber::filter::filter_fn;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

/// The onboard process: chases what its camera sees, obeys start and stop, writes the flight's log.
#[derive(Parser)]
#[command(name = "goshawk-air", version, arg_required_else_help = true)]
#[command(after_help = "Examples:\n  goshawk-air run --config air/vehicles/sim.toml\n  \
    goshawk-air run --config air/vehicles/sim.toml --listen tcp/127.0.0.1:7448 --mavlink-bind 127.0.0.1:14541\n  \
    goshawk-air check --config air/vehicles/sim.toml\n  \
    goshawk-air check --frames --config vehicle.toml\n  \
    goshawk-air replay logs/flight.mcap\n  \
    goshawk-air replay logs/flight.mcap --policy other.onnx -o other.mcap\n  \
    goshawk-air replay logs/flight.mcap --from 12.3 --for 3 --set planner.costs.obstacle=2\n\n\
    RUST_LOG=debug shows more.")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Args)]
struct Flying {
    /// The vehicle file.
    #[arg(long)]
    config: PathBuf,
    /// Zenoh endpoint to listen on, instead of the vehicle file's; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    listen: Vec<String>,
    /// Folder of the vehicle's identity (`goshawk keys`), instead of the vehicle file's.
    #[arg(long, value_name = "DIR")]
    identity: Option<PathBuf>,
    /// UDP address to listen on for MAVLink, instead of the vehicle file's line.
    #[arg(long, value_name = "ADDRESS:PORT")]
    mavlink_bind: Option<SocketAddr>,
    /// Folder for the logs, instead of the vehicle file's.
    #[arg(long, value_name = "DIR")]
    log_dir: Option<PathBuf>,
    /// Policy file, instead of the vehicle file's.
    #[arg(long, value_name = "ONNX")]
    policy: Option<PathBuf>,
}

impl Flying {
    fn split(self) -> (PathBuf, Overrides) {
        let Flying { config, listen, identity, mavlink_bind, log_dir, policy } = self;
        (config, Overrides { listen, identity, mavlink_bind, log_dir, policy })
    }
}

/// Of a log's timeline.
fn instant(text: &str) -> Result<f64, String> {
    let seconds = text.parse::<f64>().map_err(|e| e.to_string())?;
    if (0.0..=1e6).contains(&seconds) { Ok(seconds) } else { Err("0 or more seconds".to_owned()) }
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse::<f64>().map_err(|e| e.to_string())?;
    if (0.0..=600.0).contains(&seconds) { Ok(seconds) } else { Err("0 to 600 seconds".to_owned()) }
}

#[derive(Subcommand)]
enum Command {
    /// Fly: run until SIGINT or SIGTERM.
    Run(Flying),
    /// Before a flight: walk every condition, say what to do where one does not hold. Exit status 0: ready.
    Check {
        #[command(flatten)]
        flying: Flying,
        /// How long to listen to autopilot, camera and odometry, s.
        #[arg(long, value_name = "SECONDS", default_value_t = 8.0, value_parser = seconds)]
        wait: f64,
        /// Walk through the hand checks of the frames instead, and judge each; then Start is no longer refused for want
        /// of them.
        #[arg(long, conflicts_with_all = ["policy", "log_dir"])]
        frames: bool,
        /// Write the findings to a file.
        #[arg(long, value_name = "FILE")]
        json: Option<PathBuf>,
    },
    /// Run planner and controller again on a flight's log and compare, bit for bit. Exit status 0: no difference.
    Replay {
        /// The log.
        log: PathBuf,
        /// Run this policy on the log's images: the one that flew must answer as it did; of another one, how often it
        /// would have chosen otherwise.
        #[arg(long, value_name = "ONNX")]
        policy: Option<PathBuf>,
        /// Alter the planner from this second of the review on: replay up to there as it was flown, then go on with
        /// --policy, --set or both, on what the flight saw next. Exit status 0: it was done.
        #[arg(long, value_name = "SECONDS", value_parser = instant)]
        from: Option<f64>,
        /// For how many seconds.
        #[arg(long = "for", value_name = "SECONDS", default_value_t = 3.0, value_parser = seconds, requires = "from")]
        lasts: f64,
        /// Another value of one of the planner's parameters, from that second on; may be repeated. `goshawk-air
        /// parameters` lists them.
        #[arg(long, value_name = "KEY=VALUE", requires = "from")]
        set: Vec<String>,
        /// Write the other plans to a new log, at the stamps of those that were flown.
        #[arg(short, long, value_name = "MCAP")]
        out: Option<PathBuf>,
        /// Write the outcome to a file.
        #[arg(long, value_name = "FILE")]
        json: Option<PathBuf>,
    },
    /// Print what a file may hold, as JSON Schema, by which editors complete and check it.
    Schema {
        /// Which file.
        file: SchemaOf,
    },
    /// Print every key of the vehicle file and the tuning file, with its meaning and range, as Markdown.
    Parameters,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum SchemaOf {
    /// The vehicle file.
    Vehicle,
    /// The tuning file.
    Tuning,
}

/// Lines that may wait to be printed. Chosen by eye.
const LINES: usize = 4096;

fn main() -> ExitCode {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("info,zenoh=error"));
    let visitors = Visitors::default();
    // Who reads may stop reading, as a terminal does on Ctrl-S: no thread of ours waits for that, lines are left out.
    let (printer, printing) = NonBlockingBuilder::default().buffered_lines_limit(LINES).finish(std::io::stderr());
    let printed = tracing_subscriber::fmt::layer().with_writer(printer).with_filter(filter);
    let listening = visitors.clone().with_filter(filter_fn(Visitors::concerns));
    tracing_subscriber::registry().with(printed).with(listening).init();
    let ended = start(visitors);
    drop(printing); // what is left is printed, if somebody reads
    match ended {
        Ok(code) => code,
        Err(error) => {
            eprintln!("goshawk-air: {}", one_line(error.as_ref()));
            ExitCode::FAILURE
        }
    }
}

fn start(visitors: Visitors) -> Result<ExitCode> {
    match Arguments::parse().command {
        Command::Run(flying) => {
            let (config, overrides) = flying.split();
            run(Vehicle::load(&config)?, overrides, visitors)?;
            Ok(ExitCode::SUCCESS)
        }
        Command::Check { flying, wait, frames, json } => {
            let (config, overrides) = flying.split();
            let check = if frames { check::frames::check } else { check::check };
            let findings = check(&config, overrides, wait);
            check::print(&findings, frames);
            write_json(json.as_deref(), &findings)?;
            Ok(if findings.ready { ExitCode::SUCCESS } else { ExitCode::FAILURE })
        }
        Command::Replay { log, policy, from: Some(from_s), lasts: for_s, set, out, json } => {
            let alteration = goshawk_replay::Alteration { from_s, for_s, set, policy, out };
            apart(json.as_deref(), &log)?;
            let altered = goshawk_replay::alter(&log, &alteration)?;
            goshawk_replay::print_altered(&altered);
            write_json(json.as_deref(), &altered)?;
            Ok(ExitCode::SUCCESS)
        }
        Command::Replay { policy: None, out: Some(_), .. } => Err(eyre!("--out needs --policy, --from or both")),
        Command::Replay { log, policy, out, json, .. } => {
            apart(json.as_deref(), &log)?;
            let outcome = goshawk_replay::replay(&log, &goshawk_replay::Options { policy, out })?;
            goshawk_replay::print(&outcome);
            write_json(json.as_deref(), &outcome)?;
            Ok(if outcome.same() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
        }
        Command::Schema { file } => {
            let schema = match file {
                SchemaOf::Vehicle => reference::vehicle_schema(),
                SchemaOf::Tuning => reference::tuning_schema(),
            };
            println!("{}", serde_json::to_string_pretty(&schema)?);
            Ok(ExitCode::SUCCESS)
        }
        Command::Parameters => {
            print!("{}", reference::markdown());
            Ok(ExitCode::SUCCESS)
        }
    }
}

/// Refuses to write the figures over the log.
fn apart(json: Option<&Path>, log: &Path) -> Result<()> {
    match json.map(|json| (json.canonicalize(), log.canonicalize())) {
        Some((Ok(json), Ok(log))) if json == log => Err(eyre!("--json names the log itself: give another file")),
        _ => Ok(()),
    }
}

fn write_json(path: Option<&Path>, value: &impl serde::Serialize) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let text = serde_json::to_string_pretty(value)? + "\n";
    std::fs::write(path, text).wrap_err_with(|| format!("cannot write {}", path.display()))
}
