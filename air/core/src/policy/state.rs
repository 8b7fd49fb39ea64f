//! What the network is told beside the image: its `state` input (eq. 5), camera frame.

use std::ops::Deref;

use crate::values::types::Vec3;

/// Most numbers that a `state` input has: with all that there is.
const MOST: usize = 16;

/// What a policy's `state` holds beyond the velocity and the acceleration, which are the paper's. The order is that of
/// the fields.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "any of them may be there")]
pub struct StateLayout {
    /// The world's up.
    pub up: bool,
    /// Where the trajectories should end, as a share of 2r.
    pub aim: bool,
    /// The way to it, one long (the paper's navigation). Not together with the aim.
    pub direction: bool,
    /// The share of the acceleration that the vehicle can give.
    pub agility: bool,
}

/// All that a `state` may hold. Vectors are in the camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StateParts {
    /// Velocity / (alpha v_max).
    pub velocity: Vec3,
    /// Acceleration / (alpha² a_max).
    pub acceleration: Vec3,
    /// The world's up, one long.
    pub up: Vec3,
    /// Where the trajectories should end / 2r, at most 1 long; zero: there is no such place.
    pub aim: Vec3,
    /// The share of alpha² a_max that the vehicle can give, 0..=1.
    pub agility: f64,
}

/// A `state` input, as long as its policy needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NetworkState {
    values: [f32; MOST],
    len: usize,
}

impl StateLayout {
    /// The names of what a state holds, in order.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        let more = [(self.up, "up"), (self.aim, "aim"), (self.direction, "direction"), (self.agility, "agility")];
        ["velocity", "acceleration"].into_iter().chain(more.into_iter().filter_map(|(held, name)| held.then_some(name)))
    }

    /// How many numbers that is.
    #[must_use]
    pub fn numbers(self) -> usize {
        6 + 3 * [self.up, self.aim, self.direction].iter().filter(|held| **held).count() + usize::from(self.agility)
    }

    /// The state of these parts.
    #[must_use]
    pub fn state(self, parts: &StateParts) -> NetworkState {
        let direction = parts.aim.try_normalize(1e-6).unwrap_or_default();
        let vectors = [
            (true, parts.velocity),
            (true, parts.acceleration),
            (self.up, parts.up),
            (self.aim, parts.aim),
            (self.direction, direction),
        ];
        let held = vectors.iter().filter(|(held, _)| *held).flat_map(|(_, vector)| vector.iter());
        let agility = self.agility.then_some(&parts.agility);
        let mut state = NetworkState { values: [0.0; MOST], len: 0 };
        for (value, x) in state.values.iter_mut().zip(held.chain(agility)) {
            *value = *x as f32;
            state.len += 1;
        }
        state
    }
}

impl NetworkState {
    /// A state that was logged; none: it is longer than any.
    #[must_use]
    pub fn from_slice(logged: &[f32]) -> Option<Self> {
        let mut values = [0.0; MOST];
        values.get_mut(..logged.len())?.copy_from_slice(logged);
        Some(Self { values, len: logged.len() })
    }
}

impl Deref for NetworkState {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.values[..self.len]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARTS: StateParts = StateParts {
        velocity: Vec3::new(0.1, 0.2, 0.3),
        acceleration: Vec3::new(0.4, 0.5, 0.6),
        up: Vec3::new(0.0, 0.0, 1.0),
        aim: Vec3::new(0.0, 0.5, 0.0),
        agility: 0.7,
    };

    #[test]
    fn the_paper_has_velocity_and_acceleration_alone() {
        let paper = StateLayout::default();
        assert_eq!(&*paper.state(&PARTS), [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]);
        assert_eq!((paper.numbers(), paper.names().collect::<Vec<_>>()), (6, vec!["velocity", "acceleration"]));
    }

    #[test]
    fn each_layout_is_as_long_as_its_state() {
        for bits in 0..16_u8 {
            let held = |bit: u8| bits & 1 << bit != 0;
            let layout = StateLayout { up: held(0), aim: held(1), direction: held(2), agility: held(3) };
            assert_eq!(layout.state(&PARTS).len(), layout.numbers(), "{layout:?}");
        }
    }

    #[test]
    fn a_direction_is_one_long_and_without_an_aim_there_is_none() {
        let layout = StateLayout { direction: true, ..StateLayout::default() };
        assert_eq!(layout.state(&PARTS)[6..], [0.0, 1.0, 0.0]);
        assert_eq!(layout.state(&StateParts { aim: Vec3::zeros(), ..PARTS })[6..], [0.0; 3]);
    }

    #[test]
    fn a_logged_state_comes_back_and_one_that_is_too_long_does_not() {
        let state = StateLayout { up: true, aim: true, direction: false, agility: true }.state(&PARTS);
        assert_eq!(NetworkState::from_slice(&state), Some(state));
        assert_eq!(NetworkState::from_slice(&[0.0; 17]), None);
    }
}
