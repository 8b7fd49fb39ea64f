//! A camera that lies: what its pictures become, and when they come.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::sense::rgbd::{RgbdImage, mix};

/// What goes wrong with the camera's stream. Stamps and numbers go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CameraFault {
    /// The last picture again and again.
    Frozen,
    /// Black, and no depth.
    Blank,
    /// Every pixel drawn by chance.
    Noise,
    /// A depth of 0.3 m everywhere.
    Near,
    /// A depth of 19 m everywhere.
    Far,
    /// Five pictures a second.
    Slow,
    /// A second camera, which looks backwards, at 77 Hz on the same key.
    Two,
}

/// The depths that everything is at, mm.
const NEAR_MM: u16 = 300;
const FAR_MM: u16 = 19_000;
/// Frames between those that a slow camera delivers: 5 of 30 Hz.
const SLOW_FRAMES: u64 = 6;

impl CameraFault {
    /// All of them.
    pub const ALL: [Self; 7] = [Self::Frozen, Self::Blank, Self::Noise, Self::Near, Self::Far, Self::Slow, Self::Two];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Frozen => "camera-frozen",
            Self::Blank => "camera-blank",
            Self::Noise => "camera-noise",
            Self::Near => "camera-near",
            Self::Far => "camera-far",
            Self::Slow => "camera-slow",
            Self::Two => "camera-two",
        }
    }

    pub(super) fn noticed_as(self) -> &'static [&'static str] {
        match self {
            Self::Frozen => &["frozen"],
            Self::Blank => &["blank"],
            Self::Noise => &["noise"],
            Self::Near => &["one-depth", "covered"],
            Self::Far => &["one-depth"],
            Self::Slow => &["slow"],
            Self::Two => &["two-cameras"],
        }
    }
}

/// Changes the pictures of a flight.
#[derive(Clone, Debug)]
pub struct Tampered {
    rng: ChaCha8Rng,
    /// The last picture before the fault.
    frozen: Option<RgbdImage>,
}

impl Tampered {
    /// Of the flight of this seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { rng: ChaCha8Rng::seed_from_u64(mix(seed, 23)), frozen: None }
    }

    /// The true `image`, frame `number`, becomes what the camera delivers; false: it delivers none.
    pub fn apply(&mut self, fault: CameraFault, number: u64, image: &mut RgbdImage) -> bool {
        match fault {
            CameraFault::Frozen => image.clone_from(self.frozen.get_or_insert_with(|| image.clone())),
            CameraFault::Blank => {
                image.rgb.fill(0);
                image.depth_mm.fill(0);
            }
            CameraFault::Noise => {
                self.rng.fill(&mut image.rgb[..]);
                image.depth_mm.fill_with(|| self.rng.random_range(0..20_000));
            }
            CameraFault::Near => image.depth_mm.fill(NEAR_MM),
            CameraFault::Far => image.depth_mm.fill(FAR_MM),
            CameraFault::Slow => return number.is_multiple_of(SLOW_FRAMES),
            CameraFault::Two => {}
        }
        true
    }
}
