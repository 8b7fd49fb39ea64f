//! What was seen to stand about the vehicle in the last seconds (beyond the paper).
//!
//! The network sees one image. A thin branch is missing in many of them, and out of sight when it is passed: so the
//! nearest depths of each image are kept in a voxel grid that rolls along. The trajectories are held against it, and the
//! line of sight to the target.

use crate::planning::movers::{Followed, Fresh, Movers, MoversConfig};
use crate::planning::nearest::{BLOCKS, Blocks, Nearest, ROWS, coarse};
use crate::planning::room::{FARTHEST_ROOM, Room, among};
use crate::values::types::{Rot, Time, Vec3};
use nalgebra::{Vector2, Vector3};
use schemars::JsonSchema;
use serde::Deserialize;

mod hiding;
mod meeting;

/// What is remembered as standing about the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObstaclesConfig {
    /// The vehicle's body and half of what is remembered as one thing, m.
    #[schemars(range(min = 0.1, max = 2.0), extend("x-why" = "with less the airframe does not pass, with more there is no room", "x-source" = "chosen by eye"))]
    pub body_radius_m: f64,
    /// What is so near to the target's axis is the target, m: half a person, its stride, and the estimate's error.
    #[schemars(range(min = 0.1, max = 5.0), extend("x-why" = "with less the target is an obstacle, with more what stands beside it is none", "x-source" = "chosen by eye"))]
    pub target_radius_m: f64,
    /// Looking through ends this far before the measured depth, m.
    #[schemars(range(min = 0.05, max = 2.0), extend("x-why" = "with less a thing is looked through, with more it is never forgotten", "x-source" = "chosen by eye"))]
    pub depth_margin_m: f64,
    /// It ends farther before that depth by this times its square, 1/m: the depth's noise.
    #[schemars(range(min = 0.0, max = 0.1), extend("x-why" = "with more noise nothing can be looked through", "x-source" = "three times the D455's noise in ground/sim/sensors/d455.toml"))]
    pub depth_margin_per_m: f64,
}

/// Edge of a voxel, m: as in the maps that the policies are trained in.
pub const VOXEL: f64 = 0.2;
/// Voxels along x, y, z: powers of two, so that an index wraps by a mask. A row along x is one word of bits.
const SIZE: [i32; 3] = [128, 128, 32];
/// All of them.
const VOXELS: usize = 128 * ROW_COUNT;
/// Rows along x.
const ROW_COUNT: usize = 128 * 32;

/// Evidence for something in a voxel that a frame gives which ends there: two make an obstacle, a stray pixel does not.
const HIT: i8 = 3;
/// Evidence that a frame takes which looks through it: a branch that every third image misses stays.
const MISS: i8 = 2;
/// From this evidence on something is there: two hits.
const OCCUPIED: i8 = 6;
/// The least evidence: two frames that look through.
const LEAST: i8 = -4;
/// The most evidence: ten frames that look through forget it. Chosen by eye.
const MOST: i8 = 24;

/// Looking through ends no farther than this, m: what comes nearer than is remembered came through what was seen to be
/// free. As far as the D455's depth is of use.
const LOOKED: f32 = 10.0;
/// Between the points of a ray, voxels. Chosen by eye.
const STEP: f32 = 0.8;

/// What moves is looked for from so far below the camera to so far above it, m. Chosen by eye.
const LEVEL: (f32, f32) = (-1.0, 0.7);
/// It is gone if one sees this much farther, m, where it should be. Chosen by eye.
const BEYOND: f64 = 0.8;
/// One looks for it at the camera's height and so far below, m. Chosen by eye.
const BELOW: f64 = -0.5;

/// One looked through a place that is level with the camera if one did at one of these heights about it, m.
const ABOUT: [f64; 4] = [-0.4, -0.2, 0.0, 0.2];

/// A place so near is where the vehicle is already, m. Chosen by eye.
const AT_HAND: f64 = 0.5;

type Voxel = Vector3<i32>;

/// Something that is no obstacle: an upright cylinder about the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ignored {
    /// A point of its axis, world frame, m.
    pub at_world: Vec3,
    /// m.
    pub radius: f64,
}

/// A bit for each voxel, a row along x being one word.
type Bits = Box<[u128; ROW_COUNT]>;

/// A voxel's edge in steps of whole numbers.
const FINE: f32 = (1 << FINE_BITS) as f32;
/// Its bits; those above them hold a place in the grid.
const FINE_BITS: u32 = 16;

fn margin(config: &ObstaclesConfig) -> [f32; 2] {
    [config.depth_margin_m, config.depth_margin_per_m].map(|x| x as f32)
}

/// The grid.
#[derive(Clone, Debug)]
pub struct Obstacles {
    blocks: Blocks,
    /// Nothing farther is remembered, m along the optical axis.
    range: f32,
    /// Looking through ends so far before the depth, m and 1/m.
    margin: [f32; 2],
    /// m.
    body: f32,
    /// Lowest voxel; none: nothing was seen.
    low: Option<Voxel>,
    evidence: Vec<i8>,
    /// Where the evidence suffices.
    occupied: Bits,
    /// Where the evidence is the least: to look through such a voxel once more, as most are, changes nothing.
    free: Bits,
    /// This frame: in what voxels its rays end, and through which they pass. Each voxel learns once a frame.
    ended: Bits,
    passed: Bits,
    /// What came to be where the vehicle had looked through: it may move.
    moved: Bits,
    /// This frame's points of such voxels.
    new: Fresh,
    followed: Followed,
    /// Where the newest image was taken, and how it looked.
    camera: (Vec3, Rot),
}

impl Obstacles {
    /// Seen through a camera of these fields of view, rad, and remembered within `range`, m; 0: nothing is.
    #[must_use]
    pub fn new(hfov: f64, vfov: f64, range: f64, config: &ObstaclesConfig, movers: MoversConfig) -> Self {
        Self {
            blocks: Blocks::new(hfov, vfov),
            range: range as f32,
            margin: margin(config),
            body: config.body_radius_m as f32,
            low: None,
            evidence: vec![0; VOXELS],
            occupied: Box::new([0; ROW_COUNT]),
            free: Box::new([0; ROW_COUNT]),
            ended: Box::new([0; ROW_COUNT]),
            passed: Box::new([0; ROW_COUNT]),
            moved: Box::new([0; ROW_COUNT]),
            new: Fresh::new(BLOCKS * ROWS),
            followed: Followed::new(hfov, vfov, movers),
            camera: (Vec3::zeros(), Rot::identity()),
        }
    }

    /// The same grid, from here on by other rules. With a `range` of 0 nothing of it is left.
    pub(crate) fn with(self, range: f64, config: &ObstaclesConfig, movers: MoversConfig) -> Self {
        let mut grid = Self {
            range: range as f32,
            margin: margin(config),
            body: config.body_radius_m as f32,
            followed: self.followed.with(movers),
            ..self
        };
        if grid.range <= 0.0 {
            grid.reset();
        }
        grid
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.low = None;
        self.evidence.fill(0);
        self.occupied.fill(0);
        self.free.fill(0);
        self.moved.fill(0);
        self.followed.reset();
    }

    /// What moves, at the height `z` (m).
    #[must_use]
    pub fn movers(&self, z: f64) -> Movers {
        self.followed.movers(z)
    }

    /// Takes in what is seen from `cam_world` (m). Not finite: nothing is.
    pub fn see(
        &mut self,
        stamp: Time,
        (cam_world, world_from_cam): (&Vec3, &Rot),
        nearest: &Nearest,
        ignored: Option<&Ignored>,
    ) {
        if self.range <= 0.0 || !cam_world.iter().chain(world_from_cam.coords.iter()).all(|x| x.is_finite()) {
            return;
        }
        let low = self.roll(cam_world);
        let cam_from_world = world_from_cam.inverse();
        self.camera = (*cam_world, cam_from_world);
        self.new.clear();
        let lens = in_voxels(cam_world, &low);
        if !is_inside(&lens) {
            return;
        }
        let fine =
            Voxel::from_fn(|axis, _| (low[axis] & (SIZE[axis] - 1)) << FINE_BITS) + lens.map(|x| (x * FINE) as i32);
        let turn = world_from_cam.to_rotation_matrix().into_inner().map(|x| x as f32) / VOXEL as f32;
        let skipped = ignored.map(|cylinder| (in_voxels(&cylinder.at_world, &low), (cylinder.radius / VOXEL) as f32));
        let blocks = coarse(nearest);
        for (block, mm) in blocks.iter().enumerate().filter(|(_, mm)| **mm > 0) {
            let (ray, depth) = (turn * self.blocks.rays[block], f32::from(*mm) * 1e-3);
            let free = (depth - self.margin[0] - self.margin[1] * depth * depth).min(LOOKED);
            pass(&mut self.passed, &fine, &ray, free);
            let at = lens + ray * depth;
            let expected = skipped.is_some_and(|(axis, radius)| (at.x - axis.x).hypot(at.y - axis.y) < radius);
            if depth <= self.range && is_inside(&at) && !expected {
                let (row, bit) = place(&low, &at);
                self.moved[row] |= self.free[row] & bit;
                let level = (at.z - lens.z) * VOXEL as f32;
                let moves = self.moved[row] & bit != 0
                    && (LEVEL.0..LEVEL.1).contains(&level)
                    && !self.is_beside_fixed(row, bit);
                let place = (low.map(f64::from) + at.map(f64::from)) * VOXEL;
                if moves {
                    self.new.push([at.x as u8, at.y as u8], place);
                }
                // Who moves on leaves nothing to be remembered.
                if !(moves && self.followed.covers(&place)) {
                    self.ended[row] |= bit;
                }
            }
        }
        self.learn();
        let through = |at: &Vector2<f64>| {
            [BELOW, 0.0].iter().all(|up| {
                let line = cam_from_world * Vec3::new(at.x - cam_world.x, at.y - cam_world.y, *up);
                self.blocks.toward(&blocks, &line).is_some_and(|depth| depth > line.x + BEYOND)
            })
        };
        let is_target = |at: &Vector2<f64>| ignored.is_some_and(|c| (at - c.at_world.xy()).norm() < c.radius);
        let (free, moved) = (&self.free, &self.moved);
        let known = |at: &Vector2<f64>| {
            ABOUT.iter().any(|up| was_free((free, moved), &low, &Vec3::new(at.x, at.y, cam_world.z + up)))
        };
        self.followed.step(stamp, (cam_world, world_from_cam), (nearest, &mut self.new), is_target, through, known);
    }

    /// Something that does not move is in a voxel beside that of `bit` in `row`: what seems new there is its edge.
    fn is_beside_fixed(&self, row: usize, bit: u128) -> bool {
        let wide = bit | bit.rotate_left(1) | bit.rotate_right(1);
        let [_, along_y, along_z] = SIZE.map(|n| n as usize);
        let beside = |at: usize, by: usize, n: usize| (at + n + by - 1) & (n - 1);
        let (y, z) = (row % along_y, row / along_y);
        (0..9).any(|k| {
            let row = beside(z, k / 3, along_z) * along_y + beside(y, k % 3, along_y);
            self.occupied[row] & !self.moved[row] & wide != 0
        })
    }

    /// What the frame's rays say of the voxels.
    fn learn(&mut self) {
        for row in 0..ROW_COUNT {
            let (ended, passed) = (std::mem::take(&mut self.ended[row]), std::mem::take(&mut self.passed[row]));
            for bit in bits(ended) {
                self.change(row, bit, HIT);
            }
            for bit in bits(passed & !ended & !self.free[row]) {
                self.change(row, bit, -MISS);
            }
        }
    }

    fn change(&mut self, row: usize, bit: u32, change: i8) {
        let evidence = &mut self.evidence[128 * row + bit as usize];
        *evidence = (*evidence + change).clamp(LEAST, MOST);
        let set = |word: u128, on: bool| word & !(1 << bit) | u128::from(on) << bit;
        self.occupied[row] = set(self.occupied[row], *evidence >= OCCUPIED);
        self.free[row] = set(self.free[row], *evidence == LEAST);
    }

    /// The place is before the camera now: whoever comes there is seen to come.
    pub(crate) fn is_watched(&self, pos_world: &Vec3) -> bool {
        let from_cam = pos_world - self.camera.0;
        from_cam.norm() < AT_HAND || self.blocks.is_abreast(&(self.camera.1 * from_cam))
    }

    /// The place was looked through once.
    pub(crate) fn is_known(&self, pos_world: &Vec3) -> bool {
        self.low.is_some_and(|low| was_free((&self.free, &self.moved), &low, pos_world))
    }

    /// The occupied voxels, counted from the grid's lowest corner, which is returned (m), into `cells`.
    pub(crate) fn remembered(&self, cells: &mut Vec<[u8; 3]>) -> Option<Vec3> {
        cells.clear();
        let low = self.low?;
        for (y, z) in (0..SIZE[2]).flat_map(|z| (0..SIZE[1]).map(move |y| (y, z))) {
            let word = self.occupied[row_of(&(low + Voxel::new(0, y, z)))].rotate_right(bit_of(low.x));
            cells.extend(bits(word).map(|x| [x as u8, y as u8, z as u8]));
        }
        Some(low.map(f64::from) * VOXEL)
    }

    /// The room about a place. What was never seen counts as free.
    #[must_use]
    pub fn room(&self, pos_world: &Vec3) -> Room {
        let Some(low) = self.low else { return among(self.body, std::iter::empty()) };
        let at = in_voxels(pos_world, &low);
        let inner = at.map(|x| x as i32);
        let far = (f64::from(FARTHEST_ROOM) / VOXEL) as i32;
        let about = |axis: usize, by: i32| {
            inner[axis].saturating_sub(by).max(0)..=inner[axis].saturating_add(by).min(SIZE[axis] - 1)
        };
        let rows = about(2, 1).flat_map(|z| about(1, far).map(move |y| Voxel::new(0, y, z)));
        among(
            self.body,
            rows.map(|row| (row, self.occupied[row_of(&(low + row))])).filter(|(_, word)| *word != 0).flat_map(
                |(row, word)| {
                    about(0, far)
                        .filter(move |x| word & 1 << bit_of(low.x + x) != 0)
                        .map(move |x| (Vector2::new(x as f32 + 0.5, row.y as f32 + 0.5) - at.xy()) * VOXEL as f32)
                },
            ),
        )
    }

    /// Moves the grid so that `centre` is in its middle, and forgets what it leaves. Returns the lowest voxel.
    fn roll(&mut self, centre: &Vec3) -> Voxel {
        let low = centre.map(|x| ((x / VOXEL).floor() as i32).clamp(-FARTHEST, FARTHEST)) - Voxel::from(SIZE) / 2;
        let old = self.low.replace(low).unwrap_or(low);
        for axis in 0..3 {
            let moved = low[axis] - old[axis];
            // The planes that come in take the memory of those that go.
            let first = if moved > 0 { old[axis] + SIZE[axis] } else { low[axis] };
            for plane in first..first + moved.abs().min(SIZE[axis]) {
                self.forget_plane(axis, plane);
            }
        }
        low
    }

    fn forget_plane(&mut self, axis: usize, plane: i32) {
        let at = (plane & (SIZE[axis] - 1)) as usize;
        let [_, along_y, along_z] = SIZE.map(|n| n as usize);
        match axis {
            0 => (0..ROW_COUNT).for_each(|row| self.forget(row, 1 << at)),
            1 => (0..along_z).for_each(|z| self.forget(z * along_y + at, u128::MAX)),
            _ => (0..along_y).for_each(|y| self.forget(at * along_y + y, u128::MAX)),
        }
    }

    fn forget(&mut self, row: usize, gone: u128) {
        for bit in bits(gone) {
            self.evidence[128 * row + bit as usize] = 0;
        }
        self.occupied[row] &= !gone;
        self.free[row] &= !gone;
        self.moved[row] &= !gone;
    }
}

/// The bits that are set, from the lowest.
fn bits(mut word: u128) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        let bit = (word != 0).then(|| word.trailing_zeros())?;
        word &= word - 1;
        Some(bit)
    })
}

/// Marks the voxels that a ray (voxels for 1 m along the optical axis) passes on its first `free` m, but for the grid's
/// outermost. `lens`: [`FINE`] to a voxel. Whole numbers wrap as the grid does: nothing is converted or compared.
fn pass(passed: &mut Bits, lens: &Vector3<i32>, ray: &Vector3<f32>, free: f32) {
    let step = STEP / ray.norm();
    let within = (0..3).map(|axis| (SIZE[axis] / 2 - 1) as f32 / ray[axis].abs()).fold(free, f32::min);
    let advance = (ray * (step * FINE)).map(|x| x as i32);
    let mut at = *lens;
    for _ in 0..(within / step) as u32 {
        at += advance;
        let voxel = at.map(|x| x >> FINE_BITS);
        passed[row_of(&voxel)] |= 1 << bit_of(voxel.x);
    }
}

/// One looked through the place, whatever has come to be there since.
fn was_free((free, moved): (&Bits, &Bits), low: &Voxel, pos_world: &Vec3) -> bool {
    let at = in_voxels(pos_world, low);
    is_inside(&at) && {
        let (row, bit) = place(low, &at);
        (free[row] | moved[row]) & bit != 0
    }
}

/// Row and bit of the voxel that a point inside lies in.
fn place(low: &Voxel, at: &Vector3<f32>) -> (usize, u128) {
    let voxel = low + at.map(|x| x as i32);
    (row_of(&voxel), 1 << bit_of(voxel.x))
}

/// No voxel's index is larger: nobody flies farther than 200 km, and differences do not overflow.
const FARTHEST: i32 = 1_000_000;

/// A point, in voxels from `low`.
fn in_voxels(pos_world: &Vec3, low: &Voxel) -> Vector3<f32> {
    (pos_world / VOXEL - low.map(f64::from)).map(|x| x as f32)
}

fn is_inside(at: &Vector3<f32>) -> bool {
    (0..3).all(|axis| at[axis] >= 0.0 && at[axis] < SIZE[axis] as f32)
}

fn row_of(voxel: &Voxel) -> usize {
    let wrap = |axis: usize| (voxel[axis] & (SIZE[axis] - 1)) as usize;
    wrap(2) * SIZE[1] as usize + wrap(1)
}

fn bit_of(x: i32) -> u32 {
    (x & (SIZE[0] - 1)) as u32
}

#[cfg(test)]
mod tests;
