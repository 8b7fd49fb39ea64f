//! What a quadrotor is made of: the numbers of the rigid body, the rotors, the battery and the inner loops.

use super::load::LoadParameters;
use goshawk_core::{GRAVITY, Newtons, NormalisedThrust, Vec3};

/// A quadrotor's physical numbers and the gains of its autopilot's inner loops.
#[derive(Clone, Debug, PartialEq)]
pub struct QuadrotorParameters {
    /// Take-off mass, kg.
    pub mass_kg: f64,
    /// Diagonal of the inertia about the centre of mass, body axes, kg m².
    pub inertia_kgm2: Vec3,
    /// Centre to rotor axis, m; half the wheelbase.
    pub arm_m: f64,
    /// Most static thrust of all four rotors on a full, unloaded battery over the weight.
    pub thrust_to_weight: f64,
    /// First-order lag of a rotor's speed, s.
    pub rotor_lag_s: f64,
    /// Reaction torque of a rotor over its thrust, m.
    pub yaw_torque_m: f64,
    /// Rotor drag along the body's axes, linear in airspeed, N/(m/s).
    pub rotor_drag_npmps: Vec3,
    /// Body drag: force over airspeed squared, N/(m/s)².
    pub body_drag_npmps2: f64,
    /// Centre of mass above the ground when standing, m.
    pub leg_m: f64,
    /// Coulomb friction of the feet on the ground.
    pub ground_friction: f64,
    /// Normalised thrust at which the vehicle hovers on a full, unloaded battery, 0..1. With `thrust_to_weight` this
    /// fixes the curve from normalised thrust to force: force fraction = u^p.
    pub hover_thrust: NormalisedThrust,
    /// How the pack sags.
    pub battery: BatteryParameters,
    /// Attitude and rate loops.
    pub loops: LoopParameters,
    /// What hangs below; none: nothing.
    pub load: Option<LoadParameters>,
}

/// How the battery's state limits thrust.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatteryParameters {
    /// How long a full pack hovers, s.
    pub hover_endurance_s: f64,
    /// Fraction of the voltage lost between a full and an empty pack, open circuit.
    pub discharge_drop: f64,
    /// Fraction of the voltage lost across the pack's resistance at full power.
    pub load_drop: f64,
}

/// Gains of the attitude loop (quaternion P) and the rate loop (PID), in units of the body's motion: they do not change
/// with mass or inertia.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopParameters {
    /// Roll and pitch: rate demanded for an angle, 1/s.
    pub tilt_gain: f64,
    /// Yaw: rate demanded for an angle, 1/s.
    pub yaw_gain: f64,
    /// Most demanded roll and pitch rate, rad/s.
    pub tilt_rate_max_radps: f64,
    /// Most demanded yaw rate, rad/s.
    pub yaw_rate_max_radps: f64,
    /// Rate loop, proportional: angular acceleration for a rate error, 1/s.
    pub rate_p: f64,
    /// Rate loop, integral, 1/s².
    pub rate_i: f64,
    /// Rate loop, derivative on the measured rate, without unit.
    pub rate_d: f64,
    /// Cut-off of the derivative's low-pass filter, Hz.
    pub rate_d_cutoff_hz: f64,
    /// Most angular acceleration that the integrator may ask for, rad/s².
    pub integral_max_radps2: f64,
}

impl LoopParameters {
    /// Loops whose tilt covers 63 % of a small step in about `response_s` (0.07 to 0.4 s): 0.08 is a racing quad,
    /// 0.26 is what was measured on a stock PX4 model.
    #[must_use]
    pub fn with_response(response_s: f64) -> Self {
        // The attitude loop's own 1 / gain and the 47 ms of rate loop and rotors behind it add in squares: fitted to
        // the default rate loop and rotors, within 5 %.
        let own_s = (response_s * response_s - 0.0022).max(0.0025).sqrt();
        let tilt_gain = 1.0 / own_s;
        Self { tilt_gain, ..Self::default() }
    }
}

impl Default for LoopParameters {
    fn default() -> Self {
        Self {
            tilt_gain: 15.0,
            yaw_gain: 6.0,
            tilt_rate_max_radps: 12.0,
            yaw_rate_max_radps: 4.0,
            rate_p: 70.0,
            rate_i: 20.0,
            rate_d: 1.5,
            rate_d_cutoff_hz: 80.0,
            integral_max_radps2: 40.0,
        }
    }
}

impl Default for QuadrotorParameters {
    /// The paper's vehicle: 155 mm, 850 g, thrust-to-weight 4.7.
    fn default() -> Self {
        Self {
            mass_kg: 0.85,
            inertia_kgm2: Vec3::new(1.5e-3, 1.7e-3, 2.6e-3),
            arm_m: 0.0775,
            thrust_to_weight: 4.7,
            rotor_lag_s: 0.033,
            yaw_torque_m: 0.016,
            rotor_drag_npmps: Vec3::new(0.20, 0.20, 0.10),
            body_drag_npmps2: 0.008,
            leg_m: 0.06,
            ground_friction: 0.7,
            hover_thrust: NormalisedThrust(0.4),
            battery: BatteryParameters { hover_endurance_s: 420.0, discharge_drop: 0.14, load_drop: 0.10 },
            loops: LoopParameters::default(),
            load: None,
        }
    }
}

impl QuadrotorParameters {
    /// Weight.
    #[must_use]
    pub fn weight(&self) -> Newtons {
        Newtons(self.mass_kg * GRAVITY)
    }

    /// Most collective thrust on a full, unloaded battery.
    #[must_use]
    pub fn max_thrust(&self) -> Newtons {
        Newtons(self.thrust_to_weight * self.weight().0)
    }

    /// Exponent p of the curve force / max = u^p that hovers at `hover_thrust`.
    #[must_use]
    pub fn thrust_exponent(&self) -> f64 {
        (1.0 / self.thrust_to_weight).ln() / self.hover_thrust.0.ln()
    }

    /// Static force for a normalised thrust on a full, unloaded battery.
    #[must_use]
    pub fn force(&self, thrust: NormalisedThrust) -> Newtons {
        Newtons(self.max_thrust().0 * thrust.0.clamp(0.0, 1.0).powf(self.thrust_exponent()))
    }

    /// The normalised thrust that gives a static force on a full, unloaded battery.
    #[must_use]
    pub fn normalised(&self, force: Newtons) -> NormalisedThrust {
        NormalisedThrust((force.0 / self.max_thrust().0).clamp(0.0, 1.0).powf(1.0 / self.thrust_exponent()))
    }
}
