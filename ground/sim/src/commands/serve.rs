//! The real-time front door: one world on the wall clock, with the camera over Zenoh and an autopilot over MAVLink, the
//! stand-in or real firmware, for an onboard process that cannot tell it from the field.
//!
//! Two threads: physics and autopilot here, on a 1 kHz grid of the host's monotonic clock; the camera in [`camera`].

mod autopilot;
mod camera;
mod external;
mod local;
mod mishap;
mod session;
mod target;
mod watch;

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use color_eyre::eyre::{Result, WrapErr, bail, ensure};
use goshawk_core::{Time, Vec3};
use goshawk_vehicle::clock;
use goshawk_vehicle::config::Vehicle;

use crate::actors::evader::Course;
use crate::actors::moving::MovingArgs;
use crate::commands::fly::args::{TaskName, spacing};
use crate::sense::file::SensorArgs;
use crate::sense::rgbd::mix;
use crate::trial::airframe::airframe;
use crate::trial::fault::CameraFault;
use crate::trial::scene::COURSE_M;
use crate::trial::{Fault, Scene, SceneConfig, WorldSource};
use crate::vehicle::quadrotor::{Quadrotor, STEP_S, Wind};
use autopilot::{Autopilot, AutopilotArgs, Instant, Start};
use camera::{Camera, Exposure};
use session::Session;
use target::Target;
use watch::{Surroundings, Watch};

/// One physics step.
const STEP_NS: u64 = 1_000_000;
/// Steps between wake-ups: one sleep for each costs a tenth of a core.
const BATCH_STEPS: u64 = 2;
const WIND_STEPS: u64 = 10;
const WATCH_STEPS: u64 = 5;
const TRUTH_STEPS: u64 = 50;
/// Behind the wall clock by more than this, the simulation lets time go instead of racing after it.
const HOPELESS_NS: u64 = 200 * STEP_NS;
/// The evader runs once the vehicle has been this high for so long, and looks at it.
const AIRBORNE_M: f64 = 0.8;
const AIRBORNE_S: f64 = 2.0;

/// Prints a line. Whoever read them may have gone: the world goes on.
fn say(line: &str) {
    writeln!(std::io::stdout(), "{line}").unwrap_or_default();
}

/// A world in real time: camera over Zenoh, autopilot over MAVLink or real firmware at its simulator interface.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  goshawk-sim serve --seed 3 --spacing 5 --speed 3\n  \
                  goshawk-sim serve --world buildings --moving 8\n  \
                  goshawk-sim serve --task navigate --vehicle-file air/vehicles/navigate.toml\n  \
                  goshawk-sim serve --connect tcp/127.0.0.1:7448 --mavlink-port 14541\n  \
                  goshawk-sim serve --attitude-lag 0.3 --mishap no-position@8 --mishap restart@20\n  \
                  goshawk-sim serve --autopilot px4 --firmware ~/PX4-Autopilot\n  \
                  goshawk-sim serve --autopilot ardupilot --vehicle-file air/vehicles/ardupilot-sitl.toml\n  \
                  goshawk-sim serve --autopilot external --pose udpin:127.0.0.1:14550")]
pub struct ServeArgs {
    /// Seed of the world, the evader and the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Mean spacing of the trees, 1 to 1000 m.
    #[arg(long, value_name = "M", default_value_t = 5.0, value_parser = spacing)]
    spacing: f64,
    /// What is flown: a chase, or the way to a goal, with nobody to chase.
    #[arg(long, value_enum, default_value = "track")]
    task: TaskName,
    /// Most speed of the evader, m/s.
    #[arg(long, value_name = "MPS", default_value_t = 3.0)]
    speed: f64,
    /// The world: forest, buildings, or a point cloud (.ply, .pcd).
    #[arg(long, value_name = "WORLD", default_value = "forest")]
    world: String,
    /// What the evader runs: goal, eight, or a CSV file of waypoints (x,y in m ahead and left).
    #[arg(long, value_name = "COURSE", default_value = "goal")]
    course: String,
    /// How far ahead of the vehicle the goal is, the evader's or the vehicle's own, m; absent: 40, or as far as the
    /// goal of the vehicle file's default profile.
    #[arg(long, value_name = "M")]
    distance: Option<f64>,
    /// The vehicle file.
    #[arg(long, value_name = "FILE", default_value = "air/vehicles/sim.toml")]
    vehicle_file: PathBuf,
    /// The vehicle's Zenoh endpoint.
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/127.0.0.1:7447")]
    connect: String,
    /// The vehicle's UDP port for MAVLink; absent: the vehicle file's.
    #[arg(long, value_name = "PORT")]
    mavlink_port: Option<u16>,
    /// Images a second.
    #[arg(long, value_name = "HZ", default_value_t = 30.0)]
    frame_rate: f64,
    /// What gusts reach, m/s.
    #[arg(long, value_name = "MPS", default_value_t = 0.0)]
    wind: f64,
    #[command(flatten)]
    moving: MovingArgs,
    #[command(flatten)]
    sensors: SensorArgs,
    /// What goes wrong with the camera, 1 to 4 s after the evader's start, such as camera-frozen. For a second camera
    /// start a second one.
    #[arg(long, value_name = "NAME")]
    fault: Option<Fault>,
    #[command(flatten)]
    autopilot: AutopilotArgs,
    /// End by itself after so long, s.
    #[arg(long, value_name = "S")]
    exit_after: Option<f64>,
}

impl ServeArgs {
    /// Runs until SIGINT, SIGTERM or the given time, and prints a summary.
    ///
    /// # Errors
    /// What keeps it from starting; the message says on what and what to do.
    pub fn run(self) -> Result<()> {
        for (name, value, least, most) in [
            ("--speed", self.speed, 0.1, 12.0),
            ("--distance", self.distance.unwrap_or(COURSE_M), 5.0, 500.0),
            ("--frame-rate", self.frame_rate, 1.0, 120.0),
            ("--wind", self.wind, 0.0, 30.0),
        ] {
            ensure!(
                value.is_finite() && (least..=most).contains(&value),
                "{name} is {value}: it must be {least} to {most}"
            );
        }
        let fault = match self.fault {
            None => None,
            Some(Fault::Camera(fault)) if fault != CameraFault::Two => Some(fault),
            Some(other) => {
                bail!("--fault {other}: here only one camera's own faults can be shown, such as camera-frozen")
            }
        };
        let vehicle = Vehicle::load(&self.vehicle_file)?;
        let sensors = self.sensors.load()?;
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            signal_hook::flag::register(signal, Arc::clone(&stop)).wrap_err("cannot handle signals")?;
        }
        let distance_m = self.distance_m(&vehicle);
        let course = Course::parse(&self.course)?;
        let scene = Arc::new(Scene::new(&SceneConfig {
            seed: self.seed,
            world: WorldSource::parse(&self.world, self.spacing)?,
            distance_m,
            evader: (self.task == TaskName::Track).then(|| (course.clone(), self.speed)),
            moving: self.moving.moving,
        })?);
        let mut parameters = airframe(&vehicle);
        if let Some(loops) = self.autopilot.mishaps().loops()? {
            parameters.loops = loops;
        }
        let start = Start { pos_world: scene.vehicle_start(&parameters), heading_rad: scene.world.start_heading_rad() };
        let (autopilot, met_at) =
            self.autopilot.open(&vehicle, self.mavlink_port, &sensors, self.seed, start, &stop)?;
        let quad = Quadrotor::new(parameters, start.pos_world, start.heading_rad);
        let mut session = Session::dial(&vehicle.name, &self.connect, &scene, autopilot.local())?;
        let camera = Camera::start(&session, &vehicle, &sensors, &scene, self.seed, fault, Arc::clone(&stop))?;
        let mut simulation = Simulation::new(&self, course, distance_m, quad, autopilot, &scene);
        let (seed, world, obstacles) = (self.seed, &self.world, scene.world.parts().len());
        let what = match self.task {
            TaskName::Track => format!("the target runs {distance_m} m at up to {} m/s", self.speed),
            TaskName::Navigate => format!("the goal lies {distance_m} m ahead"),
        };
        say(&format!("seed {seed}, {world} ({obstacles} obstacles): {what}; vehicle at {}, {met_at}", self.connect));
        let end = self.exit_after.map(|s| clock::now().plus(s));
        while !stop.load(Ordering::Relaxed) && end.is_none_or(|end| clock::now() < end) {
            simulation.catch_up(clock::now(), &mut session, &camera);
            if let Some(why) = simulation.autopilot.over() {
                bail!("{why}; it never connected: is another one still running?");
            }
            clock::sleep_until(Time(simulation.now.0 + BATCH_STEPS * STEP_NS));
        }
        stop.store(true, Ordering::Relaxed);
        let frames = camera.join();
        say(&simulation.watch.summary(frames, simulation.skipped_s));
        Ok(())
    }
}

impl ServeArgs {
    /// A navigation's goal is the vehicle file's, unless another distance is asked for.
    fn distance_m(&self, vehicle: &Vehicle) -> f64 {
        let goal = vehicle.profile(None).and_then(|profile| profile.goal).filter(|_| self.task == TaskName::Navigate);
        self.distance.or(goal.map(|goal| goal.xy().norm())).unwrap_or(COURSE_M)
    }
}

struct Simulation<'a> {
    scene: &'a Scene,
    target: Target,
    distance_m: f64,
    goal_world: Option<Vec3>,
    quad: Quadrotor,
    autopilot: Autopilot,
    wind: Wind,
    wind_world: Vec3,
    watch: Watch,
    /// The simulated instant; follows the monotonic clock.
    now: Time,
    step: u64,
    frame_period_ns: u64,
    next_frame: Time,
    airborne_since: Option<Time>,
    /// When the evader began to run for the first time.
    runs: Option<Time>,
    /// How far what moves besides it is on its way since then, s; below 0: it stands.
    moved_s: f64,
    skipped_s: f64,
}

impl<'a> Simulation<'a> {
    fn new(
        args: &ServeArgs,
        course: Course,
        distance_m: f64,
        quad: Quadrotor,
        autopilot: Autopilot,
        scene: &'a Arc<Scene>,
    ) -> Self {
        let now = clock::now();
        Self {
            target: Target::new(Arc::clone(scene), course, distance_m, args.speed, args.seed, now),
            scene,
            distance_m,
            goal_world: None,
            quad,
            autopilot,
            wind: Wind::new(args.wind, mix(args.seed, 12)),
            wind_world: Vec3::zeros(),
            watch: Watch::default(),
            now,
            step: 0,
            frame_period_ns: (1e9 / args.frame_rate) as u64,
            next_frame: now,
            airborne_since: None,
            runs: None,
            moved_s: -1.0,
            skipped_s: 0.0,
        }
    }

    /// Steps up to the wall clock.
    fn catch_up(&mut self, wall: Time, session: &mut Session, camera: &Camera) {
        let behind = wall.0.saturating_sub(self.now.0);
        if behind > HOPELESS_NS {
            let skipped = behind - STEP_NS;
            self.now = Time(self.now.0 + skipped);
            // All stand still meanwhile, as the vehicle does.
            self.target.skip(skipped);
            for at in [&mut self.airborne_since, &mut self.runs].into_iter().flatten().chain([&mut self.next_frame]) {
                *at = Time(at.0 + skipped);
            }
            self.skipped_s += skipped as f64 * 1e-9;
        }
        while self.now.0 + STEP_NS <= wall.0 {
            self.now = Time(self.now.0 + STEP_NS);
            self.advance(session, camera);
            self.step += 1;
        }
    }

    fn advance(&mut self, session: &mut Session, camera: &Camera) {
        let world = &self.scene.world;
        if self.step.is_multiple_of(WIND_STEPS) {
            self.wind_world = self.wind.step(WIND_STEPS as f64 * STEP_S, &self.quad.state().vel_world);
        }
        let at = Instant {
            now: self.now,
            step: self.step,
            airborne_since: self.airborne_since,
            wind_world: self.wind_world,
            world,
        };
        self.autopilot.fly(&mut self.quad, &at);
        self.release_the_evader(camera.sees_target());
        self.target.advance(self.now);
        if self.runs.is_some() {
            self.moved_s = self.moved_s.max(0.0) + self.target.pace_of_movers() * STEP_S;
        }
        let (scene, moved_s) = (self.scene, self.moved_s);
        let moving = || scene.moving_at(moved_s);
        if self.now >= self.next_frame {
            self.next_frame = Time((self.next_frame.0 + self.frame_period_ns).max(self.now.0));
            camera.expose(Exposure {
                stamp: self.now,
                vehicle: *self.quad.state(),
                person: self.target.person(),
                moving: moving(),
                running_for_s: self.running_for(),
            });
        }
        if self.step.is_multiple_of(WATCH_STEPS) {
            self.target.decide(self.now, self.quad.state());
            self.place_the_goal();
            let surroundings = Surroundings { world, moving: moving(), evader: self.target.state() };
            let chase = self.airborne_since.is_some() && (self.target.has_begun() || self.scene.evader.is_none());
            self.watch.look(self.now, surroundings, self.quad.state(), chase, camera.sees_target());
            if self.step.is_multiple_of(TRUTH_STEPS) {
                session.truth(self.watch.truth(self.now, self.quad.state(), self.goal_world));
            }
        }
    }

    /// Where nobody runs the goal lies straight ahead of where the vehicle last stood.
    fn place_the_goal(&mut self) {
        let vehicle = self.quad.state();
        if self.scene.evader.is_none() && vehicle.on_ground {
            let (_, _, heading_rad) = vehicle.world_from_body.euler_angles();
            let ahead = vehicle.pos_world + Vec3::new(heading_rad.cos(), heading_rad.sin(), 0.0) * self.distance_m;
            self.goal_world = Some(Vec3::new(ahead.x, ahead.y, self.scene.world.ground_height(ahead.x, ahead.y)));
        }
    }

    fn release_the_evader(&mut self, seen: bool) {
        let at = self.quad.state().pos_world;
        let high = at.z - self.scene.world.ground_height(at.x, at.y) > AIRBORNE_M;
        self.airborne_since = if high { self.airborne_since.or(Some(self.now)) } else { None };
        let looks = seen || self.scene.evader.is_none();
        if looks && self.airborne_since.is_some_and(|since| self.now.since(since) >= AIRBORNE_S) {
            self.target.release();
            self.runs = self.runs.or(Some(self.now));
        }
    }

    fn running_for(&self) -> f64 {
        self.runs.map_or(-1.0, |runs| self.now.since(runs))
    }
}
