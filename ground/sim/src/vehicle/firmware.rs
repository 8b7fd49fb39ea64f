//! Real firmware in the loop: PX4 or ArduPilot, built by whoever flies it, gets what the vehicle's sensors measure and
//! gives what its rotors do. It speaks its own simulators' interface; both are in lockstep with the physics.
//!
//! [`Px4Hil`] is PX4's simulator interface (MAVLink over TCP, PX4 dials), [`ArduPilotJson`] ArduPilot's JSON interface
//! (UDP, ArduPilot sends first). Outside both everything is ENU and FLU. Until the firmware is there, and once it has
//! gone, the rotors stand still.

mod ardupilot;
mod earth;
mod process;
mod px4;

use std::collections::VecDeque;
use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use thiserror::Error;

use crate::vehicle::imu::{Imu, ImuSample};
use crate::vehicle::quadrotor::{QuadrotorState, STEP_S, Throttles};

pub use ardupilot::ArduPilotJson;
pub use process::{Process, ProcessError};
pub use px4::Px4Hil;

/// Steps over which an IMU's sample is the mean: PX4's simulated IMU has 250 Hz.
const IMU_STEPS: usize = 4;
/// How long physics waits for an answer while the rotors turn: longer than a busy machine keeps a process waiting.
const PATIENCE_FLYING: Duration = Duration::from_secs(1);
/// And while they stand: a firmware that boots does not answer everything.
const PATIENCE_STANDING: Duration = Duration::from_millis(20);

/// What can be measured aboard at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Sensed<'a> {
    /// The true motion.
    pub truth: &'a QuadrotorState,
    /// The IMU's sample.
    pub imu: ImuSample,
}

/// The IMU of a vehicle that firmware flies: each sample is the mean of what moved the vehicle over [`IMU_STEPS`].
pub struct Strapped {
    imu: Imu,
    past: VecDeque<QuadrotorState>,
}

impl Strapped {
    /// An IMU with its own errors.
    #[must_use]
    pub fn new(imu: Imu) -> Self {
        Self { imu, past: VecDeque::new() }
    }

    /// What it measures now; called once each step of physics.
    pub fn measure(&mut self, truth: &QuadrotorState) -> ImuSample {
        let before = self.past.front().copied().unwrap_or(*truth);
        let dt_s = STEP_S * self.past.len().max(1) as f64;
        if self.past.len() == IMU_STEPS {
            self.past.pop_front();
        }
        self.past.push_back(*truth);
        self.imu.spoil(ImuSample::between(&before, truth, dt_s), dt_s)
    }
}

/// A firmware that flies the vehicle by its rotors.
pub trait Firmware {
    /// The step of physics from `step` · 1 ms on begins: what the rotors do meanwhile. Waits for the firmware's answer
    /// where one is due, at most a second.
    fn step(&mut self, step: u64, sensed: &Sensed<'_>) -> Throttles;

    /// What has happened since the last call, in words for a person.
    fn take_news(&mut self) -> Vec<String>;
}

/// Why firmware cannot be served.
#[derive(Debug, Error)]
pub enum FirmwareError {
    /// Another process listens there.
    #[error("{0} is in use: another simulator listens there for firmware; stop it, or say --firmware-at ADDRESS:PORT")]
    PortInUse(SocketAddr),
    /// The socket cannot be made for another reason.
    #[error("cannot listen at {address} for firmware: {source}")]
    Socket {
        /// Where.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
}

impl FirmwareError {
    fn of(address: SocketAddr) -> impl Fn(io::Error) -> Self {
        move |source| match source.kind() {
            io::ErrorKind::AddrInUse => Self::PortInUse(address),
            _ => Self::Socket { address, source },
        }
    }
}

/// How long to wait for the next answer.
fn patience(throttles: &Throttles) -> Duration {
    if throttles.iter().any(|throttle| *throttle > 0.0) { PATIENCE_FLYING } else { PATIENCE_STANDING }
}

/// A rotor's command as physics takes it: 0..=1; what is not finite stands still.
fn throttle(command: f64) -> f64 {
    if command.is_finite() { command.clamp(0.0, 1.0) } else { 0.0 }
}
