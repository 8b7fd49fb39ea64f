//! A replay of a log whose bytes are not what was written: it answers, or refuses it in one line, and takes no more
//! memory than a log may. The log is of a flight in lockstep. A test binary of its own: it replaces the allocator.
#![allow(
    unsafe_code,
    reason = "counting allocations means implementing GlobalAlloc, which forwards to System unchanged"
)]
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;
use std::sync::LazyLock;

use common::{Sectors, config, contract_json, vehicle};
use goshawk_core::Task;
use goshawk_policy::Contract;
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_recorder::{Channel, Entry, LogReader, LogWriter, image};
use goshawk_replay::{Options, replay};
use goshawk_sim::commands::fly::files::Files;
use goshawk_sim::commands::fly::log::{FlightLog, header};
use goshawk_sim::pilots::fly_trial;
use goshawk_sim::trial::airframe::Mount;
use goshawk_vehicle::errors::one_line;
use proptest::prelude::*;

/// A chunk of the largest size that is believed, and what a replay of this log needs besides.
const MOST_BYTES: usize = 2 * (64 << 20);
const LENGTHS: [u64; 7] = [0, 1, (1 << 31) - 1, u32::MAX as u64, 1 << 48, i64::MAX as u64, u64::MAX];

thread_local! {
    /// What this thread holds, and the most that it held.
    static HELD: Cell<(usize, usize)> = const { Cell::new((0, 0)) };
}

struct Counting;

fn count(taken: usize, given: usize) {
    // What another thread allocated may be given back here.
    let _ = HELD.try_with(|cell| {
        let (held, most) = cell.get();
        let held = (held + taken).saturating_sub(given);
        cell.set((held, most.max(held)));
    });
}

// SAFETY: every call is forwarded to `System` with the same arguments; counting touches a thread-local without a drop.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(0, layout.size());
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// The most that `work` held beyond what was held before it.
fn most_held(work: impl FnOnce()) -> usize {
    let before = HELD.get().0;
    HELD.set((before, before));
    work();
    HELD.get().1 - before
}

fn channel(topic: &str) -> Channel {
    let inputs = [Channel::ODOMETRY, Channel::IMU, Channel::PLANNER_INPUT, Channel::CONTROLLER_INPUT];
    let own = [Channel::HEADER, Channel::RGBD].into_iter().chain(inputs);
    let told = [Key::Control, Key::Plan, Key::Map, Key::Target, Key::Event].map(|key| Channel::of(key).unwrap());
    own.chain(told).find(|channel| channel.topic == topic).unwrap()
}

/// The records of a flight's first two and a half seconds, with six of its images.
static RECORDS: LazyLock<Vec<Entry>> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let (path, vehicle) = (folder.path().join("flight.mcap"), vehicle());
    let json = contract_json("navigate");
    let header = v1::LogHeader { policy_contract_json: json.clone(), ..header(&vehicle, None) };
    let mut log = FlightLog::create(&path, Mount::of(&vehicle).camera, &header, &Files::default()).unwrap();
    let mut pilot = Sectors { contract: Contract::from_json(&json).unwrap(), blind: false };
    fly_trial(&config(Task::Navigate, 3.0, 9.0, 2), &vehicle, Some(&mut pilot), &mut log).unwrap();
    log.finish().unwrap();
    let log = LogReader::open(&path).unwrap();
    let begin = log.entries().find(|entry| entry.topic == Channel::CONTROLLER_INPUT.topic).unwrap().time_ns;
    let simulated = ["log/world", "sim/truth"];
    let (mut records, mut images) = (Vec::new(), 0);
    for entry in log.entries().filter(|entry| !simulated.contains(&entry.topic.as_str())) {
        images += usize::from(entry.topic == Channel::RGBD.topic);
        if entry.time_ns < begin + 2_500_000_000 && (entry.topic != Channel::RGBD.topic || images <= 6) {
            records.push(entry);
        }
    }
    records
});

/// A log of these records, in chunks of a tenth of a second.
fn log_of(records: &[Entry]) -> Vec<u8> {
    let mut log = LogWriter::new(Vec::new()).unwrap();
    for (index, entry) in records.iter().enumerate() {
        log.write(channel(&entry.topic), entry.time_ns, &entry.payload).unwrap();
        if index % 100 == 99 {
            log.flush().unwrap();
        }
    }
    log.finish().unwrap()
}

static WHOLE: LazyLock<Vec<u8>> = LazyLock::new(|| log_of(&RECORDS));

/// Replays the log and unpacks its images.
fn survives(bytes: &[u8]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.mcap");
    std::fs::write(&path, bytes).unwrap();
    let held = most_held(|| read_all(&path));
    assert!(held < MOST_BYTES, "{held} bytes for a log of {}", bytes.len());
}

fn read_all(path: &Path) {
    if let Err(error) = replay(path, &Options::default()) {
        let line = one_line(error.as_ref());
        assert!(!line.is_empty() && line.lines().count() == 1, "{line}");
    }
    let Ok(log) = LogReader::open(path) else { return };
    for image in log.entries().filter_map(|entry| entry.decode::<v1::CompressedRgbd>(Channel::RGBD)) {
        if let Err(error) = image::decompress(&image) {
            assert_eq!(error.to_string().lines().count(), 1, "{error}");
        }
    }
}

/// A place as a share of a length.
fn place(share: f64, length: usize) -> usize {
    (share * length as f64) as usize % length.max(1)
}

fn spoil(bytes: &mut [u8], spots: &[(f64, u8)]) {
    for (share, byte) in spots {
        let at = place(*share, bytes.len());
        if let Some(old) = bytes.get_mut(at) {
            *old = *byte;
        }
    }
}

#[test]
fn the_whole_log_is_replayed_without_a_difference() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("whole.mcap");
    std::fs::write(&path, WHOLE.as_slice()).unwrap();
    let outcome = replay(&path, &Options::default()).unwrap();
    assert!(outcome.same(), "{outcome:?}");
    assert!(outcome.plans.of > 20 && outcome.controls.of > 400, "{outcome:?}");
}

/// Where each record outside the chunks begins.
fn records_of(file: &[u8]) -> Vec<usize> {
    let (mut found, mut at) = (Vec::new(), 8);
    while at + 17 < file.len() {
        found.push(at);
        at += 9 + u64::from_le_bytes(file[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    found
}

#[test]
fn lengths_that_are_blown_up_are_survived_wherever_they_stand() {
    let chunk = records_of(&WHOLE).into_iter().filter(|at| WHOLE[*at] == 6).nth(2).unwrap();
    let (size, name, packed) = (chunk + 25, chunk + 37, chunk + 45);
    let summary = WHOLE.len() - 8 - 20;
    for at in records_of(&WHOLE).into_iter().map(|at| at + 1).chain([size, name, packed, summary]) {
        for length in LENGTHS {
            let mut bytes = WHOLE.clone();
            let width = if at == name { 4 } else { 8 };
            bytes[at..at + width].copy_from_slice(&length.to_le_bytes()[..width]);
            survives(&bytes);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(60) })]
    #[test]
    fn bytes_written_over_anywhere_and_a_cut_are_survived(
        spots in proptest::collection::vec((0.0..1.0, any::<u8>()), 1..60),
        cut in prop_oneof![Just(1.0), 0.0..1.0],
    ) {
        let mut bytes = WHOLE.clone();
        spoil(&mut bytes[8..], &spots);
        bytes.truncate(8 + ((bytes.len() - 8) as f64 * cut) as usize);
        survives(&bytes);
    }

    #[test]
    fn records_spoiled_before_their_checksum_was_made_are_survived(
        spots in proptest::collection::vec((0.0..1.0, 0.0..1.0, any::<u8>()), 1..200),
        times in proptest::collection::vec((0.0..1.0, any::<u64>()), 0..20),
        header in proptest::collection::vec((0.0..1.0, any::<u8>()), 0..3),
    ) {
        let mut records = RECORDS.clone();
        let count = records.len();
        for (which, at, byte) in spots {
            // The header's own damage mostly makes the rest unread.
            spoil(&mut records[1 + place(which, count - 1)].payload, &[(at, byte)]);
        }
        for (which, time_ns) in times {
            records[place(which, count)].time_ns = time_ns;
        }
        spoil(&mut records[0].payload, &header);
        survives(&log_of(&records));
    }
}
