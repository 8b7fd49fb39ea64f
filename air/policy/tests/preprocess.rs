//! Preprocessing against a plain reading of its definition, and its bounds for any image.

#![allow(clippy::unwrap_used)]

use goshawk_core::planning::nearest::{COLUMNS, ROWS};
use goshawk_policy::{Contract, PreprocessError, Preprocessor, Source};
use proptest::prelude::*;

const WIDTH: usize = 160;
const HEIGHT: usize = 96;

fn contract() -> Contract {
    let text = include_str!("contract.json");
    Contract::from_json(text).unwrap()
}

fn source(width: u32, height: u32) -> Source {
    let image = contract().image;
    Source { width, height, hfov_rad: image.hfov_rad, vfov_rad: image.vfov_rad }
}

fn run(width: usize, height: usize, rgb: &[u8], depth_mm: &[u16]) -> Vec<f32> {
    let mut preprocessor = Preprocessor::new(&contract(), source(width as u32, height as u32)).unwrap();
    preprocessor.run(rgb, depth_mm).unwrap().to_vec()
}

/// The depth plane for a depth image of the network's size and black colour.
fn depth_plane(depth_mm: &[u16]) -> Vec<f32> {
    run(WIDTH, HEIGHT, &vec![0; 3 * WIDTH * HEIGHT], depth_mm)[3 * WIDTH * HEIGHT..].to_vec()
}

#[test]
fn the_nearest_of_each_block_is_kept_whatever_the_sources_size() {
    for (width, height) in [(WIDTH, HEIGHT), (848, 480), (50, 30)] {
        let preprocessor = Preprocessor::new(&contract(), source(width as u32, height as u32)).unwrap();
        let mut depth_mm = vec![5000; width * height];
        depth_mm[..2].copy_from_slice(&[0, 199]); // no measurements
        *depth_mm.last_mut().unwrap() = 700;
        let nearest = preprocessor.nearest(&depth_mm).unwrap();
        assert_eq!((nearest[nearest.len() - 1], nearest[500]), (700, 5000));
        assert!(nearest.iter().all(|mm| [0, 700, 5000].contains(mm)));
        let full = preprocessor.nearest(&vec![5000; width * height]).unwrap();
        assert_eq!(full, [5000; COLUMNS * ROWS]);
        let nothing = preprocessor.nearest(&vec![0; width * height]).unwrap();
        assert!(nothing.iter().all(|mm| *mm == 0));
        assert!(preprocessor.nearest(&depth_mm[1..]).is_err());
    }
}

/// The definition, word for word, in float64.
fn definition(width: usize, height: usize, rgb: &[u8], depth_mm: &[u16]) -> Vec<f64> {
    let overlap = |a: (f64, f64), b: (f64, f64)| (a.1.min(b.1) - a.0.max(b.0)).max(0.0);
    let mut out = vec![0.0; 4 * WIDTH * HEIGHT];
    let (sx, sy) = (width as f64 / WIDTH as f64, height as f64 / HEIGHT as f64);
    let mut metres: Vec<Option<f64>> = Vec::new();
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let rows = (y as f64 * sy, (y + 1) as f64 * sy);
            let columns = (x as f64 * sx, (x + 1) as f64 * sx);
            for channel in 0..3 {
                let mut sum = 0.0;
                for v in rows.0 as usize..(rows.1.ceil() as usize).min(height) {
                    for u in columns.0 as usize..(columns.1.ceil() as usize).min(width) {
                        let share =
                            overlap(rows, (v as f64, v as f64 + 1.0)) * overlap(columns, (u as f64, u as f64 + 1.0));
                        sum += share * f64::from(rgb[3 * (v * width + u) + channel]);
                    }
                }
                out[(channel * HEIGHT + y) * WIDTH + x] = sum / (sx * sy) / 255.0; // before rounding
            }
            let (v, u) = (((y as f64 + 0.5) * sy) as usize, ((x as f64 + 0.5) * sx) as usize);
            let mm = depth_mm[v * width + u];
            metres.push((mm >= 200).then(|| f64::from(mm) / 1000.0));
        }
    }
    for _ in 0..2 {
        let before = metres.clone();
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                if before[y * WIDTH + x].is_none() {
                    let near = (y.saturating_sub(1)..(y + 2).min(HEIGHT))
                        .flat_map(|v| (x.saturating_sub(1)..(x + 2).min(WIDTH)).map(move |u| v * WIDTH + u))
                        .filter_map(|index| before[index]);
                    metres[y * WIDTH + x] = near.reduce(f64::min);
                }
            }
        }
    }
    for (value, metres) in out[3 * WIDTH * HEIGHT..].iter_mut().zip(metres) {
        *value = metres.unwrap_or(20.0).min(20.0) / 20.0;
    }
    out
}

/// Images of any size near those of cameras, with a random share of holes and of near and far readings.
fn images() -> impl Strategy<Value = (usize, usize, Vec<u8>, Vec<u16>)> {
    let sizes = prop_oneof![Just((160, 96)), Just((320, 192)), Just((424, 240)), (1usize..400, 1usize..250)];
    (sizes, any::<u64>(), 0u64..100).prop_map(|((width, height), seed, holes)| {
        let mut state = seed | 1;
        let mut next = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        };
        let rgb = (0..3 * width * height).map(|_| next() as u8).collect();
        let depth = (0..width * height).map(|_| if next() % 100 < holes { 0 } else { (next() % 65536) as u16 });
        (width, height, rgb, depth.collect())
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_image_gives_what_the_definition_says((width, height, rgb, depth) in images()) {
        let (found, needed) = (run(width, height, &rgb, &depth), definition(width, height, &rgb, &depth));
        prop_assert_eq!(found.len(), needed.len());
        for (i, (&found, needed)) in found.iter().zip(needed).enumerate() {
            // Colour is rounded to whole values; a tie may go either way in single precision.
            let tolerance = if i < 3 * WIDTH * HEIGHT { 0.501 / 255.0 } else { 1e-5 };
            prop_assert!((f64::from(found) - needed).abs() < tolerance, "value {i} is {found}, not {needed}");
        }
    }

    #[test]
    fn the_image_at_the_networks_size_gives_the_same_input((width, height, rgb, depth) in images()) {
        let mut preprocessor = Preprocessor::new(&contract(), source(width as u32, height as u32)).unwrap();
        let (small_rgb, small_depth) = preprocessor.at_network_size(&rgb, &depth).unwrap();
        prop_assert_eq!(run(WIDTH, HEIGHT, &small_rgb, &small_depth), preprocessor.run(&rgb, &depth).unwrap());
    }

    #[test]
    fn every_value_is_between_zero_and_one((width, height, rgb, depth) in images()) {
        let values = run(width, height, &rgb, &depth);
        prop_assert_eq!(values.len(), 4 * WIDTH * HEIGHT);
        prop_assert!(values.iter().all(|v| (0.0..=1.0).contains(v)));
        prop_assert!(values[3 * WIDTH * HEIGHT..].iter().all(|&v| v >= 0.01), "nothing is nearer than min_m");
    }

    #[test]
    fn a_frame_does_not_depend_on_the_one_before(
        (width, height, rgb, depth) in images(), fill in any::<u16>(), shade in any::<u8>()
    ) {
        let mut used = Preprocessor::new(&contract(), source(width as u32, height as u32)).unwrap();
        used.run(&vec![shade; rgb.len()], &vec![fill; depth.len()]).unwrap();
        prop_assert_eq!(used.run(&rgb, &depth).unwrap(), run(width, height, &rgb, &depth));
    }
}

#[test]
fn colours_become_planes_in_the_order_red_green_blue() {
    let rgb: Vec<u8> = (0..WIDTH * HEIGHT).flat_map(|_| [255, 51, 0]).collect();
    let values = run(WIDTH, HEIGHT, &rgb, &vec![0; WIDTH * HEIGHT]);
    let plane = WIDTH * HEIGHT;
    assert!(values[..plane].iter().all(|&v| v == 1.0));
    assert!(values[plane..2 * plane].iter().all(|&v| v == 0.2));
    assert!(values[2 * plane..3 * plane].iter().all(|&v| v == 0.0));
}

#[test]
fn no_measurement_anywhere_is_the_greatest_depth() {
    assert!(depth_plane(&vec![0; WIDTH * HEIGHT]).iter().all(|&v| v == 1.0));
}

#[test]
fn nearer_than_min_m_counts_as_no_measurement_and_farther_than_max_m_is_clipped() {
    let mut depth = vec![5000; WIDTH * HEIGHT];
    depth[100] = 199;
    depth[200] = 200;
    depth[300] = 20001;
    let plane = depth_plane(&depth);
    assert_eq!((plane[100], plane[200], plane[300]), (0.25, 0.01, 1.0));
}

#[test]
fn two_passes_fill_two_pixels_deep_with_the_nearest_neighbour() {
    // One measured column at x = 10; the hole grows away from it.
    let mut depth = vec![0; WIDTH * HEIGHT];
    for y in 0..HEIGHT {
        depth[y * WIDTH + 10] = if y < 50 { 4000 } else { 8000 };
    }
    let plane = depth_plane(&depth);
    let row = |y: usize| plane[y * WIDTH + 7..y * WIDTH + 14].to_vec();
    assert_eq!(row(20), [1.0, 0.2, 0.2, 0.2, 0.2, 0.2, 1.0]);
    assert_eq!(row(70), [1.0, 0.4, 0.4, 0.4, 0.4, 0.4, 1.0]);
    assert_eq!(row(50), [1.0, 0.2, 0.2, 0.4, 0.2, 0.2, 1.0]); // the measured pixel itself is kept
}

#[test]
fn a_measured_pixel_is_never_changed_by_nearer_neighbours() {
    let mut depth = vec![10_000; WIDTH * HEIGHT];
    depth[50 * WIDTH + 80] = 1000;
    let plane = depth_plane(&depth);
    assert_eq!(plane[50 * WIDTH + 80], 0.05);
    assert!(plane.iter().enumerate().all(|(i, &v)| v == 0.5 || i == 50 * WIDTH + 80));
}

#[test]
fn a_hole_at_the_border_is_not_filled_from_the_opposite_side() {
    let mut depth = vec![0; WIDTH * HEIGHT];
    for y in 0..HEIGHT {
        depth[y * WIDTH] = 3000;
    }
    let plane = depth_plane(&depth);
    assert!((0..HEIGHT).all(|y| plane[y * WIDTH + WIDTH - 1] == 1.0));
}

#[test]
fn a_rim_without_depth_is_shown_as_what_is_measured_beside_it_and_is_told_to_nobody_else() {
    // A wall that comes nearer from left to right, of which the lenses do not see 4 pixels on each side.
    let wall = |x: usize| 1000 + 100 * x as u16;
    let inside = |x: usize, y: usize| (4..WIDTH - 4).contains(&x) && (4..HEIGHT - 4).contains(&y);
    let mut depth_mm: Vec<u16> = Vec::new();
    (0..HEIGHT).for_each(|y| depth_mm.extend((0..WIDTH).map(|x| if inside(x, y) { wall(x) } else { 0 })));
    let plain = Preprocessor::new(&contract(), source(WIDTH as u32, HEIGHT as u32)).unwrap();
    let plane = |preprocessor: &mut Preprocessor| {
        preprocessor.run(&vec![0; 3 * WIDTH * HEIGHT], &depth_mm).unwrap()[3 * WIDTH * HEIGHT..].to_vec()
    };
    let shown = plane(&mut plain.clone().with_rim(8));
    for (index, value) in shown.iter().enumerate() {
        let mm = f32::from(wall((index % WIDTH).clamp(4, WIDTH - 5)));
        assert!((value - (mm / 20_000.0)).abs() < 1e-6, "pixel {index}: {value}");
    }
    // Without a rim, or with one of 3 pixels, the border is as far as can be.
    for rim in [0, 3] {
        let shown = plane(&mut plain.clone().with_rim(rim));
        assert!((0..WIDTH).all(|x| shown[x] == 1.0) && (0..HEIGHT).all(|y| shown[y * WIDTH] == 1.0), "{rim}");
    }
    let nearest = plain.nearest(&depth_mm).unwrap();
    assert_eq!(nearest, plain.with_rim(8).nearest(&depth_mm).unwrap());
}

#[test]
fn a_buffer_of_the_wrong_length_is_named() {
    let mut preprocessor = Preprocessor::new(&contract(), source(160, 96)).unwrap();
    let error = preprocessor.run(&[0; 10], &[0; WIDTH * HEIGHT]).unwrap_err();
    assert!(matches!(error, PreprocessError::Length { buffer: "rgb", found: 10, needed: 46080, .. }), "{error}");
    let error = preprocessor.run(&[0; 3 * WIDTH * HEIGHT], &[0; WIDTH * HEIGHT / 2]).unwrap_err();
    assert!(matches!(error, PreprocessError::Length { buffer: "depth", found: 15360, needed: 30720, .. }), "{error}");
}

#[test]
fn a_field_of_view_off_by_more_than_two_percent_is_refused() {
    let mut narrow = source(160, 96);
    narrow.hfov_rad *= 0.97;
    let error = Preprocessor::new(&contract(), narrow).unwrap_err();
    assert!(matches!(error, PreprocessError::FieldOfView { axis: "horizontal", .. }), "{error}");
    let mut tall = source(160, 96);
    tall.vfov_rad *= 1.03;
    let error = Preprocessor::new(&contract(), tall).unwrap_err();
    assert!(matches!(error, PreprocessError::FieldOfView { axis: "vertical", .. }), "{error}");
    for odd in [f64::NAN, f64::INFINITY, 0.0, -1.5] {
        let mut broken = source(160, 96);
        broken.hfov_rad = odd;
        assert!(Preprocessor::new(&contract(), broken).is_err());
    }
    let mut close = source(160, 96);
    close.hfov_rad *= 1.015;
    assert!(Preprocessor::new(&contract(), close).is_ok());
}

#[test]
fn an_impossible_size_is_refused() {
    for (width, height) in [(0, 96), (160, 0), (u32::MAX, u32::MAX)] {
        let error = Preprocessor::new(&contract(), source(width, height)).unwrap_err();
        assert_eq!(error, PreprocessError::Size { width, height });
    }
}

/// One case of `tests/vectors/preprocess.json`, which the training side writes.
#[derive(serde::Deserialize)]
struct Case {
    name: String,
    source: Size,
    target: Size,
    depth_mm: Vec<u16>,
    rgb: Vec<u8>,
    expected_depth: Vec<f64>,
    expected_rgb_planes: Vec<f64>,
}

#[derive(Clone, Copy, serde::Deserialize)]
struct Size {
    width: u32,
    height: u32,
}

#[test]
fn the_training_side_prepares_the_same() {
    #[derive(serde::Deserialize)]
    struct Vectors {
        depth: goshawk_policy::contract::Depth,
        cases: Vec<Case>,
    }
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/vectors/preprocess.json");
    let vectors: Vectors = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    assert!(!vectors.cases.is_empty());
    for case in vectors.cases {
        let mut contract = contract();
        contract.depth = vectors.depth;
        contract.image.width = case.target.width as usize;
        contract.image.height = case.target.height as usize;
        let mut preprocessor = Preprocessor::new(&contract, source(case.source.width, case.source.height)).unwrap();
        let found = preprocessor.run(&case.rgb, &case.depth_mm).unwrap();
        let needed = [case.expected_rgb_planes, case.expected_depth].concat();
        assert_eq!(found.len(), needed.len(), "{}", case.name);
        for (i, (&found, needed)) in found.iter().zip(needed).enumerate() {
            assert!((f64::from(found) - needed).abs() < 1e-5, "{} value {i}: {found}, not {needed}", case.name);
        }
    }
}
