//! From an ideal [`Frame`] to what an RGB-D camera delivers: [`depth`] and [`colour`].
//!
//! A [`Sensor`] is one unit of the product: exposure bias, white balance, lens and shutter are its own. What it makes of a
//! frame is a pure function of the frame, the camera's motion and a seed.

mod colour;
mod depth;

use crate::render::{Camera, Class, Frame};
use goshawk_core::Vec3;
use serde::Deserialize;

pub use colour::ColourConfig;
pub use depth::DepthConfig;

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

/// How the camera moves while the shutter is open, camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Velocity of the lens, m/s.
    pub vel_cam: Vec3,
    /// Angular velocity, rad/s.
    pub ang_vel_cam: Vec3,
}

impl Motion {
    /// A camera on a tripod.
    #[must_use]
    pub fn still() -> Self {
        Self { vel_cam: Vec3::zeros(), ang_vel_cam: Vec3::zeros() }
    }
}

/// How much of the image each lens sees. Beyond it the colour repeats the lens's border, as `goshawk-camera` sends it,
/// and nothing is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewConfig {
    /// Of the colour lens, degrees across and down; absent: all of it.
    pub colour_deg: Option<[f64; 2]>,
    /// Of the depth lenses, likewise.
    pub depth_deg: Option<[f64; 2]>,
}

/// The pixels of `camera` beyond a lens's field, degrees across and down, each with the nearest that the lens sees.
fn beyond(field_deg: Option<[f64; 2]>, camera: &Camera) -> Vec<(usize, usize)> {
    let Some([across, down]) = field_deg else { return Vec::new() };
    let (width, height) = (camera.width, camera.height);
    // Pixels on one side of the axis whose middle the lens sees; one at least.
    let seen = |degrees: f64, half: usize| {
        ((camera.focal_px() * (0.5 * degrees.to_radians()).tan() + 0.5) as usize).clamp(1, half)
    };
    let (right, low) = (seen(across, width / 2), seen(down, height / 2));
    let nearest = |place: usize, size: usize, seen: usize| place.clamp(size / 2 - seen, size / 2 + seen - 1);
    let pairs = (0..width * height).map(|pixel| {
        let (u, v) = (pixel % width, pixel / width);
        (pixel, nearest(v, height, low) * width + nearest(u, width, right))
    });
    pairs.filter(|(pixel, nearest)| pixel != nearest).collect()
}

/// One camera; owns its scratch memory.
#[derive(Clone, Debug)]
pub struct Sensor {
    /// What the colour lens does not see, and the depth lenses: see [`beyond`].
    unseen: [Vec<(usize, usize)>; 2],
    depth: depth::DepthSensor,
    colour: colour::ColourSensor,
}

impl Sensor {
    /// The unit that `seed` draws, for images of `camera`.
    #[must_use]
    pub fn new(view: ViewConfig, depth: DepthConfig, colour: ColourConfig, camera: &Camera, seed: u64) -> Self {
        Self {
            unseen: [view.colour_deg, view.depth_deg].map(|field| beyond(field, camera)),
            depth: depth::DepthSensor::new(depth),
            colour: colour::ColourSensor::new(colour, camera.focal_px() as f32, seed),
        }
    }

    /// The image that the sensor makes of `frame`. Same frame, motion and seed, same image.
    pub fn capture(&mut self, frame: &Frame, motion: &Motion, seed: u64, image: &mut RgbdImage) {
        (image.width, image.height) = (frame.width, frame.height);
        image.rgb.resize(frame.rgb.len(), 0);
        image.depth_mm.resize(frame.depth_m.len(), 0);
        self.depth.measure(frame, seed, &mut image.depth_mm);
        self.colour.expose(frame, motion, seed ^ 0x5bd1_e995_7b93_1f27, &mut image.rgb);
        let [colour, depth] = &self.unseen;
        colour.iter().for_each(|&(pixel, seen)| image.rgb.copy_within(3 * seen..3 * seen + 3, 3 * pixel));
        depth.iter().for_each(|&(pixel, _)| image.depth_mm[pixel] = 0);
    }

    /// Pixels of `frame`, which may yet be empty, that show the person where the colour lens does not see.
    #[must_use]
    pub fn person_pixels_unseen(&self, frame: &Frame) -> u32 {
        let person = |&&(pixel, _): &&(usize, usize)| frame.class.get(pixel) == Some(&(Class::Person as u8));
        self.unseen[0].iter().filter(person).count() as u32
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

/// The low 16 bits as 0..1.
#[inline(always)]
fn unit(bits: u32) -> f32 {
    (bits & 0xffff) as i32 as f32 * (1.0 / 65_536.0)
}

/// About normal, unit variance, within ±3.5: the sum of four uniform bytes.
#[inline(always)]
fn gaussian(bits: u32) -> f32 {
    let pairs = (bits & 0x00ff_00ff) + ((bits >> 8) & 0x00ff_00ff);
    let sum = (pairs & 0xffff) + (pairs >> 16);
    (sum as i32 as f32 - 510.0) * (1.0 / 147.8)
}
