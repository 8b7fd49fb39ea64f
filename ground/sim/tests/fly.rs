//! Facts about lockstep flights, flown with networks that are written by hand.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

use goshawk_air::config::Vehicle;
use goshawk_core::types::{ANCHORS, MAX_CHANNELS, NetworkOutput, Task};
use goshawk_core::{Cause, Mode};
use goshawk_policy::{Contract, PolicyError};
use goshawk_sim::cloud::{self, Point};
use goshawk_sim::evader::Course;
use goshawk_sim::fly::{Campaign, MakeNetwork};
use goshawk_sim::moving::{Body, Flat, Mover};
use goshawk_sim::sensors::Sensors;
use goshawk_sim::trial::{
    Contact, Flight, Network, Outcome, PilotKind, TrialConfig, TrialError, Unwatched, WorldSource, fly_in, fly_trial,
};
use std::path::Path;
use std::sync::Arc;

fn vehicle() -> Vehicle {
    Vehicle::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../air/vehicles/sim.toml")).unwrap()
}

fn contract(task: &str) -> Contract {
    let channels = if task == "track" { r#","objectness","du","dv","distance""# } else { "" };
    let json = format!(
        r#"{{"version":1,"task":"{task}","image":{{"width":160,"height":96,"hfov_rad":1.5707963,"vfov_rad":1.0808390}},
        "depth":{{"min_m":0.2,"max_m":20.0,"fill_passes":2}},"lattice":{{"rows":3,"columns":5,"radius_m":5.0,
        "elevation_offset_rad":0.2618,"azimuth_offset_rad":0.2618}},"v_max_mps":6.0,"a_max_mps2":6.0,
        "duration_rule":"2r/(alpha*v_max)","target_depth_scale_m":5.0,"state":["velocity","acceleration","up","aim","agility"],
        "channels":["theta","phi","r","vx","vy","vz","ax","ay","az","cost"{channels}],"camera_tilt_rad":0.17,
        "training":{{}}}}"#
    );
    Contract::from_json(&json).unwrap()
}

/// Steers through the widest sector of the depth image towards the goal, at the goal's height.
struct Sectors {
    contract: Contract,
    /// Takes every sector for free.
    blind: bool,
}

fn sectors(blind: bool) -> Sectors {
    Sectors { contract: contract("navigate"), blind }
}

impl Network for Sectors {
    fn contract(&self) -> &Contract {
        &self.contract
    }

    fn infer(&mut self, rgbd: &[f32], state: &[f32]) -> Result<NetworkOutput, PolicyError> {
        let mut values = [0.0f32; MAX_CHANNELS * ANCHORS];
        values[9 * ANCHORS..10 * ANCHORS].fill(50.0);
        let depth = &rgbd[3 * 96 * 160..];
        let (up, aim) = (&state[6..9], &state[9..12]);
        let length = aim.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-6);
        let climb = (aim[0] * up[0] + aim[1] * up[1] + aim[2] * up[2]) / length;
        let aim_azimuth = aim[1].atan2(aim[0]);
        for column in 0..5usize {
            let azimuth = std::f32::consts::FRAC_PI_2 * (0.5 - (column as f32 + 0.5) / 5.0);
            let (left, right) = ((32 * column).saturating_sub(16), (32 * column + 48).min(160));
            let free = (20..70)
                .flat_map(|row| (left..right).map(move |u| row * 160 + u))
                .map(|i| 20.0 * depth[i])
                .fold(20.0f32, f32::min);
            let free = if self.blind { 20.0 } else { free };
            // The elevation in the camera that has the aim's climb in the world.
            let mut elevation = 0.0f32;
            for _ in 0..4 {
                let level = azimuth.cos() * up[0] + azimuth.sin() * up[1];
                let value = elevation.cos() * level + elevation.sin() * up[2] - climb;
                elevation -= value / (elevation.cos() * up[2] - elevation.sin() * level).max(0.3);
            }
            let index = 5 + column;
            let reach = (free - 1.0).clamp(1.0, 6.0);
            values[index] = (elevation / 0.2618).clamp(-0.95, 0.95).atanh();
            values[2 * ANCHORS + index] = ((reach - 5.0) / 5.0).atanh();
            values[3 * ANCHORS + index] = (0.1 * reach * elevation.cos()).atanh();
            values[5 * ANCHORS + index] = (0.1 * reach * elevation.sin()).atanh();
            values[9 * ANCHORS + index] = (azimuth - aim_azimuth).abs() + 3.0 * (4.0 - free).max(0.0);
        }
        Ok(NetworkOutput { values })
    }
}

/// Always the same answer.
struct Constant(Contract, f32);

impl Network for Constant {
    fn contract(&self) -> &Contract {
        &self.0
    }

    fn infer(&mut self, _rgbd: &[f32], _state: &[f32]) -> Result<NetworkOutput, PolicyError> {
        Ok(NetworkOutput { values: [self.1; MAX_CHANNELS * ANCHORS] })
    }
}

fn config(task: Task, speed_mps: f64, spacing_m: f64, seed: u64) -> TrialConfig {
    TrialConfig {
        pilot: PilotKind::Policy,
        task,
        speed_mps,
        speed_margin_mps: 3.0,
        height_m: 1.5,
        world: WorldSource::Forest { spacing_m },
        course: Course::Goal,
        wind_mps: 0.0,
        sensors: Sensors::default(),
        spread: 0.0,
        moving: 0,
        seed,
    }
}

fn fly(config: &TrialConfig, network: &mut dyn Network) -> Flight {
    fly_trial(config, &vehicle(), Some(network), &mut Unwatched).unwrap()
}

#[test]
fn a_navigation_by_depth_reaches_its_goal() {
    let flights: Vec<Flight> =
        (0..4).map(|seed| fly(&config(Task::Navigate, 3.0, 7.0, seed), &mut sectors(false))).collect();
    let reached = flights.iter().filter(|f| f.outcome == Outcome::Success).count();
    assert!(reached >= 3, "{:?}", flights.iter().map(|f| (f.outcome, f.contact, f.end_world)).collect::<Vec<_>>());
    for flight in flights.iter().filter(|f| f.outcome == Outcome::Success) {
        assert!(flight.end_distance_m <= 2.0 && flight.metrics.way_m > 36.0, "{flight:?}");
        assert!(flight.metrics.clearance_m.unwrap() > 0.0);
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
            let world = WorldSource::Cloud(Arc::clone(&world), "posts.ply".to_owned());
            fly(&TrialConfig { world, ..config(Task::Navigate, 3.0, 0.0, seed) }, &mut sectors(false))
        })
        .collect();
    let ends: Vec<_> = flights.iter().map(|f| (f.outcome, f.contact, f.end_world)).collect();
    assert!(flights.iter().filter(|f| f.outcome == Outcome::Success).count() >= 3, "{ends:?}");
}

#[test]
fn sensors_and_airframe_of_another_kind_are_another_flight_and_none_is_the_same() {
    let plain = config(Task::Navigate, 3.0, 9.0, 2);
    let way = |config: &TrialConfig| fly(config, &mut sectors(false)).metrics.way_m;
    assert_eq!(way(&plain), way(&TrialConfig { spread: 0.0, ..plain.clone() }));
    assert_ne!(way(&plain), way(&TrialConfig { spread: 0.1, ..plain.clone() }));
    let mut sensors = Sensors::default();
    sensors.odometry.delay_s += 0.05;
    assert_ne!(way(&plain), way(&TrialConfig { sensors, ..plain.clone() }));
}

#[test]
fn a_blind_flight_through_a_dense_forest_ends_at_a_tree() {
    let flight = fly(&config(Task::Navigate, 6.0, 3.0, 1), &mut sectors(true));
    assert_eq!(flight.outcome, Outcome::Collision, "{flight:?}");
    assert!(matches!(flight.contact, Some(Contact::Trunk | Contact::Branch | Contact::Foliage)), "{flight:?}");
    assert!(flight.metrics.clearance_m.unwrap() < 0.1);
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
fn a_campaign_is_the_same_for_any_number_of_threads() {
    let run = |threads, moving| {
        let campaign = Campaign {
            pilot: PilotKind::Policy,
            task: Task::Navigate,
            speeds_mps: vec![3.0, 5.0],
            worlds: vec![WorldSource::Forest { spacing_m: 7.0 }],
            course: Course::Goal,
            trials: 2,
            seed: 5,
            wind_mps: 3.0,
            speed_margin_mps: 3.0,
            height_m: 1.5,
            sensors: Sensors::default(),
            spread: 0.0,
            moving,
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
