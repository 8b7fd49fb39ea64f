//! The hand checks before the first flight: a person moves the vehicle as asked, and its own sensors say whether they
//! agree with each other and with the vehicle file. What was found right is stamped, for Start wants it.

mod moves;
mod pictures;

use std::path::Path;
use std::time::SystemTime;

use goshawk_core::{History, Rot, Time, Vec3};
use goshawk_vehicle::clock;
use goshawk_vehicle::config::Vehicle;
use goshawk_vehicle::errors::one_line;
use goshawk_vehicle::mounting;
use goshawk_vehicle::sensors::Frame;

use self::moves::{Move, Verdict, Watch, turned};
use self::pictures::{Picture, View};
use super::Findings;
use super::live::Ears;
use crate::run::Overrides;

/// A person has so long for each move, s. Chosen by eye.
const MOVE_S: f64 = 60.0;
/// A move that went wrong may be done again so often: a hand errs too.
const TRIES: u32 = 2;
/// Pictures of a turn are compared over this much of it, rad: 30°. Farther round they show another scene. By eye.
const COMPARED: f64 = 0.52;
/// And over this at least, rad: 9°. Chosen by eye.
const LEAST_COMPARED: f64 = 0.15;
/// The accelerometer may differ from the attitude by this, rad: 15°. Chosen by eye.
const PLUMB: f64 = 0.26;
/// Turned by less than this it lies as it did, rad. Chosen by eye.
const UNTURNED: f64 = 0.03;
/// Of a turn, pictures this far apart are compared, rad: 3°. Chosen by eye.
const APART: f64 = 0.05;

/// Walks a person through the moves and judges each; writes the stamp where all were right. `wait_s`: how long sensors
/// are waited for at first.
#[must_use]
pub fn check(config: &Path, overrides: Overrides, wait_s: f64) -> Findings {
    let mut findings = Findings::default();
    match Vehicle::load(config) {
        Ok(mut vehicle) => {
            let _ = overrides.apply(&mut vehicle);
            walk(&vehicle, wait_s, &mut findings);
        }
        Err(error) => findings.fail("vehicle file", one_line(&error)),
    }
    findings.settle();
    findings
}

fn walk(vehicle: &Vehicle, wait_s: f64, findings: &mut Findings) {
    let no_stamp = |error| format!("the stamp cannot be written beside {}: {error}", vehicle.path.display());
    if let Err(error) = can_stamp(vehicle) {
        return findings.fail("stamp", no_stamp(error));
    }
    let ears = Ears::open(vehicle, findings);
    if let Err(why) = senses(&ears, wait_s) {
        return findings.fail("sensors", why);
    }
    println!("Propellers off. Do what is said, hold still after it, and wait for the answer. Ctrl-C ends.");
    let mut hands = Hands { ears: &ears, history: History::new(), seen: Time(0), turns: Vec::new(), forces: 0 };
    for (index, asked) in Move::ALL.into_iter().enumerate() {
        println!("{} of {}: {}", index + 1, Move::ALL.len(), asked.instruction());
        let verdict = hands.judge(asked);
        findings.judge(asked.name(), verdict);
        let Some(told) = findings.conditions.last() else { continue };
        println!("{told}");
    }
    let before = findings.conditions.len();
    let mount = vehicle.body_from_cam();
    for (name, picture) in [("colour", Picture::Colour), ("depth", Picture::Depth)] {
        findings.judge(name, pictures::judge(picture, &hands.turns, &mount));
    }
    if hands.forces == 0 {
        findings.warn("accelerometer", "the autopilot sends none: it was not compared with the attitude");
    } else {
        findings.ok("accelerometer", "feels gravity where the attitude says that down is");
    }
    findings.settle();
    if findings.ready {
        let now = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
        let written = mounting::write(vehicle, now);
        findings.judge("stamp", written.map(|path| path.display().to_string()).map_err(no_stamp));
    }
    for told in &findings.conditions[before..] {
        println!("{told}");
    }
}

/// A person does not move the vehicle for a stamp that cannot be written.
fn can_stamp(vehicle: &Vehicle) -> std::io::Result<()> {
    let trial = mounting::stamp_path(&vehicle.path).with_extension("part");
    std::fs::File::create(&trial)?;
    std::fs::remove_file(&trial)
}

/// Waits until there is something to judge by.
fn senses(ears: &Ears, wait_s: f64) -> Result<(), String> {
    let begun = clock::now();
    loop {
        let now = ears.poll();
        let link = ears.link.as_ref().map_err(Clone::clone)?;
        if link.status(now).armed {
            return Err("the autopilot is armed: disarm it, and take the propellers off".to_owned());
        }
        let missing = match ears.newest() {
            (Some(_), Some(_)) => return Ok(()),
            (None, _) => "no odometry comes: goshawk-air check says why",
            (_, None) => "no picture comes: goshawk-air check says why",
        };
        if now.since(begun) > wait_s {
            return Err(missing.to_owned());
        }
    }
}

/// What is seen of one person's moves.
struct Hands<'a> {
    ears: &'a Ears,
    history: History,
    /// The last picture's exposure.
    seen: Time,
    /// Of each turn the picture before it, and those during it.
    turns: Vec<(View, Vec<View>)>,
    /// How often the accelerometer was compared.
    forces: u32,
}

impl Hands<'_> {
    /// Waits for the move, and says what it was.
    fn judge(&mut self, asked: Move) -> Result<String, String> {
        let mut tries = 0;
        loop {
            tries += 1;
            match self.once(asked) {
                Ok(text) => return Ok(text),
                Err(why) if tries < TRIES => println!("         {why}. Was it done as asked? Once more."),
                Err(why) => return Err(format!("{why}: {}", remedy(asked))),
            }
        }
    }

    fn once(&mut self, asked: Move) -> Result<String, String> {
        let mut watch = Watch::new(asked);
        let mut first: Option<View> = None;
        let mut during: Vec<(f64, View)> = Vec::new();
        let begun = clock::now();
        let mut told = Time(0);
        loop {
            let now = self.ears.poll();
            if now.since(begun) > MOVE_S {
                return Err(format!("nothing like it was seen for {MOVE_S:.0} s"));
            }
            let (Some(odometry), Some(frame)) = self.ears.newest() else { continue };
            let verdict = if odometry.stamp > told { watch.take(&odometry) } else { Verdict::Waiting };
            told = told.max(odometry.stamp);
            self.history.push_odometry(&odometry);
            if let (Some(base), Some(view)) = (&watch.base, self.view(frame)) {
                let turn = turned(base, &view.odometry).norm();
                let least = during.last().map_or(LEAST_COMPARED, |(last, _)| last + APART);
                if first.is_none() || turn < UNTURNED {
                    first = Some(view);
                } else if (least..COMPARED).contains(&turn) {
                    during.push((turn, view));
                }
            }
            match verdict {
                Verdict::Waiting => {}
                Verdict::Wrong(what) => return Err(what),
                Verdict::Right(what) => {
                    if let Some(first) = first.filter(|_| asked.is_turn() && !during.is_empty()) {
                        self.turns.push((first, during.into_iter().map(|(_, view)| view).collect()));
                    }
                    return self.plumb(&odometry.world_from_body).map(|()| what);
                }
            }
        }
    }

    /// The picture and where it was taken; none: it was had before, or nobody knows.
    fn view(&mut self, frame: Frame) -> Option<View> {
        let odometry = self.history.odometry_at(frame.stamp).filter(|_| frame.stamp > self.seen)?;
        self.seen = frame.stamp;
        Some(View { frame, odometry })
    }

    /// At rest the accelerometer feels what holds the vehicle against gravity: straight up.
    fn plumb(&mut self, world_from_body: &Rot) -> Result<(), String> {
        let Some(imu) = self.ears.link.as_ref().ok().and_then(goshawk_autopilot::AutopilotLink::imu) else {
            return Ok(());
        };
        self.forces += 1;
        let off = (world_from_body * imu.specific_force_body).angle(&Vec3::z());
        if off < PLUMB {
            return Ok(());
        }
        Err(format!(
            "the accelerometer feels gravity {:.0}° from where the attitude says that down is",
            off.to_degrees()
        ))
    }
}

/// Where the mistake is likely to be.
fn remedy(asked: Move) -> &'static str {
    match asked {
        Move::Level | Move::NoseUp | Move::RollRight | Move::TurnLeft => {
            "mend how the autopilot is mounted in it (PX4: SENS_BOARD_ROT, ArduPilot: AHRS_ORIENTATION), or the \
             estimator's frames (over ROS 2: rates); never a sign in the vehicle file"
        }
        Move::Lift | Move::Forward | Move::Left => {
            "see where the estimator's position and velocity (over ROS 2: velocity) come from, and that its frame is the \
             vehicle's"
        }
    }
}
