//! From an ideal [`Frame`] to what an RGB-D camera of the D455's kind delivers.
//!
//! Depth: disparity noise and quantisation (error grows with z²), noise that neighbouring pixels share, holes at depth
//! edges, on thin things and in patches, mixed depths at edges, nothing below 0.4 m or beyond 20 m, little beyond
//! 10 m. Colour: exposure, white balance, a soft lens, noise. All of it is a pure function of the frame and a seed.

use crate::render::Frame;

/// Strength of each effect. The defaults are those of data sets and flights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorConfig {
    /// Depth noise of a pixel: σ = this · z², 1/m.
    pub noise_per_m: f32,
    /// Noise shared by patches of about 10 pixels: σ = this · z², 1/m.
    pub patch_noise_per_m: f32,
    /// Depth step between neighbouring disparities: this · z², 1/m.
    pub step_per_m: f32,
    /// Shortest depth that is measured, m.
    pub min_m: f32,
    /// From here on holes multiply, m.
    pub poor_m: f32,
    /// Nothing is measured beyond, m.
    pub max_m: f32,
    /// Probability of a hole on the far side of a depth edge.
    pub edge_hole: f32,
    /// Probability of a hole on something one or two pixels wide.
    pub thin_hole: f32,
    /// Probability of a hole anywhere.
    pub stray_hole: f32,
    /// Standard deviation of the logarithm of the exposure.
    pub exposure: f32,
    /// Standard deviation of colour noise, of 255.
    pub colour_noise: f32,
}

impl Default for SensorConfig {
    fn default() -> Self {
        Self {
            noise_per_m: 0.0014,
            patch_noise_per_m: 0.0012,
            step_per_m: 0.001,
            min_m: 0.4,
            poor_m: 10.0,
            max_m: 20.0,
            edge_hole: 0.45,
            thin_hole: 0.3,
            stray_hole: 0.003,
            exposure: 0.18,
            colour_noise: 3.0,
        }
    }
}

/// A sensor's image, row-major from the top left.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RgbdImage {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green, blue; `height · width · 3`.
    pub rgb: Vec<u8>,
    /// Along the optical axis, mm; 0: no measurement.
    pub depth_mm: Vec<u16>,
}

/// Applies the sensor model; owns its scratch memory.
#[derive(Clone, Debug)]
pub struct Sensor {
    config: SensorConfig,
    patches: Vec<[f32; 2]>,
}

/// Pixels between the nodes of the patch noise.
const PATCH_PX: usize = 8;

impl Sensor {
    /// A sensor of the given strength of effects.
    #[must_use]
    pub fn new(config: SensorConfig) -> Self {
        Self { config, patches: Vec::new() }
    }

    /// The image that the sensor makes of `frame`. Same frame and seed, same image.
    pub fn capture(&mut self, frame: &Frame, seed: u64, image: &mut RgbdImage) {
        (image.width, image.height) = (frame.width, frame.height);
        image.rgb.resize(frame.rgb.len(), 0);
        image.depth_mm.resize(frame.depth_m.len(), 0);
        self.depth(frame, seed, &mut image.depth_mm);
        self.colour(frame, seed ^ 0x5bd1_e995_7b93_1f27, &mut image.rgb);
    }

    fn depth(&mut self, frame: &Frame, seed: u64, depth_mm: &mut [u16]) {
        let (config, width, height) = (self.config, frame.width, frame.height);
        let (px, py) = (width / PATCH_PX + 2, height / PATCH_PX + 2);
        self.patches.clear();
        self.patches.extend((0..px * py).map(|i| {
            let bits = mix(seed ^ 0xa076_1d64_78bd_642f, i as u64);
            [gaussian(bits as u32), gaussian((bits >> 32) as u32)]
        }));
        let at = |u: i64, v: i64| {
            let (u, v) = (u.clamp(0, width as i64 - 1), v.clamp(0, height as i64 - 1));
            frame.depth_m[v as usize * width + u as usize]
        };
        for v in 0..height {
            for u in 0..width {
                let pixel = v * width + u;
                depth_mm[pixel] = 0;
                let mut z = frame.depth_m[pixel];
                if !(z >= config.min_m && z <= config.max_m) {
                    continue;
                }
                let bits = mix(seed, pixel as u64);
                let (chance, second) = (unit(bits as u16), unit((bits >> 16) as u16));
                let [shared, blotch] = self.patch(u, v, px);
                let (ui, vi) = (u as i64, v as i64);
                let (left, right) = (at(ui - 1, vi), at(ui + 1, vi));
                let (above, below) = (at(ui, vi - 1), at(ui, vi + 1));
                let step = 0.12 + 0.06 * z;
                let nearest = left.min(right).min(above).min(below);
                let thin = left.min(at(ui - 2, vi)) > z + step && right.min(at(ui + 2, vi)) > z + step
                    || above > z + step && below > z + step;
                let mut hole = config.stray_hole;
                if nearest < z - step {
                    hole += config.edge_hole;
                    // Matching windows straddle the edge: some pixels get a depth between the two surfaces.
                    if second < 0.12 && nearest.is_finite() {
                        z += (nearest - z) * second / 0.12;
                    } else if second < 0.35 && nearest >= config.min_m {
                        z = nearest;
                    }
                } else if thin {
                    hole += config.thin_hole;
                }
                if z > config.poor_m {
                    let far = (z - config.poor_m) / (config.max_m - config.poor_m);
                    hole += 0.08 + 0.75 * far;
                }
                // Patches without texture fail as a whole.
                if blotch > 2.1 {
                    hole += 0.6;
                }
                if chance < hole {
                    continue;
                }
                let white = gaussian((bits >> 32) as u32);
                let noisy = z + z * z * (config.noise_per_m * white + config.patch_noise_per_m * shared);
                // Disparity ∝ 1/z is quantised, so depth is in steps of step_per_m · z².
                let disparity = (1.0 / (config.step_per_m * noisy.max(0.05))).round().max(1.0);
                let measured = 1.0 / (config.step_per_m * disparity);
                if measured >= config.min_m && measured <= config.max_m {
                    depth_mm[pixel] = (measured * 1000.0).round() as u16;
                }
            }
        }
    }

    /// The two patch noises at a pixel, about unit variance at the nodes.
    fn patch(&self, u: usize, v: usize, px: usize) -> [f32; 2] {
        let (iu, iv) = (u / PATCH_PX, v / PATCH_PX);
        let fu = (u % PATCH_PX) as f32 / PATCH_PX as f32;
        let fv = (v % PATCH_PX) as f32 / PATCH_PX as f32;
        let first = iv * px + iu;
        let (a, b) = (self.patches[first], self.patches[first + 1]);
        let (c, d) = (self.patches[first + px], self.patches[first + px + 1]);
        std::array::from_fn(|i| {
            let low = a[i] + (b[i] - a[i]) * fu;
            let high = c[i] + (d[i] - c[i]) * fu;
            (low + (high - low) * fv) * 1.5
        })
    }

    fn colour(&self, frame: &Frame, seed: u64, rgb: &mut [u8]) {
        let (config, width, height) = (self.config, frame.width, frame.height);
        let draw = mix(seed, u64::MAX);
        let exposure = (config.exposure * gaussian(draw as u32)).exp();
        let tone = mix(seed, u64::MAX - 1);
        let warm = 0.05 * gaussian(tone as u32);
        let green = 0.02 * gaussian((tone >> 32) as u32);
        let gain = [exposure * (1.0 + warm), exposure * (1.0 + green), exposure * (1.0 - warm)];
        let blur = 0.16 * unit((draw >> 32) as u16);
        let noise = config.colour_noise * (0.4 + 1.2 * unit((draw >> 48) as u16));
        for v in 0..height {
            let rows = [v.saturating_sub(1), v, (v + 1).min(height - 1)].map(|r| r * width);
            for u in 0..width {
                let (left, right) = (u.saturating_sub(1), (u + 1).min(width - 1));
                let pixel = v * width + u;
                let bits = mix(seed, pixel as u64);
                let hash = [bits as u32, (bits >> 32) as u32, (bits >> 16) as u32];
                for channel in 0..3 {
                    let at = |index: usize| f32::from(frame.rgb[3 * index + channel]);
                    let around = at(rows[1] + left) + at(rows[1] + right) + at(rows[0] + u) + at(rows[2] + u);
                    let soft = at(pixel) * (1.0 - 4.0 * blur) + around * blur;
                    let value = soft * gain[channel] + noise * gaussian(hash[channel]);
                    rgb[3 * pixel + channel] = (value + 0.5).clamp(0.0, 255.0) as u8;
                }
            }
        }
    }
}

/// 64 well mixed bits from a seed and a counter (the finaliser of SplitMix64).
#[must_use]
pub(crate) fn mix(seed: u64, counter: u64) -> u64 {
    let mut z = seed.wrapping_add(counter.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// 0..1.
fn unit(bits: u16) -> f32 {
    f32::from(bits) * (1.0 / 65_536.0)
}

/// About normal, unit variance, within ±3.5: the sum of four uniform bytes.
fn gaussian(bits: u32) -> f32 {
    let sum: u32 = bits.to_le_bytes().iter().map(|b| u32::from(*b)).sum();
    (sum as f32 - 510.0) * (1.0 / 147.8)
}
