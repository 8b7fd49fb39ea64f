//! Where the camera looks from and where the person stands, for one frame.

use crate::actors::person::{CENTRE_M, Person, PersonLook, PersonPose};
use crate::render::{Camera, CameraPose};
use crate::sense::rgbd::Motion;
use crate::world::World;
use goshawk_core::{Rot, Vec3};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use std::f64::consts::TAU;

/// How often a frame may be drawn anew.
pub(super) const TRIES: usize = 20_000;

/// Distance of the person, m: a chase holds 4–8 m, and what has fallen behind must still see it.
const DISTANCE_MEDIAN_M: f64 = 5.5;
const DISTANCE_LOG_STD: f64 = 0.65;
const DISTANCES_M: std::ops::RangeInclusive<f64> = 1.2..=18.0;

/// The camera keeps this far from obstacles, m.
const CAMERA_CLEAR_M: f64 = 0.35;

/// The person keeps this far from them, m, measured from the body's axis.
const PERSON_CLEAR_M: f64 = 0.35;

/// The person's centre keeps this far inside the image, px.
const MARGIN_PX: f64 = 1.5;

/// Largest pitch of the camera either way.
const PITCH_LIMIT_RAD: f64 = 40.0 * std::f64::consts::PI / 180.0;

/// One frame's geometry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameSample {
    /// Where the camera is and looks.
    pub camera: CameraPose,
    /// How it moves while the shutter is open.
    pub motion: Motion,
    /// Whom it may see.
    pub person: Option<Person>,
}

/// Draws a frame with or without a person; `None` if this draw does not fit the world (draw again).
///
/// The camera is 0.6–3 m (one in ten 3–5 m) over the ground, pitched up by 10° ± 12°, rolled by ± 10°. A person's
/// azimuth is uniform over the image and its distance log-normal within [`DISTANCES_M`]; the centre is always in the image.
/// For half of them the pitch follows the distribution given that, for half it puts the centre at a uniform height.
pub fn sample_frame<R: Rng>(world: &World, camera: &Camera, with_person: bool, rng: &mut R) -> Option<FrameSample> {
    let pos_world = camera_place(world, rng)?;
    if !with_person {
        let world_from_cam = attitude(rng.random_range(0.0..TAU), pitch(rng), roll(rng));
        let camera = CameraPose { pos_world, world_from_cam };
        return Some(FrameSample { camera, motion: motion(rng), person: None });
    }
    let distance: f64 = (DISTANCE_MEDIAN_M.ln() + DISTANCE_LOG_STD * rng.sample::<f64, _>(StandardNormal)).exp();
    if !DISTANCES_M.contains(&distance) {
        return None;
    }
    let bearing = rng.random_range(0.0..TAU);
    let (x, y) = (pos_world.x + distance * bearing.cos(), pos_world.y + distance * bearing.sin());
    if !world.contains_xy(x, y, 0.5) || !person_fits(world, x, y) {
        return None;
    }
    let pose = PersonPose {
        foot_world: Vec3::new(x, y, world.ground_height(x, y)),
        heading_rad: rng.random_range(0.0..TAU),
        phase_rad: rng.random_range(0.0..TAU),
        stride: if rng.random_bool(0.12) { 0.0 } else { rng.random_range(0.5..1.1) },
    };
    let person = Person { look: PersonLook::random(rng), pose };
    let toward = pose.centre_world() - pos_world;
    let elevation = toward.z.atan2(distance);
    let anywhere = rng.random_bool(0.5);
    for _ in 0..12 {
        let wanted_u = rng.random_range(MARGIN_PX..camera.width as f64 - MARGIN_PX);
        let wanted_v = rng.random_range(MARGIN_PX..camera.height as f64 - MARGIN_PX);
        let ray = camera.ray_cam(wanted_u, wanted_v);
        let pitch_up = if anywhere { elevation - ray.z.atan2(ray.x.hypot(ray.y)) } else { pitch(rng) };
        if pitch_up.abs() > PITCH_LIMIT_RAD {
            continue;
        }
        let world_from_cam = attitude(bearing - ray.y.atan(), pitch_up, roll(rng));
        let pos_cam = world_from_cam.inverse_transform_vector(&toward);
        if let Some((u, v)) = camera.project(&pos_cam) {
            let inside = |x: f64, n: usize| x >= MARGIN_PX && x <= n as f64 - MARGIN_PX;
            if inside(u, camera.width) && inside(v, camera.height) {
                let camera = CameraPose { pos_world, world_from_cam };
                return Some(FrameSample { camera, motion: motion(rng), person: Some(person) });
            }
        }
    }
    None
}

/// Forward at 0–8 m/s, sideways and in turn as a chase does.
fn motion<R: Rng>(rng: &mut R) -> Motion {
    let mut normal = |std: f64| std * rng.sample::<f64, _>(StandardNormal);
    let vel_cam = Vec3::new(normal(3.0).abs(), normal(1.2), normal(0.6));
    Motion { vel_cam, ang_vel_cam: Vec3::new(normal(0.8), normal(0.8), normal(0.8)) }
}

fn camera_place<R: Rng>(world: &World, rng: &mut R) -> Option<Vec3> {
    let (min, max) = (world.min_world(), world.max_world());
    let (x, y) = (rng.random_range(min.x + 0.5..max.x - 0.5), rng.random_range(min.y + 0.5..max.y - 0.5));
    let height = if rng.random_bool(0.9) { rng.random_range(0.6..3.0) } else { rng.random_range(3.0..5.0) };
    let place = Vec3::new(x, y, world.ground_height(x, y) + height);
    (world.clearance(&place) >= CAMERA_CLEAR_M).then_some(place)
}

/// Upward pitch of the camera, rad.
fn pitch<R: Rng>(rng: &mut R) -> f64 {
    let degrees: f64 = 10.0 + 12.0 * rng.sample::<f64, _>(StandardNormal);
    degrees.to_radians().clamp(-PITCH_LIMIT_RAD, PITCH_LIMIT_RAD)
}

fn roll<R: Rng>(rng: &mut R) -> f64 {
    let degrees: f64 = 10.0 * rng.sample::<f64, _>(StandardNormal);
    degrees.clamp(-40.0, 40.0).to_radians()
}

/// world_from_cam. FLU: looking up is a negative turn about y.
fn attitude(yaw: f64, pitch_up: f64, roll: f64) -> Rot {
    Rot::from_euler_angles(roll, -pitch_up, yaw)
}

/// Whether a person standing at (x, y) is clear of every obstacle.
#[must_use]
pub(super) fn person_fits(world: &World, x: f64, y: f64) -> bool {
    let ground = world.ground_height(x, y);
    [0.3, 0.6, CENTRE_M, 1.3, 1.6].iter().all(|h| world.clearance(&Vec3::new(x, y, ground + h)) >= PERSON_CLEAR_M)
}
