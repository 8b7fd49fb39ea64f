//! The command line: one subcommand a module.

pub mod chaos;
pub mod dataset;
pub mod faults;
pub mod fly;
pub mod golden;
pub mod serve;
pub mod world_preview;

use crate::actors::moving::{MovingArgs, Site};
use crate::render::Camera;
use crate::seeds::{Seeds, SeedsArgs};
use crate::trial::{TrialError, WorldSource};
use crate::world::cloud;
use chaos::ChaosArgs;
use clap::{Args, Parser, Subcommand};
use color_eyre::eyre::{Result, WrapErr};
use dataset::{DatasetConfig, generate};
use faults::FaultsArgs;
use fly::args::{FlyArgs, spacing};
use fly::files::Files;
use golden::GoldenArgs;
use goshawk_core::Vec3;
use image::ImageFormat;
use indicatif::{ProgressBar, ProgressStyle};
use serve::ServeArgs;
use std::io::{BufWriter, Cursor, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command as Process;
use world_preview::preview;

/// Goshawk's simulator: worlds, data sets, flights.
#[derive(Debug, Parser)]
#[command(name = "goshawk-sim", version)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Draw a world: a map and a camera's view, as a PNG.
    World(WorldArgs),
    /// Generate a data set for training.
    Dataset(DatasetArgs),
    /// Fly campaigns in lockstep and report successes.
    Fly(FlyArgs),
    /// Fly with broken senses, and say what the vehicle noticed.
    Faults(FaultsArgs),
    /// Fly seeded schedules of faults, and judge every step.
    Chaos(ChaosArgs),
    /// Print which seeds are for what, and which seed a table flies with.
    Seeds(SeedsArgs),
    /// Write the golden images that a policy must answer before it may fly.
    Golden(GoldenArgs),
    /// Run one world in real time, for an onboard process.
    Serve(ServeArgs),
}

/// `goshawk-sim world`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  goshawk-sim world --seed 4 --spacing 5 -o forest.png\n  \
                  goshawk-sim world --world buildings --seed 2 --moving 8\n  goshawk-sim world --seed 4 --scan scan.ply\n  goshawk-sim world --world scan.ply")]
pub struct WorldArgs {
    /// The world: forest, buildings, or a point cloud (.ply, .pcd).
    #[arg(long, value_name = "WORLD", default_value = "forest")]
    world: String,
    /// Seed of the world.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Mean spacing of the trees, 1 to 1000 m.
    #[arg(long, value_name = "M", default_value_t = 4.0, value_parser = spacing)]
    spacing: f64,
    #[command(flatten)]
    moving: MovingArgs,
    /// The picture.
    #[arg(short, long, value_name = "PNG", default_value = "world.png")]
    output: PathBuf,
    /// Also scan the world as a laser scanner would, for `--world`.
    #[arg(long, value_name = "PLY")]
    scan: Option<PathBuf>,
}

/// `goshawk-sim dataset`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  goshawk-sim dataset --out data/train --scenes 480 --seed 900000\n  \
                  goshawk-sim dataset --out data/train --scenes 480 --seed 900000 --only 240..480   # its second half\n  \
                  goshawk-sim dataset --out data/narrow --scenes 480 --seed 950000 --hfov-deg 64   # for a narrower camera")]
pub struct DatasetArgs {
    /// Folder of the data set; finished scenes in it are kept.
    #[arg(long, value_name = "DIR", default_value = "data")]
    out: PathBuf,
    /// Number of scenes.
    #[arg(long, value_name = "N", default_value_t = 240)]
    scenes: usize,
    /// Frames in each scene.
    #[arg(long, value_name = "M", default_value_t = 128)]
    frames: usize,
    /// Seed of everything, of the training range (`goshawk-sim seeds`).
    #[arg(long, default_value_t = 900_000)]
    seed: u64,
    /// The camera's horizontal field of view, degrees; its pixels are square.
    #[arg(long, value_name = "A", default_value_t = 90.0, value_parser = field_of_view)]
    hfov_deg: f64,
    /// Threads; 0: one for each core.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Make these scenes alone, the end not among them; each is as in the whole set. 0..0 makes `dataset.json` alone.
    #[arg(long, value_name = "FIRST..END", value_parser = scenes)]
    only: Option<Range<usize>>,
}

/// Degrees that a pinhole can have, and a sensor.
fn field_of_view(text: &str) -> Result<f64, String> {
    let degrees = text.parse().ok().filter(|degrees| (10.0..=170.0).contains(degrees));
    degrees.ok_or_else(|| "degrees between 10 and 170".to_owned())
}

/// `12..16`.
fn scenes(text: &str) -> Result<Range<usize>, String> {
    let ends = text.split_once("..").and_then(|(first, end)| Some(first.parse().ok()?..end.parse().ok()?));
    ends.ok_or_else(|| "two numbers of scenes, as 12..16".to_owned())
}

impl Cli {
    /// Does what was asked.
    ///
    /// # Errors
    /// Whatever the subcommand fails with; the message says on what and what to do.
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::World(args) => args.run(),
            Command::Dataset(args) => args.run(),
            Command::Fly(args) => args.run(),
            Command::Faults(args) => args.run(),
            Command::Chaos(args) => args.run(),
            Command::Seeds(args) => args.run(),
            Command::Golden(args) => args.run(),
            Command::Serve(args) => args.run(),
        }
    }
}

/// A world's moving obstacles are near the way to a goal so far ahead of the start, m.
const AHEAD_M: f64 = 40.0;

impl WorldArgs {
    fn run(self) -> Result<()> {
        // Known to be writable before anything is drawn.
        let files = Files::default();
        let begin = |path: &Path| files.begin(path).wrap_err_with(|| format!("cannot write {}", path.display()));
        let shown = self.output.display();
        let format = ImageFormat::from_path(&self.output).wrap_err_with(|| format!("cannot write {shown}"))?;
        let (mut picture, unfinished) = begin(&self.output)?;
        let scan = self.scan.as_deref().map(begin).transpose()?;
        let world = WorldSource::parse(&self.world, self.spacing)?.draw(self.seed, AHEAD_M)?;
        let heading = world.start_heading_rad();
        let goal_world = world.start_world() + Vec3::new(heading.cos(), heading.sin(), 0.0) * AHEAD_M;
        let site = Site { world: &world, goal_world, evader: None };
        let moving = self.moving.moving;
        let movers = site.draw(moving, self.seed).ok_or(TrialError::NoRoomToMove(moving))?;
        let mut encoded = Cursor::new(Vec::new());
        preview(&world, &movers).write_to(&mut encoded, format).wrap_err_with(|| format!("cannot write {shown}"))?;
        let written = picture.write_all(encoded.get_ref()).and_then(|()| unfinished.finish());
        written.wrap_err_with(|| format!("cannot write {shown}"))?;
        let size = world.max_world() - world.min_world();
        println!(
            "{shown}: {}, {:.0} x {:.0} m, {} trees, {} obstacles in all{}",
            self.world,
            size.x,
            size.y,
            world.trees().len(),
            world.parts().len(),
            if moving > 0 { format!(", {moving} that move") } else { String::new() }
        );
        if let Some((path, (file, unfinished))) = self.scan.as_ref().zip(scan) {
            let points = cloud::scan(&world, self.seed);
            let shown = path.display();
            let mut out = BufWriter::new(file);
            let written = cloud::write_ply(&mut out, &points).and_then(|()| out.flush());
            let written = written.and_then(|()| unfinished.finish());
            written.wrap_err_with(|| format!("cannot write {shown}"))?;
            println!("{shown}: {} points", points.len());
        }
        Ok(())
    }
}

impl DatasetArgs {
    fn run(self) -> Result<()> {
        let config = DatasetConfig {
            out: self.out,
            scenes: self.scenes,
            frames: self.frames,
            seed: Seeds::Training.allow(self.seed)?,
            camera: Camera { hfov_rad: self.hfov_deg.to_radians(), ..Camera::default() },
            commit: revision(),
            only: self.only.unwrap_or(0..self.scenes),
        };
        let style = ProgressStyle::with_template("{bar:40} {pos}/{len} scenes  {elapsed} (left {eta})")?;
        let bar = ProgressBar::new(config.only.len() as u64).with_style(style);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads).build()?;
        let started = std::time::Instant::now();
        let made = std::sync::atomic::AtomicUsize::new(0);
        pool.install(|| {
            generate(&config, |there| {
                if !there {
                    made.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                }
                bar.inc(1);
            })
        })?;
        bar.finish_and_clear();
        let made = made.into_inner();
        println!(
            "{}: {} scenes of {} frames ({made} new) in {:.1} s",
            config.out.display(),
            config.only.len(),
            config.frames,
            started.elapsed().as_secs_f64()
        );
        Ok(())
    }
}

/// The checked-out revision of the code, if git knows one.
fn revision() -> String {
    let head = Process::new("git").args(["rev-parse", "HEAD"]).output();
    match head {
        Ok(out) if out.status.success() => String::from_utf8_lossy(&out.stdout).trim().to_owned(),
        _ => "unknown".to_owned(),
    }
}
