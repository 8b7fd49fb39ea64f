//! What planner and controller are given, as values that a log can hold and [`crate::replay`] gives back: a step is a
//! function of these and of the steps before, on board, in lockstep and in a replay alike.

use goshawk_core::planning::nearest::Nearest;
use goshawk_core::{
    AutopilotStatus, Command, ConfigError, Controller, ControllerConfig, ControllerInput, ControllerOutput, Mode,
    NetworkOutput, Odometry, Plan, PlannerInput, PlanningDemand, Profile, Rot, Task, Time, Vec3,
};
use goshawk_proto::v1;

use crate::convert::{self, odometry, vec3};

/// What the planner is given for one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameInput {
    /// Counts frames.
    pub seq: u64,
    /// At the frame's capture stamp.
    pub odometry: Odometry,
    /// Commanded then, m/s².
    pub acc_world: Vec3,
    /// Desired, m/s.
    pub speed: f64,
    /// Navigation's goal.
    pub goal_world: Option<Vec3>,
    /// The nearest depth in each block of the image.
    pub nearest: Nearest,
    /// The network's state input.
    pub state: [f32; 13],
    /// The network's raw answer.
    pub network: NetworkOutput,
}

/// Protobuf does not tell -0 from 0, so neither may a step's input.
fn plain(v: Vec3) -> Vec3 {
    v.map(|x| x + 0.0)
}

/// `o` with no negative zero in it.
#[must_use]
pub fn plain_odometry(o: &Odometry) -> Odometry {
    Odometry {
        stamp: o.stamp,
        pos_world: plain(o.pos_world),
        vel_world: plain(o.vel_world),
        world_from_body: Rot::new_unchecked(o.world_from_body.into_inner().coords.map(|x| x + 0.0).into()),
        ang_vel_body: plain(o.ang_vel_body),
        reset_counter: o.reset_counter,
    }
}

impl FrameInput {
    /// A frame that the network has yet to see: `state` and `network` are zero.
    #[must_use]
    pub fn new(seq: u64, at_stamp: &Odometry, acc_world: Vec3, demand: &PlanningDemand, nearest: Nearest) -> Self {
        FrameInput {
            seq,
            odometry: plain_odometry(at_stamp),
            acc_world: plain(acc_world),
            speed: demand.speed,
            goal_world: demand.goal_world.map(plain),
            nearest,
            state: [0.0; 13],
            network: NetworkOutput { values: [0.0; goshawk_core::MAX_CHANNELS * goshawk_core::ANCHORS] },
        }
    }

    /// For [`goshawk_core::Planner::step`].
    #[must_use]
    pub fn as_core(&self) -> PlannerInput<'_> {
        PlannerInput {
            seq: self.seq,
            odometry: &self.odometry,
            acc_world: self.acc_world,
            speed: self.speed,
            goal_world: self.goal_world,
            network: &self.network,
        }
    }

    /// For the log.
    #[must_use]
    pub fn to_proto(&self) -> v1::PlannerInput {
        v1::PlannerInput {
            seq: self.seq,
            odometry: Some(odometry(self.seq, &self.odometry)),
            acc_world: Some(vec3(self.acc_world)),
            speed_mps: self.speed,
            goal_world: self.goal_world.map(vec3),
            state: self.state.to_vec(),
            prediction: self.network.values.to_vec(),
            nearest_mm: self.nearest.iter().flat_map(|mm| mm.to_le_bytes()).collect(),
        }
    }

    /// From the log; none: a part is missing.
    #[must_use]
    pub fn from_proto(m: &v1::PlannerInput) -> Option<Self> {
        Some(FrameInput {
            seq: m.seq,
            odometry: odometry_from(m.odometry.as_ref()?)?,
            acc_world: vector(m.acc_world?),
            speed: m.speed_mps,
            goal_world: m.goal_world.map(vector),
            nearest: nearest_from(&m.nearest_mm)?,
            state: m.state.as_slice().try_into().ok()?,
            network: NetworkOutput { values: m.prediction.as_slice().try_into().ok()? },
        })
    }
}

fn nearest_from(bytes: &[u8]) -> Option<Nearest> {
    let (depths, rest) = bytes.as_chunks::<2>();
    let nearest: Nearest = depths.iter().map(|mm| u16::from_le_bytes(*mm)).collect::<Vec<_>>().try_into().ok()?;
    rest.is_empty().then_some(nearest)
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

/// What one controller step is given besides odometry and plan themselves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepInput {
    /// Of the newest odometry.
    pub odometry_stamp: Option<Time>,
    /// Of the newest plan.
    pub plan_seq: Option<u64>,
    /// The autopilot's state.
    pub autopilot: AutopilotStatus,
    /// A command.
    pub command: Option<Command>,
    /// The checks outside the core hold.
    pub ready: bool,
}

impl StepInput {
    /// The parts of `input` that are small.
    #[must_use]
    pub fn of(input: &ControllerInput) -> Self {
        StepInput {
            odometry_stamp: input.odometry.map(|o| o.stamp),
            plan_seq: input.plan.map(|plan| plan.seq),
            autopilot: input.autopilot,
            command: input.command,
            ready: input.ready,
        }
    }

    /// With odometry and plan again.
    #[must_use]
    pub fn as_core<'a>(&self, odometry: Option<&'a Odometry>, plan: Option<&'a Plan>) -> ControllerInput<'a> {
        ControllerInput { odometry, plan, autopilot: self.autopilot, command: self.command, ready: self.ready }
    }

    /// For the log.
    #[must_use]
    pub fn to_proto(&self, seq: u64, stamp: Time) -> v1::ControllerInput {
        v1::ControllerInput {
            seq,
            stamp_ns: stamp.0,
            plan_seq: self.plan_seq,
            connected: self.autopilot.connected,
            armed: self.autopilot.armed,
            offboard: self.autopilot.offboard,
            landed: self.autopilot.landed,
            ready: self.ready,
            start: match &self.command {
                Some(Command::Start(profile)) => Some(v1::StartProfile {
                    task: convert::task(profile.task).into(),
                    speed_mps: profile.speed,
                    height_m: profile.height,
                    goal_m: profile.goal.map(vec3),
                }),
                _ => None,
            },
            stop: self.command == Some(Command::Stop),
            odometry_ns: self.odometry_stamp.map(|stamp| stamp.0),
            battery: self.autopilot.battery,
            position: self.autopilot.position,
        }
    }

    /// From the log.
    #[must_use]
    pub fn from_proto(m: &v1::ControllerInput) -> Self {
        let start = m.start.as_ref().map(|start| {
            Command::Start(Profile {
                task: if start.task() == v1::Task::Navigate { Task::Navigate } else { Task::Track },
                speed: start.speed_mps,
                height: start.height_m,
                goal: start.goal_m.map(vector),
            })
        });
        StepInput {
            odometry_stamp: m.odometry_ns.map(Time),
            plan_seq: m.plan_seq,
            autopilot: AutopilotStatus {
                connected: m.connected,
                armed: m.armed,
                offboard: m.offboard,
                landed: m.landed,
                battery: m.battery,
                position: m.position,
            },
            command: start.or(m.stop.then_some(Command::Stop)),
            ready: m.ready,
        }
    }
}

/// The controller with the rule that makes a flight a function of its log: a start from `Ready` begins with a
/// controller that knows nothing of what was before.
#[derive(Clone, Debug)]
pub struct FlightController {
    fresh: Controller,
    current: Controller,
    /// Asked first whether it would start.
    next: Controller,
}

impl FlightController {
    /// In `Idle`.
    ///
    /// # Errors
    /// A value that cannot be flown with.
    pub fn new(config: ControllerConfig) -> Result<Self, ConfigError> {
        let fresh = Controller::new(config)?;
        Ok(FlightController { current: fresh.clone(), next: fresh.clone(), fresh })
    }

    /// One tick at `now`. Allocates nothing.
    pub fn step(&mut self, now: Time, input: &ControllerInput) -> ControllerOutput {
        if matches!(input.command, Some(Command::Start(_))) && self.current.mode() == Mode::Ready {
            let uncommanded = ControllerInput { command: None, ..*input };
            self.next.clone_from(&self.fresh);
            self.next.step(now, &uncommanded); // to Ready, if it is
            let output = self.next.step(now, input);
            if output.reply == Some(Ok(())) {
                std::mem::swap(&mut self.current, &mut self.next);
                return output;
            }
            // A refused start changes nothing: what was still to be done is done, and a change of mode is told.
            return ControllerOutput { reply: output.reply, ..self.current.step(now, &uncommanded) };
        }
        self.current.step(now, input)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prost::Message;

    #[test]
    fn a_frames_input_comes_back_from_the_log_bit_for_bit() {
        let at_stamp = Odometry {
            stamp: Time(7),
            pos_world: Vec3::new(0.1, -0.0, 1e-310),
            vel_world: Vec3::new(-1.0 / 3.0, 0.0, f64::MIN_POSITIVE),
            world_from_body: Rot::from_euler_angles(0.1, -0.2, 3.0),
            ang_vel_body: Vec3::new(-0.0, 1.0, 2.0),
            reset_counter: 3,
        };
        let demand = PlanningDemand { task: Task::Navigate, speed: 6.1, goal_world: Some(Vec3::x()) };
        let nearest = std::array::from_fn(|block| 7 * block as u16);
        let mut input = FrameInput::new(5, &at_stamp, Vec3::new(-0.0, 0.7, 0.1), &demand, nearest);
        input.state[3] = -0.0;
        input.network.values[17] = -0.0;
        let bytes = input.to_proto().encode_to_vec();
        let back = FrameInput::from_proto(&v1::PlannerInput::decode(bytes.as_slice()).unwrap()).unwrap();
        assert_eq!(format!("{back:?}"), format!("{input:?}"), "Debug tells -0 from 0");
    }

    #[test]
    fn a_start_that_is_refused_in_ready_leaves_the_controller_as_it_is_and_tells_its_change_of_mode() {
        let path = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../vehicles/sim.toml"));
        let vehicle = crate::config::Vehicle::load(path).unwrap();
        let mut controller = FlightController::new(vehicle.controller_config()).unwrap();
        let zero = Vec3::zeros();
        let odometry = Odometry {
            stamp: Time(1_000_000_000),
            pos_world: zero,
            vel_world: zero,
            world_from_body: Rot::identity(),
            ang_vel_body: zero,
            reset_counter: 0,
        };
        let autopilot = AutopilotStatus { connected: true, landed: Some(true), ..AutopilotStatus::default() };
        let standing = ControllerInput { odometry: Some(&odometry), plan: None, autopilot, command: None, ready: true };
        assert_eq!(controller.step(Time(1_000_000_000), &standing).mode, Mode::Ready);
        let lost = AutopilotStatus { position: Some(false), ..autopilot };
        let command = vehicle.profile(None).map(Command::Start);
        let output = controller.step(Time(1_005_000_000), &ControllerInput { autopilot: lost, command, ..standing });
        assert_eq!(output.reply, Some(Err(goshawk_core::Refusal::NoPosition)));
        let told = output.transition.map(|t| (t.from, t.to, t.cause));
        assert_eq!(told, Some((Mode::Ready, Mode::Idle, goshawk_core::Cause::CheckFailed)));
    }

    #[test]
    fn a_steps_input_comes_back_from_the_log() {
        let profile = Profile { task: Task::Navigate, speed: 5.0, height: 1.5, goal: Some(Vec3::x()) };
        for command in [None, Some(Command::Stop), Some(Command::Start(profile))] {
            let input = StepInput {
                odometry_stamp: Some(Time(0)),
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
            assert_eq!(StepInput::from_proto(&input.to_proto(1, Time(2))), input);
        }
    }
}
