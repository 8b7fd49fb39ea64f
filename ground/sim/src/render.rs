//! The RGB-D camera: exact ray casting of a [`World`] and a [`Person`] into colour, depth and class.
//!
//! Obstacles are drawn one at a time into a depth buffer: each covers a small rectangle of pixels, in which its
//! analytic ray intersection is evaluated row by row ([`raster`]). Then come the ground, for what is still open, and
//! the colours, once a pixel. Rays have unit length along the optical axis, so a ray parameter *is* the depth.

mod bounds;
mod camera;
mod ground;
mod raster;
mod shade;
mod texture;

pub use camera::{Camera, CameraPose};

use crate::person::Person;
use crate::world::{Part, Shape, World};
use camera::Rays;
use raster::{Canvas, ViewCone, ViewCuboid, ViewSpheroid};

/// Parts that begin beyond this distance from the camera are not drawn, m.
pub const RANGE_M: f32 = 30.0;

/// Nothing nearer than this along the optical axis is drawn, m.
const NEAR_M: f32 = 0.02;

/// What a pixel shows; the values of [`Frame::class`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Class {
    /// Nothing but air.
    Sky = 0,
    /// The height field.
    Ground = 1,
    /// A tree's stem.
    Trunk = 2,
    /// A thin limb.
    Branch = 3,
    /// Leaves.
    Foliage = 4,
    /// The target.
    Person = 5,
    /// Walls, ceilings, furniture.
    Building = 6,
    /// A scanned surface.
    Scan = 7,
    /// A moving obstacle.
    Moving = 8,
}

/// One ideal image: row-major from the top left, no sensor effects.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green, blue; `height · width · 3`.
    pub rgb: Vec<u8>,
    /// Along the optical axis, m; infinite where there is only sky.
    pub depth_m: Vec<f32>,
    /// A [`Class`] for each pixel.
    pub class: Vec<u8>,
    /// Pixels that the person alone would cover in this view.
    pub person_pixels: u32,
    /// Pixels that show the person.
    pub person_pixels_visible: u32,
}

impl Frame {
    /// The unoccluded fraction of the person's pixels in view, 0..=1; 0 if none is in view.
    #[must_use]
    pub fn person_visible(&self) -> f64 {
        if self.person_pixels == 0 {
            return 0.0;
        }
        f64::from(self.person_pixels_visible) / f64::from(self.person_pixels)
    }
}

/// Ids in the pixel buffer: nothing, the ground, a body part (flag + index), a world part (index + 1), and after the
/// world's parts the moving ones.
const ID_NONE: u32 = 0;
const ID_GROUND: u32 = 0x4000_0000;
const ID_PERSON: u32 = 0x8000_0000;

/// What an id stands for: the world's parts, then the moving ones.
#[derive(Clone, Copy)]
struct Solids<'a> {
    world: &'a World,
    moving: &'a [Part],
}

impl Solids<'_> {
    fn part(&self, index: usize) -> &Part {
        let fixed = self.world.parts();
        fixed.get(index).unwrap_or_else(|| &self.moving[index - fixed.len()])
    }
}

/// Draws frames of one camera; owns the scratch memory, so that drawing allocates nothing.
#[derive(Clone, Debug)]
pub struct Renderer {
    camera: Camera,
    rays: Rays,
    ids: Vec<u32>,
    linear: Vec<f32>,
}

impl Renderer {
    /// A renderer for images of `camera`.
    #[must_use]
    pub fn new(camera: Camera) -> Self {
        let pixels = camera.width * camera.height;
        Self { rays: Rays::new(&camera), ids: vec![ID_NONE; pixels], linear: vec![0.0; 3 * pixels], camera }
    }

    /// The camera that it draws for.
    #[must_use]
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Draws what `pose` sees into `frame`, whose buffers are sized on first use.
    pub fn render(&mut self, world: &World, person: Option<&Person>, pose: &CameraPose, frame: &mut Frame) {
        self.render_with(world, &[], person, pose, frame);
    }

    /// As [`Renderer::render`], with parts that are no part of the world: they move.
    pub fn render_with(
        &mut self,
        world: &World,
        moving: &[Part],
        person: Option<&Person>,
        pose: &CameraPose,
        frame: &mut Frame,
    ) {
        let pixels = self.camera.width * self.camera.height;
        (frame.width, frame.height) = (self.camera.width, self.camera.height);
        frame.rgb.resize(pixels * 3, 0);
        frame.class.resize(pixels, 0);
        frame.depth_m.clear();
        frame.depth_m.resize(pixels, f32::INFINITY);
        self.ids.fill(ID_NONE);

        let body = person.map(Person::body);
        let mut canvas = Canvas { rays: &self.rays, depth: &mut frame.depth_m, ids: &mut self.ids };
        // The person comes first, alone, to count the pixels that nothing hides yet.
        for (index, part) in body.iter().flatten().enumerate() {
            canvas.cone(&ViewCone::new(&part.cone, pose), ID_PERSON | index as u32, true);
        }
        frame.person_pixels = count_person(canvas.ids);
        let fixed = world.parts().iter().zip(world.bounding_spheres().iter().copied());
        let moving_parts = moving.iter().map(|part| (part, part.shape.bounding_sphere()));
        for (index, (part, (centre, radius))) in fixed.chain(moving_parts).enumerate() {
            if !self.rays.may_see(&pose.to_cam(&centre), radius as f32, RANGE_M) {
                continue;
            }
            let id = index as u32 + 1;
            match &part.shape {
                // A trunk's lower cap lies in the ground.
                Shape::Cone(c) => canvas.cone(&ViewCone::new(c, pose), id, part.kind != crate::world::Kind::Trunk),
                Shape::Spheroid(s) => canvas.spheroid(&ViewSpheroid::new(s, pose), id),
                Shape::Cuboid(c) => canvas.cuboid(&ViewCuboid::new(c, pose), id),
            }
        }
        ground::draw(world.ground(), pose, &mut canvas);
        frame.person_pixels_visible = count_person(canvas.ids);
        shade::shade(Solids { world, moving }, body.as_ref(), pose, &self.rays, &self.ids, &mut self.linear, frame);
    }
}

fn count_person(ids: &[u32]) -> u32 {
    ids.iter().map(|id| id >> 31).sum()
}
