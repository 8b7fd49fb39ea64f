//! What the autopilot must be and be set to.

use std::os::unix::fs::PermissionsExt;

use goshawk_autopilot::{AutopilotLink, Firmware, Parameter, Status};
use goshawk_vehicle::clock;
use goshawk_vehicle::config::{OdometrySource, Switch, Vehicle};
use goshawk_vehicle::switch;

use super::Findings;
use crate::report::health;

/// How long it may go on without us, s. Chosen by eye.
const LOSS_TIME_S: std::ops::RangeInclusive<f32> = 0.1..=1.0;

/// The link, as far as it has been listened to.
pub(super) fn judge(link: &Result<AutopilotLink, String>, vehicle: &Vehicle, findings: &mut Findings) {
    let link = match link {
        Ok(link) => link,
        Err(why) => return findings.fail("autopilot", why.clone()),
    };
    let status = link.status(clock::now());
    if let Some(problem) = link.line_problem().or_else(|| silence(&status)) {
        return findings.fail("autopilot", problem);
    }
    let mode = status.mode.map_or_else(|| "unknown".to_owned(), |mode| mode.to_string());
    let standing = match status.problem().or_else(|| link.refusal(clock::now())) {
        Some(problem) => Err(problem),
        None => on_ground(&status).map(|()| format!("{}, mode {mode}, disarmed, on the ground", status.firmware)),
    };
    findings.judge("autopilot", standing);
    position(&status, vehicle.sensors.odometry, findings);
    match health::battery_problem(&status, vehicle.limits.battery_start) {
        Some(problem) => findings.fail("battery", problem),
        None => match status.battery_fraction {
            Some(fraction) => findings.ok("battery", format!("{:.0} %", fraction * 100.0)),
            None => findings.warn("battery", "the autopilot does not measure it: watch the time"),
        },
    }
    match status.round_trip_s {
        Some(trip) => findings.ok("clocks", format!("synchronised, round trip {:.1} ms", trip * 1e3)),
        None => findings.warn(
            "clocks",
            "not synchronised, stamps are from arrivals: see that the autopilot answers TIMESYNC on this link",
        ),
    }
    if let Some(row) = &vehicle.switch {
        pilots_switch(link, row, findings);
    }
    if status.counters.unchecked > 0 {
        findings
            .warn("signing", "the autopilot signs what it sends and may refuse what we do not: set signing_key_file");
    }
    let [first, second] = status.firmware.parameters();
    match status.firmware {
        Firmware::Px4 => {
            loss_time(first, link.parameter(first), "what COM_OBL_RC_ACT says follows", findings);
            loss_action(second, link.parameter(second), findings);
            let told = |name: &&'static str| Some((*name, link.parameter(name)?));
            sticks(status.firmware.stick_parameters().iter().find_map(told), findings);
        }
        Firmware::ArduPilot(_) => {
            thrust_option(first, &status, findings);
            let then = "it levels, keeps its height and drifts: the pilot takes over";
            loss_time(second, link.parameter(second), then, findings);
        }
    }
}

/// Where the pilot's switch stands.
fn pilots_switch(link: &AutopilotLink, row: &Switch, findings: &mut Findings) {
    let radio = link.radio();
    let us = radio.and_then(|radio| *radio.channels_us.get(usize::from(row.channel).checked_sub(1)?)?);
    let standing = match (switch::problem(clock::now(), row, radio.as_ref()), us) {
        (None, Some(us)) => {
            let at = row.position(us).map_or("between its positions".to_owned(), |position| format!("at {position}"));
            Ok(format!("channel {} stands {at}, {us} µs", row.channel))
        }
        (problem, _) => Err(problem.unwrap_or_else(|| "it has no pulse".to_owned())),
    };
    findings.judge("switch", standing);
}

/// Others may pose as the autopilot. A key that cannot be read is told of as the link's failure.
pub(super) fn exposure(vehicle: &Vehicle, findings: &mut Findings) {
    if let Some(why) = vehicle.link().ok().and_then(|config| config.exposure()) {
        findings.warn("mavlink", why);
    }
}

/// The key's file is for its owner alone. A key that cannot be read is told of as the link's failure.
pub(super) fn signing(vehicle: &Vehicle, findings: &mut Findings) {
    let Some(file) = &vehicle.autopilot.signing_key_file else { return };
    let path = vehicle.resolve(file);
    let Ok(metadata) = std::fs::metadata(&path) else { return };
    if metadata.permissions().mode() & 0o077 == 0 {
        findings.ok("signing", format!("with the key of {}", path.display()));
    } else {
        let path = path.display();
        findings.warn("signing", format!("others may read the key: chmod 600 {path}"));
    }
}

/// Why nothing is known of it; none: it is heard.
fn silence(status: &Status) -> Option<String> {
    if status.connected { None } else { status.problem() }
}

fn on_ground(status: &Status) -> Result<(), String> {
    if status.armed {
        Err("it is armed: disarm it".to_owned())
    } else if status.landed == Some(false) {
        Err("it believes to be in the air: set it down and wait for its landing detector".to_owned())
    } else {
        Ok(())
    }
}

/// The name that is told is the parameter's own: nobody reads "parameter 1".
fn loss_time(name: &'static str, parameter: Option<Parameter>, then: &str, findings: &mut Findings) {
    match parameter {
        Some(Parameter::Real(seconds)) if LOSS_TIME_S.contains(&seconds) => {
            findings.ok(name, format!("{seconds} s without us, then {then}"));
        }
        Some(other) => findings.fail(name, format!("{}: without us it waits that long; set 0.5 (s)", plain(other))),
        None => findings.warn(name, "not answered: set it to 0.5 (s), how long the autopilot waits for us"),
    }
}

fn loss_action(name: &'static str, parameter: Option<Parameter>, findings: &mut Findings) {
    match parameter {
        Some(Parameter::Int(3)) => findings.ok(name, "3, return"),
        Some(Parameter::Int(4)) => findings.ok(name, "4, land"),
        Some(Parameter::Int(5)) => findings.ok(name, "5, hold"),
        Some(other) => {
            let danger = "without us and without sticks it sinks blindly, or cuts the motors";
            findings.fail(name, format!("{}: {danger}; set 4 (land) or 5 (hold)", plain(other)));
        }
        None => findings.warn(name, "not answered: set it to 4 (land), what the autopilot does without us"),
    }
}

/// Whether the autopilot stands by its position: what is flown by, or what it would come down by without us.
fn position(status: &Status, source: OdometrySource, findings: &mut Findings) {
    match (health::position_problem(source, status), status.position, source) {
        (Some(problem), ..) => findings.fail("position", problem),
        (None, Some(true), _) => findings.ok("position", "the autopilot stands by its own"),
        (None, Some(false), _) => findings.warn(
            "position",
            "the autopilot has none of its own: we fly by in/odometry, but without us it comes down blindly, drifting",
        ),
        (None, None, _) if status.firmware == Firmware::Px4 => {
            findings.warn("position", "the autopilot does not say whether its own is valid");
        }
        (None, None, _) => {} // ArduPilot says it in no message that we know
    }
}

/// What takes over when the pilot moves a stick; the name is that of the parameter that this version has.
fn sticks(told: Option<(&'static str, Parameter)>, findings: &mut Findings) {
    const SWITCH: &str = "the pilot takes over by the mode switch";
    match told {
        Some((name, Parameter::Real(speed))) if speed >= 0.0 => findings.ok(
            name,
            format!(
                "{speed}: a stick that moves faster than {speed} of its travel a second takes over too, a slow push does \
                 not; {SWITCH}"
            ),
        ),
        Some((name, Parameter::Int(bits))) if bits & 2 != 0 => {
            findings.ok(name, format!("{bits}: moving a stick takes over too; {SWITCH}"));
        }
        Some((name, other)) => findings.warn(name, format!("{}: sticks take nothing over; {SWITCH} alone", plain(other))),
        None => findings.warn(
            "sticks",
            format!("neither MAN_OVERRIDE_SPD nor COM_RC_OVERRIDE is answered: sticks may take nothing over; {SWITCH}"),
        ),
    }
}

fn thrust_option(name: &'static str, status: &Status, findings: &mut Findings) {
    match (status.thrust_problem(), status.guided_options) {
        (None, Some(options)) => findings.ok(name, format!("{}: our thrust is taken as thrust", plain(options))),
        (problem, _) => findings.fail(name, problem.unwrap_or_else(|| "not answered".to_owned())),
    }
}

fn plain(parameter: Parameter) -> String {
    match parameter {
        Parameter::Int(value) => value.to_string(),
        Parameter::Real(value) => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::Level;
    use goshawk_autopilot::Guided;

    #[test]
    fn what_the_autopilot_would_do_without_us_is_judged() {
        let level = |parameter| {
            let mut findings = Findings::default();
            loss_action("COM_OBL_RC_ACT", parameter, &mut findings);
            findings.conditions[0].level
        };
        assert_eq!(level(Some(Parameter::Int(4))), Level::Ok);
        assert_eq!(level(Some(Parameter::Int(0))), Level::Failed);
        assert_eq!(level(Some(Parameter::Int(7))), Level::Failed);
        assert_eq!(level(None), Level::Warning);
    }

    #[test]
    fn how_long_it_waits_for_us_is_judged() {
        let level = |parameter| {
            let mut findings = Findings::default();
            loss_time("GUID_TIMEOUT", parameter, "it levels", &mut findings);
            findings.conditions[0].level
        };
        assert_eq!(level(Some(Parameter::Real(0.5))), Level::Ok);
        assert_eq!(level(Some(Parameter::Real(3.0))), Level::Failed, "ArduPilot's default: 3 s of the last attitude");
        assert_eq!(level(Some(Parameter::Real(f32::NAN))), Level::Failed);
        assert_eq!(level(Some(Parameter::Int(1))), Level::Failed);
        assert_eq!(level(None), Level::Warning);
    }

    #[test]
    fn what_takes_over_is_told_of_either_version() {
        let found = |told| {
            let mut findings = Findings::default();
            sticks(told, &mut findings);
            let found = findings.conditions.remove(0);
            assert!(found.text.contains("mode switch"), "{found:?}");
            (found.name, found.level)
        };
        let (new, old) = ("MAN_OVERRIDE_SPD", "COM_RC_OVERRIDE");
        assert_eq!(found(Some((new, Parameter::Real(1.0)))), (new, Level::Ok));
        assert_eq!(found(Some((new, Parameter::Real(-1.0)))), (new, Level::Warning));
        assert_eq!(found(Some((old, Parameter::Int(3)))), (old, Level::Ok));
        assert_eq!(found(Some((old, Parameter::Int(1)))), (old, Level::Warning), "in the other modes only");
        assert_eq!(found(None), ("sticks", Level::Warning));
    }

    #[test]
    fn a_position_that_the_autopilot_does_not_stand_by_fails_where_it_is_flown_by() {
        let found = |valid: bool, source| {
            let position_fault = (!valid).then_some(goshawk_autopilot::PositionFault::Flags);
            let mut findings = Findings::default();
            position(&Status { position: Some(valid), position_fault, ..Status::default() }, source, &mut findings);
            findings.conditions[0].level
        };
        assert_eq!(found(true, OdometrySource::Autopilot), Level::Ok);
        assert_eq!(found(false, OdometrySource::Autopilot), Level::Failed);
        assert_eq!(found(false, OdometrySource::Zenoh), Level::Warning);
    }

    #[test]
    fn thrust_that_would_be_a_climb_rate_is_no_flight() {
        let found = |guided_options| {
            let mut findings = Findings::default();
            let firmware = Firmware::ArduPilot(Guided::Guided);
            thrust_option("GUID_OPTIONS", &Status { firmware, guided_options, ..Status::default() }, &mut findings);
            findings.conditions.remove(0)
        };
        assert_eq!(found(Some(Parameter::Int(8))).level, Level::Ok);
        assert_eq!(found(None).level, Level::Failed);
        let climb = found(Some(Parameter::Int(1)));
        assert!(climb.level == Level::Failed && climb.text.contains("set it to 9"), "{climb:?}");
    }
}
