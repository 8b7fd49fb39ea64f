//! Facts about lockstep flights, flown with networks that are written by hand.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use common::{Constant, config, contract, fly, forgetful_vehicle, sectors, vehicle};
use goshawk_core::{Cause, Mode, Task};
use goshawk_sim::actors::evader::Course;
use goshawk_sim::actors::moving::{Body, Flat, Mover};
use goshawk_sim::commands::fly::{Campaign, MakeNetwork};
use goshawk_sim::pilots::{fly_in, fly_trial};
use goshawk_sim::sense::file::Sensors;
use goshawk_sim::trial::{
    CloudFile, Contact, Difference, EvaderKind, Flight, Network, Outcome, PilotKind, TrialConfig, TrialError,
    Unwatched, WorldSource,
};
use goshawk_sim::world::cloud::{self, Point};
use std::path::Path;
use std::sync::Arc;

#[test]
fn a_navigation_by_depth_reaches_its_goal() {
    let flights: Vec<Flight> =
        (0..4).map(|seed| fly(&config(Task::Navigate, 3.0, 7.0, seed), &mut sectors(false))).collect();
    let reached = flights.iter().filter(|f| f.reached).count();
    assert!(reached >= 3, "{:?}", flights.iter().map(|f| (f.outcome, f.contact, f.end_world)).collect::<Vec<_>>());
    for flight in flights.iter().filter(|f| f.reached) {
        assert!(flight.end_distance_m <= 2.0 && flight.metrics.way_m > 36.0, "{flight:?}");
        assert!(flight.metrics.clearance_m.unwrap() > 0.0);
        // This network dawdles: its goal is reached, and that is no success.
        assert!(flight.metrics.cruise_mps().unwrap() < 0.6 * 3.0);
        assert_eq!(flight.outcome, Outcome::Slow);
        let modes: Vec<Mode> = flight.modes.iter().map(|m| m.1).collect();
        assert_eq!(modes[..2], [Mode::Takeoff, Mode::Navigate], "{modes:?}");
    }
}

#[test]
fn in_a_scanned_world_the_goal_is_reached_whichever_way_the_flight_begins() {
    let step = |n: i32, m: f64| (0..n).map(move |i| m * f64::from(i) + 0.05);
    let floor = step(300, 0.2).flat_map(|x| step(300, 0.2).map(move |y| [x, y, 0.0]));
    let posts = step(8, 8.0).flat_map(|x| step(8, 8.0).flat_map(move |y| step(40, 0.1).map(move |z| [x, y, z])));
    let points: Vec<Point> = floor.chain(posts).map(|at| Point { at, rgb: None }).collect();
    let world = Arc::new(cloud::world(&points, Path::new("posts.ply")).unwrap());
    let flights: Vec<Flight> = (0..4)
        .map(|seed| {
            let file = CloudFile { name: "posts.ply".to_owned(), sha256: String::new() };
            let world = WorldSource::Cloud(Arc::clone(&world), file);
            fly(&TrialConfig { world, ..config(Task::Navigate, 3.0, 0.0, seed) }, &mut sectors(false))
        })
        .collect();
    let ends: Vec<_> = flights.iter().map(|f| (f.outcome, f.contact, f.end_world)).collect();
    assert!(flights.iter().filter(|f| f.reached).count() >= 3, "{ends:?}");
}

#[test]
fn what_is_hit_in_the_take_off_counts_and_the_ground_does_not() {
    let step = |n: i32, m: f64| (0..n).map(move |i| m * f64::from(i) + 0.05);
    let level = |z: f64| step(300, 0.1).flat_map(move |x| step(300, 0.1).map(move |y| [x, y, z]));
    let points: Vec<Point> = level(0.0).chain(level(4.2)).map(|at| Point { at, rgb: None }).collect();
    let file = CloudFile { name: "hall.ply".to_owned(), sha256: String::new() };
    let world = WorldSource::Cloud(Arc::new(cloud::world(&points, Path::new("hall.ply")).unwrap()), file);
    let flown = |height_m: f64| {
        let config = config(Task::Navigate, 3.0, 0.0, 2);
        let config = TrialConfig { world: world.clone(), height_m, length_m: 8.0, ..config };
        fly(&config, &mut Constant(contract("navigate"), f32::NAN))
    };
    let (through, below) = (flown(5.0), flown(1.2));
    assert_eq!((through.outcome, through.contact), (Outcome::Collision, Some(Contact::Scan)), "{through:?}");
    assert!(through.modes.iter().all(|m| m.1 == Mode::Takeoff), "{through:?}");
    assert!(below.contact.is_none() && below.modes.iter().any(|m| m.1 == Mode::Navigate), "{below:?}");
}

#[test]
fn a_high_take_off_has_the_time_that_its_climb_takes() {
    let config = TrialConfig { height_m: 27.0, ..config(Task::Navigate, 3.0, 0.0, 1) };
    let world = WorldSource::Forest { spacing_m: 9.0 };
    let flight = fly(&TrialConfig { world, ..config }, &mut Constant(contract("navigate"), f32::NAN));
    assert!(flight.modes.iter().any(|m| m.1 == Mode::Navigate), "{flight:?}");
}

#[test]
fn sensors_and_airframe_of_another_kind_are_another_flight_and_none_is_the_same() {
    let plain = config(Task::Navigate, 3.0, 9.0, 2);
    let way = |config: &TrialConfig| fly(config, &mut sectors(false)).metrics.way_m;
    assert_eq!(way(&plain), way(&plain));
    let spread = Difference { spread: 0.1, ..plain.airframe };
    assert_ne!(way(&plain), way(&TrialConfig { airframe: spread, ..plain.clone() }));
    let mut sensors = Sensors::default();
    sensors.odometry.delay_s += 0.05;
    assert_ne!(way(&plain), way(&TrialConfig { sensors, ..plain.clone() }));
}

#[test]
fn a_blind_flight_through_a_dense_forest_ends_at_a_tree_unless_what_was_seen_is_remembered() {
    let ends_at_a_tree =
        |flight: &Flight| matches!(flight.contact, Some(Contact::Trunk | Contact::Branch | Contact::Foliage));
    let mut passed = 0;
    for seed in 1..=5 {
        let config = config(Task::Navigate, 5.0, 3.0, seed);
        passed += usize::from(!ends_at_a_tree(&fly(&config, &mut sectors(true))));
        let flight = fly_trial(&config, &forgetful_vehicle(), Some(&mut sectors(true)), &mut Unwatched).unwrap();
        assert_eq!(flight.outcome, Outcome::Collision, "{seed}: {flight:?}");
        assert!(ends_at_a_tree(&flight), "{seed}: {flight:?}");
        assert!(flight.metrics.clearance_m.unwrap() < 0.1);
    }
    assert!(passed >= 2, "{passed} of 5");
}

#[test]
fn a_tracker_that_sees_nothing_loses_the_evader() {
    let flight = fly(&config(Task::Track, 3.0, 5.0, 1), &mut Constant(contract("track"), -9.0));
    assert_eq!(flight.outcome, Outcome::Lost, "{flight:?}");
    assert_eq!(flight.unseen_s, None);
    assert!(flight.metrics.lateral_m.is_empty());
    assert!(flight.modes.iter().any(|m| m.1 == Mode::Search && m.2 == Cause::HeightReached));
}

#[test]
fn a_network_of_nan_is_no_flight_but_no_panic_either() {
    let flight = fly(&config(Task::Navigate, 4.0, 5.0, 1), &mut Constant(contract("navigate"), f32::NAN));
    assert_eq!(flight.outcome, Outcome::Timeout, "{flight:?}");
}

#[test]
fn wind_and_speed_do_not_change_the_forest() {
    let end = |wind_mps, speed| {
        let config = TrialConfig { wind_mps, ..config(Task::Navigate, speed, 7.0, 3) };
        let scene = goshawk_sim::trial::SceneConfig::of_task(
            config.task,
            config.speed_mps,
            config.world.clone(),
            Course::Goal,
            config.seed,
        );
        goshawk_sim::trial::Scene::new(&scene).unwrap().world.trees().to_vec()
    };
    assert_eq!(end(0.0, 3.0), end(5.0, 8.0));
}

#[test]
fn moving_obstacles_change_nothing_but_what_they_are_met_by() {
    let plain = config(Task::Navigate, 3.0, 7.0, 2);
    let crowded = TrialConfig { moving: 6, ..plain.clone() };
    let mut scene = crowded.scene().unwrap();
    assert_eq!(scene.movers.len(), 6);
    scene.movers.clear();
    let cleared = fly_in(&scene, &crowded, &vehicle(), Some(&mut sectors(false)), &mut Unwatched).unwrap();
    assert_eq!(cleared, fly(&plain, &mut sectors(false)));
}

#[test]
fn a_vehicle_that_hovers_in_a_movers_way_is_hit() {
    let config = config(Task::Navigate, 4.0, 5.0, 1);
    let mut scene = config.scene().unwrap();
    let start = scene.world.start_world().xy();
    let mover = Mover {
        middle: start,
        reach: Flat::new(0.0, 2.0),
        speed_mps: 1.0,
        body: Body::Post { radius_m: 0.15 },
        height_m: 2.4,
        tint: [0.5; 3],
    };
    scene.movers.push(mover);
    let mut hover = Constant(contract("navigate"), f32::NAN);
    let flight = fly_in(&scene, &config, &vehicle(), Some(&mut hover), &mut Unwatched).unwrap();
    assert_eq!((flight.outcome, flight.contact), (Outcome::Collision, Some(Contact::Moving)), "{flight:?}");
    // A quarter of its swing, less what the two are wide: it stood until the vehicle was up.
    let quarter_s = std::f64::consts::FRAC_PI_2 * 2.0;
    assert!((quarter_s - 1.0..quarter_s).contains(&flight.metrics.task_s), "{flight:?}");
    assert!(flight.metrics.clearance_m.unwrap() < 0.01);
}

#[test]
fn a_reactive_evader_runs_another_way_than_a_planned_one_and_always_the_same() {
    let config = config(Task::Track, 4.0, 6.0, 2);
    let reactive = TrialConfig { evader: EvaderKind::Reactive, ..config.clone() };
    let chase = |config: &TrialConfig| fly(config, &mut Constant(contract("track"), -9.0));
    let (one, planned) = (chase(&reactive), chase(&config));
    assert_eq!(one, chase(&reactive));
    assert_ne!(one.metrics.distance_sum_m, planned.metrics.distance_sum_m);
}

#[test]
fn a_campaign_is_the_same_for_any_number_of_threads() {
    let run = |threads, moving| {
        let campaign = Campaign {
            pilots: vec![PilotKind::Policy],
            task: Task::Navigate,
            speeds_mps: vec![3.0, 5.0],
            worlds: vec![WorldSource::Forest { spacing_m: 7.0 }],
            evader: EvaderKind::Planned,
            courses: vec![Course::Goal],
            length_m: 40.0,
            trials: 2,
            seed: 5,
            wind_mps: 3.0,
            speed_margin_mps: 3.0,
            height_m: 1.5,
            sensors: Sensors::default(),
            airframe: Difference::default(),
            moving,
            fault: None,
            firmware: None,
            threads,
            only: None,
            traced: false,
            log: None,
        };
        let make: &MakeNetwork<'_> = &|| Ok::<_, TrialError>(Some(Box::new(sectors(false)) as Box<dyn Network + Send>));
        let report = campaign.run(&vehicle(), make, &|_| {}).unwrap();
        serde_json::to_string(&report.cells).unwrap()
    };
    let alone = run(1, 0);
    assert_eq!(alone, run(3, 0));
    let crowded = run(1, 12);
    assert_eq!(crowded, run(2, 12));
    assert!(crowded != alone && crowded.contains(r#""moving":12"#));
    assert!(alone.contains(r#""pilot":"policy""#) && alone.contains(r#""trials":2"#));
}
