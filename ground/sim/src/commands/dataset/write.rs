//! A data set on disk.
//!
//! `dataset.json`; for each scene `scene_0000/` with `rgb.npy` (uint8 `[M, H, W, 3]`), `depth.npy` (uint16
//! `[M, H, W]`, mm, 0: none), `labels.csv`, `environment.ply` (obstacle voxels), `ground.npy` (float32 `[y, x]`
//! heights at nodes) and `scene.json`. A scene is written beside its place and renamed when complete.

use super::npy::write_npy;
use super::voxels::{VOXEL_M, obstacle_voxels};
use super::{DatasetConfig, DatasetError, DatasetJson, LabelledFrame};
use crate::world::World;
use crate::world::cloud::write_ply;
use serde::Serialize;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

#[derive(Serialize)]
struct SceneJson {
    seed: u64,
    spacing_m: f64,
    min_xyz: [f64; 3],
    max_xyz: [f64; 3],
    start_xyz: [f64; 3],
    voxel_m: f64,
    ground_cell_m: f64,
    /// World (x, y) of `ground.npy[0, 0]`; its first axis is y.
    ground_min_xy: [f64; 2],
    ground_shape: [usize; 2],
}

fn failed<'a>(action: &'static str, path: &'a Path) -> impl FnOnce(io::Error) -> DatasetError + 'a {
    move |source| DatasetError::Io { action, path: path.to_owned(), source }
}

/// Makes the folder and `dataset.json`, or checks that what is there is the same data set.
pub(super) fn open(config: &DatasetConfig) -> Result<(), DatasetError> {
    let camera = config.camera;
    let mut json = DatasetJson {
        version: 1,
        width: camera.width,
        height: camera.height,
        hfov_rad: camera.hfov_rad,
        vfov_rad: camera.vfov_rad(),
        seed: config.seed,
        scenes: config.scenes,
        frames: config.frames,
        commit: config.commit.clone(),
    };
    fs::create_dir_all(&config.out).map_err(failed("create", &config.out))?;
    let path = config.out.join("dataset.json");
    if path.exists() {
        let text = fs::read_to_string(&path).map_err(failed("read", &path))?;
        // More scenes may be asked for later; anything else must agree, the revision aside.
        let same = serde_json::from_str::<DatasetJson>(&text).is_ok_and(|there| {
            DatasetJson { scenes: json.scenes, commit: json.commit.clone(), ..there.clone() } == json
                && there.scenes <= json.scenes
        });
        if !same {
            return Err(DatasetError::Other { path: config.out.clone(), found: text.replace('\n', " ") });
        }
        // Scenes of before were made by another revision.
        if let Ok(there) = serde_json::from_str::<DatasetJson>(&text) {
            let known = there.commit.split(", ").any(|commit| commit == json.commit);
            json.commit = if known { there.commit } else { format!("{}, {}", there.commit, json.commit) };
        }
    }
    let text = serde_json::to_string_pretty(&json).expect("plain data is JSON");
    // Beside its place and renamed: another process may be making other scenes of the set, and read it.
    let partial = config.out.join(format!(".dataset.{}.partial", std::process::id()));
    fs::write(&partial, text + "\n").map_err(failed("write", &partial))?;
    fs::rename(&partial, &path).map_err(failed("rename to", &path))
}

/// Writes a scene's folder, all or nothing.
pub(super) fn scene(folder: &Path, world: &World, frames: &[LabelledFrame]) -> Result<(), DatasetError> {
    let name = folder.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let partial = folder.with_file_name(format!(".{name}.partial"));
    if partial.exists() {
        fs::remove_dir_all(&partial).map_err(failed("remove", &partial))?;
    }
    fs::create_dir_all(&partial).map_err(failed("create", &partial))?;
    let file = |name: &str, fill: &dyn Fn(&mut BufWriter<File>) -> io::Result<()>| {
        let path = partial.join(name);
        let written = File::create_new(&path).and_then(|f| {
            let mut out = BufWriter::new(f);
            fill(&mut out)?;
            out.flush()
        });
        written.map_err(failed("write", &path))
    };
    let (height, width) = frames.first().map_or((0, 0), |f| (f.image.height, f.image.width));
    let rgb: Vec<u8> = frames.iter().flat_map(|f| f.image.rgb.iter().copied()).collect();
    let depth: Vec<u8> = frames.iter().flat_map(|f| f.image.depth_mm.iter().flat_map(|d| d.to_le_bytes())).collect();
    file("rgb.npy", &|out| write_npy(out, "|u1", &[frames.len(), height, width, 3], &rgb))?;
    file("depth.npy", &|out| write_npy(out, "<u2", &[frames.len(), height, width], &depth))?;
    file("labels.csv", &|out| labels(out, frames))?;
    file("environment.ply", &|out| write_ply(out, &obstacle_voxels(world)))?;
    let ground = world.ground();
    let (rows, columns) = ground.shape();
    let heights: Vec<u8> = ground.heights().iter().flat_map(|h| h.to_le_bytes()).collect();
    file("ground.npy", &|out| write_npy(out, "<f4", &[rows, columns], &heights))?;
    let json = SceneJson {
        seed: world.seed(),
        spacing_m: world.spacing_m(),
        min_xyz: world.min_world().into(),
        max_xyz: world.max_world().into(),
        start_xyz: world.start_world().into(),
        voxel_m: VOXEL_M,
        ground_cell_m: ground.cell_m(),
        ground_min_xy: ground.min_xy(),
        ground_shape: [rows, columns],
    };
    file("scene.json", &|out| serde_json::to_writer_pretty(out, &json).map_err(io::Error::from))?;
    fs::rename(&partial, folder).map_err(failed("rename to", folder))
}

fn labels(out: &mut impl Write, frames: &[LabelledFrame]) -> io::Result<()> {
    writeln!(out, "frame,x,y,z,qw,qx,qy,qz,target_x,target_y,target_z,visible,ground_z")?;
    for (index, frame) in frames.iter().enumerate() {
        let (p, q) = (frame.sample.camera.pos_world, frame.sample.camera.world_from_cam);
        write!(out, "{index},{:.6},{:.6},{:.6},{:.9},{:.9},{:.9},{:.9},", p.x, p.y, p.z, q.w, q.i, q.j, q.k)?;
        match super::target_world(frame.sample.person.as_ref()) {
            Some(t) => write!(out, "{:.6},{:.6},{:.6},", t.x, t.y, t.z)?,
            None => write!(out, ",,,")?,
        }
        writeln!(out, "{:.4},{:.6}", frame.visible, frame.ground_z)?;
    }
    Ok(())
}
