//! The RGB-D camera: exact ray casting of a [`World`] and a [`Person`] into colour, depth and class.
//!
//! Obstacles are drawn one at a time into a depth buffer: each covers a small rectangle of pixels, in which its
//! analytic ray intersection is evaluated row by row ([`raster`]). Then come the ground, for what is still open
//! ([`ground`]), and the colours, once a pixel ([`shade`]). Rays have unit length along the optical axis, so a ray parameter *is* the depth.

mod bounds;
mod camera;
mod field;
mod ground;
pub(crate) mod lanes;
mod raster;
mod shade;
mod surface;
mod texture;

pub use camera::{Camera, CameraPose};

use crate::actors::person::Person;
use crate::world::{Part, Shape, World};
use camera::{Rays, View};
use raster::{Canvas, ViewCone, ViewCuboid, ViewSpheroid};
use shade::{Picture, Sorted};
use surface::Surface;

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

impl Class {
    /// In the order of their values.
    const ALL: [Self; 9] = [
        Self::Sky,
        Self::Ground,
        Self::Trunk,
        Self::Branch,
        Self::Foliage,
        Self::Person,
        Self::Building,
        Self::Scan,
        Self::Moving,
    ];
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

/// Ids in the pixel buffer: sky and ground have their class's value; then come the frame's solids, the person's limbs
/// first.
const ID_SKY: u32 = Class::Sky as u32;
const ID_GROUND: u32 = Class::Ground as u32;
const FIRST_SOLID: u32 = 2;

/// Draws frames of one camera; owns the scratch memory, so that drawing allocates nothing.
#[derive(Clone, Debug)]
pub struct Renderer {
    camera: Camera,
    rays: Rays,
    ids: Vec<u32>,
    slopes: [Vec<f32>; 2],
    row_below: ground::RowBelow,
    surfaces: Vec<Surface>,
    sorted: Sorted,
}

impl Renderer {
    /// A renderer for images of `camera`.
    #[must_use]
    pub fn new(camera: Camera) -> Self {
        let pixels = camera.width * camera.height;
        Self {
            rays: Rays::new(&camera),
            ids: vec![ID_SKY; pixels],
            slopes: [vec![0.0; pixels], vec![0.0; pixels]],
            row_below: ground::RowBelow::new(camera.width),
            surfaces: Vec::new(),
            sorted: Sorted::default(),
            camera,
        }
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
        self.ids.fill(ID_SKY);
        self.surfaces.clear();

        let view = &View::new(pose);
        let mut canvas = Canvas { rays: &self.rays, depth: &mut frame.depth_m, ids: &mut self.ids };
        // The person comes first, alone, to count the pixels that nothing hides yet.
        for part in person.map(Person::body).iter().flatten() {
            let id = add(&mut self.surfaces, Surface::of_body(part));
            canvas.cone(&ViewCone::new(&part.cone, view), id, true);
        }
        let limbs = self.surfaces.len() as u32;
        frame.person_pixels = count_person(canvas.ids, limbs);
        let fixed = world.parts().iter().zip(world.bounding_spheres().iter().copied());
        let moving = moving.iter().map(|part| (part, part.shape.bounding_sphere()));
        for (index, (part, (centre, radius))) in fixed.chain(moving).enumerate() {
            if !self.rays.may_see(&view.to_cam(&centre), radius as f32, RANGE_M) {
                continue;
            }
            let id = add(&mut self.surfaces, Surface::of_part(part, index));
            match &part.shape {
                // A trunk's lower cap lies in the ground.
                Shape::Cone(c) => canvas.cone(&ViewCone::new(c, view), id, part.kind != crate::world::Kind::Trunk),
                Shape::Spheroid(s) => canvas.spheroid(&ViewSpheroid::new(s, view), id),
                Shape::Cuboid(c) => canvas.cuboid(&ViewCuboid::new(c, view), id),
            }
        }
        ground::draw(world.ground(), view, &mut canvas, &mut self.slopes, &mut self.row_below);
        frame.person_pixels_visible = count_person(canvas.ids, limbs);
        let picture = Picture { rays: &self.rays, ids: &self.ids, slopes: &self.slopes, surfaces: &self.surfaces };
        shade::shade(world.look(), view, &picture, &mut self.sorted, frame);
    }
}

/// Returns its id.
fn add(surfaces: &mut Vec<Surface>, surface: Surface) -> u32 {
    surfaces.push(surface);
    FIRST_SOLID + surfaces.len() as u32 - 1
}

/// Pixels of the first `limbs` solids.
fn count_person(ids: &[u32], limbs: u32) -> u32 {
    ids.iter().map(|id| u32::from(id.wrapping_sub(FIRST_SOLID) < limbs)).sum()
}
