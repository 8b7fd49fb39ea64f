//! Angles and lengths: what every module needs and no one owns.

use crate::values::types::{Rot, Vec3};
use std::f64::consts::{PI, TAU};

/// `angle` brought to -pi..=pi; 0 if it is not finite.
#[must_use]
pub fn wrap(angle: f64) -> f64 {
    if !angle.is_finite() {
        return 0.0;
    }
    let turned = (angle + PI).rem_euclid(TAU) - PI;
    turned.clamp(-PI, PI)
}

/// Heading of the body's x axis, rad.
#[must_use]
pub fn yaw_of(world_from_body: &Rot) -> f64 {
    let nose = world_from_body * Vec3::x();
    nose.y.atan2(nose.x)
}

/// `v` shortened to `limit`; zero if it is not finite.
#[must_use]
pub fn cap(v: Vec3, limit: f64) -> Vec3 {
    let norm = v.norm();
    if !norm.is_finite() {
        Vec3::zeros()
    } else if norm > limit {
        v * (limit / norm)
    } else {
        v
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn wrapping_keeps_the_direction(angle in -1e3..1e3f64) {
            let wrapped = wrap(angle);
            prop_assert!((-PI..=PI).contains(&wrapped));
            prop_assert!((wrapped.sin() - angle.sin()).abs() < 1e-9 && (wrapped.cos() - angle.cos()).abs() < 1e-9);
        }
    }
}
