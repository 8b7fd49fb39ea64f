//! What the senses make of the truth: messages that are false, late, out of order, or not there.

use goshawk_core::{NetworkOutput, Odometry, Time, Vec3};
use goshawk_policy::{Contract, PolicyError};
use goshawk_proto::v1;
use goshawk_vehicle::convert;
use prost::Message;
use std::cell::RefCell;
use std::rc::Rc;

use super::Acting;
use crate::commands::chaos::schedule::Kind;
use crate::render::Camera;
use crate::sense::rgbd::{RgbdImage, mix};
use crate::trial::Fault as Sense;
use crate::trial::fault::{CameraFault, Falsified, NetworkFault, OdometryError, Tampered, drawn};
use crate::trial::onboard::Network;

/// A line on which things come late and in another order.
pub(crate) struct Line<T> {
    waiting: Vec<(Time, T)>,
    held: Option<T>,
}

impl<T> Default for Line<T> {
    fn default() -> Self {
        Self { waiting: Vec::new(), held: None }
    }
}

impl<T> Line<T> {
    /// Sends `item`; `swapped`: of two the second goes first.
    pub(crate) fn send(&mut self, arrives: Time, item: T, swapped: bool) {
        match self.held.take() {
            Some(first) => self.waiting.extend([(arrives, item), (arrives, first)]),
            None if swapped => self.held = Some(item),
            None => self.waiting.push((arrives, item)),
        }
    }

    /// What has arrived by `now`, in the order of sending.
    pub(crate) fn arrived(&mut self, now: Time) -> Vec<T> {
        if self.waiting.iter().all(|(at, _)| *at > now) {
            return Vec::new();
        }
        let (there, still) = std::mem::take(&mut self.waiting).into_iter().partition(|(at, _)| *at <= now);
        self.waiting = still;
        let there: Vec<(Time, T)> = there;
        there.into_iter().map(|(_, item)| item).collect()
    }
}

/// The odometry's errors, those of each fault by themselves.
pub(crate) struct FalseOdometry {
    errors: Vec<(OdometryError, Falsified, Option<Time>)>,
}

impl FalseOdometry {
    pub(crate) fn new(seed: u64) -> Self {
        let error = |error: OdometryError| (error, Falsified::new(mix(seed, error as u64)), None);
        Self { errors: OdometryError::ALL.map(error).to_vec() }
    }

    /// What `estimate` becomes at `now`.
    pub(crate) fn apply(&mut self, now: Time, acting: &Acting, estimate: &Odometry) -> Odometry {
        let mut false_one = *estimate;
        for (error, falsified, begun) in &mut self.errors {
            let acts = acting.any(&Kind::Sense(Sense::Odometry(*error)));
            *begun = begun.or(Some(now)).filter(|_| acts);
            false_one = falsified.apply(begun.map(|begun| (*error, begun)), &false_one);
        }
        false_one
    }

    /// Which of them acts on what the autopilot flies by.
    pub(crate) fn followed(acting: &Acting) -> Option<OdometryError> {
        let turned = [OdometryError::Heading, OdometryError::HeadingFromStart];
        turned.into_iter().find(|error| acting.any(&Kind::Sense(Sense::Odometry(*error))))
    }
}

/// The message of an estimate; `stamp_off_s` on its stamp, `nan`: it is no number.
pub(crate) fn odometry_message(odometry: &Odometry, stamp_off_s: f64, nan: bool) -> Vec<u8> {
    let pos_world = if nan { Vec3::repeat(f64::NAN) } else { odometry.pos_world };
    let odometry = Odometry { stamp: odometry.stamp.plus(stamp_off_s), pos_world, ..*odometry };
    convert::odometry(0, &odometry).encode_to_vec()
}

/// The camera's errors.
pub(crate) struct FalsePictures {
    tampered: Vec<(CameraFault, Tampered)>,
    numbers: u64,
}

impl FalsePictures {
    pub(crate) fn new(seed: u64) -> Self {
        Self { tampered: Self::fresh(seed), numbers: 0 }
    }

    fn fresh(seed: u64) -> Vec<(CameraFault, Tampered)> {
        CameraFault::ALL.map(|fault| (fault, Tampered::new(mix(seed, fault as u64)))).to_vec()
    }

    /// What `image` becomes; false: it does not come at all.
    pub(crate) fn apply(&mut self, seed: u64, acting: &Acting, image: &mut RgbdImage) -> bool {
        self.numbers += 1;
        let mut delivered = true;
        for (fault, tampered) in &mut self.tampered {
            if acting.any(&Kind::Sense(Sense::Camera(*fault))) {
                delivered &= tampered.apply(*fault, self.numbers, image);
            } else if *fault == CameraFault::Frozen {
                // What it freezes at is the first picture of each fault.
                *tampered = Tampered::new(mix(seed, *fault as u64));
            }
        }
        delivered
    }
}

/// The message of a picture.
pub(crate) fn frame_message(seq: u64, stamp: Time, image: &RgbdImage, camera: &Camera) -> Vec<u8> {
    v1::Rgbd {
        seq,
        stamp_ns: stamp.0,
        width: image.width as u32,
        height: image.height as u32,
        hfov_rad: camera.hfov_rad,
        vfov_rad: camera.vfov_rad(),
        rgb: image.rgb.clone(),
        depth_mm: image.depth_mm.iter().flat_map(|mm| mm.to_le_bytes()).collect(),
    }
    .encode_to_vec()
}

/// What is wrong with the network now; the flight sets it, the network looks.
pub(crate) type Wrong = Rc<RefCell<Option<NetworkFault>>>;

/// What acts on the network.
pub(crate) fn wrong_network(acting: &Acting) -> Option<NetworkFault> {
    NetworkFault::ALL.into_iter().find(|fault| acting.any(&Kind::Sense(Sense::Network(*fault))))
}

/// A network that answers wrongly at times.
pub(crate) struct Spoilt<'a> {
    inner: &'a mut dyn Network,
    wrong: Wrong,
    drawn: NetworkOutput,
}

impl<'a> Spoilt<'a> {
    pub(crate) fn new(inner: &'a mut dyn Network, wrong: Wrong, seed: u64) -> Self {
        Self { inner, wrong, drawn: drawn(seed) }
    }
}

impl Network for Spoilt<'_> {
    fn contract(&self) -> &Contract {
        self.inner.contract()
    }

    fn infer(&mut self, rgbd: &[f32], state: &[f32]) -> Result<NetworkOutput, PolicyError> {
        let mut answer = self.inner.infer(rgbd, state)?;
        if let Some(fault) = *self.wrong.borrow() {
            fault.spoil(&mut answer, &self.drawn);
        }
        Ok(answer)
    }
}
