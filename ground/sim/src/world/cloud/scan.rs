//! A world as a laser scanner on a tripod sees it from many stations: what lies in the shadow of something is missing.

use crate::world::World;
use goshawk_core::Vec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::collections::BTreeSet;
use std::f64::consts::TAU;

/// The scanner's height over the ground, m.
const TRIPOD_M: f64 = 1.6;
/// Between stations, m; one that something stands on is left out.
const STATIONS_M: f64 = 7.0;
/// Nothing stands nearer to a station, m.
const FREE_M: f64 = 0.4;
/// Between two rays, rad.
const RAYS_RAD: f64 = TAU / 480.0;
/// It looks so far down and up, rad.
const DOWN_UP_RAD: [f64; 2] = [-1.1, 1.2];
const RANGE_M: f64 = 20.0;
/// Standard deviation of a distance, m.
const NOISE_M: f64 = 0.015;
/// At most one point is kept in a cube of this edge, m.
const THINNED_M: f64 = 0.08;

/// The points of a scan, world frame, m.
#[must_use]
pub fn scan(world: &World, seed: u64) -> Vec<[f32; 3]> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (low, high) = (world.min_world(), world.max_world());
    let steps = |from: f64, to: f64, step: f64| {
        (0..).map(move |i| from + step * (f64::from(i) + 0.5)).take_while(move |x| *x < to)
    };
    let mut taken = BTreeSet::new();
    let mut points = Vec::new();
    for x in steps(low.x, high.x, STATIONS_M) {
        for y in steps(low.y, high.y, STATIONS_M) {
            let station = Vec3::new(x, y, world.ground_height(x, y) + TRIPOD_M);
            if world.clearance(&station) < FREE_M {
                continue;
            }
            for up in steps(DOWN_UP_RAD[0], DOWN_UP_RAD[1], RAYS_RAD) {
                for around in steps(0.0, TAU, RAYS_RAD / up.cos()) {
                    let ray = Vec3::new(up.cos() * around.cos(), up.cos() * around.sin(), up.sin());
                    let Some(hit) = world.ray_cast(&station, &ray, RANGE_M) else { continue };
                    let noise: f64 = rng.sample(StandardNormal);
                    let at = station + ray * (hit.distance_m + NOISE_M * noise);
                    if !world.contains_xy(at.x, at.y, 0.0) {
                        continue; // the ground of a world goes on beyond it
                    }
                    if taken.insert([at.x, at.y, at.z].map(|c| (c / THINNED_M).floor() as i32)) {
                        points.push(at.map(|c| c as f32).into());
                    }
                }
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::cloud;
    use crate::world::forest::{ForestConfig, forest};
    use std::fs::File;

    #[test]
    fn a_scanned_forest_stands_where_the_forest_stood() {
        let original =
            forest(&ForestConfig { min_xy: [0.0, -10.0], max_xy: [30.0, 10.0], ..Default::default() }, 3).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scan.ply");
        cloud::write_ply(&mut File::create(&file).unwrap(), &scan(&original, 1)).unwrap();
        let scanned = cloud::load(&file).unwrap();
        let places = (2..28).flat_map(|x| (-8..8).map(move |y| (f64::from(x), f64::from(y))));
        let mut near = 0;
        for (x, y) in places {
            let ground = original.ground_height(x, y);
            assert!((scanned.ground_height(x, y) - ground).abs() < 0.4, "ground at {x}, {y}");
            let at = Vec3::new(x, y, ground + 1.5);
            let (was, is) = (original.clearance(&at), scanned.clearance(&at));
            if was < 2.0 {
                near += 1;
                assert!((was - is).abs() < 0.5, "{was} became {is} at {x}, {y}");
            }
        }
        assert!(near > 50, "{near} places near trees");
    }
}
