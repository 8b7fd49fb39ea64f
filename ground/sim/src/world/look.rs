//! Light and colours of a world, all linear light in 0..1, drawn by seed.

use rand::{Rng, RngExt};

/// What the renderer needs beyond geometry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Unit vector toward the sun, world frame.
    pub sun_dir_world: [f32; 3],
    /// Sunlight on a surface that faces it.
    pub sun_rgb: [f32; 3],
    /// Light from everywhere.
    pub ambient_rgb: [f32; 3],
    /// Sky overhead.
    pub zenith_rgb: [f32; 3],
    /// Sky at the horizon; also the haze.
    pub horizon_rgb: [f32; 3],
    /// The two colours that the ground is mottled from.
    pub ground_rgb: [[f32; 3]; 2],
    /// The far wood that closes the view.
    pub backdrop_rgb: [f32; 3],
    /// Share of the ground in dappled shade, 0..1.
    pub shade: f32,
    /// Haze per metre.
    pub haze_per_m: f32,
}

impl Look {
    /// Draws a season, a sky and an hour.
    pub fn random<R: Rng>(rng: &mut R) -> Self {
        let azimuth = rng.random_range(0.0..std::f32::consts::TAU);
        let elevation = rng.random_range(0.35f32..1.35);
        let overcast = if rng.random_bool(0.4) { rng.random_range(0.5f32..1.0) } else { rng.random_range(0.0..0.4) };
        let warmth = (1.35 - elevation) * 0.25;
        let sun = (1.0 - overcast) * rng.random_range(0.9f32..1.5);
        let sky = rng.random_range(0.55f32..1.0);
        let blue = 1.0 - 0.8 * overcast;
        let grounds = [
            [[0.07, 0.12, 0.03], [0.14, 0.17, 0.06]],  // grass
            [[0.12, 0.08, 0.045], [0.22, 0.15, 0.08]], // leaf litter
            [[0.15, 0.12, 0.09], [0.26, 0.22, 0.16]],  // bare earth
            [[0.08, 0.10, 0.04], [0.19, 0.14, 0.07]],  // moss and litter
            [[0.28, 0.25, 0.16], [0.36, 0.32, 0.20]],  // dry grass
        ];
        let pick: [[f32; 3]; 2] = grounds[rng.random_range(0..grounds.len())];
        let jitter = rng.random_range(0.75f32..1.25);
        let green = rng.random_range(0.5f32..1.2);
        Self {
            sun_dir_world: [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()],
            sun_rgb: [sun, sun * (1.0 - 0.5 * warmth), sun * (0.95 - warmth)],
            ambient_rgb: [0.42 * sky, 0.45 * sky, (0.44 + 0.08 * blue) * sky].map(|c| c * (0.8 + 0.7 * overcast)),
            zenith_rgb: [0.62 - 0.45 * blue, 0.68 - 0.33 * blue, 0.76].map(|c| c * sky),
            horizon_rgb: [0.80 - 0.20 * blue, 0.82 - 0.12 * blue, 0.84].map(|c| c * sky),
            ground_rgb: pick.map(|c| c.map(|v| v * jitter)),
            backdrop_rgb: [0.10 * jitter, 0.13 * green, 0.07].map(|c| c * (0.6 + 0.5 * sky)),
            shade: if overcast > 0.5 { 0.0 } else { rng.random_range(0.1..0.65) },
            haze_per_m: rng.random_range(0.002f32..0.014),
        }
    }
}
