//! The front end: kinodynamic A* after Fast-Planner. States are positions and velocities, edges are short motions of
//! constant acceleration, so a path that is found can be flown from the state in which the vehicle is.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};

use goshawk_core::lead::cap;
use goshawk_core::types::{FlatState, Vec3};

use super::distance::DistanceField;
use super::map::{Knowledge, Map, voxel_of};

/// What is searched for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Query {
    /// Position and velocity at the beginning.
    pub start: FlatState,
    /// Where to go, m.
    pub goal_world: Vec3,
    /// Most speed, m/s.
    pub speed_mps: f64,
    /// Most horizontal acceleration, m/s².
    pub acc_mps2: f64,
    /// Least distance to an occupied voxel, m.
    pub clearance_m: f64,
}

/// One edge: constant acceleration for the path's step.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Leg {
    pos: Vec3,
    vel: Vec3,
    acc: Vec3,
}

/// A path that the vehicle can fly.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    legs: Vec<Leg>,
    step_s: f64,
    /// It ends at the goal; otherwise at the place nearest to it that could be reached.
    pub reached: bool,
}

impl Path {
    /// From its beginning to its end, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.legs.len() as f64 * self.step_s
    }

    /// Position at `t` seconds, m; after the end that of the end.
    #[must_use]
    pub fn at(&self, t: f64) -> Vec3 {
        let t = t.clamp(0.0, self.duration());
        let index = ((t / self.step_s) as usize).min(self.legs.len() - 1);
        let leg = &self.legs[index];
        moved(leg, t - index as f64 * self.step_s).0
    }

    /// Where it ends, m.
    #[must_use]
    pub fn end(&self) -> Vec3 {
        self.at(self.duration())
    }
}

/// Length of an edge at full speed, m, and bounds of its duration, s.
const EDGE_M: f64 = 1.6;
const STEP_S: [f64; 2] = [0.2, 0.5];
/// Accelerations tried along and across the way to the goal, of the most, and upward, m/s².
const LEVELS: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];
const CLIMBS_MPS2: [f64; 3] = [-2.0, 0.0, 2.0];
/// The vehicle may already be too near to something; over this much of its first way it may stay so, m.
const ESCAPE_M: f64 = 0.8;
/// Edges are checked at points this far apart, m.
const CHECK_M: f64 = 0.2;
/// States this near and of this like velocity (of the most) are one, m.
const SAME_M: f64 = 0.4;
const SAME_SPEED: f64 = 0.34;
/// Cost of a second of full acceleration, of a second at the least clearance (none from `COMFORT_M` more on), of a second
/// through the unknown, and of a second one metre off the goal's height, all in seconds.
const EFFORT: f64 = 0.25;
const NEARNESS: f64 = 1.5;
const COMFORT_M: f64 = 0.6;
const UNKNOWN: f64 = 0.2;
const OFF_HEIGHT: f64 = 0.4;
/// Not lower than this below the goal's height, nor higher than this above it, m.
const LOWER_M: f64 = 0.8;
const HIGHER_M: f64 = 1.5;
/// The heuristic's weight: a little greedy.
const GREED: f64 = 1.2;
/// States that are expanded at most: bounds the time it takes.
const EXPANSIONS: usize = 1200;
/// A path that does not reach the goal must lead at least this much nearer to it, m.
const PROGRESS_M: f64 = 0.5;

#[derive(Clone, Copy, Debug)]
struct Node {
    pos: Vec3,
    vel: Vec3,
    cost: f64,
    /// The node before, and the acceleration from it.
    from: Option<(usize, Vec3)>,
    closed: bool,
}

/// An open node; the heap's greatest is the cheapest, of equals the first made.
#[derive(Clone, Copy, Debug)]
struct Open {
    estimate: f64,
    node: usize,
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Open {}
impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        other.estimate.total_cmp(&self.estimate).then(other.node.cmp(&self.node))
    }
}

fn moved(leg: &Leg, t: f64) -> (Vec3, Vec3) {
    (leg.pos + leg.vel * t + leg.acc * (0.5 * t * t), leg.vel + leg.acc * t)
}

/// Searches the map. None: enclosed, no way leads nearer to the goal.
#[must_use]
pub fn search(query: &Query, map: &Map, field: &DistanceField) -> Option<Path> {
    Search::new(query, map, field).run()
}

struct Search<'a> {
    query: &'a Query,
    map: &'a Map,
    field: &'a DistanceField,
    step_s: f64,
    accelerations: Vec<Vec3>,
    nodes: Vec<Node>,
    known: HashMap<[i32; 6], usize>,
    open: BinaryHeap<Open>,
}

impl<'a> Search<'a> {
    fn new(query: &'a Query, map: &'a Map, field: &'a DistanceField) -> Self {
        let ahead = query.goal_world - query.start.pos;
        let ahead = Vec3::new(ahead.x, ahead.y, 0.0).try_normalize(1e-6).unwrap_or(Vec3::x());
        let across = Vec3::new(-ahead.y, ahead.x, 0.0);
        let mut accelerations = Vec::new();
        for (along, side) in LEVELS.iter().flat_map(|a| LEVELS.iter().map(move |b| (*a, *b))) {
            if f64::hypot(along, side) <= 1.2 {
                let flat = (ahead * along + across * side) * query.acc_mps2;
                accelerations.extend(CLIMBS_MPS2.map(|climb| flat + Vec3::z() * climb));
            }
        }
        let step_s = (EDGE_M / query.speed_mps).clamp(STEP_S[0], STEP_S[1]);
        Self {
            query,
            map,
            field,
            step_s,
            accelerations,
            nodes: Vec::new(),
            known: HashMap::new(),
            open: BinaryHeap::new(),
        }
    }

    fn run(mut self) -> Option<Path> {
        let start = &self.query.start;
        self.reach(Node { pos: start.pos, vel: start.vel, cost: 0.0, from: None, closed: false });
        let begun = (self.query.goal_world - start.pos).norm();
        // Half an edge: a goal between two ends is reached.
        let near = 0.6 * self.step_s * self.query.speed_mps;
        let (mut best, mut best_distance) = (None, begun - PROGRESS_M);
        for _ in 0..EXPANSIONS {
            let Some(index) = self.cheapest() else { break };
            let node = self.nodes[index];
            let distance = (self.query.goal_world - node.pos).norm();
            if distance < near && node.from.is_some() {
                return Some(self.path(index, true));
            }
            if distance < best_distance {
                (best, best_distance) = (Some(index), distance);
            }
            self.expand(index);
        }
        best.map(|index| self.path(index, false))
    }

    fn cheapest(&mut self) -> Option<usize> {
        while let Some(Open { node, .. }) = self.open.pop() {
            if !std::mem::replace(&mut self.nodes[node].closed, true) {
                return Some(node);
            }
        }
        None
    }

    fn expand(&mut self, index: usize) {
        let from = self.nodes[index];
        let most = self.query.speed_mps.max(from.vel.norm() - self.query.acc_mps2 * self.step_s);
        for k in 0..self.accelerations.len() {
            // What would become too fast becomes just as fast as is allowed.
            let vel = cap(from.vel + self.accelerations[k] * self.step_s, most);
            let acc = (vel - from.vel) / self.step_s;
            let leg = Leg { pos: from.pos, vel: from.vel, acc };
            let (pos, vel) = moved(&leg, self.step_s);
            if let Some(cost) = self.cost(&leg) {
                self.reach(Node { pos, vel, cost: from.cost + cost, from: Some((index, acc)), closed: false });
            }
        }
    }

    /// Cost of an edge; none: it is not free.
    fn cost(&self, leg: &Leg) -> Option<f64> {
        let query = self.query;
        let end = moved(leg, self.step_s).0;
        let checks = ((end - leg.pos).norm() / CHECK_M).ceil().max(1.0);
        let mut rate = 1.0 + EFFORT * (leg.acc.norm() / query.acc_mps2).powi(2);
        for k in 1..=checks as usize {
            let at = moved(leg, self.step_s * k as f64 / checks).0;
            let rise = at.z - query.goal_world.z;
            let spare = self.field.coarse(&at) - query.clearance_m;
            let escapes = (at - query.start.pos).norm() < ESCAPE_M;
            let bound = (-LOWER_M..=HIGHER_M).contains(&rise);
            if !escapes && (spare < 0.0 || !bound) {
                return None;
            }
            let near = (1.0 - spare / COMFORT_M).clamp(0.0, 2.0);
            let unknown = self.map.knowledge(&voxel_of(&at)) == Knowledge::Unknown;
            let extra = NEARNESS * near * near + if unknown { UNKNOWN } else { 0.0 } + OFF_HEIGHT * rise.abs();
            rate += extra / checks;
        }
        Some(rate * self.step_s)
    }

    /// Takes a state in, unless a cheaper one like it is known.
    fn reach(&mut self, node: Node) {
        let like = SAME_SPEED * self.query.speed_mps;
        let at = (node.pos / SAME_M).map(|x| x.floor() as i32);
        let vel = (node.vel / like).map(|x| x.round() as i32);
        let index = self.nodes.len();
        let estimate =
            node.cost + GREED * (self.query.goal_world - node.pos).norm() / self.query.speed_mps.max(node.vel.norm());
        match self.known.entry([at.x, at.y, at.z, vel.x, vel.y, vel.z]) {
            std::collections::hash_map::Entry::Occupied(mut entry) => {
                let other = &self.nodes[*entry.get()];
                if other.closed || other.cost <= node.cost {
                    return;
                }
                entry.insert(index);
            }
            std::collections::hash_map::Entry::Vacant(entry) => {
                entry.insert(index);
            }
        }
        self.nodes.push(node);
        self.open.push(Open { estimate, node: index });
    }

    fn path(&self, end: usize, reached: bool) -> Path {
        let mut legs = Vec::new();
        let mut node = &self.nodes[end];
        while let Some((from, acc)) = node.from {
            node = &self.nodes[from];
            legs.push(Leg { pos: node.pos, vel: node.vel, acc });
        }
        legs.reverse();
        Path { legs, step_s: self.step_s, reached }
    }
}
