//! The choice among candidates.

/// What makes a candidate eligible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SelectConfig {
    /// Least objectness of a candidate that holds the target, 0..1 (0.5).
    pub min_objectness: f64,
}
