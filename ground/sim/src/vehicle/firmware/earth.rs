//! Where on Earth the simulated world lies, and what a barometer, a magnetometer and a GNSS receiver measure there.

use goshawk_autopilot::frames::ned_from_enu;
use goshawk_core::Vec3;

/// The world's origin: latitude and longitude, rad, and height above the sea, m. The place at which PX4's own
/// simulations begin.
const HOME_RAD: [f64; 2] = [47.397_742 * std::f64::consts::PI / 180.0, 8.545_594 * std::f64::consts::PI / 180.0];
const HOME_ALTITUDE_M: f64 = 488.0;
/// The Earth as a sphere, as PX4's local projection has it, m.
const RADIUS_M: f64 = 6_371_000.0;
/// The Earth's magnetic field at home, north-east-down, gauss: the World Magnetic Model 2025 gives 0.483 G, dipping by
/// 63.2°, 3.3° east of north.
const FIELD_NED_G: [f64; 3] = [0.2174, 0.0125, 0.4311];

/// Latitude and longitude in degrees, height above the sea in m.
pub(super) fn geodetic(pos_world: Vec3) -> (f64, f64, f64) {
    let ned = ned_from_enu(pos_world);
    let latitude = HOME_RAD[0] + ned.x / RADIUS_M;
    let longitude = HOME_RAD[1] + ned.y / (RADIUS_M * HOME_RAD[0].cos());
    (latitude.to_degrees(), longitude.to_degrees(), HOME_ALTITUDE_M - ned.z)
}

/// The standard atmosphere at a height above the sea: pressure, hPa, and temperature, °C.
pub(super) fn air(altitude_m: f64) -> (f64, f64) {
    let fall = 1.0 - 2.255_77e-5 * altitude_m;
    (1013.25 * fall.powf(5.255_88), 15.0 - 0.0065 * altitude_m)
}

/// The magnetic field, world frame, gauss.
pub(super) fn field_world() -> Vec3 {
    goshawk_autopilot::frames::enu_from_ned(Vec3::from(FIELD_NED_G))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_degree_is_as_long_as_on_the_sphere_and_pressure_falls_by_twelve_pascal_a_metre() {
        let (latitude, longitude, altitude) = geodetic(Vec3::new(0.0, 111_194.93, 10.0));
        assert!((latitude - 48.397_742).abs() < 1e-6 && (longitude - 8.545_594).abs() < 1e-9, "{latitude} {longitude}");
        assert!((altitude - 498.0).abs() < 1e-9);
        let east = geodetic(Vec3::new(1000.0, 0.0, 0.0)).1;
        assert!((east - 8.545_594 - 1000.0 / (111_194.93 * HOME_RAD[0].cos())).abs() < 1e-6, "{east}");
        let ((low, warm), (high, cold)) = (air(0.0), air(100.0));
        assert!((low - 1013.25).abs() < 1e-9 && (low - high - 11.94).abs() < 0.02, "{high}");
        assert!((warm - cold - 0.65).abs() < 1e-9);
    }
}
