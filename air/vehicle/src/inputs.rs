//! What planner and controller are given, to and from the messages that a log holds and a replay gives back.

use goshawk_core::planning::nearest::{BLOCKS, COLUMNS, Nearest, ROWS};
use goshawk_core::{
    AutopilotStatus, Command, FrameInput, FrameRecord, Imu, NetworkOutput, NetworkState, Odometry, Profile, Rot,
    StepInput, Task, Time, Vec3,
};
use goshawk_proto::v1;

use crate::convert::{self, odometry, vec3};

/// All that a plan was made from, for the log.
#[must_use]
pub fn planner_input(record: &FrameRecord) -> v1::PlannerInput {
    let frame = &record.frame;
    v1::PlannerInput {
        seq: frame.seq,
        odometry: Some(odometry(frame.seq, &frame.odometry)),
        acc_world: Some(vec3(frame.acc_world)),
        speed_mps: frame.speed,
        goal_world: frame.goal_world.map(vec3),
        state: record.state.to_vec(),
        prediction: record.network.values.to_vec(),
        nearest_mm: frame.nearest.iter().flat_map(|mm| mm.to_le_bytes()).collect(),
    }
}

/// All that a plan was made from, from the log; none: a part is missing.
#[must_use]
pub fn frame_record(m: &v1::PlannerInput) -> Option<FrameRecord> {
    let state = NetworkState::from_slice(&m.state)?;
    let frame = FrameInput {
        flight: 0,
        seq: m.seq,
        odometry: odometry_from(m.odometry.as_ref()?)?,
        acc_world: vector(m.acc_world?),
        speed: m.speed_mps,
        goal_world: m.goal_world.map(vector),
        nearest: nearest_from(&m.nearest_mm)?,
    };
    Some(FrameRecord { frame, state, network: NetworkOutput { values: m.prediction.as_slice().try_into().ok()? } })
}

/// In columns, or in blocks of some, as logs of before December 2026 have it.
fn nearest_from(bytes: &[u8]) -> Option<Nearest> {
    let (depths, rest) = bytes.as_chunks::<2>();
    let each = if depths.len() == BLOCKS * ROWS { COLUMNS / BLOCKS } else { 1 };
    let columns = depths.iter().flat_map(|mm| std::iter::repeat_n(u16::from_le_bytes(*mm), each));
    columns.collect::<Vec<_>>().try_into().ok().filter(|_| rest.is_empty())
}

fn vector(v: v1::Vec3) -> Vec3 {
    Vec3::new(v.x, v.y, v.z)
}

/// A logged odometry message, bit for bit; none: a part is missing.
#[must_use]
pub fn odometry_from(m: &v1::Odometry) -> Option<Odometry> {
    let q = m.world_from_body?;
    Some(Odometry {
        stamp: Time(m.stamp_ns),
        pos_world: vector(m.pos_world?),
        vel_world: vector(m.vel_world?),
        world_from_body: Rot::new_unchecked(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z)),
        ang_vel_body: vector(m.ang_vel_body?),
        reset_counter: m.reset_counter,
    })
}

/// What a step of the controller was given at `stamp`, for the log.
#[must_use]
pub fn controller_input(input: &StepInput, seq: u64, stamp: Time) -> v1::ControllerInput {
    v1::ControllerInput {
        seq,
        stamp_ns: stamp.0,
        plan_seq: input.plan_seq,
        connected: input.autopilot.connected,
        armed: input.autopilot.armed,
        offboard: input.autopilot.offboard,
        landed: input.autopilot.landed,
        ready: input.ready,
        start: match &input.command {
            Some(Command::Start(profile)) => Some(v1::StartProfile {
                task: convert::task(profile.task).into(),
                speed_mps: profile.speed,
                height_m: profile.height,
                goal_m: profile.goal.map(vec3),
            }),
            _ => None,
        },
        stop: input.command == Some(Command::Stop),
        hold: input.command == Some(Command::Hold),
        resume: input.command == Some(Command::Resume),
        odometry_ns: input.odometry.map(|o| o.stamp.0),
        imu_ns: input.imu.map(|imu| imu.stamp.0),
        battery: input.autopilot.battery,
        position: input.autopilot.position,
    }
}

/// An inertial sample, for the log.
#[must_use]
pub fn imu(imu: &Imu) -> v1::Imu {
    v1::Imu {
        stamp_ns: imu.stamp.0,
        specific_force_body: Some(vec3(imu.specific_force_body)),
        ang_vel_body: Some(vec3(imu.ang_vel_body)),
    }
}

/// A logged inertial sample, bit for bit; none: a part is missing.
#[must_use]
pub fn imu_from(m: &v1::Imu) -> Option<Imu> {
    Some(Imu {
        stamp: Time(m.stamp_ns),
        specific_force_body: vector(m.specific_force_body?),
        ang_vel_body: vector(m.ang_vel_body?),
    })
}

/// What a step of the controller was given, from the log: the message names its odometry and its inertial sample by their
/// stamps, and the last ones before it in the log are `odometry` and `imu`.
#[must_use]
pub fn step_input(m: &v1::ControllerInput, odometry: Option<Odometry>, imu: Option<Imu>) -> StepInput {
    let start = m.start.as_ref().map(|start| {
        Command::Start(Profile {
            task: if start.task() == v1::Task::Navigate { Task::Navigate } else { Task::Track },
            speed: start.speed_mps,
            height: start.height_m,
            goal: start.goal_m.map(vector),
        })
    });
    let bare = match (m.stop, m.hold, m.resume) {
        (true, ..) => Some(Command::Stop),
        (_, true, _) => Some(Command::Hold),
        (.., true) => Some(Command::Resume),
        _ => None,
    };
    StepInput {
        odometry,
        imu: imu.filter(|_| m.imu_ns.is_some()),
        plan_seq: m.plan_seq,
        autopilot: AutopilotStatus {
            connected: m.connected,
            armed: m.armed,
            offboard: m.offboard,
            landed: m.landed,
            battery: m.battery,
            position: m.position,
        },
        command: start.or(bare),
        ready: m.ready,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use goshawk_core::PlanningDemand;
    use goshawk_core::planning::nearest::coarse;
    use prost::Message;

    fn at_stamp() -> Odometry {
        Odometry {
            stamp: Time(7),
            pos_world: Vec3::new(0.1, -0.0, 1e-310),
            vel_world: Vec3::new(-1.0 / 3.0, 0.0, f64::MIN_POSITIVE),
            world_from_body: Rot::from_euler_angles(0.1, -0.2, 3.0),
            ang_vel_body: Vec3::new(-0.0, 1.0, 2.0),
            reset_counter: 3,
        }
    }

    #[test]
    fn a_frames_input_comes_back_from_the_log_bit_for_bit() {
        let demand = PlanningDemand { task: Task::Navigate, speed: 6.1, goal_world: Some(Vec3::x()) };
        let nearest = std::array::from_fn(|block| 7 * block as u16);
        let frame = FrameInput::new(0, 5, &at_stamp(), Vec3::new(-0.0, 0.7, 0.1), &demand, nearest);
        let network = NetworkOutput { values: [0.0; goshawk_core::MAX_CHANNELS * goshawk_core::ANCHORS] };
        let mut record = FrameRecord { frame, state: NetworkState::from_slice(&[0.5, -0.0, 1.0]).unwrap(), network };
        record.network.values[17] = -0.0;
        let bytes = planner_input(&record).encode_to_vec();
        let back = frame_record(&v1::PlannerInput::decode(bytes.as_slice()).unwrap()).unwrap();
        assert_eq!(format!("{back:?}"), format!("{record:?}"), "Debug tells -0 from 0");
    }

    #[test]
    fn depths_in_blocks_of_columns_as_older_logs_have_them_are_those_of_each_column() {
        let blocks = (0..BLOCKS * ROWS).map(|block| block as u16);
        let bytes: Vec<u8> = blocks.clone().flat_map(u16::to_le_bytes).collect();
        let nearest = nearest_from(&bytes).expect("of an older log");
        assert_eq!(coarse(&nearest).as_slice(), blocks.collect::<Vec<_>>());
        assert_eq!(nearest_from(&bytes[1..]), None);
        assert_eq!(nearest_from(&[bytes.clone(), bytes].concat()), None);
    }

    #[test]
    fn a_steps_input_comes_back_from_the_log() {
        let sample = Imu { stamp: Time(9), specific_force_body: Vec3::new(0.1, -2.0, 9.8), ang_vel_body: Vec3::y() };
        let profile = Profile { task: Task::Navigate, speed: 5.0, height: 1.5, goal: Some(Vec3::x()) };
        let bare = [Command::Stop, Command::Hold, Command::Resume].map(Some);
        for command in [None, Some(Command::Start(profile))].into_iter().chain(bare) {
            let input = StepInput {
                odometry: Some(at_stamp()),
                imu: Some(sample),
                plan_seq: Some(0),
                autopilot: AutopilotStatus {
                    armed: true,
                    landed: Some(false),
                    position: Some(false),
                    ..AutopilotStatus::default()
                },
                command,
                ready: true,
            };
            let message = controller_input(&input, 1, Time(2));
            assert_eq!(message.odometry_ns, Some(7));
            assert_eq!(message.imu_ns, Some(9));
            let back = imu_from(&v1::Imu::decode(imu(&sample).encode_to_vec().as_slice()).unwrap());
            assert_eq!(step_input(&message, input.odometry, back), input);
        }
    }
}
