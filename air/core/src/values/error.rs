//! What can be wrong with a configuration. The core has no other errors: with a valid configuration it always answers.

use std::ops::RangeInclusive;

/// A configuration value that the core cannot fly with.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// The value is NaN, infinite or outside its range.
    #[error("{name} is {value}; it must be {low} to {high}: {why}{hint}")]
    OutOfRange {
        /// The key, dotted, as in the vehicle file.
        name: String,
        /// What it is, in the key's unit.
        value: f64,
        /// The least that it may be.
        low: f64,
        /// The most that it may be.
        high: f64,
        /// What is wrong with more, or with less.
        why: String,
        /// The mistaken unit that would explain the value; empty: none would.
        hint: &'static str,
    },
    /// Two values contradict each other.
    #[error("{0}")]
    Contradiction(&'static str),
}

/// `value` must lie in `range`. There is no other check of a number, so that none goes without an upper bound: a limit
/// that is never reached limits nothing. `name` is the vehicle file's key and `why` the reason for the bounds.
///
/// # Errors
/// It does not, or is not a number.
pub fn within(name: &str, value: f64, range: RangeInclusive<f64>, why: &str) -> Result<(), ConfigError> {
    if range.contains(&value) {
        return Ok(());
    }
    let hint = mistaken_unit(name, value, &range);
    let (low, high) = range.into_inner();
    Err(ConfigError::OutOfRange { name: name.to_owned(), value, low, high, why: why.to_owned(), hint })
}

/// The question to ask whoever typed `value`: in which unit it would have been within its range. Empty: in none.
fn mistaken_unit(name: &str, value: f64, range: &RangeInclusive<f64>) -> &'static str {
    /// A unit's ending, how much smaller the mistaken unit is, and the question.
    const SMALLER: [(&str, f64, &str); 5] = [
        ("_s", 1e-3, "; seconds, not milliseconds?"),
        ("_m", 1e-3, "; metres, not millimetres?"),
        ("_kg", 1e-3, "; kilograms, not grams?"),
        ("_radps", std::f64::consts::PI / 180.0, "; radians, not degrees?"),
        ("", 1e-2, "; a share of 1, not per cent?"),
    ];
    let (low, high) = (*range.start(), *range.end());
    let share = 0.0 <= low && high <= 1.0;
    SMALLER
        .into_iter()
        .find(|(unit, factor, _)| {
            name.ends_with(unit) && (!unit.is_empty() || share) && range.contains(&(value * factor))
        })
        .map_or("", |(_, _, hint)| hint)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_without_bounds_is_never_within_them() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -0.1, 2.1] {
            let error = within("x.age_s", value, 0.0..=2.0, "older ones mislead").unwrap_err().to_string();
            assert!(error.starts_with("x.age_s is ") && error.contains("0 to 2: older ones mislead"), "{error}");
        }
        assert_eq!(within("x.age_s", 2.0, 0.0..=2.0, ""), Ok(()));
    }

    #[test]
    fn a_value_in_a_smaller_unit_is_told_from_one_that_is_merely_too_large() {
        for (name, value, high, hint) in [
            ("age_s", 200.0, 0.5, "milliseconds"),
            ("radius_m", 20_000.0, 1000.0, "millimetres"),
            ("mass_kg", 850.0, 25.0, "grams"),
            ("rate_radps", 170.0, 10.0, "degrees"),
            ("battery", 20.0, 1.0, "per cent"),
        ] {
            assert!(mistaken_unit(name, value, &(0.0..=high)).contains(hint), "{name}");
            assert_eq!(mistaken_unit(name, 1e9, &(0.0..=high)), "", "{name}");
        }
        assert_eq!(mistaken_unit("kp", 25.0, &(0.1..=20.0)), "");
    }
}
