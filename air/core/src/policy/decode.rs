//! Network tensor → end states and detections, world frame (eq. 4-9).

use std::f64::consts::FRAC_PI_2;

use crate::policy::activation::{LANES, Lanes, sigmoid, sin_cos, softplus, tanh};
use crate::policy::lattice::{Anchor, COLUMNS, Lattice, ROWS};
use crate::policy::model::{CameraModel, PolicyModel};
use crate::values::error::{ConfigError, within};
use crate::values::types::{ANCHORS, Added, Candidate, FlatState, NetworkOutput, Rejection, Rot, Task, Vec3};

/// Where the camera was, and from where the vehicle plans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FramePose {
    /// The vehicle's position: f(0) of every trajectory, m.
    pub start_world: Vec3,
    /// The lens, m.
    pub cam_world: Vec3,
    /// The camera's attitude.
    pub world_from_cam: Rot,
}

/// Decodes one network's outputs.
#[derive(Clone, Debug)]
pub struct Decoder {
    lattice: Lattice,
    /// Sines and cosines of the anchors' elevations, and of their azimuths.
    angles: [(Lanes, Lanes); 2],
    policy: PolicyModel,
    /// Pixels for one unit of tan(angle).
    focal_u: f64,
    focal_v: f64,
}

/// Channels in the contract's order: a trajectory's end relative to its anchor, elevation.
const THETA: usize = 0;
/// Its azimuth.
const PHI: usize = 1;
/// Its distance.
const RADIUS: usize = 2;
/// First of its velocity's three.
const VELOCITY: usize = 3;
/// First of its acceleration's three.
const ACCELERATION: usize = 6;
/// The trajectory's cost.
const COST: usize = 9;
/// Whether the cell holds the target.
const OBJECTNESS: usize = 10;
/// The target's place in the cell, to the right.
const DELTA_U: usize = 11;
/// And down.
const DELTA_V: usize = 12;
/// Its distance.
const DISTANCE: usize = 13;
/// All of an anchor that looks for a target.
const CHANNELS: usize = 14;

/// Channels of one anchor.
#[must_use]
pub const fn channels(task: Task) -> usize {
    match task {
        Task::Track => CHANNELS,
        Task::Navigate => 10,
    }
}

impl Decoder {
    /// A decoder for `policy` seen through `camera`.
    ///
    /// # Errors
    /// A contract value out of range, or a camera that differs from the policy's.
    pub fn new(policy: PolicyModel, camera: &CameraModel) -> Result<Self, ConfigError> {
        validate(&policy, camera)?;
        let lattice = Lattice::new(policy.hfov, policy.vfov, policy.radius);
        let lanes = |angle: fn(&Anchor) -> f64| {
            let angles = std::array::from_fn(|k| lattice.anchors.get(k).map_or(0.0, angle) as f32);
            (angles.map(f32::sin), angles.map(f32::cos))
        };
        Ok(Self {
            angles: [lanes(|anchor| anchor.elevation), lanes(|anchor| anchor.azimuth)],
            lattice,
            focal_u: f64::from(policy.width) / 2.0 / (policy.hfov / 2.0).tan(),
            focal_v: f64::from(policy.height) / 2.0 / (policy.vfov / 2.0).tan(),
            policy,
        })
    }

    /// T = 2r / (alpha · v_max), s.
    #[must_use]
    pub fn duration(&self, alpha: f64) -> f64 {
        2.0 * self.policy.radius / (alpha * self.policy.v_max)
    }

    /// All candidates, none rejected yet except as `Invalid` where a value is not finite.
    ///
    /// The lens's displacement along a trajectory is the body's: `end.pos` is `start_world` plus the rotated eq. 4.
    #[must_use]
    pub fn decode(&self, output: &NetworkOutput, alpha: f64, pose: &FramePose) -> [Candidate; ANCHORS] {
        let p = &self.policy;
        let (y, finite) = activated(output, channels(p.task));
        let pos_cam = self.end_positions(&y);
        let vel_cam = self.vectors_cam(&y, VELOCITY, alpha * p.v_max);
        let acc_cam = self.vectors_cam(&y, ACCELERATION, alpha * alpha * p.a_max);
        let world_from_cam = pose.world_from_cam.to_rotation_matrix();
        std::array::from_fn(|index| {
            if !finite[index] {
                return self.bare_anchor(index, pose);
            }
            let target_world =
                (p.task == Task::Track).then(|| pose.cam_world + world_from_cam * self.detection(&y, index));
            Candidate {
                end: FlatState {
                    pos: pose.start_world + world_from_cam * pos_cam[index],
                    vel: world_from_cam * vel_cam[index],
                    acc: world_from_cam * acc_cam[index],
                },
                cost: y[COST][index].into(),
                added: Added::default(),
                objectness: y[OBJECTNESS][index].into(),
                target_world,
                rejection: None,
            }
        })
    }

    /// End positions in the camera frame, m (eq. 6, then eq. 4).
    fn end_positions(&self, y: &[Lanes; CHANNELS]) -> [Vec3; LANES] {
        let p = &self.policy;
        let turned = |at: usize, most: f64| sin_cos(&y[at].map(|bounded| bounded * most as f32));
        let [(sin_el, cos_el), (sin_az, cos_az)] = &self.angles;
        let (sin_up, cos_up) = turned(THETA, p.elevation_offset);
        let (sin_left, cos_left) = turned(PHI, p.azimuth_offset);
        std::array::from_fn(|k| {
            // Of the sums of the anchor's angles and the offsets.
            let (sin_el, cos_el) = sum((sin_el[k], cos_el[k]), (sin_up[k], cos_up[k]));
            let (sin_az, cos_az) = sum((sin_az[k], cos_az[k]), (sin_left[k], cos_left[k]));
            let radius = p.radius as f32 * (1.0 + y[RADIUS][k]);
            double([radius * cos_el * cos_az, radius * cos_el * sin_az, radius * sin_el])
        })
    }

    /// The vectors of three channels, which are in their cells' frames, times `scale` in the camera frame (eq. 7).
    fn vectors_cam(&self, y: &[Lanes; CHANNELS], at: usize, scale: f64) -> [Vec3; LANES] {
        let [(sin_el, cos_el), (sin_az, cos_az)] = &self.angles;
        std::array::from_fn(|k| {
            let [x, left, up] = [at, at + 1, at + 2].map(|channel| y[channel][k] * scale as f32);
            let (ahead, up) = (cos_el[k] * x - sin_el[k] * up, sin_el[k] * x + cos_el[k] * up);
            double([cos_az[k] * ahead - sin_az[k] * left, sin_az[k] * ahead + cos_az[k] * left, up])
        })
    }

    /// The detected centre in the camera frame, m, from its place in the cell and its distance along the optical axis
    /// (eq. 8-9).
    fn detection(&self, y: &[Lanes; CHANNELS], index: usize) -> Vec3 {
        let p = &self.policy;
        let (width, height) = (f64::from(p.width), f64::from(p.height));
        let (row, column) = ((index / COLUMNS) as f64, (index % COLUMNS) as f64);
        // A centre may leave its cell by half a cell on each side.
        let at = |channel: usize| f64::from(y[channel][index]);
        let u = (2.0 * at(DELTA_U) - 0.5 + column) * (width / COLUMNS as f64);
        let v = (2.0 * at(DELTA_V) - 0.5 + row) * (height / ROWS as f64);
        let distance = p.target_depth_scale * at(DISTANCE);
        distance * Vec3::new(1.0, (width / 2.0 - u) / self.focal_u, (height / 2.0 - v) / self.focal_v)
    }

    /// Stands in for values that are not finite.
    fn bare_anchor(&self, index: usize, pose: &FramePose) -> Candidate {
        let pos = pose.start_world + pose.world_from_cam * self.lattice.primitive(index);
        Candidate {
            end: FlatState { pos, ..FlatState::default() },
            cost: f64::from(f32::MAX),
            added: Added::default(),
            objectness: 0.0,
            target_world: None,
            rejection: Some(Rejection::Invalid),
        }
    }
}

/// Sine and cosine of the sum of two angles, given theirs.
fn sum(a: (f32, f32), b: (f32, f32)) -> (f32, f32) {
    (a.0 * b.1 + a.1 * b.0, a.1 * b.1 - a.0 * b.0)
}

fn double(v: [f32; 3]) -> Vec3 {
    Vec3::from(v.map(f64::from))
}

/// The channels after their output functions, and for which anchors all of them are finite. Navigation's objectness is 1.
fn activated(output: &NetworkOutput, channels: usize) -> ([Lanes; CHANNELS], [bool; LANES]) {
    let (mut y, mut finite) = ([[0.0; LANES]; CHANNELS], [true; LANES]);
    for (lanes, values) in y.iter_mut().zip(output.values.chunks_exact(ANCHORS)).take(channels) {
        for (k, value) in values.iter().enumerate() {
            lanes[k] = *value;
            finite[k] &= value.is_finite();
        }
    }
    tanh(y[..COST].as_flattened_mut());
    softplus(&mut y[COST]);
    if channels == CHANNELS {
        sigmoid(y[OBJECTNESS..=DELTA_V].as_flattened_mut());
        softplus(&mut y[DISTANCE]);
    } else {
        y[OBJECTNESS] = [1.0; LANES];
    }
    (y, finite)
}

fn validate(policy: &PolicyModel, camera: &CameraModel) -> Result<(), ConfigError> {
    within("policy.radius", policy.radius, 0.1..=100.0, "the depth camera sees no farther")?;
    let acute = "rad: the lattice lies before the camera";
    within("policy.azimuth_offset", policy.azimuth_offset, 1e-3..=FRAC_PI_2, acute)?;
    within("policy.elevation_offset", policy.elevation_offset, 1e-3..=FRAC_PI_2, acute)?;
    within("policy.v_max", policy.v_max, 0.1..=100.0, "m/s: no quadrotor trains for more")?;
    within("policy.a_max", policy.a_max, 0.1..=1000.0, "m/s2: no quadrotor trains for more")?;
    within(
        "policy.target_depth_scale",
        policy.target_depth_scale,
        1e-3..=1000.0,
        "m: the depth camera sees no farther",
    )?;
    within("policy.cost_scale", policy.cost_scale, 1e-3..=1e6, "what the planner adds is a multiple of it")?;
    within("policy.hfov", policy.hfov, 0.01..=3.0, "rad: a pinhole camera sees less than half the world")?;
    within("policy.vfov", policy.vfov, 0.01..=3.0, "rad: a pinhole camera sees less than half the world")?;
    within("policy.width", f64::from(policy.width), 1.0..=65_536.0, "px: no onboard network takes more")?;
    within("policy.height", f64::from(policy.height), 1.0..=65_536.0, "px: no onboard network takes more")?;
    // Half a degree: the lattice's cells are 18 degrees wide.
    let near = |a: f64, b: f64| (a - b).abs() <= 0.009;
    if !near(camera.hfov, policy.hfov) || !near(camera.vfov, policy.vfov) {
        return Err(ConfigError::Contradiction(
            "the camera's field of view differs from the policy's training images by more than 0.5 degrees: crop to \
             the policy's, or fill the rim of a narrower camera",
        ));
    }
    if (camera.width, camera.height) != (policy.width, policy.height) {
        return Err(ConfigError::Contradiction("the camera's network image size differs from the policy's"));
    }
    if !camera.pos_cam_body.iter().chain(camera.body_from_cam.coords.iter()).all(|x| x.is_finite()) {
        return Err(ConfigError::Contradiction("the camera's mounting is not finite"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::state::StateLayout;
    use crate::values::types::MAX_CHANNELS;
    use proptest::prelude::*;

    fn policy(task: Task) -> PolicyModel {
        let (hfov, vfov) = (90_f64.to_radians(), 2.0 * 0.6_f64.atan());
        PolicyModel {
            task,
            state: StateLayout { up: true, aim: true, direction: false, agility: true },
            radius: 5.0,
            azimuth_offset: 15_f64.to_radians(),
            elevation_offset: 15_f64.to_radians(),
            v_max: 6.0,
            a_max: 6.0,
            target_depth_scale: 5.0,
            cost_scale: 6.0,
            hfov,
            vfov,
            width: 160,
            height: 96,
        }
    }

    fn camera(p: &PolicyModel) -> CameraModel {
        CameraModel {
            hfov: p.hfov,
            vfov: p.vfov,
            width: 160,
            height: 96,
            body_from_cam: Rot::identity(),
            pos_cam_body: Vec3::zeros(),
        }
    }

    fn decoder(task: Task) -> Decoder {
        let p = policy(task);
        Decoder::new(p, &camera(&p)).unwrap()
    }

    fn level() -> FramePose {
        FramePose { start_world: Vec3::zeros(), cam_world: Vec3::zeros(), world_from_cam: Rot::identity() }
    }

    #[test]
    fn zero_outputs_give_the_bare_primitives() {
        let decoder = decoder(Task::Navigate);
        let output = NetworkOutput { values: [0.0; MAX_CHANNELS * ANCHORS] };
        for (index, candidate) in decoder.decode(&output, 1.0, &level()).iter().enumerate() {
            assert!((candidate.end.pos - decoder.lattice.primitive(index)).norm() < 2e-6);
            assert!(candidate.end.vel.norm() + candidate.end.acc.norm() < 1e-12);
            assert_eq!(candidate.target_world, None);
        }
    }

    #[test]
    fn a_detection_in_the_middle_cell_is_straight_ahead() {
        let decoder = decoder(Task::Track);
        let mut output = NetworkOutput { values: [0.0; MAX_CHANNELS * ANCHORS] };
        output.values[DISTANCE * ANCHORS + 7] = 1.0;
        let target = decoder.decode(&output, 1.0, &level())[7].target_world.unwrap();
        assert!((target - Vec3::new(5.0 * 1f64.exp().ln_1p(), 0.0, 0.0)).norm() < 2e-6);
    }

    #[test]
    fn a_camera_of_another_field_of_view_is_refused() {
        let p = policy(Task::Track);
        let other = CameraModel { hfov: 1.2, ..camera(&p) };
        assert!(matches!(Decoder::new(p, &other), Err(ConfigError::Contradiction(_))));
    }

    fn any_value() -> impl Strategy<Value = f32> {
        prop_oneof![4 => -6.0f32..6.0, 1 => prop::num::f32::ANY]
    }

    proptest! {
        #[test]
        fn whatever_the_network_says_candidates_are_finite_and_bounded(
            values in prop::collection::vec(any_value(), MAX_CHANNELS * ANCHORS), alpha in 0.2..3.0
        ) {
            let decoder = decoder(Task::Track);
            let output = NetworkOutput { values: values.clone().try_into().unwrap() };
            for (index, c) in decoder.decode(&output, alpha, &level()).iter().enumerate() {
                let finite = (0..14).all(|channel| values[channel * ANCHORS + index].is_finite());
                prop_assert_eq!(c.rejection, if finite { None } else { Some(Rejection::Invalid) });
                prop_assert!(c.end.pos.norm() <= 10.0 + 1e-5);
                prop_assert!(c.end.vel.amax() <= alpha * 6.0 * 3f64.sqrt() * (1.0 + 1e-6));
                prop_assert!(c.end.acc.amax() <= alpha * alpha * 6.0 * 3f64.sqrt() * (1.0 + 1e-6));
                prop_assert!(c.cost.is_finite() && c.cost >= 0.0);
                prop_assert!((0.0..=1.0).contains(&c.objectness));
                prop_assert!(c.target_world.is_none_or(|t| t.iter().all(|x| x.is_finite())));
            }
        }
    }
}
