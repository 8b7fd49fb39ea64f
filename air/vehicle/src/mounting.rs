//! The stamp that says that a person has checked the frames, as they are mounted: beside the vehicle file, void when
//! what the file says of the mounting changes.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::config::{Camera, Mounting, OdometrySource, Vehicle};

/// What was checked: a change of any of it voids the stamp.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// `camera.hfov_deg`.
    pub hfov_deg: f64,
    /// `camera.vfov_deg`.
    pub vfov_deg: f64,
    /// `camera.tilt_deg`.
    pub tilt_deg: f64,
    /// `camera.position_m`.
    pub position_m: [f64; 3],
    /// `sensors.odometry`.
    pub odometry: String,
    /// The autopilot's firmware.
    pub firmware: String,
}

/// The file beside the vehicle file.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Stamp {
    /// When, UTC.
    pub checked: String,
    /// What of.
    pub geometry: Geometry,
}

impl Geometry {
    /// Of a vehicle file.
    #[must_use]
    pub fn of(vehicle: &Vehicle) -> Self {
        let Camera { hfov_deg, vfov_deg, tilt_deg, position_m, .. } = vehicle.camera;
        let odometry = match vehicle.sensors.odometry {
            OdometrySource::Autopilot => "autopilot",
            OdometrySource::Zenoh => "zenoh",
        };
        let firmware = vehicle.autopilot.firmware().to_string();
        Self { hfov_deg, vfov_deg, tilt_deg, position_m, odometry: odometry.to_owned(), firmware }
    }

    /// The first thing that is not as it was; none: all is.
    fn difference(&self, was: &Self) -> Option<String> {
        let number = |key: &str, is: f64, was: f64| (is != was).then(|| format!("{key} is {is}, it was {was}"));
        let word = |key: &str, is: &str, was: &str| (is != was).then(|| format!("{key} is {is}, it was {was}"));
        let place = || {
            let (is, was) = (self.position_m, was.position_m);
            (is != was).then(|| format!("camera.position_m is {is:?}, it was {was:?}"))
        };
        number("camera.tilt_deg", self.tilt_deg, was.tilt_deg)
            .or_else(|| number("camera.hfov_deg", self.hfov_deg, was.hfov_deg))
            .or_else(|| number("camera.vfov_deg", self.vfov_deg, was.vfov_deg))
            .or_else(place)
            .or_else(|| word("sensors.odometry", &self.odometry, &was.odometry))
            .or_else(|| word("autopilot.firmware", &self.firmware, &was.firmware))
    }
}

/// Where a vehicle file's stamp lies.
#[must_use]
pub fn stamp_path(vehicle_file: &Path) -> PathBuf {
    vehicle_file.with_extension("mounting.toml")
}

/// Whether the frames were checked, and if not, what to do; none: the vehicle file asks for no check.
#[must_use]
pub fn standing(vehicle: &Vehicle) -> Option<Result<(), String>> {
    (vehicle.sensors.mounting == Mounting::Checked).then(|| read(vehicle))
}

fn read(vehicle: &Vehicle) -> Result<(), String> {
    let path = stamp_path(&vehicle.path);
    let way = format!("run goshawk-air check --frames --config {}", vehicle.path.display());
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return Err(format!("nobody has checked the frames yet: {way}"));
        }
        Err(error) => return Err(format!("{} cannot be read ({error}): {way}", path.display())),
    };
    let stamp: Stamp = toml::from_str(&text).map_err(|_| format!("{} is damaged: {way}", path.display()))?;
    Geometry::of(vehicle)
        .difference(&stamp.geometry)
        .map_or(Ok(()), |change| Err(format!("since the frames were checked, {change}: {way}")))
}

/// Writes the stamp; a file that was there is replaced as a whole.
///
/// # Errors
/// It cannot be written.
pub fn write(vehicle: &Vehicle, checked: String) -> std::io::Result<PathBuf> {
    let path = stamp_path(&vehicle.path);
    let stamp = Stamp { checked, geometry: Geometry::of(vehicle) };
    let text = toml::to_string(&stamp).map_err(std::io::Error::other)?;
    let unfinished = path.with_extension("part");
    std::fs::write(&unfinished, format!("# Made by goshawk-air check --frames; remove it to check again.\n{text}"))?;
    std::fs::rename(&unfinished, &path)?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stamp_holds_until_the_mounting_changes() {
        let folder = tempfile::tempdir().unwrap();
        let shipped = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../vehicles"));
        let text = std::fs::read_to_string(shipped.join("sim.toml")).unwrap();
        let text = text.replace("mounting = \"simulated\"", "mounting = \"checked\"");
        let tuning = std::fs::read_to_string(shipped.join("tuning.toml")).unwrap();
        let file = folder.path().join("alpha.toml");
        let load = |text: &str| Vehicle::parse(text.to_owned(), tuning.clone(), &file).unwrap();
        let why = |text: &str| standing(&load(text)).unwrap().unwrap_err();
        assert!(why(&text).contains("nobody has checked"), "{}", why(&text));
        let path = write(&load(&text), "2026-11-26T12:00:00Z".to_owned()).unwrap();
        assert_eq!(path, folder.path().join("alpha.mounting.toml"));
        assert_eq!(standing(&load(&text)), Some(Ok(())));
        assert_eq!(standing(&load(&text.replace("mass_kg = 0.85", "mass_kg = 0.9"))), Some(Ok(())), "no geometry");
        let tilted = why(&text.replace("tilt_deg = 5.0", "tilt_deg = 15.0"));
        assert!(tilted.contains("camera.tilt_deg is 15, it was 5") && tilted.contains("check --frames"), "{tilted}");
        assert!(why(&text.replace("odometry = \"autopilot\"", "odometry = \"zenoh\"")).contains("sensors.odometry"));
        std::fs::write(&path, "checked = 3").unwrap();
        assert!(why(&text).contains("damaged"));
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        assert!(why(&text).contains("cannot be read"));
        let simulated = text.replace("mounting = \"checked\"", "mounting = \"simulated\"");
        assert_eq!(standing(&load(&simulated)), None);
    }
}
