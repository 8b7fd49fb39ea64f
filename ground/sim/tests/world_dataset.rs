//! A data set is what its layout says, its labels agree with its images, and nothing but the seed decides it.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use goshawk_core::{Rot, Vec3};
use goshawk_sim::commands::dataset::{
    DatasetConfig, DatasetError, DatasetJson, VOXEL_M, generate, obstacle_voxels, read_npy, scene_seed, scene_world,
};
use goshawk_sim::render::Camera;
use goshawk_sim::world::Kind;
use goshawk_sim::world::forest::{ForestConfig, forest};
use nalgebra::Quaternion;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

fn config(out: &Path, scenes: usize, frames: usize) -> DatasetConfig {
    let (camera, commit) = (Camera::default(), "test".to_owned());
    DatasetConfig { out: out.to_owned(), scenes, frames, seed: 77, camera, commit, only: 0..scenes }
}

fn generate_on(threads: usize, config: &DatasetConfig) -> (usize, usize) {
    let (made, kept) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let count = |there| if there { &kept } else { &made }.fetch_add(1, Ordering::Relaxed);
    pool.install(|| generate(config, |there| _ = count(there))).unwrap();
    (made.into_inner(), kept.into_inner())
}

/// Every file below a folder, by its path there.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let name = entry.file_name().into_string().unwrap();
        if entry.path().is_dir() {
            all.extend(files(&entry.path()).into_iter().map(|(k, v)| (format!("{name}/{k}"), v)));
        } else {
            all.insert(name, fs::read(entry.path()).unwrap());
        }
    }
    all
}

#[test]
fn one_thread_and_two_write_the_same_bytes() {
    let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    assert_eq!(generate_on(1, &config(a.path(), 3, 6)), (3, 0));
    assert_eq!(generate_on(2, &config(b.path(), 3, 6)), (3, 0));
    let (a, b) = (files(a.path()), files(b.path()));
    assert_eq!(a.len(), 1 + 3 * 6);
    assert!(a == b, "the data sets differ");
}

#[test]
fn a_finished_scene_is_kept_and_a_partial_one_made_again() {
    let dir = tempfile::tempdir().unwrap();
    generate_on(1, &config(dir.path(), 2, 3));
    let before = files(dir.path());
    fs::rename(dir.path().join("scene_0001"), dir.path().join(".scene_0001.partial")).unwrap();
    assert_eq!(generate_on(1, &config(dir.path(), 2, 3)), (1, 1));
    assert!(files(dir.path()) == before);
    assert_eq!(generate_on(1, &config(dir.path(), 3, 3)), (1, 2), "more scenes may be asked for");
}

#[test]
fn scenes_made_alone_are_those_of_the_whole_set() {
    let (whole, parts) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    generate_on(2, &config(whole.path(), 3, 4));
    let only = |only| DatasetConfig { only, ..config(parts.path(), 3, 4) };
    assert_eq!(generate_on(1, &only(0..0)), (0, 0), "none: the set's description alone");
    assert_eq!(generate_on(1, &only(2..3)), (1, 0));
    assert_eq!(generate_on(1, &only(0..2)), (2, 0));
    assert!(files(parts.path()) == files(whole.path()), "the data sets differ");
    assert!(matches!(generate(&only(2..4), |_| ()), Err(DatasetError::NotThere { .. })));
}

#[test]
fn a_folder_of_another_data_set_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    generate_on(1, &config(dir.path(), 1, 2));
    let other = DatasetConfig { seed: 78, ..config(dir.path(), 1, 2) };
    assert!(matches!(generate(&other, |_| ()), Err(DatasetError::Other { .. })));
    let other = DatasetConfig { camera: narrow(), ..config(dir.path(), 1, 2) };
    assert!(matches!(generate(&other, |_| ()), Err(DatasetError::Other { .. })));
    assert!(matches!(generate(&config(dir.path(), 0, 2), |_| ()), Err(DatasetError::Empty)));
    let file = dir.path().join("dataset.json").join("below");
    let error = generate(&config(&file, 1, 1), |_| ()).unwrap_err();
    assert!(error.to_string().contains("cannot create"), "{error}");
}

/// 64 x 41 degrees, in place of 90 x 62.
fn narrow() -> Camera {
    Camera { hfov_rad: 64_f64.to_radians(), ..Camera::default() }
}

#[test]
fn arrays_and_labels_can_be_read_back_and_agree() {
    read_back(Camera::default());
}

#[test]
fn arrays_and_labels_of_a_narrower_camera_agree_too() {
    read_back(narrow());
}

fn read_back(camera: Camera) {
    let dir = tempfile::tempdir().unwrap();
    let frames = 40;
    generate_on(2, &DatasetConfig { camera, ..config(dir.path(), 1, frames) });
    let json: DatasetJson = serde_json::from_slice(&fs::read(dir.path().join("dataset.json")).unwrap()).unwrap();
    assert_eq!((json.version, json.width, json.height, json.frames), (1, 160, 96, frames));
    assert_eq!((json.hfov_rad, json.vfov_rad), (camera.hfov_rad, camera.vfov_rad()));

    let scene = dir.path().join("scene_0000");
    let file = fs::read(scene.join("depth.npy")).unwrap();
    let (descr, shape, depth) = read_npy(&file).unwrap();
    assert_eq!((descr.as_str(), shape), ("<u2", vec![frames, 96, 160]));
    assert_eq!((file.len() - depth.len()) % 64, 0, "NumPy wants aligned data");
    let rgb = fs::read(scene.join("rgb.npy")).unwrap();
    let (descr, shape, colours) = read_npy(&rgb).unwrap();
    assert_eq!((descr.as_str(), shape), ("|u1", vec![frames, 96, 160, 3]));
    assert_eq!(colours.len(), frames * 96 * 160 * 3);

    let world = scene_world(scene_seed(77, 0)).unwrap();
    let ground = fs::read(scene.join("ground.npy")).unwrap();
    let (descr, shape, heights) = read_npy(&ground).unwrap();
    assert_eq!((descr.as_str(), shape), ("<f4", vec![101, 141]));
    let node = |iy: usize, ix: usize| f32::from_le_bytes(heights[4 * (iy * 141 + ix)..][..4].try_into().unwrap());
    assert!((f64::from(node(30, 100)) - world.ground_height(50.0, -10.0)).abs() < 1e-6);

    let labels = fs::read_to_string(scene.join("labels.csv")).unwrap();
    let (mut with_person, mut at_depth, mut clear_view) = (0, 0, 0);
    for (index, line) in labels.lines().skip(1).enumerate() {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!((cells.len(), cells[0].parse::<usize>().unwrap()), (13, index));
        let number = |i: usize| cells[i].parse::<f64>().unwrap();
        let pos = Vec3::new(number(1), number(2), number(3));
        let rot = Rot::from_quaternion(Quaternion::new(number(4), number(5), number(6), number(7)));
        assert!(world.clearance(&pos) >= 0.349, "the camera is inside something");
        assert!((number(12) - world.ground_height(pos.x, pos.y)).abs() < 1e-5);
        if cells[8].is_empty() {
            assert_eq!((cells[9], cells[10], number(11)), ("", "", 0.0));
            continue;
        }
        with_person += 1;
        let target = Vec3::new(number(8), number(9), number(10));
        assert!((target.z - world.ground_height(target.x, target.y) - 0.95).abs() < 1e-5);
        let target_cam = rot.inverse_transform_vector(&(target - pos));
        let (u, v) = camera.project(&target_cam).expect("the target is ahead");
        assert!((0.0..160.0).contains(&u) && (0.0..96.0).contains(&v), "centre outside the image: {u}, {v}");
        if number(11) > 0.95 {
            clear_view += 1;
            let at = 2 * ((index * 96 + v as usize) * 160 + u as usize);
            let metres = f64::from(u16::from_le_bytes([depth[at], depth[at + 1]])) / 1000.0;
            // The chest or belly is nearer than the body's axis; stride, noise and holes take the rest.
            at_depth +=
                usize::from(metres > 0.0 && (metres - target_cam.x).abs() < 0.35 + 0.005 * target_cam.x.powi(2));
        }
    }
    assert_eq!(labels.lines().count(), frames + 1);
    assert!(with_person > 25 && with_person < frames, "{with_person} with a person");
    assert!(clear_view > 10 && at_depth * 10 > clear_view * 8, "{at_depth} of {clear_view} have the person's depth");
}

#[test]
fn voxels_are_the_grid_centres_in_or_near_an_obstacle() {
    let config = ForestConfig { min_xy: [0.0, 0.0], max_xy: [9.0, 9.0], ..ForestConfig::default() };
    let world = forest(&config, 3).unwrap();
    let cell = |c: f64| (c / VOXEL_M).floor() as i64;
    let voxels: std::collections::HashSet<[i64; 3]> =
        obstacle_voxels(&world).iter().map(|p| p.map(|c| cell(f64::from(c)))).collect();
    assert_eq!(voxels.len(), obstacle_voxels(&world).len(), "no voxel twice");
    let (min, max) = (world.min_world(), world.max_world());
    let mut inside = 0;
    for iz in cell(min.z)..=cell(max.z) {
        for iy in cell(min.y)..=cell(max.y) {
            for ix in cell(min.x)..=cell(max.x) {
                let centre = Vec3::new(ix as f64 + 0.5, iy as f64 + 0.5, iz as f64 + 0.5) * VOXEL_M;
                let near = world.clearance(&centre) <= 0.1;
                inside += usize::from(near);
                assert_eq!(voxels.contains(&[ix, iy, iz]), near, "{centre:?}");
            }
        }
    }
    assert!(inside > 500);
}

#[test]
fn half_of_the_scenes_hold_decoys_of_a_persons_size_that_the_map_knows() {
    let worlds: Vec<_> = (0..16).map(|scene| scene_world(scene_seed(77, scene)).unwrap()).collect();
    let banded = |kind: Kind| kind == Kind::Moving;
    let with_decoys: Vec<_> = worlds.iter().filter(|world| world.parts().iter().any(|p| banded(p.kind))).collect();
    assert!((4..=12).contains(&with_decoys.len()), "{} of 16", with_decoys.len());
    let map = obstacle_voxels(with_decoys[0]);
    for part in with_decoys[0].parts().iter().filter(|part| banded(part.kind)) {
        let (low, high) = part.shape.aabb();
        let height_m = high.z - with_decoys[0].ground_height(low.x, low.y);
        assert!((1.0..3.5).contains(&height_m), "{height_m} m");
        let middle = 0.5 * (low + high);
        let near = |voxel: &[f32; 3]| (Vec3::from(voxel.map(f64::from)) - middle).norm() < 1.0;
        assert!(map.iter().any(near), "not in the map: {middle}");
    }
}
