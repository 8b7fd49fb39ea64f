//! The bridge's file: which topics, from whom, into which frames.

use std::path::Path;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;

/// Why a file is no configuration; one line.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// It cannot be read.
    #[error("cannot read {path}: {cause}; air/sensors/ros2/ros2.toml is one to begin with")]
    Read {
        /// The file.
        path: String,
        /// The system's words.
        cause: std::io::Error,
    },
    /// It is not TOML of this shape.
    #[error("{path}: {cause}")]
    Parse {
        /// The file.
        path: String,
        /// What and where.
        cause: String,
    },
    /// A value cannot be used.
    #[error("{path}: {cause}")]
    Value {
        /// The file.
        path: String,
        /// Which and why.
        cause: String,
    },
}

/// The file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The vehicle.
    pub vehicle: Vehicle,
    /// The ROS 2 network.
    pub ros: Ros,
    /// Images in; absent: none.
    pub camera: Option<Camera>,
    /// Odometry in; absent: none.
    pub odometry: Option<Odometry>,
    /// What goes out; absent: nothing.
    pub output: Option<Output>,
}

/// The vehicle that is fed.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vehicle {
    /// As its vehicle file has it.
    pub name: String,
    /// Its Zenoh endpoint for its own sensors.
    pub connect: String,
}

/// The ROS 2 network.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ros {
    /// `ROS_DOMAIN_ID`.
    pub domain: u32,
    /// Zenoh endpoint of the router, `rmw_zenohd`.
    pub connect: String,
    /// Our node's name.
    pub node: String,
    /// False for ROS 2 Humble, whose types have no hashes.
    pub type_hashes: bool,
}

/// Images in. A topic that ends in `/compressed` or `/compressedDepth` is of `CompressedImage`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Colour.
    pub colour: String,
    /// Depth of the same pixels.
    pub depth: String,
    /// The lens of both.
    pub info: String,
    /// Both are rectified: the lens is `info`'s P, and has no distortion.
    pub rectified: bool,
    /// A lens that sees less than the policy is taken too.
    pub rim: bool,
    /// Two images are one if their stamps are no farther apart, ms.
    pub pair_within_ms: f64,
    /// What is sent on, px.
    pub width: u32,
    /// As `width`.
    pub height: u32,
    /// The policy's field of view, as the vehicle file has it.
    pub hfov_deg: f64,
    /// As `hfov_deg`.
    pub vfov_deg: f64,
}

/// What carries the motion.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// `nav_msgs/Odometry`.
    Odometry,
    /// `geometry_msgs/PoseStamped`: velocity and rates are differences of poses.
    Pose,
}

/// Where the velocity comes from.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Velocity {
    /// The twist, in the child frame, as the message's definition has it.
    Child,
    /// The twist, in the odometry's own frame.
    Odom,
    /// Differences of positions.
    Pose,
}

/// Where the rates of turn come from.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Rates {
    /// The twist, in the child frame.
    Twist,
    /// Differences of attitudes.
    Pose,
}

/// Odometry in.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Odometry {
    /// Where.
    pub topic: String,
    /// Of which type.
    pub message: Kind,
    /// Where the velocity comes from.
    pub velocity: Velocity,
    /// Where the rates come from.
    pub rates: Rates,
    /// From east to the x axis of the odometry's frame, anticlockwise, degrees. Its z axis is up.
    pub yaw_deg: f64,
    /// Where the child frame is in the vehicle's body: forward, left, up, m.
    pub position_m: [f64; 3],
    /// How it is turned there: roll, pitch, yaw about the body's fixed axes, degrees.
    pub rpy_deg: [f64; 3],
}

impl Odometry {
    /// The child frame's pose in the vehicle's body.
    #[must_use]
    pub fn body_from_child(&self) -> Isometry3<f64> {
        let [roll, pitch, yaw] = self.rpy_deg.map(f64::to_radians);
        Isometry3::from_parts(
            Translation3::from(Vector3::from(self.position_m)),
            UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        )
    }

    /// How the odometry's frame is turned in the world.
    #[must_use]
    pub fn world_from_odom(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.yaw_deg.to_radians())
    }
}

/// What goes out: each topic that is named.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Output {
    /// The name of the world's frame: x east, y north, z up.
    pub world_frame: String,
    /// The name of the body's frame: x forward, y left, z up.
    pub body_frame: String,
    /// `nav_msgs/Path`: the trajectory that is flown.
    pub plan: Option<String>,
    /// `visualization_msgs/MarkerArray`: every candidate, green is cheap.
    pub candidates: Option<String>,
    /// `geometry_msgs/PoseWithCovarianceStamped`.
    pub target: Option<String>,
    /// `nav_msgs/Odometry` of the vehicle, as it flies by it.
    pub odometry: Option<String>,
    /// `tf2_msgs/TFMessage`: from the world to the body. `/tf` is where others look.
    pub tf: Option<String>,
}

impl Output {
    fn topics(&self) -> impl Iterator<Item = (&'static str, &str)> {
        let all = [
            ("output.plan", &self.plan),
            ("output.candidates", &self.candidates),
            ("output.target", &self.target),
            ("output.odometry", &self.odometry),
            ("output.tf", &self.tf),
        ];
        all.into_iter().filter_map(|(key, topic)| topic.as_deref().map(|topic| (key, topic)))
    }
}

impl Config {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// It cannot be read, or used; the message is one line.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|cause| ConfigError::Read { path: name.clone(), cause })?;
        Self::parse(&text, &name)
    }

    /// [`Self::load`] of a text that is there already.
    ///
    /// # Errors
    /// As there.
    pub fn parse(text: &str, name: &str) -> Result<Self, ConfigError> {
        let path = name.to_owned();
        let config: Config = toml::from_str(text).map_err(|e| {
            let line = e.span().map_or(String::new(), |span| {
                format!(" (line {})", 1 + text[..span.start.min(text.len())].matches('\n').count())
            });
            ConfigError::Parse { path: path.clone(), cause: format!("{}{line}", e.message().replace('\n', " ")) }
        })?;
        config.check().map_err(|cause| ConfigError::Value { path, cause })?;
        Ok(config)
    }

    fn check(&self) -> Result<(), String> {
        if self.ros.domain > 232 {
            return Err(format!("ros.domain is {}: 0 to 232", self.ros.domain));
        }
        if !is_name(&self.ros.node) {
            return Err(format!("ros.node is {:?}: letters, digits and _ alone", self.ros.node));
        }
        if self.camera.is_none() && self.odometry.is_none() && self.output.is_none() {
            return Err("there is none of [camera], [odometry], [output]: nothing to do".to_owned());
        }
        let mut topics: Vec<(&str, &str)> = Vec::new();
        if let Some(camera) = &self.camera {
            camera.check()?;
            topics.extend([("camera.colour", camera.colour.as_str()), ("camera.depth", &camera.depth)]);
            topics.push(("camera.info", &camera.info));
        }
        if let Some(odometry) = &self.odometry {
            odometry.check()?;
            topics.push(("odometry.topic", &odometry.topic));
        }
        topics.extend(self.output.iter().flat_map(Output::topics));
        for (k, (key, topic)) in topics.iter().enumerate() {
            if !topic.starts_with('/') || !topic[1..].split('/').all(is_name) {
                return Err(format!("{key} is {topic:?}: a full name, such as /camera/image_raw"));
            }
            if let Some((other, _)) = topics[..k].iter().find(|(_, before)| before == topic) {
                return Err(format!("{other} and {key} are both {topic}"));
            }
        }
        Ok(())
    }
}

impl Camera {
    fn check(&self) -> Result<(), String> {
        let within = |name: &str, value: f64, least: f64, most: f64| {
            let good = (least..=most).contains(&value);
            good.then_some(()).ok_or_else(|| format!("camera.{name} is {value}: it must be {least} to {most}"))
        };
        within("pair_within_ms", self.pair_within_ms, 0.0, 100.0)?;
        within("width", self.width.into(), 16.0, 1920.0)?;
        within("height", self.height.into(), 16.0, 1200.0)?;
        within("hfov_deg", self.hfov_deg, 10.0, 170.0)?;
        within("vfov_deg", self.vfov_deg, 10.0, 170.0)
    }
}

impl Odometry {
    fn check(&self) -> Result<(), String> {
        let numbers = self.position_m.iter().chain(&self.rpy_deg).chain([&self.yaw_deg]);
        if !numbers.clone().all(|x| x.is_finite()) || self.position_m.iter().any(|x| x.abs() > 10.0) {
            return Err("odometry.position_m, rpy_deg, yaw_deg: finite, and within 10 m of the body".to_owned());
        }
        if self.message == Kind::Pose && (self.velocity != Velocity::Pose || self.rates != Rates::Pose) {
            return Err("odometry.message = \"pose\" has no twist: velocity and rates must be \"pose\"".to_owned());
        }
        Ok(())
    }
}

fn is_name(word: &str) -> bool {
    !word.is_empty()
        && !word.starts_with(|c: char| c.is_ascii_digit())
        && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHIPPED: &str = include_str!("../ros2.toml");

    fn refusal(from: &str, to: &str) -> String {
        assert!(SHIPPED.contains(from), "{from}");
        Config::parse(&SHIPPED.replacen(from, to, 1), "a.toml").unwrap_err().to_string()
    }

    #[test]
    fn the_shipped_file_is_good() {
        let config = Config::parse(SHIPPED, "ros2.toml").unwrap();
        assert!(config.camera.is_some() && config.odometry.is_some());
        assert_eq!(config.output.unwrap().topics().count(), 5);
    }

    #[test]
    fn what_cannot_be_used_is_refused_in_one_line_that_names_it() {
        for (from, to, words) in [
            ("domain = 0", "domain = 0\ncolor = 3", "unknown field `color`"),
            ("domain = 0", "domain = 999", "ros.domain is 999"),
            ("domain = 0", "", "missing field `domain`"),
            ("\"goshawk_bridge\"", "\"a/b\"", "ros.node"),
            ("pair_within_ms = 5", "pair_within_ms = -5", "camera.pair_within_ms is -5"),
            ("hfov_deg = 90.0", "hfov_deg = nan", "camera.hfov_deg is NaN"),
            ("\"/tf\"", "\"tf\"", "output.tf is \"tf\""),
            ("\"/tf\"", "\"/a/**\"", "output.tf"),
            ("\"/goshawk/odometry\"", "\"/odometry\"", "odometry.topic and output.odometry are both /odometry"),
            ("message = \"odometry\"", "message = \"pose\"", "has no twist"),
            ("yaw_deg = 0.0", "yaw_deg = inf", "finite"),
        ] {
            let said = refusal(from, to);
            assert!(said.contains(words) && said.starts_with("a.toml: ") && !said.contains('\n'), "{said}");
        }
        assert!(Config::load(Path::new("/nowhere.toml")).unwrap_err().to_string().contains("ros2.toml is one"));
    }
}
