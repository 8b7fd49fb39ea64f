//! What keeps a chased target in the image (beyond the paper). To speed up, the vehicle pitches its camera down; a
//! target that so leaves the image at its upper edge is hidden, and chased all the harder.

use crate::values::error::{ConfigError, within};
use crate::values::types::{GRAVITY, Vec3};

/// The camera's image as the controller must know it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewConfig {
    /// Its upper edge above the body's x-y plane, rad (0.63): the camera's tilt and half its vertical field of view.
    pub top: f64,
}

/// The target's centre stays so far below the upper edge, rad: half a person 8 m away.
const MARGIN: f64 = 0.105;
/// Whatever the camera sees, so much tilt toward the target is left, and no more than so much is, rad. Chosen by eye.
const TILT: (f64, f64) = (0.1, 1.3);

impl ViewConfig {
    pub(crate) fn validate(&self) -> Result<(), ConfigError> {
        let behind = "beyond, it looks backward";
        within("camera.tilt_deg + vfov_deg / 2", self.top.to_degrees(), -90.0..=175.0, behind)
    }

    /// `acc_world` (m/s²) with as much less of it toward the target, which lies along `line_world` (m), as keeps it in
    /// the image under the disturbance `acc_disturbance_world`. Nothing else changes, and nothing brakes.
    #[must_use]
    pub fn keeping(&self, acc_world: Vec3, acc_disturbance_world: Vec3, line_world: Vec3) -> Vec3 {
        let flat = Vec3::new(line_world.x, line_world.y, 0.0);
        let Some(toward) = flat.try_normalize(1e-3) else { return acc_world };
        let elevation = line_world.z.atan2(flat.norm());
        let tilt = (self.top - MARGIN - elevation).clamp(TILT.0, TILT.1);
        let force = acc_world - acc_disturbance_world + GRAVITY * Vec3::z();
        let excess = force.dot(&toward) - force.z.max(0.0) * tilt.tan();
        let ahead = acc_world.dot(&toward);
        if excess > 0.0 && ahead > 0.0 { acc_world - toward * excess.min(ahead) } else { acc_world }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::flatness::flat_command;
    use crate::shipped::controller as config;
    use proptest::prelude::*;

    const VIEW: ViewConfig = ViewConfig { top: 0.63 };

    #[test]
    fn speeding_up_leaves_the_target_in_the_image() {
        let line = Vec3::new(6.0, 0.0, -0.3);
        let kept = VIEW.keeping(Vec3::new(12.0, 3.0, 0.0), Vec3::zeros(), line);
        let down = (kept.x / GRAVITY).atan();
        assert!((VIEW.top - down - line.z.atan2(6.0) - MARGIN).abs() < 1e-9, "the upper edge is {MARGIN} above it");
        assert_eq!(kept.y, 3.0);
        let gentle = Vec3::new(3.0, -2.0, 0.5);
        assert_eq!(VIEW.keeping(gentle, Vec3::zeros(), line), gentle);
        let brake = Vec3::new(-12.0, 0.0, 0.0);
        assert_eq!(VIEW.keeping(brake, Vec3::zeros(), line), brake);
    }

    #[test]
    fn drag_takes_its_share_of_the_tilt() {
        let line = Vec3::new(6.0, 0.0, 0.0);
        let (still, drag) = (Vec3::zeros(), Vec3::new(-2.0, 0.0, 0.0));
        let kept = |disturbance| VIEW.keeping(Vec3::new(12.0, 0.0, 0.0), disturbance, line).x;
        assert!((kept(still) - kept(drag) - 2.0).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn it_never_brakes_and_never_turns_and_what_is_flown_shows_the_target(
            acc in prop::array::uniform3(-8.0..8.0f64), line in prop::array::uniform3(-9.0..9.0f64),
            drag in prop::array::uniform3(-2.0..2.0f64)
        ) {
            let (acc, line, drag) = (Vec3::from(acc), Vec3::from(line), Vec3::from(drag));
            let kept = VIEW.keeping(acc, drag, line);
            let toward = Vec3::new(line.x, line.y, 0.0).normalize();
            let less = (acc - kept).dot(&toward);
            prop_assert!(less >= 0.0 && ((acc - kept) - toward * less).norm() < 1e-9);
            prop_assert!(less == 0.0 || kept.dot(&toward) >= -1e-9, "it only speeds up less");
            let command = flat_command(&config().airframe, kept, drag, toward.y.atan2(toward.x));
            let down = command.acc_att_world + GRAVITY * Vec3::z();
            let tilt = down.dot(&toward).atan2(down.z);
            let elevation = line.z.atan2(line.xy().norm());
            let allowed = (VIEW.top - MARGIN - elevation).clamp(TILT.0, TILT.1);
            prop_assert!(tilt <= allowed + 1e-9 || kept.dot(&toward) <= 1e-9, "{tilt} of {allowed}");
        }

        #[test]
        fn whatever_is_disturbed_and_seen_it_gives_what_was_asked_or_less(
            acc in prop::array::uniform3(-1e3..1e3f64), bits in prop::array::uniform6(any::<u64>())
        ) {
            let v = |k: usize| Vec3::new(f64::from_bits(bits[k]), f64::from_bits(bits[k + 1]), f64::from_bits(bits[k + 2]));
            let acc = Vec3::from(acc);
            let kept = VIEW.keeping(acc, v(0), v(3));
            prop_assert!(kept.z == acc.z && kept.xy().norm() <= acc.xy().norm() + 1e-9, "{kept:?} of {acc:?}");
        }
    }
}
