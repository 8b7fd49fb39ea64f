//! The depth camera's errors are those it is meant to have.

use goshawk_sim::render::Frame;
use goshawk_sim::sensor::{RgbdImage, Sensor, SensorConfig};

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
    let mut image = RgbdImage::default();
    Sensor::new(SensorConfig::default()).capture(frame, seed, &mut image);
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
fn holes_are_rare_near_and_common_far() {
    let holes = |depth: f32| measured(depth).2;
    assert!(holes(3.0) < 0.05, "{}", holes(3.0));
    assert!(holes(12.0) > 0.1);
    assert!(holes(18.0) > 0.5);
}

#[test]
fn nothing_is_measured_below_the_minimum_or_beyond_the_maximum() {
    for depth in [0.0, 0.2, 0.39, 20.1, 50.0, f32::INFINITY] {
        assert!(capture(&flat(depth), 1).depth_mm.iter().all(|mm| *mm == 0), "{depth} m was measured");
    }
    let limits = SensorConfig::default();
    for mm in capture(&flat(19.9), 2).depth_mm.into_iter().filter(|mm| *mm > 0) {
        assert!(f32::from(mm) <= limits.max_m * 1000.0);
    }
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

#[test]
fn exposure_varies_but_stays_usable() {
    let means: Vec<f64> = (0..60)
        .map(|seed| {
            let image = capture(&flat(5.0), seed);
            image.rgb.iter().map(|c| f64::from(*c)).sum::<f64>() / image.rgb.len() as f64
        })
        .collect();
    let (low, high) = means.iter().fold((255.0f64, 0.0f64), |(l, h), m| (l.min(*m), h.max(*m)));
    assert!(low > 60.0 && high < 230.0 && high - low > 30.0, "{low} to {high}");
}
