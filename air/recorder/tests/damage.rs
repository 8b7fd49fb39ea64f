//! Logs with holes, flipped bits and impossible lengths: read around, named, and never a panic or a huge allocation.

#![allow(clippy::unwrap_used)]

use std::path::Path;

use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_recorder::{Channel, LogReader, LogWriter};
use proptest::prelude::*;
use prost::Message;

const CHUNKS: u64 = 20;
const IN_CHUNK: u64 = 20;

fn noise() -> Channel {
    Channel::of(Key::Preview).unwrap()
}

/// A message of a kilobyte that does not compress.
fn preview(k: u64) -> v1::Preview {
    let jpeg = (0..1000).map(|i| ((k * 1000 + i).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56) as u8).collect();
    v1::Preview { seq: k, stamp_ns: k, width: 1, height: 1, jpeg }
}

/// A closed log of 20 chunks of 20 kB each; message k is of time k.
fn log() -> Vec<u8> {
    let mut log = LogWriter::new(Vec::new()).unwrap();
    for k in 0..CHUNKS * IN_CHUNK {
        log.write(noise(), k, &preview(k).encode_to_vec()).unwrap();
        if k % IN_CHUNK == IN_CHUNK - 1 {
            log.flush().unwrap();
        }
    }
    log.finish().unwrap()
}

fn open(bytes: &[u8]) -> LogReader {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    std::fs::write(&path, bytes).unwrap();
    LogReader::open(Path::new(&path)).unwrap()
}

/// What is read back; every message is as it was written. Where the first chunk is lost and the summary is spoiled as
/// well, the channel may have a topic that is none of ours: its records are nobody's.
fn times(log: &LogReader) -> Vec<u64> {
    let whole = |entry: goshawk_recorder::Entry| {
        let back: v1::Preview = entry.decode(noise()).unwrap();
        assert_eq!(back, preview(entry.time_ns));
        entry.time_ns
    };
    log.entries().filter(|entry| entry.topic == noise().topic).map(whole).collect()
}

#[test]
fn a_whole_log_has_no_damage_and_a_cut_off_one_neither() {
    let bytes = log();
    let whole = open(&bytes);
    assert_eq!((whole.is_closed(), whole.damage().len(), times(&whole).len()), (true, 0, 400));
    for length in (8..bytes.len()).step_by(997) {
        let cut = open(&bytes[..length]);
        assert_eq!((cut.is_closed(), cut.damage().len()), (false, 0), "{length} of {}", bytes.len());
    }
}

#[test]
fn a_hole_of_4_kb_costs_its_chunks_and_names_the_time_that_is_missing() {
    let mut bytes = log();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 4096].fill(0);
    let damaged = open(&bytes);
    let back = times(&damaged);
    assert!(damaged.is_closed());
    assert!(back.len() as u64 >= (CHUNKS - 2) * IN_CHUNK, "{}", back.len());
    let [damage] = damaged.damage() else { panic!("{:?}", damaged.damage()) };
    assert!(damage.bytes.contains(&middle));
    let (after, before) = (damage.after_ns.unwrap(), damage.before_ns.unwrap());
    let missing: Vec<u64> = (0..400).filter(|k| !back.contains(k)).collect();
    assert_eq!(missing, (after + 1..before).collect::<Vec<_>>());
}

#[test]
fn a_log_whose_first_chunk_is_lost_takes_its_channels_from_the_summary() {
    let mut bytes = log();
    bytes[200..4000].fill(0xFF);
    let damaged = open(&bytes);
    assert_eq!(times(&damaged), (IN_CHUNK..400).collect::<Vec<_>>());
    assert_eq!(damaged.damage()[0].after_ns, None);
}

#[test]
fn a_length_of_2_to_the_48_is_damage_and_no_allocation() {
    let bytes = log();
    let huge = (1_u64 << 48).to_le_bytes();
    let chunks: Vec<usize> =
        (0..bytes.len() - 50).filter(|at| bytes[at + 37..].starts_with(b"\x04\0\0\0zstd")).collect();
    assert!(chunks.len() as u64 >= CHUNKS);
    let (chunk, size, packed) = (chunks[5] + 1, chunks[5] + 25, chunks[5] + 45);
    for at in [9, chunk, size, packed] {
        let mut spoiled = bytes.clone();
        spoiled[at..at + 8].copy_from_slice(&huge);
        let log = open(&spoiled);
        assert_eq!(log.damage().len(), 1, "at {at}");
        assert!(times(&log).len() as u64 >= (CHUNKS - 1) * IN_CHUNK, "at {at}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn whatever_50_bits_flip_what_is_read_is_what_was_written(flips in proptest::collection::vec((0.0..1.0, 0..8_u32), 1..50)) {
        let mut bytes = log();
        for (share, bit) in flips {
            let at = 8 + ((bytes.len() - 8) as f64 * share) as usize;
            bytes[at] ^= 1 << bit;
        }
        let damaged = open(&bytes);
        let back = times(&damaged);
        prop_assert!(back.is_sorted());
        if back.len() < 400 {
            prop_assert!(!damaged.damage().is_empty());
        }
    }

    #[test]
    fn whatever_is_written_over_a_log_the_reader_comes_back(
        spots in proptest::collection::vec((0.0..1.0, proptest::collection::vec(any::<u8>(), 1..16)), 1..40),
    ) {
        let mut bytes = log();
        for (share, over) in spots {
            let at = 8 + ((bytes.len() - 30) as f64 * share) as usize;
            bytes[at..at + over.len()].copy_from_slice(&over);
        }
        let log = open(&bytes);
        let _ = (times(&log).len(), log.damage().len());
    }
}
