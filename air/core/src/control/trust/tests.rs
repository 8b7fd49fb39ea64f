use super::*;
use crate::values::types::Time;
use proptest::prelude::*;

const DT: f64 = 0.01;

/// At `k` steps, flying at 4 m/s, with noise that no two samples share.
fn good(k: u32) -> Odometry {
    let t = DT * f64::from(k);
    let noise = 0.005 * (37.0 * t).sin();
    Odometry {
        stamp: Time::from_secs(1.0 + t),
        pos_world: Vec3::new(4.0 * t, noise, 2.0),
        vel_world: Vec3::new(4.0, 6.0 * noise, 0.0),
        world_from_body: Rot::identity(),
        ang_vel_body: Vec3::zeros(),
        reset_counter: 0,
    }
}

/// Feeds `samples` of `estimate`; what was named, and after how many samples.
fn feed(
    trust: &mut Trust,
    samples: std::ops::Range<u32>,
    estimate: impl Fn(u32) -> Odometry,
) -> Option<(OdometryFault, u32)> {
    let mut named = None;
    for k in samples.clone() {
        let (last, new) = (estimate(k.saturating_sub(1)), estimate(k));
        let moved = new.pos_world - last.pos_world - (last.vel_world + new.vel_world) * (0.5 * DT);
        let step = Step {
            last: &last,
            new: &new,
            dt: DT,
            acc_model: Vec3::zeros(),
            acc_followed: Vec3::zeros(),
            disturbance: Vec3::zeros(),
            free: true,
            jumped: moved.norm() > 0.4,
        };
        named = named.or(trust.step(&step).map(|fault| (fault, k - samples.start)));
    }
    named
}

/// Good until sample 100, then `bad`; what was named, and how many seconds later.
fn named(bad: impl Fn(u32, Odometry) -> Odometry) -> Option<(OdometryFault, f64)> {
    let estimate = |k| if k < 100 { good(k) } else { bad(k, good(k)) };
    let named = feed(&mut Trust::default(), 1..400, estimate);
    named.map(|(fault, at)| (fault, DT * f64::from(at + 1) - 1.0))
}

#[test]
fn good_odometry_is_believed() {
    let mut trust = Trust::default();
    assert_eq!(feed(&mut trust, 1..2000, good), None);
    assert!(trust.doubt() < 0.2 && trust.distrust().is_none(), "{}", trust.doubt());
}

#[test]
fn each_falsehood_is_named_within_a_second() {
    let faster = |by: f64| move |_: u32, o: Odometry| Odometry { vel_world: o.vel_world + Vec3::y() * by, ..o };
    let drifting =
        |k: u32, o: Odometry| Odometry { pos_world: o.pos_world + Vec3::x() * (DT * f64::from(k - 100)), ..o };
    let higher = |_: u32, o: Odometry| Odometry { pos_world: o.pos_world + Vec3::z(), ..o };
    let about = |_: u32, o: Odometry| Odometry { world_from_body: Rot::from_axis_angle(&Vec3::z_axis(), 3.1), ..o };
    let still = |_: u32, o: Odometry| Odometry { vel_world: good(99).vel_world, ..o };
    let dead = |_: u32, o: Odometry| Odometry { stamp: o.stamp, ..good(99) };
    let names = |got: Option<(OdometryFault, f64)>, fault: OdometryFault, within: f64| {
        assert!(got.is_some_and(|(named, after)| named == fault && after <= within), "{fault:?}: {got:?}");
    };
    names(named(faster(3.0)), OdometryFault::VelocityStepped, 0.03);
    names(named(faster(1.0)), OdometryFault::PositionDisagrees, 0.8);
    names(named(drifting), OdometryFault::PositionDisagrees, 0.8);
    names(named(higher), OdometryFault::PositionJumped, 0.03);
    names(named(about), OdometryFault::AttitudeTurned, 0.03);
    names(named(still), OdometryFault::Frozen, 0.35);
    names(named(dead), OdometryFault::Frozen, 0.15);
}

/// `good` with a velocity that wanders off and back as that of a PX4 that hovers by GPS alone: 0.3 m/s off as a rule,
/// 0.8 m/s for a second at most.
fn wandering(k: u32) -> Odometry {
    let t = DT * f64::from(k);
    let off = Vec3::new((0.35 * t).sin(), (0.5 * t).cos(), 0.8 * (1.3 * t).sin());
    Odometry { vel_world: good(k).vel_world + off * (0.3 + 0.2 * (0.11 * t).sin()), ..good(k) }
}

#[test]
fn a_velocity_that_wanders_as_by_gps_is_believed_and_a_drift_of_2_mps_is_named_all_the_same() {
    let mut trust = Trust::default();
    assert_eq!(feed(&mut trust, 1..12_000, wandering), None);
    assert!(trust.distrust().is_none());
    let drifting = |k: u32| {
        let by = 2.0 * DT * f64::from(k - 11_999);
        Odometry { pos_world: good(k).pos_world + Vec3::y() * by, ..wandering(k) }
    };
    let named = feed(&mut trust, 12_000..12_400, drifting);
    assert!(named.is_some_and(|(fault, after)| fault == OdometryFault::PositionDisagrees && after < 100), "{named:?}");
}

/// `odometry` with position and velocity told in steps of a centimetre, as some estimators do.
fn in_steps(odometry: Odometry) -> Odometry {
    let stepped = |x: f64| (x * 100.0).round() / 100.0;
    Odometry {
        pos_world: odometry.pos_world.map(stepped),
        vel_world: odometry.vel_world.map(stepped),
        world_from_body: Rot::from_axis_angle(&Vec3::x_axis(), 1e-3 * (odometry.stamp.0 as f64 * 5e-9).sin()),
        ..odometry
    }
}

/// Speeds up to 3 m/s within a second, flies on until `brakes_at`, s, and hovers a second later, as `bad` tells it: what
/// was named, and when, s.
fn flown_in_steps(brakes_at: f64, bad: impl Fn(f64, Odometry) -> Odometry) -> Option<(OdometryFault, f64)> {
    let acc = |t: f64| {
        let brakes = (brakes_at..brakes_at + 1.0).contains(&t);
        3.0 * (f64::from(u8::from(t < 1.0)) - f64::from(u8::from(brakes)))
    };
    let (mut vel, mut pos, mut trust, mut last) = (0.0, 0.0, Trust::default(), None);
    (0..900_u32).find_map(|k| {
        let t = DT * f64::from(k);
        vel += acc(t) * DT;
        pos += vel * DT;
        let flown = Odometry { pos_world: Vec3::x() * pos, vel_world: Vec3::x() * vel, ..good(k) };
        let new = bad(t, in_steps(flown));
        let acc = Vec3::x() * acc(t);
        let last = last.replace(new)?;
        step(&mut trust, [&last, &new], acc, acc, Vec3::zeros()).map(|fault| (fault, t))
    })
}

#[test]
fn an_estimate_told_in_coarse_steps_is_believed_and_one_that_stands_is_found_once_it_should_not() {
    assert_eq!(flown_in_steps(4.0, |_, told| told), None);
    let still = |t: f64, told: Odometry| Odometry {
        vel_world: Vec3::x() * if t > 2.0 { 3.0 } else { told.vel_world.x },
        ..told
    };
    let (fault, at) = flown_in_steps(4.0, still).expect("it does not brake");
    assert!(fault == OdometryFault::Frozen && (4.0..4.4).contains(&at), "{fault:?} {at}");
    let rooted = |t: f64, told: Odometry| Odometry {
        pos_world: Vec3::x() * if t > 2.0 { 4.5 } else { told.pos_world.x },
        ..told
    };
    let (fault, at) = flown_in_steps(4.0, rooted).expect("it does not move");
    assert!(at < 2.4, "{fault:?} {at}");
}

#[test]
fn a_single_jump_is_named_and_believed_and_the_third_in_a_row_is_not() {
    let jumping = |every: u32| {
        move |k: u32| Odometry { pos_world: good(k).pos_world + Vec3::y() * f64::from(k / every), ..good(k) }
    };
    let mut trust = Trust::default();
    assert_eq!(feed(&mut trust, 1..400, jumping(300)), Some((OdometryFault::PositionJumped, 299)));
    assert!(trust.distrust().is_none());
    feed(&mut trust, 1..400, jumping(40));
    assert_eq!(trust.distrust().map(|d| d.fault), Some(OdometryFault::PositionDisagrees));
}

#[test]
fn a_velocity_that_stepped_is_reckoned_on_from_before_the_step() {
    let estimate = |k| if k < 100 { good(k) } else { Odometry { vel_world: Vec3::new(4.0, 3.0, 0.0), ..good(k) } };
    let mut trust = Trust::default();
    feed(&mut trust, 1..102, estimate);
    let vel_world = trust.distrust().and_then(|d| d.vel_world).unwrap();
    assert!((vel_world - Vec3::x() * 4.0).norm() < 0.1, "{vel_world}");
}

#[test]
fn a_glitch_is_believed_again_after_all_checks_have_held_for_their_time() {
    let glitch = |k: u32| {
        let by = if (100..110).contains(&k) { Vec3::y() * 3.0 } else { Vec3::zeros() };
        Odometry { vel_world: good(k).vel_world + by, ..good(k) }
    };
    let mut trust = Trust::default();
    feed(&mut trust, 1..155, glitch);
    assert!(trust.distrust().is_some(), "not at once");
    feed(&mut trust, 155..250, glitch);
    assert!(trust.distrust().is_none());
}

#[test]
fn an_attitude_that_turned_is_believed_again_only_if_it_turns_back() {
    for back in [false, true] {
        let turned = |k: u32| {
            let yaw = if (100..120).contains(&k) || (k >= 100 && !back) { 2.0 } else { 0.0 };
            Odometry { world_from_body: Rot::from_axis_angle(&Vec3::z_axis(), yaw), ..good(k) }
        };
        let mut trust = Trust::default();
        feed(&mut trust, 1..400, turned);
        assert_eq!(trust.distrust().is_none(), back);
        let vel_world = trust.distrust().map(|d| d.vel_world.unwrap());
        assert!(vel_world.is_none_or(|vel| (vel - Vec3::x() * 4.0).norm() < 0.1), "the rates say how it leans");
    }
}

/// Steps with accelerations of model and of what is commanded; the disturbance is `drag`.
fn step(
    trust: &mut Trust,
    [last, new]: [&Odometry; 2],
    acc_model: Vec3,
    acc_followed: Vec3,
    drag: Vec3,
) -> Option<OdometryFault> {
    trust.step(&Step { last, new, dt: DT, acc_model, acc_followed, disturbance: drag, free: true, jumped: false })
}

#[test]
fn a_velocity_that_stands_still_is_reckoned_on_from_before_it_stood() {
    let mut trust = Trust::default();
    feed(&mut trust, 1..100, good);
    let braking = -Vec3::x() * 3.0;
    for k in 100..140 {
        let still = |k| Odometry { vel_world: good(99).vel_world, ..good(k) };
        // What the disturbance would be if the velocity were believed.
        step(&mut trust, [&still(k - 1), &still(k)], braking, Vec3::zeros(), -braking);
    }
    let vel_world = trust.distrust().and_then(|d| d.vel_world).unwrap();
    assert!((vel_world.x - 2.8).abs() < 0.1, "{vel_world}");
}

#[test]
fn an_estimate_that_stands_still_is_reckoned_on_by_what_is_commanded_and_the_doubt_grows() {
    let mut trust = Trust::default();
    feed(&mut trust, 1..100, good);
    let dead = |k| Odometry { stamp: good(k).stamp, ..good(99) };
    for k in 100..150 {
        step(&mut trust, [&dead(k - 1), &dead(k)], Vec3::y() * 9.0, -Vec3::x() * 4.0, Vec3::zeros());
    }
    let distrust = trust.distrust().unwrap();
    let vel_world = distrust.vel_world.unwrap();
    assert!((vel_world - Vec3::x() * 2.0).norm() < 0.15, "{vel_world}");
    assert!(distrust.attitude_stands && (0.6..0.9).contains(&distrust.doubt), "{}", distrust.doubt);
    assert!(distrust.moving(0.5).is_some() && distrust.moving(2.5).is_none());
}

#[test]
fn a_loop_that_flies_by_the_true_heading_is_found_to() {
    for own in [false, true] {
        let mut trust = Trust::default();
        let turned = |k: u32| {
            let yaw = if k >= 100 { std::f64::consts::PI } else { 0.0 };
            Odometry { world_from_body: Rot::from_axis_angle(&Vec3::z_axis(), yaw), ..good(k) }
        };
        feed(&mut trust, 1..101, turned);
        let away = trust.distrust().unwrap().loop_from_world() * Vec3::x();
        assert!(away.x < -0.99, "at first it is taken for the estimate's");
        for k in 101..200 {
            let commanded = Vec3::x() * 3.0;
            let told = if own { -commanded } else { commanded };
            step(&mut trust, [&turned(k - 1), &turned(k)], told, commanded, Vec3::zeros());
        }
        let away = trust.distrust().unwrap().loop_from_world() * Vec3::x();
        assert_eq!(away.x > 0.0, own);
    }
}

proptest! {
    #[test]
    fn whatever_it_is_given_the_doubt_is_a_number_and_the_reckoned_velocity_too(
        samples in prop::collection::vec((prop::array::uniform3(-1e3..1e3f64), prop::array::uniform3(-1e3..1e3f64), -3.0..3.0f64), 2..60)
    ) {
        let mut trust = Trust::default();
        let estimate = |k: u32| {
            let (pos, vel, yaw) = samples[k as usize];
            let world_from_body = Rot::from_axis_angle(&Vec3::z_axis(), yaw);
            Odometry { pos_world: Vec3::from(pos), vel_world: Vec3::from(vel), world_from_body, ..good(k) }
        };
        feed(&mut trust, 1..samples.len() as u32, estimate);
        prop_assert!(trust.doubt().is_finite());
        prop_assert!(trust.distrust().is_none_or(|d| d.vel_world.is_none_or(|v| v.iter().all(|x| x.is_finite()))));
    }
}
