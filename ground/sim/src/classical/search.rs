//! The front end: kinodynamic A* after Fast-Planner. States are positions and velocities, edges are short motions of
//! constant acceleration, so a path that is found can be flown from the state in which the vehicle is.

use std::cmp::Ordering;
use std::collections::hash_map::Entry;
use std::collections::{BinaryHeap, HashMap};

use goshawk_core::values::geometry::cap;
use goshawk_core::{FlatState, Vec3};

use super::distance::DistanceField;
use super::guide::Guide;
use super::map::{Knowledge, Map};

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

/// One edge: constant acceleration for a while.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Leg {
    pos: Vec3,
    vel: Vec3,
    acc: Vec3,
    duration: f64,
}

impl Leg {
    fn at(&self, t: f64) -> Vec3 {
        self.pos + self.vel * t + self.acc * (0.5 * t * t)
    }

    fn end(&self) -> Vec3 {
        self.at(self.duration)
    }
}

/// A path that the vehicle can fly.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    legs: Vec<Leg>,
    /// It ends at the goal; otherwise at the place nearest to it that could be reached.
    pub reached: bool,
}

impl Path {
    /// From its beginning to its end, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.legs.iter().map(|leg| leg.duration).sum()
    }

    /// Position at `t` seconds, m; after the end that of the end.
    #[must_use]
    pub fn at(&self, t: f64) -> Vec3 {
        let mut left = t.max(0.0);
        for leg in &self.legs {
            if left <= leg.duration {
                return leg.at(left);
            }
            left -= leg.duration;
        }
        self.end()
    }

    /// Where it ends, m.
    #[must_use]
    pub fn end(&self) -> Vec3 {
        self.legs.last().map(Leg::end).expect("a path has an edge")
    }
}

/// Length of an edge at the speed of its beginning, m, and bounds of its duration, s.
const EDGE_M: f64 = 1.6;
const STEP_S: [f64; 2] = [0.2, 0.5];
/// Accelerations tried along and across the way to the goal, of the most; and upward, m/s², only beside the full ones.
const LEVELS: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];
const CLIMBS_MPS2: [f64; 2] = [-2.0, 2.0];
/// The vehicle may already be too near to something; over this much of its first way it may be as near as it is, m.
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
/// The heuristic's weight: greedy, because it leads around obstacles already.
const GREED: f64 = 1.8;
/// States that are expanded at most: bounds the time it takes.
const EXPANSIONS: usize = 500;
/// Where no way to the goal is known, it counts as this much farther, m.
const NO_WAY_M: f64 = 3.0;
/// A path that does not reach the goal must lead at least this much nearer to it, m.
const PROGRESS_M: f64 = 0.5;

#[derive(Clone, Copy, Debug)]
struct Node {
    pos: Vec3,
    vel: Vec3,
    cost: f64,
    /// The node before, and the edge from it.
    from: Option<(usize, Leg)>,
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

/// Searches the map. None: enclosed, no way leads nearer to the goal.
#[must_use]
pub fn search(query: &Query, map: &Map, field: &DistanceField) -> Option<Path> {
    Search::new(query, map, field).run()
}

struct Search<'a> {
    query: &'a Query,
    map: &'a Map,
    field: &'a DistanceField,
    guide: Guide,
    accelerations: Vec<Vec3>,
    /// Distance at the start, m.
    start_m: f64,
    nodes: Vec<Node>,
    /// The cheapest node of each class of like states.
    known: HashMap<[i16; 6], usize>,
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
                accelerations.push(flat);
                if along.fract() == 0.0 && side.fract() == 0.0 {
                    accelerations.extend(CLIMBS_MPS2.map(|climb| flat + Vec3::z() * climb));
                }
            }
        }
        let (nodes, known, open) = (Vec::new(), HashMap::new(), BinaryHeap::new());
        let guide = Guide::new(field, &query.start.pos, &query.goal_world);
        let start_m = field.coarse(&query.start.pos);
        Self { query, map, field, guide, accelerations, start_m, nodes, known, open }
    }

    fn run(mut self) -> Option<Path> {
        let start = &self.query.start;
        self.take(Node { pos: start.pos, vel: start.vel, cost: 0.0, from: None, closed: false });
        let begun = self.remaining(&start.pos);
        // Half the longest edge and a little: a goal between two ends is reached.
        let near = 0.6 * EDGE_M.max(STEP_S[0] * self.query.speed_mps);
        let (mut best, mut best_distance) = (None, begun - PROGRESS_M);
        for _ in 0..EXPANSIONS {
            let Some(index) = self.cheapest() else { break };
            let node = self.nodes[index];
            if (self.query.goal_world - node.pos).norm() < near && node.from.is_some() {
                return Some(self.path(index, true));
            }
            let distance = self.remaining(&node.pos);
            if distance < best_distance {
                (best, best_distance) = (Some(index), distance);
            }
            self.expand(index);
        }
        best.map(|index| self.path(index, false))
    }

    /// How far it is from a point to the goal, m.
    fn remaining(&self, from: &Vec3) -> f64 {
        let straight = (self.query.goal_world - from).norm();
        self.guide.remaining_m(from).map_or(straight + NO_WAY_M, |around| around.max(straight))
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
        let (query, speed) = (self.query, from.vel.norm());
        let duration = (EDGE_M / speed.max(1e-3)).clamp(STEP_S[0], STEP_S[1]);
        let most = query.speed_mps.max(speed - query.acc_mps2 * duration);
        for k in 0..self.accelerations.len() {
            // What would become too fast becomes just as fast as is allowed.
            let vel = cap(from.vel + self.accelerations[k] * duration, most);
            let leg = Leg { pos: from.pos, vel: from.vel, acc: (vel - from.vel) / duration, duration };
            // The least that it can cost, before its way is looked at.
            let node =
                Node { pos: leg.end(), vel, cost: from.cost + duration, from: Some((index, leg)), closed: false };
            if self.is_news(&node)
                && let Some(cost) = self.cost(&leg)
            {
                self.take(Node { cost: from.cost + cost, ..node });
            }
        }
    }

    /// Cost of an edge; none: it is not free.
    fn cost(&self, leg: &Leg) -> Option<f64> {
        let query = self.query;
        let checks = ((leg.end() - leg.pos).norm() / CHECK_M).ceil().max(1.0);
        let mut rate = 1.0 + EFFORT * (leg.acc.norm() / query.acc_mps2).powi(2);
        for k in 1..=checks as usize {
            let at = leg.at(leg.duration * k as f64 / checks);
            let rise = at.z - query.goal_world.z;
            let distance = self.field.coarse(&at);
            let spare = distance - query.clearance_m;
            let escapes = (at - query.start.pos).norm() < ESCAPE_M && distance >= self.start_m;
            let lower = (self.query.start.pos.z - query.goal_world.z).min(-LOWER_M);
            let higher = (self.query.start.pos.z - query.goal_world.z).max(HIGHER_M);
            if (spare < 0.0 && !escapes) || !(lower..=higher).contains(&rise) {
                return None;
            }
            let near = (1.0 - spare / COMFORT_M).clamp(0.0, 2.0);
            let unknown = self.map.knowledge(&at) == Knowledge::Unknown;
            let extra = NEARNESS * near * near + if unknown { UNKNOWN } else { 0.0 } + OFF_HEIGHT * rise.abs();
            rate += extra / checks;
        }
        Some(rate * leg.duration)
    }

    /// States of one class are as good as one.
    fn class(&self, node: &Node) -> [i16; 6] {
        let like = SAME_SPEED * self.query.speed_mps;
        // The fraction of a class is cut off the same way everywhere, as no index is below -500.
        let index = |x: f64| (x + 500.5) as i16;
        let (at, vel) = ((node.pos - self.query.start.pos) / SAME_M, node.vel / like);
        [index(at.x), index(at.y), index(at.z), index(vel.x), index(vel.y), index(vel.z)]
    }

    /// No state like it that is as cheap is known.
    fn is_news(&self, node: &Node) -> bool {
        self.known
            .get(&self.class(node))
            .map(|index| &self.nodes[*index])
            .is_none_or(|known| !known.closed && known.cost > node.cost)
    }

    /// Takes a state in, unless a cheaper one like it is known.
    fn take(&mut self, node: Node) {
        let query = self.query;
        let class = self.class(&node);
        let index = self.nodes.len();
        match self.known.entry(class) {
            Entry::Occupied(mut entry) => {
                let known = &self.nodes[*entry.get()];
                if known.closed || known.cost <= node.cost {
                    return;
                }
                entry.insert(index);
            }
            Entry::Vacant(entry) => {
                entry.insert(index);
            }
        }
        let estimate = node.cost + GREED * self.remaining(&node.pos) / query.speed_mps.max(node.vel.norm());
        self.nodes.push(node);
        self.open.push(Open { estimate, node: index });
    }

    fn path(&self, end: usize, reached: bool) -> Path {
        let mut legs = Vec::new();
        let mut node = &self.nodes[end];
        while let Some((from, leg)) = node.from {
            node = &self.nodes[from];
            legs.push(leg);
        }
        legs.reverse();
        Path { legs, reached }
    }
}
