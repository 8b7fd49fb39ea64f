//! Seeded wind: a constant part and gusts (a first-order Gauss-Markov process on each axis).

use goshawk_core::types::Vec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// How long a gust lasts, s.
const GUST_TIME_S: f64 = 1.0;

/// Wind over one flight; the same seed gives the same wind.
#[derive(Clone, Debug)]
pub struct Wind {
    mean_world: Vec3,
    gust_std: Vec3,
    gust_world: Vec3,
    rng: ChaCha8Rng,
}

impl Wind {
    /// Still air.
    #[must_use]
    pub fn still() -> Self {
        Self::new(0.0, 0)
    }

    /// Wind whose gusts reach about `speed_mps` (95 % of the time below it): a mean of 0.6 of that from a random side,
    /// and gusts around it, horizontal standard deviation 0.2, vertical 0.1.
    #[must_use]
    pub fn new(speed_mps: f64, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let heading: f64 = rng.random_range(0.0..std::f64::consts::TAU);
        let mean_world = Vec3::new(heading.cos(), heading.sin(), 0.0) * (0.6 * speed_mps);
        let gust_std = Vec3::new(0.2, 0.2, 0.1) * speed_mps;
        Self { mean_world, gust_std, gust_world: Vec3::zeros(), rng }
    }

    /// The air's velocity after `dt_s` more, m/s, world.
    pub fn step(&mut self, dt_s: f64) -> Vec3 {
        if self.gust_std.x > 0.0 {
            let keep = (-dt_s / GUST_TIME_S).exp();
            let kick = (1.0 - keep * keep).sqrt();
            for axis in 0..3 {
                let noise: f64 = self.rng.sample(StandardNormal);
                self.gust_world[axis] = keep * self.gust_world[axis] + kick * self.gust_std[axis] * noise;
            }
        }
        self.mean_world + self.gust_world
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_blows_the_same_wind_of_the_asked_strength() {
        let (mut a, mut b) = (Wind::new(5.0, 7), Wind::new(5.0, 7));
        let mut below = 0;
        for _ in 0..200_000 {
            let wind = a.step(0.01);
            assert_eq!(wind, b.step(0.01));
            below += usize::from(wind.norm() < 5.0);
        }
        assert!((0.9..0.99).contains(&(below as f64 / 200_000.0)), "{below}");
    }
}
