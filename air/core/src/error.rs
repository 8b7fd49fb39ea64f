//! What can be wrong with a configuration. The core has no other errors: with a valid configuration it always answers.

/// A configuration value that the core cannot fly with.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// The value is NaN, infinite or outside its range.
    #[error("{name} is {value}; it must be {need}")]
    OutOfRange {
        /// Dotted path of the field, as in the vehicle file.
        name: &'static str,
        /// What it is.
        value: f64,
        /// What it must be.
        need: &'static str,
    },
    /// Two values contradict each other.
    #[error("{0}")]
    Contradiction(&'static str),
}

/// `value` must be finite and satisfy `ok`.
pub(crate) fn check(
    name: &'static str,
    value: f64,
    need: &'static str,
    ok: impl Fn(f64) -> bool,
) -> Result<(), ConfigError> {
    if value.is_finite() && ok(value) { Ok(()) } else { Err(ConfigError::OutOfRange { name, value, need }) }
}

/// `value` must be finite and above zero.
pub(crate) fn positive(name: &'static str, value: f64) -> Result<(), ConfigError> {
    check(name, value, "finite and above 0", |v| v > 0.0)
}

/// `value` must be finite and not below zero.
pub(crate) fn not_negative(name: &'static str, value: f64) -> Result<(), ConfigError> {
    check(name, value, "finite and not below 0", |v| v >= 0.0)
}
