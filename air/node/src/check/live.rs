//! What others must do: the network, the autopilot, the camera and the odometry, listened to for a few seconds.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use goshawk_autopilot::AutopilotLink;
use goshawk_bus::Bus;
use goshawk_core::{Odometry, Time};
use goshawk_policy::{Policy, Preprocessor};
use goshawk_proto::keys::Key;
use goshawk_vehicle::clock;
use goshawk_vehicle::config::{OdometrySource, Vehicle};
use goshawk_vehicle::sensors::{self, Frame};

use super::{Findings, autopilot};
use crate::network::access::{Access, Guard, INSECURE};

/// Streams are looked at so often.
const POLL: Duration = Duration::from_millis(5);
/// Streams are counted for this long once the first sample is there, s. Chosen by eye.
const COUNTED_S: f64 = 2.0;
/// Fewer pictures than this a second are a camera that is set up wrong, Hz. Chosen by eye.
const LEAST_CAMERA_HZ: f64 = 20.0;
/// Less odometry than this is too little to fly with, Hz. Chosen by eye.
const LEAST_ODOMETRY_HZ: f64 = 25.0;
/// Of the pixels, with a depth within the sensor's range. Chosen by eye.
const LEAST_MEASURED: f64 = 0.2;
/// A colour image with less contrast than this (standard deviation, of 255) shows nothing. Chosen by eye.
const LEAST_CONTRAST: f64 = 2.0;
/// What the autopilot did not tell is asked for again after this, s. Chosen by eye.
const ASK_AGAIN_S: f64 = 0.5;

/// A stream's samples so far.
struct Stream<T> {
    first: Option<Time>,
    last: Option<Time>,
    count: u64,
    /// Samples that are the one before again.
    repeated: u64,
    refused: u64,
    /// Why the newest of those was.
    why: String,
    newest: Option<T>,
}

impl<T> Default for Stream<T> {
    fn default() -> Self {
        Stream { first: None, last: None, count: 0, repeated: 0, refused: 0, why: String::new(), newest: None }
    }
}

impl<T> Stream<T> {
    fn take(&mut self, now: Time, sample: T, same: impl Fn(&T, &T) -> bool) {
        self.first.get_or_insert(now);
        self.last = Some(now);
        self.count += 1;
        self.repeated += u64::from(self.newest.as_ref().is_some_and(|newest| same(newest, &sample)));
        self.newest = Some(sample);
    }

    fn refuse(&mut self, why: &impl ToString) {
        self.refused += 1;
        self.why = why.to_string();
    }

    fn rate_hz(&self) -> f64 {
        let span = self.first.zip(self.last).map_or(0.0, |(first, last)| last.since(first));
        if self.count > 1 && span > 0.0 { (self.count - 1) as f64 / span } else { 0.0 }
    }

    fn counted(&self, now: Time) -> bool {
        self.first.is_some_and(|first| now.since(first) >= COUNTED_S)
    }
}

/// What is listened to.
pub(super) struct Ears {
    frames: Arc<Mutex<Stream<Frame>>>,
    odometry: Arc<Mutex<Stream<Odometry>>>,
    /// The autopilot, or why there is none.
    pub link: Result<AutopilotLink, String>,
    source: OdometrySource,
    _bus: Option<Bus>,
}

impl Ears {
    /// Begins to listen.
    pub(super) fn open(vehicle: &Vehicle, findings: &mut Findings) -> Self {
        let (frames, odometry) = (Arc::default(), Arc::default());
        let access = access(vehicle, findings);
        let bus = access.and_then(|access| network(vehicle, &access, &frames, &odometry, findings));
        let link = vehicle.link().and_then(|config| AutopilotLink::open(config, clock::now)).map_err(|e| e.to_string());
        Self { frames, odometry, link, source: vehicle.sensors.odometry, _bus: bus }
    }

    /// Waits a little, and takes the autopilot's odometry where that is flown by.
    pub(super) fn poll(&self) -> Time {
        std::thread::sleep(POLL);
        let now = clock::now();
        if let Ok(link) = &self.link
            && self.source == OdometrySource::Autopilot
            && let Some(newest) = link.odometry()
        {
            take_odometry(&self.odometry, now, newest);
        }
        now
    }

    /// The newest odometry, and the newest picture.
    pub(super) fn newest(&self) -> (Option<Odometry>, Option<Frame>) {
        (lock(&self.odometry).newest, lock(&self.frames).newest.clone())
    }

    /// Both streams have been counted long enough.
    fn counted(&self, now: Time) -> bool {
        lock(&self.frames).counted(now) && lock(&self.odometry).counted(now)
    }
}

/// Listens until all is known, at most `wait_s` seconds, and judges.
pub(super) fn listen(vehicle: &Vehicle, policy: Option<&Policy>, wait_s: f64, findings: &mut Findings) {
    let ears = Ears::open(vehicle, findings);
    let parameters = vehicle.autopilot.firmware().parameters();
    let sticks = vehicle.autopilot.firmware().stick_parameters();
    let begun = clock::now();
    let (mut now, mut asked) = (begun, begun);
    while now.since(begun) < wait_s {
        now = ears.poll();
        if let Ok(link) = &ears.link
            && now.since(asked) > ASK_AGAIN_S
        {
            asked = now;
            for name in parameters.iter().chain(sticks) {
                let _ = link.request_parameter(name); // without a peer there is nobody to ask; it is asked again
            }
        }
        let told = |link: &AutopilotLink, name: &str| link.parameter(name).is_some();
        let known = ears.link.as_ref().is_ok_and(|link| {
            let sticks = sticks.is_empty() || sticks.iter().any(|name| told(link, name));
            let radio = vehicle.switch.is_none() || link.radio().is_some();
            parameters.iter().all(|name| told(link, name)) && sticks && radio
        });
        if known && ears.counted(now) {
            break;
        }
    }
    autopilot::signing(vehicle, findings);
    autopilot::exposure(vehicle, findings);
    autopilot::judge(&ears.link, vehicle, findings);
    camera(&lock(&ears.frames), policy, findings);
    motion(&lock(&ears.odometry), vehicle.sensors.odometry, findings);
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn take_odometry(odometry: &Mutex<Stream<Odometry>>, now: Time, newest: Odometry) {
    let mut stream = lock(odometry);
    if stream.newest.is_none_or(|held| newest.stamp > held.stamp) {
        match sensors::plausible(newest) {
            Ok(sample) => stream.take(now, sample, |_, _| false),
            Err(why) => stream.refuse(&why),
        }
    }
}

/// Who would be let in.
fn access(vehicle: &Vehicle, findings: &mut Findings) -> Option<Access> {
    let access = vehicle
        .name
        .parse()
        .map_err(|e| format!("{e}"))
        .and_then(|name| Access::new(vehicle, name).map_err(|e| e.to_string()));
    match access {
        Ok(access) => {
            match access.guard() {
                Guard::ThisHost => findings.ok("access", "only this host is listened to"),
                Guard::Nobody => findings.warn("access", INSECURE),
                Guard::Identity(identity) => match identity.describe() {
                    (words, None) => findings.ok("access", words),
                    (words, Some(worry)) => findings.warn("access", format!("{words}; {worry}")),
                },
            }
            Some(access)
        }
        Err(why) => {
            findings.fail("access", why);
            None
        }
    }
}

fn network(
    vehicle: &Vehicle,
    access: &Access,
    frames: &Arc<Mutex<Stream<Frame>>>,
    odometry: &Arc<Mutex<Stream<Odometry>>>,
    findings: &mut Findings,
) -> Option<Bus> {
    let open = || -> Result<Bus, String> {
        let bus = access.listen().map_err(|e| e.to_string())?;
        let stream = Arc::clone(frames);
        let receive = move |payload: &[u8], _| {
            let now = clock::now();
            match sensors::frame(payload, now) {
                Ok(frame) => lock(&stream).take(now, frame, |a, b| a.rgb == b.rgb && a.depth_mm == b.depth_mm),
                Err(why) => lock(&stream).refuse(&why),
            }
        };
        bus.subscribe(Key::Rgbd, receive).map_err(|e| e.to_string())?;
        if vehicle.sensors.odometry == OdometrySource::Zenoh {
            let stream = Arc::clone(odometry);
            let receive = move |payload: &[u8], _| {
                let now = clock::now();
                match sensors::odometry(payload, now) {
                    Ok(sample) => take_odometry(&stream, now, sample),
                    Err(why) => lock(&stream).refuse(&why),
                }
            };
            bus.subscribe(Key::Odometry, receive).map_err(|e| e.to_string())?;
        }
        Ok(bus)
    };
    match open() {
        Ok(bus) => {
            findings.ok("network", format!("listening on {}", access.endpoints()));
            Some(bus)
        }
        Err(why) => {
            findings.fail("network", why);
            None
        }
    }
}

fn camera(stream: &Stream<Frame>, policy: Option<&Policy>, findings: &mut Findings) {
    findings.judge("camera", camera_problem(stream, policy));
}

fn camera_problem(stream: &Stream<Frame>, policy: Option<&Policy>) -> Result<String, String> {
    let refused = stream.refused;
    let Some(frame) = &stream.newest else {
        let key = Key::Rgbd.row().suffix;
        return Err(if refused > 0 {
            format!("{refused} images were refused; of the last, {}: mend the driver", stream.why)
        } else {
            format!("no image has come on {key}: start the camera's driver")
        });
    };
    let hz = stream.rate_hz();
    if hz < LEAST_CAMERA_HZ {
        return Err(format!("{hz:.1} images a second, at least {LEAST_CAMERA_HZ} are needed: set the driver's rate"));
    }
    if stream.repeated * 2 > stream.count {
        return Err("the image does not change: restart the camera".to_owned());
    }
    if let Some(policy) = policy {
        Preprocessor::new(policy.contract(), frame.source()).map_err(|e| e.to_string())?;
    }
    let contrast = contrast(&frame.rgb);
    if contrast < LEAST_CONTRAST {
        return Err(format!(
            "the image is blank (contrast {contrast:.1} of 255): take the lens cap off, give it light"
        ));
    }
    let mut measured: Vec<u16> = frame.depth_mm.iter().copied().filter(|mm| (200..20_000).contains(mm)).collect();
    let share = measured.len() as f64 / frame.depth_mm.len() as f64;
    if share < LEAST_MEASURED {
        return Err(format!(
            "only {:.0} % of the depth image is measured: point it at something between 0.2 and 20 m, clean the lenses",
            share * 100.0
        ));
    }
    measured.sort_unstable();
    let median_m = f64::from(measured[measured.len() / 2]) / 1000.0;
    let (width, height) = (frame.width, frame.height);
    Ok(format!("{width} x {height} at {hz:.0} Hz, {:.0} % with depth, median {median_m:.1} m", share * 100.0))
}

fn contrast(rgb: &[u8]) -> f64 {
    let n = rgb.len() as f64;
    let mean = rgb.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
    (rgb.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / n).sqrt()
}

fn motion(stream: &Stream<Odometry>, source: OdometrySource, findings: &mut Findings) {
    let from = match source {
        OdometrySource::Autopilot => "the autopilot's estimate",
        OdometrySource::Zenoh => Key::Odometry.row().suffix,
    };
    let hz = stream.rate_hz();
    findings.judge(
        "odometry",
        match &stream.newest {
            None if stream.refused > 0 => {
                Err(format!("{} samples of {from} were refused; of the last, {}", stream.refused, stream.why))
            }
            None => Err(format!("none has come from {from}: see that it has a position (GPS, flow, VIO)")),
            Some(_) if hz < LEAST_ODOMETRY_HZ => {
                Err(format!("{hz:.1} Hz from {from}, at least {LEAST_ODOMETRY_HZ} are needed: raise its stream's rate"))
            }
            Some(o) if o.vel_world.norm() > 0.5 => {
                Err(format!("it says {:.1} m/s while standing: let the estimator settle", o.vel_world.norm()))
            }
            Some(_) => Ok(format!("{hz:.0} Hz from {from}")),
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(rgb: u8, depth: u16) -> Frame {
        let rgb = (0..4 * 2 * 3).map(|k| if k % 2 == 0 { rgb } else { 100 }).collect();
        Frame {
            seq: 0,
            stamp: Time(0),
            width: 4,
            height: 2,
            hfov: 1.57,
            vfov: 1.08,
            rgb,
            depth_mm: vec![depth; 8],
            print: 0,
            fault: None,
        }
    }

    fn stream(frames: impl Fn(u64) -> Frame, hz: f64) -> Stream<Frame> {
        let mut stream = Stream::default();
        for k in 0..20 {
            stream.take(Time::from_secs(k as f64 / hz), frames(k), |a, b| a.rgb == b.rgb && a.depth_mm == b.depth_mm);
        }
        stream
    }

    #[test]
    fn a_camera_that_is_slow_frozen_blank_or_without_depth_is_told_apart() {
        let moving = |k: u64| frame(k as u8 + 1, 3000);
        let good = camera_problem(&stream(moving, 30.0), None).unwrap();
        assert!(good.contains("30 Hz") && good.contains("median 3.0 m"), "{good}");
        let problem = |stream: &Stream<Frame>| camera_problem(stream, None).unwrap_err();
        assert!(problem(&Stream::default()).contains("no image"));
        assert!(problem(&stream(moving, 10.0)).contains("10.0 images"));
        assert!(problem(&stream(|_| frame(7, 3000), 30.0)).contains("does not change"));
        assert!(problem(&stream(|k| frame(100, 3000 + k as u16), 30.0)).contains("blank"));
        assert!(problem(&stream(|k| frame(k as u8, 0), 30.0)).contains("0 %"));
    }
}
