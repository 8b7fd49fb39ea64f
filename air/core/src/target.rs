//! The target filter.

/// The filter's noise, gate and confirmation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetConfig {
    /// Variance of the target's acceleration, (m/s²)², per world axis (16, 16, 8).
    pub acc_variance: [f64; 3],
    /// Variance of a detection at short range, m² (0.02).
    pub measurement_variance: f64,
    /// Distance at which the detection's variance has doubled, m (6).
    pub variance_distance: f64,
    /// Largest inconsistency of a detection, in standard deviations (5).
    pub gate: f64,
    /// Detections needed among the last `confirm_of` frames to believe the target (4).
    pub confirm_hits: u32,
    /// Frames that confirmation looks back on, at most 32 (6).
    pub confirm_of: u32,
    /// How long the target is believed without being seen, s (0.5).
    pub blind_time: f64,
    /// Largest speed of a target, m/s (10).
    pub max_speed: f64,
    /// Detections farther than this are not believed, m (20).
    pub max_distance: f64,
    /// Added to the reachable set's radius, m (1).
    pub reacquire_margin: f64,
}
