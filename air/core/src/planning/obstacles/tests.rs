use super::*;
use crate::planning::nearest::COLUMNS;
use crate::planning::room::HEADINGS;
use crate::shipped;
use crate::values::quintic::Quintic;
use crate::values::types::FlatState;
use proptest::prelude::*;

const AHEAD: usize = COLUMNS * ROWS / 2 + COLUMNS / 2;

fn obstacles() -> Obstacles {
    remembering(6.0)
}

fn remembering(range: f64) -> Obstacles {
    let how = shipped::tuning().planner;
    Obstacles::new(90_f64.to_radians(), 62_f64.to_radians(), range, &how.obstacles, how.movers)
}

fn see(obstacles: &mut Obstacles, from: Vec3, nearest: &Nearest) {
    obstacles.see(Time::from_secs(1.0), (&from, &Rot::identity()), nearest, None);
}

/// All blocks at 9 m, but the one right of and below the middle.
fn thing_at(mm: u16) -> Nearest {
    let mut nearest = [9000; COLUMNS * ROWS];
    nearest[AHEAD] = mm;
    nearest
}

/// Straight ahead from `from`, `length` m in `duration` s.
fn ahead(from: Vec3, length: f64, duration: f64) -> Quintic {
    let vel = Vec3::x() * (length / duration);
    let start = FlatState { pos: from, vel, acc: Vec3::zeros() };
    Quintic::new(&start, &FlatState { pos: from + Vec3::x() * length, ..start }, duration)
}

#[test]
fn what_was_seen_in_two_frames_costs_the_more_the_sooner_it_is_met() {
    let mut obstacles = obstacles();
    see(&mut obstacles, Vec3::zeros(), &thing_at(4000));
    assert_eq!(obstacles.meeting(&ahead(Vec3::zeros(), 6.0, 2.0), None), 0.0, "a stray pixel");
    see(&mut obstacles, Vec3::zeros(), &thing_at(4000));
    let [slow, fast] = [2.0, 1.0].map(|duration| obstacles.meeting(&ahead(Vec3::zeros(), 6.0, duration), None));
    assert!(slow > 0.0 && fast > 1.5 * slow, "{slow} {fast}");
    assert_eq!(obstacles.meeting(&ahead(Vec3::y(), 6.0, 1.0), None), 0.0, "beside it");
    assert_eq!(obstacles.meeting(&ahead(Vec3::zeros(), 3.0, 1.0), None), 0.0, "short of it");
    assert_eq!(obstacles.meeting(&ahead(Vec3::zeros(), 40.0, 30.0), None), 0.0, "long after");
}

#[test]
fn it_is_remembered_while_it_is_not_measured_and_forgotten_once_it_is_looked_through() {
    let mut obstacles = obstacles();
    let way = ahead(Vec3::zeros(), 6.0, 1.0);
    (0..4).for_each(|_| see(&mut obstacles, Vec3::zeros(), &thing_at(4000)));
    (0..30).for_each(|_| see(&mut obstacles, Vec3::zeros(), &[0; COLUMNS * ROWS]));
    assert!(obstacles.meeting(&way, None) > 0.0, "holes look through nothing");
    (0..10).for_each(|_| see(&mut obstacles, Vec3::zeros(), &thing_at(9000)));
    assert_eq!(obstacles.meeting(&way, None), 0.0);
}

#[test]
fn who_is_beside_something_may_leave_and_not_come_nearer() {
    let mut obstacles = obstacles();
    (0..4).for_each(|_| see(&mut obstacles, Vec3::zeros(), &thing_at(1000)));
    let beside = Vec3::x() * 0.85;
    let meeting = |by: Vec3| {
        let start = FlatState { pos: beside, ..FlatState::default() };
        obstacles.meeting(&Quintic::new(&start, &FlatState { pos: beside + by, ..start }, 1.0), None)
    };
    assert!(meeting(Vec3::x()) > 0.2);
    for leaves in [Vec3::x() * -2.0, Vec3::y() * 2.0, Vec3::zeros()] {
        assert_eq!(meeting(leaves), 0.0, "{leaves}");
    }
    let around = |time: f64| beside + Vec3::x() * if time < 0.5 { -2.0 * time } else { 2.0 * time - 2.0 };
    assert!(obstacles.meeting_on(&around, 1.0, None) > 0.0, "having left it, it comes back");
}

#[test]
fn there_is_room_up_to_a_thin_thing() {
    let mut obstacles = obstacles();
    (0..4).for_each(|_| see(&mut obstacles, Vec3::zeros(), &thing_at(4000)));
    let room = |x: f64| obstacles.room(&Vec3::new(x, 0.0, 0.0));
    for (x, left) in [(1.0, 2.7), (2.9, 0.8), (3.4, 0.3)] {
        assert!((room(x)[0] - left).abs() < 0.25, "{x} {}", room(x)[0]);
    }
    assert_eq!(room(1.0)[HEADINGS / 4], FARTHEST_ROOM, "beside");
    assert_eq!(room(90.0), [FARTHEST_ROOM; HEADINGS], "outside of the grid");
}

#[test]
fn a_branch_that_every_third_image_misses_stays() {
    let mut obstacles = obstacles();
    for frame in 0..30 {
        see(&mut obstacles, Vec3::zeros(), &thing_at(if frame % 3 == 2 { 9000 } else { 4000 }));
    }
    assert!(obstacles.meeting(&ahead(Vec3::zeros(), 6.0, 1.0), None) > 0.0);
}

#[test]
fn the_target_is_no_obstacle() {
    let mut obstacles = obstacles();
    let ignored = Ignored { at_world: Vec3::new(4.0, 0.0, 1.0), radius: 0.8 };
    let way = ahead(Vec3::zeros(), 6.0, 1.0);
    (0..4).for_each(|_| {
        obstacles.see(Time::from_secs(1.0), (&Vec3::zeros(), &Rot::identity()), &thing_at(4000), Some(&ignored));
    });
    assert_eq!(obstacles.meeting(&way, None), 0.0);
    (0..4).for_each(|_| see(&mut obstacles, Vec3::zeros(), &thing_at(4000)));
    assert!(obstacles.meeting(&way, None) > 0.0 && obstacles.meeting(&way, Some(&ignored)) == 0.0);
}

#[test]
fn it_stays_where_it_is_while_the_vehicle_flies_and_goes_when_it_is_far_behind() {
    let mut obstacles = obstacles();
    (0..4).for_each(|_| see(&mut obstacles, Vec3::new(0.0, 0.0, 30.0), &thing_at(4000)));
    let back = |x: f64| ahead(Vec3::new(x, 0.0, 30.0), -4.0, 1.0);
    for step in 1..=20 {
        let at = Vec3::new(0.5 * f64::from(step), 0.0, 30.0);
        see(&mut obstacles, at, &[0; COLUMNS * ROWS]);
    }
    assert!(obstacles.meeting(&back(7.0), None) > 0.0, "6 m behind the vehicle");
    see(&mut obstacles, Vec3::new(90.0, 0.0, 30.0), &[0; COLUMNS * ROWS]);
    see(&mut obstacles, Vec3::new(7.0, 0.0, 30.0), &[0; COLUMNS * ROWS]);
    assert_eq!(obstacles.meeting(&back(7.0), None), 0.0);
}

#[test]
fn what_is_remembered_is_told_where_it_stands_wherever_the_grid_has_rolled() {
    for x in [0.0, 11.3, -260.7] {
        let (mut obstacles, lens) = (obstacles(), Vec3::new(x, 2.0, 30.0));
        (0..4).for_each(|_| see(&mut obstacles, lens, &thing_at(4000)));
        let mut cells = Vec::new();
        let origin = obstacles.remembered(&mut cells).unwrap();
        assert!(!cells.is_empty());
        for cell in &cells {
            let centre = origin + Vec3::from(cell.map(|k| (f64::from(k) + 0.5) * VOXEL));
            assert!((centre.x - lens.x - 4.0).abs() < 0.5 && (centre.yz() - lens.yz()).norm() < 1.5, "{centre}");
        }
    }
}

#[test]
fn with_a_range_of_zero_nothing_is_remembered() {
    let mut none = remembering(0.0);
    (0..4).for_each(|_| see(&mut none, Vec3::zeros(), &thing_at(1000)));
    assert_eq!(none.meeting(&ahead(Vec3::zeros(), 6.0, 1.0), None), 0.0);
}

proptest! {
    #[test]
    fn whatever_comes_nothing_panics(
        at in prop::array::uniform3(prop::num::f64::ANY), to in prop::array::uniform3(prop::num::f64::ANY),
        mm in prop::num::u16::ANY, frames in 1..4
    ) {
        let mut obstacles = obstacles();
        (0..frames).for_each(|_| see(&mut obstacles, Vec3::from(at), &[mm; COLUMNS * ROWS]));
        let start = FlatState { pos: Vec3::from(at), ..FlatState::default() };
        let end = FlatState { pos: Vec3::from(to), ..FlatState::default() };
        let cost = obstacles.meeting(&Quintic::new(&start, &end, 1.0), None);
        prop_assert!((0.0..=1.0).contains(&cost));
    }
}

#[test]
fn what_is_beside_or_behind_the_image_is_not_watched() {
    let mut obstacles = obstacles();
    see(&mut obstacles, Vec3::x(), &thing_at(4000));
    for (watched, at) in [(true, [4.0, 2.0]), (true, [1.0, 0.3]), (false, [3.0, 2.5]), (false, [-1.0, 0.0])] {
        assert_eq!(obstacles.is_watched(&Vec3::new(at[0], at[1], 0.2)), watched, "{at:?}");
    }
}
