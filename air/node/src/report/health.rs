//! Readiness and health: what is known of every part, and what to do where one is not right.

use goshawk_autopilot::{PositionFault, Status};
use goshawk_core::{OdometryFault, Time};
use goshawk_policy::{AnswerFault, StreamFault};
use goshawk_proto::keys::Key;
use goshawk_proto::v1;
use goshawk_vehicle::config::OdometrySource;
use goshawk_vehicle::stats::{RateMeter, Window};

/// An older image is told as missing, s: as the shipped `ladder.plan_stale_s`.
const FRAME_STALE_S: f64 = 0.3;
/// Older odometry is told as missing, s: before the shipped `ladder.odometry_stale_s` is reached. Chosen by eye.
const ODOMETRY_STALE_S: f64 = 0.15;
/// An older plan is told as missing, s. Chosen by eye.
const PLAN_STALE_S: f64 = 0.5;

/// Newest facts of every part, gathered by the telemetry thread.
#[derive(Default)]
pub struct Facts {
    /// Last image.
    pub frame: Option<Time>,
    /// Last odometry's own stamp.
    pub odometry: Option<Time>,
    /// What is false about the odometry, as the controller found.
    pub odometry_fault: Option<OdometryFault>,
    /// Last plan.
    pub plan: Option<Time>,
    /// Why the last frame got no plan; none after a plan.
    pub plan_failed: Option<String>,
    /// What is wrong with the camera's stream, as of the last image.
    pub camera_fault: Option<StreamFault>,
    /// What is wrong with the network, as of its last answer.
    pub answer_fault: Option<AnswerFault>,
    /// Why the policy did not answer its golden images as it should.
    pub warm_up_failed: Option<String>,
    /// Why the line to the autopilot is not open; none: it is.
    pub line: Option<String>,
    /// Why the autopilot would refuse to arm; none: it would not, or does not say.
    pub refusal: Option<String>,
    /// No flight of ours is under way, and none has just ended: motors that turn were started by somebody else.
    pub waits: bool,
    /// Whether the pilot's switch can be read, and why not; none: the vehicle has none.
    pub switch: Option<Result<(), String>>,
    /// Whether the frames were checked as mounted, and why not; none: the vehicle file asks for no check.
    pub mounting: Option<Result<(), String>>,
    /// Whose odometry is flown by.
    pub source: OdometrySource,
    /// The log cannot be written, and why.
    pub recorder_failed: Option<String>,
    /// Images a second.
    pub camera_rate: RateMeter,
    /// Plans a second.
    pub planner_rate: RateMeter,
    /// Controller steps a second.
    pub controller_rate: RateMeter,
    /// Odometry samples a second.
    pub odometry_rate: RateMeter,
    /// Exposure to plan.
    pub frame_to_plan: Window,
    /// The network alone.
    pub inference: Window,
    /// One controller step.
    pub controller_step: Window,
    /// How late controller steps begin.
    pub controller_late: Window,
}

/// Every readiness check with its reason. `battery_start`: the charge that a flight begins with at least, 0..1.
#[must_use]
pub fn checks(facts: &Facts, autopilot: &Status, refused: (u64, u64), battery_start: f64, now: Time) -> Vec<v1::Check> {
    let age = |stamp: Option<Time>| stamp.map(|stamp| now.since(stamp));
    let check = |name: &str, problem: Option<String>| v1::Check {
        name: name.to_owned(),
        ok: problem.is_none(),
        reason: problem.unwrap_or_default(),
    };
    let asked = [("switch", &facts.switch), ("mounting", &facts.mounting)];
    let asked = asked.into_iter().filter_map(|(name, found)| Some(check(name, found.clone()?.err())));
    let mut checks = vec![
        check(
            "camera",
            stale("image", Key::Rgbd.row().suffix, age(facts.frame), FRAME_STALE_S, refused.0)
                .or_else(|| facts.camera_fault.map(|fault| fault.text().to_owned())),
        ),
        check("odometry", odometry_problem(facts, autopilot, age(facts.odometry), refused.1)),
        check("autopilot", autopilot_problem(facts, autopilot)),
        check("policy", policy_problem(facts, age(facts.plan))),
        check("battery", battery_problem(autopilot, battery_start)),
        check("recorder", facts.recorder_failed.clone()),
    ];
    checks.extend(asked);
    checks
}

/// What the first of the `checks` that fails says, and how many more fail.
#[must_use]
pub fn first_problem(checks: &[v1::Check]) -> Option<String> {
    let mut failing = checks.iter().filter(|check| !check.ok);
    let first = failing.next()?;
    let more = failing.count();
    let more = if more > 0 { format!(" (and {more} more)") } else { String::new() };
    Some(format!("{}: {}{more}", first.name, first.reason))
}

fn stale(what: &str, source: &str, age_s: Option<f64>, limit_s: f64, refused: u64) -> Option<String> {
    let refused = if refused > 0 { format!(" ({refused} refused as malformed or implausible)") } else { String::new() };
    match age_s {
        None => Some(format!("no {what} has come yet: is {source} running?{refused}")),
        Some(age) if age > limit_s => Some(format!("the last {what} is {age:.1} s old: is {source} running?{refused}")),
        Some(_) => None,
    }
}

fn autopilot_problem(facts: &Facts, autopilot: &Status) -> Option<String> {
    let flown = autopilot.armed || autopilot.landed == Some(false);
    let elsewhere = || "it is armed or in the air, and not by us: land and disarm it".to_owned();
    facts
        .line
        .clone()
        .or_else(|| autopilot.problem())
        .or_else(|| (facts.waits && flown).then(elsewhere))
        .or_else(|| facts.refusal.clone())
}

fn odometry_problem(facts: &Facts, autopilot: &Status, age_s: Option<f64>, refused: u64) -> Option<String> {
    let stale = stale("odometry sample", "the odometry source", age_s, ODOMETRY_STALE_S, refused);
    let falsehood = facts.odometry_fault.filter(|fault| !fault.is_passing());
    // The autopilot's own word comes before what we conclude from its numbers, which are made up then.
    stale.or_else(|| position_problem(facts.source, autopilot)).or_else(|| falsehood.map(|fault| fault.to_string()))
}

/// The autopilot does not stand by the position that is flown by. One that is not flown by is no concern: odometry of
/// our own on `in/odometry` holds without it, and what the autopilot would do without us is told by `check`.
#[must_use]
pub fn position_problem(source: OdometrySource, autopilot: &Status) -> Option<String> {
    let fault = autopilot.position_fault.filter(|_| source == OdometrySource::Autopilot)?;
    if matches!(fault, PositionFault::Contradiction | PositionFault::Unfelt) {
        return Some(format!(
            "the autopilot's position is false: {fault}; start it again, and see what its estimator fuses"
        ));
    }
    Some(format!("the autopilot has no valid position: {fault}; give it GPS, optical flow or VIO, and wait"))
}

/// Too little charge for a flight.
#[must_use]
pub fn battery_problem(status: &Status, least: f64) -> Option<String> {
    let low = status.battery_fraction.filter(|fraction| *fraction < least);
    low.map(|f| format!("{:.0} % left, at least {:.0} % is needed: change it", f * 100.0, least * 100.0))
}

fn policy_problem(facts: &Facts, plan_age_s: Option<f64>) -> Option<String> {
    let dead = facts.answer_fault.map(|fault| fault.text().to_owned());
    if let Some(why) = facts.warm_up_failed.clone().or(dead) {
        return Some(why);
    }
    match (&facts.plan_failed, plan_age_s) {
        (Some(why), _) => Some(format!("the last frame got no plan: {why}")),
        (None, None) => Some("no frame has been planned from yet".to_owned()),
        (None, Some(age)) if age > PLAN_STALE_S => Some(format!("the last plan is {age:.1} s old")),
        (None, Some(_)) => None,
    }
}

/// Rates since the last call.
pub fn rates(facts: &mut Facts, now: Time) -> Vec<v1::Rate> {
    let rate = |name: &str, meter: &mut RateMeter| v1::Rate { name: name.to_owned(), hz: meter.read(now) };
    vec![
        rate("camera", &mut facts.camera_rate),
        rate("planner", &mut facts.planner_rate),
        rate("controller", &mut facts.controller_rate),
        rate("odometry", &mut facts.odometry_rate),
    ]
}

/// Latencies of the last samples.
pub fn latencies(facts: &mut Facts) -> Vec<v1::Latency> {
    let latency = |name: &str, window: &mut Window| {
        let q = window.quantiles();
        v1::Latency {
            name: name.to_owned(),
            p50_ms: q.p50_s * 1e3,
            p99_ms: q.p99_s * 1e3,
            max_ms: q.max_s * 1e3,
            count: q.count,
            histogram: window.histogram().to_vec(),
        }
    };
    vec![
        latency("frame_to_plan", &mut facts.frame_to_plan),
        latency("inference", &mut facts.inference),
        latency("controller_step", &mut facts.controller_step),
        latency("controller_late", &mut facts.controller_late),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use goshawk_autopilot::{Firmware, Guided};

    fn good() -> (Facts, Status, Time) {
        let now = Time::from_secs(10.0);
        let facts = Facts { frame: Some(now), odometry: Some(now), plan: Some(now), ..Facts::default() };
        let status = Status { connected: true, heartbeat_age_s: Some(0.1), ..Status::default() };
        (facts, status, now)
    }

    fn failing(facts: &Facts, status: &Status, now: Time) -> Vec<(String, String)> {
        checks(facts, status, (0, 0), 0.2, now).into_iter().filter(|c| !c.ok).map(|c| (c.name, c.reason)).collect()
    }

    #[test]
    fn all_parts_fresh_means_ready() {
        let (facts, status, now) = good();
        assert_eq!(failing(&facts, &status, now), vec![]);
    }

    #[test]
    fn the_first_problem_is_told_and_the_others_are_counted() {
        let (facts, status, now) = good();
        let told = |facts: &Facts| first_problem(&checks(facts, &status, (0, 0), 0.2, now));
        assert_eq!(told(&facts), None);
        let recorder = || Facts { recorder_failed: Some("disk full".to_owned()), ..good().0 };
        assert_eq!(told(&recorder()).as_deref(), Some("recorder: disk full"));
        let both = told(&Facts { camera_fault: Some(StreamFault::Frozen), ..recorder() });
        assert!(both.is_some_and(|both| both.starts_with("camera: ") && both.ends_with(" (and 1 more)")));
    }

    #[test]
    fn each_missing_part_is_named_with_a_reason() {
        let (facts, status, now) = good();
        let only = |facts: &Facts, status: &Status, now: Time, name: &str| {
            let failing = failing(facts, status, now);
            assert_eq!(failing.len(), 1, "{failing:?}");
            assert_eq!(failing[0].0, name);
            assert!(!failing[0].1.is_empty());
        };
        only(&Facts { frame: None, ..good().0 }, &status, now, "camera");
        only(&Facts { frame: Some(Time::from_secs(9.0)), ..good().0 }, &status, now, "camera");
        only(&Facts { odometry: None, ..good().0 }, &status, now, "odometry");
        let fault = Some(OdometryFault::PositionDisagrees);
        only(&Facts { odometry_fault: fault, ..good().0 }, &status, now, "odometry");
        only(&Facts { plan_failed: Some("NaN".to_owned()), ..good().0 }, &status, now, "policy");
        only(&Facts { recorder_failed: Some("disk full".to_owned()), ..good().0 }, &status, now, "recorder");
        only(&Facts { camera_fault: Some(StreamFault::Frozen), ..good().0 }, &status, now, "camera");
        only(&Facts { answer_fault: Some(AnswerFault::Constant), ..good().0 }, &status, now, "policy");
        only(&Facts { warm_up_failed: Some("it answers NaN".to_owned()), ..good().0 }, &status, now, "policy");
        only(&facts, &Status { connected: false, heartbeat_age_s: None, ..status }, now, "autopilot");
        let without = |fault| Status { position: Some(false), position_fault: Some(fault), ..status };
        only(&facts, &without(PositionFault::Contradiction), now, "odometry");
        let lost = without(PositionFault::Flags);
        only(&facts, &lost, now, "odometry");
        let doubted = failing(&Facts { odometry_fault: fault, ..good().0 }, &lost, now);
        assert!(doubted[0].1.contains("the autopilot has no valid position"), "{doubted:?}");
        let ours = Facts { source: OdometrySource::Zenoh, ..good().0 };
        assert_eq!(failing(&ours, &lost, now), vec![], "odometry of our own holds without it");
        only(&facts, &Status { unanswered: true, ..status }, now, "autopilot");
        only(&Facts { switch: Some(Err("not heard".to_owned())), ..good().0 }, &status, now, "switch");
        only(&Facts { refusal: Some("it refuses".to_owned()), ..good().0 }, &status, now, "autopilot");
        let line = Some("serial:/dev/ttyACM0:921600 broke".to_owned());
        only(&Facts { line, ..good().0 }, &status, now, "autopilot");
        only(&facts, &Status { firmware: Firmware::ArduPilot(Guided::Guided), ..status }, now, "autopilot");
        for elsewhere in [Status { armed: true, ..status }, Status { landed: Some(false), ..status }] {
            only(&Facts { waits: true, ..good().0 }, &elsewhere, now, "autopilot");
            assert_eq!(failing(&facts, &elsewhere, now), vec![], "in a flight of ours");
        }
        only(&facts, &Status { battery_fraction: Some(0.1), ..status }, now, "battery");
    }
}
