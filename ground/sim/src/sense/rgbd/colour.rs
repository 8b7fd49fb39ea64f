//! Colour as a small global-shutter camera delivers it: motion blur, a soft lens, auto-exposure, white balance, noise.

use super::{Motion, gaussian, mix, unit};
use crate::render::Frame;
use crate::render::lanes::{LANES, Lanes, floor, lanes, least, low_bits, most};
use nalgebra::Vector3;
use serde::Deserialize;
use std::sync::LazyLock;

/// Strength of each effect; see `sensors/d455.toml`. Levels are of 255, after the display's gamma.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColourConfig {
    /// What auto-exposure steers the image's mean to.
    pub mean_level: f32,
    /// How much of the way it goes, 0..=1.
    pub auto_exposure: f32,
    /// Of a unit: standard deviation of the logarithm of its exposure.
    pub exposure_spread: f32,
    /// Of a unit: standard deviation of red against blue, relative.
    pub white_balance: f32,
    /// Noise of a pixel, standard deviation; a unit has 0.4 to 1.6 of it.
    pub noise: f32,
    /// A unit's share of each of the four neighbours, at most.
    pub lens_blur: f32,
    /// Exposure time, shortest and longest, s; drawn for each unit.
    pub shutter_s: [f32; 2],
}

/// Auto-exposure changes levels by this factor at most, either way.
const GAIN_MAX: f32 = 1.8;

/// Smears shorter than this are none, px.
const SHORT_PX: f32 = 0.5;

/// Most samples along a smear.
const TAPS_MAX: f32 = 7.0;

/// What a pixel without depth is taken to be at, m.
const FAR_M: f32 = 60.0;

/// Unit noise; each row of an image takes a stretch of it that begins anywhere.
static NOISE: LazyLock<Vec<f32>> = LazyLock::new(|| (0..1 << 16).map(|i| gaussian(mix(0x6e01, i) as u32)).collect());

/// One unit; owns its scratch memory.
#[derive(Clone, Debug)]
pub(super) struct ColourSensor {
    config: ColourConfig,
    focal_px: f32,
    /// Level over the usual, for each channel.
    tone: [f32; 3],
    lens_blur: f32,
    noise: f32,
    shutter_s: f32,
    /// The frame's colours before and after motion blur.
    sharp: Vec<u8>,
    smeared: Vec<u8>,
    /// `gain` of each value of a row.
    gains: Vec<f32>,
}

impl ColourSensor {
    pub(super) fn new(config: ColourConfig, focal_px: f32, seed: u64) -> Self {
        let (draw, tone) = (mix(seed, u64::MAX), mix(seed, u64::MAX - 1));
        let exposure = (config.exposure_spread * gaussian(draw as u32)).exp();
        let warm = config.white_balance * gaussian(tone as u32);
        let green = 0.4 * config.white_balance * gaussian((tone >> 32) as u32);
        let [shortest, longest] = config.shutter_s;
        Self {
            config,
            focal_px,
            tone: [exposure * (1.0 + warm), exposure * (1.0 + green), exposure * (1.0 - warm)],
            lens_blur: config.lens_blur * unit((draw >> 32) as u32),
            noise: config.noise * (0.4 + 1.2 * unit((draw >> 48) as u32)),
            shutter_s: shortest * (longest / shortest).powf(unit(mix(seed, u64::MAX - 2) as u32)),
            sharp: Vec::new(),
            smeared: Vec::new(),
            gains: Vec::new(),
        }
    }

    /// Fills `rgb` from the frame's colours.
    pub(super) fn expose(&mut self, frame: &Frame, motion: &Motion, seed: u64, rgb: &mut [u8]) {
        self.smear(frame, motion);
        let (height, stride) = (frame.height, 3 * frame.width);
        let sum: u64 = self.smeared.chunks_exact(stride).map(|row| u64::from(sum(row))).sum();
        let mean = (sum as f32 / self.smeared.len().max(1) as f32).max(1.0);
        let auto = (self.config.mean_level / mean).powf(self.config.auto_exposure).clamp(1.0 / GAIN_MAX, GAIN_MAX);
        let gain = self.tone.map(|tone| tone * auto);
        self.gains.clear();
        self.gains.extend(gain.iter().cycle().take(stride));
        for (v, out) in rgb.chunks_exact_mut(stride).enumerate() {
            let row = |v: usize| &self.smeared[v * stride..(v + 1) * stride];
            let start = mix(seed, v as u64) as usize % (NOISE.len() - stride);
            let noise = &NOISE[start..start + stride];
            self.develop([row(v.saturating_sub(1)), row(v), row((v + 1).min(height - 1))], noise, out);
        }
    }

    /// One row through lens, gain and noise; `rows`: the one above, itself, the one below.
    fn develop(&self, [above, here, below]: [&[u8]; 3], noise: &[f32], out: &mut [u8]) {
        let (blur, stride) = (self.lens_blur, out.len());
        let centre = 1.0 - 4.0 * blur;
        let level = |[here, left, right, above, below]: [u8; 5], gain: f32, noise: f32| {
            let around = u16::from(left) + u16::from(right) + (u16::from(above) + u16::from(below));
            let soft = f32::from(here) * centre + f32::from(around) * blur;
            low_bits(least(most(soft * gain + self.noise * noise, 0.0), 255.0)) as u8
        };
        // Slices of one length are indexed without checks.
        let inner = stride - 6;
        let (left, middle, right) = (&here[..inner], &here[3..3 + inner], &here[6..6 + inner]);
        let (above_in, below_in) = (&above[3..3 + inner], &below[3..3 + inner]);
        let (gains, noises, outs) = (&self.gains[3..3 + inner], &noise[3..3 + inner], &mut out[3..3 + inner]);
        for i in 0..inner {
            outs[i] = level([middle[i], left[i], right[i], above_in[i], below_in[i]], gains[i], noises[i]);
        }
        for i in 0..3 {
            let last = stride - 3 + i;
            for (i, left, right) in
                [(i, here[i], here[(i + 3).min(last)]), (last, here[last.saturating_sub(3)], here[last])]
            {
                out[i] = level([here[i], left, right, above[i], below[i]], self.gains[i], noise[i]);
            }
        }
    }

    /// Averages each pixel along its way through the image while the shutter is open.
    fn smear(&mut self, frame: &Frame, motion: &Motion) {
        self.sharp.clear();
        self.sharp.extend_from_slice(&frame.rgb);
        // A pixel is read as four bytes.
        self.sharp.push(0);
        self.smeared.resize(frame.rgb.len(), 0);
        let (width, drift) = (frame.width, Drift::new(frame, motion, self.focal_px, self.shutter_s));
        for (v, (depth, out)) in
            frame.depth_m.chunks_exact(width).zip(self.smeared.chunks_exact_mut(3 * width)).enumerate()
        {
            for (index, (depth, out)) in depth.chunks(LANES).zip(out.chunks_mut(3 * LANES)).enumerate() {
                let first = index * LANES;
                let mut full = [FAR_M; LANES];
                full[..depth.len()].copy_from_slice(depth);
                let ways = drift.ways(first, v, &full);
                if ways.most_taps > 1 {
                    let pixels = average(&self.sharp, (width, frame.height), (first, v), &ways);
                    for (out, pixel) in out.chunks_exact_mut(3).zip(pixels) {
                        out.copy_from_slice(&pixel.to_le_bytes()[..3]);
                    }
                } else {
                    let pixel = 3 * (v * width + first);
                    out.copy_from_slice(&self.sharp[pixel..pixel + out.len()]);
                }
            }
        }
    }
}

fn sum(row: &[u8]) -> u32 {
    row.iter().map(|c| u32::from(*c)).sum()
}

/// How resting points move through the image while the shutter is open.
struct Drift {
    /// Velocity and angular velocity of the camera over one exposure, in pixels at a depth of 1 m.
    vel: Vector3<f32>,
    turn: Vector3<f32>,
    half: [f32; 2],
    inv_focal: f32,
}

/// The ways of some pixels through the image, px, and how many samples are taken along each.
struct Ways {
    du: Lanes,
    dv: Lanes,
    taps: Lanes,
    most_taps: usize,
}

impl Drift {
    fn new(frame: &Frame, motion: &Motion, focal_px: f32, shutter_s: f32) -> Self {
        let scale = focal_px * shutter_s;
        Self {
            vel: motion.vel_cam.cast::<f32>() * scale,
            turn: motion.ang_vel_cam.cast::<f32>() * scale,
            half: [0.5 * frame.width as f32 - 0.5, 0.5 * frame.height as f32 - 0.5],
            inv_focal: 1.0 / focal_px,
        }
    }

    /// Of the pixels of row `v` from column `first` on, at these depths, m.
    fn ways(&self, first: usize, v: usize, depth: &Lanes) -> Ways {
        let (vel, turn) = (&self.vel, &self.turn);
        let (left, z) = (self.half[0] - first as f32, (self.half[1] - v as f32) * self.inv_focal);
        let mut ways = Ways { du: [0.0; LANES], dv: [0.0; LANES], taps: [0.0; LANES], most_taps: 0 };
        for (i, depth) in depth.iter().enumerate() {
            let y = (left - i as i32 as f32) * self.inv_focal;
            let inverse = 1.0 / least(*depth, FAR_M);
            // In the camera frame a resting point p moves by −v − ω × p; here over its depth, p = (1, y, z).
            let ahead = vel.x * inverse + turn.y * z - turn.z * y;
            let across = vel.y * inverse + turn.z - turn.x * z;
            let upward = vel.z * inverse + turn.x * y - turn.y;
            let (du, dv) = (across - y * ahead, upward - z * ahead);
            let length = most(du.abs(), dv.abs());
            let moves = length >= SHORT_PX;
            // ⌈length⌉ + 1.
            let taps = least(1.0 - floor(-length) as f32, TAPS_MAX);
            (ways.du[i], ways.dv[i], ways.taps[i]) = if moves { (du, dv, taps) } else { (0.0, 0.0, 1.0) };
        }
        ways.most_taps = ways.taps.iter().fold(0.0, |a, b| most(a, *b)) as usize;
        ways
    }
}

/// The mean colours along the ways, red in the lowest byte; for images of less than 2²² pixels. `rgb` has one byte more
/// than the image.
fn average(rgb: &[u8], (width, height): (usize, usize), (first, v): (usize, usize), ways: &Ways) -> [u32; LANES] {
    let (last_u, last_v) = ((width - 1) as f32, (height - 1) as f32);
    // Red and blue share a word.
    let (mut red_blue, mut green) = ([0u32; LANES], [0u32; LANES]);
    let step = lanes(|i| 1.0 / most(ways.taps[i] - 1.0, 1.0));
    for tap in 0..ways.most_taps {
        let tap = tap as f32;
        let from: [u32; LANES] = lanes(|i| {
            let along = tap * step[i] - 0.5;
            let u = (first + i) as i32 as f32 + 0.5 + along * ways.du[i];
            let v = v as f32 + 0.5 + along * ways.dv[i];
            let (u, v) = (floor(least(most(u, 0.0), last_u)), floor(least(most(v, 0.0), last_v)));
            3 * (low_bits(v as f32 * width as f32 + u as f32) & 0x003f_ffff)
        });
        let mut pixels = [0u32; LANES];
        for (pixel, from) in pixels.iter_mut().zip(from) {
            let bytes = rgb[from as usize..].first_chunk().expect("the image is one byte longer than its pixels");
            *pixel = u32::from_le_bytes(*bytes);
        }
        for i in 0..LANES {
            let pixel = if tap < ways.taps[i] { pixels[i] } else { 0 };
            red_blue[i] += pixel & 0x00ff_00ff;
            green[i] += (pixel >> 8) & 0xff;
        }
    }
    lanes(|i| {
        let share = 1.0 / ways.taps[i];
        let mean = |sum: u32| floor(sum as i32 as f32 * share) as u32;
        mean(red_blue[i] & 0xffff) | mean(green[i]) << 8 | mean(red_blue[i] >> 16) << 16
    })
}
