//! Real firmware in a lockstep flight: it flies the rotors, and the pilot speaks MAVLink with it as on the vehicle.
//!
//! Physics and firmware are in lockstep by the firmware's simulator interface. Its MAVLink is not: the threads on both
//! sides need wall time. So simulated time runs at most [`PACE`] times as fast, and waits for a state estimate that is
//! overdue. Two such flights are alike, not equal.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use goshawk_autopilot::{AutopilotError, AutopilotLink, Status};
use goshawk_core::{AutopilotStatus, ControllerOutput, Imu as Inertial, Odometry, Time, Vec3};
use goshawk_vehicle::config::Vehicle;
use thiserror::Error;

use super::TrialConfig;
use crate::seeds::sha256_of_file;
use crate::sense::rgbd::mix;
use crate::vehicle::firmware::{ArduPilotJson, FirmwareError, Process, ProcessError, Px4Hil, Sensed, Strapped};
use crate::vehicle::imu::Imu;
use crate::vehicle::quadrotor::{Quadrotor, STEP_S};

/// Simulated seconds in one of the wall, at most.
const PACE: f64 = 2.0;
/// Firmware that boots has sensors, an estimate and a position within this, s of the wall.
const READY_WITHIN: Duration = Duration::from_mins(2);
/// And stays so for this long before it is flown, s.
const READY_FOR_S: f64 = 2.0;
/// An estimate this old is none, s.
const FRESH_S: f64 = 0.2;
/// An estimate this old is overdue: it comes every 10 ms, or every 33 from a firmware that does as it likes, s.
const OVERDUE_S: f64 = 0.04;
/// Simulated time waits so long for it: then the firmware is silent, and the pilot is to see that.
const AWAITED_FOR: Duration = Duration::from_millis(500);

/// Which firmware flies: the folder of its source tree or of its build.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Firmware {
    /// PX4.
    Px4(PathBuf),
    /// `ArduPilot` Copter.
    ArduPilot(PathBuf),
}

impl Firmware {
    /// SHA-256 of its program.
    ///
    /// # Errors
    /// There is none, or it cannot be read.
    pub fn sha256(&self) -> Result<String, ProcessError> {
        let program = match self {
            Self::Px4(tree) => Process::px4_program(tree),
            Self::ArduPilot(tree) => Process::ardupilot_program(tree),
        }?;
        sha256_of_file(&program).map_err(|source| ProcessError::Start { program, source })
    }
}

/// Why real firmware does not fly.
#[derive(Debug, Error)]
pub enum FirmwareTrouble {
    /// Its interface cannot be served.
    #[error(transparent)]
    Interface(#[from] FirmwareError),
    /// It does not start.
    #[error(transparent)]
    Process(#[from] ProcessError),
    /// Its MAVLink cannot be met.
    #[error(transparent)]
    Link(#[from] AutopilotError),
    /// It has ended.
    #[error("the firmware has ended: {0}")]
    Ended(String),
    /// It is not ready.
    #[error("the firmware was not ready within two minutes: {0}")]
    NotReady(String),
}

/// Firmware that flies the vehicle of one flight, and the pilot's line to it.
pub(crate) struct InTheLoop {
    firmware: Box<dyn crate::vehicle::firmware::Firmware>,
    process: Process,
    link: AutopilotLink,
    /// Simulated time, ns, as the link's clock.
    clock: Arc<AtomicU64>,
    imu: Strapped,
    vehicle: Vehicle,
    heard: (Option<Time>, Option<Time>),
    begun: Instant,
    /// The last estimate was waited for in vain.
    silent: bool,
}

impl InTheLoop {
    /// Starts it, and awaits it at its customary port.
    pub(crate) fn start(which: &Firmware, config: &TrialConfig, vehicle: &Vehicle) -> Result<Self, FirmwareTrouble> {
        let local = |port: u16| (std::net::Ipv4Addr::LOCALHOST, port).into();
        let seed = mix(config.seed, 17);
        let (firmware, process): (Box<dyn crate::vehicle::firmware::Firmware>, _) = match which {
            Firmware::Px4(tree) => (Box::new(Px4Hil::listen(local(4560), seed)?), Process::px4(tree, 0)?),
            Firmware::ArduPilot(tree) => (Box::new(ArduPilotJson::listen(local(9002))?), Process::ardupilot(tree, 0)?),
        };
        let clock = Arc::new(AtomicU64::new(1_000_000_000));
        let of_link = Arc::clone(&clock);
        let link = AutopilotLink::open(vehicle.link()?, move || Time(of_link.load(Ordering::Relaxed)))?;
        let imu = Strapped::new(Imu::new(config.sensors.imu, mix(config.seed, 15)));
        let (vehicle, begun) = (vehicle.clone(), Instant::now());
        Ok(Self { firmware, process, link, clock, imu, vehicle, heard: (None, None), begun, silent: false })
    }

    /// Lets it boot and find itself; how many steps that took.
    pub(crate) fn get_ready(
        &mut self,
        quad: &mut Quadrotor,
        ground_m: impl Fn(f64, f64) -> f64 + Copy,
    ) -> Result<u64, FirmwareTrouble> {
        let (mut step, mut ready_for_s) = (0, 0.0);
        while ready_for_s < READY_FOR_S {
            self.drive(step, quad, Vec3::zeros(), ground_m)?;
            step += 1;
            let now = Time(self.clock.load(Ordering::Relaxed));
            let status = self.link.status(now);
            let fresh = self.link.odometry().is_some_and(|odometry| now.since(odometry.stamp) < FRESH_S);
            ready_for_s = if fresh && may_fly(&status) { ready_for_s + STEP_S } else { 0.0 };
            if self.begun.elapsed() > READY_WITHIN {
                let why = status.problem().or_else(|| self.link.refusal(now));
                return Err(FirmwareTrouble::NotReady(why.unwrap_or_else(|| self.process.last_words())));
            }
        }
        Ok(step)
    }

    /// Flies one step of physics, in pace with the wall.
    ///
    /// # Errors
    /// It has ended: no vehicle fails by that.
    pub(crate) fn drive(
        &mut self,
        step: u64,
        quad: &mut Quadrotor,
        wind_world: Vec3,
        ground_m: impl Fn(f64, f64) -> f64,
    ) -> Result<(), FirmwareTrouble> {
        if let Some(ended) = self.process.ended() {
            return Err(FirmwareTrouble::Ended(format!("{ended}: {}", self.process.last_words())));
        }
        let truth = quad.state();
        let sensed = Sensed { truth, imu: self.imu.measure(truth) };
        let throttles = self.firmware.step(step, &sensed);
        self.firmware.take_news();
        quad.drive(STEP_S, &throttles, wind_world, ground_m);
        let now_ns = self.clock.fetch_add(1_000_000, Ordering::Relaxed);
        let due = Duration::from_nanos((now_ns as f64 / PACE) as u64);
        if let Some(early) = due.checked_sub(self.begun.elapsed()) {
            std::thread::sleep(early);
        }
        let asked = Instant::now();
        while self.overdue() && !self.silent && asked.elapsed() < AWAITED_FOR {
            std::thread::sleep(Duration::from_micros(200));
        }
        self.silent = self.overdue();
        Ok(())
    }

    /// Estimates came, and the newest is older than one can be.
    fn overdue(&self) -> bool {
        let now = Time(self.clock.load(Ordering::Relaxed));
        self.heard.0.is_some() && self.link.odometry().is_some_and(|o| now.since(o.stamp) > OVERDUE_S)
    }

    /// State estimate and inertial sample, where they are new.
    pub(crate) fn news(&mut self) -> (Option<Odometry>, Option<Inertial>) {
        let odometry = self.link.odometry().filter(|odometry| self.heard.0 != Some(odometry.stamp));
        let imu = self.link.imu().filter(|imu| self.heard.1 != Some(imu.stamp));
        self.heard.0 = odometry.map(|odometry| odometry.stamp).or(self.heard.0);
        self.heard.1 = imu.map(|imu| imu.stamp).or(self.heard.1);
        (odometry, imu)
    }

    /// What the controller is told of it.
    pub(crate) fn status(&self, now: Time) -> AutopilotStatus {
        self.vehicle.sensors.odometry.concerning(&self.link.status(now))
    }

    /// Takes what the controller sends and asks. A setpoint that cannot be sent is lost, as on any link.
    pub(crate) fn take(&self, output: &ControllerOutput) {
        if let Some(setpoint) = &output.setpoint {
            let _ = self.link.send_setpoint(setpoint);
        }
        if let Some(request) = output.request {
            self.link.request(request);
        }
    }
}

/// It would let itself be armed and flown.
fn may_fly(status: &Status) -> bool {
    status.problem().is_none() && status.position != Some(false) && status.would_arm != Some(false)
}
