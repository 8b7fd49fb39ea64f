//! What a person can run through: distance to the nearest obstacle between knee and head, on a grid filled as it is
//! asked for, and the shortest comfortable way over it.

use std::cell::RefCell;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

use goshawk_core::Vec3;

use crate::world::World;

/// A point on the ground plane, m.
pub(super) type Point = nalgebra::Vector2<f64>;

/// Heights above the ground between which an evader's body must keep clear, m.
const BODY_LOW_M: f64 = 0.3;
const BODY_HIGH_M: f64 = 1.7;
/// Clearances beyond this are all alike, m.
const CAP_M: f64 = 1.5;
const CELL_M: f64 = 0.25;
/// Above this clearance a way is comfortable, m.
const COMFORT_M: f64 = 1.1;

/// Distance from the upright segment over (x, y) to the nearest obstacle, m, capped; within 0.01 m.
pub(super) fn column_clearance(world: &World, at: &Point) -> f64 {
    let ground = world.ground_height(at.x, at.y);
    let at_height = |h: f64| world.clearance(&Vec3::new(at.x, at.y, ground + h));
    let middle = 0.5 * (BODY_LOW_M + BODY_HIGH_M);
    let half = 0.5 * (BODY_HIGH_M - BODY_LOW_M);
    let first = at_height(middle);
    // Clearance changes by at most a metre a metre.
    if first - half > CAP_M {
        return CAP_M;
    }
    let mut least = first;
    for i in 1..=4 {
        let offset = half * f64::from(i) / 4.0;
        if first - offset < least {
            least = least.min(at_height(middle + offset)).min(at_height(middle - offset));
        }
    }
    least.min(CAP_M)
}

/// The grid over a world.
pub(super) struct Field<'a> {
    world: &'a World,
    columns: usize,
    rows: usize,
    /// NaN: not asked for yet.
    cells: RefCell<Vec<f32>>,
}

impl<'a> Field<'a> {
    pub(super) fn new(world: &'a World) -> Self {
        let extent = world.max_world() - world.min_world();
        let columns = (extent.x / CELL_M) as usize + 1;
        let rows = (extent.y / CELL_M) as usize + 1;
        Self { world, columns, rows, cells: RefCell::new(vec![f32::NAN; columns * rows]) }
    }

    fn centre(&self, cell: usize) -> Point {
        let min = self.world.min_world();
        Point::new(min.x + (cell % self.columns) as f64 * CELL_M, min.y + (cell / self.columns) as f64 * CELL_M)
    }

    fn cell_at(&self, at: &Point) -> Option<usize> {
        let min = self.world.min_world();
        let (column, row) = (((at.x - min.x) / CELL_M).round(), ((at.y - min.y) / CELL_M).round());
        let inside = column >= 0.0 && row >= 0.0 && column < self.columns as f64 && row < self.rows as f64;
        inside.then(|| row as usize * self.columns + column as usize)
    }

    fn cell_clearance(&self, cell: usize) -> f64 {
        let known = self.cells.borrow()[cell];
        if !known.is_nan() {
            return f64::from(known);
        }
        let fresh = column_clearance(self.world, &self.centre(cell));
        self.cells.borrow_mut()[cell] = fresh as f32;
        fresh
    }

    /// Clearance, interpolated; 0 outside the world.
    pub(super) fn clearance(&self, at: &Point) -> f64 {
        let min = self.world.min_world();
        let (x, y) = ((at.x - min.x) / CELL_M, (at.y - min.y) / CELL_M);
        if x < 0.0 || y < 0.0 || x >= (self.columns - 1) as f64 || y >= (self.rows - 1) as f64 {
            return 0.0;
        }
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f64, y - row as f64);
        let cell = row * self.columns + column;
        let low = self.cell_clearance(cell) * (1.0 - fx) + self.cell_clearance(cell + 1) * fx;
        let high =
            self.cell_clearance(cell + self.columns) * (1.0 - fx) + self.cell_clearance(cell + self.columns + 1) * fx;
        low * (1.0 - fy) + high * fy
    }

    /// Direction in which clearance grows, not normalised.
    pub(super) fn gradient(&self, at: &Point) -> Point {
        let h = 0.5 * CELL_M;
        let slope = |d: Point| (self.clearance(&(at + d)) - self.clearance(&(at - d))) / (2.0 * h);
        Point::new(slope(Point::new(h, 0.0)), slope(Point::new(0.0, h)))
    }

    /// The comfortable way between two points through cells of at least `margin_m`, straightened; none if there is no
    /// way, or an end is not free.
    pub(super) fn way(&self, from: &Point, to: &Point, margin_m: f64) -> Option<Vec<Point>> {
        let (start, goal) = (self.cell_at(from)?, self.cell_at(to)?);
        if self.cell_clearance(goal) < margin_m {
            return None;
        }
        let cells = self.search(start, goal, margin_m)?;
        let mut points = vec![*from];
        points.extend(cells.iter().skip(1).map(|&c| self.centre(c)));
        points.push(*to);
        Some(self.straighten(&points, margin_m))
    }

    /// A* over eight neighbours; cells close to obstacles cost more.
    fn search(&self, start: usize, goal: usize, margin_m: f64) -> Option<Vec<usize>> {
        let count = self.columns * self.rows;
        let mut cost = vec![f64::INFINITY; count];
        let mut parent = vec![usize::MAX; count];
        let mut open = BinaryHeap::new();
        let goal_at = self.centre(goal);
        cost[start] = 0.0;
        open.push(Open { estimate: 0.0, cell: start });
        while let Some(Open { estimate, cell }) = open.pop() {
            if cell == goal {
                let mut path = vec![goal];
                while let Some(&last) = path.last().filter(|&&c| c != start) {
                    path.push(parent[last]);
                }
                path.reverse();
                return Some(path);
            }
            let here = self.centre(cell);
            if estimate > cost[cell] + (goal_at - here).norm() + 1e-9 {
                continue; // reached more cheaply since
            }
            let (column, row) = ((cell % self.columns) as i64, (cell / self.columns) as i64);
            for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)] {
                let (c, r) = (column + dx, row + dy);
                if c < 0 || r < 0 || c >= self.columns as i64 || r >= self.rows as i64 {
                    continue;
                }
                let next = r as usize * self.columns + c as usize;
                let clearance = self.cell_clearance(next);
                if clearance < margin_m {
                    continue;
                }
                let discomfort = ((COMFORT_M - clearance) / (COMFORT_M - margin_m)).max(0.0);
                let length = CELL_M * ((dx * dx + dy * dy) as f64).sqrt();
                let total = cost[cell] + length * (1.0 + 1.5 * discomfort * discomfort);
                if total < cost[next] {
                    cost[next] = total;
                    parent[next] = cell;
                    open.push(Open { estimate: total + (goal_at - self.centre(next)).norm(), cell: next });
                }
            }
        }
        None
    }

    /// Leaves out the corners that can be left out without coming closer to anything than the way did.
    fn straighten(&self, points: &[Point], margin_m: f64) -> Vec<Point> {
        let mut kept = vec![points[0]];
        let mut from = 0;
        while from + 1 < points.len() {
            let mut to = from + 1;
            // At most 8 m at once: longer shortcuts come close to too much.
            while to + 1 < points.len()
                && (points[to + 1] - points[from]).norm() < 8.0
                && self.least_between(&points[from], &points[to + 1])
                    >= margin_m.max(self.least_along(&points[from..=to + 1]).min(COMFORT_M) - 0.15)
            {
                to += 1;
            }
            kept.push(points[to]);
            from = to;
        }
        kept
    }

    fn least_along(&self, points: &[Point]) -> f64 {
        points.iter().skip(1).map(|p| self.clearance(p)).fold(f64::INFINITY, f64::min)
    }

    fn least_between(&self, from: &Point, to: &Point) -> f64 {
        let steps = ((to - from).norm() / (0.5 * CELL_M)).ceil().max(1.0) as usize;
        (1..=steps).map(|i| self.clearance(&from.lerp(to, i as f64 / steps as f64))).fold(f64::INFINITY, f64::min)
    }
}

/// A cell to be looked at; the heap gives the least estimate first, ties by cell.
#[derive(PartialEq)]
struct Open {
    estimate: f64,
    cell: usize,
}

impl Eq for Open {}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        other.estimate.total_cmp(&self.estimate).then(other.cell.cmp(&self.cell))
    }
}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
