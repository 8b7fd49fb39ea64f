//! The airframe as the controller sees it.

use crate::values::error::{ConfigError, within};
use crate::values::types::{GRAVITY, Newtons, NormalisedThrust};
use schemars::JsonSchema;
use serde::Deserialize;

/// What is measured of the airframe. Weigh it, and hover it once by hand.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Airframe {
    /// Take-off mass with battery, kg.
    #[schemars(range(min = 0.05, max = 25.0), extend("x-why" = "the loops are made for small quadrotors", "x-source" = "weigh it; shipped: the paper's vehicle"))]
    pub mass_kg: f64,
    /// Normalised thrust that hovers, 0..1, at full battery. The estimate in flight begins here.
    #[schemars(range(min = 0.05, max = 0.9), extend("x-why" = "with more, too little is left to climb and turn", "x-source" = "a hover by hand; shipped: the simulated vehicle's, which is made by this file"))]
    pub hover_thrust: f64,
    /// What the hover thrust that is learnt in flight may come to, from an empty vehicle with a full battery to a loaded one
    /// with an empty battery.
    #[schemars(inner(range(min = 0.01, max = 0.99)), extend("x-why" = "the range must hold hover_thrust and leave room to min_thrust and max_thrust", "x-source" = "chosen by eye"))]
    pub hover_thrust_range: [f64; 2],
    /// Least normalised thrust in flight; it keeps attitude authority.
    #[schemars(range(min = 0.005, max = 0.9), extend("x-why" = "less loses attitude authority, more than hover_thrust cannot descend", "x-source" = "chosen by eye"))]
    pub min_thrust: f64,
    /// Most normalised thrust in flight; what is left is for the attitude.
    #[schemars(range(min = 0.1, max = 1.0), extend("x-why" = "it must climb, and 1 is all that there is", "x-source" = "chosen by eye"))]
    pub max_thrust: f64,
    /// Largest commanded tilt, degrees. At 65 degrees the thrust that holds the height is 2.4 times the weight.
    #[schemars(range(min = 5.0, max = 79.9), extend("x-why" = "with less it cannot brake, near 90 no thrust holds the height", "x-source" = "tried, notebook, What mattered: Tilt and detours"))]
    pub max_tilt_deg: f64,
    /// First-order lag of the attitude loop, s. The estimate in flight begins here.
    #[schemars(range(min = 0.01, max = 1.0), extend("x-why" = "a slower attitude loop cannot be led", "x-source" = "a step in the log; shipped: the simulated vehicle's, which is made by this file"))]
    pub attitude_lag_s: f64,
    /// What the lag that is learnt in flight may come to, s.
    #[schemars(inner(range(min = 0.01, max = 1.0)), extend("x-why" = "the range must hold attitude_lag_s, and a slower loop cannot be led", "x-source" = "chosen by eye"))]
    pub attitude_lag_range_s: [f64; 2],
}

impl Airframe {
    /// Checks what no key says alone.
    pub(crate) fn validate(&self) -> Result<(), ConfigError> {
        let hover = self.hover_thrust;
        let flies = "less loses attitude authority, more than hover_thrust cannot descend";
        within("airframe.min_thrust", self.min_thrust, 0.005..=hover, flies)?;
        within(
            "airframe.max_thrust",
            self.max_thrust,
            hover + 0.05..=1.0,
            "it must climb, and 1 is all that there is",
        )?;
        let holds = "the range must hold hover_thrust and leave room to min_thrust and max_thrust";
        let [least, most] = self.hover_thrust_range;
        within("airframe.hover_thrust_range", least, self.min_thrust + 0.005..=hover, holds)?;
        within("airframe.hover_thrust_range", most, hover..=self.max_thrust - 0.01, holds)?;
        let ([least, most], lag) = (self.attitude_lag_range_s, self.attitude_lag_s);
        let holds = "the range must hold attitude_lag_s, and a slower loop cannot be led";
        within("airframe.attitude_lag_range_s", least, 0.01..=lag, holds)?;
        within("airframe.attitude_lag_range_s", most, lag.max(1.0001 * least)..=1.0, holds)
    }

    /// Normalised thrust for a collective force, clamped to 0..=`max_thrust`.
    #[must_use]
    pub fn normalised(&self, force: Newtons) -> NormalisedThrust {
        NormalisedThrust((force.0 / (self.mass_kg * GRAVITY) * self.hover_thrust).clamp(0.0, self.max_thrust))
    }

    /// The level acceleration that the greatest tilt gives while the height is held, m/s².
    #[must_use]
    pub fn level_acc(&self) -> f64 {
        GRAVITY * self.max_tilt_deg.to_radians().tan()
    }

    /// Collective force of a normalised thrust.
    #[must_use]
    pub fn force(&self, thrust: NormalisedThrust) -> Newtons {
        Newtons(thrust.0 / self.hover_thrust * self.mass_kg * GRAVITY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;

    #[test]
    fn normalised_thrust_hovers_at_the_weight_and_is_clamped() {
        let vehicle = shipped::controller().airframe;
        let weight = Newtons(0.85 * GRAVITY);
        assert!((vehicle.normalised(weight).0 - 0.25).abs() < 1e-12);
        assert!((vehicle.force(vehicle.normalised(weight)).0 - weight.0).abs() < 1e-12);
        assert_eq!(vehicle.normalised(Newtons(1e6)).0, 1.0);
        assert_eq!(vehicle.normalised(Newtons(-1.0)).0, 0.0);
    }
}
