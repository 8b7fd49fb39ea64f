//! The frame in which the vehicle reckons. The stand-in knows the world's; real firmware begins at the place where it
//! starts. What is shown to people beside the vehicle's own telemetry is told in that frame.

use goshawk_core::{Rot, Vec3};
use goshawk_proto::v1;
use goshawk_vehicle::convert;

/// From the world's frame to the vehicle's: a shift and a turn about the vertical.
#[derive(Clone, Copy, Debug)]
pub(super) struct Local {
    origin_world: Vec3,
    /// The vehicle's frame is turned by so much, from east to north, rad.
    yaw_rad: f64,
}

impl Local {
    /// The world's own.
    pub(super) fn world() -> Self {
        Self::at(Vec3::zeros(), 0.0)
    }

    /// One that begins at a place, turned by an angle.
    pub(super) fn at(origin_world: Vec3, yaw_rad: f64) -> Self {
        Self { origin_world, yaw_rad }
    }

    /// A direction of the vehicle's frame in the world's.
    pub(super) fn world_from_local(&self) -> Rot {
        Rot::from_axis_angle(&Vec3::z_axis(), self.yaw_rad)
    }

    /// A point of the vehicle's frame in the world's.
    pub(super) fn in_world(&self, point: Vec3) -> Vec3 {
        self.origin_world + self.world_from_local() * point
    }

    fn point(&self, world: Vec3) -> Vec3 {
        self.world_from_local().inverse() * (world - self.origin_world)
    }

    fn point_f(&self, point: &mut Option<v1::Vec3f>) {
        if let Some(p) = point {
            let moved = self.point(Vec3::new(f64::from(p.x), f64::from(p.y), f64::from(p.z)));
            (p.x, p.y, p.z) = (moved.x as f32, moved.y as f32, moved.z as f32);
        }
    }

    fn boxes(&self, boxes: &mut [v1::SimBox]) {
        for one in boxes {
            self.point_f(&mut one.centre_world);
            one.yaw_rad -= self.yaw_rad as f32;
        }
    }

    /// The world as the vehicle would tell it.
    pub(super) fn of_world(&self, mut world: v1::SimWorld) -> v1::SimWorld {
        for tree in &mut world.trees {
            self.point_f(&mut tree.base_world);
            self.point_f(&mut tree.top_world);
        }
        self.boxes(&mut world.boxes);
        world
    }

    /// The truth as the vehicle would tell it.
    pub(super) fn of_truth(&self, mut truth: v1::SimTruth) -> v1::SimTruth {
        let turn = self.world_from_local().inverse();
        let read = |v: &v1::Vec3| Vec3::new(v.x, v.y, v.z);
        for place in [&mut truth.pos_world, &mut truth.target_pos_world, &mut truth.goal_world].into_iter().flatten() {
            *place = convert::vec3(self.point(read(place)));
        }
        for way in [&mut truth.vel_world, &mut truth.target_vel_world, &mut truth.acc_world].into_iter().flatten() {
            *way = convert::vec3(turn * read(way));
        }
        if let Some(q) = &mut truth.world_from_body {
            let attitude = Rot::new_normalize(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z));
            *q = convert::quat(turn * attitude);
        }
        self.boxes(&mut truth.moving);
        truth
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn what_lies_ahead_of_the_start_lies_north_of_a_vehicle_that_began_facing_north() {
        // The world's course runs east; the vehicle's frame is turned so that it began facing north there.
        let local = Local::at(Vec3::new(6.0, 0.0, 1.0), -FRAC_PI_2);
        let truth = local.of_truth(v1::SimTruth {
            pos_world: Some(convert::vec3(Vec3::new(6.0, 0.0, 1.0))),
            target_pos_world: Some(convert::vec3(Vec3::new(16.0, 2.0, 2.0))),
            vel_world: Some(convert::vec3(Vec3::x())),
            world_from_body: Some(convert::quat(Rot::identity())),
            moving: vec![v1::SimBox { centre_world: Some(v1::Vec3f { x: 7.0, y: 0.0, z: 1.0 }), ..Default::default() }],
            ..Default::default()
        });
        let near = |v: Option<v1::Vec3>, x: f64, y: f64, z: f64| {
            let v = v.unwrap();
            assert!((v.x - x).abs() + (v.y - y).abs() + (v.z - z).abs() < 1e-9, "{v:?}");
        };
        near(truth.pos_world, 0.0, 0.0, 0.0);
        near(truth.target_pos_world, -2.0, 10.0, 1.0);
        near(truth.vel_world, 0.0, 1.0, 0.0);
        let q = truth.world_from_body.unwrap();
        assert!((2.0 * q.z.atan2(q.w) - FRAC_PI_2).abs() < 1e-9, "{q:?}");
        let moving = &truth.moving[0];
        assert!((moving.centre_world.unwrap().y - 1.0).abs() < 1e-6 && (moving.yaw_rad - 1.570_796_4).abs() < 1e-6);
        let tree = v1::SimTree { base_world: Some(v1::Vec3f { x: 6.0, y: 3.0, z: 1.0 }), ..Default::default() };
        assert!((local.in_world(Vec3::new(-2.0, 10.0, 1.0)) - Vec3::new(16.0, 2.0, 2.0)).norm() < 1e-9);
        let world = local.of_world(v1::SimWorld { trees: vec![tree], ..Default::default() });
        let base = world.trees[0].base_world.unwrap();
        assert!((base.x + 3.0).abs() < 1e-6 && base.y.abs() < 1e-6, "{base:?}");
    }
}
