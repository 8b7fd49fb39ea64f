//! Colours: sun, sky light, haze, and a texture for each material. Light is linear until the last line.

use super::camera::{CameraPose, Rays};
use super::ground::Field;
use super::texture::{floor, hash, signed, smooth};
use super::{Class, Frame, ID_GROUND, ID_NONE, ID_PERSON, Solids};
use crate::person::{BODY_PARTS, BodyPart};
use crate::world::{Kind, Look, RoundCone, Shape};
use goshawk_core::types::Vec3;
use nalgebra::Vector3;

type V3 = Vector3<f32>;

/// Colours every pixel of `frame` from its id and depth; `linear` is scratch of the size of `frame.rgb`.
pub(super) fn shade(
    solids: Solids<'_>,
    body: Option<&[BodyPart; BODY_PARTS]>,
    pose: &CameraPose,
    rays: &Rays,
    ids: &[u32],
    linear: &mut [f32],
    frame: &mut Frame,
) {
    let world = solids.world;
    let painter = Painter {
        look: world.look(),
        solids,
        sun: V3::from(world.look().sun_dir_world),
        field: Field::new(world.ground()),
        field_min: world.ground().min_xy().map(|c| c as f32),
    };
    let rotation = pose.rotation();
    let origin = pose.pos_world.cast::<f32>();
    for v in 0..rays.height {
        let row_dir = rotation.column(0) + rotation.column(2) * rays.dz[v];
        for u in 0..rays.width {
            let pixel = v * rays.width + u;
            let dir = row_dir + rotation.column(1) * rays.dy[u];
            let depth = frame.depth_m[pixel];
            let point = origin + dir * depth;
            let (class, light) = match ids[pixel] {
                ID_NONE => (Class::Sky, painter.background(&dir)),
                ID_GROUND => (Class::Ground, painter.ground(&point, depth)),
                id if id & ID_PERSON != 0 => {
                    let parts = body.expect("a person's pixel has a person");
                    let part = &parts[(id & !ID_PERSON) as usize];
                    (Class::Person, painter.person(part, &point, depth))
                }
                id => painter.part(id - 1, &point, depth),
            };
            frame.class[pixel] = class as u8;
            linear[3 * pixel..3 * pixel + 3].copy_from_slice(light.as_slice());
        }
    }
    // Square root: the display's gamma, near enough. On its own, so that it vectorises.
    for (level, light) in frame.rgb.iter_mut().zip(linear) {
        *level = (light.max(0.0).sqrt() * 255.0 + 0.5).min(255.0) as u8;
    }
}

struct Painter<'a> {
    look: &'a Look,
    solids: Solids<'a>,
    sun: V3,
    field: Field<'a>,
    field_min: [f32; 2],
}

impl Painter<'_> {
    /// Light from a surface: `detail` scales its colour, dappled shade and haze are added.
    fn lit(&self, tint: V3, detail: f32, normal: &V3, point: &V3, depth: f32) -> V3 {
        let look = self.look;
        let mut sun = normal.dot(&self.sun).max(0.0);
        if look.shade > 0.0 {
            // Shade of the canopy, carried along the sun's rays to the ground plane.
            let slide = point.z / self.sun.z;
            let (x, y) = (point.x - self.sun.x * slide, point.y - self.sun.y * slide);
            let cover = smooth(x * 0.7, y * 0.7, 11) + 0.35 * signed(hash(floor(x * 4.0), floor(y * 4.0), 12));
            sun *= ((cover + 1.0 - 2.0 * look.shade) * 2.5 + 0.5).clamp(0.08, 1.0);
        }
        let skyward = 0.62 + 0.38 * normal.z;
        let lit = (V3::from(look.sun_rgb) * sun + V3::from(look.ambient_rgb) * skyward).component_mul(&tint) * detail;
        let haze = 1.0 - 1.0 / (1.0 + look.haze_per_m * depth);
        lit + (V3::from(look.horizon_rgb) - lit) * haze
    }

    fn part(&self, index: u32, point: &V3, depth: f32) -> (Class, V3) {
        let part = self.solids.part(index as usize);
        let (mut normal, salt) = (surface_normal(&part.shape, point), index as i32);
        let near = 1.0 / (1.0 + 0.02 * depth * depth);
        let tint = V3::from(part.tint);
        match part.kind {
            Kind::Trunk | Kind::Branch => {
                let stripe = hash(floor(point.x * 22.0), floor(point.y * 22.0), floor(point.z * 3.5) + salt * 64);
                let patch = smooth(point.z * 2.0, (point.x + point.y) * 3.0, salt);
                let detail = 1.0 + 0.45 * near * signed(stripe) + 0.2 * patch;
                let class = if part.kind == Kind::Trunk { Class::Trunk } else { Class::Branch };
                (class, self.lit(tint, detail, &normal, point, depth))
            }
            Kind::Foliage => {
                let leaf = hash(floor(point.x * 13.0), floor(point.y * 13.0), floor(point.z * 13.0));
                let clump = hash(floor(point.x * 4.0), floor(point.y * 4.0), floor(point.z * 4.0));
                let turn = |shift: u32| signed(leaf.rotate_left(shift)) * 0.7 * near;
                normal = (normal + V3::new(turn(3), turn(11), turn(19))).normalize();
                let detail = 1.0 + 0.5 * near * signed(leaf) + 0.25 * signed(clump);
                (Class::Foliage, self.lit(tint, detail, &normal, point, depth))
            }
            Kind::Building => {
                // Courses of blocks with joints, under stains; a plaster finish on every third part.
                let along = if normal.x.abs() > normal.y.abs() { point.y } else { point.x };
                let (row, plaster) = (floor(point.z * 4.0), salt % 3 == 0);
                let column = along * 2.0 + if row % 2 == 0 { 0.5 } else { 0.0 };
                let joint = (point.z * 4.0 - row as f32).min(column - floor(column) as f32) < 0.07;
                let block = 0.12 * signed(hash(row, floor(column), salt));
                let stain = 0.15 * smooth(along * 0.9, point.z * 1.3, salt);
                let course = if plaster { 0.0 } else { block - if joint { 0.25 * near } else { 0.0 } };
                (Class::Building, self.lit(tint, 1.0 + stain + course, &normal, point, depth))
            }
            Kind::Scan => {
                let grain = hash(floor(point.x * 9.0), floor(point.y * 9.0), floor(point.z * 9.0));
                (Class::Scan, self.lit(tint, 1.0 + 0.25 * near * signed(grain), &normal, point, depth))
            }
            // Painted in bands that do not run along as it moves.
            Kind::Moving => {
                let band = if floor(point.z * 2.5) % 2 == 0 { 0.2 } else { -0.2 };
                (Class::Moving, self.lit(tint, 1.0 + band, &normal, point, depth))
            }
        }
    }

    fn person(&self, part: &BodyPart, point: &V3, depth: f32) -> V3 {
        let normal = surface_normal(&Shape::Cone(part.cone), point);
        self.lit(V3::from(part.tint), 1.0, &normal, point, depth)
    }

    fn ground(&self, point: &V3, depth: f32) -> V3 {
        let normal = if depth < 25.0 {
            let (_, along_x, along_y) = self.field.sample(point.x - self.field_min[0], point.y - self.field_min[1]);
            V3::new(-along_x, -along_y, 1.0).normalize()
        } else {
            V3::z()
        };
        let near = 1.0 / (1.0 + 0.015 * depth * depth);
        let patch = smooth(point.x * 0.6, point.y * 0.6, 1) + 0.5 * smooth(point.x * 2.3, point.y * 2.3, 2);
        let speck = signed(hash(floor(point.x * 14.0), floor(point.y * 14.0), 3));
        let mix = (0.5 + 0.45 * patch + 0.3 * near * speck).clamp(0.0, 1.0);
        let [first, second] = self.look.ground_rgb.map(V3::from);
        let lit = self.lit(first + (second - first) * mix, 1.0 + 0.3 * near * speck, &normal, point, depth);
        // Far ground fades into the wood behind it.
        let fade = (depth * (1.0 / 60.0)).min(1.0);
        lit + (self.far_wood(1.0) - lit) * (fade * fade)
    }

    fn far_wood(&self, detail: f32) -> V3 {
        let veil = (0.25 + 20.0 * self.look.haze_per_m).min(0.6);
        V3::from(self.look.backdrop_rgb) * detail * (1.0 - veil) + V3::from(self.look.horizon_rgb) * (veil * 0.8)
    }

    /// Sky with a gradient, closed at the horizon by a far wood.
    fn background(&self, dir: &V3) -> V3 {
        let flat = (dir.x * dir.x + dir.y * dir.y).sqrt().max(1e-6);
        let (ax, ay, rise) = (dir.x / flat, dir.y / flat, dir.z / flat);
        let [horizon, zenith] = [self.look.horizon_rgb, self.look.zenith_rgb].map(V3::from);
        let crown = 0.13 + 0.06 * smooth(ax * 9.0, ay * 9.0, 21) + 0.025 * smooth(ax * 50.0, ay * 50.0, 22);
        if rise < crown {
            let stems = signed(hash(floor(ax * 90.0), floor(ay * 90.0), floor(rise * 12.0)));
            return self.far_wood(1.0 + 0.3 * stems);
        }
        let clouds = 0.06 * smooth(ax * 3.0 + 7.0 * rise, ay * 3.0, 23);
        horizon + (zenith - horizon) * (rise * 0.9).min(1.0) + V3::repeat(clouds)
    }
}

/// Outward unit normal of a solid at a point of its surface, world frame.
fn surface_normal(shape: &Shape, point: &V3) -> V3 {
    let single = |v: &Vec3| v.cast::<f32>();
    match shape {
        Shape::Cone(RoundCone { a, b, radius_a, radius_b }) => {
            let (a, along) = (single(a), single(&(b - a)));
            let length = along.norm();
            let (axis, k) = (along / length, (radius_a - radius_b) as f32 / length);
            let rel = point - a;
            let y = axis.dot(&rel);
            let x = (rel.norm_squared() - y * y).max(0.0).sqrt();
            let s = (y - k * x / (1.0 - k * k).sqrt()).clamp(0.0, length);
            (rel - axis * s).try_normalize(1e-9).unwrap_or(V3::z())
        }
        Shape::Spheroid(s) => {
            let rel = point - single(&s.centre);
            let (xy, z) = ((s.radius_xy * s.radius_xy) as f32, (s.radius_z * s.radius_z) as f32);
            V3::new(rel.x / xy, rel.y / xy, rel.z / z).try_normalize(1e-9).unwrap_or(V3::z())
        }
        Shape::Cuboid(c) => {
            let rel = c.turn_in(&(point.cast::<f64>() - c.centre));
            let axis = (rel.abs() - c.half).imax();
            let mut normal = Vec3::zeros();
            normal[axis] = rel[axis].signum();
            single(&c.turn_out(&normal))
        }
    }
}
