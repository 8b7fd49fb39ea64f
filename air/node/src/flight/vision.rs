//! Odometry of our own on to the autopilot, on a thread that may wait for the line as the controller's may not.

use std::thread;
use std::time::Duration;

use goshawk_autopilot::{AutopilotLink, VisionMessage};
use goshawk_vehicle::config::VISION_HZ;

use crate::flight::shared::Shared;

/// Sends the newest sample, so often at most, until the process stops. What the line does not take is lost and counted.
pub fn send(message: VisionMessage, link: &AutopilotLink, shared: &Shared) {
    let mut seen = 0;
    while !shared.stopping() {
        if let Some((sample, _)) = shared.vision.wait_newer(&mut seen, Duration::from_millis(100)) {
            let _ = link.send_vision(message, &sample);
            thread::sleep(Duration::from_secs_f64(1.0 / VISION_HZ));
        }
    }
}
