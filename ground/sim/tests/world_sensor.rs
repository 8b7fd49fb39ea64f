//! The depth camera's errors are those it is meant to have.

use goshawk_core::Vec3;
use goshawk_sim::render::{Camera, Frame};
use goshawk_sim::sense::file::Sensors;
use goshawk_sim::sense::rgbd::{Motion, RgbdImage};
use goshawk_sim::trial::judge::in_view;
use std::path::Path;

fn flat(depth_m: f32) -> Frame {
    let pixels = 160 * 96;
    Frame {
        width: 160,
        height: 96,
        rgb: vec![120; pixels * 3],
        depth_m: vec![depth_m; pixels],
        class: vec![1; pixels],
        ..Frame::default()
    }
}

fn capture(frame: &Frame, seed: u64) -> RgbdImage {
    moving(frame, &Motion::still(), seed)
}

/// A unit, and what it makes of the frame, both drawn from `seed`.
fn moving(frame: &Frame, motion: &Motion, seed: u64) -> RgbdImage {
    let mut image = RgbdImage::default();
    Sensors::default().sensor(&Camera::default(), seed).capture(frame, motion, seed, &mut image);
    image
}

/// (mean, standard deviation, share of holes) of the measured depth, m, over many images.
fn measured(depth_m: f32) -> (f64, f64, f64) {
    let (mut n, mut sum, mut squares, mut all) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..20 {
        for mm in capture(&flat(depth_m), seed).depth_mm {
            all += 1.0;
            if mm > 0 {
                let d = f64::from(mm) / 1000.0;
                (n, sum, squares) = (n + 1.0, sum + d, squares + d * d);
            }
        }
    }
    let mean: f64 = sum / n;
    (mean, (squares / n - mean * mean).sqrt(), 1.0 - n / all)
}

#[test]
fn depth_noise_grows_with_the_square_of_depth() {
    let (near, far) = (measured(2.0), measured(8.0));
    for (depth, (mean, sigma, _)) in [(2.0, near), (8.0, far)] {
        assert!((mean - depth).abs() < 0.003 * depth, "mean {mean} at {depth}");
        let per_square = sigma / (depth * depth);
        assert!((0.0013..0.0024).contains(&per_square), "σ = {per_square} z² at {depth} m");
    }
}

#[test]
fn a_person_beyond_the_colour_lens_is_not_in_view() {
    let d435 = Sensors::load(Some(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/sensors/d435.toml"))), &[]).unwrap();
    let of = |sensors: &Sensors| sensors.sensor(&Camera::default(), 1);
    let shown = |columns: std::ops::Range<usize>| {
        let mut frame = flat(5.0);
        (40..56).flat_map(|v| columns.clone().map(move |u| v * 160 + u)).for_each(|pixel| frame.class[pixel] = 5);
        frame.person_pixels = 16 * columns.len() as u32;
        frame.person_pixels_visible = frame.person_pixels;
        frame
    };
    let (aside, ahead) = (shown(2..8), shown(77..83));
    assert!(in_view(&aside, &of(&Sensors::default())) && in_view(&ahead, &of(&d435)));
    assert!(!in_view(&aside, &of(&d435)));
}

#[test]
fn holes_are_rare_near_and_common_far() {
    let holes = |depth: f32| measured(depth).2;
    assert!(holes(3.0) < 0.05, "{}", holes(3.0));
    assert!(holes(12.0) > 0.1);
    assert!(holes(18.0) > 0.5);
}

#[test]
fn beyond_its_lenses_a_d435_repeats_the_border_of_its_colour_and_measures_nothing() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/sensors/d435.toml");
    let (camera, mut image) = (Camera::default(), RgbdImage::default());
    let mut sensor = Sensors::load(Some(file.as_ref()), &[]).unwrap().sensor(&camera, 1);
    sensor.capture(&flat(2.0), &Motion::still(), 1, &mut image);
    // 80 px tan(69 / 2 deg) = 55 columns and 80 px tan(42 / 2 deg) = 30.7 rows on each side of the axis
    for (u, v) in (0..160).flat_map(|u| (0..96).map(move |v| (u, v))) {
        let (colour, depth) = (&image.rgb[3 * (v * 160 + u)..][..3], image.depth_mm[v * 160 + u]);
        assert_eq!(colour, &image.rgb[3 * (v.clamp(17, 78) * 160 + u.clamp(25, 134))..][..3], "{u}, {v}");
        assert!(depth == 0 || ((4..156).contains(&u) && (4..92).contains(&v)), "{u}, {v}");
    }
    let measured = image.depth_mm.iter().filter(|mm| **mm > 0).count();
    assert!(measured > 152 * 88 * 9 / 10, "{measured} pixels");
}

#[test]
fn nothing_is_measured_below_the_minimum_or_beyond_the_maximum() {
    for depth in [0.0, 0.2, 0.39, 20.1, 50.0, f32::INFINITY] {
        assert!(capture(&flat(depth), 1).depth_mm.iter().all(|mm| *mm == 0), "{depth} m was measured");
    }
    let limits = Sensors::default().depth;
    let far = capture(&flat(19.9), 2).depth_mm;
    assert!(far.iter().any(|mm| *mm > 0), "nothing was measured at 19.9 m");
    assert!(far.iter().all(|mm| f32::from(*mm) <= limits.max_m * 1000.0));
}

#[test]
fn the_far_side_of_an_edge_and_thin_things_have_holes() {
    let mut frame = flat(6.0);
    for v in 0..96 {
        for u in 0..80 {
            frame.depth_m[v * 160 + u] = 2.0;
        }
        frame.depth_m[v * 160 + 120] = 3.0;
    }
    let share = |column: usize| {
        let holes = (0..30u64).map(|seed| {
            let image = capture(&frame, seed);
            (0..96).filter(|v| image.depth_mm[v * 160 + column] == 0).count()
        });
        holes.sum::<usize>() as f64 / (30.0 * 96.0)
    };
    let (open, far_side, thin) = (share(100), share(80), share(120));
    assert!(far_side > 0.35 && far_side < 0.6, "far side {far_side}");
    assert!(thin > 0.2 && thin < 0.45, "thin {thin}");
    assert!(open < 0.06, "open {open}");
}

#[test]
fn same_seed_same_image_and_another_seed_another() {
    let frame = flat(5.0);
    assert_eq!(capture(&frame, 3), capture(&frame, 3));
    assert_ne!(capture(&frame, 3), capture(&frame, 4));
}

fn mean_level(image: &RgbdImage) -> f64 {
    image.rgb.iter().map(|c| f64::from(*c)).sum::<f64>() / image.rgb.len() as f64
}

fn grey(level: u8) -> Frame {
    Frame { rgb: vec![level; 160 * 96 * 3], ..flat(5.0) }
}

#[test]
fn units_differ_in_exposure_but_stay_usable() {
    let means: Vec<f64> = (0..60).map(|seed| mean_level(&capture(&grey(120), seed))).collect();
    let (low, high) = means.iter().fold((255.0f64, 0.0f64), |(l, h), m| (l.min(*m), h.max(*m)));
    assert!(low > 60.0 && high < 200.0 && high - low > 25.0, "{low} to {high}");
}

#[test]
fn auto_exposure_brings_dark_and_bright_views_together() {
    let level = |true_level: u8| (0..20).map(|seed| mean_level(&capture(&grey(true_level), seed))).sum::<f64>() / 20.0;
    let (dark, bright) = (level(50), level(200));
    assert!(dark > 75.0 && bright < 150.0 && bright > dark, "{dark} {bright}");
}

#[test]
fn turning_smears_an_edge_sideways_and_standing_still_does_not() {
    let mut frame = grey(40);
    for row in frame.rgb.chunks_exact_mut(160 * 3) {
        row[240..].fill(200);
    }
    let width = |motion: &Motion| {
        // Columns whose mean lies between the two sides, over many units.
        let mut between = 0;
        for seed in 0..20 {
            let image = moving(&frame, motion, seed);
            let column = |u: usize| (0..96).map(|v| f64::from(image.rgb[(v * 160 + u) * 3 + 1])).sum::<f64>() / 96.0;
            let (low, high) = (column(60), column(100));
            let quarter = 0.25 * (high - low);
            between += (60..100).filter(|u| (low + quarter..high - quarter).contains(&column(*u))).count();
        }
        f64::from(between as u32) / 20.0
    };
    let turning = Motion { ang_vel_cam: Vec3::new(0.0, 0.0, 6.0), ..Motion::still() };
    let (still, turned) = (width(&Motion::still()), width(&turning));
    assert!(still <= 0.5 && turned > still + 0.7, "{still} {turned}");
}
