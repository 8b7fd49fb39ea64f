//! How the airframe that flies differs from what the vehicle file says of it.

use goshawk_core::NormalisedThrust;
use serde::Deserialize;
use thiserror::Error;

use super::airframe::{motors_lift, spread};
use crate::vehicle::quadrotor::{LoadParameters, LoopParameters, QuadrotorParameters};

/// How the airframe that flies differs from what the vehicle file says of it; by default not at all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Difference {
    /// Its true mass, kg; the motors stay, so that it hovers at more thrust if it is heavier.
    pub mass_kg: Option<f64>,
    /// The normalised thrust at which it truly hovers, whatever the mass.
    pub hover_thrust: Option<f64>,
    /// In how long its tilt truly covers 63 % of a small step, s.
    pub attitude_lag_s: Option<f64>,
    /// What hangs below it on half a metre of line, kg.
    pub load_kg: Option<f64>,
    /// Relative standard deviation of its parameters, drawn for each flight; 0: none.
    #[serde(skip)]
    pub spread: f64,
}

/// Length of a hanging load's line, m.
const LINE_M: f64 = 0.5;
/// The inner loops cannot be faster than this with the paper's rotors; below it the rotors are quicker too, s.
const QUICK_ROTORS_BELOW_S: f64 = 0.07;

/// A number of the command line that is no true airframe.
#[derive(Debug, Error)]
pub enum DifferenceError {
    /// Not KEY=NUMBER, or no such key.
    #[error("--airframe {0}: give mass_kg, hover_thrust, attitude_lag_s or load_kg, then = and a number")]
    Unknown(String),
    /// Nothing that can fly.
    #[error("--airframe {name} is {value}: it must be {low} to {high}")]
    OutOfRange {
        /// Its key.
        name: &'static str,
        /// What it is.
        value: f64,
        /// The least that flies.
        low: f64,
        /// The most that flies.
        high: f64,
    },
}

impl Difference {
    /// From `KEY=NUMBER` each.
    ///
    /// # Errors
    /// An unknown key, or a value that cannot fly.
    pub fn parse(changes: &[String]) -> Result<Self, DifferenceError> {
        let mut table = toml::Table::new();
        for change in changes {
            let unknown = || DifferenceError::Unknown(change.clone());
            let (key, value) = change.split_once('=').ok_or_else(unknown)?;
            let value: f64 = value.trim().parse().map_err(|_| unknown())?;
            table.insert(key.trim().to_owned(), toml::Value::Float(value));
            Self::deserialize(table.clone()).map_err(|_| unknown())?;
        }
        let parsed = Self::deserialize(table).map_err(|_| DifferenceError::Unknown(changes.join(" ")))?;
        for (name, value, low, high) in [
            ("mass_kg", parsed.mass_kg, 0.1, 10.0),
            ("hover_thrust", parsed.hover_thrust, 0.05, 0.9),
            ("attitude_lag_s", parsed.attitude_lag_s, 0.05, 0.4),
            ("load_kg", parsed.load_kg, 0.001, 5.0),
        ] {
            if let Some(value) = value.filter(|value| !(low..=high).contains(value)) {
                return Err(DifferenceError::OutOfRange { name, value, low, high });
            }
        }
        Ok(parsed)
    }

    /// `nominal` with these differences; what is drawn is drawn from `seed`.
    #[must_use]
    pub fn apply(&self, nominal: &QuadrotorParameters, seed: u64) -> QuadrotorParameters {
        let mut vehicle = spread(nominal, self.spread, seed);
        if let Some(mass_kg) = self.mass_kg {
            let factor = vehicle.mass_kg / mass_kg;
            motors_lift(&mut vehicle, factor);
            vehicle.mass_kg = mass_kg;
        }
        if let Some(hover) = self.hover_thrust {
            vehicle.hover_thrust = NormalisedThrust(hover);
        }
        if let Some(lag_s) = self.attitude_lag_s {
            vehicle.loops = LoopParameters::with_response(lag_s);
            if lag_s < QUICK_ROTORS_BELOW_S {
                vehicle.rotor_lag_s = 0.01;
                vehicle.loops.rate_p = 150.0;
                vehicle.loops.tilt_gain = 1.14 / lag_s;
            }
        }
        vehicle.load = self.load_kg.map(|mass_kg| LoadParameters { mass_kg, line_m: LINE_M });
        vehicle
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_is_read_key_by_key_and_a_bad_one_is_named_in_one_line() {
        let parse = |changes: &[&str]| Difference::parse(&changes.iter().map(|c| (*c).to_owned()).collect::<Vec<_>>());
        let both = parse(&["mass_kg=1.02", "hover_thrust = 0.5"]).unwrap();
        assert_eq!((both.mass_kg, both.hover_thrust, both.load_kg), (Some(1.02), Some(0.5), None));
        assert_eq!(parse(&[]).unwrap(), Difference::default());
        for bad in ["mass", "wings=2", "mass_kg=heavy", "spread=0.1", "mass_kg=99", "hover_thrust=nan"] {
            let message = parse(&[bad]).unwrap_err().to_string();
            assert!(message.contains(bad.split('=').next().unwrap()) && message.lines().count() == 1, "{message}");
        }
    }

    #[test]
    fn a_heavier_vehicle_hovers_at_more_thrust() {
        let nominal = QuadrotorParameters::default();
        let heavy = Difference { mass_kg: Some(1.02), ..Difference::default() }.apply(&nominal, 1);
        assert!(heavy.hover_thrust.0 > 1.1 * nominal.hover_thrust.0);
        assert!((heavy.max_thrust().0 / nominal.max_thrust().0 - 1.0).abs() < 1e-9);
        assert!((heavy.force(heavy.hover_thrust).0 / heavy.weight().0 - 1.0).abs() < 1e-9);
    }
}
