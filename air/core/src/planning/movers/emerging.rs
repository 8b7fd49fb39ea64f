//! What comes to be where the vehicle had looked through: near by, and however little of it is in the image.

use crate::planning::movers::track::{Track, advance, nearest};
use crate::planning::movers::{MOST, Mover, MoversConfig};
use crate::values::types::{Flat, Time, Vec3};
use nalgebra::Matrix2;

/// A new point is followed together with others within so many cells: as many as the grid is wide.
const CELLS: usize = 128;
/// Fewer points are noise. Chosen by eye.
const LEAST_POINTS: usize = 3;
/// More than so many groups in a frame are not looked at. Chosen by eye.
const MOST_GROUPS: usize = 16;
/// From the middle of what is seen, its surface, to the axis, m. Chosen by eye.
const BEHIND: f64 = 0.1;
/// Standard deviation of a group's middle, m. Chosen by eye.
const SIGHTING: f64 = 0.15;
/// White noise of a mover's acceleration, m²/s³. Chosen by eye.
const RESTLESS: f64 = 2.0;
/// A group belongs to what should be within this, m. Chosen by eye.
const GATE: f64 = 0.7;

/// What has come to be where nothing was, in one frame, seen from above: points in cells of a grid.
#[derive(Clone, Debug)]
pub(crate) struct Fresh {
    /// Where (m) and in which cell.
    points: Vec<([u8; 2], Vec3)>,
    /// A bit for each cell with a point.
    cells: [u128; CELLS],
}

impl Fresh {
    pub(crate) fn new(most: usize) -> Self {
        Self { points: Vec::with_capacity(most), cells: [0; CELLS] }
    }

    pub(crate) fn clear(&mut self) {
        self.points.clear();
        self.cells = [0; CELLS];
    }

    /// A point at `at_world` in a cell of the grid, counted from its lowest.
    pub(crate) fn push(&mut self, [x, y]: [u8; 2], at_world: Vec3) {
        if self.points.len() < self.points.capacity() && usize::from(x.max(y)) < CELLS {
            self.points.push(([x, y], at_world));
            self.cells[usize::from(y)] |= 1 << x;
        }
    }

    /// Takes a group of cells that touch, corners and one cell between included; none: nothing is left.
    fn take_group(&mut self) -> Option<[u128; CELLS]> {
        let first = self.cells.iter().position(|row| *row != 0)?;
        let mut group = [0_u128; CELLS];
        group[first] = 1 << self.cells[first].trailing_zeros();
        loop {
            let mut grown = group;
            for (y, row) in grown.iter_mut().enumerate() {
                let about = y.saturating_sub(2)..=(y + 2).min(CELLS - 1);
                let near = group[about].iter().fold(0, |bits, row| bits | row);
                *row |= self.cells[y] & (near | near << 1 | near >> 1 | near << 2 | near >> 2);
            }
            if grown == group {
                break;
            }
            group = grown;
        }
        self.cells.iter_mut().zip(&group).for_each(|(left, taken)| *left &= !taken);
        Some(group)
    }
}

/// Points that lie together.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Group {
    middle: Flat,
    radius: f64,
}

/// Follows what emerges.
#[derive(Clone, Debug)]
pub(crate) struct Emerging {
    config: MoversConfig,
    tracks: [Option<Track>; MOST],
}

impl Emerging {
    pub(crate) fn new(config: MoversConfig) -> Self {
        Self { config, tracks: [None; MOST] }
    }

    /// The same tracks, from here on by other rules.
    pub(crate) fn with(self, config: MoversConfig) -> Self {
        Self { config, ..self }
    }

    pub(crate) fn reset(&mut self) {
        self.tracks = [None; MOST];
    }

    /// Takes in what is new in a frame, seen from `cam_world`. `through`: one looks through a place.
    pub(crate) fn step(&mut self, stamp: Time, cam_world: &Vec3, new: &mut Fresh, through: &impl Fn(&Flat) -> bool) {
        advance(&mut self.tracks, stamp, RESTLESS, through);
        let mut taken = [false; MOST];
        for _ in 0..MOST_GROUPS {
            let Some(cells) = new.take_group() else { break };
            if let Some(group) = group(&self.config, &cells, &new.points, &cam_world.xy()) {
                self.see(stamp, &group, &mut taken);
            }
        }
    }

    /// A group belongs to the nearest track, or begins one.
    fn see(&mut self, stamp: Time, group: &Group, taken: &mut [bool; MOST]) {
        let noise = Matrix2::from_diagonal_element(SIGHTING * SIGHTING);
        let Some((slot, within)) = nearest(&self.tracks, taken, &group.middle, GATE) else { return };
        if within && let Some(track) = &mut self.tracks[slot] {
            track.correct(group.middle, &noise);
            track.show(group.radius);
            track.moves |= track.has_gone(self.config.min_speed_mps);
            taken[slot] = true;
        } else if let Some(slot) = self.tracks.iter().position(Option::is_none) {
            self.tracks[slot] = Some(Track::new(stamp, group.middle, group.radius, &noise));
            taken[slot] = true;
        }
    }

    pub(crate) fn covers(&self, at_world: &Vec3) -> bool {
        self.tracks.iter().flatten().any(|track| track.covers(at_world))
    }

    /// Those that move, at the height `z` (m).
    pub(crate) fn movers(&self, z: f64) -> impl Iterator<Item = Mover> {
        self.tracks.iter().flatten().filter_map(move |track| track.mover(z))
    }
}

fn group(config: &MoversConfig, cells: &[u128; CELLS], points: &[([u8; 2], Vec3)], cam: &Flat) -> Option<Group> {
    let within = || points.iter().filter(|([x, y], _)| cells[usize::from(*y)] >> x & 1 == 1).map(|(_, at)| at);
    let count = within().count();
    let (low, high) = within().fold((f64::MAX, f64::MIN), |(low, high), at| (low.min(at.z), high.max(at.z)));
    if count < LEAST_POINTS || high - low < config.min_height_m {
        return None;
    }
    let surface = within().fold(Flat::zeros(), |sum, at| sum + at.xy()) / count as f64;
    let away = (surface - cam).try_normalize(1e-3).unwrap_or_default();
    let spread = within().map(|at| (at.xy() - surface).norm()).fold(0.0, f64::max);
    let [least, most] = config.radius_m;
    Some(Group { middle: surface + away * BEHIND, radius: spread.clamp(least, most) })
}
