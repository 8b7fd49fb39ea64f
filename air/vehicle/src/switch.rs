//! A switch of the pilot's radio that starts, holds and stops. Pure: what the radio says goes in, what it asks for comes
//! out, once for each time that a hand moves it.

use goshawk_autopilot::Radio;
use goshawk_core::Time;

use crate::config::{Position, Switch};

/// A position must be told for so long, s: two of the samples that are asked for. Chosen by eye.
const SETTLED_S: f64 = 0.1;
/// A radio that was heard longer ago than this is not heard, s. Chosen by eye.
pub const RADIO_STALE_S: f64 = 1.0;

/// What is known of it.
#[derive(Clone, Copy, Debug, Default)]
pub struct SwitchReader {
    settled: Option<Position>,
    seen: Option<(Position, Time)>,
}

impl SwitchReader {
    /// Looks at what the radio last said; gives the position that the switch was moved to, once.
    ///
    /// Where it was not known where it stood, nobody is taken to have moved it to start or hold: a radio that is switched
    /// on must not take off. A stop counts always.
    pub fn take(&mut self, now: Time, switch: &Switch, radio: Option<&Radio>) -> Option<Position> {
        let Some(position) = reading(now, switch, radio).ok().flatten() else {
            self.seen = None;
            if problem(now, switch, radio).is_some() {
                self.settled = None;
            }
            return None;
        };
        let since = self.seen.filter(|seen| seen.0 == position).map_or(now, |seen| seen.1);
        self.seen = Some((position, since));
        if now.since(since) < SETTLED_S || self.settled == Some(position) {
            return None;
        }
        let before = self.settled.replace(position);
        (before.is_some() || position == Position::Stop).then_some(position)
    }

    /// Where it stands; none: not known.
    #[must_use]
    pub fn position(&self) -> Option<Position> {
        self.settled
    }
}

/// Why the switch cannot be read, in one line; none: it can, or is just between two positions.
#[must_use]
pub fn problem(now: Time, switch: &Switch, radio: Option<&Radio>) -> Option<String> {
    reading(now, switch, radio).err()
}

/// The position that the radio tells; none: it is between two.
fn reading(now: Time, switch: &Switch, radio: Option<&Radio>) -> Result<Option<Position>, String> {
    let channel = switch.channel;
    let Some(radio) = radio else {
        return Err("the autopilot tells nothing of the pilot's radio: see that it has a receiver".to_owned());
    };
    let age = now.since(radio.stamp);
    if age > RADIO_STALE_S {
        return Err(format!("the pilot's radio was last heard {age:.1} s ago: check receiver and link"));
    }
    let index = usize::from(channel).checked_sub(1);
    let pulse = index.and_then(|index| *radio.channels_us.get(index)?);
    let Some(us) = pulse else {
        return Err(format!("channel {channel} of the pilot's radio has no pulse: switch it on, map the channel"));
    };
    Ok(switch.position(us))
}

#[cfg(test)]
mod tests {
    use super::*;
    use goshawk_autopilot::CHANNELS;

    const SWITCH: Switch =
        Switch { channel: 8, start_us: [1750, 2100], hold_us: Some([1400, 1600]), stop_us: [900, 1250], profile: None };

    /// What it asks for while each of these is told for 0.5 s at 20 Hz; 0: no pulse.
    fn asked(pulses: &[u16]) -> Vec<Position> {
        let mut reader = SwitchReader::default();
        let mut asked = Vec::new();
        for step in 0..pulses.len() * 10 {
            let now = Time::from_secs(1.0 + step as f64 * 0.05);
            let mut channels_us = [None; CHANNELS];
            channels_us[7] = Some(pulses[step / 10]).filter(|us| *us != 0);
            asked.extend(reader.take(now, &SWITCH, Some(&Radio { stamp: now, channels_us })));
        }
        asked
    }

    #[test]
    fn each_move_asks_once() {
        assert_eq!(
            asked(&[1000, 1900, 1500, 1900, 1000]),
            [
                Position::Stop, // which it stood at
                Position::Start,
                Position::Hold,
                Position::Start,
                Position::Stop,
            ]
        );
        assert_eq!(asked(&[1500, 1900, 1900, 1900]), [Position::Start]);
    }

    #[test]
    fn a_radio_that_is_switched_on_starts_nothing_wherever_its_switch_stands() {
        assert_eq!(asked(&[1900, 1900]), []);
        assert_eq!(asked(&[0, 1900]), []);
        assert_eq!(asked(&[1000, 1900, 0, 1900]), [Position::Stop, Position::Start], "back after a gap");
        assert_eq!(asked(&[1500, 0, 1500]), []);
        assert_eq!(asked(&[1900, 0, 1000]), [Position::Stop], "a stop counts always");
    }

    #[test]
    fn pulses_between_the_positions_ask_for_nothing_and_forget_nothing() {
        assert_eq!(asked(&[1500, 1300, 1700, 3000, 1500]), []);
        assert_eq!(asked(&[1500, 1700, 1900]), [Position::Start]);
    }

    #[test]
    fn a_glitch_asks_for_nothing() {
        let mut reader = SwitchReader::default();
        for step in 0..100 {
            let now = Time::from_secs(f64::from(step) * 0.05);
            let mut channels_us = [None; CHANNELS];
            channels_us[7] = Some(if step % 20 == 19 { 1900 } else { 1500 });
            assert_eq!(reader.take(now, &SWITCH, Some(&Radio { stamp: now, channels_us })), None);
        }
        assert_eq!(reader.position(), Some(Position::Hold));
    }

    #[test]
    fn what_keeps_it_from_being_read_is_named() {
        let now = Time::from_secs(10.0);
        let mut radio = Radio { stamp: now, channels_us: [Some(1500); CHANNELS] };
        assert_eq!(problem(now, &SWITCH, Some(&radio)), None);
        assert!(problem(now, &SWITCH, None).is_some_and(|why| why.contains("receiver")));
        assert!(problem(now.plus(3.0), &SWITCH, Some(&radio)).is_some_and(|why| why.contains("3.0 s ago")));
        radio.channels_us[7] = None;
        assert!(problem(now, &SWITCH, Some(&radio)).is_some_and(|why| why.contains("channel 8")));
        let none = Switch { channel: 0, ..SWITCH };
        assert!(problem(now, &none, Some(&radio)).is_some(), "the file's range excludes it; no panic");
    }
}
