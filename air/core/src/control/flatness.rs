//! Differential flatness: acceleration and yaw → attitude and collective thrust (eq. 11-13), within tilt and thrust.

use crate::control::vehicle::Airframe;
use crate::values::types::{GRAVITY, Newtons, NormalisedThrust, Rot, Vec3};
use nalgebra::{Matrix3, Rotation3};

/// What to command, and what it would do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlatCommand {
    /// Attitude.
    pub world_from_body: Rot,
    /// Collective thrust, F_c = m‖F‖.
    pub force: Newtons,
    /// The acceleration that attitude and thrust alone give: the desired one less the disturbance, unless limited.
    pub acc_att_world: Vec3,
}

impl FlatCommand {
    /// The thrust that, along the body z axis of a vehicle still at `world_from_body`, comes nearest to the demanded
    /// force: its projection. ‖F‖, right once the attitude is there, until then pushes where nobody wants it.
    #[must_use]
    pub fn force_along(&self, vehicle: &Airframe, world_from_body: &Rot) -> Newtons {
        let force = self.acc_att_world + GRAVITY * Vec3::z();
        let along = vehicle.mass_kg * force.dot(&(world_from_body * Vec3::z()));
        Newtons(along.max(vehicle.force(NormalisedThrust(vehicle.min_thrust)).0))
    }
}

/// Attitude and thrust for `acc_world` under the lumped disturbance `acc_disturbance_world` (both m/s²) at `yaw` (rad).
///
/// Limits keep the vertical first: height before course. The vertical part of F is cut to what the thrust range allows,
/// then the horizontal part to what the tilt limit and the remaining thrust allow. The least thrust is above zero, so the
/// vertical part never vanishes, the tilt stays below 90°, and R_z × R_yaw has no degenerate case. An input that is not
/// finite counts as zero.
#[must_use]
pub fn flat_command(vehicle: &Airframe, acc_world: Vec3, acc_disturbance_world: Vec3, yaw: f64) -> FlatCommand {
    let finite = |v: Vec3| if v.iter().all(|x| x.is_finite()) { v } else { Vec3::zeros() };
    let yaw = if yaw.is_finite() { yaw } else { 0.0 };
    let least = vehicle.force(NormalisedThrust(vehicle.min_thrust)).0 / vehicle.mass_kg;
    let most = vehicle.force(NormalisedThrust(vehicle.max_thrust)).0 / vehicle.mass_kg;
    // eq. 13, then the limits
    let wanted = finite(acc_world) - finite(acc_disturbance_world) + GRAVITY * Vec3::z();
    let vertical = wanted.z.clamp(least, most);
    let room =
        (vertical * vehicle.max_tilt_deg.to_radians().tan()).min((most * most - vertical * vertical).max(0.0).sqrt());
    let horizontal = wanted.xy();
    let norm = horizontal.norm();
    let horizontal = if norm > room { horizontal * (room / norm) } else { horizontal };
    let force = Vec3::new(horizontal.x, horizontal.y, vertical);
    // eq. 12
    let magnitude = force.norm();
    let z_axis = force / magnitude;
    let y_axis = z_axis.cross(&Vec3::new(yaw.cos(), yaw.sin(), 0.0)).normalize();
    let x_axis = y_axis.cross(&z_axis);
    let columns = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x_axis, y_axis, z_axis]));
    FlatCommand {
        world_from_body: Rot::from_rotation_matrix(&columns),
        force: Newtons(vehicle.mass_kg * magnitude),
        acc_att_world: force - GRAVITY * Vec3::z(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;
    use proptest::prelude::*;

    fn vehicle() -> Airframe {
        Airframe { hover_thrust: 0.25, min_thrust: 0.02, max_thrust: 1.0, max_tilt_deg: 45.0, ..shipped::airframe() }
    }

    fn vector(limit: f64) -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-limit..limit).prop_map(Vec3::from)
    }

    #[test]
    fn hover_is_level_at_the_weight() {
        let command = flat_command(&vehicle(), Vec3::zeros(), Vec3::zeros(), 0.7);
        assert!((command.force.0 - 0.85 * GRAVITY).abs() < 1e-12);
        assert!((command.world_from_body * Vec3::z() - Vec3::z()).norm() < 1e-12);
        assert!((command.world_from_body.euler_angles().2 - 0.7).abs() < 1e-12);
    }

    #[test]
    fn forward_acceleration_pitches_the_nose_down_at_each_cardinal_heading() {
        for quarter in 0..4 {
            let yaw = f64::from(quarter) * std::f64::consts::FRAC_PI_2;
            let ahead = Vec3::new(yaw.cos(), yaw.sin(), 0.0);
            let command = flat_command(&vehicle(), ahead * 3.0, Vec3::zeros(), yaw);
            let nose = command.world_from_body * Vec3::x();
            assert!(nose.z < 0.0 && nose.dot(&ahead) > 0.9);
        }
    }

    #[test]
    fn a_push_is_leaned_against() {
        let command = flat_command(&vehicle(), Vec3::zeros(), Vec3::new(0.0, 2.0, 0.0), 0.0);
        assert!((command.acc_att_world - Vec3::new(0.0, -2.0, 0.0)).norm() < 1e-12);
    }

    proptest! {
        #[test]
        fn within_limits_the_thrust_vector_gives_the_acceleration(
            acc in vector(4.0), push in vector(1.0), yaw in -4.0..4.0
        ) {
            let command = flat_command(&vehicle(), acc, push, yaw);
            let given = command.world_from_body * Vec3::z() * (command.force.0 / vehicle().mass_kg) - GRAVITY * Vec3::z();
            prop_assert!((given - command.acc_att_world).norm() < 1e-9);
            if (acc - push).xy().norm() < 4.0 {
                prop_assert!((given + push - acc).norm() < 1e-9);
            }
        }

        #[test]
        fn tilt_and_thrust_stay_within_limits(acc in vector(200.0), push in vector(50.0), yaw in -4.0..4.0) {
            let command = flat_command(&vehicle(), acc, push, yaw);
            let up = (command.world_from_body * Vec3::z()).z;
            prop_assert!(up >= vehicle().max_tilt_deg.to_radians().cos() - 1e-9);
            let thrust = vehicle().normalised(command.force).0;
            prop_assert!((vehicle().min_thrust - 1e-9..=vehicle().max_thrust + 1e-9).contains(&thrust));
        }

        #[test]
        fn the_nose_is_in_the_vertical_plane_of_the_yaw_seen_along_the_thrust(acc in vector(30.0), yaw in -3.1..3.1) {
            let command = flat_command(&vehicle(), acc, Vec3::zeros(), yaw);
            let heading = command.world_from_body.inverse() * Vec3::new(yaw.cos(), yaw.sin(), 0.0);
            prop_assert!(heading.y.abs() < 1e-9 && heading.x > 0.0);
        }

        #[test]
        fn vertical_comes_first_while_thrust_allows(horizontal in 0.0..100.0, up in -5.0..20.0) {
            let command = flat_command(&vehicle(), Vec3::new(horizontal, 0.0, up), Vec3::zeros(), 0.0);
            prop_assert!((command.acc_att_world.z - up).abs() < 1e-9);
        }

        #[test]
        fn the_attitude_is_a_rotation(acc in vector(50.0), yaw in -10.0..10.0) {
            let q = flat_command(&vehicle(), acc, Vec3::zeros(), yaw).world_from_body;
            prop_assert!((q.norm() - 1.0).abs() < 1e-12);
            let m = q.to_rotation_matrix();
            prop_assert!((m.matrix().determinant() - 1.0).abs() < 1e-9);
            prop_assert!((m.matrix().transpose() * m.matrix() - Matrix3::identity()).norm() < 1e-9);
        }
    }

    #[test]
    fn while_the_attitude_lags_the_thrust_holds_the_height() {
        let command = flat_command(&vehicle(), Vec3::x() * 8.0, Vec3::zeros(), 0.0);
        let weight = 0.85 * GRAVITY;
        assert!((command.force_along(&vehicle(), &Rot::identity()).0 - weight).abs() < 1e-9);
        assert!((command.force_along(&vehicle(), &command.world_from_body).0 - command.force.0).abs() < 1e-9);
        let upside_down = Rot::from_axis_angle(&Vec3::x_axis(), 3.0);
        let least = vehicle().force(NormalisedThrust(vehicle().min_thrust));
        assert_eq!(command.force_along(&vehicle(), &upside_down), least);
    }

    #[test]
    fn inputs_that_are_not_finite_level_the_vehicle() {
        let nan = Vec3::new(f64::NAN, 0.0, f64::INFINITY);
        let command = flat_command(&vehicle(), nan, nan, f64::NAN);
        assert!((command.world_from_body * Vec3::z() - Vec3::z()).norm() < 1e-12);
    }
}
