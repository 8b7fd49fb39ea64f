//! How evenly the controller's thread runs while other processes keep every core busy: the thread of the vehicle itself,
//! with its own scheduling. Its yardsticks are a bare thread that only sleeps and reads the clock, scheduled alike and
//! running at the same time (what the machine itself gives), and the controller's thread without its scheduling. The
//! figure goes to `target/bench.json` under `controller_period_error_ms`.

mod common;

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};

use common::{quantile, record, row, verdict};
use goshawk_air::flight::control::Control;
use goshawk_air::flight::realtime::{Schedule, lock_memory};
use goshawk_air::flight::shared::{Report, Shared};
use goshawk_autopilot::{AutopilotLink, LinkConfig};
use goshawk_core::{FlightController, Time};
use goshawk_vehicle::clock;
use goshawk_vehicle::config::{OdometrySource, Vehicle};

const SECONDS: u64 = 15;
const TARGET_MS: f64 = 1.0;
/// The argument that makes this program one of the busy processes.
const BURN: &str = "--burn";

/// Processes that keep the cores busy until they are dropped.
struct Load(Vec<Child>);

impl Load {
    fn on_every_core() -> color_eyre::Result<Self> {
        let cores = std::thread::available_parallelism()?.get();
        let program = std::env::current_exe()?;
        let one = || Command::new(&program).arg(BURN).stdout(Stdio::null()).spawn();
        Ok(Self((0..cores).map(|_| one()).collect::<Result<_, _>>()?))
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        for child in &mut self.0 {
            let _ = child.kill(); // gone already is as good
            let _ = child.wait();
        }
    }
}

/// Errors of the period, ms, of the vehicle's control thread and of a bare one beside it.
fn errors_ms(vehicle: &Vehicle, schedule: Option<Schedule>, seconds: u64) -> color_eyre::Result<[Vec<f64>; 2]> {
    let link = Arc::new(AutopilotLink::open(LinkConfig::customary("127.0.0.1:0".parse()?), clock::now)?);
    let (sender, reports) = sync_channel(64 * 1024);
    let shared = Arc::new(Shared::new(sender));
    let rate_hz = vehicle.realtime.controller_rate_hz;
    let controller = FlightController::new(vehicle.controller_config())?;
    let control = Control { controller, link, source: OdometrySource::Autopilot, rate_hz, schedule };
    let (for_control, for_bare) = (Arc::clone(&shared), Arc::clone(&shared));
    let thread = std::thread::spawn(move || control.run(&for_control));
    let bare = std::thread::spawn(move || bare_stamps(&for_bare, schedule, rate_hz));
    std::thread::sleep(Duration::from_secs(seconds));
    shared.stop.store(true, Ordering::Relaxed);
    let _ = thread.join();
    let bare = bare.join().unwrap_or_default();
    let stamps: Vec<_> = reports
        .try_iter()
        .filter_map(|report| if let Report::Control { stamp, .. } = report { Some(stamp) } else { None })
        .collect();
    let errors = |stamps: &[Time]| {
        stamps.windows(2).map(|pair| (pair[1].since(pair[0]) - 1.0 / rate_hz).abs() * 1e3).collect::<Vec<_>>()
    };
    Ok([errors(&stamps), errors(&bare)])
}

/// When a thread woke that does nothing else.
fn bare_stamps(shared: &Shared, schedule: Option<Schedule>, rate_hz: f64) -> Vec<Time> {
    if let Some(schedule) = schedule {
        schedule.apply("bare");
    }
    let mut stamps = Vec::with_capacity(1 << 16);
    let mut due = clock::now();
    while !shared.stopping() {
        due = due.plus(1.0 / rate_hz);
        clock::sleep_until(due);
        stamps.push(clock::now());
    }
    stamps
}

/// Processor time that the machine's host has taken for others, and all of it, in ticks.
fn stolen() -> Option<[u64; 2]> {
    let text = std::fs::read_to_string("/proc/stat").ok()?;
    let ticks: Vec<u64> = text.lines().next()?.split_whitespace().skip(1).map_while(|word| word.parse().ok()).collect();
    Some([*ticks.get(7)?, ticks.iter().take(8).sum()])
}

fn main() -> color_eyre::Result<()> {
    if std::env::args().any(|argument| argument == BURN) {
        let until = Instant::now() + Duration::from_secs(10 * SECONDS); // should nobody stop it
        while Instant::now() < until {
            std::hint::spin_loop();
        }
        return Ok(());
    }
    let vehicle = Vehicle::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../air/vehicles/sim.toml"))?;
    let schedule = Schedule { priority: vehicle.realtime.controller_priority, core: vehicle.realtime.controller_core };
    // Tried on a thread of its own, which is over then: this one must stay as it is.
    let tried = std::thread::spawn(move || schedule.try_apply()).join();
    let mut refused = tried.unwrap_or_default();
    refused.extend(lock_memory().err());
    let _load = Load::on_every_core()?;
    let cores = std::thread::available_parallelism()?.get();
    println!(
        "controller, {} Hz, {cores} busy processes on {cores} cores, {SECONDS} s each",
        vehicle.realtime.controller_rate_hz
    );
    let [mut plain, _] = errors_ms(&vehicle, None, SECONDS)?;
    let before = stolen();
    let [mut errors, mut bare] = errors_ms(&vehicle, Some(schedule), SECONDS)?;
    let taken = before.zip(stolen()).map(|(a, b)| (b[0] - a[0]) as f64 / (b[1] - a[1]).max(1) as f64);
    let (p50, p99) = (quantile(&mut errors, 0.5), quantile(&mut errors, 0.99));
    let met = verdict(p99 <= TARGET_MS);
    println!("  period error        p50 {p50:.3} ms, p99 {p99:.3} ms   target p99 {TARGET_MS} ms: {met}");
    let (p50_bare, p99_bare) = (quantile(&mut bare, 0.5), quantile(&mut bare, 0.99));
    println!("  a bare thread       p50 {p50_bare:.3} ms, p99 {p99_bare:.3} ms   yardstick: what this machine gives");
    let (p50_plain, p99_plain) = (quantile(&mut plain, 0.5), quantile(&mut plain, 0.99));
    println!("  without scheduling  p50 {p50_plain:.3} ms, p99 {p99_plain:.3} ms   yardstick");
    if let Some(taken) = taken {
        println!("  the host took       {:.1} % of the processor's time for others", 100.0 * taken);
    }
    for why in &refused {
        println!("  refused here: {why}");
    }
    let mut row = row(p50, p99, TARGET_MS);
    row["bare_p99"] = p99_bare.into();
    row["host_took"] = taken.into();
    record("controller_period_error_ms", row)?;
    Ok(())
}
