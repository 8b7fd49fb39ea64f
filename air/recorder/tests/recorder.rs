//! The recorder over real files, full disks and killed writers.

#![allow(clippy::unwrap_used)]

use std::fs::File;
use std::io::{BufWriter, Error, ErrorKind, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_recorder::{Channel, LogReader, LogWriter, Recorder, RecorderError};
use proptest::prelude::*;
use prost::Message;

fn event(k: u64) -> v1::Event {
    v1::Event { stamp_ns: k, severity: 1, kind: "test".to_owned(), text: format!("event {k}"), seq: k }
}

fn events() -> Channel {
    Channel::of(Key::Event).unwrap()
}

fn record(recorder: &Recorder, k: u64) {
    recorder.record(events(), k, Box::new(move || Some(event(k).encode_to_vec())));
}

#[test]
fn what_was_recorded_is_read_back_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new/folder/flight.mcap");
    let mut recorder = Recorder::begin(&path, || ()).unwrap();
    for k in 0..100 {
        record(&recorder, k);
    }
    recorder.record(events(), 1000, Box::new(|| None)); // could not be made
    recorder.close();
    assert_eq!((recorder.dropped(), recorder.failure()), (1, None));
    let log = LogReader::open(&path).unwrap();
    assert!(log.is_closed());
    let back: Vec<v1::Event> = log.entries().filter_map(|entry| entry.decode(events())).collect();
    assert_eq!(back, (0..100).map(event).collect::<Vec<_>>());
    assert!(log.entries().all(|entry| entry.decode::<v1::Event>(Channel::HEADER).is_none()));
}

#[test]
fn an_existing_log_is_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    std::fs::write(&path, "precious").unwrap();
    let mut recorder = Recorder::begin(&path, || ()).unwrap();
    recorder.close();
    assert_eq!(recorder.failure(), Some(RecorderError::Exists(path.clone()).to_string()));
    assert!(!recorder.is_open());
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
}

#[test]
fn a_folder_that_cannot_be_made_is_an_error_that_names_it() {
    let mut recorder = Recorder::begin(Path::new("/dev/null/flight.mcap"), || ()).unwrap();
    recorder.close();
    let error = recorder.failure().unwrap();
    assert!(error.contains("/dev/null/flight.mcap"), "{error}");
}

#[test]
fn a_full_disk_ends_the_recording_and_says_so() {
    let full = File::options().write(true).open("/dev/full").unwrap();
    let mut recorder = Recorder::over(BufWriter::new(full), Box::new(|| Ok(())), Path::new("full")).unwrap();
    let mut k = 0;
    while recorder.failure().is_none() {
        record(&recorder, k);
        k += 1;
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(recorder.failure().unwrap().contains("space"), "{:?}", recorder.failure());
    record(&recorder, k); // harmless
    assert!(recorder.dropped() >= 1);
    recorder.close();
}

/// A disk that takes `left` bytes, then is full; `sink` is what it holds.
struct SmallDisk {
    sink: Arc<Mutex<Vec<u8>>>,
    left: usize,
}

impl Write for SmallDisk {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        let taken = bytes.len().min(self.left);
        if taken == 0 {
            return Err(Error::from(ErrorKind::StorageFull));
        }
        self.left -= taken;
        self.sink.lock().unwrap().extend_from_slice(&bytes[..taken]);
        Ok(taken)
    }
    fn flush(&mut self) -> Result<(), Error> {
        Ok(())
    }
}

#[test]
fn what_was_on_the_disk_before_it_was_full_is_read_back() {
    let sink = Arc::new(Mutex::new(Vec::new()));
    let disk = SmallDisk { sink: Arc::clone(&sink), left: 200_000 };
    let mut log = LogWriter::new(disk).unwrap();
    let mut ended = 0;
    for k in 0.. {
        log.write(noise(), k, &preview(k)).unwrap();
        if k % 10 == 9 {
            if log.flush().is_err() {
                break;
            }
            ended = k + 1;
        }
    }
    assert!(log.write(noise(), 0, &preview(0)).is_err());
    drop(log);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("full.mcap");
    std::fs::write(&path, sink.lock().unwrap().as_slice()).unwrap();
    let log = LogReader::open(&path).unwrap();
    assert!(!log.is_closed());
    let back = log.entries().count() as u64;
    assert!(ended >= 20 && back >= ended, "{back} of {ended}");
}

fn noise() -> Channel {
    Channel::of(Key::Preview).unwrap()
}

/// A message of a kilobyte that does not compress.
fn preview(k: u64) -> Vec<u8> {
    let jpeg = (0..1000).map(|i| ((k * 1000 + i).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56) as u8).collect();
    v1::Preview { seq: k, stamp_ns: k, width: 1, height: 1, jpeg }.encode_to_vec()
}

#[test]
fn a_disk_that_cannot_sync_ends_the_recording_and_says_so() {
    let sync = Box::new(|| Err(Error::other("cable pulled")));
    let mut recorder = Recorder::over(Vec::new(), sync, Path::new("pulled")).unwrap();
    record(&recorder, 0);
    recorder.close();
    assert!(recorder.failure().unwrap().contains("cable pulled"));
}

#[test]
fn a_recording_that_ended_in_the_middle_is_no_whole_log() {
    for panics in [false, true] {
        let sink = Arc::new(Mutex::new(Vec::new()));
        let disk = SmallDisk { sink: Arc::clone(&sink), left: usize::MAX };
        let sync = move || if panics { Ok(()) } else { Err(Error::other("cable pulled")) };
        let mut recorder = Recorder::over(disk, Box::new(sync), Path::new("ended")).unwrap();
        record(&recorder, 0);
        if panics {
            recorder.record(events(), 0, Box::new(|| panic!("on purpose")));
        }
        while recorder.failure().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        recorder.close();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ended.mcap");
        std::fs::write(&path, sink.lock().unwrap().as_slice()).unwrap();
        assert!(!LogReader::open(&path).unwrap().is_closed(), "panics: {panics}");
    }
}

#[test]
fn a_panic_on_the_recorders_thread_is_a_failure_and_no_more() {
    let mut recorder = Recorder::over(Vec::new(), Box::new(|| Ok(())), Path::new("panic")).unwrap();
    recorder.record(events(), 0, Box::new(|| panic!("on purpose")));
    while recorder.failure().is_none() {
        std::thread::yield_now();
    }
    record(&recorder, 1);
    assert_eq!(recorder.dropped(), 1);
    recorder.close();
    assert!(recorder.failure().unwrap().contains("panicked"));

    let mut last = Recorder::over(Vec::new(), Box::new(|| Ok(())), Path::new("panic")).unwrap();
    last.record(events(), 0, Box::new(|| panic!("on purpose")));
    last.finish();
    while !last.is_finished() {
        std::thread::yield_now();
    }
    assert!(last.failure().unwrap().contains("panicked"), "also where nothing more is to be recorded");
}

#[test]
fn a_full_queue_drops_and_counts_and_does_not_block() {
    let folder = tempfile::tempdir().unwrap();
    let (open, gate) = std::sync::mpsc::channel::<()>();
    let mut recorder = Recorder::begin(&folder.path().join("flight.mcap"), || ()).unwrap();
    recorder.record(events(), 0, Box::new(move || gate.recv().ok().map(|()| event(0).encode_to_vec())));
    for k in 1..5000 {
        record(&recorder, k);
    }
    let dropped = recorder.dropped();
    assert!(dropped > 3000, "{dropped}");
    open.send(()).unwrap();
    recorder.close();
    let kept = LogReader::open(recorder.path()).unwrap().entries().count() as u64;
    assert_eq!(kept + dropped, 5000);
}

#[test]
fn a_disk_that_hangs_holds_up_neither_the_beginning_nor_the_end_of_a_log() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let (answer, disk) = std::sync::mpsc::channel::<()>();
    let mut recorder = Recorder::begin(&path, move || disk.recv().unwrap_or_default()).unwrap();
    record(&recorder, 7);
    recorder.finish();
    assert!(!recorder.is_open() && !recorder.is_finished());
    answer.send(()).unwrap();
    while !recorder.is_finished() {
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!((recorder.failure(), LogReader::open(&path).unwrap().entries().count()), (None, 1));

    let (answer, disk) = std::sync::mpsc::channel::<()>();
    let mut stuck =
        Recorder::begin(&folder.path().join("stuck.mcap"), move || disk.recv().unwrap_or_default()).unwrap();
    assert!(!stuck.close_within(Duration::from_millis(20)));
    drop(stuck); // waits for nothing
    drop(answer);
}

fn in_chunks() -> (Vec<u8>, Vec<usize>) {
    let mut log = LogWriter::new(Vec::new()).unwrap();
    for k in 0..300 {
        log.write(events(), k, &event(k).encode_to_vec()).unwrap();
        if k % 100 == 99 {
            log.flush().unwrap();
        }
    }
    let bytes = log.finish().unwrap();
    // Where each chunk ends: the length of a file that holds just it and those before.
    let ends = (1..=3)
        .map(|chunks| {
            let mut log = LogWriter::new(Vec::new()).unwrap();
            for k in 0..chunks * 100 {
                log.write(events(), k, &event(k).encode_to_vec()).unwrap();
                if k % 100 == 99 {
                    log.flush().unwrap();
                }
            }
            let summary_free = log.finish().unwrap();
            summary_free.iter().zip(&bytes).take_while(|(a, b)| a == b).count()
        })
        .collect();
    (bytes, ends)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn a_killed_log_keeps_every_chunk_that_was_ended(cut in 0.0f64..1.0) {
        let (bytes, ends) = in_chunks();
        let length = 8 + ((bytes.len() - 8) as f64 * cut) as usize;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("killed.mcap");
        std::fs::write(&path, &bytes[..length]).unwrap();
        let whole = ends.iter().filter(|end| **end <= length).count() as u64 * 100;
        let log = LogReader::open(&path).unwrap();
        prop_assert!(!log.is_closed());
        let back: Vec<v1::Event> = log.entries().filter_map(|entry| entry.decode(events())).collect();
        prop_assert!(back.len() as u64 >= whole, "{} of {whole}", back.len());
        prop_assert_eq!(&back[..], &(0..back.len() as u64).map(event).collect::<Vec<_>>()[..]);
    }

    #[test]
    fn no_file_panics_the_reader(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("garbage.mcap");
        std::fs::write(&path, [mcap::MAGIC, &bytes].concat()).unwrap();
        let _ = LogReader::open(&path).unwrap().entries().count();
        std::fs::write(&path, &bytes).unwrap();
        let _ = LogReader::open(&path).map(|log| log.entries().count());
    }
}

#[test]
fn a_compressed_image_comes_back_as_it_was() {
    let rgb: Vec<u8> = (0..48 * 32).flat_map(|k| [(k % 48) as u8 * 5, (k / 48) as u8 * 7, 90]).collect();
    let depth: Vec<u16> = (0..48 * 32).map(|k| (k * 13 % 20_000) as u16).collect();
    let message = goshawk_recorder::image::compress(&rgb, &depth, 48, 32).unwrap();
    let (rgb_back, depth_back) = goshawk_recorder::image::decompress(&message).unwrap();
    assert_eq!((rgb_back, depth_back), (rgb.clone(), depth.clone()));
    assert!(goshawk_recorder::image::compress(&rgb[3..], &depth, 48, 32).is_err());
    let mistaken = v1::CompressedRgbd { width: 32, height: 48, ..message };
    assert!(goshawk_recorder::image::decompress(&mistaken).unwrap_err().to_string().contains("48 x 32"));
}

#[test]
fn the_oldest_logs_make_room_and_nothing_else_does() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str| std::fs::write(folder.path().join(name), [0; 100]).unwrap();
    let [first, second, third] = ["01", "02", "03"].map(|month| format!("kite-2026-{month}-02T101112123Z.mcap"));
    for name in [&third, &first, &second] {
        write(name);
    }
    let others = ["kite-2026-01-02T101112123Z.txt", "kite-2-2025-01-02T101112123Z.mcap", "kite-2025.mcap"];
    for name in others.into_iter().chain(["hawk-2025-01-02T101112123Z.mcap"]) {
        write(name);
    }
    assert_eq!(goshawk_recorder::rotate(folder.path(), "kite-", 300), Vec::<std::path::PathBuf>::new());
    let removed = goshawk_recorder::rotate(folder.path(), "kite-", 250);
    assert_eq!(removed, [folder.path().join(first)]);
    let _ = goshawk_recorder::rotate(folder.path(), "kite-", 0);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 4);
    assert!(goshawk_recorder::rotate(&folder.path().join("none"), "kite-", 0).is_empty());
}

#[test]
fn a_disk_has_room_again_once_it_takes_what_a_log_needs() {
    let folder = tempfile::tempdir().unwrap();
    let logs = folder.path().join("new/logs");
    assert_eq!(goshawk_recorder::has_room(&logs), Ok(()));
    assert_eq!(std::fs::read_dir(&logs).unwrap().count(), 0);
    let why = goshawk_recorder::has_room(Path::new("/dev/null/logs")).unwrap_err();
    assert!(why.contains("/dev/null/logs") && why.contains("free some space"), "{why}");
}
