//! A picture of a world: the map from above, and what a camera at the start sees.

use crate::person::{Person, PersonLook, PersonPose};
use crate::render::{Camera, CameraPose, Frame, Renderer};
use crate::sensor::{RgbdImage, Sensor, SensorConfig};
use crate::world::{Kind, Shape, World};
use goshawk_core::types::{Rot, Vec3};
use image::{Rgb, RgbImage};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Pixels a metre on the map.
const MAP_SCALE: f64 = 12.0;

/// The map above, below it a large view and, enlarged, the policy's own RGB and depth (holes black).
#[must_use]
pub fn preview(world: &World) -> RgbImage {
    let map = map(world);
    let start = world.start_world();
    let camera = CameraPose {
        pos_world: start + Vec3::new(0.0, 0.0, 1.5),
        world_from_cam: Rot::from_euler_angles(0.0, -0.05, 0.0),
    };
    let person = ahead(world, start.x + 4.5, start.y + 0.8);
    let wide = Camera { width: 640, height: 384, ..Camera::default() };
    let mut frame = Frame::default();
    Renderer::new(wide).render(world, Some(&person), &camera, &mut frame);
    let large = rgb_image(frame.width, frame.height, &frame.rgb);

    let mut image = RgbdImage::default();
    Renderer::new(Camera::default()).render(world, Some(&person), &camera, &mut frame);
    Sensor::new(SensorConfig::default()).capture(&frame, world.seed(), &mut image);
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

/// North up: ground height in brown, low foliage, trunks and branches as seen from above up to 4 m.
fn map(world: &World) -> RgbImage {
    let (min, max) = (world.min_world(), world.max_world());
    let (low, high) = world.ground().range();
    let size = ((max.x - min.x) * MAP_SCALE, (max.y - min.y) * MAP_SCALE);
    let mut map = RgbImage::from_fn(size.0 as u32, size.1 as u32, |u, v| {
        let (x, y) = (min.x + f64::from(u) / MAP_SCALE, max.y - f64::from(v) / MAP_SCALE);
        let rise = ((world.ground_height(x, y) - low) / (high - low).max(0.01)) as f32;
        Rgb([150.0, 140.0, 120.0].map(|c: f32| (c * (0.75 + 0.45 * rise)) as u8))
    });
    let mut disc = |x: f64, y: f64, radius: f64, colour: [u8; 3]| {
        let (cu, cv, r) = ((x - min.x) * MAP_SCALE, (max.y - y) * MAP_SCALE, (radius * MAP_SCALE).max(0.7));
        for v in (cv - r).floor().max(0.0) as u32..((cv + r).ceil().max(0.0) as u32).min(size.1 as u32) {
            for u in (cu - r).floor().max(0.0) as u32..((cu + r).ceil().max(0.0) as u32).min(size.0 as u32) {
                if (f64::from(u) + 0.5 - cu).hypot(f64::from(v) + 0.5 - cv) <= r {
                    map.put_pixel(u, v, Rgb(colour));
                }
            }
        }
    };
    for part in world.parts() {
        match &part.shape {
            Shape::Spheroid(s) if s.centre.z < 3.6 => disc(s.centre.x, s.centre.y, s.radius_xy, [70, 120, 60]),
            Shape::Spheroid(_) => {}
            Shape::Cone(c) => {
                let colour = if part.kind == Kind::Trunk { [60, 40, 25] } else { [100, 75, 55] };
                let steps = ((c.b - c.a).norm() * 8.0).ceil() as usize;
                for i in 0..=steps {
                    let f = i as f64 / steps as f64;
                    let p = c.a.lerp(&c.b, f);
                    if p.z < 4.0 {
                        disc(p.x, p.y, c.radius_a + (c.radius_b - c.radius_a) * f, colour);
                    }
                }
            }
        }
    }
    let start = world.start_world();
    disc(start.x, start.y, 0.3, [230, 60, 40]);
    map
}
