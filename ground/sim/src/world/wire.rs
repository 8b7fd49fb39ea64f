//! A world as the wire has it, for pictures: trees in outline, all else that is solid as boxes.

use super::{Cuboid, Kind, Shape, World};
use goshawk_core::Vec3;
use goshawk_proto::v1;

/// A world is sent with so many boxes at most: 0.8 MB.
pub const MOST_BOXES: usize = 20_000;

fn vec3f(v: &Vec3) -> v1::Vec3f {
    v1::Vec3f { x: v.x as f32, y: v.y as f32, z: v.z as f32 }
}

impl Shape {
    /// The upright box around it; of a box, itself.
    #[must_use]
    pub fn around(&self) -> Cuboid {
        match self {
            Shape::Cuboid(cuboid) => *cuboid,
            Shape::Cone(_) | Shape::Spheroid(_) => {
                let (low, high) = self.aabb();
                Cuboid { centre: (low + high) * 0.5, half: (high - low) * 0.5, yaw_rad: 0.0 }
            }
        }
    }
}

impl Cuboid {
    /// As the wire has it.
    #[must_use]
    pub fn to_proto(&self) -> v1::SimBox {
        v1::SimBox {
            centre_world: Some(vec3f(&self.centre)),
            size_m: Some(vec3f(&(2.0 * self.half))),
            yaw_rad: self.yaw_rad as f32,
        }
    }
}

impl World {
    /// As the wire has it. Of more than [`MOST_BOXES`] walls and voxels the largest are kept, in the world's order.
    #[must_use]
    pub fn to_proto(&self) -> v1::SimWorld {
        let trees = self.trees().iter().map(|t| v1::SimTree {
            base_world: Some(vec3f(&t.base_world)),
            top_world: Some(vec3f(&t.top_world)),
            radius_m: t.radius_m as f32,
            foliage_radius_m: t.foliage_radius_m as f32,
        });
        let built = self.parts().iter().filter(|part| matches!(part.kind, Kind::Building | Kind::Scan));
        let mut boxes: Vec<(usize, Cuboid)> = built.map(|part| part.shape.around()).enumerate().collect();
        if boxes.len() > MOST_BOXES {
            boxes.sort_by(|(_, a), (_, b)| b.half.product().total_cmp(&a.half.product()));
            boxes.truncate(MOST_BOXES);
            boxes.sort_by_key(|(index, _)| *index);
        }
        v1::SimWorld {
            trees: trees.collect(),
            seed: self.seed(),
            spacing_m: self.spacing_m(),
            boxes: boxes.iter().map(|(_, cuboid)| cuboid.to_proto()).collect(),
        }
    }
}
