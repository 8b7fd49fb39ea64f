//! Collective force and torque to four rotor forces, within what the rotors can give: tilt first, then collective,
//! yaw last.

use goshawk_core::Vec3;

/// Rotors in X: front left, front right, rear right, rear left.
const X: [f64; 4] = [1.0, 1.0, -1.0, -1.0];
const Y: [f64; 4] = [1.0, -1.0, -1.0, 1.0];
/// Sign of the reaction torque about body z.
const SPIN: [f64; 4] = [-1.0, 1.0, -1.0, 1.0];

/// Geometry of the rotors.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mixer {
    /// Distance of a rotor from each of the body's horizontal axes, m.
    lever_m: f64,
    /// Reaction torque over thrust, m.
    yaw_torque_m: f64,
}

/// Four rotor forces and whether they are less than was asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mixed {
    /// Newtons, each within the limits.
    pub(super) force_n: [f64; 4],
    /// The demand could not be met whole.
    pub(super) saturated: bool,
}

impl Mixer {
    pub(super) fn new(arm_m: f64, yaw_torque_m: f64) -> Self {
        Self { lever_m: arm_m * std::f64::consts::FRAC_1_SQRT_2, yaw_torque_m }
    }

    /// Rotor forces for a collective force, N, and a body torque, N m; each force ends in `min_n..=max_n`.
    pub(super) fn mix(&self, collective_n: f64, torque_body: Vec3, min_n: f64, max_n: f64) -> Mixed {
        let mut saturated = false;
        let per_lever = 0.25 / self.lever_m;
        let mut tilt = [0.0; 4];
        for (i, t) in tilt.iter_mut().enumerate() {
            *t = (torque_body.x * Y[i] - torque_body.y * X[i]) * per_lever;
        }
        let (low, high) = bounds(&tilt);
        let range = high - low;
        if range > max_n - min_n {
            let scale = (max_n - min_n) / range;
            tilt.iter_mut().for_each(|t| *t *= scale);
            saturated = true;
        }
        let (low, high) = bounds(&tilt);
        let wanted = 0.25 * collective_n;
        let base = wanted.min(max_n - high).max(min_n - low);
        saturated |= (base - wanted).abs() > 1e-9;

        // Yaw takes what is left on the tightest rotor.
        let yaw_unit = 0.25 / self.yaw_torque_m;
        let mut yaw = torque_body.z * yaw_unit;
        let mut room = f64::INFINITY;
        for i in 0..4 {
            let force = base + tilt[i];
            room = room.min(if SPIN[i] * yaw > 0.0 { max_n - force } else { force - min_n });
        }
        let room = room.max(0.0);
        if yaw.abs() > room {
            yaw = room.copysign(yaw);
            saturated = true;
        }
        let mut force_n = [0.0; 4];
        for (i, f) in force_n.iter_mut().enumerate() {
            *f = (base + tilt[i] + SPIN[i] * yaw).clamp(min_n, max_n);
        }
        Mixed { force_n, saturated }
    }

    /// Collective force, N, and body torque, N m, of four rotor forces.
    pub(super) fn wrench(&self, force_n: &[f64; 4]) -> (f64, Vec3) {
        let mut torque = Vec3::zeros();
        for i in 0..4 {
            torque.x += Y[i] * self.lever_m * force_n[i];
            torque.y -= X[i] * self.lever_m * force_n[i];
            torque.z += SPIN[i] * self.yaw_torque_m * force_n[i];
        }
        (force_n.iter().sum(), torque)
    }
}

fn bounds(values: &[f64; 4]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_unsaturated_demand_is_met_exactly() {
        let mixer = Mixer::new(0.0775, 0.016);
        let torque = Vec3::new(0.1, -0.05, 0.02);
        let mixed = mixer.mix(12.0, torque, 0.0, 9.0);
        let (collective, got) = mixer.wrench(&mixed.force_n);
        assert!(!mixed.saturated);
        assert!((collective - 12.0).abs() < 1e-9 && (got - torque).norm() < 1e-9);
    }

    #[test]
    fn yaw_is_given_up_before_tilt() {
        let mixer = Mixer::new(0.0775, 0.016);
        let mixed = mixer.mix(8.0, Vec3::new(0.3, 0.0, 1.0), 0.0, 9.0);
        let (_, got) = mixer.wrench(&mixed.force_n);
        assert!(mixed.saturated && (got.x - 0.3).abs() < 1e-9 && got.z < 0.2);
    }

    proptest! {
        #[test]
        fn rotor_forces_stay_within_limits(
            collective in -5.0..80.0f64,
            x in -3.0..3.0f64, y in -3.0..3.0f64, z in -1.0..1.0f64,
        ) {
            let mixed = Mixer::new(0.0775, 0.016).mix(collective, Vec3::new(x, y, z), 0.1, 9.8);
            prop_assert!(mixed.force_n.iter().all(|f| (0.1..=9.8).contains(f)));
        }
    }
}
