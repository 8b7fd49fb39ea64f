//! A schedule of faults as data: where and how is flown, what goes wrong, from when on, for how long.

use std::path::Path;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::trial::Fault as Sense;

/// One flight with all that goes wrong in it. The flight is a pure function of it, of the vehicle file and the policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schedule {
    /// Noise and whatever else is drawn in the flight.
    pub seed: u64,
    /// What is flown.
    pub setting: Setting,
    /// What goes wrong, in no order.
    pub faults: Vec<Fault>,
}

/// A flight without its faults.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setting {
    /// What is to be done.
    pub task: Task,
    /// Which of the prepared scenes.
    pub scene: usize,
    /// What Stop does.
    pub on_stop: OnStop,
    /// Where the odometry comes from.
    pub odometry: Odometry,
    /// The vehicle file's fence, m.
    pub fence_m: f64,
    /// The vehicle file's ceiling, m.
    pub ceiling_m: f64,
    /// What gusts reach, m/s.
    pub wind_mps: f64,
    /// The flight's longest time, s.
    pub length_s: f64,
}

/// What is to be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Task {
    /// Track an evader, with the shipped policy.
    Track,
    /// Fly to a goal, steered by the depth image alone.
    Navigate,
}

/// As `mission.on_stop` of the vehicle file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum OnStop {
    Land,
    Hover,
    HandOver,
}

/// As `sensors.odometry` of the vehicle file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum Odometry {
    Autopilot,
    Zenoh,
}

/// One thing that goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// When it begins, s after the beginning.
    pub at_s: f64,
    /// How long it lasts, s; no matter for what happens at an instant.
    pub for_s: f64,
    /// What it is.
    pub what: Kind,
}

/// What can go wrong. The values of each are in [`super::draw`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Kind {
    /// The operator asks to stop, under the id of this number.
    Stop(u32),
    /// The operator asks to start, likewise.
    Start(u32),
    /// Nothing that the operator asks arrives.
    CommandsLost,
    /// It arrives late, s.
    CommandsLate(f64),
    /// It arrives so many times.
    CommandsRepeated(u32),
    /// One of the faults of `goshawk-sim faults`: of the camera, the network's answers, the odometry.
    #[serde(serialize_with = "by_name", deserialize_with = "from_name")]
    Sense(Sense),
    /// No frame arrives.
    FramesLost,
    /// They arrive late, s.
    FramesLate(f64),
    /// Of each two the second arrives first.
    FramesSwapped,
    /// Each arrives twice.
    FramesTwice,
    /// Their stamps are off, s; above 0: of the future.
    FramesStamped(f64),
    /// No odometry arrives.
    OdometryLost,
    /// It arrives late, s.
    OdometryLate(f64),
    /// Of each two samples the second arrives first.
    OdometrySwapped,
    /// Two of three are no numbers; from the autopilot all.
    OdometryNan,
    /// Its stamps are off, s.
    OdometryStamped(f64),
    /// The network takes longer, s.
    PlansLate(f64),
    /// A readiness check fails.
    NotReady,
    /// The autopilot refuses to arm.
    Unarmable,
    /// The autopilot hears no command.
    Deaf,
    /// It takes so long to arm, s.
    ArmsLate(f64),
    /// It loses its position, and says so.
    NoPosition,
    /// Nothing that it says arrives.
    Silent,
    /// No setpoint reaches it.
    SetpointsLost,
    /// The pilot takes the mode.
    PilotTakesOver,
    /// It changes to landing by itself.
    LandsByItself,
    /// It starts again, which takes so long, s.
    Restarts(f64),
    /// It stops the motors.
    Disarms,
    /// It says that this share of the charge is left.
    BatteryLow(f64),
    /// The planner's thread stands still.
    PlannerPaused,
    /// The controller's thread stands still.
    ControllerPaused,
    /// The disk takes no byte more.
    DiskFull,
    /// The disk takes nothing for a while.
    DiskSlow,
    /// The log is cut off at this share of its bytes.
    LogCut(f64),
}

impl Kind {
    /// Its name in tables.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Stop(_) => "stop",
            Self::Start(_) => "start",
            Self::CommandsLost => "commands-lost",
            Self::CommandsLate(_) => "commands-late",
            Self::CommandsRepeated(_) => "commands-repeated",
            Self::Sense(fault) => fault.name(),
            Self::FramesLost => "frames-lost",
            Self::FramesLate(_) => "frames-late",
            Self::FramesSwapped => "frames-swapped",
            Self::FramesTwice => "frames-twice",
            Self::FramesStamped(_) => "frames-stamped",
            Self::OdometryLost => "odometry-lost",
            Self::OdometryLate(_) => "odometry-late",
            Self::OdometrySwapped => "odometry-swapped",
            Self::OdometryNan => "odometry-nan",
            Self::OdometryStamped(_) => "odometry-stamped",
            Self::PlansLate(_) => "plans-late",
            Self::NotReady => "not-ready",
            Self::Unarmable => "unarmable",
            Self::Deaf => "deaf",
            Self::ArmsLate(_) => "arms-late",
            Self::NoPosition => "no-position",
            Self::Silent => "silent",
            Self::SetpointsLost => "setpoints-lost",
            Self::PilotTakesOver => "pilot-takes-over",
            Self::LandsByItself => "lands-by-itself",
            Self::Restarts(_) => "restarts",
            Self::Disarms => "disarms",
            Self::BatteryLow(_) => "battery-low",
            Self::PlannerPaused => "planner-paused",
            Self::ControllerPaused => "controller-paused",
            Self::DiskFull => "disk-full",
            Self::DiskSlow => "disk-slow",
            Self::LogCut(_) => "log-cut",
        }
    }

    /// Its number, if it has one, with another in its place.
    #[must_use]
    pub fn with_number(self, change: impl Fn(f64) -> f64) -> Self {
        match self {
            Self::CommandsLate(x) => Self::CommandsLate(change(x)),
            Self::FramesLate(x) => Self::FramesLate(change(x)),
            Self::FramesStamped(x) => Self::FramesStamped(change(x)),
            Self::OdometryLate(x) => Self::OdometryLate(change(x)),
            Self::OdometryStamped(x) => Self::OdometryStamped(change(x)),
            Self::PlansLate(x) => Self::PlansLate(change(x)),
            Self::ArmsLate(x) => Self::ArmsLate(change(x)),
            Self::Restarts(x) => Self::Restarts(change(x)),
            Self::BatteryLow(x) => Self::BatteryLow(change(x)),
            Self::LogCut(x) => Self::LogCut(change(x)),
            other => other,
        }
    }
}

impl Fault {
    /// It acts at `t_s`.
    #[must_use]
    pub fn acts(&self, t_s: f64) -> bool {
        (self.at_s..self.at_s + self.for_s).contains(&t_s)
    }
}

fn by_name<S: Serializer>(fault: &Sense, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(fault.name())
}

fn from_name<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Sense, D::Error> {
    String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
}

/// Longest flight, s.
const LONGEST_S: f64 = 600.0;

impl Schedule {
    /// As one line, for `--schedule`.
    #[must_use]
    pub fn line(&self) -> String {
        serde_json::to_string(self).expect("numbers, strings and lists become JSON")
    }

    /// From `--schedule`: a line as of [`Schedule::line`], or a file that holds one.
    ///
    /// # Errors
    /// It cannot be read, is no schedule, or holds a value that cannot be flown; in one line.
    pub fn load(text: &str) -> Result<Self, String> {
        if text.trim_start().starts_with('{') {
            return text.parse();
        }
        let read = std::fs::read_to_string(Path::new(text));
        let content =
            read.map_err(|e| format!("cannot read the schedule {text}: {e}; give a file, or its JSON itself"))?;
        content.parse().map_err(|e: String| format!("{text}: {e}"))
    }

    fn check(&self) -> Result<(), String> {
        let within = |name: &str, value: f64, low: f64, high: f64| {
            let good = (low..=high).contains(&value);
            good.then_some(()).ok_or_else(|| format!("{name} is {value}: it must be from {low} to {high}"))
        };
        let s = &self.setting;
        within("setting.length_s", s.length_s, 1.0, LONGEST_S)?;
        within("setting.fence_m", s.fence_m, 1.0, 10_000.0)?;
        within("setting.ceiling_m", s.ceiling_m, 1.5, 500.0)?;
        within("setting.wind_mps", s.wind_mps, 0.0, 15.0)?;
        for (index, fault) in self.faults.iter().enumerate() {
            within(&format!("faults[{index}].at_s"), fault.at_s, 0.0, LONGEST_S)?;
            within(&format!("faults[{index}].for_s"), fault.for_s, 0.0, LONGEST_S)?;
            let number = std::cell::Cell::new(0.0);
            let _ = fault.what.with_number(|x| {
                number.set(x);
                x
            });
            within(&format!("faults[{index}].what"), number.get(), -100.0, 100.0)?;
        }
        Ok(())
    }
}

impl FromStr for Schedule {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let schedule: Self = serde_json::from_str(text).map_err(|e| format!("no schedule: {e}"))?;
        schedule.check()?;
        Ok(schedule)
    }
}

#[cfg(test)]
mod tests {
    use super::super::draw::draw;
    use super::*;

    #[test]
    fn a_schedule_comes_back_from_its_line() {
        for index in 0..300 {
            let schedule = draw(5, index);
            assert_eq!(schedule.line().parse(), Ok(schedule));
        }
    }

    #[test]
    fn what_is_no_schedule_is_refused_in_one_line_that_says_why() {
        let good = draw(5, 0).line();
        let far = good.replace("\"length_s\":", "\"length_s\":9");
        for (text, word) in
            [("{}", "seed"), ("{\"seed\":1", "EOF"), (far.as_str(), "length_s"), ("no-such", "cannot read")]
        {
            let why = Schedule::load(text).unwrap_err();
            assert!(why.contains(word) && !why.contains('\n'), "{why}");
        }
    }
}
