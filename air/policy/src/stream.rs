//! The camera's stream as a whole: what one picture alone does not show.

use goshawk_core::Time;

/// A picture's place in its stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// Counted by the source.
    pub seq: u64,
    /// Middle of the exposure.
    pub stamp: Time,
    /// Which publisher it came from; 0: it does not say.
    pub source: u64,
}
