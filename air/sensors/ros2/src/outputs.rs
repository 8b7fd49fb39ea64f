//! What the vehicle tells, as ROS 2 has it.

use goshawk_core::values::quintic::Quintic;
use goshawk_core::{FlatState, Vec3};
use goshawk_proto::v1;

use crate::wire::messages::{
    self, Colour, Covariance, Header, Marker, MarkerArray, Odometry, Path, Pose, PoseStamped, PoseWithCovariance,
    PoseWithCovarianceStamped, Stamp, TfMessage, TransformStamped, Twist, TwistWithCovariance, Vector3,
};

/// Points of a trajectory.
const POINTS: u32 = 20;
/// `visualization_msgs/Marker.LINE_STRIP`.
const LINE_STRIP: i32 = 4;
/// A candidate's line, and that of the one that is flown, m.
const WIDTHS_M: [f64; 2] = [0.02, 0.06];
/// Markers go by themselves when no plan comes any more, ns.
const LIFETIME_NS: u32 = 500_000_000;
/// The variance of what is not known.
const UNKNOWN: f64 = 1e6;

/// The names of world and body.
#[derive(Clone, Debug)]
pub struct Frames {
    /// x east, y north, z up.
    pub world: String,
    /// x forward, y left, z up.
    pub body: String,
}

impl Frames {
    fn header(&self, stamp: Stamp) -> Header {
        Header { stamp, frame_id: self.world.clone() }
    }

    /// The trajectory that is flown; none: nothing was eligible.
    #[must_use]
    pub fn path(&self, plan: &v1::Plan, stamp: Stamp) -> Option<Path> {
        let trajectory = trajectory(plan, plan.candidates.get(plan.chosen? as usize)?)?;
        let header = self.header(stamp);
        let pose = |state: FlatState| PoseStamped {
            header: header.clone(),
            pose: Pose { position: vector(state.pos), orientation: along(state.vel) },
        };
        Some(Path { poses: states(&trajectory).map(pose).collect(), header })
    }

    /// Every candidate as a line: green is the cheapest, red the dearest, grey what is not eligible; the one that is
    /// flown is thicker.
    #[must_use]
    pub fn candidates(&self, plan: &v1::Plan, stamp: Stamp) -> MarkerArray {
        let eligible = |c: &&v1::Candidate| matches!(c.rejection(), v1::Rejection::None | v1::Rejection::Cost);
        let costs = || plan.candidates.iter().filter(eligible).map(|c| c.cost).filter(|cost| cost.is_finite());
        let (least, most) = (costs().fold(f32::INFINITY, f32::min), costs().fold(f32::NEG_INFINITY, f32::max));
        let markers = plan.candidates.iter().enumerate().filter_map(|(id, candidate)| {
            let trajectory = trajectory(plan, candidate)?;
            let chosen = plan.chosen == Some(id as u32);
            let dear = ((candidate.cost - least) / (most - least).max(f32::EPSILON)).clamp(0.0, 1.0);
            let colour = if !eligible(&candidate) || !dear.is_finite() {
                Colour { r: 0.5, g: 0.5, b: 0.5, a: 0.4 }
            } else {
                Colour { r: dear, g: 1.0 - dear, b: 0.0, a: 1.0 }
            };
            let mut pose = Pose::default();
            pose.orientation.w = 1.0;
            Some(Marker {
                header: self.header(stamp),
                ns: "candidates".to_owned(),
                id: id as i32,
                kind: LINE_STRIP,
                pose,
                scale: Vector3 { x: WIDTHS_M[usize::from(chosen)], ..Vector3::default() },
                colour,
                lifetime: (0, LIFETIME_NS),
                points: states(&trajectory).map(|state| vector(state.pos)).collect(),
                ..Marker::default()
            })
        });
        MarkerArray { markers: markers.collect() }
    }

    /// The target's position with its covariance; none: the message has neither.
    #[must_use]
    pub fn target(&self, target: &v1::Target, stamp: Stamp) -> Option<PoseWithCovarianceStamped> {
        let pos = target.pos_world?;
        let mut pose = Pose { position: Vector3 { x: pos.x, y: pos.y, z: pos.z }, ..Pose::default() };
        pose.orientation = target.vel_world.map_or(along(Vec3::zeros()), |v| along(Vec3::new(v.x, v.y, v.z)));
        let mut covariance = unknown();
        for (row, column, at) in [(0, 0, 0), (0, 1, 1), (0, 2, 2), (1, 1, 6), (1, 2, 7), (2, 2, 11)] {
            let value = f64::from(*target.covariance_upper.get(at)?);
            (covariance[row][column], covariance[column][row]) = (value, value);
        }
        Some(PoseWithCovarianceStamped { header: self.header(stamp), pose: PoseWithCovariance { pose, covariance } })
    }

    /// The vehicle's motion, as it flies by it; its rates of turn are not told.
    #[must_use]
    pub fn odometry(&self, control: &v1::Control, stamp: Stamp) -> Option<Odometry> {
        let (pose, vel) = (body(control)?, control.vel_world?);
        let q = &pose.orientation;
        let world_from_body = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z));
        let linear = vector(world_from_body.inverse() * Vec3::new(vel.x, vel.y, vel.z));
        let mut covariance = Covariance::default();
        for (k, row) in covariance.iter_mut().enumerate().skip(3) {
            row[k] = UNKNOWN;
        }
        Some(Odometry {
            header: self.header(stamp),
            child_frame_id: self.body.clone(),
            pose: PoseWithCovariance { pose, covariance: Covariance::default() },
            twist: TwistWithCovariance { twist: Twist { linear, ..Twist::default() }, covariance },
        })
    }

    /// The body's pose as a transform.
    #[must_use]
    pub fn tf(&self, control: &v1::Control, stamp: Stamp) -> Option<TfMessage> {
        let Pose { position, orientation } = body(control)?;
        let child_frame_id = self.body.clone();
        let header = self.header(stamp);
        let transform = TransformStamped { header, child_frame_id, translation: position, rotation: orientation };
        Some(TfMessage { transforms: vec![transform] })
    }
}

fn body(control: &v1::Control) -> Option<Pose> {
    let (pos, q) = (control.pos_world?, control.world_from_body?);
    Some(Pose {
        position: Vector3 { x: pos.x, y: pos.y, z: pos.z },
        orientation: messages::Quaternion { x: q.x, y: q.y, z: q.z, w: q.w },
    })
}

fn unknown() -> Covariance {
    let mut covariance = Covariance::default();
    for (k, row) in covariance.iter_mut().enumerate() {
        row[k] = UNKNOWN;
    }
    covariance
}

fn trajectory(plan: &v1::Plan, candidate: &v1::Candidate) -> Option<Quintic> {
    let start = |v: Option<v1::Vec3>| v.map(|v| Vec3::new(v.x, v.y, v.z));
    let end = |v: Option<v1::Vec3f>| v.map(|v| Vec3::new(v.x.into(), v.y.into(), v.z.into()));
    let from = FlatState {
        pos: start(plan.start_pos_world)?,
        vel: start(plan.start_vel_world)?,
        acc: start(plan.start_acc_world)?,
    };
    let to = FlatState {
        pos: end(candidate.end_pos_world)?,
        vel: end(candidate.end_vel_world)?,
        acc: end(candidate.end_acc_world)?,
    };
    (plan.duration_s > 0.0).then(|| Quintic::new(&from, &to, plan.duration_s))
}

fn states(trajectory: &Quintic) -> impl Iterator<Item = FlatState> + '_ {
    (0..POINTS).map(|k| trajectory.at(trajectory.duration() * f64::from(k) / f64::from(POINTS - 1)))
}

fn vector(v: Vec3) -> Vector3 {
    Vector3 { x: v.x, y: v.y, z: v.z }
}

/// Level, its x axis along `vel`.
fn along(vel: Vec3) -> messages::Quaternion {
    let half = 0.5 * vel.y.atan2(vel.x);
    messages::Quaternion { z: half.sin(), w: half.cos(), ..messages::Quaternion::default() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAMP: Stamp = Stamp { sec: 7, nanosec: 8 };

    fn frames() -> Frames {
        Frames { world: "map".to_owned(), body: "base_link".to_owned() }
    }

    fn v(x: f64, y: f64, z: f64) -> Option<v1::Vec3> {
        Some(v1::Vec3 { x, y, z })
    }

    fn plan() -> v1::Plan {
        let zero = Some(v1::Vec3f::default());
        let candidate = |x: f32, cost: f32, rejection: v1::Rejection| v1::Candidate {
            end_pos_world: Some(v1::Vec3f { x, y: 1.0, z: 2.0 }),
            end_vel_world: zero,
            end_acc_world: zero,
            cost,
            rejection: rejection.into(),
            ..v1::Candidate::default()
        };
        v1::Plan {
            start_pos_world: v(0.0, 0.0, 2.0),
            start_vel_world: v(1.0, 0.0, 0.0),
            start_acc_world: v(0.0, 0.0, 0.0),
            duration_s: 2.0,
            chosen: Some(1),
            candidates: vec![
                candidate(3.0, 9.0, v1::Rejection::Cost),
                candidate(4.0, 1.0, v1::Rejection::None),
                candidate(5.0, 0.0, v1::Rejection::Blocked),
            ],
            ..v1::Plan::default()
        }
    }

    #[test]
    fn a_path_is_the_chosen_trajectory_from_its_start_to_its_end() {
        let path = frames().path(&plan(), STAMP).unwrap();
        let (first, last) = (&path.poses[0].pose, &path.poses[19].pose);
        assert_eq!((first.position, first.orientation.w), (Vector3 { x: 0.0, y: 0.0, z: 2.0 }, 1.0));
        assert!((last.position.x - 4.0).abs() + (last.position.y - 1.0).abs() < 1e-9);
        assert_eq!((path.header.frame_id.as_str(), path.header.stamp), ("map", STAMP));
        assert_eq!(frames().path(&v1::Plan { chosen: None, ..plan() }, STAMP), None);
        assert_eq!(frames().path(&v1::Plan { chosen: Some(99), ..plan() }, STAMP), None);
    }

    #[test]
    fn candidates_are_lines_from_green_to_red_and_grey_where_not_eligible() {
        let markers = frames().candidates(&plan(), STAMP).markers;
        let colours: Vec<_> = markers.iter().map(|m| (m.colour.r, m.colour.g)).collect();
        assert_eq!(colours, [(1.0, 0.0), (0.0, 1.0), (0.5, 0.5)]);
        assert!(markers.iter().all(|m| m.kind == 4 && m.points.len() == 20 && m.action == 0));
        assert!(markers[1].scale.x > markers[0].scale.x);
        assert!(frames().candidates(&v1::Plan::default(), STAMP).markers.is_empty());
    }

    #[test]
    fn a_targets_covariance_keeps_its_positions_rows() {
        let covariance_upper = (0..21_u8).map(f32::from).collect();
        let target = v1::Target {
            pos_world: v(1.0, 2.0, 3.0),
            vel_world: v(0.0, 1.0, 0.0),
            covariance_upper,
            ..v1::Target::default()
        };
        let sent = frames().target(&target, STAMP).unwrap().pose;
        assert_eq!(
            sent.covariance.map(|row| [row[0], row[1], row[2]])[..3],
            [[0.0, 1.0, 2.0], [1.0, 6.0, 7.0], [2.0, 7.0, 11.0]]
        );
        assert_eq!((sent.covariance[5][5], sent.pose.position.z), (UNKNOWN, 3.0));
        assert!((sent.pose.orientation.z - 0.5_f64.sqrt()).abs() < 1e-9);
        assert_eq!(frames().target(&v1::Target { covariance_upper: vec![1.0], ..target }, STAMP), None);
    }

    #[test]
    fn odometry_and_tf_are_of_the_body_in_the_world_and_its_twist_in_the_body() {
        let half = 0.5_f64.sqrt();
        let control = v1::Control {
            pos_world: v(1.0, 2.0, 3.0),
            vel_world: v(0.0, 2.0, 0.0),
            world_from_body: Some(v1::Quat { w: half, z: half, ..v1::Quat::default() }),
            ..v1::Control::default()
        };
        let odometry = frames().odometry(&control, STAMP).unwrap();
        assert!((odometry.twist.twist.linear.x - 2.0).abs() < 1e-9 && odometry.twist.twist.linear.y.abs() < 1e-9);
        assert_eq!((odometry.child_frame_id.as_str(), odometry.twist.covariance[3][3]), ("base_link", UNKNOWN));
        let tf = frames().tf(&control, STAMP).unwrap().transforms.remove(0);
        assert_eq!((tf.translation, tf.rotation), (odometry.pose.pose.position, odometry.pose.pose.orientation));
        assert_eq!((tf.header.frame_id.as_str(), tf.child_frame_id.as_str()), ("map", "base_link"));
        assert_eq!(frames().tf(&v1::Control::default(), STAMP), None);
    }
}
