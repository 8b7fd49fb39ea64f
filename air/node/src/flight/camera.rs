//! The camera's messages, judged as a stream before anything is planned from them.

use std::sync::{Arc, Mutex};

use goshawk_core::Time;
use goshawk_policy::{Arrival, Moving, RateLimits, StreamMonitor};
use goshawk_proto::v1;
use goshawk_vehicle::sensors;

use crate::flight::shared::{Shared, lock};

/// Takes what the camera sends.
pub struct CameraInput {
    monitor: Mutex<StreamMonitor>,
}

impl CameraInput {
    /// Of a camera that may send so often.
    #[must_use]
    pub fn new(limits: RateLimits) -> Self {
        Self { monitor: Mutex::new(StreamMonitor::new(limits)) }
    }

    /// Hands a message of `source` that was received at `now` to the planner, with what is wrong with the stream.
    pub fn take(&self, shared: &Shared, payload: &[u8], source: u64, now: Time) {
        let Ok(mut frame) = sensors::frame(payload, now) else {
            shared.refused_frames.count();
            return;
        };
        let moving = moving(shared, frame.stamp);
        let arrival = Arrival { seq: frame.seq, stamp: frame.stamp, source };
        let mut monitor = lock(&self.monitor);
        frame.fault = monitor.judge(&arrival, &frame.rgb, &frame.depth_mm, &moving);
        frame.print = monitor.print();
        drop(monitor);
        shared.frame.put(Arc::new(frame));
    }
}

fn moving(shared: &Shared, stamp: Time) -> Moving {
    let mode = shared.mode();
    let standing = [v1::Mode::Idle, v1::Mode::Ready, v1::Mode::Landed, v1::Mode::Fault].contains(&mode);
    let odometry = lock(&shared.history).odometry_at(stamp);
    odometry.map_or(Moving { flying: !standing, ..Moving::default() }, |odometry| sensors::moving(!standing, &odometry))
}
