//! What the simulated vehicle senses with: one TOML file for camera, odometry and IMU, and its overrides.

use clap::Args;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use thiserror::Error;

use crate::render::Camera;
use crate::sense::odometry::OdometryConfig;
use crate::sense::rgbd::{ColourConfig, DepthConfig, Sensor, ViewConfig};
use crate::vehicle::imu::ImuConfig;

/// The shipped file: a RealSense D455 with sources.
const D455: &str = include_str!("../../sensors/d455.toml");

/// Every sensor's parameters.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensors {
    /// How much of the image the lenses see; absent: all of it.
    #[serde(default)]
    pub view: ViewConfig,
    /// The depth image.
    pub depth: DepthConfig,
    /// The colour image.
    pub colour: ColourConfig,
    /// The state estimate.
    pub odometry: OdometryConfig,
    /// Accelerometer and gyroscope.
    pub imu: ImuConfig,
}

/// What is wrong with a sensor file or an override.
#[derive(Debug, Error)]
pub enum SensorsError {
    /// It cannot be read.
    #[error("cannot read sensor file {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// A key is unknown, missing, or of the wrong type.
    #[error("sensor file {file}: {cause}")]
    Content {
        /// The file, or "d455.toml".
        file: String,
        /// In one line.
        cause: String,
    },
    /// An override is not `section.key=number`, or names nothing.
    #[error("--set {0:?} is not section.key=number with a key of the sensor file, such as odometry.delay_s=0.05")]
    Override(String),
}

impl Sensors {
    /// Reads `file` (none: the shipped D455) and sets each `section.key=number` of `overrides`.
    ///
    /// # Errors
    /// See [`SensorsError`].
    pub fn load(file: Option<&Path>, overrides: &[String]) -> Result<Self, SensorsError> {
        let (name, text) = match file {
            None => ("d455.toml".to_owned(), D455.to_owned()),
            Some(path) => {
                let read = std::fs::read_to_string(path);
                let text = read.map_err(|source| SensorsError::Read { path: path.to_owned(), source })?;
                (path.display().to_string(), text)
            }
        };
        let bad = |cause: String| SensorsError::Content { file: name.clone(), cause };
        let mut table: toml::Table = text.parse().map_err(|e: toml::de::Error| bad(e.message().to_owned()))?;
        for change in overrides {
            set(&mut table, change).ok_or_else(|| SensorsError::Override(change.clone()))?;
        }
        let sensors: Self = table.try_into().map_err(|e: toml::de::Error| bad(e.message().to_owned()))?;
        sensors.validate().map_err(bad)?;
        Ok(sensors)
    }

    /// The camera that `seed` draws, for images of `camera`.
    #[must_use]
    pub fn sensor(&self, camera: &Camera, seed: u64) -> Sensor {
        Sensor::new(self.view, self.depth, self.colour, camera, seed)
    }

    fn validate(&self) -> Result<(), String> {
        let d = &self.depth;
        if !(d.min_m > 0.0 && d.min_m < d.poor_m && d.poor_m < d.max_m && d.max_m <= 65.0) {
            return Err("depth needs 0 < min_m < poor_m < max_m <= 65".to_owned());
        }
        let fields = [self.view.colour_deg, self.view.depth_deg].into_iter().flatten().flatten();
        if !fields.into_iter().all(|degrees| degrees > 0.0 && degrees < 180.0) {
            return Err("the fields of view need degrees above 0 and below 180".to_owned());
        }
        let [shortest, longest] = self.colour.shutter_s;
        if !(shortest > 0.0 && shortest <= longest && longest < 0.1) {
            return Err("colour.shutter_s needs 0 < shortest <= longest < 0.1".to_owned());
        }
        let (c, o, i) = (&self.colour, &self.odometry, &self.imu);
        let single = [d.noise_per_m, d.patch_noise_per_m, d.step_per_m, d.edge_hole, d.thin_hole, d.stray_hole];
        let colour = [c.mean_level, c.auto_exposure, c.exposure_spread, c.white_balance, c.noise, c.lens_blur];
        let odometry = [o.delay_s, o.position_m, o.drift_m, o.velocity_mps, o.velocity_bias_mps, o.attitude_rad];
        let more = [o.yaw_drift_rad, o.rate_radps, o.jump_every_s, o.jump_m];
        let imu = [i.acc_density, i.gyro_density, i.acc_bias_mps2, i.gyro_bias_radps];
        let doubles = odometry.into_iter().chain(more).chain(imu);
        let mut all = single.into_iter().chain(colour).map(f64::from).chain(doubles);
        if !all.all(|v| v.is_finite() && v >= 0.0)
            || d.step_per_m == 0.0
            || o.bias_time_s.is_nan()
            || o.bias_time_s <= 0.0
        {
            return Err("every value must be a number of 0 or more, step_per_m and bias_time_s above 0".to_owned());
        }
        Ok(())
    }
}

/// The options that choose sensors, the same for every subcommand.
#[derive(Clone, Debug, Args)]
pub struct SensorArgs {
    /// Sensor file (TOML); absent: the shipped RealSense D455.
    #[arg(long, value_name = "FILE")]
    sensors: Option<PathBuf>,
    /// Change one number of it, such as odometry.delay_s=0.05; may be repeated.
    #[arg(long, value_name = "SECTION.KEY=NUMBER")]
    set: Vec<String>,
}

impl SensorArgs {
    /// The chosen sensors.
    ///
    /// # Errors
    /// See [`SensorsError`].
    pub fn load(&self) -> Result<Sensors, SensorsError> {
        Sensors::load(self.sensors.as_deref(), &self.set)
    }
}

impl Default for Sensors {
    fn default() -> Self {
        Self::load(None, &[]).expect("the shipped sensor file is valid")
    }
}

/// Replaces the number at `section.key`; none if there is none.
fn set(table: &mut toml::Table, change: &str) -> Option<()> {
    let (path, value) = change.split_once('=')?;
    let (section, key) = path.trim().split_once('.')?;
    let number: f64 = value.trim().parse().ok()?;
    let place = table.get_mut(section)?.as_table_mut()?.get_mut(key)?;
    place.as_float()?;
    *place = toml::Value::Float(number);
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_override_changes_its_value_alone() {
        let plain = Sensors::default();
        let late = Sensors::load(None, &["odometry.delay_s=0.08".to_owned()]).unwrap();
        assert!((late.odometry.delay_s - 0.08).abs() < 1e-12);
        assert_eq!(Sensors { odometry: plain.odometry, ..late }, plain);
    }

    #[test]
    fn the_d435_differs_from_the_d455_in_its_lenses_alone() {
        let (plain, file) = (Sensors::default(), Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/sensors/d435.toml")));
        let d435 = Sensors::load(Some(file), &[]).unwrap();
        assert_eq!(Sensors { view: plain.view, depth: plain.depth, ..d435 }, plain);
        assert_eq!(d435.view, ViewConfig { colour_deg: Some([69.0, 42.0]), depth_deg: Some([87.0, 58.0]) });
        assert!(d435.depth.noise_per_m > plain.depth.noise_per_m && d435.depth.max_m < plain.depth.max_m);
    }

    #[test]
    fn a_bad_override_or_file_is_one_line_that_names_it() {
        for bad in ["odometry.delay=1", "depth", "depth.noise_per_m=much", "colour.shutter_s=1"] {
            let message = Sensors::load(None, &[bad.to_owned()]).unwrap_err().to_string();
            assert!(message.contains(bad) && message.lines().count() == 1, "{message}");
        }
        let message = Sensors::load(None, &["depth.max_m=5".to_owned()]).unwrap_err().to_string();
        assert!(message.contains("min_m < poor_m < max_m"), "{message}");
        let message = Sensors::load(Some(Path::new("no/such.toml")), &[]).unwrap_err().to_string();
        assert!(message.contains("no/such.toml"), "{message}");
    }
}
