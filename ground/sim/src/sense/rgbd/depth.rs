//! Depth as a stereo camera measures it: disparity noise and quantisation (error grows with z²), noise that
//! neighbouring pixels share, holes at depth edges, on thin things and in patches, mixed depths at edges, nothing below
//! the shortest range, little far away.

use super::{gaussian, mix, unit};
use crate::render::Frame;
use crate::render::lanes::{LANES, Lanes, lanes, least, low_bits, most, nearest_whole, some};
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
    /// Nodes of the two patch noises, row by row.
    patches: [Vec<f32>; 2],
    /// The two patch noises along a row of pixels.
    shared: [Vec<f32>; 2],
    /// The true depth, with `BORDER` columns and one row more on each side.
    around: Vec<f32>,
}

/// Columns beside a pixel that decide whether it is on something thin.
const BORDER: usize = 2;

impl DepthSensor {
    pub(super) fn new(config: DepthConfig) -> Self {
        Self { config, patches: Default::default(), shared: Default::default(), around: Vec::new() }
    }

    /// Fills `depth_mm` (mm, 0: no measurement) from the frame's true depth.
    pub(super) fn measure(&mut self, frame: &Frame, seed: u64, depth_mm: &mut [u16]) {
        let (width, height) = (frame.width, frame.height);
        self.draw_patches(width, height, seed ^ 0xa076_1d64_78bd_642f);
        self.surround(frame);
        for v in 0..height {
            self.patch_row(v, width);
            for first in (0..width).step_by(LANES) {
                let inside = LANES.min(width - first);
                let pixel = v * width + first;
                let bits = lanes(|i| mix(seed, (pixel + i) as u64));
                let halves = [lanes(|i| bits[i] as u32), lanes(|i| (bits[i] >> 32) as u32)];
                let measured = self.stretch(first, v, width, &halves);
                depth_mm[pixel..pixel + inside].copy_from_slice(&measured[..inside]);
            }
        }
    }

    /// Some pixels of row `v` from column `first` on, mm.
    fn stretch(&self, first: usize, v: usize, width: usize, [low, high]: &[[u32; LANES]; 2]) -> [u16; LANES] {
        let config = &self.config;
        let around = |dv: usize, du: usize| some(&self.around, (v + dv) * stride(width) + first + du);
        let true_z = around(1, 2);
        let [shared, blotch] = self.shared.each_ref().map(|noise| some(noise, first));
        let (nearest, mut hole) =
            self.edges(true_z, [0, 1, 3, 4].map(|du| around(1, du)), [around(0, 2), around(2, 2)]);
        let (chance, second): (Lanes, Lanes) = (lanes(|i| unit(low[i])), lanes(|i| unit(low[i] >> 16)));
        let z = lanes(|i| {
            // Matching windows straddle an edge: some pixels get a depth between the two surfaces, or the nearer one.
            let between = true_z[i] + (nearest[i] - true_z[i]) * (second[i] * (1.0 / 0.12));
            let nearer = if (second[i] < 0.35) && (nearest[i] >= config.min_m) { nearest[i] } else { true_z[i] };
            if second[i] < 0.12 { between } else { nearer }
        });
        let inverse = 1.0 / (config.max_m - config.poor_m);
        for i in 0..LANES {
            let far = (z[i] - config.poor_m) * inverse;
            hole[i] += if far > 0.0 { 0.08 + 0.75 * far } else { 0.0 };
            // Patches without texture fail as a whole.
            hole[i] += if blotch[i] > 2.1 { 0.6 } else { 0.0 };
        }
        let measured = lanes(|i| {
            let noise = config.noise_per_m * gaussian(high[i]) + config.patch_noise_per_m * shared[i];
            // Disparity ∝ 1/z is quantised, so depth is in steps of step_per_m · z².
            let disparity = nearest_whole(1.0 / (config.step_per_m * most(z[i] + z[i] * z[i] * noise, 0.05)));
            1.0 / (config.step_per_m * most(disparity, 1.0))
        });
        let within = |z: f32| (z >= config.min_m) && (z <= config.max_m);
        let known: [bool; LANES] = lanes(|i| within(true_z[i]) && (chance[i] >= hole[i]) & within(measured[i]));
        let level: [u32; LANES] = lanes(|i| if known[i] { low_bits(measured[i] * 1000.0) } else { 0 });
        level.map(|mm| mm as u16)
    }

    /// Where depth steps: the nearer surface on the far side of an edge, elsewhere the depth itself; and the probability
    /// of a hole for that. `beside`: two columns to the left, one, one to the right, two.
    fn edges(&self, z: &Lanes, beside: [&Lanes; 4], [above, below]: [&Lanes; 2]) -> (Lanes, Lanes) {
        let config = &self.config;
        let [left2, left, right, right2] = beside;
        let nearest = lanes(|i| least(least(left[i], right[i]), least(above[i], below[i])));
        // Something thin: all is farther on both sides of it.
        let over =
            lanes(|i| most(least(least(left[i], left2[i]), least(right[i], right2[i])), least(above[i], below[i])));
        let step = lanes(|i| 0.12 + 0.06 * z[i]);
        let far_side: [bool; LANES] = lanes(|i| nearest[i] < z[i] - step[i]);
        let hole = lanes(|i| {
            let thin = if over[i] > z[i] + step[i] { config.thin_hole } else { 0.0 };
            config.stray_hole + if far_side[i] { config.edge_hole } else { thin }
        });
        (lanes(|i| if far_side[i] { nearest[i] } else { z[i] }), hole)
    }

    fn draw_patches(&mut self, width: usize, height: usize, seed: u64) {
        let nodes = nodes(width) * (height / PATCH_PX + 2);
        for (index, patches) in self.patches.iter_mut().enumerate() {
            patches.clear();
            patches.extend((0..nodes).map(|i| gaussian((mix(seed, i as u64) >> (32 * index)) as u32)));
        }
    }

    /// The two patch noises along row `v`, about unit variance at the nodes.
    fn patch_row(&mut self, v: usize, width: usize) {
        let (nodes, fv) = (nodes(width), (v % PATCH_PX) as f32 / PATCH_PX as f32);
        for (patches, noise) in self.patches.iter().zip(&mut self.shared) {
            let (low, high) =
                (&patches[v / PATCH_PX * nodes..][..nodes], &patches[(v / PATCH_PX + 1) * nodes..][..nodes]);
            let node = |i: usize| (low[i] + (high[i] - low[i]) * fv) * 1.5;
            noise.resize(nodes * PATCH_PX, 0.0);
            for (i, stretch) in noise.chunks_exact_mut(PATCH_PX).take(nodes - 1).enumerate() {
                let (begin, slope) = (node(i), (node(i + 1) - node(i)) * (1.0 / PATCH_PX as f32));
                for (along, noise) in stretch.iter_mut().enumerate() {
                    *noise = begin + slope * along as f32;
                }
            }
        }
    }

    /// Repeats the image's border outside of it.
    fn surround(&mut self, frame: &Frame) {
        let (width, height, stride) = (frame.width, frame.height, stride(frame.width));
        self.around.resize((height + 2) * stride, 0.0);
        for (v, padded) in self.around.chunks_exact_mut(stride).enumerate() {
            let row = v.clamp(1, height) - 1;
            let row = &frame.depth_m[row * width..(row + 1) * width];
            padded[..BORDER].fill(row[0]);
            padded[BORDER..BORDER + width].copy_from_slice(row);
            padded[BORDER + width..].fill(row[width - 1]);
        }
    }
}

/// Patch nodes along a row; beyond the image enough for whole stretches.
fn nodes(width: usize) -> usize {
    width.next_multiple_of(LANES) / PATCH_PX + 2
}

/// Length of a surrounded row.
fn stride(width: usize) -> usize {
    width.next_multiple_of(LANES) + 2 * BORDER
}
