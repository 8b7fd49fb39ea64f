//! Yaw against motion: whoever tilts to one side must accelerate to that side.

use crate::values::types::Vec3;
use std::f64::consts::PI;

/// Length of a block, s: single velocities are too noisy to tell an acceleration. Chosen by eye.
const BLOCK: f64 = 0.1;
/// What is steady is taken out with this time constant, s: wind, drag, a tilt that is a little off. Chosen by eye.
const STEADY: f64 = 2.0;
/// Time constant of the sums, s. Chosen by eye.
const SUMS: f64 = 1.0;
/// The modelled acceleration must vary by so much, ∫ |u|² dt in m²/s³, before it tells anything. Chosen by eye.
const EXCITED: f64 = 0.5;
/// And the motion must be it, turned: amplitude over the model's. It was 0.5, and a gust that is leaned against late
/// passed for a wrong heading.
const GAIN: f64 = 0.7;
/// And the share that the turned model explains. It was 0.6, with the same fault.
const COHERENCE: f64 = 0.7;
/// For so many blocks in a row: a gust that is leaned against late looks like it for a moment. Chosen by eye.
const BLOCKS: u32 = 3;
/// By more than this, rad: less still flies, and is the attitude loop's own business. Chosen by eye.
const AWAY: f64 = PI / 3.0;

/// The regression of the acceleration on the modelled one, as complex numbers of the plane.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Heading {
    time: f64,
    model: [f64; 2],
    motion: [f64; 2],
    steady: Option<[[f64; 2]; 2]>,
    /// ∫ |u|², |v̇|², u · v̇, u × v̇.
    sums: [f64; 4],
    /// Blocks in a row whose end found it turned away.
    away: u32,
}

impl Heading {
    /// Takes `dt` s. Returns whether the motion is turned away from the model at the end of a block.
    pub(super) fn step(&mut self, dt: f64, acc_model: Vec3, changed: Vec3) -> bool {
        self.time += dt;
        for axis in 0..2 {
            self.model[axis] += acc_model[axis] * dt;
            self.motion[axis] += changed[axis];
        }
        if self.time < BLOCK {
            return false;
        }
        let time = std::mem::take(&mut self.time);
        let block = [std::mem::take(&mut self.model), std::mem::take(&mut self.motion)].map(|v| v.map(|x| x / time));
        let share = 1.0 - (-time / STEADY).exp();
        let steady = self.steady.get_or_insert(block);
        for (steady, block) in steady.iter_mut().flatten().zip(block.iter().flatten()) {
            *steady += (block - *steady) * share;
        }
        let [u, w] = [0, 1].map(|i| [0, 1].map(|axis| block[i][axis] - steady[i][axis]));
        let products = [
            u[0] * u[0] + u[1] * u[1],
            w[0] * w[0] + w[1] * w[1],
            u[0] * w[0] + u[1] * w[1],
            u[0] * w[1] - u[1] * w[0],
        ];
        let keep = (-time / SUMS).exp();
        for (sum, product) in self.sums.iter_mut().zip(products) {
            *sum = *sum * keep + product * time;
        }
        self.away = if self.is_away() { self.away + 1 } else { 0 };
        self.away >= BLOCKS
    }

    /// The last block found it turned away, which is not enough by itself.
    pub(super) fn is_suspected(&self) -> bool {
        self.away > 0
    }

    /// By how much the motion is turned away from the model, rad, anticlockwise; 0 as long as nothing is known.
    pub(super) fn turn(&self) -> f64 {
        let [_, _, along, across] = self.sums;
        across.atan2(along)
    }

    fn is_away(&self) -> bool {
        let [uu, ww, along, across] = self.sums;
        let common = along.hypot(across);
        uu > EXCITED && common > GAIN * uu && common * common > COHERENCE * uu * ww && across.atan2(along).abs() > AWAY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 5 s of a level acceleration that sways by `amplitude` m/s² while the motion is it, turned by `turn` rad, on top of
    /// a steady wind. Whether it is ever found to be turned away.
    fn away(turn: f64, amplitude: f64) -> bool {
        let mut heading = Heading::default();
        (0..500).any(|k| {
            let t = 0.01 * f64::from(k);
            let (x, y) = (amplitude * (2.0 * t).sin(), amplitude * (3.1 * t).cos());
            let motion = Vec3::new(x * turn.cos() - y * turn.sin(), x * turn.sin() + y * turn.cos(), 0.0);
            heading.step(0.01, Vec3::new(x, y, 0.0), (motion + Vec3::new(1.5, -0.5, 0.2)) * 0.01)
        })
    }

    #[test]
    fn a_heading_that_is_90_or_180_degrees_wrong_shows_as_soon_as_the_vehicle_tilts() {
        for turn in [-PI / 2.0, PI / 2.0, 2.5, PI] {
            assert!(away(turn, 1.5) && !away(turn, 0.2), "{turn}");
        }
    }

    #[test]
    fn a_heading_that_is_a_little_off_flies() {
        for turn in [-0.6, -0.2, 0.0, 0.3, 0.6] {
            assert!(!away(turn, 1.5) && !away(turn, 6.0), "{turn}");
        }
    }
}
