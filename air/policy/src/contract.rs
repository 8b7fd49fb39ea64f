//! The policy contract: what an exported ONNX file says of itself, and whether this software can honour it.
//!
//! It is JSON under the ONNX metadata key `goshawk_contract`. A field that is not known here is refused, except inside
//! `training`: a newer exporter must raise `version` when it changes what the numbers mean.

use goshawk_core::{PolicyModel, StateLayout, Task};
use serde::{Deserialize, Serialize};

/// The ONNX metadata key that holds the contract.
pub const METADATA_KEY: &str = "goshawk_contract";
/// The only contract version that this software honours.
pub const VERSION: u32 = 2;
/// T of the network's trajectories, as text (§III-B).
pub const DURATION_RULE: &str = "2r/(alpha*v_max)";
/// Grid rows, top to bottom.
pub const ROWS: usize = 3;
/// Grid columns, left to right.
pub const COLUMNS: usize = 5;
/// Pixels of a grid cell's side: the network's downsampling.
pub const CELL_PX: usize = 32;

const NAVIGATE_CHANNELS: [&str; 10] = ["theta", "phi", "r", "vx", "vy", "vz", "ax", "ay", "az", "cost"];
const TARGET_CHANNELS: [&str; 4] = ["objectness", "du", "dv", "distance"];

/// The whole contract, as the file has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contract {
    /// Version of this schema.
    pub version: u32,
    /// What the policy was trained for.
    pub task: PolicyTask,
    /// The network's image.
    pub image: Image,
    /// How depth is prepared.
    pub depth: Depth,
    /// The anchors of eq. 3 and 6.
    pub lattice: Lattice,
    /// Largest speed in training, m/s.
    pub v_max_mps: f64,
    /// Largest acceleration in training, m/s².
    pub a_max_mps2: f64,
    /// T of the trajectories; only [`DURATION_RULE`] is honoured.
    pub duration_rule: String,
    /// Metres for one unit of softplus(y_d).
    pub target_depth_scale_m: f64,
    /// How far apart the costs of an image's candidates are: the median over held-out scenes of the dearest less the
    /// cheapest, measured at export.
    pub cost_scale: f64,
    /// What the `state` input holds, in order: velocity and acceleration (the paper's), then of up, aim or direction, and
    /// agility what it has. Vectors are three numbers; the agility is one.
    pub state: Vec<String>,
    /// The channels of the output in order.
    pub channels: Vec<String>,
    /// Upward tilt of the training camera, rad. Advice: the network sees the true up in `state`.
    pub camera_tilt_rad: f64,
    /// Where it comes from; not interpreted.
    pub training: serde_json::Map<String, serde_json::Value>,
}

/// [`Task`], as the contract spells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PolicyTask {
    /// Chase the detected target.
    Track,
    /// Fly to a goal.
    Navigate,
}

/// The network's image, and the field of view that it was trained with.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Image {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Horizontal field of view, rad.
    pub hfov_rad: f64,
    /// Vertical field of view, rad.
    pub vfov_rad: f64,
}

/// How depth is prepared; see [`crate::preprocess`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Depth {
    /// Nearer counts as no measurement, m.
    pub min_m: f64,
    /// Farther is clipped to this, m.
    pub max_m: f64,
    /// Passes of hole filling.
    pub fill_passes: u32,
}

/// The anchors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lattice {
    /// Rows of the grid.
    pub rows: usize,
    /// Columns of the grid.
    pub columns: usize,
    /// r, m.
    pub radius_m: f64,
    /// d_theta, rad.
    pub elevation_offset_rad: f64,
    /// d_phi, rad.
    pub azimuth_offset_rad: f64,
}

/// Why a contract cannot be honoured.
#[derive(Debug, thiserror::Error)]
pub enum ContractError {
    /// Not JSON, a field is missing, of the wrong type, or unknown.
    #[error("not a version {VERSION} contract: {}", one_line(.0))]
    Fields(#[from] serde_json::Error),
    /// The schema is another one.
    #[error(
        "contract version {found}, this software honours {VERSION}: export the policy again, or update the software"
    )]
    Version {
        /// The file's.
        found: u64,
    },
    /// A field says what this software does not do.
    #[error("contract field {field} is {found}, this software needs {needed}")]
    Value {
        /// Path of the field.
        field: &'static str,
        /// The file's value.
        found: String,
        /// What would do.
        needed: String,
    },
}

/// An unknown field's name is quoted as it is, line breaks included.
fn one_line(error: &serde_json::Error) -> String {
    error.to_string().replace(char::is_control, " ")
}

/// Only the version, whatever else there is.
#[derive(Deserialize)]
struct Versioned {
    version: u64,
}

impl Contract {
    /// Reads and validates a contract's JSON.
    ///
    /// # Errors
    /// Another version, missing or unknown fields, or values that this software cannot honour; the version comes first.
    pub fn from_json(json: &str) -> Result<Self, ContractError> {
        let Versioned { version } = serde_json::from_str(json)?;
        if version != u64::from(VERSION) {
            return Err(ContractError::Version { found: version });
        }
        let contract: Self = serde_json::from_str(json)?;
        contract.validate()?;
        Ok(contract)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// The first field that this software cannot honour.
    pub fn validate(&self) -> Result<(), ContractError> {
        if self.version != VERSION {
            return Err(ContractError::Version { found: u64::from(self.version) });
        }
        let right_angle = std::f64::consts::FRAC_PI_2;
        same("lattice.rows", &self.lattice.rows, &ROWS)?;
        same("lattice.columns", &self.lattice.columns, &COLUMNS)?;
        same("image.width", &self.image.width, &(COLUMNS * CELL_PX))?;
        same("image.height", &self.image.height, &(ROWS * CELL_PX))?;
        within("image.hfov_rad", self.image.hfov_rad, 0.1, 3.0)?;
        within("image.vfov_rad", self.image.vfov_rad, 0.1, 3.0)?;
        within("depth.max_m", self.depth.max_m, 0.001, 65.534)?;
        within("depth.min_m", self.depth.min_m, 0.0, self.depth.max_m)?;
        within("depth.fill_passes", f64::from(self.depth.fill_passes), 0.0, 16.0)?;
        within("lattice.radius_m", self.lattice.radius_m, 0.1, 100.0)?;
        within("lattice.elevation_offset_rad", self.lattice.elevation_offset_rad, 0.0, right_angle)?;
        within("lattice.azimuth_offset_rad", self.lattice.azimuth_offset_rad, 0.0, right_angle)?;
        within("v_max_mps", self.v_max_mps, 0.1, 100.0)?;
        within("a_max_mps2", self.a_max_mps2, 0.1, 1000.0)?;
        same("duration_rule", &self.duration_rule.as_str(), &DURATION_RULE)?;
        within("target_depth_scale_m", self.target_depth_scale_m, 0.01, 100.0)?;
        within("cost_scale", self.cost_scale, 1e-3, 1e6)?;
        self.validate_state()?;
        same("channels", &self.channels, &expected_channels(self.task))?;
        within("camera_tilt_rad", self.camera_tilt_rad, -right_angle, right_angle)
    }

    /// Numbers of the `state` input.
    #[must_use]
    pub fn state_len(&self) -> usize {
        self.layout().numbers()
    }

    fn layout(&self) -> StateLayout {
        let held = |name: &str| self.state.iter().any(|held| held == name);
        StateLayout { up: held("up"), aim: held("aim"), direction: held("direction"), agility: held("agility") }
    }

    fn validate_state(&self) -> Result<(), ContractError> {
        let layout = self.layout();
        same("state", &self.state, &layout.names().collect::<Vec<_>>())?;
        let led = usize::from(layout.aim) + usize::from(layout.direction);
        if led == 1 || (led == 0 && self.task == PolicyTask::Track) {
            return Ok(());
        }
        let needed = "an aim or a direction, not both; tracking alone may have neither".to_owned();
        Err(ContractError::Value { field: "state", found: format!("{:?}", self.state), needed })
    }

    /// What the core's planner needs to know of it.
    #[must_use]
    pub fn model(&self) -> PolicyModel {
        PolicyModel {
            task: match self.task {
                PolicyTask::Track => Task::Track,
                PolicyTask::Navigate => Task::Navigate,
            },
            state: self.layout(),
            radius: self.lattice.radius_m,
            azimuth_offset: self.lattice.azimuth_offset_rad,
            elevation_offset: self.lattice.elevation_offset_rad,
            v_max: self.v_max_mps,
            a_max: self.a_max_mps2,
            target_depth_scale: self.target_depth_scale_m,
            cost_scale: self.cost_scale,
            hfov: self.image.hfov_rad,
            vfov: self.image.vfov_rad,
            width: self.image.width as u32,
            height: self.image.height as u32,
        }
    }
}

fn expected_channels(task: PolicyTask) -> Vec<&'static str> {
    let target: &[&str] = if task == PolicyTask::Track { &TARGET_CHANNELS } else { &[] };
    [&NAVIGATE_CHANNELS, target].concat()
}

fn same<A, B>(field: &'static str, found: &A, needed: &B) -> Result<(), ContractError>
where
    A: PartialEq<B> + std::fmt::Debug,
    B: std::fmt::Debug,
{
    if found == needed {
        return Ok(());
    }
    Err(ContractError::Value { field, found: format!("{found:?}"), needed: format!("{needed:?}") })
}

fn within(field: &'static str, found: f64, lowest: f64, highest: f64) -> Result<(), ContractError> {
    if (lowest..=highest).contains(&found) {
        return Ok(());
    }
    Err(ContractError::Value { field, found: found.to_string(), needed: format!("{lowest}..={highest}") })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn track() -> Value {
        serde_json::from_str(include_str!("../tests/contract.json")).unwrap()
    }

    fn read(value: &Value) -> Result<Contract, ContractError> {
        Contract::from_json(&value.to_string())
    }

    /// The track contract with one field replaced.
    fn with(pointer: &str, value: Value) -> Value {
        let mut contract = track();
        *contract.pointer_mut(pointer).unwrap() = value;
        contract
    }

    #[test]
    fn the_numbers_reach_the_planner() {
        let contract = read(&with("/lattice/azimuth_offset_rad", json!(0.3))).unwrap();
        let model = contract.model();
        assert_eq!((model.task, model.width, model.height), (Task::Track, 160, 96));
        assert_eq!((model.azimuth_offset, model.elevation_offset), (0.3, 15f64.to_radians()));
        assert_eq!((model.radius, model.hfov), (5.0, std::f64::consts::FRAC_PI_2));
        assert_eq!(model.vfov, 2.0 * (48f64 / 80.0).atan());
        assert_eq!((model.v_max, model.a_max, model.target_depth_scale), (6.0, 6.0, 5.0));
        assert_eq!(model.cost_scale, 6.0);
        assert_eq!(contract.state_len(), 13);
    }

    #[test]
    fn a_navigation_contract_has_no_target() {
        let mut contract = track();
        contract["task"] = json!("navigate");
        contract["channels"] = json!(NAVIGATE_CHANNELS);
        let contract = read(&contract).unwrap();
        assert_eq!((contract.model().task, contract.state_len()), (Task::Navigate, 13));
    }

    #[test]
    fn the_papers_state_of_six_numbers_is_honoured_in_tracking_and_leads_nowhere_in_navigation() {
        let mut contract = with("/state", json!(["velocity", "acceleration"]));
        assert_eq!(read(&contract).unwrap().state_len(), 6);
        contract["task"] = json!("navigate");
        contract["channels"] = json!(NAVIGATE_CHANNELS);
        assert!(read(&contract).unwrap_err().to_string().contains("an aim or a direction"));
        contract["state"] = json!(["velocity", "acceleration", "direction"]);
        assert_eq!(read(&contract).unwrap().state_len(), 9);
    }

    #[test]
    fn another_version_is_named_even_when_the_fields_are_unknown() {
        let error = Contract::from_json(r#"{"version": 3, "novelty": true}"#).unwrap_err();
        assert!(matches!(error, ContractError::Version { found: 3 }), "{error}");
        assert!(error.to_string().contains("honours 2"));
    }

    #[test]
    fn an_unknown_field_is_named() {
        for pointer in ["", "/image", "/depth", "/lattice"] {
            let mut contract = track();
            let object = contract.pointer_mut(pointer).unwrap().as_object_mut().unwrap();
            object.insert("novelty".into(), json!(1));
            assert!(read(&contract).unwrap_err().to_string().contains("unknown field `novelty`"));
        }
    }

    #[test]
    fn an_unknown_field_with_a_line_break_in_its_name_is_refused_in_one_line() {
        let mut contract = track();
        contract["chan\nels"] = json!(1);
        let message = read(&contract).unwrap_err().to_string();
        assert!(message.contains("unknown field `chan els`") && message.lines().count() == 1, "{message}");
    }

    #[test]
    fn training_may_say_anything() {
        read(&with("/training", json!({"novelty": [1, 2]}))).unwrap();
    }

    #[test]
    fn a_missing_field_is_named() {
        for field in track().as_object().unwrap().keys() {
            let mut contract = track();
            contract.as_object_mut().unwrap().remove(field);
            assert!(read(&contract).unwrap_err().to_string().contains(field.as_str()), "{field}");
        }
    }

    #[test]
    fn a_value_that_cannot_be_honoured_is_named_with_what_is_needed() {
        let cases = [
            ("/image/width", json!(320), "image.width is 320, this software needs 160"),
            ("/image/height", json!(90), "image.height is 90, this software needs 96"),
            ("/image/hfov_rad", json!(0.0), "image.hfov_rad"),
            ("/image/vfov_rad", json!(3.2), "image.vfov_rad"),
            ("/depth/max_m", json!(100.0), "depth.max_m"),
            ("/depth/min_m", json!(-0.1), "depth.min_m"),
            ("/depth/min_m", json!(21.0), "depth.min_m"),
            ("/depth/fill_passes", json!(17), "depth.fill_passes"),
            ("/lattice/rows", json!(4), "lattice.rows"),
            ("/lattice/columns", json!(4), "lattice.columns"),
            ("/lattice/radius_m", json!(0), "lattice.radius_m"),
            ("/lattice/elevation_offset_rad", json!(1.6), "lattice.elevation_offset_rad"),
            ("/lattice/azimuth_offset_rad", json!(-0.1), "lattice.azimuth_offset_rad"),
            ("/v_max_mps", json!(0.0), "v_max_mps"),
            ("/a_max_mps2", json!(-6.0), "a_max_mps2"),
            ("/duration_rule", json!("r/v"), "duration_rule"),
            ("/target_depth_scale_m", json!(0.0), "target_depth_scale_m"),
            ("/cost_scale", json!(0.0), "cost_scale"),
            ("/state", json!(["velocity", "up", "aim", "agility"]), "state"),
            ("/state", json!(["velocity", "acceleration", "agility", "aim"]), "state"),
            ("/state", json!(["velocity", "acceleration", "aim", "direction"]), "not both"),
            ("/channels", json!(NAVIGATE_CHANNELS), "channels"),
            ("/camera_tilt_rad", json!(1.6), "camera_tilt_rad"),
            ("/task", json!("land"), "unknown variant `land`"),
        ];
        for (pointer, value, said) in cases {
            let message = read(&with(pointer, value)).unwrap_err().to_string();
            assert!(message.contains(said), "{pointer}: {message}");
        }
    }
}
