//! Faults of a flight's senses, injected on purpose: what goes wrong, from when on, and by which name the vehicle is to
//! notice it. When and how is a pure function of the flight's seed.

mod camera;
mod network;
mod odometry;

use std::cell::Cell;
use std::fmt;
use std::rc::Rc;
use std::str::FromStr;

use goshawk_core::Time;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::sense::rgbd::mix;
pub use camera::{CameraFault, Tampered};
pub use network::{FaultyNetwork, NetworkFault, drawn};
pub use odometry::{Falsified, OdometryError, followed};

/// A fault begins so long after the task's beginning, s: drawn evenly.
const ONSET_S: [f64; 2] = [1.0, 4.0];

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fault {
    /// In the camera's stream.
    Camera(CameraFault),
    /// In the network's answers.
    Network(NetworkFault),
    /// In the estimate of the motion.
    Odometry(OdometryError),
}

impl Fault {
    /// Every fault, in the order in which they are shown.
    #[must_use]
    pub fn all() -> Vec<Fault> {
        let camera = CameraFault::ALL.map(Fault::Camera);
        let network = NetworkFault::ALL.map(Fault::Network);
        let odometry = OdometryError::ALL.map(Fault::Odometry);
        camera.into_iter().chain(network).chain(odometry).collect()
    }

    /// Its name on the command line and in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Fault::Camera(fault) => fault.name(),
            Fault::Network(fault) => fault.name(),
            Fault::Odometry(error) => error.name(),
        }
    }

    /// The names under which the vehicle may report it: any of them is right.
    #[must_use]
    pub fn noticed_as(self) -> &'static [&'static str] {
        match self {
            Fault::Camera(fault) => fault.noticed_as(),
            Fault::Network(fault) => fault.noticed_as(),
            Fault::Odometry(error) => error.noticed_as(),
        }
    }

    /// When it begins in the flight of this seed, s after the task's beginning; 0: it is there from the first.
    #[must_use]
    pub fn onset_s(self, seed: u64) -> f64 {
        if self == Fault::Odometry(OdometryError::HeadingFromStart) {
            return 0.0;
        }
        ChaCha8Rng::seed_from_u64(mix(seed, 21)).random_range(ONSET_S[0]..ONSET_S[1])
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let all = Fault::all();
        all.iter().copied().find(|fault| fault.name() == text).ok_or_else(|| {
            let names: Vec<&str> = all.iter().map(|fault| fault.name()).collect();
            format!("there is no fault {text:?}: the faults are {}", names.join(", "))
        })
    }
}

/// The fault of one flight, and whether it acts yet.
#[derive(Clone, Debug)]
pub struct Injection {
    fault: Option<Fault>,
    onset_s: f64,
    begun: Option<Time>,
    acting: Rc<Cell<bool>>,
}

impl Injection {
    /// Of the flight of this seed; none: nothing goes wrong.
    #[must_use]
    pub fn new(fault: Option<Fault>, seed: u64) -> Self {
        let onset_s = fault.map_or(0.0, |fault| fault.onset_s(seed));
        Self { fault, onset_s, begun: None, acting: Rc::default() }
    }

    /// The time is `now`, and the task has been flown for `task_for_s`, s; 0: it has not begun.
    pub fn advance(&mut self, now: Time, task_for_s: f64) {
        if self.fault.is_some() && self.begun.is_none() && task_for_s >= self.onset_s {
            self.begun = Some(now);
            self.acting.set(true);
        }
    }

    /// When it began; none: nothing is wrong yet.
    #[must_use]
    pub fn begun(&self) -> Option<Time> {
        self.begun
    }

    /// What is wrong now.
    #[must_use]
    pub fn acting(&self) -> Option<Fault> {
        self.fault.filter(|_| self.begun.is_some())
    }

    /// What is wrong with the estimate of the motion, and since when.
    #[must_use]
    pub fn odometry(&self) -> Option<(OdometryError, Time)> {
        match self.fault {
            Some(Fault::Odometry(error)) => self.begun.map(|begun| (error, begun)),
            _ => None,
        }
    }

    /// True from the onset on, for whom the time is not told.
    #[must_use]
    pub fn flag(&self) -> Rc<Cell<bool>> {
        Rc::clone(&self.acting)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_read_by_its_own_name_and_an_unknown_one_is_told_which_there_are() {
        let all = Fault::all();
        for fault in &all {
            assert_eq!(fault.name().parse(), Ok(*fault));
            assert!(!fault.noticed_as().is_empty());
        }
        let message = "gremlins".parse::<Fault>().unwrap_err();
        assert!(all.iter().all(|fault| message.contains(fault.name())), "{message}");
    }

    #[test]
    fn the_seed_alone_says_when_a_fault_begins() {
        let fault = Fault::all()[0];
        let onsets: Vec<f64> = (0..50).map(|seed| fault.onset_s(seed)).collect();
        assert!(onsets.iter().all(|onset| (ONSET_S[0]..ONSET_S[1]).contains(onset)));
        assert!(onsets.iter().any(|onset| *onset < 1.6) && onsets.iter().any(|onset| *onset > 3.4));
        assert_eq!(fault.onset_s(7), fault.onset_s(7));
    }

    #[test]
    fn a_fault_acts_from_its_onset_on() {
        let mut injection = Injection::new(Some(Fault::all()[0]), 3);
        let flag = injection.flag();
        injection.advance(Time::from_secs(5.0), 0.0);
        assert_eq!((injection.acting(), flag.get()), (None, false));
        injection.advance(Time::from_secs(9.0), ONSET_S[1]);
        injection.advance(Time::from_secs(10.0), ONSET_S[1] + 1.0);
        assert_eq!((injection.begun(), flag.get()), (Some(Time::from_secs(9.0)), true));
    }
}
