//! The controller's thread allocates nothing after its start: a whole take-off and flight of it, with odometry, plans,
//! commands and MAVLink. A test binary of its own: it replaces the allocator.
#![allow(
    unsafe_code,
    reason = "counting allocations means implementing GlobalAlloc, which forwards to System unchanged"
)]
#![allow(clippy::unwrap_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::BTreeSet;
use std::net::UdpSocket;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use goshawk_air::flight::control::Control;
use goshawk_air::flight::realtime::Schedule;
use goshawk_air::flight::shared::{PendingCommand, Report, Shared, lock};
use goshawk_autopilot::messages::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag};
use goshawk_autopilot::wire::encode::Encoder;
use goshawk_autopilot::{AutopilotLink, LinkConfig, Px4Mode};
use goshawk_core::planning::room::HEADINGS;
use goshawk_core::{
    ANCHORS, Added, Candidate, Command, FlatState, FlightController, Mode, Odometry, Plan, Rot, TargetEstimate, Time,
    Vec3,
};
use goshawk_vehicle::clock;
use goshawk_vehicle::config::{OdometrySource, Vehicle};

thread_local! {
    static WATCHED: Cell<bool> = const { Cell::new(false) };
}
static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

struct Counting;

// SAFETY: every call is forwarded to `System` with the same arguments; counting touches an atomic and a thread-local.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if WATCHED.try_with(Cell::get).unwrap_or(false) {
            ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        }
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// An autopilot that grants everything, a vehicle that is where it should be, and a planner that flies straight.
struct Surroundings {
    socket: UdpSocket,
    encoder: Encoder,
    height: f64,
    frames: u64,
}

impl Surroundings {
    fn heartbeat(&self, flying: bool) {
        let mode = if flying { Px4Mode::Offboard } else { Px4Mode::Hold };
        let armed = if flying { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
        let message = HEARTBEAT_DATA {
            custom_mode: mode.custom_mode(),
            base_mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed,
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            ..HEARTBEAT_DATA::default()
        };
        self.socket.send(self.encoder.encode(&MavMessage::HEARTBEAT(message)).raw_bytes()).unwrap();
    }

    fn step(&mut self, shared: &Shared, tick: u64, mode: Mode) {
        let now = clock::now();
        let flying = !matches!(mode, Mode::Idle | Mode::Ready);
        if tick.is_multiple_of(20) {
            self.heartbeat(flying);
        }
        self.height += if flying { 0.01_f64.min(1.5 - self.height) } else { 0.0 };
        shared.odometry.put(Odometry {
            stamp: now,
            pos_world: Vec3::new(0.0, 0.0, self.height),
            vel_world: Vec3::zeros(),
            world_from_body: Rot::identity(),
            ang_vel_body: Vec3::zeros(),
            reset_counter: 0,
        });
        if tick.is_multiple_of(7) {
            self.frames += 1;
            shared.plan.put(plan(self.frames, now, self.height));
        }
    }
}

fn plan(seq: u64, stamp: Time, height: f64) -> Plan {
    let state = |x| FlatState { pos: Vec3::new(x, 0.0, height), ..FlatState::default() };
    let candidate = Candidate {
        end: state(3.0),
        cost: 1.0,
        added: Added::default(),
        objectness: 0.9,
        target_world: None,
        rejection: None,
    };
    let target = TargetEstimate {
        stamp,
        pos_world: Vec3::new(8.0, 0.0, height),
        vel_world: Vec3::x(),
        covariance: nalgebra::Matrix6::identity(),
        confirmed: true,
        last_seen: stamp,
    };
    Plan {
        seq,
        stamp,
        start: state(0.0),
        world_from_cam: Rot::identity(),
        duration: 1.5,
        alpha: 1.0,
        candidates: [candidate; ANCHORS],
        chosen: Some(7),
        target: Some(target),
        look: None,
        room: Some([1.0; HEADINGS]),
        movers: [None; goshawk_core::planning::movers::MOST],
        evasion: None,
    }
}

/// The modes of the steps reported since the last call, and the last one.
fn modes(reports: &Receiver<Report>, seen: &mut BTreeSet<String>, mode: &mut Mode) -> u64 {
    let mut steps = 0;
    while let Ok(report) = reports.try_recv() {
        if let Report::Control { output, .. } = report {
            *mode = output.mode;
            seen.insert(format!("{mode:?}"));
            steps += 1;
        }
    }
    steps
}

#[test]
fn the_controllers_thread_allocates_nothing_after_its_start() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../vehicles/sim.toml");
    let vehicle = Vehicle::load(&path).unwrap();
    let link =
        Arc::new(AutopilotLink::open(LinkConfig::customary("127.0.0.1:0".parse().unwrap()), clock::now).unwrap());
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(link.local_address().unwrap()).unwrap();
    let mut around = Surroundings { socket, encoder: Encoder::new(1, 1), height: 0.0, frames: 0 };
    let (sender, reports) = sync_channel(2048);
    let shared = Arc::new(Shared::new(sender));
    let control = Control {
        controller: FlightController::new(vehicle.controller_config()).unwrap(),
        link,
        source: OdometrySource::Zenoh,
        rate_hz: 200.0,
        schedule: Some(Schedule { priority: 1, core: None }),
    };
    let for_thread = Arc::clone(&shared);
    let thread = std::thread::spawn(move || {
        WATCHED.set(true);
        control.run(&for_thread);
        drop(std::hint::black_box(vec![1])); // one, to see that they are counted
        WATCHED.set(false);
    });

    let (mut seen, mut mode, mut steps, mut begun) = (BTreeSet::new(), Mode::Idle, 0, None);
    let mut verdict = None;
    for tick in 0..4000 {
        shared.ready.judge(None, clock::now());
        around.step(&shared, tick, mode);
        steps += modes(&reports, &mut seen, &mut mode);
        if begun.is_none() && mode == Mode::Ready && steps > 20 {
            begun = Some(ALLOCATIONS.load(Ordering::Relaxed));
            let (answer, answered) = sync_channel(1);
            let command = Command::Start(vehicle.profile(None).unwrap());
            *lock(&shared.command) = Some(PendingCommand { number: 0, command, profile: "chase".into(), answer });
            verdict = Some(answered);
        }
        if seen.contains("Track") && steps > 1200 {
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let ended = ALLOCATIONS.load(Ordering::Relaxed);
    shared.stop.store(true, Ordering::Relaxed);
    thread.join().unwrap();
    assert_eq!(verdict.unwrap().recv().unwrap(), Ok(()));
    assert!(seen.contains("Takeoff") && seen.contains("Track"), "it flew: {seen:?}");
    assert_eq!(ended - begun.unwrap(), 0);
    assert!(ALLOCATIONS.load(Ordering::Relaxed) > ended, "the counter counts");
}
