//! A picture of a world: the map from above, and what a camera at the start sees.

use crate::actors::moving::Mover;
use crate::actors::person::{Person, PersonLook, PersonPose};
use crate::render::{Camera, CameraPose, Frame, Renderer};
use crate::sense::file::Sensors;
use crate::sense::rgbd::{Motion, RgbdImage};
use crate::world::{Kind, Part, Shape, World};
use goshawk_core::{Rot, Vec3};
use image::{Rgb, RgbImage};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Pixels a metre on the map, and how many it has each way at most: a wide world is drawn smaller.
const MAP_SCALE: f64 = 12.0;
const MAP_PX: f64 = 8000.0;

/// The map above, below it a large view and, enlarged, the policy's own RGB and depth (holes black). Moving obstacles
/// stand at the beginning of their ways.
#[must_use]
pub fn preview(world: &World, movers: &[Mover]) -> RgbImage {
    let moving: Vec<Part> = movers.iter().map(|mover| mover.part(world, 0.0)).collect();
    let map = map(world, movers);
    let start = world.start_world();
    let camera = CameraPose {
        pos_world: start + Vec3::new(0.0, 0.0, 1.5),
        world_from_cam: Rot::from_euler_angles(0.0, -0.05, world.start_heading_rad()),
    };
    let beside = camera.world_from_cam * Vec3::new(4.5, 0.8, 0.0);
    let person = ahead(world, start.x + beside.x, start.y + beside.y);
    let wide = Camera { width: 640, height: 384, ..Camera::default() };
    let mut frame = Frame::default();
    Renderer::new(wide).render_with(world, &moving, Some(&person), &camera, &mut frame);
    let large = rgb_image(frame.width, frame.height, &frame.rgb);

    let mut image = RgbdImage::default();
    Renderer::new(Camera::default()).render_with(world, &moving, Some(&person), &camera, &mut frame);
    Sensors::default().sensor(&Camera::default(), world.seed()).capture(
        &frame,
        &Motion::still(),
        world.seed(),
        &mut image,
    );
    let small = rgb_image(image.width, image.height, &image.rgb);
    let depth = depth_image(&image);
    let zoom = |i: &RgbImage| image::imageops::resize(i, 320, 192, image::imageops::FilterType::Nearest);

    let width = map.width().max(960);
    let mut sheet = RgbImage::from_pixel(width, map.height() + 392, Rgb([20, 20, 20]));
    image::imageops::replace(&mut sheet, &map, 0, 0);
    let top = i64::from(map.height()) + 8;
    image::imageops::replace(&mut sheet, &large, 0, top);
    image::imageops::replace(&mut sheet, &zoom(&small), 640, top);
    image::imageops::replace(&mut sheet, &zoom(&depth), 640, top + 192);
    sheet
}

fn ahead(world: &World, x: f64, y: f64) -> Person {
    let foot_world = Vec3::new(x, y, world.ground_height(x, y));
    let pose = PersonPose { foot_world, heading_rad: 0.6, phase_rad: 0.9, stride: 1.0 };
    Person { look: PersonLook::random(&mut ChaCha8Rng::seed_from_u64(world.seed())), pose }
}

fn rgb_image(width: usize, height: usize, rgb: &[u8]) -> RgbImage {
    RgbImage::from_fn(width as u32, height as u32, |u, v| {
        let at = 3 * (v as usize * width + u as usize);
        Rgb([rgb[at], rgb[at + 1], rgb[at + 2]])
    })
}

/// Near is bright and warm, far is dark and blue, no measurement is black.
#[must_use]
pub fn depth_image(image: &RgbdImage) -> RgbImage {
    RgbImage::from_fn(image.width as u32, image.height as u32, |u, v| {
        match image.depth_mm[v as usize * image.width + u as usize] {
            0 => Rgb([0, 0, 0]),
            mm => {
                let near = (-f32::from(mm) / 6000.0).exp();
                let ramp = |low: f32, high: f32| (low + (high - low) * near) as u8;
                Rgb([ramp(20.0, 255.0), ramp(30.0, 225.0), ramp(110.0, 60.0)])
            }
        }
    })
}

/// North up: ground height in brown, low foliage, trunks and branches as seen from above up to 4 m, the ways of moving
/// obstacles and where they begin.
fn map(world: &World, movers: &[Mover]) -> RgbImage {
    let (min, max) = (world.min_world(), world.max_world());
    let (low, high) = world.ground().range();
    let scale = MAP_SCALE.min(MAP_PX / (max.x - min.x).max(max.y - min.y));
    let size = ((max.x - min.x) * scale, (max.y - min.y) * scale);
    let mut map = RgbImage::from_fn(size.0 as u32, size.1 as u32, |u, v| {
        let (x, y) = (min.x + f64::from(u) / scale, max.y - f64::from(v) / scale);
        let rise = ((world.ground_height(x, y) - low) / (high - low).max(0.01)) as f32;
        Rgb([150.0, 140.0, 120.0].map(|c: f32| (c * (0.75 + 0.45 * rise)) as u8))
    });
    // Colours the pixels within `reach` m of (x, y) in which `inside` holds, by their offset from (x, y) in m.
    let mut stamp = |x: f64, y: f64, reach: f64, colour: [u8; 3], inside: &dyn Fn(f64, f64) -> bool| {
        let (cu, cv, r) = ((x - min.x) * scale, (max.y - y) * scale, reach * scale);
        for v in (cv - r).floor().max(0.0) as u32..((cv + r).ceil().max(0.0) as u32).min(map.height()) {
            for u in (cu - r).floor().max(0.0) as u32..((cu + r).ceil().max(0.0) as u32).min(map.width()) {
                if inside((f64::from(u) + 0.5 - cu) / scale, (cv - f64::from(v) - 0.5) / scale) {
                    map.put_pixel(u, v, Rgb(colour));
                }
            }
        }
    };
    let round = |radius: f64| radius.max(0.7 / scale);
    for part in world.parts() {
        match &part.shape {
            Shape::Spheroid(s) if s.centre.z < 3.6 => {
                let radius = round(s.radius_xy);
                stamp(s.centre.x, s.centre.y, radius, [70, 120, 60], &|dx, dy| dx.hypot(dy) <= radius);
            }
            Shape::Cuboid(c) if c.centre.z - c.half.z < world.ground_height(c.centre.x, c.centre.y) + 2.0 => {
                let shade = part.tint.map(|t| 40 + (90.0 * t) as u8);
                stamp(c.centre.x, c.centre.y, c.half.xy().norm(), shade, &|dx, dy| {
                    let at = c.turn_in(&Vec3::new(dx, dy, 0.0)).abs();
                    at.x <= c.half.x && at.y <= c.half.y
                });
            }
            Shape::Spheroid(_) | Shape::Cuboid(_) => {}
            Shape::Cone(c) => {
                let colour = if part.kind == Kind::Trunk { [60, 40, 25] } else { [100, 75, 55] };
                let steps = ((c.b - c.a).norm() * 8.0).ceil() as usize;
                for i in 0..=steps {
                    let f = i as f64 / steps as f64;
                    let p = c.a.lerp(&c.b, f);
                    if p.z < 4.0 {
                        let radius = round(c.radius_a + (c.radius_b - c.radius_a) * f);
                        stamp(p.x, p.y, radius, colour, &|dx, dy| dx.hypot(dy) <= radius);
                    }
                }
            }
        }
    }
    for mover in movers {
        let [first, last] = mover.ends();
        for share in 0..=100 {
            let at = first.lerp(&last, f64::from(share) / 100.0);
            stamp(at.x, at.y, 0.1, [240, 200, 40], &|dx, dy| dx.hypot(dy) <= 0.1);
        }
        let radius = mover.radius_m();
        stamp(first.x, first.y, radius, [200, 90, 20], &|dx, dy| dx.hypot(dy) <= radius);
    }
    let start = world.start_world();
    stamp(start.x, start.y, 0.3, [230, 60, 40], &|dx, dy| dx.hypot(dy) <= 0.3);
    map
}
