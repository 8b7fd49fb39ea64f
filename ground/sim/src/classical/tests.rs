//! Facts about the baseline's parts, in worlds that a depth image shows.

use goshawk_core::{FlatState, Rot, Vec3};

use std::f64::consts::FRAC_PI_2;

use super::distance::{CAP_M, DistanceField};
use super::map::{Ignored, Knowledge, Map, VOXEL_M};
use super::optimise::{Wanted, cost, optimise};
use super::planner::{Aim, MapPlanner};
use super::search::{Query, search};
use super::spline::{Spline, opening};
use crate::render::{Camera, CameraPose, Frame, Renderer};
use crate::world::forest::{ForestConfig, forest};

const HEIGHT_M: f64 = 1.5;

fn looking(yaw: f64) -> CameraPose {
    CameraPose { pos_world: Vec3::new(0.0, 0.0, HEIGHT_M), world_from_cam: Rot::from_axis_angle(&Vec3::z_axis(), yaw) }
}

/// A depth image (mm): `wall_m` away between two fractions of the width, `back_m` away beside it.
fn wall(wall_m: f64, back_m: f64, from: f64, to: f64) -> Vec<u16> {
    let camera = Camera::default();
    let depth = |u: usize| {
        let at = u as f64 / camera.width as f64;
        (if (from..to).contains(&at) { wall_m } else { back_m } * 1e3) as u16
    };
    (0..camera.height).flat_map(|_| (0..camera.width).map(depth)).collect()
}

fn walled(images: &[(f64, Vec<u16>)]) -> (Map, DistanceField) {
    let (mut map, mut field) = (Map::new(), DistanceField::new());
    for (yaw, depth_mm) in images.iter().cycle().take(3 * images.len()) {
        map.integrate(&Camera::default(), &looking(*yaw), depth_mm, None);
    }
    field.update(&map);
    (map, field)
}

/// A wall 4 m ahead, 4 m wide, nothing within 9 m beside it.
fn wall_ahead() -> (Map, DistanceField) {
    walled(&[(0.0, wall(4.0, 9.0, 0.25, 0.75))])
}

fn query(goal_m: f64) -> Query {
    let start = FlatState { pos: Vec3::new(0.0, 0.0, HEIGHT_M), ..FlatState::default() };
    let goal_world = Vec3::new(goal_m, 0.0, HEIGHT_M);
    Query { start, goal_world, speed_mps: 4.0, acc_mps2: 6.0, clearance_m: 0.45 }
}

#[test]
fn a_rendered_frame_marks_what_it_shows_and_carves_what_is_before_it() {
    let world = forest(&ForestConfig::default(), 3).unwrap();
    let camera = Camera::default();
    let pose = CameraPose { pos_world: world.start_world() + Vec3::z() * HEIGHT_M, world_from_cam: Rot::identity() };
    let mut frame = Frame::default();
    Renderer::new(camera).render(&world, None, &pose, &mut frame);
    let depth_mm: Vec<u16> =
        frame.depth_m.iter().map(|z| if *z < 20.0 { (z * 1e3).round() as u16 } else { 0 }).collect();
    let mut map = Map::new();
    for _ in 0..2 {
        map.integrate(&camera, &pose, &depth_mm, None);
    }
    let (mut ends, mut marked, mut free) = (0, 0, 0);
    for (pixel, depth) in frame.depth_m.iter().enumerate().filter(|(_, z)| (1.0..9.0).contains(*z)) {
        let (u, v) = ((pixel % camera.width) as f64 + 0.5, (pixel / camera.width) as f64 + 0.5);
        let ray = camera.ray_cam(u, v) * f64::from(*depth);
        if ray.z.abs() > 3.0 {
            continue;
        }
        ends += 1;
        marked += usize::from(map.knowledge(&(pose.pos_world + ray)) == Knowledge::Occupied);
        free += usize::from(map.knowledge(&(pose.pos_world + ray * 0.5)) == Knowledge::Free);
    }
    assert!(ends > 3000 && marked > ends * 98 / 100, "{marked} of {ends} marked");
    assert!(free > ends * 90 / 100, "{free} of {ends} free half way");
    assert_eq!(map.knowledge(&(pose.pos_world - Vec3::x() * 2.0)), Knowledge::Unknown, "behind the camera");
}

#[test]
fn an_obstacle_that_is_gone_is_forgotten_and_a_target_never_mapped() {
    let at = Vec3::new(3.05, 0.05, HEIGHT_M);
    let (mut map, _) = walled(&[(0.0, wall(3.05, 9.0, 0.25, 0.75))]);
    assert_eq!(map.knowledge(&at), Knowledge::Occupied);
    for _ in 0..14 {
        map.integrate(&Camera::default(), &looking(0.0), &wall(9.0, 9.0, 0.0, 0.0), None);
    }
    assert_eq!(map.knowledge(&at), Knowledge::Free);
    let target = Ignored { at_world: at, radius_m: 0.8, half_height_m: 1.4 };
    for _ in 0..3 {
        map.integrate(&Camera::default(), &looking(0.0), &wall(3.05, 9.0, 0.45, 0.55), Some(&target));
    }
    assert_eq!(map.knowledge(&at), Knowledge::Free);
}

#[test]
fn what_the_map_rolls_away_from_is_forgotten() {
    let (mut map, _) = wall_ahead();
    let at = Vec3::new(4.05, 0.05, HEIGHT_M);
    assert_eq!(map.knowledge(&at), Knowledge::Occupied);
    for x in [-30.0, 0.0] {
        let pose = CameraPose { pos_world: Vec3::new(x, 0.0, HEIGHT_M), ..looking(0.0) };
        map.integrate(&Camera::default(), &pose, &[], None);
    }
    assert_eq!(map.knowledge(&at), Knowledge::Unknown);
}

#[test]
fn the_distance_field_is_the_distance_to_the_nearest_occupied_voxel() {
    let (map, field) = wall_ahead();
    let centre =
        |x: i32, y: i32, z: i32| Vec3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, f64::from(z) + 0.5) * VOXEL_M;
    let voxels = |reach: i32, z: std::ops::Range<i32>| {
        z.flat_map(move |z| (-30..30).flat_map(move |y| (0..reach).map(move |x| centre(x, y, z))))
    };
    let occupied: Vec<Vec3> = voxels(49, -2..17).filter(|at| map.knowledge(at) == Knowledge::Occupied).collect();
    assert!(occupied.len() > 100);
    for at in voxels(30, 6..8).step_by(7) {
        let nearest = occupied.iter().map(|o| (o - at).norm()).fold(CAP_M, f64::min);
        assert!((field.coarse(&at) - nearest).abs() < 1e-9, "{at}: {} {nearest}", field.coarse(&at));
    }
}

#[test]
fn the_search_goes_around_a_wall() {
    let (map, field) = wall_ahead();
    let path = search(&query(7.0), &map, &field).unwrap();
    assert!(path.reached);
    let steps = (path.duration() / 0.02) as usize;
    for at in (0..=steps).map(|k| path.at(0.02 * k as f64)) {
        assert!(field.coarse(&at) > 0.3, "{at}");
    }
    let aside = (0..=steps).map(|k| path.at(0.02 * k as f64)).find(|at| at.x > 4.0).unwrap();
    assert!(aside.y.abs() > 2.0 || (aside.z - HEIGHT_M).abs() > 1.0, "{aside}");
}

#[test]
fn the_search_finds_nothing_where_the_vehicle_is_enclosed() {
    let (mut map, mut field) = (Map::new(), DistanceField::new());
    for (quarter, pitch) in (0..4).flat_map(|k| [-1.0, 0.0, 1.0].map(|pitch| (f64::from(k), pitch))) {
        let level = Rot::from_axis_angle(&Vec3::z_axis(), quarter * FRAC_PI_2);
        let world_from_cam = level * Rot::from_axis_angle(&Vec3::y_axis(), pitch);
        let pose = CameraPose { world_from_cam, ..looking(0.0) };
        map.integrate(&Camera::default(), &pose, &wall(0.9, 0.9, 0.0, 1.0), None);
    }
    field.update(&map);
    assert_eq!(search(&query(6.0), &map, &field), None);
}

fn wanted() -> Wanted {
    Wanted {
        start: FlatState { vel: Vec3::new(4.0, 0.5, 0.0), ..query(7.0).start },
        end_world: Some(query(7.0).goal_world),
        end_vel_world: Vec3::new(4.0, 0.0, 0.0),
        height_m: HEIGHT_M,
        speed_mps: 4.5,
        acc_mps2: 6.0,
        clearance_m: 0.9,
    }
}

#[test]
fn the_gradient_is_the_slope_of_the_cost() {
    let (_, field) = wall_ahead();
    let wanted = Wanted { speed_mps: 2.0, acc_mps2: 3.0, ..wanted() };
    // Through the wall, too fast, off the height: every term counts.
    let mut points = opening(&wanted.start, 0.25).to_vec();
    points.extend((1..9).map(|k| {
        let k = f64::from(k);
        Vec3::new(0.83 * k, 0.21 * (1.7 * k).sin() + 0.03, HEIGHT_M + 0.13 * k.cos())
    }));
    let spline = Spline { points, step_s: 0.25 };
    let mut gradient = vec![Vec3::zeros(); spline.points.len()];
    assert!(cost(&wanted, &field, &spline, &mut gradient) > 1.0);
    for (index, axis) in (3..spline.points.len()).flat_map(|i| (0..3).map(move |axis| (i, axis))) {
        let moved = |by: f64| {
            let mut spline = spline.clone();
            spline.points[index][axis] += by;
            cost(&wanted, &field, &spline, &mut vec![Vec3::zeros(); spline.points.len()])
        };
        let slope = (moved(1e-6) - moved(-1e-6)) / 2e-6;
        let error = (slope - gradient[index][axis]).abs();
        assert!(error < 1e-3 * (1.0 + slope.abs()), "{index} {axis}: {slope} {}", gradient[index][axis]);
    }
}

#[test]
fn the_optimised_trajectory_keeps_clear_and_within_limits() {
    let (map, field) = wall_ahead();
    let wanted = wanted();
    let path = search(&Query { start: wanted.start, ..query(7.0) }, &map, &field).unwrap();
    let (spans, duration) = (11, 1.2 * path.duration());
    let step_s = duration / f64::from(spans);
    let points: Vec<Vec3> = (-1..spans + 2).map(|i| path.at(f64::from(i) * step_s / 1.2)).collect();
    let spline = optimise(&wanted, &field, &points, step_s);
    for k in 0..=100 {
        let (state, _) = spline.at(duration * f64::from(k) / 100.0);
        assert!(field.sample(&state.pos).0 > 0.5, "{}", state.pos);
        assert!(state.vel.norm() < 1.1 * wanted.speed_mps, "{}", state.vel.norm());
        assert!(state.acc.norm() < 1.15 * wanted.acc_mps2, "{}", state.acc.norm());
    }
    assert!((spline.at(0.0).0.vel - wanted.start.vel).norm() < 1e-9);
    assert!((spline.at(duration).0.pos - query(7.0).goal_world).norm() < 0.8);
}

#[test]
fn a_goal_in_an_obstacle_is_moved_beside_it_and_a_stop_ends_at_rest() {
    let mut planner = MapPlanner::default();
    for _ in 0..3 {
        planner.see(&Camera::default(), &looking(0.0), &wall(4.0, 9.0, 0.25, 0.75), None);
    }
    let start = FlatState { vel: Vec3::new(4.0, 0.0, 0.0), ..query(7.0).start };
    let aim = Aim { pos_world: Vec3::new(4.1, 0.1, HEIGHT_M), vel_world: Vec3::zeros(), after_s: 0.0 };
    let goal = planner.local_goal(&start, &aim, 4.0);
    let off = (goal.pos_world - aim.pos_world).norm();
    assert!((0.3..1.0).contains(&off) && goal.pos_world.x < 3.7, "{}", goal.pos_world);
    let stop = planner.stop(&start);
    let (end, _) = stop.at(stop.duration());
    assert!(end.vel.norm() < 1.0 && end.pos.x < 3.6, "{end:?}");
    assert!(planner.is_clear(&stop, 0.0));
}
