//! Builds every part from the vehicle file, starts the threads, and waits for the signal to stop.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{channel, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use color_eyre::eyre::{Result, WrapErr, bail};
use goshawk_autopilot::{Address, AutopilotLink};
use goshawk_bus::Bus;
use goshawk_core::{FlightController, Planner, PlanningDemand, Profile};
use goshawk_policy::{AnswerMonitor, Policy, PolicyError, golden};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_vehicle::clock;
use goshawk_vehicle::config::{OdometrySource, Vehicle};
use goshawk_vehicle::mounting;
use goshawk_vehicle::sensors;

use crate::flight::camera::CameraInput;
use crate::flight::control::Control;
use crate::flight::planning::Planning;
use crate::flight::realtime::{self, Schedule};
use crate::flight::shared::{REPORT_QUEUE, Report, Shared};
use crate::flight::vision;
use crate::network::access::{Access, Guard};
use crate::network::commands;
use crate::network::memory::Memory;
use crate::network::missed;
use crate::network::switch;
use crate::network::visitors::Visitors;
use crate::report::flightlog::FlightLog;
use crate::report::telemetry::{Identity, Telemetry};

/// What the command line may change of the vehicle file.
#[derive(Clone, Debug, Default)]
pub struct Overrides {
    /// Zenoh endpoints instead of `network.listen`.
    pub listen: Vec<String>,
    /// Instead of `network.identity`.
    pub identity: Option<PathBuf>,
    /// UDP to listen on instead of `autopilot.link`.
    pub mavlink_bind: Option<std::net::SocketAddr>,
    /// Instead of `recorder.directory`.
    pub log_dir: Option<PathBuf>,
    /// Instead of `policy.model`.
    pub policy: Option<PathBuf>,
}

impl Overrides {
    /// Changes the vehicle file; gives the policy's file and the logs' folder.
    #[must_use]
    pub fn apply(self, vehicle: &mut Vehicle) -> (PathBuf, PathBuf) {
        if let Some(bind) = self.mavlink_bind {
            vehicle.autopilot.link = Address::UdpIn(bind);
        }
        if !self.listen.is_empty() {
            vehicle.network.listen = self.listen;
        }
        if let Some(folder) = self.identity {
            vehicle.network.identity = Some(std::path::absolute(&folder).unwrap_or(folder));
        }
        let model = self.policy.unwrap_or_else(|| vehicle.resolve(&vehicle.policy.model));
        let log_dir = self.log_dir.unwrap_or_else(|| vehicle.resolve(&vehicle.recorder.directory));
        (model, log_dir)
    }
}

/// Runs the onboard process until SIGINT or SIGTERM; SIGHUP waits for the end of a flight.
///
/// # Errors
/// Anything that keeps it from starting: one line that says what to do.
pub fn run(mut vehicle: Vehicle, overrides: Overrides, visitors: Visitors) -> Result<()> {
    let (model, log_dir) = overrides.apply(&mut vehicle);
    let access = Access::new(&vehicle, vehicle.name.parse()?)?;
    let mut policy = load_policy(&vehicle, &model)?;
    let warm_up_failed = golden::warm_up(&mut policy, &model).err().map(|why| why.to_string());
    let planner = Planner::new(vehicle.planner_config(policy.contract().model()))
        .wrap_err_with(|| format!("the vehicle file and the policy {} do not make a planner", model.display()))?;
    let controller = FlightController::new(vehicle.controller_config())?;
    let idle_demand = idle_demand(&vehicle, &policy)?;
    let line = vehicle.link()?;
    let exposure = line.exposure();
    let link = Arc::new(AutopilotLink::open(line, clock::now)?);
    let bus = access.listen()?;

    let (sender, reports) = sync_channel(REPORT_QUEUE);
    let shared = Arc::new(Shared::new(sender));
    subscribe(&bus, &vehicle, &shared)?;
    let (answers, unsent) = channel();
    let asked = commands::declare(&bus, &answers)?;
    let pinged = commands::declare_question(&bus, Key::Ping, &answers)?;
    let away = commands::declare_question(&bus, Key::Missed, &answers)?;
    let memory = Memory::default();
    let session = memory.session();
    let memory = Arc::new(Mutex::new(memory));
    let log = FlightLog::new(log_dir, &vehicle, &policy);
    let identity = Identity {
        vehicle: vehicle.name.clone(),
        profiles: vehicle.profile_names(),
        policy_sha256: policy.sha256().to_owned(),
        warm_up_failed,
        battery_start: vehicle.limits.battery_start,
        switch: vehicle.switch.clone(),
        mounting: mounting::standing(&vehicle),
        source: vehicle.sensors.odometry,
        insecure: *access.guard() == Guard::Nobody,
        warnings: [("mavlink", exposure), ("least distance", vehicle.unkept().map(str::to_owned))],
    };
    let kept = Arc::clone(&memory);
    let telemetry = Telemetry::new(&bus, Arc::clone(&link), log, visitors.clone(), identity, kept)?;
    visitors.watch(&bus)?;
    let _alive = bus.declare_alive()?;
    tracing::info!("listening on {}; policy {}", access.endpoints(), model.display());

    shared.barred.store(vehicle.switch.is_some(), Ordering::Relaxed);
    let told = Arc::clone(&link);
    let (piloted, heard) = (vehicle.switch.clone().map(|switch| (switch, vehicle.clone())), Arc::clone(&link));
    let sight = vehicle.autopilot.vision().map(|message| (message, Arc::clone(&link)));
    let r = &vehicle.realtime;
    let control = Control {
        controller,
        link,
        source: vehicle.sensors.odometry,
        rate_hz: r.controller_rate_hz,
        schedule: Some(Schedule { priority: r.controller_priority, core: r.controller_core }),
    };
    let schedule = Schedule { priority: r.planner_priority, core: None };
    let watched = AnswerMonitor::new(policy.contract());
    let depth_rim_px = vehicle.camera.depth_rim_px;
    let planning =
        Planning { policy, answers: watched, depth_rim_px, preprocessor: None, planner, idle_demand, schedule };
    if r.lock_memory
        && let Err(why) = realtime::lock_memory()
    {
        tracing::warn!("{why}");
    }
    let mut threads = vec![
        spawn("control", &shared, move |shared| control.run(shared))?,
        spawn("planner", &shared, move |shared| planning.run(shared))?,
        spawn("telemetry", &shared, move |shared| telemetry.run(&reports, shared))?,
        spawn("commands", &shared, move |shared| commands::serve(&asked, &answers, shared, &vehicle, session))?,
        spawn("answers", &shared, move |shared| commands::send(&unsent, shared))?,
        spawn("ping", &shared, move |shared| commands::serve_pings(&pinged, shared))?,
        spawn("missed", &shared, move |shared| missed::serve(&away, &memory, shared))?,
    ];
    if let Some((message, link)) = sight {
        threads.push(spawn("vision", &shared, move |shared| vision::send(message, &link, shared))?);
    }
    if let Some((switch, vehicle)) = piloted {
        threads.push(spawn("switch", &shared, move |shared| switch::serve(&switch, &heard, shared, &vehicle))?);
    }
    wait(&shared, &told, threads)
}

/// The policy as the vehicle file has it run; says so where that is not to be had.
///
/// # Errors
/// The policy cannot be loaded or run at all.
pub fn load_policy(vehicle: &Vehicle, model: &Path) -> Result<Policy, PolicyError> {
    let policy = vehicle.load_policy(model, vehicle.policy.threads)?;
    vehicle.check_pin(model, &policy)?;
    if let Some(why) = policy.why_not() {
        tracing::warn!("the network runs on the cpu, not on {}: {why}", vehicle.policy.provider.name());
    }
    Ok(policy)
}

fn spawn(name: &str, shared: &Arc<Shared>, body: impl FnOnce(&Shared) + Send + 'static) -> Result<JoinHandle<()>> {
    let shared = Arc::clone(shared);
    thread::Builder::new()
        .name(name.to_owned())
        .spawn(move || body(&shared))
        .wrap_err_with(|| format!("cannot start the {name} thread"))
}

fn wait(shared: &Shared, link: &AutopilotLink, threads: Vec<JoinHandle<()>>) -> Result<()> {
    let asked_to_stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&asked_to_stop)).wrap_err("cannot handle signals")?;
    }
    let hung_up = Arc::new(AtomicBool::new(false));
    if !ignores_hang_up() {
        let signal = signal_hook::consts::SIGHUP;
        signal_hook::flag::register(signal, Arc::clone(&hung_up)).wrap_err("cannot handle signals")?;
    }
    // A thread that ended by itself is a defect. In flight the others go on: the controller's ladder brings the vehicle
    // down without a planner, and the autopilot's own failsafe does without a controller.
    let mut told = HashSet::new();
    while !asked_to_stop.load(Ordering::Relaxed) {
        thread::sleep(Duration::from_millis(50));
        // The terminal is gone, as when the link over which it was opened broke: no reason to leave a flight.
        if hung_up.load(Ordering::Relaxed) && !shared.may_be_in_the_air() {
            break;
        }
        for ended in threads.iter().filter(|thread| thread.is_finished()) {
            if told.insert(ended.thread().id()) {
                let text = format!("the {} thread ended unexpectedly", ended.thread().name().unwrap_or("unnamed"));
                tracing::error!("{text}");
                shared.report(Report::Event(v1::Severity::Error, "process", text));
            }
        }
    }
    tracing::info!("stopping");
    give_up_take_off(shared, link);
    shared.stop.store(true, Ordering::Relaxed);
    let failed: Vec<String> = threads
        .into_iter()
        .filter_map(|thread| {
            let name = thread.thread().name().unwrap_or("unnamed").to_owned();
            thread.join().err().map(|_| name)
        })
        .collect();
    if failed.is_empty() { Ok(()) } else { bail!("these threads failed: {}", failed.join(", ")) }
}

/// So long an autopilot may take to start motors that it was asked for before; then another asked for them.
const LATE_ARMING: Duration = Duration::from_secs(3);
/// A take-off that had begun to climb has come down again by then, or the autopilot's failsafe brings it down.
const DOWN_AGAIN: Duration = Duration::from_secs(8);

/// Gives up a take-off that is under way: whoever ended the process while motors start would leave them running. Of one
/// that was given up a moment ago, too, they may still start.
fn give_up_take_off(shared: &Shared, link: &AutopilotLink) {
    use v1::Mode::{Stopping, Takeoff};
    let asked = Duration::from_nanos(clock::now().0.saturating_sub(shared.asked_to_arm.load(Ordering::Relaxed)));
    let text = match shared.mode() {
        Takeoff => "ended in the take-off: it is given up first",
        _ if !shared.flies() && asked < LATE_ARMING => "ended just after a take-off: its motors are waited for",
        _ => return,
    };
    tracing::warn!("{text}");
    shared.report(Report::Event(v1::Severity::Warning, "process", text.to_owned()));
    commands::press_stop(shared);
    let begun = Instant::now();
    let waits = || {
        let autopilot = link.status(clock::now());
        let under_way = matches!(shared.mode(), Takeoff | Stopping) || autopilot.armed;
        autopilot.connected && begun.elapsed() < if under_way { DOWN_AGAIN } else { LATE_ARMING }
    };
    while waits() {
        thread::sleep(Duration::from_millis(20));
    }
}

/// Whoever started the process wants it to outlive the terminal, as `nohup` does.
fn ignores_hang_up() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal_hook::consts::SIGHUP - 1) & 1 == 1
}

/// What is planned for before the first start; refuses a policy of another task than the profiles.
pub(crate) fn idle_demand(vehicle: &Vehicle, policy: &Policy) -> Result<PlanningDemand> {
    let task = policy.contract().model().task;
    for name in vehicle.profile_names() {
        let Some(Profile { task: wanted, .. }) = vehicle.profile(Some(&name)) else { continue };
        if wanted != task {
            bail!(
                "profile {name:?} asks for {wanted:?}, but the policy was trained to {task:?}: name a policy that fits"
            );
        }
    }
    let Some(Profile { task, speed, .. }) = vehicle.profile(None) else { bail!("no default profile") };
    Ok(PlanningDemand { task, speed, goal_world: None })
}

fn subscribe(bus: &Bus, vehicle: &Vehicle, shared: &Arc<Shared>) -> Result<()> {
    let frames = Arc::clone(shared);
    let camera = CameraInput::new(vehicle.camera.rates());
    bus.subscribe(Key::Rgbd, move |payload, source| camera.take(&frames, payload, source, clock::now()))?;
    if vehicle.sensors.odometry == OdometrySource::Zenoh {
        let (samples, sent_on) = (Arc::clone(shared), vehicle.autopilot.vision().is_some());
        bus.subscribe(Key::Odometry, move |payload, _| match sensors::odometry(payload, clock::now()) {
            Ok(sample) => {
                samples.odometry.put(sample);
                if sent_on {
                    samples.vision.put(Arc::new(sample));
                }
            }
            Err(_) => samples.refused_odometry.count(),
        })?;
    }
    Ok(())
}
