//! One flight in lockstep, as fast as the machine allows: the vehicle's own planner and controller, the true physics,
//! and a verdict. A flight is a pure function of its configuration, the vehicle file and the policy.

pub mod airframe;
mod autopilot;
mod difference;
pub mod fault;
pub(crate) mod firmware;
pub mod judge;
pub(crate) mod lockstep;
pub mod onboard;
pub mod rule;
mod runner;
pub mod scene;
pub mod spent;

use goshawk_core::{
    AutopilotStatus, Cause, Command, ConfigError, ControllerOutput, FrameRecord, Imu, LimitsConfig, Mode, Odometry,
    Plan, Profile, StepInput, Task, Time, Vec3,
};
use goshawk_policy::stream::Arrival;
use goshawk_policy::{PolicyError, PreprocessError};
use goshawk_proto::v1;
use goshawk_vehicle::convert;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::actors::evader::{Course, EvaderError, EvaderState};
use crate::sense::file::Sensors;
use crate::sense::rgbd::RgbdImage;
use crate::vehicle::quadrotor::QuadrotorState;
use crate::world::{Part, World, WorldError};
pub use difference::{Difference, DifferenceError};
pub use fault::Fault;
pub use firmware::Firmware;
pub use judge::{Contact, Metrics};
pub use onboard::{Network, Onboard};
pub use scene::{CloudFile, Scene, SceneConfig, WorldSource};
pub use spent::Spent;

/// Why a flight cannot be flown at all. A flight that ends badly is no error.
#[derive(Debug, Error)]
pub enum TrialError {
    /// The forest.
    #[error(transparent)]
    World(#[from] WorldError),
    /// There is no free place to start from, or no way to any goal.
    #[error("no room in this world to fly from a start to a goal: give a larger world, or another --seed")]
    NoRoom,
    /// Too many things are to move in too small a world.
    #[error(
        "no room in this world for {0} moving obstacles: give a lower --moving, a wider --spacing, or another --seed"
    )]
    NoRoomToMove(usize),
    /// Nobody can run in it.
    #[error(transparent)]
    Evader(#[from] EvaderError),
    /// The vehicle file does not fit the policy or cannot be flown with.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The policy failed.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// The pilot cannot fly without a policy.
    #[error("this flight needs a policy: only the classical pilot's navigation does without")]
    NoPolicy,
    /// The vehicle refuses to start, or never gets ready for it.
    #[error("the vehicle refused to start at {speed_mps} m/s and {height_m} m: {why}")]
    Refused {
        /// What was asked of it, with the margin over the evader's speed, m/s.
        speed_mps: f64,
        /// Above the start, m.
        height_m: f64,
        /// Its reason, and what to change.
        why: String,
    },
    /// Physics went wrong.
    #[error(
        "the simulated vehicle's state is not a number any more {0:.1} s after its start: give less extreme options"
    )]
    NotFinite(f64),
    /// Real firmware cannot be met.
    #[error(transparent)]
    Firmware(#[from] firmware::FirmwareTrouble),
    /// The camera does not fit the policy.
    #[error(transparent)]
    Preprocess(#[from] PreprocessError),
}

/// Which software flies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PilotKind {
    /// The vehicle's own: a policy's trajectories.
    #[default]
    Policy,
    /// The baseline: a map, a search, an optimised spline.
    Classical,
}

/// Who is chased.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EvaderKind {
    /// Its run is planned before it begins, and it sees nobody.
    #[default]
    Planned,
    /// It sees the vehicle and gets away from it.
    Reactive,
}

/// From the middle of the exposure to the frame's being there for the pilot, s.
pub const FRAME_AT_PLANNER_S: f64 = 0.015;

/// The software that flies: images and state estimates in, setpoints out.
pub trait Pilot {
    /// How long [`Pilot::plan`] takes on board, s: a plan counts only then. Below 18 ms, that is within a frame.
    fn compute_s(&self) -> f64;

    /// A state estimate has come.
    fn take_odometry(&mut self, odometry: &Odometry);

    /// An inertial sample has come.
    fn take_imu(&mut self, imu: &Imu);

    /// Plans from a frame; the plan is flown once it is handed to [`Pilot::take_plan`]. None: the controller demands no
    /// plan, there is no odometry around the frame's stamp, or the frame is not to be believed.
    ///
    /// # Errors
    /// If the network fails.
    fn plan(&mut self, arrival: &Arrival, image: &RgbdImage) -> Result<Option<Plan>, TrialError>;

    /// The last plan has become available.
    fn take_plan(&mut self, plan: Plan);

    /// What it remembers to stand about it, as the `seq`-th such message; none: nothing, or it tells nobody.
    fn obstacle_map(&self, _seq: u64, _now: Time) -> Option<v1::ObstacleMap> {
        None
    }

    /// What the last [`Pilot::plan`] and the last [`Pilot::control`] cost.
    fn spent(&self) -> Spent;

    /// The newest state estimate.
    fn odometry(&self) -> Option<&Odometry>;

    /// One tick of the controller.
    fn control(&mut self, now: Time, autopilot: AutopilotStatus, command: Option<Command>) -> ControllerOutput;

    /// What is wrong with the vehicle's senses as far as it can tell, by name.
    fn faults(&self) -> Vec<&'static str> {
        Vec::new()
    }

    /// What the last plan was made from; none: by something else than the planner alone.
    fn frame_record(&self) -> Option<&FrameRecord> {
        None
    }

    /// What the last tick was given; none: it is not the controller alone that answers it.
    fn step_input(&self) -> Option<&StepInput> {
        None
    }
}

/// One flight.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialConfig {
    /// Which software flies.
    pub pilot: PilotKind,
    /// Chase or fly to a goal.
    pub task: Task,
    /// The evader's largest speed (track), or the vehicle's own desired speed (navigate), m/s.
    pub speed_mps: f64,
    /// Track: how much faster than the evader the vehicle may fly, m/s.
    pub speed_margin_mps: f64,
    /// Height of the flight above the start, m.
    pub height_m: f64,
    /// Where.
    pub world: WorldSource,
    /// Track: who runs.
    pub evader: EvaderKind,
    /// Track: what a planned evader runs.
    pub course: Course,
    /// How far ahead the goal is, the evader's or the vehicle's own; a reactive evader's whole way, m.
    pub length_m: f64,
    /// What the wind's gusts reach, m/s; 0: still air.
    pub wind_mps: f64,
    /// Camera and odometry.
    pub sensors: Sensors,
    /// How the airframe differs from the vehicle file.
    pub airframe: Difference,
    /// Moving obstacles.
    pub moving: usize,
    /// What goes wrong on the way; none: nothing does. With a fault the flight goes on until it is down: see
    /// [`Outcome`].
    pub fault: Option<Fault>,
    /// Real firmware flies the rotors; none: the autopilot is a model that grants every request at once.
    pub firmware: Option<Firmware>,
    /// Everything random is drawn from it.
    pub seed: u64,
}

impl TrialConfig {
    /// What the vehicle is asked to fly, but for the goal of a navigation, which its scene has.
    pub(crate) fn profile(&self) -> Profile {
        let margin_mps = if self.task == Task::Track { self.speed_margin_mps } else { 0.0 };
        Profile { task: self.task, speed: self.speed_mps + margin_mps, height: self.height_m, goal: None }
    }

    /// Where it is flown.
    ///
    /// # Errors
    /// As [`Scene::new`].
    pub fn scene(&self) -> Result<Scene, TrialError> {
        let (world, course) = (self.world.clone(), self.course.clone());
        let config = SceneConfig::of_task(self.task, self.speed_mps, world, course, self.seed);
        Scene::new(&SceneConfig { distance_m: self.length_m, moving: self.moving, ..config })
    }
}

/// That the vehicle may fly a profile.
///
/// # Errors
/// It goes beyond a limit, which [`TrialError::Refused`] names.
pub(crate) fn within_limits(limits: &LimitsConfig, profile: &Profile) -> Result<(), TrialError> {
    limits.exceeded_by(profile).map_or(Ok(()), |limit| {
        let why = format!("{limit}; ask for less, or raise that limit in the vehicle file");
        Err(TrialError::Refused { speed_mps: profile.speed, height_m: profile.height, why })
    })
}

/// How a flight ended, by the strict [`rule`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Outcome {
    /// The goal was reached, or the evader was followed to its end. After a fault: the vehicle is down, by itself or by
    /// the autopilot.
    Success,
    /// The vehicle touched something.
    Collision,
    /// Track: out of sight or too far away at the end, or the mission was given up.
    Lost,
    /// It took too long. After a fault: it flew on.
    Timeout,
    /// Track: the vehicle came nearer to the target than [`rule::TOO_CLOSE_M`].
    TooClose,
    /// Track: it was farther than [`rule::FAR_M`] away for longer than [`rule::FAR_S`].
    Behind,
    /// Track: too few of the frames show the target, less than [`rule::IN_VIEW`].
    OutOfView,
    /// Navigate: the goal was reached, at less than [`rule::SLOW_SHARE`] of the asked speed.
    Slow,
}

/// The record of one flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Flight {
    /// How it ended.
    pub outcome: Outcome,
    /// A success by the lax [`rule`].
    pub reached: bool,
    /// What was hit.
    pub contact: Option<Contact>,
    /// Where the vehicle was at the end.
    #[serde(with = "triple")]
    pub end_world: Vec3,
    /// Distance to the target or the goal at the end, m.
    pub end_distance_m: f64,
    /// How long it was since the target was last detected at the end, s; none: it never was.
    pub unseen_s: Option<f64>,
    /// All of it, from the Start command, s.
    pub flown_s: f64,
    /// From the task's beginning to the end, s: what moves stands where it was by then. No cell has it, so a record
    /// leaves it out.
    #[serde(skip)]
    pub stage_s: f64,
    /// Changes of mode: s since the Start command, what to, why.
    pub modes: Vec<(f64, Mode, Cause)>,
    /// When the fault began, s since the Start command; none: it never did.
    pub fault_at_s: Option<f64>,
    /// What the vehicle found wrong with its senses: s since the Start command, by what name. No cell
    /// has anything of it, so a record leaves it out.
    #[serde(skip)]
    pub named: Vec<(f64, &'static str)>,
    /// What was measured.
    pub metrics: Metrics,
}

/// A vector as a record has it: three numbers.
mod triple {
    use goshawk_core::Vec3;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<S: Serializer>(vector: &Vec3, to: S) -> Result<S::Ok, S::Error> {
        <[f64; 3]>::from(*vector).serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec3, D::Error> {
        <[f64; 3]>::deserialize(from).map(Vec3::from)
    }
}

/// True places at one instant, for a [`Witness`].
#[derive(Clone, Copy, Debug)]
pub struct Truth<'a> {
    /// The vehicle.
    pub vehicle: &'a QuadrotorState,
    /// The evader.
    pub evader: Option<EvaderState>,
    /// The moving obstacles.
    pub moving: &'a [Part],
    /// From the vehicle's sphere to the nearest obstacle, m.
    pub clearance_m: f64,
    /// How often it touched something so far.
    pub collisions: u32,
    /// The last frame showed the target.
    pub visible: bool,
    /// On the ground, where a navigation leads; none: somebody is chased.
    pub goal_world: Option<Vec3>,
}

/// Someone who records a flight. All methods do nothing unless they are overridden.
pub trait Witness {
    /// Where it will be flown, once, before all else.
    fn world(&mut self, world: &World) {
        let _ = world;
    }
    /// A step of the controller.
    fn control(&mut self, now: Time, output: &ControllerOutput, onboard: &dyn Pilot) {
        let _ = (now, output, onboard);
    }
    /// A frame was exposed.
    fn frame(&mut self, seq: u64, stamp: Time, image: &RgbdImage) {
        let _ = (seq, stamp, image);
    }
    /// A plan became available at `ready`.
    fn plan(&mut self, ready: Time, plan: &Plan, record: Option<&FrameRecord>) {
        let _ = (ready, plan, record);
    }
    /// A plan was made, and cost this much.
    fn spent(&mut self, spent: &Spent) {
        let _ = spent;
    }
    /// The truth, 20 times a second.
    fn truth(&mut self, now: Time, truth: &Truth<'_>) {
        let _ = (now, truth);
    }
    /// How it ended, last.
    fn verdict(&mut self, now: Time, outcome: Outcome, contact: Option<Contact>) {
        let _ = (now, outcome, contact);
    }
}

/// Nobody looks.
pub struct Unwatched;
impl Witness for Unwatched {}

impl Truth<'_> {
    /// As the wire has it.
    #[must_use]
    pub fn to_proto(&self, now: Time) -> v1::SimTruth {
        let evader = self.evader.as_ref();
        let centre = evader.map(EvaderState::centre_world);
        v1::SimTruth {
            stamp_ns: now.0,
            pos_world: Some(convert::vec3(self.vehicle.pos_world)),
            world_from_body: Some(convert::quat(self.vehicle.world_from_body)),
            vel_world: Some(convert::vec3(self.vehicle.vel_world)),
            target_pos_world: centre.map(convert::vec3),
            target_vel_world: evader.map(|e| convert::vec3(e.vel_world)),
            clearance_m: self.clearance_m,
            collisions: self.collisions,
            target_distance_m: centre.map_or(0.0, |c| (c - self.vehicle.pos_world).norm()),
            target_path_m: evader.map_or(0.0, |e| e.path_m),
            target_arrived: evader.is_some_and(|e| e.arrived),
            target_visible: self.visible,
            moving: self.moving.iter().map(|part| part.shape.around().to_proto()).collect(),
            acc_world: Some(convert::vec3(self.vehicle.acc_world)),
            goal_world: self.goal_world.map(convert::vec3),
        }
    }
}
