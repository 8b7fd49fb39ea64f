//! The floor plan: rooms by recursive splitting, walls with openings.

use rand::{Rng, RngExt};

/// Narrower rooms are not split, m.
const ROOM_MIN_M: f64 = 3.6;
/// Wider rooms always are, m.
const ROOM_MAX_M: f64 = 9.5;
/// Walls keep this far from the edge of a doorway, or of a window, in a wall that they meet, m.
const DOOR_KEEP_M: f64 = 0.7;
const WINDOW_KEEP_M: f64 = 0.2;

/// A rectangle, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rect {
    pub(super) min: [f64; 2],
    pub(super) max: [f64; 2],
}

impl Rect {
    pub(super) fn size(&self, axis: usize) -> f64 {
        self.max[axis] - self.min[axis]
    }

    pub(super) fn contains(&self, x: f64, y: f64) -> bool {
        (self.min[0]..=self.max[0]).contains(&x) && (self.min[1]..=self.max[1]).contains(&y)
    }

    pub(super) fn grown(&self, by: f64) -> Self {
        Self { min: self.min.map(|c| c - by), max: self.max.map(|c| c + by) }
    }

    pub(super) fn cut(&self, axis: usize, at: f64) -> (Self, Self) {
        let (mut low, mut high) = (*self, *self);
        (low.max[axis], high.min[axis]) = (at, at);
        (low, high)
    }
}

/// A doorway or a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Opening {
    /// Its middle along the wall, m.
    pub(super) at: f64,
    pub(super) half_m: f64,
    /// Its lower and upper edge above the floor, m; a doorway's sill is below it.
    pub(super) sill_m: f64,
    pub(super) head_m: f64,
}

impl Opening {
    pub(super) fn is_door(&self) -> bool {
        self.sill_m <= 0.0
    }
}

/// A wall along one axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Wall {
    /// 0: it runs along x; 1: along y.
    pub(super) axis: usize,
    /// Its coordinate on the other axis, m.
    pub(super) line: f64,
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) openings: Vec<Opening>,
}

impl Wall {
    fn new(axis: usize, line: f64, from: f64, to: f64) -> Self {
        Self { axis, line, from, to, openings: Vec::new() }
    }

    /// Adds an opening where there is room; whether there was.
    fn open<R: Rng>(&mut self, half_m: f64, heights: (f64, f64), rng: &mut R) -> bool {
        let (low, high) = (self.from + half_m + 0.5, self.to - half_m - 0.5);
        for _ in 0..12 {
            if low >= high {
                return false;
            }
            let at = rng.random_range(low..high);
            if self.openings.iter().all(|o| (o.at - at).abs() > o.half_m + half_m + 0.5) {
                self.openings.push(Opening { at, half_m, sill_m: heights.0, head_m: heights.1 });
                return true;
            }
        }
        false
    }

    fn door<R: Rng>(&mut self, rng: &mut R) -> bool {
        let half = rng.random_range(0.75..1.15);
        self.open(half, (-0.2, rng.random_range(2.15..2.6)), rng)
    }
}

/// A room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Room {
    pub(super) rect: Rect,
    /// Long and narrow: nothing stands in it.
    pub(super) corridor: bool,
}

/// Rooms and the walls between them.
#[derive(Clone, Debug, Default)]
pub(super) struct FloorPlan {
    pub(super) rooms: Vec<Room>,
    pub(super) walls: Vec<Wall>,
}

impl FloorPlan {
    /// Splits `house` into rooms. Each side has a doorway or two, and windows.
    pub(super) fn draw<R: Rng>(house: Rect, rng: &mut R) -> Self {
        let mut plan = Self::default();
        for (axis, side) in [(1, 0), (1, 1), (0, 0), (0, 1)] {
            let line = if side == 0 { house.min[1 - axis] } else { house.max[1 - axis] };
            let mut wall = Wall::new(axis, line, house.min[axis], house.max[axis]);
            for _ in 0..if house.size(axis) > 12.0 { 2 } else { 1 } {
                wall.door(rng);
            }
            for _ in 0..rng.random_range(0..=3) {
                wall.open(rng.random_range(0.5..1.2), (rng.random_range(0.8..1.1), rng.random_range(1.9..2.4)), rng);
            }
            plan.walls.push(wall);
        }
        plan.split(Room { rect: house, corridor: false }, rng);
        plan
    }

    fn split<R: Rng>(&mut self, room: Room, rng: &mut R) {
        let rect = room.rect;
        let axis = usize::from(rect.size(1) > rect.size(0) * rng.random_range(0.8..1.25));
        let small = rect.size(0).max(rect.size(1)) < ROOM_MAX_M && rng.random_bool(0.35);
        let corridor = if rect.size(axis) > 12.0 && rng.random_bool(0.45) { rng.random_range(2.2..3.0) } else { 0.0 };
        // Across its longer side if that can be, else across the other.
        let place = [(axis, corridor), (1 - axis, 0.0)]
            .into_iter()
            .find_map(|(axis, corridor)| self.place(&rect, axis, corridor, rng).map(|at| (axis, at, corridor)));
        let Some((axis, at, corridor)) = place.filter(|_| !room.corridor && !small) else {
            self.rooms.push(room);
            return;
        };
        let (low, rest) = rect.cut(axis, at);
        self.divide(&rect, axis, at, rng);
        self.split(Room { rect: low, corridor: false }, rng);
        if corridor > 0.0 {
            let (between, high) = rest.cut(axis, at + corridor);
            self.divide(&rect, axis, at + corridor, rng);
            self.rooms.push(Room { rect: between, corridor: true });
            self.split(Room { rect: high, corridor: false }, rng);
        } else {
            self.split(Room { rect: rest, corridor: false }, rng);
        }
    }

    /// Where along `axis` to cut; none: nowhere is room for two rooms with a corridor between them.
    fn place<R: Rng>(&self, rect: &Rect, axis: usize, corridor: f64, rng: &mut R) -> Option<f64> {
        let (low, high) = (rect.min[axis] + ROOM_MIN_M, rect.max[axis] - ROOM_MIN_M - corridor);
        (0..40)
            .filter(|_| low < high)
            .map(|_| rng.random_range(low..high))
            .find(|at| self.meets_no_door(rect, axis, *at) && self.meets_no_door(rect, axis, at + corridor))
    }

    /// A wall across `rect` at a coordinate of `axis`, with one doorway, long ones with two.
    fn divide<R: Rng>(&mut self, rect: &Rect, axis: usize, at: f64, rng: &mut R) {
        let mut wall = Wall::new(1 - axis, at, rect.min[1 - axis], rect.max[1 - axis]);
        let doors = if rect.size(1 - axis) > 9.0 { 2 } else { 1 };
        for _ in 0..doors {
            wall.door(rng);
        }
        self.walls.push(wall);
    }

    /// Whether a wall at a coordinate of `axis` ends beside, not in, the doorways of the walls that bound `rect`.
    fn meets_no_door(&self, rect: &Rect, axis: usize, at: f64) -> bool {
        self.walls.iter().filter(|w| w.axis == axis).all(|wall| {
            let bounds = [rect.min[1 - axis], rect.max[1 - axis]].iter().any(|c| (c - wall.line).abs() < 1e-6);
            let keep = |o: &Opening| o.half_m + if o.is_door() { DOOR_KEEP_M } else { WINDOW_KEEP_M };
            !bounds || wall.openings.iter().all(|o| (o.at - at).abs() > keep(o))
        })
    }

    /// The doorways' middles, m.
    pub(super) fn doorways(&self) -> impl Iterator<Item = [f64; 2]> {
        self.walls.iter().flat_map(|wall| {
            wall.openings.iter().filter(|o| o.is_door()).map(move |o| {
                let mut at = [wall.line; 2];
                at[wall.axis] = o.at;
                at
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn every_room_is_reached_from_outside_through_doorways() {
        let mut rooms = 0;
        for seed in 0..40 {
            let house = Rect { min: [15.0, -10.0], max: [39.0, 10.0] };
            let plan = FloorPlan::draw(house, &mut ChaCha8Rng::seed_from_u64(seed));
            rooms += plan.rooms.len();
            let room_at = |x: f64, y: f64| plan.rooms.iter().position(|r| r.rect.contains(x, y));
            let mut reached = vec![false; plan.rooms.len()];
            for _ in 0..plan.rooms.len() {
                for wall in &plan.walls {
                    for door in wall.openings.iter().filter(|o| o.is_door()) {
                        let side = |across: f64| {
                            let mut at = [wall.line + across; 2];
                            at[wall.axis] = door.at;
                            room_at(at[0], at[1])
                        };
                        match (side(-0.3), side(0.3)) {
                            (Some(a), Some(b)) => {
                                let both = reached[a] || reached[b];
                                (reached[a], reached[b]) = (both, both);
                            }
                            (Some(only), None) | (None, Some(only)) => reached[only] = true,
                            (None, None) => panic!("seed {seed}: a door between nothing"),
                        }
                    }
                }
            }
            assert!(reached.iter().all(|r| *r), "seed {seed}: a closed room");
        }
        assert!(rooms > 40 * 4, "{rooms} rooms in 40 houses");
    }
}
