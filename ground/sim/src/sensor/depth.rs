//! Depth as a stereo camera measures it: disparity noise and quantisation (error grows with z²), noise that
//! neighbouring pixels share, holes at depth edges, on thin things and in patches, mixed depths at edges, nothing below
//! the shortest range, little far away.

use super::{gaussian, mix, unit};
use crate::render::Frame;
use serde::Deserialize;

/// Strength of each effect; see `sensors/d455.toml` for values and sources.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthConfig {
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
}

/// Pixels between the nodes of the patch noise.
const PATCH_PX: usize = 8;

/// Measures depth; owns its scratch memory.
#[derive(Clone, Debug)]
pub(super) struct DepthSensor {
    config: DepthConfig,
    patches: Vec<[f32; 2]>,
}

impl DepthSensor {
    pub(super) fn new(config: DepthConfig) -> Self {
        Self { config, patches: Vec::new() }
    }

    /// Fills `depth_mm` (mm, 0: no measurement) from the frame's true depth.
    pub(super) fn measure(&mut self, frame: &Frame, seed: u64, depth_mm: &mut [u16]) {
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
}
