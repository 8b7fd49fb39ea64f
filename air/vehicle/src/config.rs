//! The vehicle file: TOML with units in its names, checked here, turned into the core's SI configuration.

use std::path::{Path, PathBuf};

use goshawk_autopilot::Status;
use goshawk_core::{
    AutopilotStatus, CameraModel, ChaseConfig, ConfigError, ControllerConfig, GazeConfig, HoldConfig, LadderConfig,
    LagConfig, LeadConfig, LimitsConfig, MissionConfig, ObserverConfig, PlannerConfig, PlanningConfig, PolicyModel,
    Profile, Rot, SelectConfig, SeparationConfig, StopAction, TargetConfig, Task, ThrustConfig, Vec3, VehicleModel,
    ViewConfig, YawConfig, within,
};
use goshawk_policy::{PolicyError, Provider, RateLimits};
use serde::Deserialize;

mod autopilot;

pub use autopilot::Autopilot;

/// Why a vehicle file cannot be flown with.
#[derive(Debug, thiserror::Error)]
pub enum VehicleError {
    /// It cannot be read.
    #[error("cannot read the vehicle file {path}: {cause}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's words.
        cause: std::io::Error,
    },
    /// It is not TOML of this shape: an unknown or missing key, a wrong type.
    #[error("{path}: {cause}")]
    Parse {
        /// The file.
        path: PathBuf,
        /// What and where, in one line.
        cause: String,
    },
    /// A value cannot be flown with.
    #[error("{path}: {cause}")]
    Value {
        /// The file.
        path: PathBuf,
        /// Which and why.
        cause: String,
    },
}

/// A whole vehicle file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)] // one key each; air/vehicles/sim.toml comments them
pub struct Vehicle {
    pub name: String,
    pub default_profile: String,
    pub airframe: Airframe,
    pub camera: Camera,
    pub policy: Policy,
    pub autopilot: Autopilot,
    pub sensors: Sensors,
    pub network: Network,
    pub recorder: Recorder,
    pub realtime: Realtime,
    planner: Planner,
    pub controller: Controller,
    observer: Observer,
    lead: Lead,
    yaw: Yaw,
    hold: Hold,
    ladder: Ladder,
    pub mission: Mission,
    pub limits: Limits,
    profile: Vec<ProfileRow>,
    /// The file's own text, for the log.
    #[serde(skip)]
    pub text: String,
    /// The file's folder: what relative paths start from.
    #[serde(skip)]
    pub folder: PathBuf,
}

macro_rules! section {
    ($(#[$doc:meta])* $name:ident { $($field:ident: $type:ty),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Debug, Deserialize)]
        #[serde(deny_unknown_fields)]
        #[allow(missing_docs)]
        pub struct $name { $(pub $field: $type),+ }
    };
}

section! { /** The airframe. */ Airframe {
    mass_kg: f64, hover_thrust: f64, hover_thrust_range: [f64; 2], min_thrust: f64, max_thrust: f64, max_tilt_deg: f64,
} }
section! { /** The camera as mounted. */ Camera {
    hfov_deg: f64, vfov_deg: f64, tilt_deg: f64, position_m: [f64; 3], rate_hz: [f64; 2],
} }
section! { /** Where odometry comes from. */ Sensors { odometry: OdometrySource } }
section! { /** Where logs go. */ Recorder { directory: PathBuf, keep_mb: f64 } }
section! { /** The control loop. */ Controller { rate_hz: f64 } }
section! { /** Detection, the chase and the target filter. */ Planner {
    min_objectness: f64, keep_objectness: f64, standoff_m: f64, headway_s: f64, above_target_m: f64,
    max_acc_mps2: f64, max_agility: f64, remember_within_m: f64, pursue_until_s: f64,
    acc_variance_mps2: [f64; 3], lateral_variance_m2: f64, range_variance_m2: f64, doubt: f64,
    variance_distance_m: f64, gate_sigmas: f64,
    confirm_hits: u32, confirm_of: u32, confirm_objectness: f64, sure_objectness: f64, blind_time_s: f64,
    target_max_speed_mps: f64, target_max_acc_mps2: f64, target_max_distance_m: f64, reacquire_margin_m: f64,
} }
section! { /** Disturbance observer. */ Observer { alpha1: f64, alpha2: f64, zeta_s: f64, limit_mps2: f64 } }
section! { /** Lead over the attitude loop's lag. */ Lead {
    attitude_lag_s: f64, attitude_lag_range_s: [f64; 2], limit_mps2: f64,
} }
section! { /** Yaw limits and the search. */ Yaw {
    max_rate_radps: f64, max_acc_radps2: f64, lag_s: f64, search_rate_radps: f64, search_delay_s: f64,
    along_velocity_speed_mps: f64,
} }
section! { /** Braking and position hold. */ Hold {
    kp: f64, kv: f64, max_acc_horizontal_mps2: f64, max_acc_vertical_mps2: f64, stopped_speed_mps: f64,
} }
section! { /** The fallback ladder's timings. */ Ladder {
    missed_detection_s: f64, plan_stale_s: f64, no_plan_land_s: f64, odometry_stale_s: f64, descend_acc_mps2: f64,
    hand_back_s: f64,
} }
section! { /** Take-off, holding, landing. */ Mission {
    stream_before_offboard_s: f64, request_period_s: f64, request_timeout_s: f64, takeoff_ramp_s: f64,
    climb_speed_mps: f64, hold_distance_m: f64, resume_distance_m: f64, goal_radius_m: f64, search_timeout_s: f64, descent_speed_mps: f64,
    touchdown_speed_mps: f64, slow_height_m: f64, touchdown_time_s: f64, on_stop: OnStop,
} }
section! { /** What no flight may exceed. */ Limits {
    fence_radius_m: f64, ceiling_m: f64, max_speed_mps: f64, max_time_s: f64, battery_start: f64, battery_land: f64,
    min_target_distance_m: f64,
} }

/// What Stop does.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum OnStop {
    /// Brake and land.
    Land,
    /// Brake and hold the place; a second Stop lands.
    Hover,
    /// Hand over to the autopilot.
    HandOver,
}

/// Zenoh endpoints to listen on, and who is let in.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Network {
    pub listen: Vec<String>,
    /// The folder that `goshawk keys` made; absent: only this host is listened to.
    pub identity: Option<PathBuf>,
    /// Listen to whoever comes, as an operator.
    #[serde(default)]
    pub insecure: bool,
}

/// How the threads that fly are scheduled.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Realtime {
    pub controller_priority: u8,
    pub planner_priority: u8,
    /// The core that the controller runs on; absent: any.
    pub controller_core: Option<usize>,
    pub lock_memory: bool,
}

/// The policy file and how to run it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Policy {
    pub model: PathBuf,
    /// Of that file, lower-case hexadecimal; another file is not flown.
    pub sha256: String,
    pub threads: usize,
    /// What runs it; one that cannot is replaced by the processor.
    pub provider: Provider,
    /// libonnxruntime; absent: searched for.
    pub library: Option<PathBuf>,
}

/// Where odometry comes from.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum OdometrySource {
    /// The autopilot's own estimate, by MAVLink.
    #[default]
    Autopilot,
    /// `in/odometry`.
    Zenoh,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ProfileRow {
    name: String,
    task: TaskName,
    speed_mps: f64,
    height_m: f64,
    /// Forward, left, up of the start.
    goal_m: Option<[f64; 3]>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum TaskName {
    Track,
    Navigate,
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

impl Vehicle {
    /// Reads and checks a vehicle file.
    ///
    /// # Errors
    /// Unreadable, malformed, or with a value that cannot be flown with; the message is one line.
    pub fn load(path: &Path) -> Result<Vehicle, VehicleError> {
        let text =
            std::fs::read_to_string(path).map_err(|cause| VehicleError::Read { path: path.to_owned(), cause })?;
        Self::parse(text, path)
    }

    /// [`Self::load`] of a text that is there already; `path` is what messages call it and where its folder is.
    ///
    /// # Errors
    /// As there.
    pub fn parse(text: String, path: &Path) -> Result<Vehicle, VehicleError> {
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let mut vehicle: Vehicle = toml::from_str(&text)
            .map_err(|e| VehicleError::Parse { path: path.to_owned(), cause: parse_cause(&text, &e) })?;
        vehicle.text = text;
        vehicle.folder = folder;
        vehicle.validate().map_err(|cause| VehicleError::Value { path: path.to_owned(), cause })?;
        Ok(vehicle)
    }

    /// Checks what the core does not.
    fn validate(&self) -> Result<(), String> {
        self.name.parse::<goshawk_proto::keys::VehicleName>().map_err(|e| e.to_string())?;
        self.validate_board().map_err(|e| e.to_string())?;
        let hex = |c: char| c.is_ascii_digit() || ('a'..='f').contains(&c);
        if self.policy.sha256.len() != 64 || !self.policy.sha256.chars().all(hex) {
            return Err(format!(
                "policy.sha256 is {:?}; it must be the model's SHA-256, 64 digits of 0-9 and a-f, as its card has it",
                self.policy.sha256
            ));
        }
        self.autopilot.validate(self.controller.rate_hz)?;
        if self.network.listen.is_empty() {
            return Err(
                "network.listen is empty; name at least one endpoint, such as \"tcp/127.0.0.1:7447\"".to_owned()
            );
        }
        self.planning_config().validate().map_err(|e| e.to_string())?;
        let config = self.controller_config();
        config.validate().map_err(|e| e.to_string())?;
        self.validate_profiles(&config.limits)
    }

    fn validate_board(&self) -> Result<(), ConfigError> {
        let rate = "slower does not hold an attitude, faster floods the autopilot's line";
        within("controller.rate_hz", self.controller.rate_hz, 50.0..=1000.0, rate)?;
        let lens = "the network's pinhole camera sees neither less nor more";
        within("camera.hfov_deg", self.camera.hfov_deg, 30.0..=150.0, lens)?;
        within("camera.vfov_deg", self.camera.vfov_deg, 20.0..=130.0, lens)?;
        within("camera.tilt_deg", self.camera.tilt_deg, -60.0..=60.0, "it must see where it flies")?;
        for p in self.camera.position_m {
            within("camera.position_m", p, -2.0..=2.0, "it is on the airframe")?;
        }
        let [least_hz, most_hz] = self.camera.rate_hz;
        within("camera.rate_hz", least_hz, 8.0..=120.0, "at 8 Hz a plan is 0.3 s old when the next one comes")?;
        let most = "it lies a fifth above the least, and no RGB-D camera gives more than 240 Hz";
        within("camera.rate_hz", most_hz, least_hz * 1.2..=240.0, most)?;
        within("recorder.keep_mb", self.recorder.keep_mb, 0.0..=1e7, "no disk on board holds ten terabytes")?;
        let r = &self.realtime;
        let planner = f64::from(r.planner_priority);
        within("realtime.planner_priority", planner, 1.0..=98.0, "the controller's goes above it")?;
        let urgent = "it must be above planner_priority, and 99 is the most urgent";
        within("realtime.controller_priority", r.controller_priority.into(), planner + 1.0..=99.0, urgent)?;
        let core = r.controller_core.unwrap_or(0) as f64;
        within("realtime.controller_core", core, 0.0..=1023.0, "the kernel counts no more cores")?;
        within("policy.threads", self.policy.threads as f64, 1.0..=64.0, "more threads than cores only wait")
    }

    fn validate_profiles(&self, limits: &LimitsConfig) -> Result<(), String> {
        for row in &self.profile {
            let check = |key: &str, value, range, why| {
                within(&format!("profile {}: {key}", row.name), value, range, why).map_err(|e| e.to_string())
            };
            check("speed_mps", row.speed_mps, 0.5..=20.0, "no policy is trained for more, nor does less get anywhere")?;
            check("height_m", row.height_m, 0.3..=50.0, "the ground is near below, and nothing to chase is above")?;
            for x in row.goal_m.iter().flatten() {
                let inside = "it must be inside the fence, from the start";
                check("goal_m", *x, -limits.fence_radius..=limits.fence_radius, inside)?;
            }
            if matches!(row.task, TaskName::Navigate) && row.goal_m.is_none() {
                return Err(format!("profile {}: navigate needs goal_m", row.name));
            }
        }
        if self.profile(None).is_none() {
            return Err(format!("default_profile {:?} is none of the profiles", self.default_profile));
        }
        for row in &self.profile {
            let beyond = self.profile(Some(&row.name)).and_then(|profile| limits.exceeded_by(&profile));
            if let Some(why) = beyond {
                return Err(format!("profile {}: {why}", row.name));
            }
        }
        Ok(())
    }

    /// `path` as written in the file, resolved against the file's folder.
    #[must_use]
    pub fn resolve(&self, path: &Path) -> PathBuf {
        self.folder.join(path)
    }

    /// The file's own model is the one that it pins; a model that was named instead of it is not pinned.
    ///
    /// # Errors
    /// It is another file.
    pub fn check_pin(&self, model: &Path, policy: &goshawk_policy::Policy) -> Result<(), PolicyError> {
        if model == self.resolve(&self.policy.model) { policy.pinned(model, &self.policy.sha256) } else { Ok(()) }
    }

    /// Where ONNX Runtime is; none: to be searched for.
    #[must_use]
    pub fn library(&self) -> Option<PathBuf> {
        self.policy.library.as_ref().map(|path| self.resolve(path))
    }

    /// The names that Start may give, the default first.
    #[must_use]
    pub fn profile_names(&self) -> Vec<String> {
        let mut names: Vec<String> = self.profile.iter().map(|row| row.name.clone()).collect();
        names.sort_by_key(|name| *name != self.default_profile);
        names
    }

    /// The start profile of that name, or the default one.
    #[must_use]
    pub fn profile(&self, name: Option<&str>) -> Option<Profile> {
        let name = name.unwrap_or(&self.default_profile);
        self.profile.iter().find(|row| row.name == name).map(|row| Profile {
            task: match row.task {
                TaskName::Track => Task::Track,
                TaskName::Navigate => Task::Navigate,
            },
            speed: row.speed_mps,
            height: row.height_m,
            goal: row.goal_m.map(Vec3::from),
        })
    }

    /// The planner's configuration with the policy's contract.
    #[must_use]
    pub fn planner_config(&self, policy: PolicyModel) -> PlannerConfig {
        PlannerConfig {
            camera: CameraModel {
                hfov: self.camera.hfov_deg.to_radians(),
                vfov: self.camera.vfov_deg.to_radians(),
                width: policy.width,
                height: policy.height,
                body_from_cam: Rot::from_axis_angle(&Vec3::y_axis(), -self.camera.tilt_deg.to_radians()),
                pos_cam_body: Vec3::from(self.camera.position_m),
            },
            policy,
            planning: self.planning_config(),
        }
    }

    fn planning_config(&self) -> PlanningConfig {
        let p = &self.planner;
        PlanningConfig {
            target: TargetConfig {
                acc_variance: p.acc_variance_mps2,
                lateral_variance: p.lateral_variance_m2,
                range_variance: p.range_variance_m2,
                doubt: p.doubt,
                variance_distance: p.variance_distance_m,
                gate: p.gate_sigmas,
                confirm_hits: p.confirm_hits,
                confirm_of: p.confirm_of,
                confirm_objectness: p.confirm_objectness,
                sure_objectness: p.sure_objectness,
                blind_time: p.blind_time_s,
                max_speed: p.target_max_speed_mps,
                max_acc: p.target_max_acc_mps2,
                max_distance: p.target_max_distance_m,
                reacquire_margin: p.reacquire_margin_m,
            },
            select: SelectConfig { min_objectness: p.min_objectness, keep_objectness: p.keep_objectness },
            chase: ChaseConfig {
                standoff: p.standoff_m,
                headway: p.headway_s,
                height: p.above_target_m,
                pursue_until: p.pursue_until_s,
                keep_off: self.limits.min_target_distance_m,
            },
            max_acc: p.max_acc_mps2,
            max_agility: p.max_agility,
            remember: p.remember_within_m,
        }
    }

    /// The controller's configuration.
    #[must_use]
    pub fn controller_config(&self) -> ControllerConfig {
        let (a, o, y, h, l, m) = (&self.airframe, &self.observer, &self.yaw, &self.hold, &self.ladder, &self.mission);
        let limits = &self.limits;
        ControllerConfig {
            vehicle: VehicleModel {
                mass: a.mass_kg,
                hover_thrust: a.hover_thrust,
                min_thrust: a.min_thrust,
                max_thrust: a.max_thrust,
                max_tilt: a.max_tilt_deg.to_radians(),
            },
            thrust: ThrustConfig { least: a.hover_thrust_range[0], most: a.hover_thrust_range[1] },
            observer: ObserverConfig { alpha1: o.alpha1, alpha2: o.alpha2, zeta: o.zeta_s, limit: o.limit_mps2 },
            lead: LeadConfig { tau: self.lead.attitude_lag_s, limit: self.lead.limit_mps2 },
            lag: LagConfig { least: self.lead.attitude_lag_range_s[0], most: self.lead.attitude_lag_range_s[1] },
            yaw: YawConfig {
                max_rate: y.max_rate_radps,
                max_acc: y.max_acc_radps2,
                lag: y.lag_s,
                search_rate: y.search_rate_radps,
                search_delay: y.search_delay_s,
                along_velocity_speed: y.along_velocity_speed_mps,
            },
            view: ViewConfig { top: (self.camera.tilt_deg + 0.5 * self.camera.vfov_deg).to_radians() },
            gaze: GazeConfig {
                objectness: self.planner.confirm_objectness,
                target_speed: self.planner.target_max_speed_mps,
            },
            hold: HoldConfig {
                kp: h.kp,
                kv: h.kv,
                max_acc_horizontal: h.max_acc_horizontal_mps2,
                max_acc_vertical: h.max_acc_vertical_mps2,
                stopped_speed: h.stopped_speed_mps,
            },
            ladder: LadderConfig {
                missed_detection: l.missed_detection_s,
                plan_stale: l.plan_stale_s,
                no_plan_land: l.no_plan_land_s,
                odometry_stale: l.odometry_stale_s,
                descend_acc: l.descend_acc_mps2,
                hand_back: l.hand_back_s,
            },
            mission: MissionConfig {
                stream_before_offboard: m.stream_before_offboard_s,
                request_period: m.request_period_s,
                request_timeout: m.request_timeout_s,
                takeoff_ramp: m.takeoff_ramp_s,
                climb_speed: m.climb_speed_mps,
                hold_distance: m.hold_distance_m,
                resume_distance: m.resume_distance_m,
                goal_radius: m.goal_radius_m,
                search_timeout: m.search_timeout_s,
                descent_speed: m.descent_speed_mps,
                touchdown_speed: m.touchdown_speed_mps,
                slow_height: m.slow_height_m,
                touchdown_time: m.touchdown_time_s,
                on_stop: match m.on_stop {
                    OnStop::Land => StopAction::Land,
                    OnStop::Hover => StopAction::Hover,
                    OnStop::HandOver => StopAction::HandOver,
                },
            },
            limits: LimitsConfig {
                fence_radius: limits.fence_radius_m,
                ceiling: limits.ceiling_m,
                max_speed: limits.max_speed_mps,
                max_time: limits.max_time_s,
                battery_start: limits.battery_start,
                battery_land: limits.battery_land,
            },
            separation: SeparationConfig {
                min_distance: limits.min_target_distance_m,
                target_acc: self.planner.target_max_acc_mps2,
                max_acc: self.planner.max_acc_mps2,
            },
        }
    }
}

// The toml crate's message spans several lines; an operator gets one, with the line's number and text.
fn parse_cause(text: &str, error: &toml::de::Error) -> String {
    let line = error.span().map(|span| text[..span.start.min(text.len())].matches('\n').count() + 1);
    let message = error.message().replace('\n', " ");
    let Some(number) = line else { return message };
    let line = text.lines().nth(number - 1).map(|line| line.split('#').next().unwrap_or(line).trim());
    let quoted = line.filter(|line| !line.is_empty()).map(|line| format!(", in `{line}`")).unwrap_or_default();
    format!("line {number}: {message}{quoted}")
}

#[cfg(test)]
mod tests;
