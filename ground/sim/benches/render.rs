//! Speed of the RGB-D renderer: 160 × 96, forest at 4 m spacing with a person in view, one core.
//!
//! The yardstick, measured in the same run, is depth alone by one ray a pixel through the world's grid, as a general
//! ray caster does it. The scene is left as triangles in `target/render`, where `embree.py` casts the same rays through
//! it. The figure goes to `target/bench.json` under `render_fps_per_core`.

mod common;

use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::Path;

use common::{core_seconds, median, record, tenths, verdict};
use goshawk_core::Vec3;
use goshawk_sim::commands::dataset::sample_frame;
use goshawk_sim::render::{Camera, CameraPose, Frame, Renderer};
use goshawk_sim::sense::file::Sensors;
use goshawk_sim::sense::rgbd::{Motion, RgbdImage};
use goshawk_sim::world::forest::{ForestConfig, forest};
use goshawk_sim::world::{Shape, World};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const POSES: usize = 100;
const ROUNDS: usize = 15;
const TARGET_FPS: f64 = 2000.0;
/// Sides of what is round, and rings of half a sphere.
const ROUND: (usize, usize) = (12, 3);

fn main() -> color_eyre::Result<()> {
    let world = forest(&ForestConfig::default(), 1)?;
    let camera = Camera::default();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut draw = || sample_frame(&world, &camera, true, &mut rng);
    let samples: Vec<_> = std::iter::repeat_with(&mut draw).flatten().take(POSES).collect();

    let mut renderer = Renderer::new(camera);
    let mut sensor = Sensors::default().sensor(&camera, 1);
    // A brisk turn at 5 m/s: everything smears.
    let motion = Motion { vel_cam: Vec3::new(5.0, 0.0, 0.0), ang_vel_cam: Vec3::new(0.0, 0.5, 2.0) };
    let (mut frame, mut image) = (Frame::default(), RgbdImage::default());
    let (mut render_fps, mut sensed_fps, mut cast_fps) = (Vec::new(), Vec::new(), Vec::new());
    for round in 0..ROUNDS {
        let started = core_seconds();
        for sample in &samples {
            renderer.render(&world, sample.person.as_ref(), &sample.camera, &mut frame);
            std::hint::black_box(&frame);
        }
        render_fps.push(POSES as f64 / (core_seconds() - started));

        let started = core_seconds();
        for (seed, _) in samples.iter().enumerate() {
            sensor.capture(&frame, &motion, (round * POSES + seed) as u64, &mut image);
            std::hint::black_box(&image);
        }
        sensed_fps.push(POSES as f64 / (core_seconds() - started));

        let started = core_seconds();
        let cast = 2;
        for sample in samples.iter().cycle().skip(round * cast).take(cast) {
            for pixel in 0..camera.width * camera.height {
                let (u, v) = ((pixel % camera.width) as f64 + 0.5, (pixel / camera.width) as f64 + 0.5);
                let dir = sample.camera.world_from_cam * camera.ray_cam(u, v).normalize();
                std::hint::black_box(world.ray_cast(&sample.camera.pos_world, &dir, 30.0));
            }
        }
        cast_fps.push(cast as f64 / (core_seconds() - started));
    }
    let (render, sensed, cast) = (median(&mut render_fps), median(&mut sensed_fps), median(&mut cast_fps));
    println!("render, 160 x 96 RGB-D, forest 4 m, one core, median of {ROUNDS} rounds of {POSES} poses");
    println!("  renderer            {render:8.0} frames/s   target {TARGET_FPS:.0}: {}", verdict(render >= TARGET_FPS));
    println!("  ray cast (depth)    {cast:8.0} frames/s   yardstick: {:.1} x", render / cast);
    println!("  sensor model        {sensed:8.0} frames/s");
    record("render_fps_per_core", tenths(render))?;
    let poses: Vec<CameraPose> = samples.iter().map(|sample| sample.camera).collect();
    leave(&world, &camera, &poses)
}

/// Writes the scene's triangles, the camera and its poses: little-endian f32, and JSON.
fn leave(world: &World, camera: &Camera, poses: &[CameraPose]) -> color_eyre::Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/render");
    std::fs::create_dir_all(&folder)?;
    let solids = world.parts().iter().flat_map(|part| solid(&part.shape));
    let corners = solids.chain(ground(world)).flatten();
    let poses = poses.iter().flat_map(|pose| {
        let turned = pose.world_from_cam.to_rotation_matrix().into_inner();
        let rows: Vec<Vec3> = (0..3).map(|k| turned.row(k).transpose()).collect();
        std::iter::once(pose.pos_world).chain(rows)
    });
    let bytes = |of: &mut dyn Iterator<Item = Vec3>| -> Vec<u8> {
        of.flat_map(|v| [v.x, v.y, v.z]).flat_map(|value| (value as f32).to_le_bytes()).collect()
    };
    std::fs::write(folder.join("triangles.f32"), bytes(&mut corners.into_iter()))?;
    std::fs::write(folder.join("poses.f32"), bytes(&mut poses.into_iter()))?;
    let camera = serde_json::json!({"width": camera.width, "height": camera.height, "focal_px": camera.focal_px()});
    std::fs::write(folder.join("camera.json"), camera.to_string())?;
    Ok(())
}

/// The triangles of a part.
fn solid(shape: &Shape) -> Vec<[Vec3; 3]> {
    let dome = |from: f64, to: f64| (0..=ROUND.1).map(move |k| from + (to - from) * k as f64 / ROUND.1 as f64);
    // (along the axis, away from it), from one end to the other.
    let (origin, axis, profile): (Vec3, Vec3, Vec<(f64, f64)>) = match shape {
        Shape::Cone(cone) => {
            let along = cone.b - cone.a;
            let tilt = ((cone.radius_a - cone.radius_b) / along.norm()).asin();
            let ball = |at: f64, radius: f64, from: f64, to: f64| {
                dome(from, to).map(move |angle| (at + radius * angle.sin(), radius * angle.cos()))
            };
            let profile = ball(0.0, cone.radius_a, -FRAC_PI_2, tilt)
                .chain(ball(along.norm(), cone.radius_b, tilt, FRAC_PI_2))
                .collect();
            (cone.a, along.normalize(), profile)
        }
        Shape::Spheroid(ball) => {
            let half = dome(-FRAC_PI_2, 0.0).chain(dome(0.0, FRAC_PI_2).skip(1));
            let profile = half.map(|angle| (ball.radius_z * angle.sin(), ball.radius_xy * angle.cos())).collect();
            (ball.centre, Vec3::z(), profile)
        }
        Shape::Cuboid(_) => return Vec::new(), // a forest has none
    };
    let aside = axis.cross(&if axis.z.abs() < 0.9 { Vec3::z() } else { Vec3::x() }).normalize();
    let across = axis.cross(&aside);
    let point = |(along, away): (f64, f64), side: usize| {
        let (sin, cos) = (TAU * side as f64 / ROUND.0 as f64).sin_cos();
        origin + axis * along + (aside * cos + across * sin) * away
    };
    let rings = profile.windows(2).flat_map(|pair| (0..ROUND.0).map(move |side| (pair[0], pair[1], side)));
    rings
        .flat_map(|(low, high, side)| {
            let (a, b, c, d) = (point(low, side), point(low, side + 1), point(high, side), point(high, side + 1));
            [[a, b, c], [b, d, c]]
        })
        .collect()
}

/// Those of the ground, two for each of its cells.
fn ground(world: &World) -> Vec<[Vec3; 3]> {
    let ((nx, ny), cell, low) = (world.ground().shape(), world.ground().cell_m(), world.ground().min_xy());
    let node = |i: usize, j: usize| {
        let (x, y) = (low[0] + i as f64 * cell, low[1] + j as f64 * cell);
        Vec3::new(x, y, world.ground_height(x, y))
    };
    let cells = (0..nx - 1).flat_map(|i| (0..ny - 1).map(move |j| (i, j)));
    cells
        .flat_map(|(i, j)| {
            let (a, b, c, d) = (node(i, j), node(i + 1, j), node(i, j + 1), node(i + 1, j + 1));
            [[a, b, c], [b, d, c]]
        })
        .collect()
}
