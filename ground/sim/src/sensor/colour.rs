//! Colour as a small global-shutter camera delivers it: motion blur, a soft lens, auto-exposure, white balance, noise.

use super::{Motion, gaussian, mix, unit};
use crate::render::Frame;
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
            lens_blur: config.lens_blur * unit((draw >> 32) as u16),
            noise: config.noise * (0.4 + 1.2 * unit((draw >> 48) as u16)),
            shutter_s: shortest * (longest / shortest).powf(unit(mix(seed, u64::MAX - 2) as u16)),
            smeared: Vec::new(),
            gains: Vec::new(),
        }
    }

    /// Fills `rgb` from the frame's colours.
    pub(super) fn expose(&mut self, frame: &Frame, motion: &Motion, seed: u64, rgb: &mut [u8]) {
        self.smear(frame, motion);
        let sum: u64 = self.smeared.iter().map(|c| u64::from(*c)).sum();
        let mean = (sum as f32 / self.smeared.len().max(1) as f32).max(1.0);
        let auto = (self.config.mean_level / mean).powf(self.config.auto_exposure).clamp(1.0 / GAIN_MAX, GAIN_MAX);
        let gain = self.tone.map(|tone| tone * auto);
        let (width, height, blur) = (frame.width, frame.height, self.lens_blur);
        let (stride, centre) = (3 * width, 1.0 - 4.0 * blur);
        self.gains.clear();
        self.gains.extend(gain.iter().cycle().take(stride));
        for v in 0..height {
            let row = |v: usize| &self.smeared[v * stride..(v + 1) * stride];
            let (above, here, below) = (row(v.saturating_sub(1)), row(v), row((v + 1).min(height - 1)));
            let start = mix(seed, v as u64) as usize % (NOISE.len() - stride);
            let noise = &NOISE[start..start + stride];
            let out = &mut rgb[v * stride..(v + 1) * stride];
            let level = |i: usize, left: u8, right: u8| {
                let beside = f32::from(left) + f32::from(right);
                let around = beside + f32::from(above[i]) + f32::from(below[i]);
                let soft = f32::from(here[i]) * centre + around * blur;
                (soft * self.gains[i] + self.noise * noise[i] + 0.5).clamp(0.0, 255.0) as u8
            };
            for i in 3..stride - 3 {
                out[i] = level(i, here[i - 3], here[i + 3]);
            }
            for i in 0..3 {
                let last = stride - 3 + i;
                out[i] = level(i, here[i], here[(i + 3).min(last)]);
                out[last] = level(last, here[last.saturating_sub(3)], here[last]);
            }
        }
    }

    /// Averages each pixel along its way through the image while the shutter is open.
    fn smear(&mut self, frame: &Frame, motion: &Motion) {
        self.smeared.clear();
        self.smeared.extend_from_slice(&frame.rgb);
        let (vel, turn) = (motion.vel_cam.cast::<f32>(), motion.ang_vel_cam.cast::<f32>());
        let (width, height) = (frame.width, frame.height);
        let (half_w, half_h, inv_f) = (0.5 * width as f32, 0.5 * height as f32, 1.0 / self.focal_px);
        for v in 0..height {
            for u in 0..width {
                let pixel = v * width + u;
                let ray = Vector3::new(1.0, (half_w - u as f32 - 0.5) * inv_f, (half_h - v as f32 - 0.5) * inv_f);
                let inv_depth = 1.0 / frame.depth_m[pixel].min(FAR_M);
                // A resting point moves by −v − ω × p in the camera frame; here over its depth.
                let drift = -vel * inv_depth - turn.cross(&ray);
                let scale = -self.focal_px * self.shutter_s;
                let (du, dv) = (scale * (drift.y - ray.y * drift.x), scale * (drift.z - ray.z * drift.x));
                let length = du.abs().max(dv.abs());
                if length < SHORT_PX {
                    continue;
                }
                let taps = (length + 1.0).ceil().min(TAPS_MAX) as usize;
                let step = 1.0 / (taps - 1) as f32;
                let mut sum = [0u16; 3];
                for tap in 0..taps {
                    let along = tap as f32 * step - 0.5;
                    let at_u = (u as f32 + 0.5 + along * du).clamp(0.0, (width - 1) as f32) as usize;
                    let at_v = (v as f32 + 0.5 + along * dv).clamp(0.0, (height - 1) as f32) as usize;
                    let from = 3 * (at_v * width + at_u);
                    for (sum, value) in sum.iter_mut().zip(&frame.rgb[from..from + 3]) {
                        *sum += u16::from(*value);
                    }
                }
                let share = 1.0 / taps as f32;
                for (channel, sum) in sum.into_iter().enumerate() {
                    self.smeared[3 * pixel + channel] = (f32::from(sum) * share) as u8;
                }
            }
        }
    }
}
