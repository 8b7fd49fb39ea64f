//! ENU ↔ NED, FLU ↔ FRD: the only place that converts.
//!
//! World: ENU here (x east, y north, z up), NED on the wire. Body: FLU here (x forward, y left, z up), FRD on the
//! wire. Each function is its own inverse; both names exist so that a call reads in the direction that it goes.

use goshawk_core::{Rot, Vec3};
use nalgebra::{Quaternion, UnitQuaternion};
use std::f64::consts::FRAC_1_SQRT_2;

/// A vector or point, north-east-down → east-north-up.
#[must_use]
pub fn enu_from_ned(ned: Vec3) -> Vec3 {
    Vec3::new(ned.y, ned.x, -ned.z)
}

/// A vector or point, east-north-up → north-east-down.
#[must_use]
pub fn ned_from_enu(enu: Vec3) -> Vec3 {
    Vec3::new(enu.y, enu.x, -enu.z)
}

/// A body vector, forward-right-down → forward-left-up.
#[must_use]
pub fn flu_from_frd(frd: Vec3) -> Vec3 {
    Vec3::new(frd.x, -frd.y, -frd.z)
}

/// A body vector, forward-left-up → forward-right-down.
#[must_use]
pub fn frd_from_flu(flu: Vec3) -> Vec3 {
    Vec3::new(flu.x, -flu.y, -flu.z)
}

/// `world_from_body` (ENU from FLU) of the wire's attitude (NED from FRD).
#[must_use]
pub fn world_from_body(ned_from_frd: &Rot) -> Rot {
    change_both_frames(ned_from_frd)
}

/// The wire's attitude (NED from FRD) of `world_from_body` (ENU from FLU). Its w is not negative.
#[must_use]
pub fn ned_from_frd(world_from_body: &Rot) -> Rot {
    change_both_frames(world_from_body)
}

/// `ned_from_enu ⊗ q ⊗ flu_from_frd`, where `ned_from_enu` is (0, 1, 1, 0)/√2 and `flu_from_frd` is (0, 1, 0, 0),
/// multiplied out and signed so that w ≥ 0. Its own inverse.
fn change_both_frames(q: &Rot) -> Rot {
    let (w, x, y, z) = (q.w, q.i, q.j, q.k);
    let out = Quaternion::new(w + z, x + y, x - y, w - z) * FRAC_1_SQRT_2;
    UnitQuaternion::new_normalize(if out.w < 0.0 { -out } else { out })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    /// Yaw in NED of an ENU attitude: 0 is north, clockwise seen from above.
    fn ned_euler_deg(world_from_body: &Rot) -> (f64, f64, f64) {
        let (roll, pitch, yaw) = ned_from_frd(world_from_body).euler_angles();
        (roll.to_degrees(), pitch.to_degrees(), yaw.to_degrees())
    }

    fn yaw(radians: f64) -> Rot {
        Rot::from_axis_angle(&nalgebra::Vector3::z_axis(), radians)
    }

    #[test]
    fn each_axis_of_the_world_has_its_sign() {
        assert_eq!(ned_from_enu(Vec3::new(1.0, 0.0, 0.0)), Vec3::new(0.0, 1.0, 0.0)); // east
        assert_eq!(ned_from_enu(Vec3::new(0.0, 1.0, 0.0)), Vec3::new(1.0, 0.0, 0.0)); // north
        assert_eq!(ned_from_enu(Vec3::new(0.0, 0.0, 1.0)), Vec3::new(0.0, 0.0, -1.0)); // up
        assert_eq!(enu_from_ned(Vec3::new(1.0, 0.0, 0.0)), Vec3::new(0.0, 1.0, 0.0));
        assert_eq!(enu_from_ned(Vec3::new(0.0, 1.0, 0.0)), Vec3::new(1.0, 0.0, 0.0));
        assert_eq!(enu_from_ned(Vec3::new(0.0, 0.0, 1.0)), Vec3::new(0.0, 0.0, -1.0));
    }

    #[test]
    fn each_axis_of_the_body_has_its_sign() {
        assert_eq!(frd_from_flu(Vec3::new(1.0, 2.0, 3.0)), Vec3::new(1.0, -2.0, -3.0));
        assert_eq!(flu_from_frd(Vec3::new(1.0, 2.0, 3.0)), Vec3::new(1.0, -2.0, -3.0));
    }

    #[test]
    fn cardinal_headings_are_golden() {
        let s = FRAC_1_SQRT_2;
        // Facing north, west, south, east: ENU yaw from east, anticlockwise; (w, x, y, z) on the wire.
        for (enu_yaw, wire) in [(FRAC_PI_2, [1.0, 0.0, 0.0, 0.0]), (PI, [s, 0.0, 0.0, -s]), (0.0, [s, 0.0, 0.0, s])] {
            let q = ned_from_frd(&yaw(enu_yaw));
            for (got, want) in [q.w, q.i, q.j, q.k].iter().zip(wire) {
                assert!((got - want).abs() < 1e-12, "yaw {enu_yaw}: {q:?} is not {wire:?}");
            }
        }
        let south = ned_from_frd(&yaw(-FRAC_PI_2));
        assert!(south.w.abs() < 1e-12 && (south.k.abs() - 1.0).abs() < 1e-12, "{south:?}");
    }

    #[test]
    fn tilts_keep_their_meaning_at_every_heading() {
        for quarter in 0..4 {
            let heading = yaw(f64::from(quarter) * FRAC_PI_2);
            // FLU: a positive turn about y (left) lowers the nose; about x (forward) lowers the right side.
            let nose_down = heading * Rot::from_axis_angle(&nalgebra::Vector3::y_axis(), 0.2);
            let right_down = heading * Rot::from_axis_angle(&nalgebra::Vector3::x_axis(), 0.2);
            let (roll, pitch, _) = ned_euler_deg(&nose_down);
            assert!((pitch + 0.2_f64.to_degrees()).abs() < 1e-9 && roll.abs() < 1e-9, "{roll} {pitch}");
            let (roll, pitch, _) = ned_euler_deg(&right_down);
            assert!((roll - 0.2_f64.to_degrees()).abs() < 1e-9 && pitch.abs() < 1e-9, "{roll} {pitch}");
        }
    }

    fn any_rot() -> impl Strategy<Value = Rot> {
        (-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64)
            .prop_filter("not near zero", |(w, x, y, z)| w * w + x * x + y * y + z * z > 1e-3)
            .prop_map(|(w, x, y, z)| Rot::new_normalize(Quaternion::new(w, x, y, z)))
    }

    fn any_vec() -> impl Strategy<Value = Vec3> {
        (-10.0..10.0f64, -10.0..10.0f64, -10.0..10.0f64).prop_map(|(x, y, z)| Vec3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn the_attitude_commutes_with_the_vectors(q in any_rot(), v_body in any_vec()) {
            // Rotating in FLU → ENU, then to NED, equals going to FRD and rotating there.
            let via_enu = ned_from_enu(q * v_body);
            let via_wire = ned_from_frd(&q) * frd_from_flu(v_body);
            prop_assert!((via_enu - via_wire).norm() < 1e-9);
        }

        #[test]
        fn conversions_are_their_own_inverses(q in any_rot(), v in any_vec()) {
            prop_assert_eq!(enu_from_ned(ned_from_enu(v)), v);
            prop_assert_eq!(flu_from_frd(frd_from_flu(v)), v);
            prop_assert!(world_from_body(&ned_from_frd(&q)).angle_to(&q) < 1e-7);
            prop_assert!(ned_from_frd(&q).w >= 0.0);
        }
    }
}
