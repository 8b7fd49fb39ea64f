//! Out of the way of what moves (beyond the paper).
//!
//! The network's trajectories lead to the aim and last a second or more: a slow vehicle's hardly differ before a mover
//! is there. If the best of them meets one, short ways are tried, on all sides and to a stop, and the safest is flown.

use crate::movers::{Movers, meeting};
use crate::obstacles::{Ignored, Obstacles};
use crate::quintic::Quintic;
use crate::types::{FlatState, Rot, Time, Vec3};

/// A short way aside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evasion {
    /// Where it ends, world frame.
    pub end: FlatState,
    /// s.
    pub duration: f64,
}

/// How long a way aside lasts, s.
const DURATION: f64 = 0.6;
/// Headings that are tried, at these speeds, m/s, and turns of the velocity, rad.
const HEADINGS: u32 = 16;
const SPEEDS: [f64; 2] = [1.2, 2.5];
const TURNS: [f64; 6] = [-0.9, -0.45, -0.2, 0.2, 0.45, 0.9];
/// What the trajectory that would be flown costs at least for movers, so that another is looked for: a navigation takes
/// its time, a chase that steps aside loses its target.
const WORTH: (f64, f64) = (2.0, 14.0);
/// A way aside costs less by so much, or is not flown.
const BETTER: f64 = 1.0;
/// On the scale of the network's costs: a place that was never looked through; each metre from where the vehicle would
/// be; each m/s from what was flown a frame ago.
const UNKNOWN: f64 = 6.0;
const ASIDE: f64 = 0.5;
const RESTLESS: f64 = 0.5;
/// Times of a way at which it is looked whether one knows the place, s.
const KNOWN_AT: [f64; 4] = [0.4, 0.7, 1.0, 1.3];

/// Chooses ways aside.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Evader {
    /// Where the last one led, m/s.
    last: Option<Vec3>,
}

/// What is in the way.
pub(crate) struct Scene<'a> {
    pub(crate) stamp: Time,
    pub(crate) obstacles: &'a Obstacles,
    pub(crate) movers: &'a Movers,
    pub(crate) ignored: Option<&'a Ignored>,
    /// A target is chased.
    pub(crate) chases: bool,
    /// The vehicle's greatest acceleration, m/s².
    pub(crate) max_acc: f64,
}

impl Scene<'_> {
    fn danger(&self, way: &impl Fn(f64) -> Vec3, horizon: f64) -> f64 {
        self.obstacles.meeting_on(way, horizon, self.ignored) + meeting(self.movers, self.stamp, way, horizon)
    }
}

impl Evader {
    /// The way aside from `start`, where `flown` would be flown otherwise, or a stop; none: nothing moves in its way, or
    /// no way is safer.
    pub(crate) fn step(&mut self, start: &FlatState, flown: Option<&Quintic>, scene: &Scene) -> Option<Evasion> {
        let last = self.last.take();
        if scene.movers.iter().all(Option::is_none) {
            return None;
        }
        let worth = if scene.chases { WORTH.1 } else { WORTH.0 };
        let stop = aside(start, Vec3::zeros());
        let otherwise = |time: f64| flown.map_or_else(|| then(&stop, time), |flown| flown.at(time).pos);
        let horizon = flown.map_or(2.0 * DURATION, Quintic::duration);
        if meeting(scene.movers, scene.stamp, &otherwise, horizon) < worth {
            return None;
        }
        let least = scene.danger(&otherwise, horizon);
        let soon = otherwise(DURATION.min(horizon));
        let level = Vec3::new(start.vel.x, start.vel.y, 0.0);
        let around = (0..HEADINGS).flat_map(|k| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(HEADINGS)).sin_cos();
            SPEEDS.map(|speed| Vec3::new(cos, sin, 0.0) * speed)
        });
        let turned = TURNS.iter().map(|turn| Rot::from_axis_angle(&Vec3::z_axis(), *turn) * level * 0.85);
        let cost = |vel: Vec3| {
            let quintic = aside(start, vel);
            let way = |time: f64| then(&quintic, time);
            let hard = ((vel - level).norm() * 1.6 / DURATION - scene.max_acc).max(0.0);
            let unknown = KNOWN_AT.iter().filter(|time| !scene.obstacles.is_known(&way(**time))).count();
            scene.danger(&way, 2.0 * DURATION)
                + hard
                + UNKNOWN * unknown as f64 / KNOWN_AT.len() as f64
                + ASIDE * (way(DURATION) - soon).norm()
                + last.map_or(0.0, |last| RESTLESS * (vel - last).norm())
        };
        let all = std::iter::once(Vec3::zeros()).chain(around).chain(turned);
        let best = all.map(|vel| (vel, cost(vel))).min_by(|a, b| a.1.total_cmp(&b.1));
        let (vel, cost) = best.filter(|(_, cost)| cost.is_finite())?;
        let better = if last.is_some() { 0.0 } else { BETTER };
        (cost + better < least).then(|| {
            self.last = Some(vel);
            Evasion { end: aside(start, vel).at(DURATION), duration: DURATION }
        })
    }
}

/// To the velocity `vel` (m/s, level).
fn aside(start: &FlatState, vel: Vec3) -> Quintic {
    let pos = start.pos + (start.vel + vel) * (0.5 * DURATION);
    let level = Vec3::new(pos.x, pos.y, start.pos.z);
    Quintic::new(start, &FlatState { pos: level, vel, acc: Vec3::zeros() }, DURATION)
}

/// On a way, and straight on beyond its end.
fn then(quintic: &Quintic, time: f64) -> Vec3 {
    let end = quintic.at(time.min(DURATION));
    end.pos + end.vel * (time - DURATION).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::movers::{MOST, Mover};
    use crate::nearest::{COLUMNS, ROWS};

    const STAMP: Time = Time(1_000_000_000);

    /// One looks at a wall 9 m ahead.
    fn open_space() -> Obstacles {
        let mut obstacles = Obstacles::new(90_f64.to_radians(), 62_f64.to_radians(), 6.0);
        for _ in 0..4 {
            obstacles.see(STAMP, (&Vec3::zeros(), &Rot::identity()), &[9000; COLUMNS * ROWS], None);
        }
        obstacles
    }

    fn mover(pos_world: Vec3, vel_world: Vec3) -> Movers {
        let mut movers = [None; MOST];
        movers[0] = Some(Mover { stamp: STAMP, pos_world, vel_world, radius: 0.3, pos_doubt: 0.0 });
        movers
    }

    fn step(start: &FlatState, movers: &Movers) -> Option<Evasion> {
        let obstacles = open_space();
        let ahead = FlatState { pos: start.pos + start.vel * 2.0, ..*start };
        let flown = Quintic::new(start, &ahead, 2.0);
        let scene = Scene { stamp: STAMP, obstacles: &obstacles, movers, ignored: None, chases: false, max_acc: 10.0 };
        Evader::default().step(start, Some(&flown), &scene)
    }

    #[test]
    fn a_mover_on_the_way_is_evaded_by_its_back_or_by_a_stop_and_one_that_passes_is_not() {
        let start = FlatState { vel: Vec3::x() * 2.0, ..FlatState::default() };
        let crossing = mover(Vec3::new(2.2, -1.2, 0.0), Vec3::y() * 1.2);
        let evasion = step(&start, &crossing).expect("they would meet");
        let way = Quintic::new(&start, &evasion.end, evasion.duration);
        let gap = (1..=20).map(|k| f64::from(k) * 0.09).map(|time| {
            let it = crossing[0].unwrap();
            (then(&way, time) - it.pos_world - it.vel_world * time).xy().norm()
        });
        let least = gap.fold(f64::INFINITY, f64::min);
        assert!(least > 0.6, "{least} {evasion:?}");
        assert_eq!(step(&start, &mover(Vec3::new(2.2, -1.2, 0.0), Vec3::y() * -1.2)), None);
        assert_eq!(step(&start, &[None; MOST]), None);
    }

    #[test]
    fn whatever_is_not_finite_is_not_flown() {
        let start = FlatState { vel: Vec3::x() * f64::NAN, ..FlatState::default() };
        assert_eq!(step(&start, &mover(Vec3::x(), Vec3::x() * -2.0)), None);
    }
}
