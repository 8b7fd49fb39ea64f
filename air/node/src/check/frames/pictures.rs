//! How the camera is mounted, by what a turn does to its pictures. The odometry's turn and the vehicle file's mounting
//! say where each pixel of the second picture was in the first; of all ways in which a picture may be swapped, the one
//! that fits best is the camera's.

use goshawk_core::{Odometry, Rot, Vec3};
use goshawk_vehicle::sensors::Frame;
use nalgebra::{Matrix2, Vector2};

/// Pictures are compared at about so many columns.
const COLUMNS: usize = 80;
/// Fewer points that both pictures show say nothing.
const LEAST_POINTS: usize = 200;
/// A correlation below this is that of two different scenes. Chosen by eye.
const LEAST_FIT: f64 = 0.3;
/// And the best way must be better than the next by this. Chosen by eye.
const LEAST_LEAD: f64 = 0.05;

/// A picture and where it was taken.
#[derive(Clone, Debug)]
pub(super) struct View {
    /// The picture.
    pub(super) frame: Frame,
    /// At its exposure.
    pub(super) odometry: Odometry,
}

/// Which of a frame's two pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Picture {
    /// Brightness.
    Colour,
    /// One over the depth.
    Depth,
}

/// A way in which a picture may be swapped: from its (left, up) to the true ones.
const SWAPS: [(&str, [f64; 4]); 8] = [
    ("as the vehicle file says", [1.0, 0.0, 0.0, 1.0]),
    ("upside down: turn it by 180°, or set it so in the driver", [-1.0, 0.0, 0.0, -1.0]),
    ("mirrored left to right: set the driver", [-1.0, 0.0, 0.0, 1.0]),
    ("mirrored top to bottom, or looking backwards: set the driver, or turn it", [1.0, 0.0, 0.0, -1.0]),
    ("turned by 90° one way: turn it, or set it so in the driver", [0.0, 1.0, -1.0, 0.0]),
    ("turned by 90° the other way: turn it, or set it so in the driver", [0.0, -1.0, 1.0, 0.0]),
    ("mirrored and turned by 90° one way: set the driver", [0.0, 1.0, 1.0, 0.0]),
    ("mirrored and turned by 90° the other way: set the driver", [0.0, -1.0, -1.0, 0.0]),
];

/// What the pictures say of the mounting.
///
/// # Errors
/// They fit another one better, or say nothing; with what to do.
pub(super) fn judge(picture: Picture, turns: &[(View, Vec<View>)], body_from_cam: &Rot) -> Result<String, String> {
    let mut fits: Vec<(f64, &str)> = SWAPS
        .iter()
        .map(|(name, [a, b, c, d])| {
            let swap = Matrix2::new(*a, *b, *c, *d);
            let of_pair = |first: &View, second: &View| fit(picture, first, second, body_from_cam, &swap);
            let of_turn =
                |(first, during): &(View, Vec<View>)| mean(during.iter().map(|second| of_pair(first, second)));
            (mean(turns.iter().map(of_turn)), *name)
        })
        .collect();
    let as_said = fits[0];
    fits.sort_by(|a, b| b.0.total_cmp(&a.0));
    let [(best, name), (next, _), ..] = fits[..] else { return Err("no way was tried".to_owned()) };
    if best < LEAST_FIT || best - next < LEAST_LEAD {
        return Err(format!(
            "the pictures do not tell (fit {best:.2}, next {next:.2}): do it again before something with more to see, \
             3 m off or more"
        ));
    }
    if as_said.0 < best {
        return Err(format!(
            "the pictures turn as if it were {name} (fit {best:.2}, next {next:.2}, the file's {:.2})",
            as_said.0
        ));
    }
    Ok(format!("turns as the vehicle does (fit {best:.2}, next {next:.2})"))
}

/// 0: there are none.
fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1);
    values.sum::<f64>() / count as f64
}

/// The correlation of the second picture with the first as it would look from there, -1 to 1; 0: they show too little
/// in common.
fn fit(picture: Picture, first: &View, second: &View, body_from_cam: &Rot, swap: &Matrix2<f64>) -> f64 {
    let first_from_second = body_from_cam.inverse()
        * first.odometry.world_from_body.inverse()
        * second.odometry.world_from_body
        * body_from_cam;
    let unswap = swap.transpose(); // its inverse
    let frame = &second.frame;
    let stride = (frame.width / COLUMNS).max(1);
    let mut points = Vec::new();
    for row in (0..frame.height).step_by(stride) {
        for column in (0..frame.width).step_by(stride) {
            let there = swap * plane(frame, column as f64, row as f64);
            let seen = first_from_second * Vec3::new(1.0, there.x, there.y);
            if seen.x < 0.1 {
                continue;
            }
            let here = unswap * Vector2::new(seen.y / seen.x, seen.z / seen.x);
            let Some(index) = pixel(&first.frame, &here) else { continue };
            let pair = value(picture, frame, row * frame.width + column).zip(value(picture, &first.frame, index));
            points.extend(pair);
        }
    }
    if points.len() < LEAST_POINTS { 0.0 } else { correlation(&points) }
}

/// Where a pixel looks: left and up at a distance of 1.
fn plane(frame: &Frame, column: f64, row: f64) -> Vector2<f64> {
    let (width, height) = (frame.width as f64, frame.height as f64);
    let left = (1.0 - 2.0 * (column + 0.5) / width) * (frame.hfov / 2.0).tan();
    let up = (1.0 - 2.0 * (row + 0.5) / height) * (frame.vfov / 2.0).tan();
    Vector2::new(left, up)
}

/// The pixel that looks there; none: it lies outside.
fn pixel(frame: &Frame, plane: &Vector2<f64>) -> Option<usize> {
    let (width, height) = (frame.width as f64, frame.height as f64);
    let column = (1.0 - plane.x / (frame.hfov / 2.0).tan()) * width / 2.0;
    let row = (1.0 - plane.y / (frame.vfov / 2.0).tan()) * height / 2.0;
    let inside = (0.0..width).contains(&column) && (0.0..height).contains(&row);
    inside.then(|| row as usize * frame.width + column as usize)
}

fn value(picture: Picture, frame: &Frame, index: usize) -> Option<f64> {
    match picture {
        Picture::Colour => {
            let rgb = frame.rgb.get(3 * index..3 * index + 3)?;
            Some(rgb.iter().map(|channel| f64::from(*channel)).sum())
        }
        Picture::Depth => frame.depth_mm.get(index).filter(|mm| **mm > 200).map(|mm| 1e3 / f64::from(*mm)),
    }
}

fn correlation(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let mean = points.iter().fold((0.0, 0.0), |sum, point| (sum.0 + point.0 / n, sum.1 + point.1 / n));
    let (mut cross, mut first, mut second) = (0.0, 0.0, 0.0);
    for point in points {
        let (a, b) = (point.0 - mean.0, point.1 - mean.1);
        (cross, first, second) = (cross + a * b, first + a * a, second + b * b);
    }
    let spread = (first * second).sqrt();
    if spread > 0.0 { cross / spread } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use goshawk_core::Time;

    /// A scene at infinity: smooth blobs over the sphere of directions, and a ground.
    fn scene(direction: &Vec3) -> f64 {
        let d = direction.normalize();
        let blobs = (9.0 * d.x + 2.0).sin() * (11.0 * d.y).cos() + (7.0 * d.z + 5.0 * d.y).sin();
        if d.z < -0.1 { blobs + 1.0 } else { blobs }
    }

    /// A picture from there by a camera whose pictures are swapped.
    fn view(world_from_body: Rot, body_from_cam: &Rot, swap: &Matrix2<f64>) -> View {
        let (width, height) = (96, 60);
        let mut frame = Frame {
            seq: 0,
            stamp: Time(0),
            width,
            height,
            hfov: 1.5,
            vfov: 1.0,
            rgb: Vec::new(),
            depth_mm: Vec::new(),
            print: 0,
            fault: None,
        };
        for row in 0..height {
            for column in 0..width {
                let there = swap * plane(&frame, column as f64, row as f64);
                let world = world_from_body * body_from_cam * Vec3::new(1.0, there.x, there.y);
                let brightness = scene(&world);
                frame.rgb.extend([(120.0 + 40.0 * brightness) as u8; 3]);
                frame.depth_mm.push((6000.0 + 1500.0 * brightness) as u16);
            }
        }
        let odometry = Odometry {
            stamp: Time(0),
            pos_world: Vec3::zeros(),
            vel_world: Vec3::zeros(),
            world_from_body,
            ang_vel_body: Vec3::zeros(),
            reset_counter: 0,
        };
        View { frame, odometry }
    }

    fn turns(body_from_cam: &Rot, swap: &Matrix2<f64>) -> Vec<(View, Vec<View>)> {
        let level = Rot::from_euler_angles(0.0, 0.0, 0.7);
        let turns = [Vec3::new(0.0, -0.35, 0.0), Vec3::new(0.35, 0.0, 0.0), Vec3::new(0.0, 0.0, 0.4)];
        let taken = |attitude: Rot| view(attitude, body_from_cam, swap);
        let during = |turn: Vec3| [0.6, 1.0].map(|part| taken(level * Rot::from_scaled_axis(turn * part))).into();
        turns.map(|turn| (taken(level), during(turn))).into()
    }

    #[test]
    fn each_way_in_which_a_picture_may_be_swapped_is_told_from_the_others() {
        let mount = Rot::from_axis_angle(&Vec3::y_axis(), -0.1);
        for (index, (name, [a, b, c, d])) in SWAPS.iter().enumerate() {
            let turns = turns(&mount, &Matrix2::new(*a, *b, *c, *d));
            for picture in [Picture::Colour, Picture::Depth] {
                match judge(picture, &turns, &mount) {
                    Ok(_) => assert_eq!(index, 0, "{name}"),
                    Err(why) => assert!(index > 0 && why.contains(name), "{name}: {why}"),
                }
            }
        }
    }

    #[test]
    fn pictures_that_show_nothing_say_so() {
        let mount = Rot::identity();
        let mut turns = turns(&mount, &Matrix2::identity());
        for (first, during) in &mut turns {
            first.frame.rgb.fill(90);
            for second in during {
                second.frame.rgb.fill(90);
                second.frame.depth_mm.fill(0);
            }
        }
        for picture in [Picture::Colour, Picture::Depth] {
            assert!(judge(picture, &turns, &mount).is_err_and(|why| why.contains("do not tell")));
        }
        assert!(judge(Picture::Colour, &[], &mount).is_err());
    }
}
