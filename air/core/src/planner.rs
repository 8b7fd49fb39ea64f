//! One camera frame in, one plan out.

use crate::decode::{Decoder, FramePose};
use crate::error::ConfigError;
use crate::select::{SelectConfig, select};
use crate::target::{TargetConfig, TargetFilter};
use crate::types::{FlatState, NetworkOutput, Odometry, Plan, Rot, Task, Time, Vec3};

/// The camera as mounted, and the image that the network sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraModel {
    /// Horizontal field of view, rad.
    pub hfov: f64,
    /// Vertical field of view, rad.
    pub vfov: f64,
    /// Network image width, px.
    pub width: u32,
    /// Network image height, px.
    pub height: u32,
    /// Mounting attitude; a camera tilted up by `tilt` is `Ry(-tilt)`.
    pub body_from_cam: Rot,
    /// Lens position in the body frame, m.
    pub pos_cam_body: Vec3,
}

/// What the policy's contract says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolicyModel {
    /// What it was trained for.
    pub task: Task,
    /// r of eq. 3, m.
    pub radius: f64,
    /// d_phi of eq. 6, rad.
    pub azimuth_offset: f64,
    /// d_theta of eq. 6, rad.
    pub elevation_offset: f64,
    /// Largest speed in training, m/s.
    pub v_max: f64,
    /// Largest acceleration in training, m/s².
    pub a_max: f64,
    /// Metres for one unit of softplus(y_d).
    pub target_depth_scale: f64,
    /// Horizontal field of view of the training images, rad.
    pub hfov: f64,
    /// Vertical field of view of the training images, rad.
    pub vfov: f64,
    /// Network image width, px.
    pub width: u32,
    /// Network image height, px.
    pub height: u32,
}

/// Everything that the planner needs to know.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannerConfig {
    /// The camera as mounted.
    pub camera: CameraModel,
    /// The policy's contract.
    pub policy: PolicyModel,
    /// The target filter.
    pub target: TargetConfig,
    /// The choice among candidates.
    pub select: SelectConfig,
}

/// One frame.
#[derive(Clone, Copy, Debug)]
pub struct PlannerInput<'a> {
    /// Counts frames.
    pub seq: u64,
    /// Interpolated at the frame's capture stamp; its `stamp` is the frame's.
    pub odometry: &'a Odometry,
    /// Commanded acceleration at the stamp, m/s².
    pub acc_world: Vec3,
    /// Desired largest speed, m/s; sets alpha = speed / v_max.
    pub speed: f64,
    /// Navigation's goal; none while tracking.
    pub goal_world: Option<Vec3>,
    /// The network's raw answer to the frame.
    pub network: &'a NetworkOutput,
}

/// Decodes, filters the target, chooses.
#[derive(Clone, Debug)]
pub struct Planner {
    config: PlannerConfig,
    decoder: Decoder,
    filter: TargetFilter,
    /// The last frame's motion: stamp, position, velocity, reset counter.
    last: Option<(Time, Vec3, Vec3, u32)>,
}

/// Beyond this gap between frames a jump of the odometry cannot be told from the flight itself, s.
const LONGEST_BRIDGED_GAP: f64 = 0.5;

impl Planner {
    /// A planner with an empty target filter.
    ///
    /// # Errors
    /// A value out of range, or a camera that does not match the policy.
    pub fn new(config: PlannerConfig) -> Result<Self, ConfigError> {
        config.target.validate()?;
        config.select.validate()?;
        let decoder = Decoder::new(config.policy, &config.camera)?;
        let filter = TargetFilter::new(config.target);
        Ok(Self { config, decoder, filter, last: None })
    }

    /// The configuration that it plans with.
    #[must_use]
    pub fn config(&self) -> &PlannerConfig {
        &self.config
    }

    /// alpha for a desired largest speed (m/s): speed / v_max, kept within 0.05..=10.
    #[must_use]
    pub fn alpha(&self, speed: f64) -> f64 {
        let alpha = speed / self.config.policy.v_max;
        if alpha.is_finite() { alpha.clamp(0.05, 10.0) } else { 1.0 }
    }

    /// The network's `state` input (eq. 5), camera frame: velocity / (alpha·v_max), acceleration / (alpha²·a_max), unit
    /// world-up, and for navigation the unit direction to the goal. Tracking uses the first 9; the rest is 0.
    #[must_use]
    pub fn network_state(
        &self,
        odometry: &Odometry,
        acc_world: Vec3,
        speed: f64,
        goal_world: Option<Vec3>,
    ) -> [f32; 12] {
        let p = &self.config.policy;
        let alpha = self.alpha(speed);
        let cam_from_world = (odometry.world_from_body * self.config.camera.body_from_cam).inverse();
        let vel_cam = cam_from_world * odometry.vel_world / (alpha * p.v_max);
        let acc_cam = cam_from_world * acc_world / (alpha * alpha * p.a_max);
        let up_cam = cam_from_world * Vec3::z();
        let goal_cam = goal_world
            .and_then(|goal| (goal - odometry.pos_world).try_normalize(1e-9))
            .map_or_else(Vec3::zeros, |direction| cam_from_world * direction);
        let mut state = [0.0; 12];
        for (i, v) in [vel_cam, acc_cam, up_cam, goal_cam].iter().enumerate() {
            for (axis, x) in v.iter().enumerate() {
                state[3 * i + axis] = *x as f32;
            }
        }
        state
    }

    /// Plans from the actual state at the frame's stamp (§III-D).
    pub fn step(&mut self, input: &PlannerInput) -> Plan {
        let odometry = input.odometry;
        self.follow_jumps(odometry);
        let alpha = self.alpha(input.speed);
        let world_from_cam = odometry.world_from_body * self.config.camera.body_from_cam;
        let cam_world = odometry.pos_world + odometry.world_from_body * self.config.camera.pos_cam_body;
        let pose = FramePose { start_world: odometry.pos_world, cam_world, world_from_cam };
        let mut candidates = self.decoder.decode(input.network, alpha, &pose);
        let task = self.config.policy.task;
        let stamp = odometry.stamp;
        let chosen = select(&self.config.select, task, stamp, cam_world, &mut self.filter, &mut candidates);
        Plan {
            seq: input.seq,
            stamp,
            start: FlatState { pos: odometry.pos_world, vel: odometry.vel_world, acc: input.acc_world },
            world_from_cam,
            duration: self.decoder.duration(alpha),
            alpha,
            candidates,
            chosen,
            target: self.filter.estimate(),
        }
    }

    /// Forgets the target.
    pub fn reset(&mut self) {
        self.filter.reset();
        self.last = None;
    }

    /// When the odometry jumps, the target's place jumps with it.
    fn follow_jumps(&mut self, odometry: &Odometry) {
        if let Some((stamp, pos, vel, counter)) = self.last
            && counter != odometry.reset_counter
        {
            let gap = odometry.stamp.since(stamp);
            if (0.0..=LONGEST_BRIDGED_GAP).contains(&gap) {
                self.filter.shift(odometry.pos_world - (pos + vel * gap));
            } else {
                self.filter.reset();
            }
        }
        self.last = Some((odometry.stamp, odometry.pos_world, odometry.vel_world, odometry.reset_counter));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::{ANCHORS, MAX_CHANNELS, Rejection};
    use proptest::prelude::*;

    fn planner(task: Task) -> Planner {
        let (hfov, vfov) = (90_f64.to_radians(), 2.0 * 0.6_f64.atan());
        Planner::new(PlannerConfig {
            camera: CameraModel {
                hfov,
                vfov,
                width: 160,
                height: 96,
                body_from_cam: Rot::from_axis_angle(&Vec3::y_axis(), -0.35),
                pos_cam_body: Vec3::new(0.06, 0.0, 0.02),
            },
            policy: PolicyModel {
                task,
                radius: 5.0,
                azimuth_offset: 0.2618,
                elevation_offset: 0.2618,
                v_max: 6.0,
                a_max: 6.0,
                target_depth_scale: 5.0,
                hfov,
                vfov,
                width: 160,
                height: 96,
            },
            target: TargetConfig {
                acc_variance: [16.0, 16.0, 8.0],
                measurement_variance: 0.02,
                variance_distance: 6.0,
                gate: 5.0,
                confirm_hits: 4,
                confirm_of: 6,
                blind_time: 0.5,
                max_speed: 10.0,
                max_distance: 20.0,
                reacquire_margin: 1.0,
            },
            select: SelectConfig { min_objectness: 0.5 },
        })
        .unwrap()
    }

    fn odometry(stamp: f64) -> Odometry {
        Odometry {
            stamp: Time::from_secs(stamp),
            pos_world: Vec3::new(1.0, 2.0, 3.0),
            vel_world: Vec3::new(2.0, 0.0, 0.0),
            world_from_body: Rot::identity(),
            ang_vel_body: Vec3::zeros(),
            reset_counter: 0,
        }
    }

    /// All cells empty but those of `held`, whose costs are given.
    fn network(held: &[(usize, f32)]) -> NetworkOutput {
        let mut values = [0.0; MAX_CHANNELS * ANCHORS];
        for index in 0..ANCHORS {
            values[9 * ANCHORS + index] = 5.0;
            values[10 * ANCHORS + index] = -4.0;
        }
        for (index, cost) in held {
            values[9 * ANCHORS + index] = *cost;
            values[10 * ANCHORS + index] = 4.0;
        }
        NetworkOutput { values }
    }

    fn frames(planner: &mut Planner, from: u64, count: u64, network: &NetworkOutput) -> Plan {
        let mut plan = None;
        for seq in from..from + count {
            let odometry = odometry(seq as f64 / 30.0);
            let input = PlannerInput {
                seq,
                odometry: &odometry,
                acc_world: Vec3::zeros(),
                speed: 6.0,
                goal_world: None,
                network,
            };
            plan = Some(planner.step(&input));
        }
        plan.unwrap()
    }

    #[test]
    fn a_target_is_chased_once_confirmed() {
        let mut planner = planner(Task::Track);
        let seen = network(&[(7, 1.0)]);
        let early = frames(&mut planner, 0, 3, &seen);
        assert_eq!((early.chosen, early.candidates[7].rejection), (None, Some(Rejection::Gate)));
        let plan = frames(&mut planner, 3, 1, &seen);
        assert_eq!((plan.chosen, plan.candidates[7].rejection), (Some(7), None));
        assert_eq!(plan.candidates[0].rejection, Some(Rejection::Objectness));
        assert!(plan.target.unwrap().confirmed);
        assert_eq!(plan.start.pos, odometry(0.0).pos_world);
    }

    #[test]
    fn a_detection_elsewhere_is_gated_out_even_if_cheaper() {
        let mut planner = planner(Task::Track);
        frames(&mut planner, 0, 6, &network(&[(7, 1.0)]));
        let plan = frames(&mut planner, 6, 1, &network(&[(7, 1.0), (10, 0.0)]));
        assert_eq!((plan.chosen, plan.candidates[10].rejection), (Some(7), Some(Rejection::Gate)));
    }

    #[test]
    fn a_missed_frame_chooses_nothing_and_keeps_the_target() {
        let mut planner = planner(Task::Track);
        frames(&mut planner, 0, 6, &network(&[(7, 1.0)]));
        let plan = frames(&mut planner, 6, 1, &network(&[]));
        assert_eq!(plan.chosen, None);
        assert!(plan.target.unwrap().confirmed);
    }

    #[test]
    fn navigation_flies_the_cheapest_valid_candidate() {
        let mut planner = planner(Task::Navigate);
        let mut output = network(&[(3, 0.5), (4, 0.2)]);
        assert_eq!(frames(&mut planner, 0, 1, &output).chosen, Some(4));
        output.values[4] = f32::NAN;
        let plan = frames(&mut planner, 1, 1, &output);
        assert_eq!((plan.chosen, plan.candidates[4].rejection), (Some(3), Some(Rejection::Invalid)));
        assert_eq!(plan.candidates[3].objectness, 1.0);
    }

    #[test]
    fn a_network_of_nan_chooses_nothing() {
        for task in [Task::Track, Task::Navigate] {
            let nan = NetworkOutput { values: [f32::NAN; MAX_CHANNELS * ANCHORS] };
            assert_eq!(frames(&mut planner(task), 0, 3, &nan).chosen, None);
        }
    }

    #[test]
    fn the_state_is_seen_from_the_tilted_camera() {
        let state = planner(Task::Navigate).network_state(
            &odometry(0.0),
            Vec3::new(0.0, 0.0, 1.5),
            3.0,
            Some(Vec3::new(1.0, 12.0, 3.0)),
        );
        let (sin, cos) = (0.35_f32.sin(), 0.35_f32.cos());
        // alpha 0.5: velocity 2 / 3, acceleration 1.5 / (0.25 * 6) = 1; a camera looking up sees them below and ahead.
        let want = [2.0 / 3.0 * cos, 0.0, -2.0 / 3.0 * sin, sin, 0.0, cos, sin, 0.0, cos, 0.0, 1.0, 0.0];
        for (got, want) in state.iter().zip(want) {
            assert!((got - want).abs() < 1e-6, "{state:?}");
        }
    }

    #[test]
    fn an_odometry_jump_does_not_lose_the_target() {
        let mut planner = planner(Task::Track);
        let seen = network(&[(7, 1.0)]);
        frames(&mut planner, 0, 6, &seen);
        let mut jumped = odometry(0.2);
        jumped.pos_world += jumped.vel_world / 30.0 + Vec3::new(0.0, 50.0, 0.0);
        jumped.reset_counter = 1;
        let input = PlannerInput {
            seq: 6,
            odometry: &jumped,
            acc_world: Vec3::zeros(),
            speed: 6.0,
            goal_world: None,
            network: &seen,
        };
        assert_eq!(planner.step(&input).chosen, Some(7));
    }

    proptest! {
        #[test]
        fn no_input_makes_it_panic(
            values in prop::collection::vec(prop::num::f32::ANY, MAX_CHANNELS * ANCHORS),
            pos in prop::array::uniform3(prop::num::f64::ANY), speed in prop::num::f64::ANY, stamp in prop::num::u64::ANY
        ) {
            let mut planner = planner(Task::Track);
            let network = NetworkOutput { values: values.try_into().unwrap() };
            let odometry = Odometry { stamp: Time(stamp), pos_world: Vec3::from(pos), ..odometry(0.0) };
            for seq in 0..8 {
                let acc_world = Vec3::from(pos);
                let input = PlannerInput { seq, odometry: &odometry, acc_world, speed, goal_world: None, network: &network };
                let plan = planner.step(&input);
                prop_assert!(plan.duration.is_finite() && plan.duration > 0.0);
            }
        }
    }
}
