//! How wrong an estimate may be, from its covariance.

use nalgebra::Matrix3;

/// Standard deviations of the position that count, and the most that they come to, m. Chosen by eye.
const DOUBT: (f64, f64) = (2.0, 0.8);

/// How much nearer a target of this covariance (m²) may be, m.
#[must_use]
pub fn pos_doubt(covariance: &Matrix3<f64>) -> f64 {
    (DOUBT.0 * level_deviation(covariance)).min(DOUBT.1)
}

/// The larger standard deviation of the two level axes.
pub(crate) fn level_deviation(covariance: &Matrix3<f64>) -> f64 {
    covariance[(0, 0)].max(covariance[(1, 1)]).max(0.0).sqrt()
}
