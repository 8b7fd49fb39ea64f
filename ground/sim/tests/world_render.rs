//! What is drawn is what is there: depth against ray casting, and points against the pinhole.

use goshawk_core::{Rot, Vec3};
use goshawk_sim::actors::person::{CENTRE_M, HEIGHT_M, Person, PersonLook, PersonPose};
use goshawk_sim::render::{Camera, CameraPose, Class, Frame, Renderer};
use goshawk_sim::world::buildings::{BuildingsConfig, buildings};
use goshawk_sim::world::forest::{ForestConfig, forest};
use goshawk_sim::world::{Ground, Kind, Look, Part, RoundCone, Shape, Spheroid, Surface, World, WorldParts};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn plain(parts: Vec<Part>) -> World {
    World::new(WorldParts {
        seed: 0,
        spacing_m: 4.0,
        min_xy: [-40.0, -40.0],
        max_xy: [40.0, 40.0],
        start_heading_rad: 0.0,
        start_xy: [0.0, 0.0],
        ground: Ground::from_fn([-40.0, -40.0], [40.0, 40.0], 0.5, |_, _| 0.0),
        parts,
        trees: Vec::new(),
        look: Look::random(&mut ChaCha8Rng::seed_from_u64(1)),
    })
}

fn draw(world: &World, person: Option<&Person>, pose: &CameraPose, camera: Camera) -> Frame {
    let mut frame = Frame::default();
    Renderer::new(camera).render(world, person, pose, &mut frame);
    frame
}

fn at_origin(height: f64) -> CameraPose {
    CameraPose { pos_world: Vec3::new(0.0, 0.0, height), world_from_cam: Rot::identity() }
}

fn standing(x: f64, y: f64) -> Person {
    let look = PersonLook { scale: 1.0, ..PersonLook::random(&mut ChaCha8Rng::seed_from_u64(4)) };
    let pose = PersonPose { foot_world: Vec3::new(x, y, 0.0), heading_rad: 0.3, phase_rad: 0.0, stride: 0.0 };
    Person { look, pose }
}

#[test]
fn the_default_camera_is_the_shared_one() {
    let camera = Camera::default();
    assert!((camera.focal_px() - 80.0).abs() < 1e-12);
    assert!((camera.vfov_rad().to_degrees() - 61.927_513_064_147_04).abs() < 1e-9);
    let (u, v) = camera.project(&Vec3::new(2.0, 1.0, 0.5)).unwrap();
    assert!((u - 40.0).abs() < 1e-9 && (v - 28.0).abs() < 1e-9, "left is at small u, up at small v: {u}, {v}");
    assert_eq!(camera.project(&Vec3::new(-1.0, 0.0, 0.0)), None);
}

/// Renderer (single precision, camera frame) and ray cast (double, world frame) share no code.
#[test]
fn every_pixels_depth_and_class_are_the_ray_casts() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let camera = Camera::default();
    let mut renderer = Renderer::new(camera);
    let mut frame = Frame::default();
    let (mut pixels, mut wrong, mut parts_seen) = (0, 0, 0);
    for seed in 0..24 {
        let world = match seed % 2 {
            0 => forest(&ForestConfig { spacing_m: 3.5, ..ForestConfig::default() }, seed).unwrap(),
            _ => buildings(&BuildingsConfig::default(), seed).unwrap(),
        };
        let (x, y) = (rng.random_range(5.0..65.0), rng.random_range(-20.0..20.0));
        let pos_world = Vec3::new(x, y, world.ground_height(x, y) + rng.random_range(0.6..4.0));
        if world.clearance(&pos_world) < 0.2 {
            continue;
        }
        let mut angle = |limit: f64| rng.random_range(-limit..limit);
        let world_from_cam = Rot::from_euler_angles(angle(0.8), angle(0.8), angle(3.1));
        renderer.render(&world, None, &CameraPose { pos_world, world_from_cam }, &mut frame);
        for v in 0..camera.height {
            for u in 0..camera.width {
                let ray = camera.ray_cam(u as f64 + 0.5, v as f64 + 0.5);
                let scale = ray.norm();
                let hit = world.ray_cast(&pos_world, &(world_from_cam * (ray / scale)), 25.0);
                let depth = f64::from(frame.depth_m[v * camera.width + u]);
                let class = frame.class[v * camera.width + u];
                pixels += 1;
                let right = match hit {
                    None => depth * scale > 24.9,
                    Some(hit) => {
                        let expected = hit.distance_m / scale;
                        let kind = match hit.surface {
                            Surface::Ground => Class::Ground,
                            Surface::Part(i) => match world.parts()[i as usize].kind {
                                Kind::Trunk => Class::Trunk,
                                Kind::Branch => Class::Branch,
                                Kind::Foliage => Class::Foliage,
                                Kind::Building => Class::Building,
                                Kind::Scan => Class::Scan,
                                Kind::Moving => Class::Moving,
                            },
                        };
                        parts_seen += usize::from(kind != Class::Ground);
                        (depth - expected).abs() < 0.005 + 0.002 * expected && class == kind as u8
                    }
                };
                wrong += usize::from(!right);
            }
        }
    }
    // Silhouettes and grazing ground may differ by rounding.
    assert!(pixels > 100_000 && parts_seen > 20_000);
    assert!((wrong as f64) < 0.003 * f64::from(pixels), "{wrong} of {pixels} pixels differ");
}

#[test]
fn a_trunk_ahead_has_its_analytic_depth_and_width() {
    let cone = RoundCone { a: Vec3::new(5.0, 0.0, -1.0), b: Vec3::new(5.0, 0.0, 8.0), radius_a: 0.3, radius_b: 0.3 };
    let world = plain(vec![Part { shape: Shape::Cone(cone), kind: Kind::Trunk, tint: [0.2; 3] }]);
    let frame = draw(&world, None, &at_origin(1.5), Camera::default());
    let row = &frame.depth_m[40 * 160..41 * 160];
    for u in [79, 80] {
        // The pixel's centre is half a pixel off the axis: (5 − x)² + (x / 160)² = 0.3².
        assert!((row[u] - 4.701_44).abs() < 1e-4, "{}", row[u]);
    }
    let wide = frame.class[40 * 160..41 * 160].iter().filter(|c| **c == Class::Trunk as u8).count();
    // 2 · 80 px · 0.3 / √(5² − 0.3²) = 9.6 px.
    assert!((9..=10).contains(&wide), "{wide} px");
}

#[test]
fn a_spheroid_beside_the_camera_is_drawn_up_to_the_images_border() {
    let ball = Spheroid { centre: Vec3::new(0.3, 1.2, 1.5), radius_xy: 0.9, radius_z: 0.6 };
    let world = plain(vec![Part { shape: Shape::Spheroid(ball), kind: Kind::Foliage, tint: [0.2; 3] }]);
    let camera = Camera::default();
    let frame = draw(&world, None, &at_origin(1.5), camera);
    for v in 0..96 {
        for u in 0..160 {
            let ray = camera.ray_cam(u as f64 + 0.5, v as f64 + 0.5);
            let hit = world.ray_cast(&Vec3::new(0.0, 0.0, 1.5), &ray.normalize(), 20.0);
            let expect = matches!(hit, Some(h) if h.surface == Surface::Part(0));
            assert_eq!(frame.class[v * 160 + u] == Class::Foliage as u8, expect, "pixel {u}, {v}");
        }
    }
}

#[test]
fn level_ground_has_its_analytic_depth() {
    let frame = draw(&plain(Vec::new()), None, &at_origin(1.6), Camera::default());
    for v in 60..96 {
        let expected = 1.6 / ((v as f32 + 0.5 - 48.0) / 80.0);
        for u in [0, 80, 159] {
            assert!((frame.depth_m[v * 160 + u] - expected).abs() < 0.002 * expected);
        }
    }
    assert!(frame.depth_m[..47 * 160].iter().all(|d| d.is_infinite()), "sky has no depth");
}

#[test]
fn the_person_is_drawn_where_the_pinhole_puts_it() {
    let world = plain(Vec::new());
    let camera = Camera::default();
    for (x, y) in [(3.0, 0.0), (6.0, 3.5), (4.0, -2.0), (10.0, 1.0)] {
        let person = standing(x, y);
        let frame = draw(&world, Some(&person), &at_origin(1.2), camera);
        let (mut n, mut sum, mut top, mut bottom) = (0.0, [0.0, 0.0], 96usize, 0usize);
        for (i, _) in frame.class.iter().enumerate().filter(|(_, c)| **c == Class::Person as u8) {
            sum = [sum[0] + (i % 160) as f64 + 0.5, sum[1] + (i / 160) as f64 + 0.5];
            n += 1.0;
            (top, bottom) = (top.min(i / 160), bottom.max(i / 160 + 1));
            assert!((f64::from(frame.depth_m[i]) - x).abs() < 0.5);
        }
        let centre_cam = person.pose.centre_world() - Vec3::new(0.0, 0.0, 1.2);
        let (u, v) = camera.project(&centre_cam).unwrap();
        let tolerance = 0.6 + 12.0 / x;
        assert!((sum[0] / n - u).abs() < tolerance, "u {} against {u}", sum[0] / n);
        assert!((sum[1] / n - v).abs() < tolerance, "v {} against {v}", sum[1] / n);
        let edge = |h: f64| camera.project(&Vec3::new(x, y, h - 1.2)).unwrap().1.clamp(0.0, 96.0);
        assert!((top as f64 - edge(HEIGHT_M)).abs() < 1.0 + 4.0 / x, "top {top} against {}", edge(HEIGHT_M));
        assert!((bottom as f64 - edge(0.0)).abs() < 1.0 + 10.0 / x, "bottom {bottom} against {}", edge(0.0));
        assert_eq!(frame.person_visible(), 1.0);
    }
}

#[test]
fn the_centre_is_halfway_up_a_standing_person() {
    let body = standing(0.0, 0.0).body();
    let ends = body.iter().flat_map(|p| [(p.cone.a, p.cone.radius_a), (p.cone.b, p.cone.radius_b)]);
    let (low, high) = ends.fold((f64::MAX, f64::MIN), |(low, high), (c, r)| (low.min(c.z - r), high.max(c.z + r)));
    assert!((high - HEIGHT_M).abs() < 0.04, "top of the head at {high}");
    assert!(low.abs() < 0.03, "soles at {low}");
    assert!((CENTRE_M - HEIGHT_M / 2.0).abs() < 0.1);
}

#[test]
fn a_running_persons_feet_stay_on_the_ground() {
    for step in 0..40 {
        let mut person = standing(0.0, 0.0);
        (person.pose.phase_rad, person.pose.stride) = (f64::from(step) * 0.157, 1.0);
        let body = person.body();
        let low = body.iter().map(|p| (p.cone.a.z - p.cone.radius_a).min(p.cone.b.z - p.cone.radius_b));
        let low = low.fold(f64::MAX, f64::min);
        assert!(low.abs() < 0.03, "soles at {low}");
    }
}

#[test]
fn visibility_is_the_share_of_the_persons_pixels_that_nothing_hides() {
    let person = standing(6.0, 0.0);
    let wall = |y0: f64, y1: f64| {
        let posts = ((y1 - y0) / 0.05) as usize;
        let post = |i: usize| {
            let y = y0 + 0.05 * i as f64;
            let cone =
                RoundCone { a: Vec3::new(3.0, y, -1.0), b: Vec3::new(3.0, y, 5.0), radius_a: 0.05, radius_b: 0.05 };
            Part { shape: Shape::Cone(cone), kind: Kind::Trunk, tint: [0.2; 3] }
        };
        plain((0..posts).map(post).collect())
    };
    let visible = |world: &World| draw(world, Some(&person), &at_origin(1.0), Camera::default()).person_visible();
    assert_eq!(visible(&plain(Vec::new())), 1.0);
    assert_eq!(visible(&wall(-2.0, 2.0)), 0.0);
    let half = visible(&wall(0.05, 2.0));
    assert!((0.35..0.65).contains(&half), "half a person: {half}");
    assert_eq!(draw(&plain(Vec::new()), None, &at_origin(1.0), Camera::default()).person_visible(), 0.0);
}

#[test]
fn drawing_again_with_the_same_renderer_changes_nothing() {
    let world = forest(&ForestConfig::default(), 2).unwrap();
    let pose = CameraPose { pos_world: world.start_world() + Vec3::z() * 1.5, world_from_cam: Rot::identity() };
    let person = standing(9.0, 0.5);
    let mut renderer = Renderer::new(Camera::default());
    let (mut a, mut b) = (Frame::default(), Frame::default());
    renderer.render(&world, Some(&person), &pose, &mut a);
    renderer.render(&world, None, &at_origin(3.0), &mut b);
    renderer.render(&world, Some(&person), &pose, &mut b);
    assert_eq!(a, b);
}
