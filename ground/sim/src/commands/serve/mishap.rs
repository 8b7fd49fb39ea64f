//! What goes wrong with the simulated autopilot, and when.

use std::str::FromStr;

use clap::Args;
use color_eyre::eyre::{Result, ensure};
use goshawk_core::Time;

use crate::vehicle::px4::{OdometryFault, Px4Udp, StickOverride};
use crate::vehicle::quadrotor::LoopParameters;

/// How long a restart takes, s: what PX4's own simulator takes at least.
const BOOT_S: f64 = 2.5;
/// How late a late arming is, s.
const LATE_S: f64 = 2.0;
/// One message in so many is one that nobody knows: as many as were counted of a PX4 of August 2026.
const UNKNOWN_AFTER: u64 = 140;
/// The lags that the attitude loop can be given, s.
const LAGS_S: std::ops::RangeInclusive<f64> = 0.07..=0.4;

/// The stand-in's settings and mishaps.
#[derive(Debug, Args)]
pub(super) struct MishapArgs {
    /// What goes wrong with the autopilot, and how long after lift-off, s; without @S from the start. Repeatable:
    /// unarmable (it refuses to arm and says why), no-position (no GPS), position-back,
    /// two-motions (ODOMETRY is 3 m/s faster than LOCAL_POSITION_NED), one-motion (no more), restart, late-arming (it arms
    /// 2 s after it is asked), numb (it never notices that it has landed), deaf (it answers no command, as one that wants
    /// signatures), unknown-messages, sticks=SPEED (the pilot moves the sticks so fast, travels a second).
    #[arg(long = "mishap", value_name = "WHAT[@S]")]
    mishaps: Vec<Mishap>,
    /// The attitude's lag, s: how long a small step takes to 63 %; absent: the airframe's.
    #[arg(long, value_name = "S")]
    attitude_lag: Option<f64>,
    /// MAN_OVERRIDE_SPD: how fast a stick must move to take over, travels a second; below 0: none does.
    /// Absent: 1, PX4's own.
    #[arg(long, value_name = "SPEED", allow_negative_numbers = true)]
    man_override_spd: Option<f64>,
}

/// MAN_OVERRIDE_SPD's default.
const MAN_OVERRIDE_SPD: f64 = 1.0;

impl MishapArgs {
    /// The inner loops that the command line asks for; none: the airframe's.
    pub(super) fn loops(&self) -> Result<Option<LoopParameters>> {
        let Some(lag) = self.attitude_lag else { return Ok(None) };
        let (least, most) = (LAGS_S.start(), LAGS_S.end());
        ensure!(LAGS_S.contains(&lag), "--attitude-lag is {lag}: it must be {least} to {most}");
        Ok(Some(LoopParameters::with_response(lag)))
    }

    pub(super) fn sticks(&self) -> StickOverride {
        StickOverride::Speed(self.man_override_spd.unwrap_or(MAN_OVERRIDE_SPD))
    }

    /// Something of it was asked for.
    pub(super) fn any(&self) -> bool {
        !self.mishaps.is_empty() || self.attitude_lag.is_some() || self.man_override_spd.is_some()
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum What {
    Unarmable,
    NoPosition,
    PositionBack,
    TwoMotions,
    OneMotion,
    Restart,
    LateArming,
    Numb,
    Deaf,
    UnknownMessages,
    Sticks(f64),
}

/// One mishap; without a time it is there from the start.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Mishap {
    what: What,
    after_s: Option<f64>,
}

impl FromStr for Mishap {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (what, after) = text.split_once('@').map_or((text, None), |(what, after)| (what, Some(after)));
        let number = |text: &str| text.parse().ok().filter(|x: &f64| x.is_finite() && *x >= 0.0);
        let after_s = after.map(|after| number(after).ok_or(format!("{after:?} is no time in s"))).transpose()?;
        let what = match what {
            "unarmable" => What::Unarmable,
            "no-position" => What::NoPosition,
            "position-back" => What::PositionBack,
            "two-motions" => What::TwoMotions,
            "one-motion" => What::OneMotion,
            "restart" => What::Restart,
            "late-arming" => What::LateArming,
            "numb" => What::Numb,
            "deaf" => What::Deaf,
            "unknown-messages" => What::UnknownMessages,
            other => match other.strip_prefix("sticks=").and_then(number) {
                Some(speed) => What::Sticks(speed),
                None => return Err(format!("{other:?} is no mishap: see --help")),
            },
        };
        Ok(Mishap { what, after_s })
    }
}

/// The mishaps still to come.
pub(super) struct Mishaps {
    waiting: Vec<Mishap>,
}

impl Mishaps {
    pub(super) fn new(args: &MishapArgs) -> Self {
        Self { waiting: args.mishaps.clone() }
    }

    /// Lets happen what is due at `now`; `airborne`: since when the vehicle has been up.
    pub(super) fn strike(&mut self, now: Time, airborne: Option<Time>, px4: &mut Px4Udp) {
        let up_s = airborne.map(|since| now.since(since));
        self.waiting.retain(|mishap| {
            let due = mishap.after_s.is_none_or(|after| up_s.is_some_and(|up| up >= after));
            if due {
                super::say(&format!("mishap: {:?}", mishap.what));
                mishap.what.happen(px4);
            }
            !due
        });
    }
}

impl What {
    fn happen(self, px4: &mut Px4Udp) {
        let faults = &mut px4.logic.faults;
        match self {
            Self::Unarmable => faults.unarmable = true,
            Self::NoPosition => faults.no_position = true,
            Self::PositionBack => faults.no_position = false,
            Self::TwoMotions => px4.logic.set_odometry_fault(Some(OdometryFault::Contradictory)),
            Self::OneMotion => px4.logic.set_odometry_fault(None),
            Self::LateArming => faults.arming_delay_s = LATE_S,
            Self::Numb => faults.numb = true,
            Self::Deaf => faults.deaf = true,
            Self::Restart => px4.logic.restart(BOOT_S),
            Self::UnknownMessages => px4.unknown_after = Some(UNKNOWN_AFTER),
            Self::Sticks(speed) => px4.logic.move_sticks(speed),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mishap_is_read_with_its_time_and_nonsense_is_named() {
        let read = |text: &str| text.parse::<Mishap>();
        assert_eq!(read("deaf"), Ok(Mishap { what: What::Deaf, after_s: None }));
        assert_eq!(read("sticks=0.5@8"), Ok(Mishap { what: What::Sticks(0.5), after_s: Some(8.0) }));
        for (text, named) in [("sunshine", "sunshine"), ("restart@soon", "soon"), ("sticks=-1", "sticks=-1")] {
            assert!(read(text).unwrap_err().contains(named), "{text}");
        }
    }
}
