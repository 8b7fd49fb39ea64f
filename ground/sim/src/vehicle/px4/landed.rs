//! PX4's landed detector as measured: it never feels the ground, it only sees low thrust and no motion.

use super::VehicleState;
use goshawk_core::Time;

/// Thrust below which it may have landed, above which it believes that it has taken off (0.2–0.3 does, measured).
const LOW_THRUST: f64 = 0.15;
/// From thrust 0 on the ground to landed: 2–2.6 s measured.
const STILL_S: f64 = 2.3;
/// Take-off was detected 24 ms after thrust was raised.
const THRUST_S: f64 = 0.02;
const STILL_MPS: f64 = 0.4;
const STILL_RADPS: f64 = 0.5;

/// A change of mind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Detected {
    Takeoff,
    Landing,
}

#[derive(Clone, Debug)]
pub(super) struct LandedDetector {
    landed: bool,
    /// Since when the evidence has been against `landed`.
    contrary_since: Option<Time>,
}

impl LandedDetector {
    /// A vehicle that stands.
    pub(super) fn new() -> Self {
        Self { landed: true, contrary_since: None }
    }

    pub(super) fn landed(&self) -> bool {
        self.landed
    }

    /// `thrust`: as demanded of the rotors; 0 when disarmed.
    pub(super) fn step(&mut self, now: Time, thrust: f64, vehicle: &VehicleState) -> Option<Detected> {
        let low = thrust < LOW_THRUST;
        let still = vehicle.vel_world.norm() < STILL_MPS && vehicle.ang_vel_body.norm() < STILL_RADPS;
        let (contrary, wait_s) = if self.landed { (!low, THRUST_S) } else { (low && still, STILL_S) };
        if !contrary {
            self.contrary_since = None;
            return None;
        }
        let since = *self.contrary_since.get_or_insert(now);
        if now.since(since) < wait_s {
            return None;
        }
        self.landed = !self.landed;
        self.contrary_since = None;
        Some(if self.landed { Detected::Landing } else { Detected::Takeoff })
    }
}
