//! A world as the wire has it, for pictures: trees in outline, all else that is solid as boxes.

use super::{Cuboid, Kind, Shape, World};
use goshawk_core::Vec3;
use goshawk_proto::v1;

/// A world is sent with so many boxes at most: 0.8 MB.
pub const MOST_BOXES: usize = 20_000;
/// Trees and boxes of a page: it fits into what may wait for a weak link on board.
const PAGE: usize = 100;

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
            items: 0,
        }
    }
}

/// The page of a whole `world` that begins with its item number `first`.
#[must_use]
pub fn page(world: &v1::SimWorld, first: usize) -> v1::SimWorld {
    let trees = world.trees.len();
    let items = trees + world.boxes.len();
    let (begin, end) = (first.min(items), first.saturating_add(PAGE).min(items));
    v1::SimWorld {
        trees: world.trees[begin.min(trees)..end.min(trees)].to_vec(),
        boxes: world.boxes[begin.max(trees) - trees..end.max(trees) - trees].to_vec(),
        seed: world.seed,
        spacing_m: world.spacing_m,
        items: items as u32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pages_of_a_world_are_the_world() {
        let trees = (0..150).map(|k| v1::SimTree { radius_m: k as f32, ..v1::SimTree::default() }).collect();
        let boxes = (0..130).map(|k| v1::SimBox { yaw_rad: k as f32, ..v1::SimBox::default() }).collect();
        let world = v1::SimWorld { trees, boxes, seed: 3, spacing_m: 4.0, items: 0 };
        let mut read = v1::SimWorld { seed: 3, spacing_m: 4.0, ..v1::SimWorld::default() };
        while read.trees.len() + read.boxes.len() < 280 {
            let page = page(&world, read.trees.len() + read.boxes.len());
            assert_eq!((page.items, page.seed), (280, 3));
            assert!((1..=PAGE).contains(&(page.trees.len() + page.boxes.len())));
            read.trees.extend(page.trees);
            read.boxes.extend(page.boxes);
        }
        assert_eq!(read, world);
        for beyond in [280, usize::MAX] {
            let page = page(&world, beyond);
            assert!(page.trees.is_empty() && page.boxes.is_empty() && page.items == 280);
        }
    }
}
