//! A load that hangs on a line below the centre of mass: a point mass, and a line that only pulls.

use goshawk_core::{GRAVITY, Vec3};

/// What hangs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadParameters {
    /// kg; above 0.
    pub mass_kg: f64,
    /// Length of the line, m.
    pub line_m: f64,
}

/// The line's stiffness as the load's own frequency on it, rad/s: millimetres of stretch, and soft enough for the step.
const LINE_RADPS: f64 = 60.0;
/// Its damping, of critical.
const LINE_DAMPING: f64 = 0.3;
/// Air drag, N/(m/s).
const DRAG_NPMPS: f64 = 0.05;

/// The load's motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Load {
    parameters: LoadParameters,
    pos_world: Vec3,
    vel_world: Vec3,
}

impl Load {
    /// A load at rest where the vehicle stands.
    pub(super) fn new(parameters: LoadParameters, pos_world: Vec3) -> Self {
        Self { parameters, pos_world, vel_world: Vec3::zeros() }
    }

    /// Advances by `dt_s` over ground at the height `ground_m`; the force on the vehicle at `pos_world`, N.
    pub(super) fn step(&mut self, dt_s: f64, pos_world: Vec3, vel_world: Vec3, ground_m: f64) -> Vec3 {
        let LoadParameters { mass_kg, line_m } = self.parameters;
        let line = pos_world - self.pos_world;
        let stretch = line.norm() - line_m;
        let pull = if stretch > 0.0 {
            let along = line.normalize();
            let rate = (vel_world - self.vel_world).dot(&along);
            let tension = mass_kg * LINE_RADPS * (LINE_RADPS * stretch + 2.0 * LINE_DAMPING * rate);
            along * tension.max(0.0)
        } else {
            Vec3::zeros()
        };
        let force = pull - self.vel_world * DRAG_NPMPS;
        self.vel_world += (force / mass_kg - Vec3::z() * GRAVITY) * dt_s;
        self.pos_world += self.vel_world * dt_s;
        if self.pos_world.z < ground_m {
            self.pos_world.z = ground_m;
            self.vel_world = Vec3::zeros();
        }
        -pull
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hanging_load_pulls_with_its_weight_and_swings_with_the_lines_period() {
        let parameters = LoadParameters { mass_kg: 0.1, line_m: 0.5 };
        let mut load = Load::new(parameters, Vec3::new(0.05, 0.0, 4.5));
        let (hook, mut crossings, mut side, mut weight) = (Vec3::new(0.0, 0.0, 5.0), 0, true, 0.0);
        for _ in 0..10_000 {
            weight += load.step(1e-3, hook, Vec3::zeros(), 0.0).z / 10_000.0;
            crossings += u32::from((load.pos_world.x > 0.0) != side);
            side = load.pos_world.x > 0.0;
        }
        assert!((weight + 0.1 * GRAVITY).abs() < 0.02, "{weight}");
        let half_period = std::f64::consts::PI * (0.5 / GRAVITY).sqrt();
        assert!((f64::from(crossings) * half_period - 10.0).abs() < 1.0, "{crossings}");
    }

    #[test]
    fn a_slack_line_pulls_nothing() {
        let mut load = Load::new(LoadParameters { mass_kg: 0.1, line_m: 0.5 }, Vec3::zeros());
        assert_eq!(load.step(1e-3, Vec3::new(0.0, 0.0, 0.3), Vec3::zeros(), 0.0), Vec3::zeros());
    }
}
