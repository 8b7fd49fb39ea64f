//! What a ray meets.

/// The first thing on a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// From the ray's origin, m.
    pub distance_m: f64,
    /// What was met.
    pub surface: Surface,
}

/// What a ray can meet in the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surface {
    /// The height field.
    Ground,
    /// The part with this index in [`super::World::parts`].
    Part(u32),
}
