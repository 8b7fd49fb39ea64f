//! Data sets: scenes of random camera poses with RGB-D images, labels and the scene's true obstacles.
//!
//! The layout (see [`write`]) is what the trainer reads. Every scene depends on the data set's seed and its own
//! number alone, so neither threads nor a restart change a byte.

mod clutter;
mod npy;
mod sample;
mod voxels;
mod write;

pub use npy::{NpyError, read_npy};
pub use sample::{FrameSample, sample_frame};
pub use voxels::{VOXEL_M, obstacle_voxels};

use crate::actors::person::Person;
use crate::render::{Camera, Frame, Renderer};
use crate::sense::file::Sensors;
use crate::sense::rgbd::{RgbdImage, mix};
use crate::world::forest::{ForestConfig, forest};
use crate::world::{World, WorldError};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Share of frames with a person.
const WITH_PERSON: f64 = 0.88;

/// Share of frames with a person for which a half hidden one is sought, and how long: chance alone hides too few to
/// learn from.
const HALF_HIDDEN: f64 = 0.2;
const HALF_HIDDEN_TRIES: usize = 60;

/// Share of frames with a hidden person that are kept.
const KEEP_HIDDEN: f64 = 0.5;

/// What to generate.
#[derive(Clone, Debug, PartialEq)]
pub struct DatasetConfig {
    /// Where; made if absent.
    pub out: PathBuf,
    /// Number of scenes.
    pub scenes: usize,
    /// Frames in each.
    pub frames: usize,
    /// Seed of everything.
    pub seed: u64,
    /// The camera that sees them.
    pub camera: Camera,
    /// Revision of the code, recorded.
    pub commit: String,
    /// The scenes to make now; others may be made elsewhere at the same time. Of none, `dataset.json` alone is made.
    pub only: Range<usize>,
}

/// Why a data set cannot be made.
#[derive(Debug, Error)]
pub enum DatasetError {
    /// Nothing to do.
    #[error("a data set needs at least one scene of one frame")]
    Empty,
    /// Scenes that the data set does not have.
    #[error("scenes {} to {} are not all among the {scenes} of the data set, which begin with 0", only.start, only.end)]
    NotThere {
        /// What was asked for.
        only: Range<usize>,
        /// How many there are.
        scenes: usize,
    },
    /// The folder holds something else.
    #[error("{path} already holds a data set of other parameters ({found}): choose another folder or delete it")]
    Other {
        /// The folder.
        path: PathBuf,
        /// Its parameters.
        found: String,
    },
    /// A file or folder could not be read or written.
    #[error("cannot {action} {path}: {source}")]
    Io {
        /// What was tried.
        action: &'static str,
        /// On what.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// A world could not be made.
    #[error(transparent)]
    World(#[from] WorldError),
    /// No free place for the camera was found.
    #[error("scene {scene}: no free camera place found for frame {frame} in {tries} tries; is the forest too dense?")]
    NoPlace {
        /// The scene's number.
        scene: usize,
        /// The frame's number.
        frame: usize,
        /// How often it was tried.
        tries: usize,
    },
}

/// `dataset.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DatasetJson {
    /// Of this layout.
    pub version: u32,
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Horizontal field of view.
    pub hfov_rad: f64,
    /// Vertical field of view.
    pub vfov_rad: f64,
    /// Seed of everything.
    pub seed: u64,
    /// Number of scenes.
    pub scenes: usize,
    /// Frames in each.
    pub frames: usize,
    /// Revision of the code that made it.
    pub commit: String,
}

/// One frame as it goes to disk.
#[derive(Clone, Debug)]
pub struct LabelledFrame {
    /// Where the camera and the person were.
    pub sample: FrameSample,
    /// The unoccluded fraction of the person's pixels.
    pub visible: f64,
    /// Height of the ground below the camera, m.
    pub ground_z: f64,
    /// What the sensor delivered.
    pub image: RgbdImage,
}

/// The seed of one scene.
#[must_use]
pub fn scene_seed(seed: u64, scene: usize) -> u64 {
    // Kept below 2⁵³ so that every JSON reader holds it exactly.
    mix(seed, scene as u64) >> 11
}

/// The world of a scene: trees at a spacing of 3–7 m, one scene in twenty sparse, one in four with walls, boxes and posts
/// between wider spaced trees; in every second one decoys besides.
///
/// # Errors
/// Never with the default rectangle.
pub fn scene_world(seed: u64) -> Result<World, WorldError> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x5ce7e);
    let spacing_m = if rng.random_bool(0.05) { 12.0 } else { rng.random_range(3.0..7.0) };
    let hills_m = rng.random_range(0.1..0.45);
    let grow = |spacing_m| forest(&ForestConfig { spacing_m, hills_m, ..ForestConfig::default() }, seed);
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x0c10_77e4);
    let world = if rng.random_bool(clutter::CLUTTERED) {
        clutter::cluttered(grow(spacing_m + clutter::WIDER_M)?, &mut rng)
    } else {
        grow(spacing_m)?
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xdec0_7000);
    Ok(if rng.random_bool(clutter::WITH_DECOYS) { clutter::with_decoys(world, &mut rng) } else { world })
}

/// Poses, images and labels of one scene.
///
/// # Errors
/// [`DatasetError::NoPlace`] if the world leaves no room.
pub fn scene_frames(
    world: &World,
    camera: Camera,
    scene: usize,
    frames: usize,
) -> Result<Vec<LabelledFrame>, DatasetError> {
    let mut renderer = Renderer::new(camera);
    let sensors = Sensors::default();
    let mut ideal = Frame::default();
    (0..frames)
        .map(|frame| {
            let mut rng = ChaCha8Rng::seed_from_u64(world.seed() ^ 0xf4a3e);
            rng.set_stream(frame as u64 + 1);
            let with_person = rng.random_bool(WITH_PERSON);
            let mut half_hidden = if rng.random_bool(HALF_HIDDEN) { HALF_HIDDEN_TRIES } else { 0 };
            for _ in 0..sample::TRIES {
                let drawn = sample_frame(world, renderer.camera(), with_person, &mut rng);
                let Some(sample) = drawn else { continue };
                renderer.render(world, sample.person.as_ref(), &sample.camera, &mut ideal);
                let visible = ideal.person_visible();
                if with_person {
                    if half_hidden > 0 && !(0.1..0.9).contains(&visible) {
                        half_hidden -= 1;
                        continue;
                    }
                    if visible < 0.05 && !rng.random_bool(KEEP_HIDDEN) {
                        continue;
                    }
                }
                let mut image = RgbdImage::default();
                // Another unit for each frame.
                let mut sensor = sensors.sensor(renderer.camera(), rng.random());
                sensor.capture(&ideal, &sample.motion, rng.random(), &mut image);
                let p = sample.camera.pos_world;
                let ground_z = world.ground_height(p.x, p.y);
                return Ok(LabelledFrame { sample, visible, ground_z, image });
            }
            Err(DatasetError::NoPlace { scene, frame, tries: sample::TRIES })
        })
        .collect()
}

/// Generates whatever of the data set is not there yet, in parallel over the current rayon pool; `done` is told of
/// each scene, `true` if it was there already.
///
/// # Errors
/// The first [`DatasetError`]; finished scenes stay and are skipped next time.
pub fn generate(config: &DatasetConfig, done: impl Fn(bool) + Sync) -> Result<(), DatasetError> {
    if config.scenes == 0 || config.frames == 0 {
        return Err(DatasetError::Empty);
    }
    if config.only.start > config.only.end || config.only.end > config.scenes {
        return Err(DatasetError::NotThere { only: config.only.clone(), scenes: config.scenes });
    }
    write::open(config)?;
    config.only.clone().into_par_iter().try_for_each(|scene| {
        let folder = scene_folder(&config.out, scene);
        if folder.exists() {
            done(true);
            return Ok(());
        }
        let world = scene_world(scene_seed(config.seed, scene))?;
        let frames = scene_frames(&world, config.camera, scene, config.frames)?;
        write::scene(&folder, &world, &frames)?;
        done(false);
        Ok(())
    })
}

/// `OUT/scene_0007`.
#[must_use]
pub fn scene_folder(out: &Path, scene: usize) -> PathBuf {
    out.join(format!("scene_{scene:04}"))
}

/// The person of a sample, if any, as labelled: its centre.
#[must_use]
pub fn target_world(person: Option<&Person>) -> Option<goshawk_core::Vec3> {
    person.map(|p| p.pose.centre_world())
}
