//! What can be told without anybody else: files, libraries, permissions, space.

use std::path::Path;

use color_eyre::eyre::Report;
use goshawk_core::Planner;
use goshawk_policy::library::{Places, find};
use goshawk_policy::{Policy, Provider, golden};
use goshawk_vehicle::clock;
use goshawk_vehicle::config::Vehicle;
use goshawk_vehicle::errors::one_line;

use super::Findings;
use crate::flight::realtime::{self, Schedule};
use crate::run::idle_demand;

/// A log grows by about this much, with the image of 160 x 96 at 30 Hz.
const LOG_MB_PER_MINUTE: f64 = 105.0;
/// Less space than this is not enough for a flight, MB: five minutes of log.
const LEAST_MB: f64 = 500.0;
/// Less than this is not enough for an afternoon, MB: half an hour of log.
const PLENTY_MB: f64 = 3000.0;
/// The network must leave most of a frame's 33 ms: less than half.
const SLOWEST_INFERENCE_MS: f64 = 15.0;
/// The network is timed over so many runs. Chosen by eye.
const INFERENCES: usize = 50;

/// Whether the tilt gives what the tuning counts on to get out of somebody's way.
pub(super) fn tilt(vehicle: &Vehicle, findings: &mut Findings) {
    let (tuning, tilt_deg) = (vehicle.tuning(), vehicle.airframe.max_tilt_deg);
    let gives = vehicle.airframe.level_acc();
    let wanted = [
        ("planner.max_acc_mps2, with which it brakes to keep the least distance", tuning.planner.max_acc_mps2),
        ("planner.evasion.acc_mps2", tuning.planner.evasion.acc_mps2),
        ("separation.aside_acc_mps2", tuning.separation.aside_acc_mps2),
        ("hold.max_acc_horizontal_mps2", tuning.hold.max_acc_horizontal_mps2),
    ];
    let beyond: Vec<_> =
        wanted.iter().filter(|(_, acc)| *acc > gives).map(|(key, acc)| format!("{acc} of {key}")).collect();
    if !beyond.is_empty() {
        let beyond = beyond.join(", ");
        findings.warn("tilt", format!("{tilt_deg} degrees give {gives:.1} m/s², which is flown instead of {beyond}"));
    }
}

/// The library, the policy, what runs it, and how fast.
pub(super) fn policy(vehicle: &Vehicle, model: &Path, findings: &mut Findings) -> Option<Policy> {
    let library = find(vehicle.library().as_deref(), &Places::of_process());
    let found = library.is_ok();
    findings.judge("onnx runtime", library.map(|path| path.display().to_string()).map_err(|e| e.to_string()));
    if !found {
        findings.fail("policy", "not tried: it needs ONNX Runtime");
        return None;
    }
    let mut policy = match vehicle.load_policy(model, vehicle.policy.threads) {
        Ok(policy) => policy,
        Err(error) => {
            findings.fail("policy", one_line(&error));
            return None;
        }
    };
    let fits = vehicle
        .check_pin(model, &policy)
        .map_err(Report::new)
        .and_then(|()| golden::warm_up(&mut policy, model).map_err(Report::new))
        .and_then(|_| Planner::new(vehicle.planner_config(policy.contract().model())).map_err(Report::new))
        .and_then(|_| idle_demand(vehicle, &policy));
    let sha = policy.sha256().get(..12).unwrap_or_default().to_owned();
    let task = policy.contract().model().task;
    findings.judge(
        "policy",
        fits.map(|_| format!("{}: {task:?}, sha256 {sha}…", model.display())).map_err(|error| one_line(error.as_ref())),
    );
    provider(vehicle.policy.provider, &policy, findings);
    let schedule = Schedule { priority: vehicle.realtime.planner_priority, core: None };
    inference(&mut policy, schedule, findings);
    Some(policy)
}

fn provider(asked: Provider, policy: &Policy, findings: &mut Findings) {
    match policy.why_not() {
        None => {
            let bits = if policy.half() { ", in 16 bits" } else { "" };
            findings.ok("provider", format!("the network runs on {}{bits}", policy.provider().name()));
        }
        Some(why) => findings.warn(
            "provider",
            format!(
                "the network runs on {}, not on {}: {why}; install an ONNX Runtime that was built for it, or set \
                 policy.provider",
                policy.provider().name(),
                asked.name()
            ),
        ),
    }
}

/// Timed on a thread that is scheduled as the planner's.
fn inference(policy: &mut Policy, schedule: Schedule, findings: &mut Findings) {
    let timed = std::thread::scope(|scope| {
        let thread = scope.spawn(|| {
            let _ = schedule.try_apply(); // what is refused is told under "real time"
            median_ms(policy)
        });
        thread.join().unwrap_or_else(|_| Err("the network panicked".to_owned()))
    });
    let way = "stop what else runs, take a smaller policy or another provider";
    findings.judge(
        "inference",
        timed.and_then(|ms| match format!("{ms:.1} ms (median of {INFERENCES})") {
            text if ms <= SLOWEST_INFERENCE_MS => Ok(text),
            text => Err(format!("{text}; at most {SLOWEST_INFERENCE_MS} ms can be flown with: {way}")),
        }),
    );
}

fn median_ms(policy: &mut Policy) -> Result<f64, String> {
    let (image, state) = (vec![0.5; policy.rgbd_len()], vec![0.0; policy.state_len()]);
    let mut times_ms = Vec::with_capacity(INFERENCES);
    for _ in 0..INFERENCES {
        let begun = clock::now();
        let network = policy.infer(&image, &state).map_err(|e| e.to_string())?;
        times_ms.push(clock::now().since(begun) * 1e3);
        if !network.values.iter().all(|value| value.is_finite()) {
            return Err("the network's answer to a grey image is not finite".to_owned());
        }
    }
    times_ms.sort_by(f64::total_cmp);
    Ok(times_ms[INFERENCES / 2])
}

/// Whether the threads get what the vehicle file asks for; tried on a thread of its own.
pub(super) fn scheduling(vehicle: &Vehicle, findings: &mut Findings) {
    let r = &vehicle.realtime;
    let schedule = Schedule { priority: r.controller_priority, core: r.controller_core };
    let tried = std::thread::spawn(move || schedule.try_apply()).join();
    let mut refused = tried.unwrap_or_else(|_| vec!["could not be tried".to_owned()]);
    if r.lock_memory {
        refused.extend(realtime::lock_memory().err());
    }
    if refused.is_empty() {
        let memory = if r.lock_memory { ", memory locked" } else { "" };
        findings.ok("real time", format!("SCHED_FIFO {}{memory}", r.controller_priority));
    } else {
        findings.warn("real time", refused.join("; "));
    }
}

/// Whether a log can be written, and for how long.
pub(super) fn log_folder(folder: &Path, findings: &mut Findings) {
    let probe = folder.join(format!(".probe-{}", std::process::id()));
    let written = std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(&probe, [0; 4096]))
        .and_then(|()| std::fs::remove_file(&probe));
    let name = folder.display();
    if let Err(error) = written {
        return findings.fail("log folder", format!("{name} cannot be written ({error}): name another with --log-dir"));
    }
    match rustix::fs::statvfs(folder) {
        Err(error) => findings.warn("log folder", format!("{name}: its free space is not known ({error})")),
        Ok(space) => {
            let free_mb = space.f_bavail as f64 * space.f_frsize as f64 / 1e6;
            let text = format!("{name}: {free_mb:.0} MB free, {:.0} minutes of flight", free_mb / LOG_MB_PER_MINUTE);
            if free_mb < LEAST_MB {
                findings.fail("log folder", format!("{text}: remove old logs, or name another with --log-dir"));
            } else if free_mb < PLENTY_MB {
                findings.warn("log folder", format!("{text}: remove old logs soon"));
            } else {
                findings.ok("log folder", text);
            }
        }
    }
}
