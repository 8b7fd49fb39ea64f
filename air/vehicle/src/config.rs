//! The vehicle file: what is measured on a vehicle, and the tuning file that it names. Read, checked, and turned into
//! what the core is configured with.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use goshawk_autopilot::{AutopilotError, HeartbeatKind, LinkConfig, SigningConfig, SigningKey, StreamRates};
use goshawk_core::{
    Airframe, CameraModel, ConfigError, ControllerConfig, LimitsConfig, PlannerConfig, PolicyModel, Profile, Rot, Task,
    Tuning, Vec3, ViewConfig, within,
};
use goshawk_policy::PolicyError;
use schemars::JsonSchema;
use serde::Deserialize;
use serde::de::DeserializeOwned;

mod autopilot;
pub mod reference;
mod schema;
mod sections;
mod switch;

pub use autopilot::{Autopilot, VISION_HZ};
pub use sections::{Camera, Mounting, Network, OdometrySource, Policy, Realtime, Recorder, Sensors};
pub use switch::{Position, Switch};

use sections::ProfileRow;

/// Why a vehicle file, or the tuning file that it names, cannot be flown with.
#[derive(Debug, thiserror::Error)]
pub enum VehicleError {
    /// It cannot be read.
    #[error("cannot read the {what} {path}: {cause}")]
    Read {
        /// Which of the two files.
        what: &'static str,
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

/// A vehicle file: what is measured on one vehicle.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Vehicle {
    /// The vehicle's name on the network.
    pub name: String,
    /// The profile that is flown where Start names none.
    pub default_profile: String,
    /// The tuning file: how it flies. Relative to this file.
    #[serde(rename = "tuning")]
    tuning_file: PathBuf,
    /// The airframe.
    pub airframe: Airframe,
    /// The camera as mounted.
    pub camera: Camera,
    /// The policy file and how to run it.
    pub policy: Policy,
    /// Where the autopilot is, which one it is, and who we are.
    pub autopilot: Autopilot,
    /// Where odometry comes from.
    pub sensors: Sensors,
    /// Where to listen, and who is let in.
    pub network: Network,
    /// Where logs go.
    pub recorder: Recorder,
    /// How the threads that fly are scheduled.
    pub realtime: Realtime,
    /// What no flight may exceed.
    pub limits: LimitsConfig,
    /// The pilot's switch, where there is one.
    pub switch: Option<Switch>,
    /// What Start may name.
    profile: Vec<ProfileRow>,
    /// What the tuning file says; there once the vehicle is loaded.
    #[serde(skip)]
    tuning: Option<Tuning>,
    /// The file's own text, for the log.
    #[serde(skip)]
    pub text: String,
    /// The tuning file's own text, for the log.
    #[serde(skip)]
    pub tuning_text: String,
    /// The file's folder: what relative paths start from.
    #[serde(skip)]
    pub folder: PathBuf,
    /// The file itself.
    #[serde(skip)]
    pub path: PathBuf,
}

impl Vehicle {
    /// Reads and checks a vehicle file and the tuning file that it names.
    ///
    /// # Errors
    /// Unreadable, malformed, or with a value that cannot be flown with; the message is one line.
    pub fn load(path: &Path) -> Result<Vehicle, VehicleError> {
        let text = read("vehicle file", path)?;
        let vehicle: Vehicle = parsed(&text, path)?;
        let tuning = read("tuning file", &folder_of(path).join(&vehicle.tuning_file))?;
        vehicle.with(text, tuning, path)
    }

    /// [`Self::load`] of two texts that are there already; `path` is what messages call the vehicle file and where its
    /// folder is.
    ///
    /// # Errors
    /// As there.
    pub fn parse(text: String, tuning: String, path: &Path) -> Result<Vehicle, VehicleError> {
        parsed::<Vehicle>(&text, path)?.with(text, tuning, path)
    }

    fn with(mut self, text: String, tuning_text: String, path: &Path) -> Result<Vehicle, VehicleError> {
        folder_of(path).clone_into(&mut self.folder);
        path.clone_into(&mut self.path);
        let tuning_path = self.resolve(&self.tuning_file);
        let tuning: Tuning = parsed(&tuning_text, &tuning_path)?;
        tuning.validate().map_err(|cause| VehicleError::Value { path: tuning_path, cause: cause.to_string() })?;
        self.tuning = Some(tuning);
        (self.text, self.tuning_text) = (text, tuning_text);
        self.validate().map_err(|cause| VehicleError::Value { path: path.to_owned(), cause })?;
        Ok(self)
    }

    /// What the tuning file says.
    ///
    /// # Panics
    /// Never: whoever makes a vehicle reads its tuning.
    #[must_use]
    pub fn tuning(&self) -> &Tuning {
        self.tuning.as_ref().expect("a vehicle is made with its tuning")
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
        if let Some(switch) = &self.switch {
            switch.validate()?;
            if let Some(name) = switch.profile.as_deref().filter(|name| self.profile(Some(name)).is_none()) {
                return Err(format!("switch.profile {name:?} is none of the profiles"));
            }
        }
        self.autopilot.validate(self.realtime.controller_rate_hz, self.sensors.odometry)?;
        if self.network.listen.is_empty() {
            return Err(
                "network.listen is empty; name at least one endpoint, such as \"tcp/127.0.0.1:7447\"".to_owned()
            );
        }
        let config = self.controller_config();
        config.validate().map_err(|e| e.to_string())?;
        self.validate_profiles(&config.limits)
    }

    fn validate_board(&self) -> Result<(), ConfigError> {
        let [least_hz, most_hz] = self.camera.rate_hz;
        let most = "it lies a fifth above the least, and no RGB-D camera gives more than 240 Hz";
        within("camera.rate_hz", most_hz, least_hz * 1.2..=240.0, most)?;
        let urgent = "it must be above planner_priority, and 99 is the most urgent";
        let r = &self.realtime;
        let least = f64::from(r.planner_priority) + 1.0;
        within("realtime.controller_priority", r.controller_priority.into(), least..=99.0, urgent)
    }

    fn validate_profiles(&self, limits: &LimitsConfig) -> Result<(), String> {
        for row in &self.profile {
            for x in row.goal_m.iter().flatten() {
                let (key, fence) = (format!("profile {}: goal_m", row.name), limits.fence_radius_m);
                let inside = "it must be inside the fence, from the start";
                within(&key, *x, -fence..=fence, inside).map_err(|e| e.to_string())?;
            }
            if row.task == Task::Navigate && row.goal_m.is_none() {
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

    /// The line to the autopilot that the file asks for.
    ///
    /// # Errors
    /// The signing key cannot be read.
    pub fn link(&self) -> Result<LinkConfig, AutopilotError> {
        let a = &self.autopilot;
        let signing = a.signing_key_file.as_ref().map(|file| {
            let path = self.resolve(file);
            let stamps = Some(stamps_of(&path, std::env::var_os("STATE_DIRECTORY")));
            SigningKey::load(&path).map(|key| SigningConfig { key, stamps })
        });
        Ok(LinkConfig {
            address: a.link.clone(),
            peer: a.peer,
            firmware: a.firmware(),
            signing: signing.transpose()?,
            system_id: a.system_id,
            component_id: a.component_id,
            target_system: a.target_system,
            target_component: a.target_component,
            heartbeat: HeartbeatKind::default(),
            rates: StreamRates { radio_hz: self.switch.as_ref().map(|_| RADIO_HZ), ..StreamRates::default() },
        })
    }

    /// The policy's file for a task.
    #[must_use]
    pub fn model(&self, task: Task) -> PathBuf {
        let own = self.resolve(&self.policy.model);
        match (task, &self.policy.navigate) {
            (Task::Track, _) => own,
            (Task::Navigate, Some(path)) => self.resolve(path),
            (Task::Navigate, None) => own.with_file_name("navigate.onnx"),
        }
    }

    /// Loads a model as the file has it run, with `threads` threads of the processor.
    ///
    /// # Errors
    /// As [`goshawk_policy::Policy::load_on`].
    pub fn load_policy(&self, model: &Path, threads: usize) -> Result<goshawk_policy::Policy, PolicyError> {
        let (policy, library) = (&self.policy, self.library());
        goshawk_policy::Policy::load_on(policy.provider, policy.half_precision, model, library.as_deref(), threads)
    }

    /// The file's own model is the one that it pins; a model that was named instead of it is not pinned.
    ///
    /// # Errors
    /// It is another file.
    pub fn check_pin(&self, model: &Path, policy: &goshawk_policy::Policy) -> Result<(), PolicyError> {
        if model == self.resolve(&self.policy.model) { policy.pinned(model, &self.policy.sha256) } else { Ok(()) }
    }

    /// What the tuning leaves undone that the limits ask for, for people; none: nothing.
    #[must_use]
    pub fn unkept(&self) -> Option<&'static str> {
        let off =
            "extensions.least_distance is off: nothing keeps the vehicle from its target; fly it in simulation only";
        (!self.tuning().extensions.least_distance).then_some(off)
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
            task: row.task,
            speed: row.speed_mps,
            height: row.height_m,
            goal: row.goal_m.map(Vec3::from),
        })
    }

    /// How the camera is mounted.
    #[must_use]
    pub fn body_from_cam(&self) -> Rot {
        Rot::from_axis_angle(&Vec3::y_axis(), -self.camera.tilt_deg.to_radians())
    }

    /// The planner's configuration with the policy's contract.
    #[must_use]
    pub fn planner_config(&self, policy: PolicyModel) -> PlannerConfig {
        let tuning = self.tuning().within_tilt(&self.airframe);
        PlannerConfig {
            camera: CameraModel {
                hfov: self.camera.hfov_deg.to_radians(),
                vfov: self.camera.vfov_deg.to_radians(),
                width: policy.width,
                height: policy.height,
                body_from_cam: self.body_from_cam(),
                pos_cam_body: Vec3::from(self.camera.position_m),
            },
            policy,
            planning: tuning.planner,
            extensions: tuning.extensions,
            keep_off: self.limits.min_target_distance_m,
        }
    }

    /// The controller's configuration.
    #[must_use]
    pub fn controller_config(&self) -> ControllerConfig {
        let view = ViewConfig { top: (self.camera.tilt_deg + 0.5 * self.camera.vfov_deg).to_radians() };
        ControllerConfig::new(self.airframe, self.limits, view, self.tuning())
    }
}

/// The pilot's radio is asked for so often, Hz, where a switch of it counts. Chosen by eye.
const RADIO_HZ: f64 = 20.0;

/// Where the newest stamp that was signed with a key is kept: in the service's own folder, or beside the key.
fn stamps_of(key: &Path, state_folder: Option<OsString>) -> PathBuf {
    let mut name = key.file_name().unwrap_or_default().to_owned();
    name.push(".stamp");
    state_folder.map_or_else(|| key.with_file_name(&name), |folder| Path::new(&folder).join(&name))
}

fn read(what: &'static str, path: &Path) -> Result<String, VehicleError> {
    std::fs::read_to_string(path).map_err(|cause| VehicleError::Read { what, path: path.to_owned(), cause })
}

fn folder_of(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

/// One file, its keys and the range of each number checked.
fn parsed<T: DeserializeOwned + JsonSchema>(text: &str, path: &Path) -> Result<T, VehicleError> {
    let malformed = |e| VehicleError::Parse { path: path.to_owned(), cause: parse_cause(text, &e) };
    let file = toml::from_str(text).map_err(malformed)?;
    let values = toml::from_str(text).map_err(malformed)?;
    schema::check(&values, &schema::schema::<T>())
        .map_err(|cause| VehicleError::Value { path: path.to_owned(), cause: cause.to_string() })?;
    Ok(file)
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
