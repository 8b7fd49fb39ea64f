//! Braking, holding a position, climbing and descending: what is flown when no plan is.

use crate::values::geometry::cap;
use crate::values::types::{FlatState, Vec3};
use schemars::JsonSchema;
use serde::Deserialize;

/// Braking and position hold.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HoldConfig {
    /// Position gain, 1/s².
    #[schemars(range(min = 0.1, max = 20.0), extend("x-why" = "less does not hold, more oscillates with the attitude's lag", "x-source" = "chosen by eye"))]
    pub kp: f64,
    /// Velocity gain, 1/s.
    #[schemars(range(min = 0.1, max = 20.0), extend("x-why" = "less does not brake, more oscillates with the attitude's lag", "x-source" = "chosen by eye"))]
    pub kv: f64,
    /// Largest horizontal acceleration of hold and brake, m/s².
    #[schemars(range(min = 0.5, max = 20.0), extend("x-why" = "less does not stop before the fence, two g is all that tilt gives", "x-source" = "chosen by eye"))]
    pub max_acc_horizontal_mps2: f64,
    /// Largest vertical acceleration of hold and brake, m/s².
    #[schemars(range(min = 0.5, max = 9.5), extend("x-why" = "less does not hold the height, more than gravity cannot be had downward", "x-source" = "chosen by eye"))]
    pub max_acc_vertical_mps2: f64,
    /// Speed below which braking becomes position hold, m/s.
    #[schemars(range(min = 0.05, max = 3.0), extend("x-why" = "a place is held only where braking has ended", "x-source" = "chosen by eye"))]
    pub stopped_speed_mps: f64,
}

/// Brakes first, then holds the place where it stopped.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hover {
    /// The height held while braking, m.
    height: Option<f64>,
    /// The position held.
    anchor_world: Option<Vec3>,
}

impl Hover {
    /// Starts over: the next step begins to brake.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Holds `pos_world` from now on.
    pub fn hold(&mut self, pos_world: Vec3) {
        self.height = Some(pos_world.z);
        self.anchor_world = Some(pos_world);
    }

    /// Holds a place at least `distance` m, measured level, from `centre_world`.
    pub fn keep_from(&mut self, centre_world: Vec3, distance: f64) {
        let Some(anchor) = &mut self.anchor_world else { return };
        let line = (*anchor - centre_world).xy();
        if let Some(away) = line.try_normalize(1e-3).filter(|_| line.norm() < distance) {
            let moved = centre_world.xy() + away * distance;
            (anchor.x, anchor.y) = (moved.x, moved.y);
        }
    }

    /// Moves what is held by `jump_world`, m.
    pub fn shift(&mut self, jump_world: Vec3) {
        self.height = self.height.map(|height| height + jump_world.z);
        self.anchor_world = self.anchor_world.map(|anchor| anchor + jump_world);
    }

    /// Braking is over.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.anchor_world.is_some()
    }

    /// Brakes at the height where braking began, then holds. The reference's `acc` is what to command.
    pub fn step(&mut self, config: &HoldConfig, pos_world: Vec3, vel_world: Vec3) -> FlatState {
        let height = *self.height.get_or_insert(pos_world.z);
        if self.anchor_world.is_none() && vel_world.xy().norm() < config.stopped_speed_mps {
            self.anchor_world = Some(Vec3::new(pos_world.x, pos_world.y, height));
        }
        let pos = self.anchor_world.unwrap_or(Vec3::new(pos_world.x, pos_world.y, height));
        let acc = (pos - pos_world) * config.kp - vel_world * config.kv;
        FlatState { pos, vel: Vec3::zeros(), acc: limit(config, acc) }
    }

    /// As [`Hover::step`], but moves vertically at `climb` m/s (positive upward) wherever the height is.
    pub fn step_vertical(&mut self, config: &HoldConfig, pos_world: Vec3, vel_world: Vec3, climb: f64) -> FlatState {
        self.height = Some(pos_world.z);
        if let Some(anchor) = &mut self.anchor_world {
            anchor.z = pos_world.z;
        }
        let mut reference = self.step(config, pos_world, vel_world);
        let acc = Vec3::new(reference.acc.x, reference.acc.y, config.kv * (climb - vel_world.z));
        reference.vel.z = climb;
        reference.acc = limit(config, acc);
        reference
    }
}

/// The acceleration that takes out `vel_world` (m/s) wherever the vehicle is, m/s².
#[must_use]
pub fn brake(config: &HoldConfig, vel_world: Vec3) -> Vec3 {
    limit(config, vel_world * -config.kv)
}

fn limit(config: &HoldConfig, acc: Vec3) -> Vec3 {
    let horizontal = cap(Vec3::new(acc.x, acc.y, 0.0), config.max_acc_horizontal_mps2);
    let vertical = if acc.z.is_finite() { acc.z } else { 0.0 };
    Vec3::new(horizontal.x, horizontal.y, vertical.clamp(-config.max_acc_vertical_mps2, config.max_acc_vertical_mps2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;

    fn config() -> HoldConfig {
        shipped::tuning().hold
    }

    /// A point mass whose acceleration follows with a lag of `tau` s.
    fn fly(hover: &mut Hover, tau: f64, vel: Vec3) -> (Vec3, Vec3) {
        let (mut pos, mut vel, mut acc, dt) = (Vec3::new(0.0, 0.0, 2.0), vel, Vec3::zeros(), 0.005);
        for _ in 0..1600 {
            let wanted = hover.step(&config(), pos, vel).acc;
            acc += (wanted - acc) * (dt / tau);
            vel += acc * dt;
            pos += vel * dt;
        }
        (pos, vel)
    }

    #[test]
    fn braking_from_10_mps_stops_and_keeps_the_height() {
        for tau in [0.05, 0.25] {
            let mut hover = Hover::default();
            let (pos, vel) = fly(&mut hover, tau, Vec3::new(10.0, 0.0, -1.0));
            assert!(hover.is_stopped() && vel.norm() < 0.02, "tau {tau}: {vel}");
            assert!((pos.z - 2.0).abs() < 0.02 && pos.x < 14.0, "tau {tau}: {pos}");
        }
    }
}
