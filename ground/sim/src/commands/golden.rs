//! `goshawk-sim golden`: the images that a policy must answer before it may fly, with the answers that it gives now.

use std::path::{Path, PathBuf};

use clap::Args;
use color_eyre::eyre::{Result, WrapErr, bail};
use goshawk_core::{ANCHORS, Rot, StateParts, Task, Vec3};
use goshawk_policy::golden::GoldenFrame;
use goshawk_policy::{Golden, Policy, Preprocessor, Source};
use sha2::{Digest, Sha256};

use crate::actors::evader::Course;
use crate::commands::fly::files::Files;
use crate::render::{Camera, CameraPose, Frame, Renderer};
use crate::sense::file::Sensors;
use crate::sense::rgbd::{Motion, RgbdImage, mix};
use crate::trial::{Scene, SceneConfig, WorldSource};

/// What stands between these in the card is written here.
const MARKS: [&str; 2] = ["<!-- file: begin -->", "<!-- file: end -->"];
/// The camera hangs so high above the ground, m, and looks so far to the side in each further image, rad.
const HEIGHT_M: f64 = 1.5;
const TURN_RAD: f64 = 0.35;
/// The evader has run for so long, s.
const RUNNING_S: f64 = 1.0;

/// Write the golden images beside a policy, and both files' SHA-256 into its card.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  goshawk-sim golden --policy air/models/track.onnx\n  \
                  goshawk-sim golden --policy air/models/navigate.onnx --frames 1\n\n\
                  Make them on the processor, once, from the file as it was exported: a vehicle whose policy answers\n  \
                  otherwise is not ready. Then write the SHA-256 into [policy] of the vehicle file.")]
pub struct GoldenArgs {
    /// The policy.
    #[arg(long, value_name = "ONNX")]
    policy: PathBuf,
    /// Images; each takes 78 kB.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=16))]
    frames: u32,
    /// Seed of the forest.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// ONNX Runtime's library; absent: searched for.
    #[arg(long, value_name = "FILE")]
    library: Option<PathBuf>,
}

impl GoldenArgs {
    /// Renders, asks the policy, writes.
    ///
    /// # Errors
    /// The policy cannot be loaded, answers with what is no number, or a file cannot be written.
    pub fn run(self) -> Result<()> {
        let mut policy = Policy::load(&self.policy, self.library.as_deref(), 1)?;
        let golden = make(&mut policy, self.frames, self.seed)?;
        let path = Golden::path(&self.policy);
        let unwritable = |path: &Path| format!("cannot write {}", path.display());
        let (files, bytes) = (Files::default(), golden.to_bytes());
        files.write(&path, &bytes).wrap_err_with(|| unwritable(&path))?;
        // Read back as a vehicle does.
        goshawk_policy::golden::warm_up(&mut policy, &self.policy)?;
        let digest: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        let card = self.policy.with_extension("md");
        if let Ok(text) = std::fs::read_to_string(&card) {
            let text = with_hashes(&text, policy.sha256(), &digest);
            files.write(&card, text.as_bytes()).wrap_err_with(|| unwritable(&card))?;
        }
        println!("{}: {} images, {} bytes", path.display(), golden.frames.len(), bytes.len());
        println!("sha256 = \"{}\"", policy.sha256());
        Ok(())
    }
}

/// The card with the hashes of both files.
fn with_hashes(card: &str, model: &str, golden: &str) -> String {
    let [begin, end] = MARKS;
    let section =
        format!("{begin}\n| file | SHA-256 |\n|---|---|\n| model | `{model}` |\n| golden images | `{golden}` |\n{end}");
    match (card.find(begin), card.find(end)) {
        (Some(from), Some(to)) if from < to => format!("{}{section}{}", &card[..from], &card[to + end.len()..]),
        _ => format!("{}\n\n## File\n{section}\n", card.trim_end()),
    }
}

fn make(policy: &mut Policy, count: u32, seed: u64) -> Result<Golden> {
    let task = policy.contract().model().task;
    let scene =
        Scene::new(&SceneConfig::of_task(task, 4.0, WorldSource::Forest { spacing_m: 4.0 }, Course::Goal, seed))?;
    let camera = Camera { hfov_rad: policy.contract().image.hfov_rad, ..Camera::default() };
    let source = Source {
        width: camera.width as u32,
        height: camera.height as u32,
        hfov_rad: camera.hfov_rad,
        vfov_rad: camera.vfov_rad(),
    };
    let mut preprocessor = Preprocessor::new(policy.contract(), source)?;
    let mut sensor = Sensors::default().sensor(&camera, mix(seed, 14));
    let mut frames = Vec::new();
    for index in 0..count {
        let pose = pose(&scene, f64::from(index) * TURN_RAD);
        let person = scene.person_at(RUNNING_S);
        let (mut frame, mut image) = (Frame::default(), RgbdImage::default());
        Renderer::new(camera).render_with(&scene.world, &[], person.as_ref(), &pose, &mut frame);
        sensor.capture(&frame, &Motion::still(), mix(seed, u64::from(index)), &mut image);
        let state = policy.contract().model().state.state(&parts(&pose, task));
        let network = policy.infer(preprocessor.run(&image.rgb, &image.depth_mm)?, &state)?;
        let answer = network.values[..policy.contract().channels.len() * ANCHORS].to_vec();
        if !answer.iter().all(|value| value.is_finite()) {
            bail!("the policy's answer to image {index} is no number: export it again");
        }
        frames.push(GoldenFrame { rgb: image.rgb, depth_mm: image.depth_mm, state: state.to_vec(), answer });
    }
    Ok(Golden { width: camera.width, height: camera.height, frames })
}

fn pose(scene: &Scene, turn_rad: f64) -> CameraPose {
    let heading = scene.world.start_heading_rad() + turn_rad;
    CameraPose {
        pos_world: scene.world.start_world() + Vec3::new(0.0, 0.0, HEIGHT_M),
        world_from_cam: Rot::from_axis_angle(&Vec3::z_axis(), heading) * Rot::from_axis_angle(&Vec3::y_axis(), -0.09),
    }
}

/// Half the speed ahead, an aim ahead, the camera's own up.
fn parts(pose: &CameraPose, task: Task) -> StateParts {
    StateParts {
        velocity: Vec3::new(0.5, 0.0, 0.0),
        acceleration: Vec3::zeros(),
        up: pose.world_from_cam.inverse_transform_vector(&Vec3::z()),
        aim: Vec3::new(if task == Task::Track { 0.5 } else { 1.0 }, 0.0, 0.0),
        agility: 0.7,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_card_gets_its_hashes_once_and_keeps_the_rest() {
        let card = with_hashes("# Policy\n\n## Limits\nNone.\n", "aa", "bb");
        assert!(card.starts_with("# Policy\n\n## Limits\nNone.\n\n## File\n"), "{card}");
        let again = with_hashes(&card, "cc", "dd");
        assert!(again.contains("| model | `cc` |") && !again.contains("aa"), "{again}");
        assert_eq!(again.matches("## File").count(), 1);
    }
}
