//! What a frame costs the classical pilot: mapping, search, optimisation, on one core. 160 × 96 depth, forest at 4 m
//! spacing, flown at 5 m/s along its own trajectories without dynamics, planned anew every frame.
//!
//! The yardstick is what campaigns charge it for a plan: `classical::pilot::COMPUTE_S`, one constant so that a flight
//! is the same on every machine. The figures go to `target/bench.json` under `classical_plan_ms`.

mod common;

use common::{core_seconds, record, verdict};
use goshawk_core::{FlatState, Rot, Vec3};
use goshawk_sim::classical::pilot::COMPUTE_S;
use goshawk_sim::classical::planner::{Aim, MapPlanner};
use goshawk_sim::render::{Camera, CameraPose, Frame, Renderer};
use goshawk_sim::sense::file::Sensors;
use goshawk_sim::sense::rgbd::{Motion, RgbdImage};
use goshawk_sim::world::forest::{ForestConfig, forest};

const SPEED_MPS: f64 = 5.0;
const FRAME_S: f64 = 1.0 / 30.0;
const WAY_M: f64 = 45.0;
const FORESTS: u64 = 6;

#[derive(Default)]
struct Times {
    map: Vec<f64>,
    search: Vec<f64>,
    optimise: Vec<f64>,
    all: Vec<f64>,
    found: usize,
}

fn main() -> color_eyre::Result<()> {
    let mut times = Times::default();
    for seed in 0..FORESTS {
        fly(seed, &mut times)?;
    }
    let frames = times.all.len();
    println!("classical pilot, one frame to a plan, forest 4 m at {SPEED_MPS} m/s, one core, {frames} frames");
    println!("  {:<22}{:>8}{:>8}{:>8}   ms", "", "p50", "p99", "max");
    let mut figures = serde_json::Map::new();
    for (name, values) in [
        ("map, distance field", &mut times.map),
        ("search", &mut times.search),
        ("optimisation", &mut times.optimise),
        ("all", &mut times.all),
    ] {
        values.sort_by(f64::total_cmp);
        let at = |q: f64| values[(q * (values.len() - 1) as f64) as usize] * 1e3;
        println!("  {name:<22}{:8.2}{:8.2}{:8.2}", at(0.5), at(0.99), at(1.0));
        if name == "all" {
            let verdict = verdict(at(0.99) <= COMPUTE_S * 1e3);
            println!("  charged in campaigns {:17.2}   p99 within it: {verdict}", COMPUTE_S * 1e3);
            figures.insert("p50".to_owned(), rounded(at(0.5)));
            figures.insert("p99".to_owned(), rounded(at(0.99)));
        }
    }
    println!("  a trajectory was found in {:.1} % of the frames", 100.0 * times.found as f64 / frames as f64);
    record("classical_plan_ms", figures.into())
}

/// One flight through a forest.
fn fly(seed: u64, times: &mut Times) -> color_eyre::Result<()> {
    let world = forest(&ForestConfig::default(), seed)?;
    let camera = Camera::default();
    let (mut renderer, mut sensor) = (Renderer::new(camera), Sensors::default().sensor(&camera, seed));
    let (mut frame, mut image) = (Frame::default(), RgbdImage::default());
    let mut planner = MapPlanner::default();
    let start_world = world.start_world() + Vec3::z() * 1.5;
    let aim = Aim { pos_world: start_world + Vec3::x() * WAY_M, vel_world: Vec3::zeros(), after_s: 0.0 };
    let mut at = FlatState { pos: start_world, ..FlatState::default() };
    for count in 0..(1.5 * WAY_M / SPEED_MPS / FRAME_S) as u64 {
        let yaw = if at.vel.xy().norm() > 1.0 { at.vel.y.atan2(at.vel.x) } else { 0.0 };
        let pose = CameraPose { pos_world: at.pos, world_from_cam: Rot::from_euler_angles(0.0, 0.0, yaw) };
        renderer.render(&world, None, &pose, &mut frame);
        let motion = Motion { vel_cam: pose.world_from_cam.inverse() * at.vel, ang_vel_cam: Vec3::zeros() };
        sensor.capture(&frame, &motion, (seed << 32) + count, &mut image);

        let begun = core_seconds();
        planner.see(&camera, &pose, &image.depth_mm, None);
        let seen = core_seconds();
        let goal = planner.local_goal(&at, &aim, SPEED_MPS);
        let path = planner.search(&at, &goal, SPEED_MPS);
        let searched = core_seconds();
        let spline = path.and_then(|path| planner.refine(&at, &goal, &path, SPEED_MPS));
        times.found += usize::from(spline.is_some());
        let spline = spline.unwrap_or_else(|| planner.stop(&at));
        let optimised = core_seconds();

        times.map.push(seen - begun);
        times.search.push(searched - seen);
        times.optimise.push(optimised - searched);
        times.all.push(optimised - begun);
        at = spline.at(FRAME_S).0;
        if (aim.pos_world - at.pos).norm() < 2.0 {
            break;
        }
    }
    Ok(())
}

fn rounded(ms: f64) -> serde_json::Value {
    ((ms * 100.0).round() / 100.0).into()
}
