//! From the core's values to the messages of the wire and the log.

use goshawk_core as core;
use goshawk_core::planning::nearest::coarse;
use goshawk_core::planning::obstacles::VOXEL;
use goshawk_proto::v1;

/// World- or body-frame vector.
#[must_use]
pub fn vec3(v: core::Vec3) -> v1::Vec3 {
    v1::Vec3 { x: v.x, y: v.y, z: v.z }
}

fn vec3f(v: core::Vec3) -> v1::Vec3f {
    v1::Vec3f { x: v.x as f32, y: v.y as f32, z: v.z as f32 }
}

/// (w, x, y, z).
#[must_use]
pub fn quat(q: core::Rot) -> v1::Quat {
    v1::Quat { w: q.w, x: q.i, y: q.j, z: q.k }
}

/// The mode's wire value.
#[must_use]
pub fn mode(mode: core::Mode) -> v1::Mode {
    match mode {
        core::Mode::Idle => v1::Mode::Idle,
        core::Mode::Ready => v1::Mode::Ready,
        core::Mode::Takeoff => v1::Mode::Takeoff,
        core::Mode::Track => v1::Mode::Track,
        core::Mode::Navigate => v1::Mode::Navigate,
        core::Mode::Search => v1::Mode::Search,
        core::Mode::Hold => v1::Mode::Hold,
        core::Mode::Stopping => v1::Mode::Stopping,
        core::Mode::Landed => v1::Mode::Landed,
        core::Mode::Fault => v1::Mode::Fault,
    }
}

/// The task's wire value.
#[must_use]
pub fn task(task: core::Task) -> v1::Task {
    match task {
        core::Task::Track => v1::Task::Track,
        core::Task::Navigate => v1::Task::Navigate,
    }
}

fn fallback(fallback: core::Fallback) -> v1::Fallback {
    match fallback {
        core::Fallback::None => v1::Fallback::None,
        core::Fallback::PlanExpiredBrake => v1::Fallback::PlanExpiredBrake,
        core::Fallback::HoldPosition => v1::Fallback::HoldPosition,
        core::Fallback::OdometryFalseBrake => v1::Fallback::OdometryFalseBrake,
        core::Fallback::OdometryStaleDescend => v1::Fallback::OdometryStaleDescend,
        core::Fallback::HandBack => v1::Fallback::HandBack,
    }
}

fn odometry_fault(fault: Option<core::OdometryFault>) -> v1::OdometryFault {
    match fault {
        None => v1::OdometryFault::None,
        Some(core::OdometryFault::PositionJumped) => v1::OdometryFault::PositionJumped,
        Some(core::OdometryFault::PositionDisagrees) => v1::OdometryFault::PositionDisagrees,
        Some(core::OdometryFault::VelocityStepped) => v1::OdometryFault::VelocityStepped,
        Some(core::OdometryFault::AttitudeTurned) => v1::OdometryFault::AttitudeTurned,
        Some(core::OdometryFault::HeadingDisagrees) => v1::OdometryFault::HeadingDisagrees,
        Some(core::OdometryFault::Frozen) => v1::OdometryFault::Frozen,
    }
}

fn rejection(rejection: Option<core::Rejection>) -> v1::Rejection {
    match rejection {
        None => v1::Rejection::None,
        Some(core::Rejection::Objectness) => v1::Rejection::Objectness,
        Some(core::Rejection::Gate) => v1::Rejection::Gate,
        Some(core::Rejection::Cost) => v1::Rejection::Cost,
        Some(core::Rejection::Blocked) => v1::Rejection::Blocked,
        Some(core::Rejection::Invalid) => v1::Rejection::Invalid,
    }
}

fn candidate(c: &core::Candidate) -> v1::Candidate {
    v1::Candidate {
        end_pos_world: Some(vec3f(c.end.pos)),
        end_vel_world: Some(vec3f(c.end.vel)),
        end_acc_world: Some(vec3f(c.end.acc)),
        cost: c.cost as f32,
        objectness: c.objectness as f32,
        target_pos_world: c.target_world.map(vec3f),
        rejection: rejection(c.rejection).into(),
        added_obstacle: c.added.obstacle as f32,
        added_mover: c.added.mover as f32,
        added_target: c.added.target as f32,
        added_climbing: c.added.climbing as f32,
    }
}

/// Of what is remembered no more voxels are told than this, the nearest ones: 2.4 kB a second of some 120.
const TOLD_VOXELS: usize = 800;
/// And none farther above or below than this, m: the ground is no obstacle to who flies over it.
const TOLD_HEIGHT: f64 = 1.2;

/// What `planner` remembers about the vehicle, and what it saw in `frame`, its newest; none: nothing was seen yet.
#[must_use]
pub fn obstacle_map(
    seq: u64,
    stamp: core::Time,
    planner: &core::Planner,
    frame: &core::FrameInput,
) -> Option<v1::ObstacleMap> {
    let mut cells = Vec::new();
    let origin = planner.remembered(&mut cells)?;
    let at = (frame.odometry.pos_world - origin) / VOXEL;
    cells.retain(|cell| (f64::from(cell[2]) - at.z).abs() < TOLD_HEIGHT / VOXEL);
    if cells.len() > TOLD_VOXELS {
        let far = |cell: &[u8; 3]| (core::Vec3::from(cell.map(f64::from)) - at).norm_squared();
        cells.select_nth_unstable_by(TOLD_VOXELS, |a, b| far(a).total_cmp(&far(b)));
        cells.truncate(TOLD_VOXELS);
        cells.sort_unstable();
    }
    Some(v1::ObstacleMap {
        seq,
        stamp_ns: stamp.0,
        origin_world: Some(vec3(origin)),
        voxel_m: VOXEL,
        voxels: cells.concat(),
        depth: Some(depth_blocks(&planner.config().camera, frame)),
    })
}

/// A byte a block: the tenth of a metre is finer than anybody sees it drawn.
fn depth_blocks(camera: &core::CameraModel, frame: &core::FrameInput) -> v1::DepthBlocks {
    let at = &frame.odometry;
    let rounded = |mm: &u16| if *mm == 0 { 0 } else { (mm.saturating_add(50) / 100).clamp(1, 255) as u8 };
    v1::DepthBlocks {
        frame_ns: at.stamp.0,
        cam_world: Some(vec3(at.pos_world + at.world_from_body * camera.pos_cam_body)),
        world_from_cam: Some(quat(at.world_from_body * camera.body_from_cam)),
        hfov_rad: camera.hfov,
        vfov_rad: camera.vfov,
        nearest_dm: coarse(&frame.nearest).iter().map(rounded).collect(),
    }
}

/// The plan, ready at `ready`.
#[must_use]
pub fn plan(plan: &core::Plan, ready: core::Time) -> v1::Plan {
    v1::Plan {
        seq: plan.seq,
        frame_ns: plan.stamp.0,
        ready_ns: ready.0,
        start_pos_world: Some(vec3(plan.start.pos)),
        start_vel_world: Some(vec3(plan.start.vel)),
        start_acc_world: Some(vec3(plan.start.acc)),
        world_from_cam: Some(quat(plan.world_from_cam)),
        duration_s: plan.duration,
        alpha: plan.alpha,
        candidates: plan.candidates.iter().map(candidate).collect(),
        chosen: plan.chosen.map(|index| index as u32),
    }
}

/// The target filter after a plan's frame; none before the first detection.
#[must_use]
pub fn target(seq: u64, plan: &core::Plan) -> Option<v1::Target> {
    let target = plan.target?;
    Some(v1::Target {
        seq,
        stamp_ns: target.stamp.0,
        pos_world: Some(vec3(target.pos_world)),
        vel_world: Some(vec3(target.vel_world)),
        covariance_upper: (0..6)
            .flat_map(|row| (row..6).map(move |column| target.covariance[(row, column)] as f32))
            .collect(),
        confirmed: target.confirmed,
        since_seen_s: core::hidden_for(target.last_seen, plan.stamp),
        look: plan.look.map(look),
    })
}

fn look(look: core::TargetLook) -> v1::TargetLook {
    let (taken, rival) = (look.taken, look.rival);
    v1::TargetLook {
        detections: look.detections,
        passed: look.passed,
        gate_sigmas: look.gate_sigmas,
        innovation_world: taken.map(|taken| vec3(taken.innovation_world)),
        innovation_sigmas: taken.map_or(0.0, |taken| taken.sigmas),
        objectness: taken.map_or(0.0, |taken| taken.objectness),
        rival_pos_world: rival.map(|rival| vec3(rival.pos_world)),
        rival_objectness: rival.map_or(0.0, |rival| rival.objectness),
        rival_needed: rival.map_or(0.0, |rival| rival.needed),
    }
}

/// One controller step.
#[must_use]
pub fn control(
    seq: u64,
    stamp: core::Time,
    output: &core::ControllerOutput,
    odometry: Option<&core::Odometry>,
) -> v1::Control {
    v1::Control {
        seq,
        stamp_ns: stamp.0,
        mode: mode(output.mode).into(),
        fallback: fallback(output.fallback).into(),
        pos_world: odometry.map(|o| vec3(o.pos_world)),
        vel_world: odometry.map(|o| vec3(o.vel_world)),
        world_from_body: odometry.map(|o| quat(o.world_from_body)),
        acc_des_world: Some(vec3(output.acc_des_world)),
        acc_att_world: Some(vec3(output.acc_att_world)),
        acc_disturbance_world: Some(vec3(output.acc_disturbance_world)),
        acc_meas_world: output.acc_meas_world.map(vec3),
        world_from_body_des: output.setpoint.map(|s| quat(s.world_from_body)),
        thrust_n: output.thrust.0,
        thrust_norm: output.setpoint.map_or(0.0, |s| s.thrust.0),
        yaw_des_rad: output.yaw_des,
        plan_seq: output.plan_seq,
        plan_age_s: output.plan_age,
        hover_thrust: output.hover_thrust,
        attitude_lag_s: output.attitude_lag,
        odometry_fault: odometry_fault(output.odometry_fault).into(),
        odometry_doubt: output.odometry_doubt,
        disturbance_limit_mps2: output.disturbance_limit,
    }
}

/// One odometry sample.
#[must_use]
pub fn odometry(seq: u64, o: &core::Odometry) -> v1::Odometry {
    v1::Odometry {
        seq,
        stamp_ns: o.stamp.0,
        pos_world: Some(vec3(o.pos_world)),
        vel_world: Some(vec3(o.vel_world)),
        world_from_body: Some(quat(o.world_from_body)),
        ang_vel_body: Some(vec3(o.ang_vel_body)),
        reset_counter: o.reset_counter,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Vehicle;
    use goshawk_core::planning::nearest::{BLOCKS, COLUMNS, ROWS};
    use std::path::Path;

    #[test]
    fn of_what_is_remembered_the_nearest_at_the_vehicles_height_is_told() {
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../vehicles/sim.toml");
        let contract = goshawk_policy::Contract::from_json(include_str!("../../policy/tests/contract.json")).unwrap();
        let config = Vehicle::load(&shipped).unwrap().planner_config(contract.model());
        let hfov = config.camera.hfov;
        let mut planner = core::Planner::new(config).unwrap();
        let pos_world = core::Vec3::new(3.0, -2.0, 20.0);
        let frame = |seq: u64, nearest| {
            let odometry = core::Odometry {
                stamp: core::Time(seq * 33_000_000),
                pos_world,
                vel_world: core::Vec3::zeros(),
                world_from_body: core::Rot::identity(),
                ang_vel_body: core::Vec3::zeros(),
                reset_counter: 0,
            };
            let demand = core::PlanningDemand { task: core::Task::Track, speed: 4.0, goal_world: None };
            core::FrameInput::new(0, seq, &odometry, core::Vec3::zeros(), &demand, nearest)
        };
        let nothing = frame(0, [0; COLUMNS * ROWS]);
        assert_eq!(obstacle_map(0, core::Time(0), &planner, &nothing), None, "nothing was seen");
        // A wall that fills the image at each of some distances.
        for (seq, mm) in (0..20_u64).map(|k| (k, 2000 + 200 * (k / 4) as u16)) {
            drop(planner.see(&frame(seq, [mm; COLUMNS * ROWS])));
        }
        let mut nearest = [2849; COLUMNS * ROWS];
        [0, 7, 25_450, u16::MAX]
            .iter()
            .zip(nearest.chunks_exact_mut(COLUMNS / BLOCKS))
            .for_each(|(mm, block)| block.fill(*mm));
        let map = obstacle_map(7, core::Time(9), &planner, &frame(20, nearest)).unwrap();
        let depth = map.depth.unwrap();
        assert_eq!((&depth.nearest_dm[..5], depth.nearest_dm.len()), (&[0, 1, 255, 255, 28][..], BLOCKS * ROWS));
        assert_eq!((depth.frame_ns, depth.hfov_rad), (660_000_000, hfov));
        let origin = map.origin_world.unwrap();
        let (cells, rest) = map.voxels.as_chunks::<3>();
        assert!((100..=TOLD_VOXELS).contains(&cells.len()) && rest.is_empty(), "{}", cells.len());
        for [x, _, z] in cells {
            let (ahead, above) = (origin.x + VOXEL * f64::from(*x) - 3.0, origin.z + VOXEL * f64::from(*z) - 20.0);
            assert!((1.0..4.0).contains(&ahead) && above.abs() <= TOLD_HEIGHT + VOXEL, "{ahead} {above}");
        }
    }
}
