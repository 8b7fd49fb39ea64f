//! Schedules by chance: a pure function of the campaign's seed and the schedule's number.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::schedule::{Fault, Kind, Odometry, OnStop, Schedule, Setting, Task};
use crate::sense::rgbd::mix;
use crate::trial::Fault as Sense;

/// Prepared scenes of each task.
pub const SCENES: usize = 12;
/// One schedule in so many chases an evader: the policy's network takes most of such a flight's time.
const TRACK_ONE_IN: u64 = 8;
/// Faults in a schedule, at most.
const MOST_FAULTS: usize = 7;
/// Share of the schedules with a pair of faults at an odd moment, and the ids of its commands.
const ODD_MOMENTS: f64 = 0.35;
const LATER_ID: u32 = 50;
/// One flight in so many lasts long enough for a landing and another flight, s.
const LONG: (f64, f64, f64) = (0.06, 18.0, 26.0);
/// The operator asks for the start then, s.
pub const START_S: f64 = 0.7;
/// Share of the faults that begin in the air, or about to be: after this time, s.
const AIRBORNE: (f64, f64) = (0.7, 3.0);
/// How long a fault lasts, s: drawn evenly on a logarithmic scale.
const LASTS_S: (f64, f64) = (0.03, 6.0);
/// Ids of commands that are drawn: few, so that some are repeated. 1 is the first start's.
const IDS: u32 = 6;

/// The schedule of this number.
#[must_use]
pub fn draw(seed: u64, index: u64) -> Schedule {
    let own = mix(mix(seed, 61), index);
    let mut rng = ChaCha8Rng::seed_from_u64(own);
    let setting = setting(&mut rng, index);
    let many = 1 + (0..MOST_FAULTS - 1).take_while(|_| rng.random_bool(0.72)).count();
    let mut faults: Vec<Fault> = (0..many).map(|_| fault(&mut rng, setting.length_s)).collect();
    faults.truncate(MOST_FAULTS - 2);
    if rng.random_bool(ODD_MOMENTS) {
        faults.extend(odd_moment(&mut rng));
    }
    Schedule { seed: own >> 16, setting, faults }
}

/// Two that meet where chance alone rarely puts them.
fn odd_moment(rng: &mut ChaCha8Rng) -> [Fault; 2] {
    let mut between = |low: f64, high: f64| milli(rng.random_range(low..high));
    let (early, gap, lasts) = (between(START_S, 6.0), between(0.02, 3.0), between(0.1, 1.0));
    let (near, kind) = (between(-0.3, 0.05), between(0.0, 4.0));
    let at = |at_s: f64, for_s, what| Fault { at_s: milli(at_s), for_s, what };
    match kind as u32 {
        // A flight that is stopped as it begins, and another one.
        0 => [at(early, 0.0, Kind::Stop(LATER_ID)), at(early + gap, 0.0, Kind::Start(LATER_ID + 1))],
        // The controller stands still as the start arrives.
        1 => [at(START_S + near, lasts, Kind::ControllerPaused), at(early, 0.0, Kind::Stop(LATER_ID))],
        // A stop while the controller stands still.
        2 => [at(early, lasts, Kind::ControllerPaused), at(early + 0.5 * lasts, 0.0, Kind::Stop(LATER_ID))],
        // A stop as the autopilot starts again.
        _ => [at(early, 0.0, Kind::Restarts(lasts)), at(early + near.abs(), 0.0, Kind::Stop(LATER_ID))],
    }
}

fn setting(rng: &mut ChaCha8Rng, index: u64) -> Setting {
    let track = index % TRACK_ONE_IN == TRACK_ONE_IN - 1;
    // A goal must lie inside the fence; a chase has none.
    let fence_m = if track { 4.0..10.0 } else { 8.3..11.0 };
    Setting {
        task: if track { Task::Track } else { Task::Navigate },
        scene: rng.random_range(0..SCENES),
        on_stop: [OnStop::Land, OnStop::Land, OnStop::Hover, OnStop::HandOver][rng.random_range(0..4)],
        odometry: if rng.random_bool(0.5) { Odometry::Autopilot } else { Odometry::Zenoh },
        fence_m: if rng.random_bool(0.3) { milli(rng.random_range(fence_m)) } else { 200.0 },
        ceiling_m: if rng.random_bool(0.2) { milli(rng.random_range(1.6..2.2)) } else { 30.0 },
        wind_mps: if rng.random_bool(0.2) { milli(rng.random_range(1.0..5.0)) } else { 0.0 },
        length_s: milli(if rng.random_bool(LONG.0) {
            rng.random_range(LONG.1..LONG.2)
        } else {
            rng.random_range(7.0..13.0)
        }),
    }
}

fn fault(rng: &mut ChaCha8Rng, length_s: f64) -> Fault {
    let airborne = rng.random_bool(AIRBORNE.0);
    let at_s = milli(rng.random_range(if airborne { AIRBORNE.1 } else { 0.0 }..length_s));
    let for_s = milli((rng.random_range(LASTS_S.0.ln()..LASTS_S.1.ln())).exp());
    Fault { at_s, for_s, what: kind(rng) }
}

fn kind(rng: &mut ChaCha8Rng) -> Kind {
    let senses = Sense::all();
    let mut late = |most: f64| milli(rng.random_range(0.01..most));
    let numbers = [late(3.0), late(0.4), late(0.3), late(0.5), late(4.0), late(3.0), late(0.25), late(1.0)];
    let stamp = |rng: &mut ChaCha8Rng| {
        let off = [0.02, 0.06, 0.3, 2.0, 60.0][rng.random_range(0..5)];
        if rng.random_bool(0.5) { off } else { -off }
    };
    let [commands, frames, odometry, plans, arms, boot, charge, cut] = numbers;
    match rng.random_range(0..48) {
        0..7 => Kind::Stop(rng.random_range(2..IDS)),
        7 | 8 => Kind::Start(rng.random_range(1..IDS)),
        9 => Kind::CommandsLost,
        10 => Kind::CommandsLate(commands),
        11 => Kind::CommandsRepeated(rng.random_range(2..5)),
        12..19 => Kind::Sense(senses[rng.random_range(0..senses.len())]),
        19 => Kind::FramesLost,
        20 => Kind::FramesLate(frames),
        21 => Kind::FramesSwapped,
        22 => Kind::FramesTwice,
        23 => Kind::FramesStamped(stamp(rng)),
        24 => Kind::OdometryLost,
        25 => Kind::OdometryLate(odometry),
        26 => Kind::OdometrySwapped,
        27 => Kind::OdometryNan,
        28 => Kind::OdometryStamped(stamp(rng)),
        29 => Kind::PlansLate(plans),
        30 => Kind::NotReady,
        31 => Kind::Unarmable,
        32 => Kind::Deaf,
        33 => Kind::ArmsLate(arms),
        34 => Kind::NoPosition,
        35 => Kind::Silent,
        36 => Kind::SetpointsLost,
        37 => Kind::PilotTakesOver,
        38 => Kind::LandsByItself,
        39 => Kind::Restarts(boot),
        40 => Kind::Disarms,
        41 => Kind::BatteryLow(charge),
        42 => Kind::PlannerPaused,
        43 => Kind::ControllerPaused,
        44 => Kind::DiskFull,
        45 => Kind::DiskSlow,
        _ => Kind::LogCut(cut),
    }
}

/// To a thousandth: a short line, and the same number when it is read back.
fn milli(x: f64) -> f64 {
    (x * 1000.0).round() / 1000.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn seed_and_number_alone_make_a_schedule_and_each_another() {
        assert_eq!(draw(1, 7), draw(1, 7));
        let lines: BTreeSet<String> = (0..50).flat_map(|i| [draw(1, i).line(), draw(2, i).line()]).collect();
        assert_eq!(lines.len(), 100);
    }

    #[test]
    fn every_kind_is_drawn_and_faults_overlap_often() {
        let schedules: Vec<Schedule> = (0..4000).map(|index| draw(3, index)).collect();
        let names: BTreeSet<&str> = schedules.iter().flat_map(|s| &s.faults).map(|f| f.what.name()).collect();
        assert_eq!(names.len(), 33 + Sense::all().len(), "{names:?}");
        let overlaps = |s: &&Schedule| {
            s.faults.iter().enumerate().any(|(i, a)| s.faults[i + 1..].iter().any(|b| b.acts(a.at_s) || a.acts(b.at_s)))
        };
        assert!(schedules.iter().filter(overlaps).count() > 1000);
        assert!(schedules.iter().all(|s| (1..=MOST_FAULTS).contains(&s.faults.len())));
    }
}
