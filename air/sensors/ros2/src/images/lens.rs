//! From a camera's image to the picture that the policy was trained with: which pixels are looked up, worked out once.

use crate::wire::messages::CameraInfo;
use std::ops::Range;

/// An image has no more pixels than this.
const MOST_PIXELS: u32 = 4096 * 4096;
/// The lens may see this much less than is asked for, of the image's width and height: the edge's pixels stand in.
const SHORT: f64 = 0.015;
/// Colour is looked up this often in each direction of a pixel, and averaged.
const SAMPLES: u32 = 2;

/// Why a lens cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LensError {
    /// No calibration, or none that can be.
    #[error("is not calibrated: {0}")]
    Uncalibrated(&'static str),
    /// Only `plumb_bob` and none are known.
    #[error("has distortion model {0:?}: publish the rectified image, or calibrate it as plumb_bob")]
    Model(String),
    /// Part of the image, or not every pixel.
    #[error("has binning or a region of interest: publish the whole image")]
    Part,
    /// It sees less than asked for.
    #[error(
        "sees less than {hfov_deg:.1} x {vfov_deg:.1} degrees: take a wider lens, or write rim = true under [camera], or \
         take a policy and a vehicle file of less"
    )]
    Narrow {
        /// Asked for.
        hfov_deg: f64,
        /// Asked for.
        vfov_deg: f64,
    },
}

/// The picture that is asked for: a pinhole's, its axis the lens's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// px.
    pub width: u32,
    /// px.
    pub height: u32,
    /// rad.
    pub hfov: f64,
    /// rad.
    pub vfov: f64,
    /// A lens that sees less is taken too: beyond it colour repeats its border, and nothing is measured.
    pub rim: bool,
}

/// Which pixels of the camera's image make the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Of the camera's image, px.
    pub width: u32,
    /// As `width`.
    pub height: u32,
    /// For each pixel of the picture where the colours are that are averaged, column and row.
    pub colour: Vec<[(u16, u16); 4]>,
    /// For each pixel of the picture where its depth is; none: the lens does not see there.
    pub depth: Vec<Option<(u16, u16)>>,
}

/// fx, fy, cx, cy in px; k1, k2, p1, p2, k3.
struct Lens {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    d: [f64; 5],
}

impl Lens {
    /// Of the images as they come, or rectified.
    fn new(info: &CameraInfo, rectified: bool) -> Result<Self, LensError> {
        let pixels = info.width.checked_mul(info.height).filter(|&n| n > 0 && n <= MOST_PIXELS);
        if pixels.is_none() || info.width > 65_535 || info.height > 65_535 {
            return Err(LensError::Uncalibrated("no image has that size"));
        }
        let roi = &info.roi;
        let whole = (roi.width == 0 || roi.width == info.width) && (roi.height == 0 || roi.height == info.height);
        if info.binning_x > 1 || info.binning_y > 1 || roi.x_offset > 0 || roi.y_offset > 0 || !whole {
            return Err(LensError::Part);
        }
        let [fx, _, cx, _, fy, cy, ..] = info.k;
        let [rectified_fx, _, rectified_cx, _, _, rectified_fy, rectified_cy, ..] = info.p;
        let (fx, fy, cx, cy, unlike) = if rectified {
            (rectified_fx, rectified_fy, rectified_cx, rectified_cy, "its P is not a pinhole's")
        } else {
            (fx, fy, cx, cy, "its K is not a pinhole's")
        };
        let all = [fx, fy, cx, cy].iter().chain(&info.d).all(|x| x.is_finite());
        if !all || fx < 1.0 || fy < 1.0 || cx <= 0.0 || cy <= 0.0 {
            return Err(LensError::Uncalibrated(unlike));
        }
        let mut d = [0.0; 5];
        if !rectified && info.d.iter().any(|&x| x != 0.0) {
            if info.distortion_model != "plumb_bob" || info.d.len() > 5 {
                return Err(LensError::Model(info.distortion_model.chars().take(40).collect()));
            }
            d[..info.d.len()].copy_from_slice(&info.d);
        }
        Ok(Lens { fx, fy, cx, cy, d })
    }

    /// Where the ray through (x, y, 1) meets the image, px; a pixel's centre is at whole numbers.
    fn project(&self, x: f64, y: f64) -> (f64, f64) {
        let [k1, k2, p1, p2, k3] = self.d;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
        (self.fx * u + self.cx, self.fy * v + self.cy)
    }
}

impl Map {
    /// Of the camera that `info` describes, distortion undone unless its images are `rectified` already.
    ///
    /// # Errors
    /// It cannot give that picture.
    pub fn new(info: &CameraInfo, rectified: bool, view: &View) -> Result<Self, LensError> {
        let lens = Lens::new(info, rectified)?;
        let narrow = LensError::Narrow { hfov_deg: view.hfov.to_degrees(), vfov_deg: view.vfov.to_degrees() };
        let (right, down) = ((view.hfov / 2.0).tan(), (view.vfov / 2.0).tan());
        // Where the camera's image shows that place of the picture, and whether it does.
        let at = |column: f64, row: f64| {
            let x = right * (2.0 * column / f64::from(view.width) - 1.0);
            let y = down * (2.0 * row / f64::from(view.height) - 1.0);
            let (u, v) = lens.project(x, y);
            let clamped = |place: f64, size: u32| {
                let (place, short) = (place.round(), SHORT * f64::from(size));
                let seen = place >= -short && place < f64::from(size) + short;
                (place.clamp(0.0, f64::from(size - 1)) as u16, seen)
            };
            let ((u, in_row), (v, in_column)) = (clamped(u, info.width), clamped(v, info.height));
            ((u, v), in_row && in_column)
        };
        let step = 1.0 / f64::from(SAMPLES);
        // Where a pixel of the picture takes its colours and its depth from, and whether the lens sees all of these.
        let pixel = |column: u32, row: u32| {
            let (left, top) = (f64::from(column), f64::from(row));
            let (depth, mut seen) = at(left + 0.5, top + 0.5);
            let mut samples = [(0, 0); 4];
            for (k, sample) in samples.iter_mut().enumerate() {
                let (right, down) = (k as u32 % SAMPLES, k as u32 / SAMPLES);
                let (place, shown) = at(left + step * (f64::from(right) + 0.5), top + step * (f64::from(down) + 0.5));
                (*sample, seen) = (place, seen && shown);
            }
            (samples, depth, seen)
        };
        let columns = stretch(view.width, |column| pixel(column, view.height / 2).2);
        let rows = stretch(view.height, |row| pixel(view.width / 2, row).2);
        if columns.is_empty() || rows.is_empty() {
            return Err(narrow);
        }
        let pixels = (view.width * view.height) as usize;
        let (mut colour, mut depth) = (Vec::with_capacity(pixels), Vec::with_capacity(pixels));
        for row in 0..view.height {
            for column in 0..view.width {
                // Beyond what the lens sees about its axis its polynomial may lead back into the image.
                let near = (column.clamp(columns.start, columns.end - 1), row.clamp(rows.start, rows.end - 1));
                let (samples, place, seen) = pixel(near.0, near.1);
                let measured = seen && near == (column, row);
                if !measured && !view.rim {
                    return Err(narrow);
                }
                colour.push(samples);
                depth.push(measured.then_some(place));
            }
        }
        Ok(Map { width: info.width, height: info.height, colour, depth })
    }
}

/// The stretch about the middle of 0..`size` where all is `seen`.
fn stretch(size: u32, seen: impl Fn(u32) -> bool) -> Range<u32> {
    let low = (0..size / 2).rev().find(|&place| !seen(place)).map_or(0, |place| place + 1);
    low..(size / 2..size).find(|&place| !seen(place)).unwrap_or(size)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) const VIEW: View =
        View { width: 4, height: 2, hfov: std::f64::consts::FRAC_PI_2, vfov: 0.927_295_218_001_612_2, rim: false };

    /// A pinhole that sees exactly that: its pixels are the picture's, `scale` times as fine.
    pub(crate) fn pinhole(scale: u32) -> CameraInfo {
        let s = f64::from(scale);
        let k = [2.0 * s, 0.0, 2.0 * s - 0.5, 0.0, 2.0 * s, s - 0.5, 0.0, 0.0, 1.0];
        CameraInfo { width: 4 * scale, height: 2 * scale, k, ..CameraInfo::default() }
    }

    #[test]
    fn a_pinhole_of_that_view_is_taken_pixel_by_pixel() {
        let map = Map::new(&pinhole(1), false, &VIEW).unwrap();
        let wanted: Vec<_> = (0..2).flat_map(|row| (0..4).map(move |column| Some((column, row)))).collect();
        assert_eq!(map.depth, wanted);
        let fine = Map::new(&pinhole(2), false, &VIEW).unwrap();
        assert_eq!(fine.colour[5], [(2, 2), (3, 2), (2, 3), (3, 3)]);
    }

    #[test]
    fn a_wider_lens_is_cropped_and_a_narrower_one_refused() {
        let mut info = pinhole(100);
        info.k[0] *= 0.8;
        info.k[4] *= 0.8;
        let map = Map::new(&info, false, &VIEW).unwrap();
        assert_eq!(map.depth[0], Some((80, 60)));
        info.k[0] *= 1.5;
        assert!(matches!(Map::new(&info, false, &VIEW), Err(LensError::Narrow { .. })));
    }

    #[test]
    fn beyond_a_narrower_lens_colour_repeats_its_border_and_nothing_is_measured() {
        let view = View { width: 40, height: 20, rim: true, ..VIEW };
        let mut info = pinhole(100);
        (info.k[0], info.k[4]) = (300.0, 200.0);
        info.distortion_model = "plumb_bob".to_owned();
        for d in [vec![], vec![-0.3, 0.0, 0.0, 0.0, 0.0]] {
            info.d = d;
            let map = Map::new(&info, false, &view).unwrap();
            let row = &map.depth[400..440];
            let seen: Vec<_> = row.iter().map(Option::is_some).collect();
            let first = seen.iter().position(|&seen| seen).unwrap();
            assert!((1..9).contains(&first) && seen[first..40 - first].iter().all(|&seen| seen), "{seen:?}");
            assert!(!seen[40 - first..].iter().any(|&seen| seen));
            assert_eq!(map.colour[400], map.colour[400 + first]);
            assert!(map.depth.iter().flatten().all(|&(column, row)| column < 400 && row < 200));
        }
        info.k[2] = 4000.0;
        assert!(matches!(Map::new(&info, false, &view), Err(LensError::Narrow { .. })), "it looks elsewhere");
    }

    // By OpenCV's formula at x = -0.75, y = -0.25, worked out by hand.
    #[test]
    fn plumb_bob_is_undone_and_every_other_distortion_refused() {
        let mut info = CameraInfo { distortion_model: "plumb_bob".to_owned(), ..pinhole(100) };
        info.d = vec![-0.1, 0.01, 0.001, -0.002, 0.0];
        let map = Map::new(&info, false, &VIEW).unwrap();
        let r2 = 0.75_f64 * 0.75 + 0.25 * 0.25;
        let radial = 1.0 - 0.1 * r2 + 0.01 * r2 * r2;
        let u = -0.75 * radial + 0.002 * 0.75 * 0.25 - 0.002 * (r2 + 2.0 * 0.75 * 0.75);
        let v = -0.25 * radial + 0.001 * (r2 + 2.0 * 0.25 * 0.25) - 0.004 * 0.75 * 0.25;
        assert_eq!(map.depth[0], Some(((200.0 * u + 199.5).round() as u16, (200.0 * v + 99.5).round() as u16)));
        info.distortion_model = "equidistant".to_owned();
        assert!(matches!(Map::new(&info, false, &VIEW), Err(LensError::Model(model)) if model == "equidistant"));
        info.d = vec![0.0; 8];
        assert!(Map::new(&info, false, &VIEW).is_ok(), "without distortion the model's name does not matter");
    }

    #[test]
    fn a_rectified_image_is_taken_by_p_and_its_distortion_is_gone() {
        let [fx, _, cx, _, fy, cy, ..] = pinhole(100).k;
        let p = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0];
        let mut info = CameraInfo { distortion_model: "plumb_bob".to_owned(), p, ..pinhole(100) };
        info.d = vec![-0.1, 0.01, 0.001, -0.002, 0.0];
        info.k[0] *= 1.2; // of the raw image, which another lens than P's shows
        assert_eq!(Map::new(&info, true, &VIEW), Map::new(&pinhole(100), false, &VIEW));
        info.p = [0.0; 12];
        assert_eq!(Map::new(&info, true, &VIEW), Err(LensError::Uncalibrated("its P is not a pinhole's")));
    }

    #[test]
    fn no_calibration_and_absurd_ones_are_refused() {
        let good = pinhole(1);
        let k = |at: usize, value: f64| {
            let mut info = good.clone();
            info.k[at] = value;
            info
        };
        for bad in [
            CameraInfo::default(),
            k(0, 0.0),
            k(4, f64::NAN),
            k(2, f64::INFINITY),
            CameraInfo { width: u32::MAX, height: u32::MAX, ..good.clone() },
            CameraInfo { d: vec![f64::NAN], ..good.clone() },
        ] {
            assert!(matches!(Map::new(&bad, false, &VIEW), Err(LensError::Uncalibrated(_))), "{bad:?}");
        }
        assert_eq!(Map::new(&CameraInfo { binning_x: 2, ..good }, false, &VIEW), Err(LensError::Part));
    }
}
