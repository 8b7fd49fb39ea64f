//! Whatever it is given, the controller answers with something that can be sent.
#![allow(clippy::unwrap_used, reason = "test helpers too")]

mod common;

use goshawk_core::planning::room::HEADINGS;
use goshawk_core::*;
use proptest::prelude::*;

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![6 => -30.0..30.0f64, 1 => prop::num::f64::ANY]
}

fn vector() -> impl Strategy<Value = Vec3> {
    [number(), number(), number()].prop_map(Vec3::from)
}

fn odometry() -> impl Strategy<Value = (f64, Vec3, Vec3, f64, u32)> {
    (0.0..0.5f64, vector(), vector(), -3.0..3.0f64, 0..2u32)
}

prop_compose! {
    fn plan()(
        chosen in prop::option::of(0..20usize), pos in vector(), vel in vector(), acc in vector(),
        duration in number(), age in 0.0..0.5f64, distance in number(), target in prop::option::of((vector(), vector(), any::<bool>()))
    ) -> (f64, Plan) {
        let state = FlatState { pos, vel, acc };
        let candidate = Candidate { end: state, cost: 1.0, added: Added::default(), objectness: 1.0, target_world: None, rejection: None };
        let estimate = target.map(|(pos_world, vel_world, confirmed)| TargetEstimate {
            stamp: Time(0), pos_world, vel_world, covariance: nalgebra::Matrix6::identity(), confirmed, last_seen: Time(0),
        });
        (age, Plan {
            seq: 0, stamp: Time(0), start: state, world_from_cam: Rot::identity(), duration, alpha: 1.0,
            candidates: [candidate; ANCHORS], chosen, target: estimate, look: None,
            room: Some([distance as f32; HEADINGS]),
            movers: [None; goshawk_core::planning::movers::MOST],
            evasion: None,
        })
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn every_setpoint_is_finite_and_within_limits(
        steps in prop::collection::vec((odometry(), plan(), any::<u8>(), 0.0..0.4f64), 1..60), navigate in any::<bool>()
    ) {
        let config = common::config();
        let mut controller = Controller::new(config.clone()).unwrap();
        let mut now = Time::from_secs(50.0);
        let profile = if navigate { common::navigate(Vec3::x() * 20.0) } else { common::track() };
        for (k, ((age, pos_world, vel_world, yaw, reset_counter), (plan_age, plan), bits, dt)) in steps.into_iter().enumerate() {
            now = now.plus(dt);
            let odometry = Odometry {
                stamp: now.plus(-age), pos_world, vel_world, reset_counter,
                world_from_body: Rot::from_axis_angle(&Vec3::z_axis(), yaw), ang_vel_body: Vec3::zeros(),
            };
            let plan = Plan { seq: k as u64, stamp: now.plus(-plan_age), ..plan };
            // A mostly willing autopilot, so that flights get far.
            let climbing = k > 4;
            let input = StepInput {
            imu: None,
                odometry: Some(odometry),
                plan_seq: Some(plan.seq),
                autopilot: AutopilotStatus { connected: true, armed: climbing, offboard: climbing, landed: None, battery: Some(0.8), position: None },
                command: match bits { 0..=9 => Some(Command::Stop), 10..=120 => Some(Command::Start(profile)), 121..=125 => Some(Command::Hold), 126..=130 => Some(Command::Resume), _ => None },
                ready: true,
            };
            let output = controller.step(now, &input, Some(&plan));
            prop_assert_eq!(output.setpoint.is_some(), output.mode.has_authority());
            if let Some(setpoint) = output.setpoint {
                prop_assert!((0.0..=config.airframe.max_thrust).contains(&setpoint.thrust.0));
                prop_assert!((setpoint.world_from_body.norm() - 1.0).abs() < 1e-9);
                let up = (setpoint.world_from_body * Vec3::z()).z;
                prop_assert!(up >= config.airframe.max_tilt_deg.to_radians().cos() - 1e-9);
            }
            prop_assert!(output.yaw_des.is_finite() && output.acc_disturbance_world.norm() <= config.observer.limit_mps2 + 1e-9);
        }
    }
}
