use super::apart::Apart;
use super::scan::{Scan, Thing};
use super::*;
use crate::planning::nearest::{COLUMNS, ROWS};
use crate::shipped;
use proptest::prelude::*;

/// What a camera in the origin sees new of a post of 0.2 m that stands at `at`: its near side, 1.2 m of it.
fn see(emerging: &mut Emerging, time: f64, at: Flat) {
    let mut new = Fresh::new(256);
    for (k, z) in [-0.6, -0.2, 0.2, 0.6].iter().enumerate() {
        let side = Flat::new(-0.15, 0.1 * (k as f64 - 1.5));
        let place = at + side;
        let cell = [place.x, place.y].map(|x| (x / 0.2 + 64.0) as u8);
        new.push(cell, Vec3::new(place.x, place.y, *z));
    }
    emerging.step(Time::from_secs(time), &Vec3::zeros(), &mut new, &|_| false);
}

/// Seen at 30 Hz for so many frames, from (5, -1) at `vel`.
fn emerging(vel: Flat, frames: u32) -> Emerging {
    let mut emerging = Emerging::new(shipped::tuning().planner.movers);
    for k in 0..frames {
        let time = f64::from(k) / 30.0;
        see(&mut emerging, 1.0 + time, Flat::new(5.0, -1.0) + vel * time);
    }
    emerging
}

#[test]
fn what_goes_a_way_of_its_own_is_known_with_its_velocity_within_half_a_second() {
    let vel = Flat::new(-0.5, 1.2);
    let mover = emerging(vel, 15).movers(1.5).next().expect("it moves");
    assert!((mover.vel_world.xy() - vel).norm() < 0.35, "{}", mover.vel_world);
    let at = Flat::new(5.0, -1.0) + vel * (14.0 / 30.0);
    assert!((mover.pos_world.xy() - at).norm() < 0.25 && mover.pos_world.z == 1.5, "{}", mover.pos_world);
}

#[test]
fn what_stands_is_none() {
    assert_eq!(emerging(Flat::zeros(), 60).movers(0.0).next(), None);
}

#[test]
fn out_of_sight_it_fades_is_in_doubt_and_is_forgotten() {
    let mut emerging = emerging(Flat::new(0.0, 1.2), 15);
    let mut step = |from: u32, to: u32| {
        for k in from..to {
            let stamp = Time::from_secs(1.0 + f64::from(k) / 30.0);
            emerging.step(stamp, &Vec3::zeros(), &mut Fresh::new(1), &|_| false);
        }
        emerging.movers(0.0).next()
    };
    let late = step(15, 75).expect("2 s later it is still about");
    assert!(late.vel_world.norm() < 0.3 && late.pos_doubt > 0.7, "{late:?}");
    assert_eq!(step(75, 120), None);
}

#[test]
fn where_one_looks_through_it_is_gone() {
    let mut emerging = emerging(Flat::new(0.0, 1.2), 15);
    for k in 15..24 {
        let stamp = Time::from_secs(1.0 + f64::from(k) / 30.0);
        emerging.step(stamp, &Vec3::zeros(), &mut Fresh::new(1), &|_| true);
    }
    assert_eq!(emerging.movers(0.0).next(), None);
}

#[test]
fn who_crosses_the_way_costs_the_more_the_sooner_and_who_has_passed_nothing() {
    let stamp = Time::from_secs(1.0);
    let mover = |at: f64, vel: f64| {
        let mut movers: Movers = [None; MOST];
        movers[3] = Some(Mover {
            stamp,
            pos_world: Vec3::new(4.0, at, 1.0),
            vel_world: Vec3::y() * vel,
            radius: 0.3,
            pos_doubt: 0.0,
        });
        movers
    };
    let cost = |movers: &Movers, speed: f64| meeting(movers, 0.5, stamp, &|time| Vec3::x() * (speed * time), 3.0);
    let [late, soon] = [cost(&mover(-2.0, 1.0), 2.1), cost(&mover(-1.0, 1.0), 4.0)];
    assert!(late > 0.0 && soon > 2.0 * late, "{late} {soon}");
    assert_eq!(cost(&mover(2.0, 1.5), 4.0), 0.0, "it goes away from the way");
}

/// An upright post: its axis, and its radius, m.
type Post = (Flat, f64);

/// What a level camera at `cam`, which looks along x, sees of posts from 2 m below to 1.2 m above it, before a wall 18 m
/// ahead. `noise`: the depth's standard deviation at 1 m, which grows with the square.
fn image(cam: &Flat, posts: &[Post], noise: f64, mut normal: impl FnMut() -> f64) -> Nearest {
    let (wide, high) = (1.0, 31_f64.to_radians().tan());
    let mut nearest = [0; COLUMNS * ROWS];
    for (k, mm) in nearest.iter_mut().enumerate() {
        let middle = |k: usize, n: usize, half: f64| (1.0 - (2 * k + 1) as f64 / n as f64) * half;
        let (side, up) = (middle(k % COLUMNS, COLUMNS, wide), middle(k / COLUMNS, ROWS, high));
        let met = |(axis, radius): &Post| {
            let (at, ray) = (axis - cam, Flat::new(1.0, side));
            let (a, b) = (ray.norm_squared(), at.dot(&ray));
            let root = b * b - a * (at.norm_squared() - radius * radius);
            let depth = (b - root.max(0.0).sqrt()) / a;
            (root > 0.0 && depth > 0.3 && (-2.0..1.2).contains(&(up * depth))).then_some(depth)
        };
        let depth = posts.iter().filter_map(met).fold(18.0, f64::min);
        *mm = ((depth + noise * depth * depth * normal()) * 1e3) as u16;
    }
    nearest
}

fn things(nearest: &Nearest) -> Vec<Thing> {
    let mut scan = Scan::new(90_f64.to_radians(), 62_f64.to_radians());
    scan.see((&Vec3::zeros(), &Rot::identity()), nearest);
    scan.things().collect()
}

#[test]
fn what_lies_apart_is_a_thing_at_its_place_and_one_that_is_partly_hidden_or_leaves_is_not_whole() {
    let level = |posts: &[Post]| image(&Flat::zeros(), posts, 0.0, || 0.0);
    let far = (Flat::new(8.0, 2.0), 0.2);
    let [thing] = things(&level(&[far]))[..] else { panic!("there is one") };
    assert!((thing.surface - far.0).norm() < 0.3 && (thing.half - 0.2).abs() < 0.1 && thing.whole, "{thing:?}");
    let [seen, before] = things(&level(&[far, (Flat::new(4.0, 0.75), 0.2)]))[..] else { panic!("there are two") };
    assert!(!seen.whole && before.whole, "{seen:?} {before:?}");
    assert_eq!(things(&[5000; COLUMNS * ROWS]), [], "a wall is none");
    let mut leaves = level(&[far]);
    leaves.iter_mut().enumerate().filter(|(k, _)| (k / COLUMNS).is_multiple_of(2)).for_each(|(_, mm)| *mm = 18_000);
    assert!(things(&leaves).iter().all(|thing| !thing.whole), "one sees through them");
}

/// Flies at `vel` toward posts of which the first goes at `walks`, for so many frames of 30 a second; the first frame in
/// which anything moves, the distance to the first post then, and what moves at the end. Everywhere one had looked
/// through, if `known`.
fn approach(vel: f64, walks: Flat, posts: &[Post], frames: u32, known: bool) -> (Option<(u32, f64)>, Vec<Mover>) {
    let mut scan = Scan::new(90_f64.to_radians(), 62_f64.to_radians());
    let mut apart = Apart::new(shipped::tuning().planner.movers);
    // A normal number as the sum of twelve of a simple generator.
    let mut seed = 7_u32;
    let mut uniform = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24)
    };
    let mut first = None;
    for frame in 0..frames {
        let time = f64::from(frame) / 30.0;
        let (stamp, cam) = (Time::from_secs(1.0 + time), Vec3::new(vel * time, 0.02 * (9.0 * time).sin(), 0.0));
        let mut now = posts.to_vec();
        now[0].0 += walks * time;
        let nearest = image(&cam.xy(), &now, 0.002, || (0..12).map(|_| uniform()).sum::<f64>() - 6.0);
        apart.advance(stamp, &|_| false);
        scan.see((&cam, &Rot::identity()), &nearest);
        for thing in scan.things() {
            apart.see(stamp, &cam.xy(), &thing, |_| known, |at| scan.is_through(at));
        }
        if first.is_none() && apart.movers(0.0).next().is_some() {
            first = Some((frame, (now[0].0 - cam.xy()).norm()));
        }
    }
    (first, apart.movers(0.0).collect())
}

#[test]
fn who_walks_is_known_from_afar_by_a_vehicle_that_comes_at_it() {
    let walks = Flat::new(-0.2, 1.2);
    let (known, movers) = approach(8.0, walks, &[(Flat::new(13.0, -1.0), 0.14)], 30, true);
    let (frame, distance) = known.expect("it moves");
    assert!(frame < 24 && distance > 6.5, "in frame {frame}, {distance} m away");
    let [mover] = movers[..] else { panic!("it is one: {movers:?}") };
    assert!((mover.vel_world.xy() - walks).norm() < 0.5, "{}", mover.vel_world);
    assert!((mover.pos_world.xy() - Flat::new(13.0, -1.0) - walks * (29.0 / 30.0)).norm() < 0.3, "{}", mover.pos_world);
}

#[test]
fn who_comes_out_of_where_nobody_had_looked_is_known_by_the_place_that_it_left() {
    let walks = Flat::new(-0.2, -1.2);
    let (known, movers) = approach(4.0, walks, &[(Flat::new(8.5, 2.0), 0.25)], 30, false);
    let (frame, distance) = known.expect("it moves");
    assert!(frame < 24 && distance > 4.0, "in frame {frame}, {distance} m away");
    assert!(movers.len() == 1 && (movers[0].vel_world.xy() - walks).norm() < 0.4, "{movers:?}");
}

#[test]
fn who_walks_slowly_is_known_before_a_vehicle_that_comes_at_it_is_there_and_a_twig_is_not() {
    let (walks, at) = (Flat::new(-0.2, 0.55), Flat::new(9.0, -0.6));
    let (known, _) = approach(5.0, walks, &[(at, 0.2)], 45, true);
    let (frame, distance) = known.expect("it moves");
    assert!(distance > 4.0, "in frame {frame}, {distance} m away");
    assert_eq!(approach(5.0, walks, &[(at, 0.05)], 45, true).0, None);
}

#[test]
fn one_looks_through_what_is_before_something_and_not_through_what_is_beside_or_behind_it() {
    let mut scan = Scan::new(90_f64.to_radians(), 62_f64.to_radians());
    let post = (Flat::new(6.0, 1.0), 0.2);
    scan.see((&Vec3::zeros(), &Rot::identity()), &image(&Flat::zeros(), &[post], 0.0, || 0.0));
    for (at, through) in [
        (Flat::new(3.0, 0.5), true),
        (Flat::new(6.0, 2.0), true),
        (Flat::new(8.0, 1.33), false),
        (Flat::new(6.0, 1.0), false),
        (Flat::new(5.4, 0.9), false),
        (Flat::new(1.0, 3.0), false),
        (Flat::new(-3.0, 0.0), false),
    ] {
        assert_eq!(scan.is_through(&at), through, "{at}");
    }
}

#[test]
fn what_stands_does_not_move_however_fast_one_flies_past() {
    let trunks: Vec<Post> =
        (0..24).map(|k| (Flat::new(4.0 + 1.7 * f64::from(k), 7.0 * (f64::from(k) * 2.4).sin()), 0.15)).collect();
    for vel in [0.0, 4.0, 10.0] {
        for known in [true, false] {
            let (first, _) = approach(vel, Flat::zeros(), &trunks, 90, known);
            assert_eq!(first, None, "at {vel} m/s, looked through: {known}");
        }
    }
}

proptest! {
    #[test]
    fn whatever_comes_nothing_panics(
        points in prop::collection::vec((any::<[u8; 2]>(), prop::array::uniform3(prop::num::f64::ANY)), 0..64),
        times in prop::collection::vec(-1e9..1e9f64, 1..6), at in prop::array::uniform3(prop::num::f64::ANY),
        turn in prop::array::uniform3(-7.0..7.0f64), depths in prop::collection::vec(any::<u16>(), 1..40)
    ) {
        let mut followed = Followed::new(1.6, 1.1, shipped::tuning().planner.movers);
        let nearest: Nearest = std::array::from_fn(|k| depths[k % depths.len()]);
        let (cam, world_from_cam) = (Vec3::from(at), Rot::from_scaled_axis(Vec3::from(turn)));
        for time in times {
            let mut new = Fresh::new(64);
            points.iter().for_each(|(cell, at)| new.push(*cell, Vec3::from(*at)));
            let seen = (&nearest, &mut new);
            followed.step(Time::from_secs(time), (&cam, &world_from_cam), seen, |_| false, |_| false, |_| true);
            let cost = meeting(&followed.movers(0.0), 0.5, Time::from_secs(time), &|_| cam, 2.0);
            prop_assert!((0.0..=1.0).contains(&cost));
        }
    }
}
