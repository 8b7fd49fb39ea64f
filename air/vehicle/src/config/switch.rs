//! The vehicle file's `[switch]`.

use schemars::JsonSchema;
use serde::Deserialize;

/// Where the switch stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Position {
    /// Fly: take off, or go on with what is held.
    Start,
    /// Brake, and hold the place.
    Hold,
    /// As the operator's Stop.
    Stop,
}

impl std::fmt::Display for Position {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Position::Start => "start",
            Position::Hold => "hold",
            Position::Stop => "stop",
        })
    }
}

/// Optional: a switch of the pilot's radio that starts, holds and stops.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Eq)]
#[serde(deny_unknown_fields)]
pub struct Switch {
    /// The radio's channel, as the autopilot numbers it.
    #[schemars(range(min = 1, max = 18), extend("x-why" = "RC_CHANNELS tells of 18", "x-source" = "the radio's own mapping"))]
    pub channel: u8,
    /// Pulses that start, µs, least and most: from another position. In flight they let go of a hold.
    #[schemars(inner(range(min = 700, max = 2300)), extend("x-why" = "no receiver puts out more or less", "x-source" = "read them off the radio"))]
    pub start_us: [u16; 2],
    /// Pulses that hold the place; absent: the switch has two positions.
    #[schemars(inner(range(min = 700, max = 2300)), extend("x-why" = "no receiver puts out more or less", "x-source" = "read them off the radio"))]
    pub hold_us: Option<[u16; 2]>,
    /// Pulses that stop. There nobody else starts either.
    #[schemars(inner(range(min = 700, max = 2300)), extend("x-why" = "no receiver puts out more or less", "x-source" = "read them off the radio"))]
    pub stop_us: [u16; 2],
    /// The profile that it starts; absent: the default one.
    pub profile: Option<String>,
}

impl Switch {
    /// The position of a pulse; none: it lies between two.
    #[must_use]
    pub fn position(&self, us: u16) -> Option<Position> {
        let within = |range: &[u16; 2]| (range[0]..=range[1]).contains(&us);
        self.positions().into_iter().find(|(_, _, range)| within(range)).map(|(position, ..)| position)
    }

    fn positions(&self) -> Vec<(Position, &'static str, [u16; 2])> {
        let hold = self.hold_us.map(|range| (Position::Hold, "switch.hold_us", range));
        let ends =
            [(Position::Stop, "switch.stop_us", self.stop_us), (Position::Start, "switch.start_us", self.start_us)];
        ends.into_iter().chain(hold).collect()
    }

    /// Checks what its keys do not say alone.
    pub(super) fn validate(&self) -> Result<(), String> {
        let mut positions = self.positions();
        positions.sort_by_key(|(_, _, range)| *range);
        for (_, key, [least, most]) in &positions {
            if least >= most {
                return Err(format!("{key} is [{least}, {most}]: the first is the least, the second the most"));
            }
        }
        for pair in positions.windows(2) {
            if let [(_, below, [_, most]), (_, above, [least, _])] = pair
                && most >= least
            {
                return Err(format!("{below} and {above} overlap: leave a gap, so that no pulse means both"));
            }
        }
        Ok(())
    }
}
