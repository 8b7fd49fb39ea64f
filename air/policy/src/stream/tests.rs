use super::*;

const WIDTH: usize = 160;
const HEIGHT: usize = 96;
const LIMITS: RateLimits = RateLimits { least_hz: 15.0, most_hz: 65.0 };
const FLYING: Moving = Moving { flying: true, speed_mps: 3.0, rate_radps: 0.5 };
const STANDING: Moving = Moving { flying: false, speed_mps: 0.0, rate_radps: 0.0 };

fn drawn(seed: u64) -> u64 {
    mixed(mixed(0x1234_5678, seed as u32), (seed >> 32) as u32) >> 17
}

fn mixed(print: u64, value: u32) -> u64 {
    let z = (print ^ u64::from(value)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (z ^ (z >> 29)).wrapping_mul(0x94d0_49bb_1331_11eb)
}

/// A slope with waves of colour and a little noise, which move with `phase`.
fn scene(phase: u64) -> (Vec<u8>, Vec<u16>) {
    let (mut rgb, mut depth) = (Vec::new(), Vec::new());
    for at in 0..WIDTH * HEIGHT {
        let (u, v) = (at % WIDTH, at / WIDTH);
        let noise = drawn(phase * 100_003 + at as u64) % 7;
        let wave = (90.0 + 60.0 * ((u as u64 + phase) as f64 / 15.0).sin()) as u8 + noise as u8;
        rgb.extend([wave, wave, wave / 2]);
        depth.push(if at % 31 == 0 { 0 } else { (1500 + 60 * v + 5 * u) as u16 + noise as u16 });
    }
    (rgb, depth)
}

/// What is named, and when, s: frame k of `frames` comes at k / `hz`, seconds 0 to 4; the fault begins at 1 s.
fn named(hz: f64, moving: Moving, frame: impl Fn(u64, bool) -> (Vec<u8>, Vec<u16>)) -> Option<(StreamFault, f64)> {
    let mut monitor = StreamMonitor::new(LIMITS);
    (0..(4.0 * hz) as u64).find_map(|k| {
        let at = k as f64 / hz;
        let (rgb, depth) = frame(k, at >= 1.0);
        let arrival = Arrival { seq: k, stamp: Time::from_secs(10.0 + at), source: 0 };
        monitor.judge(&arrival, &rgb, &depth, &moving).map(|fault| (fault, at - 1.0))
    })
}

fn assert_named(fault: StreamFault, frame: impl Fn(u64, bool) -> (Vec<u8>, Vec<u16>)) {
    let (found, after_s) = named(30.0, FLYING, frame).unwrap();
    assert_eq!(found, fault);
    assert!((0.0..0.6).contains(&after_s), "{fault:?} after {after_s} s");
}

#[test]
fn a_camera_that_sees_is_not_accused_in_flight_or_standing() {
    for moving in [FLYING, STANDING] {
        for hz in [20.0, 30.0, 60.0] {
            assert_eq!(named(hz, moving, |k, _| scene(k)), None);
        }
    }
}

#[test]
fn a_picture_that_stands_still_is_frozen_colour_or_depth_alone_too() {
    assert_named(StreamFault::Frozen, |k, bad| scene(if bad { 30 } else { k }));
    assert_named(StreamFault::Frozen, |k, bad| (scene(k).0, scene(if bad { 30 } else { k }).1));
    assert_named(StreamFault::Frozen, |k, bad| (scene(if bad { 30 } else { k }).0, scene(k).1));
}

#[test]
fn a_noiseless_camera_that_stands_may_repeat_itself_for_a_while_but_not_for_ever() {
    let (fault, after_s) = named(30.0, STANDING, |k, bad| scene(if bad { 30 } else { k })).unwrap();
    assert_eq!(fault, StreamFault::Frozen);
    assert!(after_s > 1.8, "{after_s}");
}

#[test]
fn black_and_lost_depth_are_blank() {
    assert_named(StreamFault::Blank, |k, bad| if bad { (vec![0; 3 * WIDTH * HEIGHT], scene(k).1) } else { scene(k) });
    assert_named(StreamFault::Blank, |k, bad| (scene(k).0, if bad { vec![0; WIDTH * HEIGHT] } else { scene(k).1 }));
}

#[test]
fn depth_that_fades_into_the_open_sky_is_no_fault() {
    let fading = |k: u64, _| {
        let (rgb, mut depth) = scene(k);
        let rows = HEIGHT.saturating_sub(2 * k as usize);
        depth[rows * WIDTH..].fill(0);
        (rgb, depth)
    };
    assert_eq!(named(30.0, FLYING, fading), None);
    assert!(named(30.0, STANDING, fading).is_some(), "on the ground the floor is in view");
}

#[test]
fn noise_is_named_in_colour_and_in_depth() {
    let colour = |k: u64| (0..3 * WIDTH * HEIGHT).map(|at| drawn(k << 20 | at as u64) as u8).collect::<Vec<u8>>();
    let depth = |k: u64| (0..WIDTH * HEIGHT).map(|at| (drawn(k << 20 | at as u64) % 20_000) as u16).collect::<Vec<_>>();
    assert_named(StreamFault::Noise, |k, bad| if bad { (colour(k), depth(k)) } else { scene(k) });
    assert_named(StreamFault::Noise, |k, bad| (if bad { colour(k) } else { scene(k).0 }, scene(k).1));
    assert_named(StreamFault::Noise, |k, bad| (scene(k).0, if bad { depth(k) } else { scene(k).1 }));
}

#[test]
fn one_depth_everywhere_is_named_near_and_far_with_a_little_noise_too() {
    for mm in [300, 4000, 19_000] {
        let flat = |k: u64| -> Vec<u16> {
            (0..WIDTH * HEIGHT).map(|at| mm + (drawn(k << 20 | at as u64) % 3) as u16).collect()
        };
        assert_named(StreamFault::OneDepth, |k, bad| (scene(k).0, if bad { flat(k) } else { scene(k).1 }));
    }
}

#[test]
fn a_hand_before_the_lens_is_named() {
    let near = |k: u64| scene(k).1.iter().map(|mm| mm / 20).collect();
    assert_named(StreamFault::Covered, |k, bad| (scene(k).0, if bad { near(k) } else { scene(k).1 }));
}

#[test]
fn five_pictures_a_second_are_too_few_and_a_hundred_too_many() {
    let (fault, _) = named(5.0, FLYING, |k, _| scene(k)).unwrap();
    assert_eq!(fault, StreamFault::Slow);
    let (fault, after_s) = named(107.0, FLYING, |k, _| scene(k)).unwrap();
    assert_eq!(fault, StreamFault::TwoCameras);
    assert!(after_s < 0.0, "named within the first second");
}

#[test]
fn two_cameras_are_told_by_their_counts_and_by_their_publishers_at_any_rate() {
    let first = |seq: u64, at: f64, source| Arrival { seq, stamp: Time::from_secs(10.0 + at), source };
    let mut counts = StreamMonitor::new(LIMITS);
    let mut publishers = StreamMonitor::new(LIMITS);
    let mut named = [None; 2];
    for k in 0..20u64 {
        let at = k as f64 / 30.0;
        for (second, seq) in [(0, k), (1, 5000 + k)] {
            let (rgb, depth) = scene(2 * k + second);
            let at = at + 0.01 * second as f64;
            named[0] = named[0].or(counts.judge(&first(seq, at, 0), &rgb, &depth, &FLYING));
            named[1] = named[1].or(publishers.judge(&first(2 * k + second, at, 1 + second), &rgb, &depth, &FLYING));
        }
    }
    assert_eq!(named, [Some(StreamFault::TwoCameras); 2]);
}

#[test]
fn a_camera_that_is_started_again_is_no_second_one_and_a_fault_that_ends_is_over() {
    let mut monitor = StreamMonitor::new(LIMITS);
    let mut judge = |seq: u64, at: f64, source: u64, phase: u64| {
        let (rgb, depth) = scene(phase);
        let arrival = Arrival { seq, stamp: Time::from_secs(10.0 + at), source };
        monitor.judge(&arrival, &rgb, &depth, &FLYING)
    };
    let restarted = (0..60u64).filter_map(|k| judge(k % 30, k as f64 / 30.0, 1 + k / 30, k)).count();
    assert_eq!(restarted, 0);
    let frozen: Vec<_> = (60..90u64).map(|k| judge(k, k as f64 / 30.0, 2, 60)).collect();
    assert_eq!(frozen.last(), Some(&Some(StreamFault::Frozen)));
    let after: Vec<_> = (90..120u64).map(|k| judge(k, k as f64 / 30.0, 2, k)).collect();
    assert_eq!((after.first(), after.last()), (Some(&Some(StreamFault::Frozen)), Some(&None)));
}

#[test]
fn an_image_of_any_size_is_judged_without_a_panic() {
    let mut monitor = StreamMonitor::new(LIMITS);
    for pixels in [0, 1, 2, 3, 1025, 640 * 480] {
        let arrival = Arrival { seq: pixels as u64, stamp: Time(u64::MAX), source: 0 };
        let _ = monitor.judge(&arrival, &vec![7; 3 * pixels], &vec![900; pixels], &STANDING);
    }
}
