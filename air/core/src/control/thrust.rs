//! The normalised thrust that hovers, learnt in flight. Beyond the paper, whose thrust is in newtons.
//!
//! Along the body's z axis the specific force is f = g u / h, with u the commanded normalised thrust and h the hover
//! thrust. h is the mean of g u / f over the last seconds. It takes what is steady: battery, payload, a vehicle file that
//! is wrong. What changes faster, and every other axis, is left to the disturbance observer, which sees only what the
//! present h does not explain; the mean uses command and motion alone, so that the two cannot wind each other up.

use crate::values::types::{GRAVITY, NormalisedThrust};

/// The hover thrust's estimate.
#[derive(Clone, Copy, Debug)]
pub struct HoverThrust {
    /// What the estimate may come to, normalised.
    range: [f64; 2],
    estimate: f64,
    /// How much flight the estimate is worth, s.
    weight: f64,
    block: Block,
}

/// Integrals over a short while: the velocity's noise is too large for single samples.
#[derive(Clone, Copy, Debug, Default)]
struct Block {
    /// s.
    time: f64,
    /// ∫ u dt, s.
    thrust: f64,
    /// ∫ f dt, m/s.
    force: f64,
}

/// Time constant of forgetting, s. Chosen by eye: slow, for the observer takes what changes faster.
const MEMORY: f64 = 5.0;
/// What the first value weighs, as seconds of flight: as much as one block.
const PRIOR: f64 = 0.1;
/// Length of a block, s. Chosen by eye.
const BLOCK: f64 = 0.1;
/// Thrusts beyond the bounds by more than these factors are no hover: the motors' curve is another there. By eye.
const NEAR_HOVER: (f64, f64) = (0.6, 1.5);
/// A specific force that rotors in flight give, in g: less is a fall, more is contact. Chosen by eye.
const IN_FLIGHT: (f64, f64) = (0.4, 2.5);

impl HoverThrust {
    /// Believes `hover` until flight says otherwise; the estimate stays in `range`.
    #[must_use]
    pub fn new(range: [f64; 2], hover: f64) -> Self {
        Self { range, estimate: hover, weight: PRIOR, block: Block::default() }
    }

    /// The estimate, normalised; within the bounds.
    #[must_use]
    pub fn get(&self) -> f64 {
        self.estimate
    }

    /// Begins again from `hover`, brought within the bounds: at lift-off the thrust that lifted.
    pub fn restart(&mut self, hover: NormalisedThrust) {
        *self = Self::new(self.range, hover.0.clamp(self.range[0], self.range[1]));
    }

    /// What came before does not belong to what comes: on the ground, out of limits, after a jump.
    pub fn skip(&mut self) {
        self.block = Block::default();
    }

    /// Takes `dt` seconds in free flight at a commanded `thrust`; `force` is the specific force along body z that was
    /// felt meanwhile, m/s². A value that is not finite is not taken.
    pub fn step(&mut self, dt: f64, thrust: NormalisedThrust, force: f64) {
        if !(dt.is_finite() && dt > 0.0 && thrust.0.is_finite() && force.is_finite()) {
            self.skip();
            return;
        }
        self.block.time += dt;
        self.block.thrust += thrust.0 * dt;
        self.block.force += force * dt;
        if self.block.time >= BLOCK {
            let Block { time, thrust, force } = std::mem::take(&mut self.block);
            self.learn(time, thrust / time, force / time);
        }
    }

    fn learn(&mut self, time: f64, thrust: f64, force: f64) {
        let near = NEAR_HOVER.0 * self.range[0]..=NEAR_HOVER.1 * self.range[1];
        if !near.contains(&thrust) || !(IN_FLIGHT.0 * GRAVITY..=IN_FLIGHT.1 * GRAVITY).contains(&force) {
            return;
        }
        self.weight = self.weight * (-time / MEMORY).exp() + time;
        let found = GRAVITY * thrust / force;
        let estimate = self.estimate + (found - self.estimate) * (time / self.weight);
        self.estimate = estimate.clamp(self.range[0], self.range[1]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RANGE: [f64; 2] = [0.2, 0.55];

    /// Flies `seconds` at thrusts around the true hover thrust `hover`, the velocity noisy by `noise` m/s.
    fn fly(estimate: &mut HoverThrust, hover: f64, seconds: f64, noise: f64) {
        let mut before = 0.0;
        for k in 0..(seconds * 100.0) as u32 {
            let thrust = hover * (1.0 + 0.2 * (f64::from(k) * 0.03).sin());
            // White enough, and the same each time.
            let now = noise * ((f64::from(k) * 12.9898).sin() * 43_758.547).fract();
            estimate.step(0.01, NormalisedThrust(thrust), GRAVITY * thrust / hover + (now - before) / 0.01);
            before = now;
        }
    }

    #[test]
    fn a_hover_thrust_40_percent_wrong_either_way_is_found_within_two_seconds() {
        for hover in [0.21, 0.49] {
            let mut estimate = HoverThrust::new(RANGE, 0.35);
            fly(&mut estimate, hover, 2.0, 0.05);
            assert!((estimate.get() / hover - 1.0).abs() < 0.05, "{hover}: {}", estimate.get());
            fly(&mut estimate, hover, 8.0, 0.05);
            assert!((estimate.get() / hover - 1.0).abs() < 0.01, "{hover}: {}", estimate.get());
        }
    }

    #[test]
    fn a_gust_of_half_a_second_moves_a_settled_estimate_little() {
        let mut estimate = HoverThrust::new(RANGE, 0.35);
        fly(&mut estimate, 0.35, 10.0, 0.0);
        for _ in 0..50 {
            estimate.step(0.01, NormalisedThrust(0.35), GRAVITY - 3.0);
        }
        assert!((estimate.get() / 0.35 - 1.0).abs() < 0.05, "{}", estimate.get());
    }

    #[test]
    fn the_estimate_stays_within_its_bounds_and_comes_back_from_them_at_once() {
        let mut estimate = HoverThrust::new(RANGE, 0.35);
        fly(&mut estimate, 0.7, 30.0, 0.0);
        assert_eq!(estimate.get(), RANGE[1]);
        fly(&mut estimate, 0.35, 8.0, 0.0);
        assert!(estimate.get() < 0.4, "{}", estimate.get());
    }

    #[test]
    fn falling_standing_and_idling_teach_nothing() {
        for (thrust, force) in [(0.35, 0.5), (0.05, GRAVITY), (0.0, GRAVITY), (0.35, 40.0), (0.9, GRAVITY)] {
            let mut estimate = HoverThrust::new(RANGE, 0.35);
            for _ in 0..500 {
                estimate.step(0.01, NormalisedThrust(thrust), force);
            }
            assert!((estimate.get() - 0.35).abs() < 1e-12, "{thrust}, {force}");
        }
    }

    proptest! {
        #[test]
        fn whatever_comes_the_estimate_is_within_its_bounds(
            steps in prop::collection::vec((prop::num::f64::ANY, prop::num::f64::ANY, prop::num::f64::ANY), 1..50)
        ) {
            let mut estimate = HoverThrust::new(RANGE, 0.35);
            for (dt, thrust, force) in steps {
                estimate.step(dt, NormalisedThrust(thrust), force);
                prop_assert!((RANGE[0]..=RANGE[1]).contains(&estimate.get()));
            }
        }
    }
}
