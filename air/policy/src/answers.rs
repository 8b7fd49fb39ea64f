//! Watches the network's answers for a network that is dead: no numbers, or always the same ones whatever it is shown.
//! No clock, no I/O: a function of the answers so far.
//!
//! A plan that was made from such an answer is not flown; then the plan expires, and the vehicle brakes, holds and lands.

use goshawk_core::{ANCHORS, NetworkOutput, Time};

use crate::contract::Contract;

/// What is wrong with a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AnswerFault {
    /// No candidate is a number throughout.
    Invalid,
    /// Costs and objectness do not change, though what is shown does.
    Constant,
}

impl AnswerFault {
    /// A word for it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Invalid => "invalid",
            Self::Constant => "constant",
        }
    }

    /// What is seen, and what to do.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::Invalid => {
                "invalid: no candidate of the network is a number: name a policy that works, or another provider"
            }
            Self::Constant => {
                "constant: the network answers the same whatever it is shown: name a policy that works, or another \
                 provider"
            }
        }
    }
}

/// Answers must stay the same for so long before that is believed, s. Chosen by eye.
const CONSTANT_S: f64 = 0.5;
/// A fault is over once it has not been seen for so long, s. Chosen by eye.
const OVER_S: f64 = 0.5;
/// A change of less than this is none: a share of the value, and of 1. Chosen by eye.
const SAME: f32 = 1e-5;
/// The channels that must change.
const WATCHED: [&str; 2] = ["cost", "objectness"];

/// Watches one network.
#[derive(Clone, Debug)]
pub struct AnswerMonitor {
    /// Numbers of an answer that count, and where the watched ones begin.
    numbers: usize,
    watched: Vec<usize>,
    /// The first of the answers that are all the same, and what it was shown.
    first: Option<(Time, NetworkOutput, u64)>,
    /// What was believed last, and when it was seen last.
    believed: Option<(AnswerFault, Time)>,
}

impl AnswerMonitor {
    /// For a network of this contract.
    #[must_use]
    pub fn new(contract: &Contract) -> Self {
        let place = |name: &str| contract.channels.iter().position(|channel| channel == name);
        Self {
            numbers: contract.channels.len() * ANCHORS,
            watched: WATCHED.iter().filter_map(|name| place(name)).map(|channel| channel * ANCHORS).collect(),
            first: None,
            believed: None,
        }
    }

    /// Takes the answer to the frame that was exposed at `stamp`; `print`: [`crate::stream::Picture::prints`], or
    /// whatever else tells one image from another. Gives what is wrong now; none: the answer can be flown with.
    pub fn judge(&mut self, stamp: Time, print: u64, answer: &NetworkOutput) -> Option<AnswerFault> {
        let seen = if self.is_invalid(answer) {
            Some(AnswerFault::Invalid)
        } else {
            self.is_constant(stamp, print, answer).then_some(AnswerFault::Constant)
        };
        match seen {
            Some(fault) => self.believed = Some((fault, stamp)),
            None => self.believed = self.believed.filter(|(_, last)| stamp.since(*last) < OVER_S),
        }
        self.fault()
    }

    /// What is wrong with the network; none: nothing.
    #[must_use]
    pub fn fault(&self) -> Option<AnswerFault> {
        self.believed.map(|(fault, _)| fault)
    }

    fn is_invalid(&self, answer: &NetworkOutput) -> bool {
        let whole = |anchor: usize| answer.values[..self.numbers].iter().skip(anchor).step_by(ANCHORS);
        (0..ANCHORS).all(|anchor| !whole(anchor).all(|value| value.is_finite()))
    }

    fn is_constant(&mut self, stamp: Time, print: u64, answer: &NetworkOutput) -> bool {
        let same = |a: &NetworkOutput| {
            let mut pairs =
                self.watched.iter().flat_map(|&at| (at..at + ANCHORS).map(|i| (a.values[i], answer.values[i])));
            pairs.all(|(a, b)| a == b || (a - b).abs() <= SAME * (1.0 + a.abs()))
        };
        match &self.first {
            Some((since, first, shown)) if same(first) => *shown != print && stamp.since(*since) >= CONSTANT_S,
            _ => {
                self.first = Some((stamp, answer.clone(), print));
                false
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn monitor() -> AnswerMonitor {
        AnswerMonitor::new(&Contract::from_json(include_str!("../tests/contract.json")).unwrap())
    }

    fn answers(value: impl Fn(u64, usize) -> f32) -> Option<(AnswerFault, u64)> {
        let mut monitor = monitor();
        (0..60u64).find_map(|k| {
            let answer = NetworkOutput { values: std::array::from_fn(|i| value(k, i)) };
            monitor.judge(Time::from_secs(1.0 + k as f64 / 30.0), k, &answer).map(|fault| (fault, k))
        })
    }

    #[test]
    fn answers_that_vary_are_no_fault_even_if_some_candidates_are_no_numbers() {
        assert_eq!(answers(|k, i| (k as f32 * 0.3 + i as f32).sin()), None);
        assert_eq!(answers(|k, i| if i % ANCHORS < 14 { f32::NAN } else { k as f32 }), None);
    }

    #[test]
    fn no_numbers_are_named_at_once_and_constant_ones_within_a_second() {
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(answers(|_, _| value), Some((AnswerFault::Invalid, 0)));
        }
        for constant in [|_: usize| 0.0, |i: usize| (i as f32).sin()] {
            let (fault, frames) = answers(|_, i| constant(i)).unwrap();
            assert_eq!(fault, AnswerFault::Constant);
            assert!(frames < 30, "{frames}");
        }
    }

    #[test]
    fn the_same_answer_to_the_same_picture_is_no_fault() {
        let mut monitor = monitor();
        let answer = NetworkOutput { values: std::array::from_fn(|i| i as f32) };
        let named = (0..60u64).find_map(|k| monitor.judge(Time::from_secs(k as f64 / 30.0), 7, &answer));
        assert_eq!(named, None);
    }

    #[test]
    fn a_network_that_recovers_is_believed_again_after_a_while() {
        let mut monitor = monitor();
        let mut judge = |k: u64, value: f32| {
            let answer = NetworkOutput { values: [value; goshawk_core::MAX_CHANNELS * ANCHORS] };
            monitor.judge(Time::from_secs(k as f64 / 30.0), k, &answer)
        };
        assert_eq!(judge(0, f32::NAN), Some(AnswerFault::Invalid));
        assert_eq!(judge(5, 1.0), Some(AnswerFault::Invalid));
        assert_eq!(judge(20, 2.0), None);
    }
}
