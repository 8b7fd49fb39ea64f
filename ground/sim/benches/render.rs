//! Speed of the RGB-D renderer: 160 × 96, forest at 4 m spacing with a person in view, one core.
//!
//! The yardstick, measured in the same run, is depth alone by one ray a pixel through the world's grid, as a general
//! ray caster does it. (Embree by Open3D, depth only, 225k triangles, made 354 frames/s on the reference machine.)
//! The figure goes to `target/bench.json` under `render_fps_per_core`.

mod common;

use common::{core_seconds, median, record, tenths, verdict};
use goshawk_core::Vec3;
use goshawk_sim::dataset::sample_frame;
use goshawk_sim::render::{Camera, Frame, Renderer};
use goshawk_sim::sense::file::Sensors;
use goshawk_sim::sense::rgbd::{Motion, RgbdImage};
use goshawk_sim::world::forest::{ForestConfig, forest};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const POSES: usize = 100;
const ROUNDS: usize = 15;
const TARGET_FPS: f64 = 500.0;

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
    Ok(())
}
