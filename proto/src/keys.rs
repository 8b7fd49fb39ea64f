//! Key expressions and their QoS, generated at build time from `keys.toml`, the table that Rust and Python share.

use std::fmt;
use std::str::FromStr;

/// What every key expression begins with.
pub const PREFIX: &str = "goshawk";

/// How a key is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Published, subscribed.
    Pub,
    /// Asked and answered.
    Query,
    /// A liveliness token.
    Liveliness,
}

/// Who takes part. An operator and an observer are known by their certificate, a sensor by being on the vehicle's host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The onboard process.
    Vehicle,
    /// A camera, an odometry or a simulator.
    Sensor,
    /// Starts, stops and sees.
    Operator,
    /// Sees.
    Observer,
}

/// Zenoh's priority of the same name, most urgent first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Priority {
    RealTime,
    InteractiveHigh,
    InteractiveLow,
    DataHigh,
    Data,
    DataLow,
    Background,
}

/// Zenoh's congestion control of the same name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Congestion {
    /// A message that would wait is dropped whole.
    Drop,
    /// The sender waits: never on a control thread.
    Block,
}

/// One row of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeyRow {
    /// The table's name for it, `snake_case`.
    pub name: &'static str,
    /// What follows `goshawk/{vehicle}/`.
    pub suffix: &'static str,
    /// How it is used.
    pub kind: Kind,
    /// Who publishes, asks or shows itself alive.
    pub from: &'static [Role],
    /// Who subscribes, answers or watches.
    pub to: &'static [Role],
    /// Full name of the payload's message (of the request, for a query); none: an empty payload.
    pub message: Option<&'static str>,
    /// Full name of a query's reply; none for other kinds.
    pub reply: Option<&'static str>,
    /// Zenoh's priority.
    pub priority: Priority,
    /// Zenoh's congestion control.
    pub congestion: Congestion,
    /// Sent at once, not batched.
    pub express: bool,
}

include!(concat!(env!("OUT_DIR"), "/keys.rs"));

impl Key {
    /// The key's row of the table.
    #[must_use]
    pub const fn row(self) -> &'static KeyRow {
        &ROWS[self as usize]
    }

    /// `goshawk/{vehicle}/{suffix}`.
    #[must_use]
    pub fn expression(self, vehicle: &VehicleName) -> String {
        format!("{PREFIX}/{vehicle}/{}", self.row().suffix)
    }

    /// The key and vehicle that an expression without wildcards names; none if it is not in the table.
    #[must_use]
    pub fn parse(expression: &str) -> Option<(Key, VehicleName)> {
        let (vehicle, suffix) = expression.strip_prefix(PREFIX)?.strip_prefix('/')?.split_once('/')?;
        let key = Key::ALL.into_iter().find(|key| key.row().suffix == suffix)?;
        Some((key, vehicle.parse().ok()?))
    }
}

/// A vehicle's name: one or more of `a-z`, `0-9`, `_`, `-`. Never a wildcard, so it cannot widen a key expression.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct VehicleName(String);

/// A vehicle's name has a character that a key expression must not have, or none at all.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("vehicle name {0:?}: use one or more of a-z, 0-9, '_' and '-'")]
pub struct VehicleNameError(pub String);

impl FromStr for VehicleName {
    type Err = VehicleNameError;

    fn from_str(name: &str) -> Result<Self, VehicleNameError> {
        let good = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_' || c == '-';
        if !name.is_empty() && name.chars().all(good) {
            Ok(Self(name.to_owned()))
        } else {
            Err(VehicleNameError(name.to_owned()))
        }
    }
}

impl VehicleName {
    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for VehicleName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use prost::Message as _;
    use std::collections::BTreeSet;

    fn vehicle(name: &str) -> VehicleName {
        name.parse().unwrap()
    }

    #[test]
    fn a_key_expression_has_prefix_vehicle_and_suffix() {
        assert_eq!(Key::Plan.expression(&vehicle("kite-1")), "goshawk/kite-1/tel/plan");
    }

    #[test]
    fn commands_are_urgent_queries_that_are_answered() {
        for key in [Key::CmdStart, Key::CmdStop] {
            let row = key.row();
            assert_eq!((row.kind, row.priority, row.congestion), (Kind::Query, Priority::RealTime, Congestion::Drop));
            assert_eq!(row.reply, Some("goshawk.v1.CommandReply"));
        }
    }

    #[test]
    fn an_operator_alone_commands_and_a_sensor_alone_senses() {
        for key in Key::ALL {
            let row = key.row();
            match row.suffix.split_once('/').map(|(room, _)| room) {
                Some("cmd") => assert_eq!((row.from, row.to), (&[Role::Operator][..], &[Role::Vehicle][..])),
                Some("in") => assert_eq!((row.from, row.to), (&[Role::Sensor][..], &[Role::Vehicle][..])),
                Some("tel") => assert_eq!(row.from, [Role::Vehicle]),
                _ => {}
            }
        }
    }

    #[test]
    fn nothing_published_in_flight_blocks() {
        for key in Key::ALL.into_iter().filter(|key| key.row().kind == Kind::Pub) {
            assert_eq!(key.row().congestion, Congestion::Drop, "{}", key.row().name);
        }
    }

    #[test]
    fn every_row_names_a_message_of_the_descriptor_set() {
        let set = prost_types::FileDescriptorSet::decode(crate::FILE_DESCRIPTOR_SET).unwrap();
        let names: BTreeSet<String> = set
            .file
            .iter()
            .flat_map(|f| f.message_type.iter().map(|m| format!("{}.{}", f.package(), m.name())))
            .collect();
        let named: Vec<&str> = Key::ALL.iter().flat_map(|k| [k.row().message, k.row().reply]).flatten().collect();
        assert!(named.len() > 10);
        for name in named {
            assert!(names.contains(name), "{name}");
        }
    }

    #[test]
    fn names_and_suffixes_are_unique() {
        let names: BTreeSet<_> = Key::ALL.iter().map(|k| k.row().name).collect();
        let suffixes: BTreeSet<_> = Key::ALL.iter().map(|k| k.row().suffix).collect();
        assert_eq!((names.len(), suffixes.len()), (Key::ALL.len(), Key::ALL.len()));
    }

    #[test]
    fn a_wildcard_slash_or_empty_vehicle_name_is_refused() {
        for name in ["", "*", "**", "a/b", "Kite", "a b", "a$*", "é"] {
            assert_eq!(name.parse::<VehicleName>(), Err(VehicleNameError(name.to_owned())));
        }
    }

    #[test]
    fn an_unknown_key_does_not_parse() {
        for expression in ["goshawk/kite", "goshawk/kite/tel/nothing", "hawk/kite/tel/plan", "goshawk/*/tel/plan", ""] {
            assert_eq!(Key::parse(expression), None, "{expression}");
        }
    }

    proptest! {
        #[test]
        fn an_expression_parses_back(name in "[a-z0-9_-]{1,20}", index in 0..Key::ALL.len()) {
            let key = Key::ALL[index];
            prop_assert_eq!(Key::parse(&key.expression(&vehicle(&name))), Some((key, vehicle(&name))));
        }
    }
}
