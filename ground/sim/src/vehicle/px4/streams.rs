//! When each message is due. Rates are those that a real PX4 streams unasked.

use goshawk_autopilot::messages::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, ATTITUDE_TARGET_DATA, BATTERY_STATUS_DATA, CURRENT_MODE_DATA,
    ESTIMATOR_STATUS_DATA, EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA, HIGHRES_IMU_DATA, LOCAL_POSITION_NED_DATA,
    ODOMETRY_DATA, SYS_STATUS_DATA, TIMESYNC_DATA, VFR_HUD_DATA,
};
use goshawk_core::Time;
use mavlink::MessageData;

/// Message id and rate, Hz.
const UNASKED: [(u32, f64); 14] = [
    (HEARTBEAT_DATA::ID, 1.0),
    (ATTITUDE_DATA::ID, 100.0),
    (ATTITUDE_QUATERNION_DATA::ID, 50.0),
    (HIGHRES_IMU_DATA::ID, 50.0),
    (LOCAL_POSITION_NED_DATA::ID, 30.0),
    (ODOMETRY_DATA::ID, 30.0),
    (TIMESYNC_DATA::ID, 10.0),
    (ATTITUDE_TARGET_DATA::ID, 10.0),
    (VFR_HUD_DATA::ID, 10.0),
    (SYS_STATUS_DATA::ID, 5.0),
    (EXTENDED_SYS_STATE_DATA::ID, 5.0),
    (ESTIMATOR_STATUS_DATA::ID, 1.0),
    (BATTERY_STATUS_DATA::ID, 0.5),
    (CURRENT_MODE_DATA::ID, 0.5),
];
/// Streams cannot be asked for faster than this, Hz.
const FASTEST_HZ: f64 = 250.0;

#[derive(Clone, Copy, Debug)]
struct Stream {
    id: u32,
    /// None: switched off.
    interval_s: Option<f64>,
    due: Time,
}

#[derive(Clone, Debug)]
pub(super) struct Streams {
    streams: [Stream; UNASKED.len()],
}

impl Streams {
    /// The unasked rates, beginning at `now`, one stream a millisecond later than the one before.
    pub(super) fn new(now: Time) -> Self {
        let mut index = 0.0;
        let streams = UNASKED.map(|(id, hz)| {
            index += 1.0;
            Stream { id, interval_s: Some(1.0 / hz), due: now.plus(index * 1e-3) }
        });
        Self { streams }
    }

    /// MAV_CMD_SET_MESSAGE_INTERVAL: microseconds, 0 for the unasked rate, negative for none. False: no such stream.
    pub(super) fn set_interval(&mut self, now: Time, id: u32, interval_us: f64) -> bool {
        let Some(stream) = self.streams.iter_mut().find(|stream| stream.id == id) else { return false };
        stream.interval_s = match interval_us {
            us if us < 0.0 => None,
            us if us > 0.0 => Some((us * 1e-6).max(1.0 / FASTEST_HZ)),
            _ => UNASKED.iter().find(|row| row.0 == id).map(|row| 1.0 / row.1),
        };
        stream.due = now;
        true
    }

    /// Calls `send` for every message that is due at `now`.
    pub(super) fn due(&mut self, now: Time, mut send: impl FnMut(u32)) {
        for stream in &mut self.streams {
            let Some(interval_s) = stream.interval_s else { continue };
            if now >= stream.due {
                send(stream.id);
                // Keeps its rate on average; after a pause it does not catch up.
                stream.due = stream.due.plus(interval_s).max(now.plus(-interval_s));
            }
        }
    }
}
