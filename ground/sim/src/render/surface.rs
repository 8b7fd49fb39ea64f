//! What the colours need to know of each thing that is drawn in a frame.

use super::Class;
use crate::actors::person::BodyPart;
use crate::world::{Cuboid, Kind, Part, RoundCone, Shape, Spheroid};
use goshawk_core::Vec3;
use nalgebra::Vector3;

type V3 = Vector3<f32>;

/// One solid, single precision, world frame.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    pub(super) class: Class,
    /// Base colour, linear light.
    pub(super) tint: [f32; 3],
    /// Sets its texture apart from its neighbours'.
    pub(super) salt: i32,
    form: Form,
}

#[derive(Clone, Debug)]
enum Form {
    /// The axis from `a`; `lean`: k / √(1 − k²), see [`RoundCone`].
    Cone { a: V3, axis: V3, length: f32, lean: f32 },
    /// Inverses of the squared semi-axes.
    Spheroid { centre: V3, inv_xy2: f32, inv_z2: f32 },
    /// (cos, sin) of the yaw.
    Cuboid { centre: V3, half: V3, turn: (f32, f32) },
}

impl From<&Shape> for Form {
    fn from(shape: &Shape) -> Self {
        let single = |v: &Vec3| v.cast::<f32>();
        match shape {
            Shape::Cone(RoundCone { a, b, radius_a, radius_b }) => {
                let along = b - a;
                let length = along.norm();
                let k = (radius_a - radius_b) / length;
                let lean = (k / (1.0 - k * k).sqrt()) as f32;
                Self::Cone { a: single(a), axis: single(&(along / length)), length: length as f32, lean }
            }
            Shape::Spheroid(Spheroid { centre, radius_xy, radius_z }) => {
                let inverse = |radius: f64| (1.0 / (radius * radius)) as f32;
                Self::Spheroid { centre: single(centre), inv_xy2: inverse(*radius_xy), inv_z2: inverse(*radius_z) }
            }
            Shape::Cuboid(Cuboid { centre, half, yaw_rad }) => {
                let turn = (yaw_rad.cos() as f32, yaw_rad.sin() as f32);
                Self::Cuboid { centre: single(centre), half: single(half), turn }
            }
        }
    }
}

impl Surface {
    /// A part of the world; `index` is its own in the world.
    pub(super) fn of_part(part: &Part, index: usize) -> Self {
        let class = match part.kind {
            Kind::Trunk => Class::Trunk,
            Kind::Branch => Class::Branch,
            Kind::Foliage => Class::Foliage,
            Kind::Building => Class::Building,
            Kind::Scan => Class::Scan,
            Kind::Moving => Class::Moving,
        };
        Self { class, tint: part.tint, salt: index as i32, form: (&part.shape).into() }
    }

    /// A limb of the person.
    pub(super) fn of_body(part: &BodyPart) -> Self {
        Self { class: Class::Person, tint: part.tint, salt: 0, form: (&Shape::Cone(part.cone)).into() }
    }

    /// Outward unit normal at a point of the surface.
    #[inline]
    pub(super) fn normal(&self, point: &V3) -> V3 {
        match &self.form {
            Form::Cone { a, axis, length, lean } => {
                let rel = point - a;
                let y = axis.dot(&rel);
                let x = (rel.norm_squared() - y * y).max(0.0).sqrt();
                unit(rel - axis * (y - lean * x).clamp(0.0, *length))
            }
            Form::Spheroid { centre, inv_xy2, inv_z2 } => {
                let rel = point - centre;
                unit(V3::new(rel.x * inv_xy2, rel.y * inv_xy2, rel.z * inv_z2))
            }
            Form::Cuboid { centre, half, turn: (cos, sin) } => {
                let rel = point - centre;
                let along = V3::new(cos * rel.x + sin * rel.y, cos * rel.y - sin * rel.x, rel.z);
                let beyond = along.abs() - half;
                if beyond.z >= beyond.x && beyond.z >= beyond.y {
                    V3::new(0.0, 0.0, along.z.signum())
                } else if beyond.x >= beyond.y {
                    V3::new(*cos, *sin, 0.0) * along.x.signum()
                } else {
                    V3::new(-sin, *cos, 0.0) * along.y.signum()
                }
            }
        }
    }
}

fn unit(v: V3) -> V3 {
    v * (1.0 / v.norm().max(1e-9))
}
