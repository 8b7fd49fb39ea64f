//! Golden images: what a policy is shown before it may fly, and what it answered when it was exported. A network whose
//! weights are not what they were answers otherwise.
//!
//! They lie beside the model, `track.golden` beside `track.onnx`. The file: [`MAGIC`], then as little-endian u32 the
//! number of frames, width, height, numbers of the state, numbers of the answer; then each frame: colour
//! `[height, width, 3]` bytes, depth `[height, width]` u16 in mm, state f32, answer f32, little-endian.

use std::path::{Path, PathBuf};

use crate::policy::{Policy, PolicyError};
use crate::preprocess::{PreprocessError, Preprocessor, Source};

/// What a file of golden images begins with.
pub const MAGIC: &[u8; 16] = b"GOSHAWK GOLDEN 1";
/// An image's answers may differ so much: the root mean square of the differences, each as a share of its number, or of 1
/// where the number is smaller. Another provider rounds otherwise, and in 8 or 16 bits one rounding moves single numbers
/// far. Chosen by eye: two ways to calculate a shipped policy in 8 bits were 0.03 apart, and one without its first layer
/// answers 1.5 off.
pub const TOLERANCE: f32 = 0.1;
/// No file is larger: frames, pixels of a side, numbers.
const MOST: [u32; 5] = [16, 1024, 1024, 64, 1024];

/// One image with the answer to it.
#[derive(Clone, Debug, PartialEq)]
pub struct GoldenFrame {
    /// `[height, width, 3]`.
    pub rgb: Vec<u8>,
    /// `[height, width]`, mm; 0: no measurement.
    pub depth_mm: Vec<u16>,
    /// The network's `state` input.
    pub state: Vec<f32>,
    /// The network's raw answer.
    pub answer: Vec<f32>,
}

/// The golden images of one policy, all of one size.
#[derive(Clone, Debug, PartialEq)]
pub struct Golden {
    /// px.
    pub width: usize,
    /// px.
    pub height: usize,
    /// At least one.
    pub frames: Vec<GoldenFrame>,
}

/// Why a policy does not pass.
#[derive(Debug, thiserror::Error)]
pub enum GoldenError {
    /// There are none.
    #[error(
        "no golden images in {} ({source}): make them with `goshawk-sim golden`, or name a policy that has them",
        path.display()
    )]
    Read {
        /// Where they were looked for.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// They are none of this form, or not of this policy's sizes.
    #[error("the golden images do not fit the policy ({0}): make them again with `goshawk-sim golden`")]
    Form(&'static str),
    /// They cannot be prepared.
    #[error("the golden images do not fit the policy: {0}")]
    Prepare(#[from] PreprocessError),
    /// The network fails on them.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// It answers otherwise.
    #[error(
        "the policy does not answer golden image {frame} as its card says: the answers differ by {off}, the root mean \
         square, and not by at most {TOLERANCE}: its weights are damaged, or this provider computes wrongly"
    )]
    Answer {
        /// From 0.
        frame: usize,
        /// By how much, as [`TOLERANCE`] counts it.
        off: f32,
    },
}

impl Golden {
    /// Where a model's golden images lie.
    #[must_use]
    pub fn path(model: &Path) -> PathBuf {
        model.with_extension("golden")
    }

    /// Reads those of `model`.
    ///
    /// # Errors
    /// There are none, or they are not of this form.
    pub fn load(model: &Path) -> Result<Self, GoldenError> {
        let path = Self::path(model);
        let bytes = std::fs::read(&path).map_err(|source| GoldenError::Read { path, source })?;
        Self::from_bytes(&bytes)
    }

    /// From a file's bytes.
    ///
    /// # Errors
    /// Not of this form, or an answer that is no number.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, GoldenError> {
        let mut rest = bytes.strip_prefix(MAGIC).ok_or(GoldenError::Form("no golden images"))?;
        let mut sizes = [0; 5];
        for (size, most) in sizes.iter_mut().zip(MOST) {
            let (first, after) = rest.split_first_chunk::<4>().ok_or(GoldenError::Form("cut off"))?;
            let value = u32::from_le_bytes(*first);
            if value == 0 || value > most {
                return Err(GoldenError::Form("a size is out of range"));
            }
            (*size, rest) = (value as usize, after);
        }
        let [count, width, height, state, answer] = sizes;
        let pixels = width * height;
        let length = 5 * pixels + 4 * (state + answer);
        if rest.len() != count * length {
            return Err(GoldenError::Form("cut off, or too long"));
        }
        let floats = |bytes: &[u8]| bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect::<Vec<_>>();
        let frame = |bytes: &[u8]| {
            let (rgb, bytes) = bytes.split_at(3 * pixels);
            let (depth, bytes) = bytes.split_at(2 * pixels);
            let (state, answer) = bytes.split_at(4 * state);
            let depth_mm = depth.as_chunks::<2>().0.iter().map(|b| u16::from_le_bytes(*b)).collect();
            GoldenFrame { rgb: rgb.to_vec(), depth_mm, state: floats(state), answer: floats(answer) }
        };
        let frames: Vec<_> = rest.chunks_exact(length).map(frame).collect();
        let whole = |frame: &GoldenFrame| frame.state.iter().chain(&frame.answer).all(|value| value.is_finite());
        if !frames.iter().all(whole) {
            return Err(GoldenError::Form("an answer is no number"));
        }
        Ok(Self { width, height, frames })
    }

    /// A file's bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let numbers = |of: fn(&GoldenFrame) -> usize| self.frames.first().map_or(0, of);
        let sizes =
            [self.frames.len(), self.width, self.height, numbers(|f| f.state.len()), numbers(|f| f.answer.len())];
        let mut bytes = MAGIC.to_vec();
        bytes.extend(sizes.iter().flat_map(|size| (*size as u32).to_le_bytes()));
        for frame in &self.frames {
            bytes.extend(&frame.rgb);
            bytes.extend(frame.depth_mm.iter().flat_map(|mm| mm.to_le_bytes()));
            bytes.extend(frame.state.iter().chain(&frame.answer).flat_map(|value| value.to_le_bytes()));
        }
        bytes
    }

    /// Shows the images to `policy`; gives the largest difference of an image's answers, as [`TOLERANCE`] counts it.
    ///
    /// # Errors
    /// It answers otherwise than it did, or the images do not fit it.
    pub fn check(&self, policy: &mut Policy) -> Result<f32, GoldenError> {
        let image = policy.contract().image;
        let source = Source {
            width: self.width as u32,
            height: self.height as u32,
            hfov_rad: image.hfov_rad,
            vfov_rad: image.vfov_rad,
        };
        let mut preprocessor = Preprocessor::new(policy.contract(), source)?;
        let numbers = policy.contract().channels.len() * goshawk_core::ANCHORS;
        let mut worst = 0.0f32;
        for (index, frame) in self.frames.iter().enumerate() {
            if frame.answer.len() != numbers {
                return Err(GoldenError::Form("another number of answers"));
            }
            let answer = policy.infer(preprocessor.run(&frame.rgb, &frame.depth_mm)?, &frame.state)?;
            let off = difference(&answer.values, &frame.answer);
            // Not finite is not within either.
            let within = off <= TOLERANCE;
            if !within {
                return Err(GoldenError::Answer { frame: index, off });
            }
            worst = worst.max(off);
        }
        Ok(worst)
    }
}

/// As [`TOLERANCE`] counts it.
fn difference(found: &[f32], needed: &[f32]) -> f32 {
    let share = |(&found, &needed): (&f32, &f32)| (found - needed) / needed.abs().max(1.0);
    let squares: f32 = found.iter().zip(needed).map(|pair| share(pair).powi(2)).sum();
    (squares / needed.len() as f32).sqrt()
}

/// The policy answers its golden images, which lie beside `model`, as it did when it was exported.
///
/// # Errors
/// It does not, or there are none.
pub fn warm_up(policy: &mut Policy, model: &Path) -> Result<f32, GoldenError> {
    Golden::load(model)?.check(policy)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn golden() -> Golden {
        let frame = |k: u8| GoldenFrame {
            rgb: vec![k; 12],
            depth_mm: vec![u16::from(k) * 300; 4],
            state: vec![0.5, -1.0],
            answer: vec![f32::from(k), 2.0, -3.0],
        };
        Golden { width: 2, height: 2, frames: vec![frame(1), frame(2)] }
    }

    #[test]
    fn golden_images_are_read_as_they_were_written() {
        assert_eq!(Golden::from_bytes(&golden().to_bytes()).unwrap(), golden());
    }

    #[test]
    fn a_damaged_file_is_refused_without_a_panic() {
        let bytes = golden().to_bytes();
        for length in 0..bytes.len() {
            assert!(Golden::from_bytes(&bytes[..length]).is_err());
        }
        let mut huge = bytes.clone();
        huge[16..20].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(Golden::from_bytes(&huge).is_err());
        let mut nan = golden();
        nan.frames[1].answer[2] = f32::NAN;
        assert!(matches!(Golden::from_bytes(&nan.to_bytes()), Err(GoldenError::Form("an answer is no number"))));
    }
}
