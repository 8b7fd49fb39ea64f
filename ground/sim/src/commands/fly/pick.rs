//! Single flights of a campaign: how they are named, chosen, and flown again.

use std::fmt;
use std::str::FromStr;

/// A flight of a campaign, written `CELL:TRIAL`, both from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Pick {
    /// The cell, as the table numbers them.
    pub cell: usize,
    /// The flight in it.
    pub trial: usize,
}

impl fmt::Display for Pick {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.cell, self.trial)
    }
}

impl FromStr for Pick {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.split_once(':').and_then(|(cell, trial)| {
            Some(Self { cell: cell.trim().parse().ok()?, trial: trial.trim().parse().ok()? })
        });
        parsed.ok_or_else(|| format!("{text:?} is not CELL:TRIAL, as in 0:3"))
    }
}

/// What only says where to write, how fast to fly and which flights: no part of what a flight is.
const NOT_REPEATED: [&str; 6] = ["--only", "--json", "--log", "--threads", "--records", "--from"];

/// The command line of `arguments` (the program first) without those that do not change a flight, for a shell.
#[must_use]
pub fn command(arguments: impl IntoIterator<Item = String>) -> String {
    let mut kept: Vec<String> = Vec::new();
    let mut arguments = arguments.into_iter();
    while let Some(argument) = arguments.next() {
        if NOT_REPEATED.contains(&argument.as_str()) {
            arguments.next();
        } else if !NOT_REPEATED.iter().any(|name| argument.strip_prefix(name).is_some_and(|r| r.starts_with('='))) {
            kept.push(quoted(argument));
        }
    }
    kept.join(" ")
}

/// For a shell.
pub(crate) fn quoted(argument: String) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_=+./,:@%".contains(c);
    if !argument.is_empty() && argument.chars().all(plain) {
        argument
    } else {
        format!("'{}'", argument.replace('\'', r"'\''"))
    }
}

/// The command that flies one flight again, with its log.
#[must_use]
pub fn again(command: &str, pick: Pick) -> String {
    format!("{command} --only {pick} --log flight-{}-{}", pick.cell, pick.trial)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pick_reads_as_it_is_written() {
        assert_eq!("0:3".parse(), Ok(Pick { cell: 0, trial: 3 }));
        assert_eq!(Pick { cell: 12, trial: 0 }.to_string(), "12:0");
        for wrong in ["", "3", "a:1", "1:-1", "1:2:3"] {
            assert!(wrong.parse::<Pick>().unwrap_err().contains("CELL:TRIAL"), "{wrong}");
        }
    }

    #[test]
    fn the_command_repeats_what_a_flight_depends_on() {
        let line =
            "sim/goshawk-sim fly --task track --only 1:2 --speed=3,5 --json=a.json --log old --wind 2 --threads 1";
        let arguments =
            line.split(' ').map(str::to_owned).chain(["--policy".to_owned(), "my policy's.onnx".to_owned()]);
        let command = command(arguments);
        assert_eq!(command, r"sim/goshawk-sim fly --task track --speed=3,5 --wind 2 --policy 'my policy'\''s.onnx'");
        assert!(again(&command, Pick { cell: 1, trial: 2 }).ends_with("--only 1:2 --log flight-1-2"));
    }
}
