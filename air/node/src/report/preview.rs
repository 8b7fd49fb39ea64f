//! A small picture for the ground, now and then, while somebody looks.

use goshawk_bus::{Bus, BusError, Publisher};
use goshawk_core::Time;
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_vehicle::sensors::Frame;
use image::codecs::jpeg::JpegEncoder;

/// One so often, s: 10 Hz.
const PERIOD_S: f64 = 0.1;
/// Its JPEG quality, of 100. Chosen by eye.
const QUALITY: u8 = 60;

/// Makes and sends them.
pub struct Preview {
    publisher: Publisher,
    seq: u64,
    last: Time,
}

impl Preview {
    /// Declares the publisher.
    ///
    /// # Errors
    /// Zenoh refused it.
    pub fn new(bus: &Bus) -> Result<Self, BusError> {
        Ok(Preview { publisher: bus.publisher(Key::Preview)?, seq: 0, last: Time(0) })
    }

    /// Sends this image, if one is due and wanted.
    pub fn show(&mut self, frame: &Frame, now: Time) {
        if now.since(self.last) < PERIOD_S {
            return;
        }
        self.last = now;
        if !self.publisher.is_wanted() {
            return;
        }
        let (width, height) = (frame.width as u32, frame.height as u32);
        let mut jpeg = Vec::with_capacity(8 * 1024);
        let mut encoder = JpegEncoder::new_with_quality(&mut jpeg, QUALITY);
        if encoder.encode(&frame.rgb, width, height, image::ExtendedColorType::Rgb8).is_err() {
            return;
        }
        let message = v1::Preview { seq: self.seq, stamp_ns: frame.stamp.0, width, height, jpeg };
        self.seq += 1;
        self.publisher.put(&message);
    }
}
