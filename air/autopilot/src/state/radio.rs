//! The pilot's radio as the autopilot hears it.

use crate::messages::RC_CHANNELS_DATA;
use goshawk_core::Time;

/// Channels that RC_CHANNELS has room for.
pub const CHANNELS: usize = 18;

/// What the receiver last put out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Radio {
    /// When it came.
    pub stamp: Time,
    /// Pulse widths of channels 1 to 18, µs; none: the receiver has no such channel, or hears nothing.
    pub channels_us: [Option<u16>; CHANNELS],
}

impl Radio {
    /// The message that arrived `now`. A channel that is not used is 65535 on the wire, or above the count; ArduPilot
    /// puts 0 into those.
    #[must_use]
    pub(crate) fn of(now: Time, m: &RC_CHANNELS_DATA) -> Self {
        let raw = [
            m.chan1_raw,
            m.chan2_raw,
            m.chan3_raw,
            m.chan4_raw,
            m.chan5_raw,
            m.chan6_raw,
            m.chan7_raw,
            m.chan8_raw,
            m.chan9_raw,
            m.chan10_raw,
            m.chan11_raw,
            m.chan12_raw,
            m.chan13_raw,
            m.chan14_raw,
            m.chan15_raw,
            m.chan16_raw,
            m.chan17_raw,
            m.chan18_raw,
        ];
        let mut channels_us = raw.map(|us| Some(us).filter(|us| !matches!(*us, 0 | u16::MAX)));
        channels_us[usize::from(m.chancount).min(CHANNELS)..].fill(None);
        Self { stamp: now, channels_us }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_beyond_the_count_or_without_a_pulse_is_none() {
        let message = RC_CHANNELS_DATA {
            chancount: 4,
            chan1_raw: 1500,
            chan2_raw: u16::MAX,
            chan3_raw: 0,
            chan4_raw: 2000,
            chan5_raw: 1900,
            ..RC_CHANNELS_DATA::DEFAULT
        };
        let radio = Radio::of(Time(1), &message);
        assert_eq!(radio.channels_us[..5], [Some(1500), None, None, Some(2000), None]);
        let none = Radio::of(Time(1), &RC_CHANNELS_DATA { chancount: 0, ..message });
        assert_eq!(none.channels_us, [None; CHANNELS], "the receiver hears nothing");
        let many = Radio::of(Time(1), &RC_CHANNELS_DATA { chancount: 255, ..message });
        assert_eq!(many.channels_us[4], Some(1900));
    }
}
