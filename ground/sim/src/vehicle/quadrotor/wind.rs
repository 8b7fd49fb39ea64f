//! Seeded wind: a constant part and turbulence of the Dryden spectrum at low altitude (MIL-F-8785C).

use goshawk_core::Vec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Scale lengths along, across and up, m: h / (0.177 + 0.000823 h)^1.2 twice and h, in feet, at h = 6 ft.
const SCALE_M: [f64; 3] = [14.0, 14.0, 1.8];
/// Standard deviations over the wind 6 m up: 0.1 upward, and 0.1 / (0.177 + 0.000823 h)^0.4 along and across.
const STRENGTH: [f64; 3] = [0.2, 0.2, 0.1];
/// The mean wind over the speed that gusts reach: mean and two standard deviations along it make the whole.
const MEAN: f64 = 0.6;
/// The field drifts past a vehicle that goes with the wind at this speed at least, m/s.
const DRIFT_MIN_MPS: f64 = 0.5;

/// Wind over one flight; the same seed and motion give the same wind.
#[derive(Clone, Debug)]
pub struct Wind {
    mean_world: Vec3,
    speed_mps: f64,
    /// Each axis' unit noise after one and after two lags of its scale length.
    once: [f64; 3],
    twice: [f64; 3],
    rng: ChaCha8Rng,
}

impl Wind {
    /// Wind whose gusts reach about `speed_mps`, from a random side.
    #[must_use]
    pub fn new(speed_mps: f64, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let heading: f64 = rng.random_range(0.0..std::f64::consts::TAU);
        let mean_world = Vec3::new(heading.cos(), heading.sin(), 0.0) * (MEAN * speed_mps);
        Self { mean_world, speed_mps, once: [0.0; 3], twice: [0.0; 3], rng }
    }

    /// The air's velocity after `dt_s` more where a vehicle of velocity `vel_world` is, m/s, world: the turbulence is a
    /// frozen field that the vehicle flies through.
    pub fn step(&mut self, dt_s: f64, vel_world: &Vec3) -> Vec3 {
        if self.speed_mps <= 0.0 {
            return Vec3::zeros();
        }
        let way_m = (vel_world - self.mean_world).norm().max(DRIFT_MIN_MPS) * dt_s;
        for ((once, twice), scale_m) in self.once.iter_mut().zip(&mut self.twice).zip(SCALE_M) {
            let keep = (-way_m / scale_m).exp();
            let noise: f64 = self.rng.sample(StandardNormal);
            let before = *once;
            *once = keep * before + (1.0 - keep * keep).sqrt() * noise;
            *twice = keep * *twice + (1.0 - keep) * 0.5 * (before + *once);
        }
        // (1 + √3 L s) / (1 + L s)² = √3 / (1 + L s) + (1 − √3) / (1 + L s)²; its variance is 2.
        let root = 3f64.sqrt();
        let second = |axis: usize| (root * self.once[axis] + (1.0 - root) * self.twice[axis]) / 2f64.sqrt();
        let gust = [self.once[0], second(1), second(2)];
        let along = self.mean_world / (MEAN * self.speed_mps);
        let across = Vec3::new(-along.y, along.x, 0.0);
        let strength = STRENGTH.map(|s| s * self.speed_mps);
        self.mean_world
            + along * (gust[0] * strength[0])
            + across * (gust[1] * strength[1])
            + Vec3::z() * (gust[2] * strength[2])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_blows_the_same_wind_of_the_asked_strength() {
        let (mut a, mut b) = (Wind::new(5.0, 7), Wind::new(5.0, 7));
        let fast = Vec3::new(8.0, 0.0, 0.0);
        let (mut below, mut sum, mut squares) = (0, Vec3::zeros(), Vec3::zeros());
        let count = 400_000;
        for _ in 0..count {
            let wind = a.step(0.01, &fast);
            assert_eq!(wind, b.step(0.01, &fast));
            below += usize::from(wind.norm() < 5.0);
            sum += wind;
            squares += wind.component_mul(&wind);
        }
        assert!((0.9..0.99).contains(&(below as f64 / f64::from(count))), "{below}");
        let mean = sum / f64::from(count);
        let variance = squares / f64::from(count) - mean.component_mul(&mean);
        assert!((mean.norm() - 3.0).abs() < 0.1, "{mean}");
        assert!((variance.z.sqrt() - 0.5).abs() < 0.03, "{variance}");
        assert!(((variance.x + variance.y).sqrt() - 2f64.sqrt()).abs() < 0.1, "{variance}");
    }

    #[test]
    fn gusts_last_as_long_as_their_scale_length_takes_to_pass() {
        // Autocorrelation of the wind along its mean: e^(−distance / scale).
        let mut wind = Wind::new(4.0, 3);
        let along = wind.mean_world.normalize();
        let hover = Vec3::zeros();
        let drift = wind.mean_world.norm();
        let series: Vec<f64> = (0..300_000).map(|_| (wind.step(0.02, &hover) - wind.mean_world).dot(&along)).collect();
        let lag = (SCALE_M[0] / drift / 0.02).round() as usize;
        let product = |lag: usize| series.iter().zip(&series[lag..]).map(|(a, b)| a * b).sum::<f64>();
        let correlation = product(lag) / product(0);
        assert!((correlation - (-1f64).exp()).abs() < 0.08, "{correlation}");
    }

    #[test]
    fn without_wind_the_air_is_still() {
        assert_eq!(Wind::new(0.0, 1).step(0.01, &Vec3::x()), Vec3::zeros());
    }
}
