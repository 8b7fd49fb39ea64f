//! A level scan out of an image: what stands or moves at the height of the flight, as things that lie apart.

use crate::planning::nearest::{COLUMNS, Nearest, ROWS};
use crate::values::types::{Flat, Rot, Vec3};
use nalgebra::Vector3;

/// Beams, equal in the tangent of their bearing: some more than the image's columns, of which a tilted camera shows
/// fewer across. Chosen by eye.
const BEAMS: usize = 192;
/// The tangent of the outermost one's bearing: 54 degrees. Chosen by eye.
const WIDE: f32 = 1.4;
/// Looked at from so far below the camera to so far above it, m. Chosen by eye.
const LEVEL: (f32, f32) = (-0.7, 0.6);
/// And no farther ahead than this, m: beyond, a post is narrower than two beams. Chosen by eye.
const FARTHEST: f32 = 14.0;
/// From beam to beam a thing's distance changes by no more than this, m, and this share. Chosen by eye.
const JUMP: (f32, f32) = (0.3, 0.03);
/// What is wider is no thing but a wall, m. Chosen by eye.
const WIDEST: f32 = 1.4;
/// Beside a thing apart one sees so much farther, m. Chosen by eye.
const CLEAR: f32 = 1.0;
/// A thing fills at least this share of its rows: leaves do not. Chosen by eye.
const SOLID: f64 = 0.75;
/// What is so near to a beam's distance is the same thing, m. Chosen by eye.
const SAME: f32 = 0.4;
/// So many beams that no column shows may lie between a thing's, and beside it. Chosen by eye.
const GAPS: usize = 2;
/// Stands for no beam.
const NONE: u8 = u8::MAX;

/// Something that lies apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Thing {
    /// The middle of what is seen of it, world frame, m.
    pub(crate) surface: Flat,
    /// Half its width, m.
    pub(crate) half: f64,
    /// It is seen as a whole: solid, and free on both sides.
    pub(crate) whole: bool,
}

/// Makes scans of a camera's images.
#[derive(Clone, Debug)]
pub(crate) struct Scan {
    /// Tangents of half the fields of view.
    half: [f32; 2],
    /// What is nearest at the flight's height, m along the heading; infinite: nothing; not a number: not looked at.
    beams: [f32; BEAMS],
    /// Of each beam the rows at that height and distance, and those in which it is.
    filled: [[u8; 2]; BEAMS],
    /// Of each point of the image its beam, m along the heading, and the rise of its line of sight.
    points: Box<[(u8, f32, f32); COLUMNS * ROWS]>,
    /// Where it was made, m.
    cam: Flat,
    /// And where the camera looked, 1 long.
    heading: Flat,
}

impl Scan {
    /// Of a camera of these fields of view, rad.
    pub(crate) fn new(hfov: f64, vfov: f64) -> Self {
        let half = [hfov, vfov].map(|fov| (fov / 2.0).tan() as f32);
        let points = Box::new([(NONE, 0.0, 0.0); COLUMNS * ROWS]);
        Self { half, beams: [f32::NAN; BEAMS], filled: [[0; 2]; BEAMS], points, cam: Flat::zeros(), heading: Flat::x() }
    }

    /// Takes in an image seen from `cam_world`.
    pub(crate) fn see(&mut self, (cam_world, world_from_cam): (&Vec3, &Rot), nearest: &Nearest) {
        self.beams = [f32::NAN; BEAMS];
        // Who looks straight up or down has no heading.
        let Some(heading) = (world_from_cam * Vec3::x()).xy().try_normalize(0.2) else { return };
        (self.cam, self.heading) = (cam_world.xy(), heading);
        self.look(&heading, world_from_cam, nearest);
    }

    /// Its things, from left to right.
    pub(crate) fn things(&self) -> impl Iterator<Item = Thing> {
        let left = Flat::new(-self.heading.y, self.heading.x);
        let mut at = 0;
        let groups = std::iter::from_fn(move || {
            let first = (at..BEAMS).find(|beam| self.beams[*beam].is_finite())?;
            let last = self.last_of(first);
            at = last + 1;
            Some((first, last))
        });
        groups.filter_map(|(first, last)| self.thing(first, last)).map(move |(forward, side, half, whole)| Thing {
            surface: self.cam + self.heading * forward + left * side,
            half,
            whole,
        })
    }

    /// One looks through a place: beside it, too, one sees farther by [`CLEAR`].
    pub(crate) fn is_through(&self, at: &Flat) -> bool {
        let line = at - self.cam;
        let (forward, side) = (line.dot(&self.heading) as f32, self.heading.perp(&line) as f32);
        let beam = (1.0 - side / forward / WIDE) * (0.5 * BEAMS as f32);
        if !(forward > 0.2 && (1.0..(BEAMS - 1) as f32).contains(&beam)) {
            return false;
        }
        let about = &self.beams[beam as usize - 1..=beam as usize + 1];
        about.iter().any(|now| !now.is_nan()) && !about.iter().any(|now| *now <= forward + CLEAR)
    }

    /// Fills the beams.
    fn look(&mut self, heading: &Flat, world_from_cam: &Rot, nearest: &Nearest) {
        let turn = world_from_cam.to_rotation_matrix().into_inner();
        let [along, left, up] = [0, 1, 2].map(|k| {
            let v = turn.column(k);
            let (ahead, aside) = (v.x * heading.x + v.y * heading.y, heading.x * v.y - heading.y * v.x);
            Vector3::new(ahead as f32, aside as f32, v.z as f32)
        });
        let middle = |k: usize, n: usize, half: f32| (1.0 - (2 * k + 1) as f32 / n as f32) * half;
        self.filled = [[0; 2]; BEAMS];
        let rows = nearest.chunks_exact(COLUMNS).zip(self.points.chunks_exact_mut(COLUMNS));
        for (row, (depths, points)) in rows.enumerate() {
            let begin = along + up * middle(row, ROWS, self.half[1]);
            for (column, (mm, point)) in depths.iter().zip(points).enumerate() {
                let ray = begin + left * middle(column, COLUMNS, self.half[0]);
                let per_forward = 1.0 / ray.x;
                let beam = (1.0 - ray.y * per_forward / WIDE) * (0.5 * BEAMS as f32);
                if *mm == 0 || ray.x < 0.2 || !(0.0..BEAMS as f32).contains(&beam) {
                    point.0 = NONE;
                    continue;
                }
                let (forward, rise) = (ray.x * f32::from(*mm) * 1e-3, ray.z * per_forward);
                *point = (beam as u8, forward, rise);
                let there = forward < FARTHEST && (LEVEL.0..LEVEL.1).contains(&(rise * forward));
                let beam = &mut self.beams[usize::from(point.0)];
                *beam = beam.min(if there { forward } else { f32::INFINITY });
            }
        }
        for (beam, forward, rise) in self.points.iter().filter(|(beam, ..)| *beam != NONE) {
            let (distance, [all, hit]) = (self.beams[usize::from(*beam)], &mut self.filled[usize::from(*beam)]);
            if distance.is_finite() && (LEVEL.0..LEVEL.1).contains(&(rise * distance)) {
                *all = all.saturating_add(1);
                *hit = hit.saturating_add(u8::from((forward - distance).abs() < SAME));
            }
        }
    }

    /// The last beam of the thing whose first one this is.
    fn last_of(&self, first: usize) -> usize {
        let mut last = first;
        for (next, now) in self.beams.iter().enumerate().skip(first + 1).filter(|(_, now)| now.is_finite()) {
            let here = self.beams[last];
            if next - last > GAPS || (now - here).abs() > JUMP.0 + JUMP.1 * here {
                break;
            }
            last = next;
        }
        last
    }

    /// Where the thing of these beams is ahead and to the left, m, half its width, m, and whether it is seen as a whole;
    /// none: it is a wall.
    fn thing(&self, first: usize, last: usize) -> Option<(f64, f64, f64, bool)> {
        let tangent = |beam: usize| (1.0 - (2 * beam + 1) as f32 / BEAMS as f32) * WIDE;
        let seen = || (first..=last).map(|beam| (tangent(beam), self.beams[beam])).filter(|(_, now)| now.is_finite());
        let count = seen().count() as f32;
        let forward = seen().map(|(_, now)| now).sum::<f32>() / count;
        let side = seen().map(|(tangent, now)| tangent * now).sum::<f32>() / count;
        let width = forward * (last + 1 - first) as f32 * (2.0 * WIDE / BEAMS as f32);
        if width > WIDEST {
            return None;
        }
        let looked = |beams: &[f32], edge: usize, from_right: bool| {
            let mut beams = beams.iter().copied().filter(|beam| !beam.is_nan());
            let beside = if from_right { beams.next_back() } else { beams.next() };
            beside.is_some_and(|beside| beside > self.beams[edge] + CLEAR)
        };
        let left = looked(&self.beams[first.saturating_sub(GAPS + 1)..first], first, true);
        let right = looked(&self.beams[last + 1..(last + GAPS + 2).min(BEAMS)], last, false);
        let sums = self.filled[first..=last]
            .iter()
            .fold([0.0; 2], |[all, hit], [a, h]| [all + f64::from(*a), hit + f64::from(*h)]);
        let whole = left && right && sums[1] > SOLID * sums[0];
        Some((f64::from(forward), f64::from(side), f64::from(0.5 * width), whole))
    }
}
