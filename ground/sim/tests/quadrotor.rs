//! Facts about the quadrotor's motion.

use goshawk_core::{AttitudeThrust, GRAVITY, Newtons, NormalisedThrust, Rot, Vec3};
use goshawk_sim::trial::Difference;
use goshawk_sim::vehicle::quadrotor::{Quadrotor, QuadrotorParameters, STEP_S};
use nalgebra::UnitQuaternion;

/// No ground within reach.
fn no_ground(_x: f64, _y: f64) -> f64 {
    -1e6
}

fn flat_ground(_x: f64, _y: f64) -> f64 {
    0.0
}

fn level() -> Rot {
    UnitQuaternion::identity()
}

/// A battery that neither drains nor sags.
fn ideal() -> QuadrotorParameters {
    let mut parameters = QuadrotorParameters::default();
    parameters.battery.discharge_drop = 0.0;
    parameters.battery.load_drop = 0.0;
    parameters
}

fn hover(parameters: &QuadrotorParameters) -> AttitudeThrust {
    AttitudeThrust { world_from_body: level(), thrust: parameters.hover_thrust }
}

fn run(quad: &mut Quadrotor, demand: Option<&AttitudeThrust>, seconds: f64) {
    for _ in 0..(seconds / STEP_S).round() as usize {
        quad.step(STEP_S, demand, Vec3::zeros(), no_ground);
    }
}

#[test]
fn hover_thrust_holds_height_and_attitude() {
    let parameters = ideal();
    let demand = hover(&parameters);
    let mut quad = Quadrotor::new(parameters, Vec3::new(0.0, 0.0, 50.0), 0.3);
    run(&mut quad, Some(&demand), 1.0); // spin up
    quad.set_motion(Vec3::new(0.0, 0.0, 50.0), Vec3::zeros());
    run(&mut quad, Some(&demand), 5.0);
    let after = quad.state();
    assert!(after.acc_world.norm() < 1e-3, "{}", after.acc_world);
    assert!((after.pos_world - Vec3::new(0.0, 0.0, 50.0)).norm() < 1e-2);
    assert!((after.world_from_body.inverse() * level()).angle() < 1e-3);
    assert!(after.ang_vel_body.norm() < 1e-3);
}

#[test]
fn hover_thrust_is_what_the_parameters_say_for_any_curve() {
    for u in [0.3, 0.4, 0.5] {
        let parameters = QuadrotorParameters { hover_thrust: NormalisedThrust(u), ..ideal() };
        assert!((parameters.force(NormalisedThrust(u)).0 - parameters.weight().0).abs() < 1e-9);
        let half = Newtons(0.5 * parameters.max_thrust().0);
        assert!((parameters.force(parameters.normalised(half)).0 - half.0).abs() < 1e-9);
        assert!((parameters.max_thrust().0 / parameters.weight().0 - 4.7).abs() < 1e-12);
    }
}

#[test]
fn disarmed_it_falls_freely() {
    let mut parameters = ideal();
    parameters.rotor_drag_npmps = Vec3::zeros();
    parameters.body_drag_npmps2 = 0.0;
    let mut quad = Quadrotor::new(parameters, Vec3::new(0.0, 0.0, 100.0), 0.0);
    run(&mut quad, None, 2.0);
    assert!((quad.state().vel_world.z + 2.0 * GRAVITY).abs() < 1e-9);
    assert!((quad.state().pos_world.z - (100.0 - 2.0 * GRAVITY)).abs() < 1e-6);
}

#[test]
fn level_thrust_tilted_reaches_the_speed_where_drag_balances_it() {
    let parameters = ideal();
    let tilt: f64 = 0.4;
    let attitude = UnitQuaternion::from_euler_angles(0.0, tilt, 0.0);
    let (linear, quadratic, mass) = (parameters.rotor_drag_npmps, parameters.body_drag_npmps2, parameters.mass_kg);
    let mut quad = Quadrotor::new(parameters.clone(), Vec3::new(0.0, 0.0, 50.0), 0.0);
    // Hold height by the thrust alone.
    for _ in 0..60_000 {
        let s = *quad.state();
        let up = mass * (GRAVITY - 2.0 * s.vel_world.z) / tilt.cos();
        let demand = AttitudeThrust { world_from_body: attitude, thrust: parameters.normalised(Newtons(up)) };
        quad.step(STEP_S, Some(&demand), Vec3::zeros(), no_ground);
    }
    let s = quad.state();
    assert!(s.acc_world.norm() < 1e-2, "{}", s.acc_world);
    // Horizontal balance, from the equations and not from the code: thrust · sin θ = drag.
    let air_body = s.world_from_body.inverse() * s.vel_world;
    let drag_body = linear.component_mul(&air_body) + air_body * (quadratic * air_body.norm());
    let drag_world = s.world_from_body * drag_body;
    let expected = (mass * GRAVITY + drag_world.z) * tilt.tan();
    assert!((drag_world.x - expected).abs() < 0.05, "{} {expected}", drag_world.x);
    assert!((8.0..16.0).contains(&s.vel_world.x), "{}", s.vel_world.x);
}

#[test]
fn falling_it_reaches_a_terminal_speed() {
    let parameters = ideal();
    let mut quad = Quadrotor::new(parameters.clone(), Vec3::new(0.0, 0.0, 5000.0), 0.0);
    run(&mut quad, None, 60.0);
    let v = -quad.state().vel_world.z;
    let drag = parameters.rotor_drag_npmps.z * v + parameters.body_drag_npmps2 * v * v;
    assert!((drag - parameters.weight().0).abs() < 1e-3, "{v}");
}

#[test]
fn full_thrust_climbs_at_what_thrust_to_weight_gives() {
    let parameters = ideal();
    let full = AttitudeThrust { world_from_body: level(), thrust: NormalisedThrust(1.0) };
    let mut quad = Quadrotor::new(parameters, Vec3::new(0.0, 0.0, 10.0), 0.0);
    run(&mut quad, Some(&full), 0.25);
    let s = quad.state();
    assert!((0.9 * 3.7 * GRAVITY..3.7 * GRAVITY).contains(&s.acc_world.z), "{}", s.acc_world.z);
}

#[test]
fn thrust_saturates_at_thrust_to_weight() {
    let parameters = ideal();
    let limit = parameters.max_thrust().0 / parameters.mass_kg;
    for thrust in [1.0, 2.0, 50.0] {
        let wild = AttitudeThrust {
            world_from_body: UnitQuaternion::from_euler_angles(0.5, -0.4, 1.0),
            thrust: NormalisedThrust(thrust),
        };
        let mut quad = Quadrotor::new(parameters.clone(), Vec3::new(0.0, 0.0, 10.0), 0.0);
        for _ in 0..500 {
            quad.step(STEP_S, Some(&wild), Vec3::zeros(), no_ground);
            let specific = quad.state().acc_world + Vec3::new(0.0, 0.0, GRAVITY);
            assert!(specific.norm() <= limit + 0.05 * quad.state().vel_world.norm_squared().max(1.0));
        }
    }
}

/// Time to 63 % and overshoot of a small roll or pitch step at hover.
fn step_response(parameters: &QuadrotorParameters, des: Rot) -> (f64, f64) {
    let mut quad = Quadrotor::new(parameters.clone(), Vec3::new(0.0, 0.0, 500.0), 0.0);
    run(&mut quad, Some(&hover(parameters)), 1.0);
    let demand = AttitudeThrust { world_from_body: des, thrust: parameters.hover_thrust };
    let (mut t63, mut overshoot) = (None, 0.0f64);
    for i in 0..1500 {
        quad.step(STEP_S, Some(&demand), Vec3::zeros(), no_ground);
        let done = 1.0 - (quad.state().world_from_body.inverse() * des).angle() / des.angle();
        let signed = quad.state().world_from_body.scaled_axis().dot(&des.scaled_axis()) / des.angle().powi(2);
        if done >= 0.632 && t63.is_none() {
            t63 = Some(f64::from(i + 1) * STEP_S);
        }
        overshoot = overshoot.max(signed - 1.0);
    }
    assert!((quad.state().world_from_body.inverse() * des).angle() < 0.01 * des.angle());
    (t63.expect("the step is followed"), overshoot)
}

#[test]
fn a_tilt_step_is_followed_like_a_racing_quads() {
    for des in [UnitQuaternion::from_euler_angles(0.26, 0.0, 0.0), UnitQuaternion::from_euler_angles(0.0, -0.5, 0.0)] {
        let (t63, overshoot) = step_response(&ideal(), des);
        assert!((0.06..0.10).contains(&t63), "63 % after {t63} s");
        assert!(overshoot < 0.12, "overshoot {overshoot}");
    }
}

#[test]
fn the_tilt_response_time_can_be_asked_for() {
    for asked in [0.05, 0.07, 0.1, 0.15, 0.26, 0.3] {
        let parameters = Difference { attitude_lag_s: Some(asked), ..Difference::default() }.apply(&ideal(), 1);
        let (t63, _) = step_response(&parameters, UnitQuaternion::from_euler_angles(0.2, 0.0, 0.0));
        assert!((t63 - asked).abs() < 0.15 * asked, "asked {asked}, got {t63}");
    }
}

#[test]
fn yaw_follows_slower_than_tilt_and_settles() {
    let (t63, _) = step_response(&ideal(), UnitQuaternion::from_euler_angles(0.0, 0.0, 0.5));
    assert!((0.12..0.5).contains(&t63), "{t63}");
}

#[test]
fn no_energy_comes_from_nowhere() {
    // Without drag and with the rotors off the mechanical energy stays; with drag it only falls.
    for drag in [0.0, 0.2] {
        let mut parameters = ideal();
        parameters.rotor_drag_npmps = Vec3::repeat(drag);
        parameters.body_drag_npmps2 = 0.0;
        let mass = parameters.mass_kg;
        let mut quad = Quadrotor::new(parameters, Vec3::new(0.0, 0.0, 1000.0), 0.0);
        quad.set_motion(Vec3::new(0.0, 0.0, 1000.0), Vec3::new(8.0, -3.0, 5.0));
        let energy =
            |q: &Quadrotor| 0.5 * mass * q.state().vel_world.norm_squared() + mass * GRAVITY * q.state().pos_world.z;
        let first = energy(&quad);
        let mut last = first;
        for _ in 0..5000 {
            quad.step(STEP_S, None, Vec3::zeros(), no_ground);
            let now = energy(&quad);
            assert!(now <= last + 1e-6);
            last = now;
        }
        if drag == 0.0 {
            assert!((last - first).abs() < 1e-6 * first);
        }
    }
}

#[test]
fn a_landing_comes_to_rest_on_uneven_ground() {
    let hill = |x: f64, y: f64| 0.15 * (0.7 * x).sin() + 0.1 * (0.9 * y).cos();
    let parameters = ideal();
    let sink = AttitudeThrust {
        world_from_body: UnitQuaternion::from_euler_angles(0.05, 0.05, 0.4),
        thrust: parameters.normalised(Newtons(0.9 * parameters.weight().0)),
    };
    let idle = AttitudeThrust { world_from_body: level(), thrust: NormalisedThrust(0.0) };
    let mut quad = Quadrotor::new(parameters, Vec3::new(1.0, -2.0, 1.5), 0.4);
    let mut lowest = f64::INFINITY;
    for i in 0..8000 {
        let demand = if quad.state().on_ground || i > 4000 { &idle } else { &sink };
        quad.step(STEP_S, Some(demand), Vec3::zeros(), hill);
        let p = quad.state().pos_world;
        lowest = lowest.min(p.z - hill(p.x, p.y));
    }
    let s = *quad.state();
    assert!(s.on_ground && s.vel_world.norm() < 1e-2, "{}", s.vel_world);
    assert!(s.ang_vel_body.norm() < 1e-2 && lowest > 0.05, "{lowest}");
    for _ in 0..2000 {
        quad.step(STEP_S, None, Vec3::zeros(), hill);
    }
    assert!((quad.state().pos_world - s.pos_world).norm() < 0.01);
}

#[test]
fn standing_it_lifts_off_when_thrust_exceeds_weight() {
    let parameters = ideal();
    let lift = AttitudeThrust {
        world_from_body: level(),
        thrust: parameters.normalised(Newtons(1.3 * parameters.weight().0)),
    };
    let mut quad = Quadrotor::new(parameters, Vec3::new(0.0, 0.0, 0.06), 0.0);
    for _ in 0..1000 {
        quad.step(STEP_S, Some(&lift), Vec3::zeros(), flat_ground);
    }
    assert!(!quad.state().on_ground && quad.state().pos_world.z > 0.5);
}

#[test]
fn the_battery_sags_under_load_and_empties() {
    let parameters = QuadrotorParameters::default();
    let demand = hover(&parameters);
    let mut quad = Quadrotor::new(parameters, Vec3::new(0.0, 0.0, 500.0), 0.0);
    run(&mut quad, Some(&demand), 1.0);
    let early = quad.state().acc_world.z;
    run(&mut quad, Some(&demand), 60.0);
    assert!(early < -0.05, "sag under load: {early}");
    assert!((0.7..0.95).contains(&quad.battery_fraction()));
    // Drag would hide it: compare thrust as acceleration without airspeed.
    let s = *quad.state();
    quad.set_motion(s.pos_world, Vec3::zeros());
    run(&mut quad, Some(&demand), STEP_S);
    assert!(quad.state().acc_world.z < early - 0.05);
}

#[test]
fn wind_pushes_it_downwind() {
    let parameters = ideal();
    let demand = hover(&parameters);
    let mut quad = Quadrotor::new(parameters, Vec3::new(0.0, 0.0, 50.0), 0.0);
    for _ in 0..30_000 {
        quad.step(STEP_S, Some(&demand), Vec3::new(0.0, -5.0, 0.0), no_ground);
    }
    assert!((quad.state().vel_world.y + 5.0).abs() < 0.1);
}

#[test]
fn the_same_inputs_give_the_same_bits() {
    let demand = AttitudeThrust {
        world_from_body: UnitQuaternion::from_euler_angles(0.3, -0.2, 0.7),
        thrust: NormalisedThrust(0.5),
    };
    let fly = || {
        let mut quad = Quadrotor::new(QuadrotorParameters::default(), Vec3::new(0.0, 0.0, 50.0), 0.0);
        run(&mut quad, Some(&demand), 2.0);
        *quad.state()
    };
    assert_eq!(fly(), fly());
}
