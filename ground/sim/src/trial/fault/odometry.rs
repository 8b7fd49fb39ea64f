//! An estimator that errs: what its position, velocity and heading become. Stamps go on, and the reset counter says
//! nothing.

use goshawk_core::{AttitudeThrust, Odometry, Rot, Time, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{PI, TAU};

use crate::sense::rgbd::mix;

/// What goes wrong with the estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OdometryError {
    /// 3 m/s more in a level direction.
    Velocity,
    /// 5 m away in a level direction, at once.
    Jump,
    /// 1 m higher, at once.
    Height,
    /// 1 m/s away in a level direction, of which the velocity says nothing.
    Drift,
    /// The heading is turned about, at once.
    Heading,
    /// The heading has been the wrong way round since before the take-off.
    HeadingFromStart,
    /// The velocity stays as it is.
    VelocityFrozen,
    /// All stays as it is.
    Frozen,
}

const VELOCITY_MPS: f64 = 3.0;
const JUMP_M: f64 = 5.0;
const HEIGHT_M: f64 = 1.0;
const DRIFT_MPS: f64 = 1.0;

impl OdometryError {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Velocity,
        Self::Jump,
        Self::Height,
        Self::Drift,
        Self::Heading,
        Self::HeadingFromStart,
        Self::VelocityFrozen,
        Self::Frozen,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Velocity => "odometry-velocity",
            Self::Jump => "odometry-jump",
            Self::Height => "odometry-height",
            Self::Drift => "odometry-drift",
            Self::Heading => "odometry-heading",
            Self::HeadingFromStart => "odometry-heading-from-start",
            Self::VelocityFrozen => "odometry-velocity-frozen",
            Self::Frozen => "odometry-frozen",
        }
    }

    pub(super) fn noticed_as(self) -> &'static [&'static str] {
        match self {
            Self::Velocity => &["velocity-stepped"],
            Self::Jump | Self::Height => &["position-jumped"],
            Self::Drift => &["position-disagrees"],
            Self::Heading => &["attitude-turned"],
            Self::HeadingFromStart => &["heading-disagrees"],
            // Whichever shows first.
            Self::VelocityFrozen | Self::Frozen => &["odometry-frozen", "position-disagrees", "velocity-stepped"],
        }
    }
}

/// Falsifies the estimate of a flight.
#[derive(Clone, Debug)]
pub struct Falsified {
    /// A level direction.
    direction: Vec3,
    /// The last estimate before the fault.
    last: Option<Odometry>,
}

impl Falsified {
    /// Of the flight of this seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let angle: f64 = ChaCha8Rng::seed_from_u64(mix(seed, 24)).random_range(0.0..TAU);
        Self { direction: Vec3::new(angle.cos(), angle.sin(), 0.0), last: None }
    }

    /// What `estimate` becomes; `error` with the time since when it acts, none: nothing is wrong.
    pub fn apply(&mut self, error: Option<(OdometryError, Time)>, estimate: &Odometry) -> Odometry {
        let acts = error.filter(|(_, begun)| estimate.stamp >= *begun);
        let Some((error, begun)) = acts else {
            self.last = Some(*estimate);
            return *estimate;
        };
        let last = *self.last.get_or_insert(*estimate);
        let mut o = *estimate;
        match error {
            OdometryError::Velocity => o.vel_world += self.direction * VELOCITY_MPS,
            OdometryError::Jump => o.pos_world += self.direction * JUMP_M,
            OdometryError::Height => o.pos_world.z += HEIGHT_M,
            OdometryError::Drift => o.pos_world += self.direction * (DRIFT_MPS * o.stamp.since(begun)),
            OdometryError::Heading | OdometryError::HeadingFromStart => {
                o.world_from_body = about() * o.world_from_body;
            }
            OdometryError::VelocityFrozen => o.vel_world = last.vel_world,
            OdometryError::Frozen => o = Odometry { stamp: o.stamp, ..last },
        }
        o
    }
}

/// What the attitude loop does with `setpoint`: it flies with the same estimate, and so by the same wrong heading.
#[must_use]
pub fn followed(error: Option<OdometryError>, setpoint: AttitudeThrust) -> AttitudeThrust {
    match error {
        Some(OdometryError::Heading | OdometryError::HeadingFromStart) => {
            AttitudeThrust { world_from_body: about().inverse() * setpoint.world_from_body, ..setpoint }
        }
        _ => setpoint,
    }
}

/// The wrong way round.
fn about() -> Rot {
    Rot::from_axis_angle(&Vec3::z_axis(), PI)
}
