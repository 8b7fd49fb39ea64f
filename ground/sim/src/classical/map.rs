//! The occupancy map: log-odds in a voxel grid that rolls along with the vehicle, from depth images alone.

use goshawk_core::Vec3;
use nalgebra::Vector3;

use crate::render::{Camera, CameraPose};

/// Edge of a voxel, m, and how many are in a metre.
pub const VOXEL_M: f64 = 0.2;
pub(super) const PER_M: f64 = 1.0 / VOXEL_M;

/// Indices of a voxel in the world's endless grid.
pub type Voxel = Vector3<i32>;

/// Voxels along x, y, z: powers of two, so that an index wraps by a mask.
pub(super) const SIZE: [i32; 3] = [128, 128, 32];

/// Log-odds, in small integers. A pixel that ends in a voxel adds `HIT`, up to `HITS_MAX` times a frame; a frame whose
/// rays only pass through it takes `MISS`. Two pixels of one frame, or one of two frames, make an obstacle; a single
/// stray pixel does not.
const HIT: i8 = 3;
const HITS_MAX: u8 = 3;
const MISS: i8 = 2;
const OCCUPIED: i8 = 6;
/// So bounded, what was free for long is seen to be occupied within two frames, and the other way round in a dozen.
const LEAST: i8 = -8;
const MOST: i8 = 26;

/// Depth beyond this ends nothing, its ray is only followed so far, m: noise grows with its square.
const RANGE_M: f64 = 10.0;
/// Every so many pixels, in both directions, a ray is carved: at the range they are 0.25 m apart.
const CARVE_PX: usize = 2;
/// Between samples of a carved ray, m.
const CARVE_STEP_M: f64 = 0.15;
/// Carving stops this far before the measured end, m, and this much times the depth squared, 1/m: the end's noise.
const CARVE_SHORT_M: f64 = 0.2;
const CARVE_SHORT_PER_M: f64 = 0.005;

/// Something that is no obstacle: an upright cylinder about the target. What is seen in it is not mapped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ignored {
    /// A point of the axis, world frame, m.
    pub at_world: Vec3,
    /// Horizontal radius, m.
    pub radius_m: f64,
    /// How far up and down from the point, m.
    pub half_height_m: f64,
}

impl Ignored {
    fn contains(&self, at_world: &Vec3) -> bool {
        let from = at_world - self.at_world;
        from.xy().norm() < self.radius_m && from.z.abs() < self.half_height_m
    }
}

/// What is known of a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Knowledge {
    /// Never observed, or outside the grid.
    Unknown,
    /// Rather free.
    Free,
    /// An obstacle.
    Occupied,
}

/// The rolling grid.
#[derive(Clone, Debug)]
pub struct Map {
    /// Lowest voxel; none: nothing has been seen.
    low: Option<Voxel>,
    log_odds: Vec<i8>,
    /// Pixels that ended in a voxel in this frame; all 0 between frames.
    hits: Vec<u8>,
    touched: Vec<usize>,
    /// The frame that last carved a voxel.
    carved: Vec<u32>,
    frame: u32,
}

/// The voxel that holds a point.
#[must_use]
pub fn voxel_of(pos_world: &Vec3) -> Voxel {
    pos_world.map(|x| (x * PER_M).floor() as i32)
}

fn slot(voxel: &Voxel) -> usize {
    let wrap = |axis: usize| (voxel[axis] & (SIZE[axis] - 1)) as usize;
    (wrap(2) * SIZE[1] as usize + wrap(1)) * SIZE[0] as usize + wrap(0)
}

impl Default for Map {
    fn default() -> Self {
        Self::new()
    }
}

impl Map {
    /// A map of nothing.
    #[must_use]
    pub fn new() -> Self {
        let voxels = SIZE.iter().map(|n| *n as usize).product();
        Self {
            low: None,
            log_odds: vec![0; voxels],
            hits: vec![0; voxels],
            touched: Vec::new(),
            carved: vec![0; voxels],
            frame: 0,
        }
    }

    /// What is known of the voxel that holds a point.
    #[must_use]
    pub fn knowledge(&self, pos_world: &Vec3) -> Knowledge {
        match self.index(pos_world).map_or(0, |index| self.log_odds[index]) {
            OCCUPIED.. => Knowledge::Occupied,
            ..0 => Knowledge::Free,
            _ => Knowledge::Unknown,
        }
    }

    /// The lowest voxel of the grid, which holds `SIZE` of them; none: nothing has been seen.
    pub(super) fn low(&self) -> Option<Voxel> {
        self.low
    }

    /// Whether each voxel of a row along x is occupied, from `first` on; the row must lie within the grid.
    pub(super) fn row(&self, first: &Voxel) -> impl Iterator<Item = bool> {
        let start = slot(&Voxel::new(0, first.y, first.z));
        let x = first.x;
        (0..).map(move |i| self.log_odds[start + ((x + i) & (SIZE[0] - 1)) as usize] >= OCCUPIED)
    }

    /// Takes in a depth image (mm along the optical axis, row-major, 0: no measurement) seen from `pose`.
    pub fn integrate(&mut self, camera: &Camera, pose: &CameraPose, depth_mm: &[u16], ignored: Option<&Ignored>) {
        self.roll(&pose.pos_world);
        self.frame += 1;
        self.hit(camera, pose, depth_mm, ignored);
        self.carve(camera, pose, depth_mm, ignored);
        for index in std::mem::take(&mut self.touched) {
            let added = HIT * self.hits[index].min(HITS_MAX) as i8;
            self.log_odds[index] = (self.log_odds[index] + added).min(MOST);
            self.hits[index] = 0;
        }
    }

    /// Counts the pixels that end in each voxel.
    fn hit(&mut self, camera: &Camera, pose: &CameraPose, depth_mm: &[u16], ignored: Option<&Ignored>) {
        for (pixel, depth) in depth_mm.iter().enumerate().filter(|(_, depth)| **depth > 0) {
            let depth_m = f64::from(*depth) * 1e-3;
            if depth_m > RANGE_M {
                continue;
            }
            let end = pose.pos_world + ray_world(camera, pose, pixel) * depth_m;
            if ignored.is_some_and(|cylinder| cylinder.contains(&end)) {
                continue;
            }
            let Some(index) = self.index(&end) else { continue };
            if self.hits[index] == 0 {
                self.touched.push(index);
            }
            self.hits[index] = self.hits[index].saturating_add(1);
        }
    }

    /// Takes from the voxels that rays pass through, once a frame; not from those that are hit.
    fn carve(&mut self, camera: &Camera, pose: &CameraPose, depth_mm: &[u16], ignored: Option<&Ignored>) {
        for v in (0..camera.height).step_by(CARVE_PX) {
            for u in (0..camera.width).step_by(CARVE_PX) {
                let pixel = v * camera.width + u;
                let Some(depth) = depth_mm.get(pixel).filter(|depth| **depth > 0) else { continue };
                let depth_m = f64::from(*depth) * 1e-3;
                let ray = ray_world(camera, pose, pixel);
                if ignored.is_some_and(|cylinder| cylinder.contains(&(pose.pos_world + ray * depth_m))) {
                    continue;
                }
                let free_m = (depth_m - CARVE_SHORT_M - CARVE_SHORT_PER_M * depth_m * depth_m).min(RANGE_M);
                let step = CARVE_STEP_M / ray.norm();
                for k in 1..=(free_m / step).max(0.0) as usize {
                    let at = pose.pos_world + ray * (step * k as f64);
                    let Some(index) = self.index(&at) else { break };
                    if self.carved[index] != self.frame && self.hits[index] == 0 {
                        self.carved[index] = self.frame;
                        self.log_odds[index] = (self.log_odds[index] - MISS).max(LEAST);
                    }
                }
            }
        }
    }

    /// Where a point's voxel lies in the arrays; none outside the grid.
    fn index(&self, pos_world: &Vec3) -> Option<usize> {
        let low = self.low?;
        let from = pos_world * PER_M - low.map(f64::from);
        let inside = (0..3).all(|axis| from[axis] >= 0.0 && from[axis] < f64::from(SIZE[axis]));
        // Above zero cutting is flooring, and faster.
        inside.then(|| slot(&(low + from.map(|x| x as i32))))
    }

    /// Moves the grid so that `centre_world` is in its middle, and forgets what it leaves.
    fn roll(&mut self, centre_world: &Vec3) {
        let low = voxel_of(centre_world) - Voxel::from(SIZE) / 2;
        let Some(old) = self.low.replace(low) else { return };
        for axis in 0..3 {
            let moved = low[axis] - old[axis];
            // The planes that come in take the memory of those that go.
            let first = if moved > 0 { old[axis] + SIZE[axis] } else { low[axis] };
            for plane in first..first + moved.abs().min(SIZE[axis]) {
                self.forget_plane(axis, plane);
            }
        }
    }

    fn forget_plane(&mut self, axis: usize, plane: i32) {
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut voxel = Voxel::zeros();
        voxel[axis] = plane;
        for i in 0..SIZE[a] {
            for j in 0..SIZE[b] {
                (voxel[a], voxel[b]) = (i, j);
                self.log_odds[slot(&voxel)] = 0;
            }
        }
    }
}

/// The ray through a pixel's centre in the world frame; its component along the optical axis is 1.
fn ray_world(camera: &Camera, pose: &CameraPose, pixel: usize) -> Vec3 {
    let (u, v) = ((pixel % camera.width) as f64 + 0.5, (pixel / camera.width) as f64 + 0.5);
    pose.world_from_cam * camera.ray_cam(u, v)
}
