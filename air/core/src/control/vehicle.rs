//! The airframe as the controller sees it.

use crate::values::types::{GRAVITY, Newtons, NormalisedThrust};

/// Mass, thrust and tilt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleModel {
    /// Take-off mass, kg (0.85).
    pub mass: f64,
    /// Normalised thrust that hovers, 0..1; where the estimate begins.
    pub hover_thrust: f64,
    /// Least normalised thrust in flight; keeps attitude authority (0.05).
    pub min_thrust: f64,
    /// Most normalised thrust in flight, up to 1.
    pub max_thrust: f64,
    /// Largest commanded tilt, rad (45 deg); below 80 deg.
    pub max_tilt: f64,
}

impl VehicleModel {
    /// Normalised thrust for a collective force, clamped to 0..=`max_thrust`.
    #[must_use]
    pub fn normalised(&self, force: Newtons) -> NormalisedThrust {
        NormalisedThrust((force.0 / (self.mass * GRAVITY) * self.hover_thrust).clamp(0.0, self.max_thrust))
    }

    /// Collective force of a normalised thrust.
    #[must_use]
    pub fn force(&self, thrust: NormalisedThrust) -> Newtons {
        Newtons(thrust.0 / self.hover_thrust * self.mass * GRAVITY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normalised_thrust_hovers_at_the_weight_and_is_clamped() {
        let vehicle = VehicleModel { mass: 0.85, hover_thrust: 0.25, min_thrust: 0.03, max_thrust: 1.0, max_tilt: 0.8 };
        let weight = Newtons(0.85 * GRAVITY);
        assert!((vehicle.normalised(weight).0 - 0.25).abs() < 1e-12);
        assert!((vehicle.force(vehicle.normalised(weight)).0 - weight.0).abs() < 1e-12);
        assert_eq!(vehicle.normalised(Newtons(1e6)).0, 1.0);
        assert_eq!(vehicle.normalised(Newtons(-1.0)).0, 0.0);
    }
}
