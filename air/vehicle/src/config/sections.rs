//! The sections of the vehicle file that concern what flies the vehicle, not how: each key with its range and why.

use std::path::PathBuf;

use goshawk_autopilot::Status;
use goshawk_core::{AutopilotStatus, Task};
use goshawk_policy::{Provider, RateLimits};
use schemars::JsonSchema;
use serde::Deserialize;

/// The camera as mounted.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Horizontal field of view, degrees: of the camera, after any cropping.
    #[schemars(range(min = 30.0, max = 150.0), extend("x-why" = "the network's pinhole camera sees neither less nor more", "x-source" = "the data sheet, less what is cropped; shipped: the paper's 90 degrees"))]
    pub hfov_deg: f64,
    /// Vertical field of view, degrees.
    #[schemars(range(min = 20.0, max = 130.0), extend("x-why" = "the network's pinhole camera sees neither less nor more", "x-source" = "the data sheet, less what is cropped; shipped: 160 x 96 square pixels of 90 degrees"))]
    pub vfov_deg: f64,
    /// Tilt of the optical axis, degrees, up: braking pitches the camera up, starting pitches it down.
    #[schemars(range(min = -60.0, max = 60.0), extend("x-why" = "it must see where it flies", "x-source" = "measure it; shipped: tried, notebook, What mattered: The camera's tilt"))]
    pub tilt_deg: f64,
    /// Of the lens from the centre of mass, m: forward, left, up.
    #[schemars(inner(range(min = -2.0, max = 2.0)), extend("x-why" = "it is on the airframe", "x-source" = "measure it; shipped: chosen by eye"))]
    pub position_m: [f64; 3],
    /// Pictures a second, least and most: fewer are too few to fly with, more are not one camera's.
    #[schemars(inner(range(min = 8.0, max = 240.0)), extend("x-why" = "at 8 Hz a plan is 0.3 s old when the next one comes, and no RGB-D camera gives more than 240 Hz", "x-source" = "the camera's setting; shipped: chosen by eye"))]
    pub rate_hz: [f64; 2],
    /// Pixels of the network's image at its border where depth may be missing, because its lenses see less than the image:
    /// there the network is shown what is measured beside it. Absent: none.
    #[serde(default)]
    #[schemars(range(min = 0, max = 16), extend("x-why" = "without it a rim that is not measured looks free, and more would invent what was never seen", "x-source" = "the share that goshawk-camera check says depth sees; shipped: D435 and D455 leave 4, and their edge is ragged"))]
    pub depth_rim_px: usize,
}

/// The policy file and how to run it.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Policy {
    /// The policy, an ONNX file, relative to this file. Its golden images lie beside it.
    pub model: PathBuf,
    /// SHA-256 of that file, lower-case hexadecimal, as its card has it. Another file is not flown.
    pub sha256: String,
    /// What the simulator navigates with, relative to this file; absent: `navigate.onnx` beside the model.
    pub navigate: Option<PathBuf>,
    /// Threads that run the network on the processor.
    #[schemars(range(min = 1, max = 64), extend("x-why" = "more threads than cores only wait", "x-source" = "as `make bench` times the policy"))]
    pub threads: usize,
    /// What runs it. Where that cannot be, the processor does, and `goshawk-air check` says why.
    pub provider: Provider,
    /// TensorRT and OpenVINO calculate in 16 bits, which is faster where the device has instructions for it. The others
    /// do not, whatever this says. Absent: in 32.
    #[serde(default)]
    pub half_precision: bool,
    /// libonnxruntime, relative to this file; absent: it is searched for.
    pub library: Option<PathBuf>,
}

/// Where odometry comes from.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sensors {
    /// The source.
    pub odometry: OdometrySource,
    /// Whether Start wants the frames checked by hand, by `goshawk-air check --frames`; absent: it does.
    #[serde(default)]
    pub mounting: Mounting,
}

/// Where to listen, and who is let in.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Network {
    /// Zenoh endpoints. "tcp/127.0.0.1:7447" is this host alone; for others "tls/0.0.0.0:7447" and an identity.
    pub listen: Vec<String>,
    /// The folder that `goshawk keys` made; absent: only this host is listened to.
    pub identity: Option<PathBuf>,
    /// Listen to whoever comes, as an operator.
    #[serde(default)]
    pub insecure: bool,
}

/// Where logs go.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Recorder {
    /// The folder, relative to this file.
    pub directory: PathBuf,
    /// At a start the oldest logs go, so that those of before hold no more than this, MB.
    #[schemars(range(min = 0.0, max = 10_000_000.0), extend("x-why" = "no disk on board holds ten terabytes", "x-source" = "chosen by eye: three hours of flights"))]
    pub keep_mb: f64,
}

/// How the threads that fly are scheduled. A priority that is refused is said, and flown without.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Realtime {
    /// Steps of the controller a second; each sends a setpoint.
    #[schemars(range(min = 50.0, max = 1000.0), extend("x-why" = "slower does not hold an attitude, faster floods the autopilot's line", "x-source" = "chosen by eye"))]
    pub controller_rate_hz: f64,
    /// SCHED_FIFO priority of the controller.
    #[schemars(range(min = 2, max = 99), extend("x-why" = "it must be above planner_priority, and 99 is the most urgent", "x-source" = "chosen by eye"))]
    pub controller_priority: u8,
    /// SCHED_FIFO priority of the planner.
    #[schemars(range(min = 1, max = 98), extend("x-why" = "the controller's goes above it", "x-source" = "chosen by eye"))]
    pub planner_priority: u8,
    /// The core that the controller runs on, best one that the kernel keeps free (isolcpus); absent: any.
    #[schemars(range(min = 0, max = 1023), extend("x-why" = "the kernel counts no more cores", "x-source" = "the board's isolcpus; shipped without"))]
    pub controller_core: Option<usize>,
    /// Keep the process in memory.
    pub lock_memory: bool,
}

/// Where odometry comes from.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum OdometrySource {
    /// The autopilot's own estimate, by MAVLink.
    #[default]
    Autopilot,
    /// The topic `in/odometry`.
    Zenoh,
}

/// Who vouches for how camera and autopilot are mounted.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum Mounting {
    /// A person did, once: without that Start is refused.
    #[default]
    Checked,
    /// A simulator mounts them as the file says.
    Simulated,
}

/// What Start may name.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct ProfileRow {
    /// Its name.
    pub(super) name: String,
    /// What to do.
    pub(super) task: Task,
    /// Speed, m/s: a navigation cruises at it, and a chase, which wants about twice its target's, flies no faster.
    #[schemars(range(min = 0.5, max = 20.0), extend("x-why" = "no policy is trained for more, nor does less get anywhere", "x-source" = "twice a target of 3 m/s"))]
    pub(super) speed_mps: f64,
    /// Height above the start to climb to, m.
    #[schemars(range(min = 0.3, max = 50.0), extend("x-why" = "the ground is near below, and nothing to chase is above", "x-source" = "chosen by eye"))]
    pub(super) height_m: f64,
    /// Navigation's goal from the start, m: forward, left, up.
    #[schemars(inner(range(min = -10000.0, max = 10000.0)), extend("x-why" = "it must be inside the fence, from the start", "x-source" = "the place of the flight; shipped without"))]
    pub(super) goal_m: Option<[f64; 3]>,
}

impl OdometrySource {
    /// What concerns the controller of the autopilot's state. Of its position only where it is flown by: with odometry
    /// of our own, the autopilot may well have none.
    #[must_use]
    pub fn concerning(self, status: &Status) -> AutopilotStatus {
        let status = status.core();
        let position = status.position.filter(|_| self == OdometrySource::Autopilot);
        AutopilotStatus { position, ..status }
    }
}

impl Camera {
    /// How often its pictures may come.
    #[must_use]
    pub fn rates(&self) -> RateLimits {
        let [least_hz, most_hz] = self.rate_hz;
        RateLimits { least_hz, most_hz }
    }
}
