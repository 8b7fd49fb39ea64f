//! The solids that a world is made of: signed distance and ray intersection, world frame, metres.

use goshawk_core::Vec3;

/// The union of all spheres whose centre moves from `a` to `b` while the radius goes linearly from `radius_a` to
/// `radius_b`: a capsule with taper. The ends must lie further apart than the radii differ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoundCone {
    /// One end of the axis.
    pub a: Vec3,
    /// The other end.
    pub b: Vec3,
    /// Radius about `a`, m.
    pub radius_a: f64,
    /// Radius about `b`, m.
    pub radius_b: f64,
}

/// An ellipsoid of revolution whose axis is vertical.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spheroid {
    /// Its centre.
    pub centre: Vec3,
    /// Semi-axis in the horizontal plane, m.
    pub radius_xy: f64,
    /// Vertical semi-axis, m.
    pub radius_z: f64,
}

/// An upright box, turned about the vertical.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cuboid {
    /// Its centre.
    pub centre: Vec3,
    /// Half its edges along its own axes, m, each above 0.
    pub half: Vec3,
    /// From east to its own x axis, rad.
    pub yaw_rad: f64,
}

/// The geometry of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Trunks, branches, limbs.
    Cone(RoundCone),
    /// Foliage.
    Spheroid(Spheroid),
    /// Walls, slabs, furniture, voxels.
    Cuboid(Cuboid),
}

impl RoundCone {
    /// (unit axis, its length, taper k = sine of the cone's half angle).
    fn axis(&self) -> (Vec3, f64, f64) {
        let along = self.b - self.a;
        let length = along.norm();
        (along / length, length, (self.radius_a - self.radius_b) / length)
    }

    /// Signed distance: exact outside; inside, the depth below the nearest of the spheres, which for a capsule is
    /// exact too.
    #[must_use]
    pub fn signed_distance(&self, p: &Vec3) -> f64 {
        let (axis, length, k) = self.axis();
        let rel = p - self.a;
        let y = axis.dot(&rel);
        let x = (rel.norm_squared() - y * y).max(0.0).sqrt();
        // The distance to the sphere at s, √(x² + (y − s)²) − (r_a − k s), is convex in s; its minimum has
        // y − s = k x / √(1 − k²).
        let s = (y - k * x / (1.0 - k * k).sqrt()).clamp(0.0, length);
        x.hypot(y - s) - (self.radius_a - k * s)
    }

    /// Distance along the unit vector `dir` to where the ray enters; `None` if it misses or starts beyond.
    fn ray(&self, origin: &Vec3, dir: &Vec3) -> Option<f64> {
        let (n, length, k) = self.axis();
        let (o, c2, r) = (origin - self.a, 1.0 - k * k, self.radius_a);
        let (y0, yd) = (n.dot(&o), n.dot(dir));
        // Lateral surface: √(1 − k²) x = r_a − k y for k r_a ≤ y ≤ k r_a + (1 − k²) length, squared.
        let qa = c2 - yd * yd;
        let qb = c2 * o.dot(dir) + (r * k - y0) * yd;
        let qc = c2 * o.norm_squared() - y0 * y0 + 2.0 * r * k * y0 - r * r;
        let disc = qb * qb - qa * qc;
        let lateral = (disc >= 0.0 && qa.abs() > 1e-12).then(|| (-qb - disc.sqrt()) / qa).filter(|t| {
            let y = y0 + t * yd;
            *t >= 0.0 && y >= k * r && y <= k * r + c2 * length
        });
        let ends = [(self.a, r), (self.b, self.radius_b)];
        let caps = ends.iter().filter_map(|(centre, radius)| ray_sphere(&(origin - centre), dir, *radius));
        caps.chain(lateral).reduce(f64::min)
    }
}

fn ray_sphere(o: &Vec3, dir: &Vec3, radius: f64) -> Option<f64> {
    let b = o.dot(dir);
    let disc = b * b - o.norm_squared() + radius * radius;
    (disc >= 0.0).then(|| -b - disc.sqrt()).filter(|t| *t >= 0.0)
}

impl Spheroid {
    /// Exact signed distance.
    #[must_use]
    pub fn signed_distance(&self, p: &Vec3) -> f64 {
        let rel = p - self.centre;
        let (a, b) = (self.radius_xy, self.radius_z);
        let (x, z) = (rel.x.hypot(rel.y).max(1e-9), rel.z.abs().max(1e-9));
        // The nearest point is (a² x / (t + a²), b² z / (t + b²)) at the root of a function that is convex and falls
        // in t; Newton from the left of the root never overshoots.
        let (a2, b2) = (a * a, b * b);
        let mut t = (a * x - a2).max(b * z - b2);
        for _ in 0..24 {
            let (fx, fz) = (a * x / (t + a2), b * z / (t + b2));
            let f = fx * fx + fz * fz - 1.0;
            let slope = -2.0 * (fx * fx / (t + a2) + fz * fz / (t + b2));
            let step = f / slope;
            t -= step;
            if step.abs() < 1e-12 * (a2 + b2) {
                break;
            }
        }
        let distance = (x - a2 * x / (t + a2)).hypot(z - b2 * z / (t + b2));
        if t < 0.0 { -distance } else { distance }
    }

    fn ray(&self, origin: &Vec3, dir: &Vec3) -> Option<f64> {
        let squash = |v: &Vec3| Vec3::new(v.x / self.radius_xy, v.y / self.radius_xy, v.z / self.radius_z);
        let (o, d) = (squash(&(origin - self.centre)), squash(dir));
        let (qa, qb) = (d.norm_squared(), o.dot(&d));
        let disc = qb * qb - qa * (o.norm_squared() - 1.0);
        (disc >= 0.0).then(|| (-qb - disc.sqrt()) / qa).filter(|t| *t >= 0.0)
    }
}

impl Cuboid {
    /// A vector of the world along the box's own axes.
    #[must_use]
    pub fn turn_in(&self, v_world: &Vec3) -> Vec3 {
        let (sin, cos) = self.yaw_rad.sin_cos();
        Vec3::new(cos * v_world.x + sin * v_world.y, cos * v_world.y - sin * v_world.x, v_world.z)
    }

    /// A vector along the box's own axes in the world.
    #[must_use]
    pub fn turn_out(&self, v: &Vec3) -> Vec3 {
        let (sin, cos) = self.yaw_rad.sin_cos();
        Vec3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z)
    }

    /// Exact signed distance.
    #[must_use]
    pub fn signed_distance(&self, p: &Vec3) -> f64 {
        let beyond = self.turn_in(&(p - self.centre)).abs() - self.half;
        beyond.sup(&Vec3::zeros()).norm() + beyond.max().min(0.0)
    }

    fn ray(&self, origin: &Vec3, dir: &Vec3) -> Option<f64> {
        let (o, d) = (self.turn_in(&(origin - self.centre)), self.turn_in(dir));
        let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            // A ray along a face divides by zero: the infinities have the right signs.
            let (a, b) = ((-self.half[axis] - o[axis]) / d[axis], (self.half[axis] - o[axis]) / d[axis]);
            if a.is_nan() || b.is_nan() {
                continue;
            }
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        (enter <= leave && enter > 0.0).then_some(enter)
    }
}

impl Shape {
    /// Signed distance of a point, negative inside, m.
    #[must_use]
    pub fn signed_distance(&self, p: &Vec3) -> f64 {
        match self {
            Shape::Cone(cone) => cone.signed_distance(p),
            Shape::Spheroid(spheroid) => spheroid.signed_distance(p),
            Shape::Cuboid(cuboid) => cuboid.signed_distance(p),
        }
    }

    /// Distance along the unit vector `dir` to where the ray enters the solid; `None` if it does not enter.
    #[must_use]
    pub fn ray(&self, origin: &Vec3, dir: &Vec3) -> Option<f64> {
        match self {
            Shape::Cone(cone) => cone.ray(origin, dir),
            Shape::Spheroid(spheroid) => spheroid.ray(origin, dir),
            Shape::Cuboid(cuboid) => cuboid.ray(origin, dir),
        }
    }

    /// Corners of the axis-aligned box around it.
    #[must_use]
    pub fn aabb(&self) -> (Vec3, Vec3) {
        match self {
            Shape::Cone(c) => {
                let (ra, rb) = (Vec3::repeat(c.radius_a), Vec3::repeat(c.radius_b));
                ((c.a - ra).inf(&(c.b - rb)), (c.a + ra).sup(&(c.b + rb)))
            }
            Shape::Spheroid(s) => {
                let half = Vec3::new(s.radius_xy, s.radius_xy, s.radius_z);
                (s.centre - half, s.centre + half)
            }
            Shape::Cuboid(c) => {
                let (sin, cos) = (c.yaw_rad.sin().abs(), c.yaw_rad.cos().abs());
                let half = Vec3::new(cos * c.half.x + sin * c.half.y, sin * c.half.x + cos * c.half.y, c.half.z);
                (c.centre - half, c.centre + half)
            }
        }
    }

    /// Centre and radius of a sphere around it.
    #[must_use]
    pub fn bounding_sphere(&self) -> (Vec3, f64) {
        match self {
            Shape::Cone(c) => ((c.a + c.b) * 0.5, (c.b - c.a).norm() * 0.5 + c.radius_a.max(c.radius_b)),
            Shape::Spheroid(s) => (s.centre, s.radius_xy.max(s.radius_z)),
            Shape::Cuboid(c) => (c.centre, c.half.norm()),
        }
    }
}
