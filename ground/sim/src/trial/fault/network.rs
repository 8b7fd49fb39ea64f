//! A network that goes dead in flight: its answers are no numbers, endless, nothing, or drawn by chance.

use std::cell::Cell;
use std::rc::Rc;

use goshawk_core::NetworkOutput;
use goshawk_policy::{Contract, PolicyError};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::sense::rgbd::mix;
use crate::trial::Network;

/// What the network answers instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NetworkFault {
    /// NaN.
    Nan,
    /// Infinite.
    Infinite,
    /// Zero: always the same, whatever it is shown.
    Zero,
    /// The same numbers, drawn once.
    Random,
}

impl NetworkFault {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Nan, Self::Infinite, Self::Zero, Self::Random];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Nan => "network-nan",
            Self::Infinite => "network-infinite",
            Self::Zero => "network-zero",
            Self::Random => "network-random",
        }
    }

    /// What the network answers instead of `answer`; `drawn`: what a random one draws once.
    pub fn spoil(self, answer: &mut NetworkOutput, drawn: &NetworkOutput) {
        match self {
            Self::Nan => answer.values.fill(f32::NAN),
            Self::Infinite => answer.values.fill(f32::INFINITY),
            Self::Zero => answer.values.fill(0.0),
            Self::Random => answer.clone_from(drawn),
        }
    }

    pub(super) fn noticed_as(self) -> &'static [&'static str] {
        match self {
            Self::Nan | Self::Infinite => &["invalid"],
            Self::Zero | Self::Random => &["constant"],
        }
    }
}

/// A network that answers wrongly from an instant on.
pub struct FaultyNetwork<'a> {
    inner: &'a mut dyn Network,
    fault: Option<NetworkFault>,
    acting: Rc<Cell<bool>>,
    drawn: NetworkOutput,
}

impl<'a> FaultyNetwork<'a> {
    /// `inner` until `acting`; then `fault`. What is drawn is drawn from `seed`.
    pub fn new(inner: &'a mut dyn Network, fault: Option<NetworkFault>, acting: Rc<Cell<bool>>, seed: u64) -> Self {
        Self { inner, fault, acting, drawn: drawn(seed) }
    }
}

/// What a random fault of `seed` answers.
#[must_use]
pub fn drawn(seed: u64) -> NetworkOutput {
    let mut rng = ChaCha8Rng::seed_from_u64(mix(seed, 22));
    NetworkOutput { values: std::array::from_fn(|_| rng.random_range(-2.0..2.0)) }
}

impl Network for FaultyNetwork<'_> {
    fn contract(&self) -> &Contract {
        self.inner.contract()
    }

    fn infer(&mut self, rgbd: &[f32], state: &[f32]) -> Result<NetworkOutput, PolicyError> {
        let mut answer = self.inner.infer(rgbd, state)?;
        if let Some(fault) = self.fault.filter(|_| self.acting.get()) {
            fault.spoil(&mut answer, &self.drawn);
        }
        Ok(answer)
    }
}
