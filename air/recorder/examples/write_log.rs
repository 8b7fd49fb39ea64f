//! Writes a log of synthetic telemetry and images: `write_log FILE [RECORDS]`; without RECORDS it goes on until it is
//! killed, in real time.

use std::error::Error;
use std::path::Path;
use std::time::{Duration, Instant};

use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_recorder::{Channel, Recorder, image};
use prost::Message;

const WIDTH: u32 = 160;
const HEIGHT: u32 = 96;
const PERIOD: Duration = Duration::from_millis(10);

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let path = arguments.first().ok_or("usage: write_log FILE [RECORDS]")?;
    let records: Option<u64> = arguments.get(1).map(|text| text.parse()).transpose()?;
    let mut recorder = Recorder::begin(Path::new(path), || ())?;
    let control = Channel::of(Key::Control).ok_or("the control key has no message")?;
    let header = v1::LogHeader { vehicle: "kite".to_owned(), version: "0.1.0".to_owned(), ..Default::default() };
    recorder.record(Channel::HEADER, 0, Box::new(move || Some(header.encode_to_vec())));

    let start = Instant::now();
    for seq in 0..records.unwrap_or(u64::MAX) {
        let stamp_ns = seq * PERIOD.as_nanos() as u64;
        let position = v1::Vec3 { x: seq as f64, y: 0.5, z: 2.0 };
        let message = v1::Control { seq, stamp_ns, pos_world: Some(position), ..Default::default() };
        recorder.record(control, stamp_ns, Box::new(move || Some(message.encode_to_vec())));
        if seq % 4 == 0 {
            recorder.record(Channel::RGBD, stamp_ns, Box::new(move || compress(seq, stamp_ns)));
        }
        if records.is_none() {
            std::thread::sleep((PERIOD * seq as u32).saturating_sub(start.elapsed()));
        }
    }
    recorder.close();
    match recorder.failure() {
        Some(why) => Err(why.into()),
        None => Ok(()),
    }
}

/// Pixel values that a reader can work out from `seq`.
fn compress(seq: u64, stamp_ns: u64) -> Option<Vec<u8>> {
    let pixels = (WIDTH * HEIGHT) as usize;
    let rgb: Vec<u8> = (0..pixels).flat_map(|i| [(i % WIDTH as usize) as u8, 100, (seq % 256) as u8]).collect();
    let depth_mm: Vec<u16> = (0..pixels).map(|i| (i as u64 + seq) as u16).collect();
    let message = image::compress(&rgb, &depth_mm, WIDTH, HEIGHT).ok()?;
    Some(v1::CompressedRgbd { seq, stamp_ns, ..message }.encode_to_vec())
}
