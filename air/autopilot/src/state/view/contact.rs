//! Who is heard: what is missing between packets, others on the line, restarts, and the refusal to arm.

use super::{HEARTBEAT_TIMEOUT_S, View};
use crate::messages::{MavAutopilot, MavMessage};
use crate::wire::packet::Packet;
use goshawk_core::Time;

/// Nothing heard for this long, s: it may be starting again. Its fastest stream comes at 100 Hz, its slowest at 1 Hz.
const HEARD_S: f64 = 1.5;
/// Its time since boot going back by more than this, ms, means that it has started again.
const RESTART_MS: u64 = 1_000;
/// An event whose number is one of so many up to the newest is told again. PX4 keeps a few dozen.
const EVENTS_AGAIN: u16 = 1_000;

/// A message that says who speaks after a silence: its state anew, or its time since boot.
pub(super) fn tells_who(message: &MavMessage) -> bool {
    use MavMessage::{ATTITUDE_QUATERNION, HEARTBEAT, LOCAL_POSITION_NED, TIMESYNC};
    matches!(message, HEARTBEAT(_) | ATTITUDE_QUATERNION(_) | LOCAL_POSITION_NED(_))
        || matches!(message, TIMESYNC(sync) if sync.tc1 > 0)
}

impl View {
    /// Counts a packet of another system or component, and remembers an autopilot among them.
    pub fn foreign(&mut self, packet: &Packet) {
        self.counters.foreign += 1;
        let MavMessage::HEARTBEAT(heartbeat) = &packet.message else { return };
        if heartbeat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID {
            self.other = u8::try_from(packet.header.system_id).ok().map(|system| (system, packet.header.component_id));
        }
    }

    /// Counts what is missing before `sequence`.
    pub(super) fn follow(&mut self, sequence: u8) {
        if let Some(last) = self.sequence.replace(sequence) {
            let gap = sequence.wrapping_sub(last).wrapping_sub(1);
            // More than half the circle is a packet that came late, not 128 that were lost.
            self.counters.lost += if gap < 128 { u64::from(gap) } else { 0 };
        }
    }

    /// Its clock has gone back: forgets what the one before the restart said.
    pub(super) fn has_restarted(&mut self, message: &MavMessage) -> bool {
        let (newest, told) = match message {
            MavMessage::ATTITUDE_QUATERNION(attitude) => (&mut self.boot_ms, u64::from(attitude.time_boot_ms)),
            MavMessage::LOCAL_POSITION_NED(local) => (&mut self.boot_ms, u64::from(local.time_boot_ms)),
            // Its answers come even where nothing is streamed unasked, as by ArduPilot after its start.
            MavMessage::TIMESYNC(sync) if sync.tc1 > 0 => (&mut self.sync_ms, sync.tc1.unsigned_abs() / 1_000_000),
            _ => return false,
        };
        let restarted = told.saturating_add(RESTART_MS) < *newest;
        *newest = told.max(*newest);
        if restarted {
            let mut new = Self::new(self.target_system, self.target_component, self.firmware);
            std::mem::swap(&mut new, self);
            let before = new;
            (self.heard, self.clock, self.estimate) = (before.heard, before.clock, before.estimate);
            (self.texts, self.events, self.counters) = (before.texts, before.events, before.counters);
            self.estimate.compare_anew();
            self.counters.restarts += 1;
        }
        restarted
    }

    /// No event of this number has come lately.
    pub(super) fn is_new_event(&mut self, sequence: u16) -> bool {
        let new = self.event.is_none_or(|newest| newest.wrapping_sub(sequence) >= EVENTS_AGAIN);
        if new {
            self.event = Some(sequence);
        }
        new
    }

    /// It was heard, and nothing has come lately, or nothing since that says whether it has started again.
    #[must_use]
    pub fn has_fallen_silent(&self, now: Time) -> bool {
        self.unsure || self.heard.is_some_and(|heard| now.since(heard) >= HEARD_S)
    }

    /// By what it last said, its motors may turn or it is in the air.
    #[must_use]
    pub fn may_fly(&self) -> bool {
        self.armed || self.landed == Some(false)
    }

    /// Its heartbeat, or anything else of it, is younger than [`HEARTBEAT_TIMEOUT_S`].
    #[must_use]
    pub fn is_heard(&self, now: Time) -> bool {
        [self.heartbeat, self.heard].iter().flatten().any(|heard| now.since(*heard) < HEARTBEAT_TIMEOUT_S)
    }

    /// On the ground it would refuse to arm, or SYS_STATUS says so: its reasons are worth asking for.
    #[must_use]
    pub fn refuses_to_arm(&self, now: Time) -> bool {
        let status = self.status(now);
        status.connected && !status.armed && (self.arming.bit_is_clear() || status.would_arm == Some(false))
    }

    /// Why it would refuse to arm, in one line; none: it would not, or does not say.
    #[must_use]
    pub fn refusal(&self, now: Time) -> Option<String> {
        let status = self.status(now);
        let refuses = status.connected && status.would_arm == Some(false);
        refuses.then(|| format!("it refuses to arm: {}", self.arming.reasons(now)))
    }
}
