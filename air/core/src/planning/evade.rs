//! Out of the way of what moves, and of a target that comes (beyond the paper).
//!
//! The network's trajectories lead to the aim and last a second or more: a slow vehicle's hardly differ before a mover
//! is there. If the best of them meets one, short ways are tried, on all sides and to a stop, and the safest is flown.
//! So it is when the best meets at once what stands: it came into view late, or a way aside led before it, and all of
//! them lead into it. So it is when a target comes that braking alone does not keep away from; then faster ways are tried
//! as well, and ways over it: it runs as fast as the vehicle backs, but it does not fly.
//! A way that ends beside a mover costs more than one that leaves it behind: it may turn round, unseen.

use crate::gaze::threat::{Pace, Threat};
use crate::planning::movers::{Mover, Movers, meeting};
use crate::planning::obstacles::{Ignored, Obstacles};
use crate::values::geometry::cap;
use crate::values::quintic::Quintic;
use crate::values::types::{Flat, FlatState, Rot, Time, Vec3};
use schemars::JsonSchema;
use serde::Deserialize;

/// What the airframe can do to get out of the way.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EvasionConfig {
    /// Acceleration with which a way aside begins, m/s².
    #[schemars(range(min = 1.0, max = 20.0), extend("x-why" = "less is too slow to get out of the way, and two g is all that tilt gives", "x-source" = "chosen by eye"))]
    pub acc_mps2: f64,
    /// How long the vehicle flies on as it does before it begins, s: network and attitude.
    #[schemars(range(min = 0.0, max = 0.5), extend("x-why" = "a vehicle that answers later does not get out of the way", "x-source" = "chosen by eye"))]
    pub begins_after_s: f64,
    /// Speeds that are tried to each side, m/s.
    #[schemars(inner(range(min = 0.1, max = 10.0)), extend("x-why" = "slower is a stop, faster flies into what stands beside", "x-source" = "chosen by eye"))]
    pub speeds_mps: [f64; 2],
    /// The speed that is tried besides, out of the way of a target that comes, m/s.
    #[schemars(range(min = 0.1, max = 15.0), extend("x-why" = "slower is a stop, faster flies into what stands beside", "x-source" = "chosen by eye"))]
    pub from_target_mps: f64,
    /// Acceleration upward, over a target that comes, m/s².
    #[schemars(range(min = 1.0, max = 30.0), extend("x-why" = "less is too slow to get over the target, more no airframe gives", "x-source" = "chosen by eye"))]
    pub climb_acc_mps2: f64,
    /// Speed upward, over a target that comes, m/s.
    #[schemars(range(min = 0.5, max = 10.0), extend("x-why" = "slower does not get over the target, faster reaches the ceiling", "x-source" = "chosen by eye"))]
    pub climb_mps: f64,
}

/// A way aside: to this velocity as fast as may be, and straight on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evasion {
    /// Level, m/s.
    pub vel_world: Vec3,
    /// And to this height, m; none: as high as one flies.
    pub height: Option<f64>,
    /// Out of the way of the target: so it keeps the least distance by itself.
    pub from_target: bool,
}

impl Evasion {
    /// What to fly at `height` (m) with `vel_world` (m/s), m/s².
    #[must_use]
    pub fn acc(&self, config: &EvasionConfig, height: f64, vel_world: Vec3) -> Vec3 {
        let level = Vec3::new(vel_world.x, vel_world.y, 0.0);
        let climb = self.height.map_or(0.0, |end| ((end - height) * CLIMB_GAIN).clamp(0.0, config.climb_mps));
        let vertical = ((climb - vel_world.z) * GAIN).clamp(-config.climb_acc_mps2, config.climb_acc_mps2);
        cap((self.vel_world - level) * GAIN, config.acc_mps2) + Vec3::z() * vertical
    }
}

/// Gain on the velocity, 1/s. Chosen by eye.
const GAIN: f64 = 5.0;
/// Gain of the climbing speed on the height that is left, 1/s. Chosen by eye.
const CLIMB_GAIN: f64 = 3.0;
/// How far a way aside is foreseen, s. Chosen by eye.
const HORIZON: f64 = 1.2;
/// At this time places are compared with where the vehicle would be, s. Chosen by eye.
const SOON: f64 = 0.6;
/// Headings that are tried. Chosen by eye.
const HEADINGS: u32 = 16;
/// Turns of the velocity that are tried, rad. Chosen by eye.
const TURNS: [f64; 6] = [-0.9, -0.45, -0.2, 0.2, 0.45, 0.9];
/// What the trajectory that would be flown costs at least for movers, so that another is looked for: a navigation takes
/// its time, a chase that steps aside may lose its target. Tried: the notebook, "Seen from afar".
const WORTH: (f64, f64) = (2.0, 5.0);
/// So a chase steps aside only before who would come as near as this, m, if both went on. Tried: there, too.
const COURSE: f64 = 0.3;
/// And what it costs for what stands: as much as to meet it within 0.8 s, or within 1.4 s if a way aside is flown
/// already. Tried: the notebook, "Away from what moves".
const AT_ONCE: (f64, f64) = (14.0, 6.0);
/// A way aside costs less by so much, or is not flown. Chosen by eye.
const BETTER: f64 = 1.0;
/// What a place costs that was never looked through. Chosen by eye.
const UNKNOWN: f64 = 6.0;
/// What a place costs that is beside the image now, though it was looked through once: who comes there is not seen.
/// Tried: the notebook, "Seen from afar".
const UNWATCHED: f64 = 10.0;
/// What each metre costs from where the vehicle would be. Chosen by eye.
const ASIDE: f64 = 0.5;
/// What each m/s costs from what was flown a frame ago. Chosen by eye.
const RESTLESS: f64 = 0.5;
/// Times of a way at which it is looked whether one knows the place, s. Chosen by eye.
const KNOWN_AT: [f64; 4] = [0.4, 0.7, 1.0, 1.3];
/// What it costs to end a way beside a mover. Tried: the notebook, "Away from what moves".
const BESIDE: f64 = 6.0;
/// It is left behind when its surface is so far from there, m. Chosen by eye.
const LEFT: f64 = 3.0;
/// What it costs to go up out of a target's way, for it leaves the image. Chosen by eye.
const UPWARD: f64 = 1.0;
/// What each m/s away from it costs: who backs before it only puts it off. Chosen by eye.
const BACKWARD: f64 = 1.5;
/// What it costs to meet something at once; the other costs here are weighed against it, never against the network's.
/// Chosen by eye.
const MEETING: f64 = 30.0;
/// What it costs to be where a target may be: twice what it costs to meet something. Chosen by eye.
const NEAR: f64 = 60.0;
/// At how many instants one looks for the target. Chosen by eye.
const LOOKS: u32 = 12;
/// Up to how late one looks for it, s. Chosen by eye.
const FORESEEN: f64 = 1.5;
/// A target comes that is faster toward the vehicle than this, m/s, and than one standard deviation more. Tried: the
/// notebook, "Who stands does not come".
const COMES: f64 = 0.5;

/// Chooses ways aside.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Evading {
    config: EvasionConfig,
    /// Of the last frame.
    last: Option<Evasion>,
    stamp: Option<Time>,
    pace: Pace,
}

/// What is in the way.
pub(crate) struct Scene<'a> {
    pub(crate) stamp: Time,
    pub(crate) obstacles: &'a Obstacles,
    pub(crate) movers: &'a Movers,
    /// Kept from them, m.
    pub(crate) clearance: f64,
    pub(crate) ignored: Option<&'a Ignored>,
    /// A target is chased.
    pub(crate) chases: bool,
    /// It must be kept away from,
    pub(crate) threat: Option<Threat>,
    /// by so much, m,
    pub(crate) keep_off: f64,
    /// and accelerates no harder than this, m/s².
    pub(crate) target_acc: f64,
}

impl Scene<'_> {
    fn danger(&self, way: &impl Fn(f64) -> Vec3, horizon: f64) -> f64 {
        let standing = self.obstacles.meeting_on(way, horizon, self.ignored);
        MEETING * (standing + meeting(self.movers, self.clearance, self.stamp, way, horizon))
    }
}

/// How near to one of the movers a way ends at `end`: 0 to none, 1 in it.
fn beside(movers: &Movers, end: &Vec3) -> f64 {
    let near = |mover: &Mover| 1.0 - ((end - mover.pos_world).xy().norm() - mover.radius) / LEFT;
    movers.iter().flatten().map(near).fold(0.0, f64::max).min(1.0)
}

/// The target, which may go on as it does, or turn on the vehicle.
struct Approach {
    /// m.
    pos_world: Vec3,
    /// How it may run, m/s.
    vels_world: [Vec3; 2],
    /// From it to the vehicle, level.
    away: Vec3,
    /// It comes nearer.
    comes: bool,
    /// m.
    keep_off: f64,
}

impl Approach {
    fn of(start: &FlatState, pace: &mut Pace, dt: f64, scene: &Scene) -> Option<Self> {
        let threat = scene.threat.as_ref()?;
        pace.step(dt, threat);
        let away: Flat = (start.pos - threat.pos_world).xy().try_normalize(1e-3)?;
        let worst = pace.worst(threat, scene.target_acc, &away);
        let turned = away * worst.dot(&away).max(0.0);
        Some(Self {
            pos_world: threat.pos_world,
            vels_world: [worst, turned].map(|vel| vel.push(0.0)),
            away: away.push(0.0),
            comes: threat.vel_world.xy().dot(&away) > COMES + threat.vel_doubt,
            keep_off: scene.keep_off + threat.pos_doubt,
        })
    }

    /// What it costs to fly `way`.
    fn meets(&self, way: &impl Fn(f64) -> Vec3) -> f64 {
        let share = |vel: &Vec3| {
            let at = |k: u32| {
                let time = FORESEEN * f64::from(k) / f64::from(LOOKS);
                let gap = (way(time) - self.pos_world - vel * time).norm();
                1.0 - gap / self.keep_off
            };
            (1..=LOOKS).map(at).fold(0.0, f64::max)
        };
        NEAR * self.vels_world.iter().map(share).fold(0.0, f64::max)
    }

    /// What it costs to back before it with `vel`, m/s.
    fn backs(&self, vel: &Vec3) -> f64 {
        if self.comes { BACKWARD * vel.dot(&self.away).max(0.0) } else { 0.0 }
    }
}

impl Evading {
    pub(crate) fn new(config: EvasionConfig) -> Self {
        Self { config, last: None, stamp: None, pace: Pace::default() }
    }

    /// The same way aside, from here on by other rules.
    pub(crate) fn with(self, config: EvasionConfig) -> Self {
        Self { config, ..self }
    }

    /// The way aside from `start`, where `flown` would be flown otherwise, or a stop; none: nothing moves in its way, or
    /// no way is safer.
    pub(crate) fn step(&mut self, start: &FlatState, flown: Option<&Quintic>, scene: &Scene) -> Option<Evasion> {
        let (last, config) = (self.last.take(), self.config);
        let dt = self.stamp.replace(scene.stamp).map_or(0.0, |stamp| scene.stamp.since(stamp).clamp(0.0, 1.0));
        let approach = Approach::of(start, &mut self.pace, dt, scene);
        let on = |vel_world: Vec3| Evasion { vel_world, height: None, from_target: false };
        let stop = |time: f64| aside(&config, start, &on(Vec3::zeros()), time);
        // Before a target the vehicle brakes, whatever is flown.
        let coming = approach.as_ref().filter(|target| target.comes);
        let met = coming.map_or(0.0, |coming| coming.meets(&stop));
        let otherwise = |time: f64| match flown {
            Some(flown) if met == 0.0 => flown.at(time).pos,
            _ => stop(time),
        };
        let horizon = flown.map_or(HORIZON, Quintic::duration);
        let (worth, kept) = if scene.chases { (WORTH.1, COURSE) } else { (WORTH.0, scene.clearance) };
        let moving = MEETING * meeting(scene.movers, kept, scene.stamp, &otherwise, horizon);
        let at_once = if last.is_some() { AT_ONCE.1 } else { AT_ONCE.0 };
        let standing = || MEETING * scene.obstacles.meeting_on(&otherwise, horizon, scene.ignored);
        if met == 0.0 && moving < worth && standing() < at_once {
            return None;
        }
        let least =
            scene.danger(&otherwise, horizon) + met + BESIDE * beside(scene.movers, &otherwise(HORIZON.min(horizon)));
        let soon = otherwise(SOON.min(horizon));
        let level = Vec3::new(start.vel.x, start.vel.y, 0.0);
        let around = (0..HEADINGS).flat_map(|k| config.speeds_mps.map(|speed| heading(k) * speed));
        let turned = TURNS.iter().map(|turn| Rot::from_axis_angle(&Vec3::z_axis(), *turn) * level * 0.85);
        // All but what is looked up in the map.
        let effort = |evasion: &Evasion| {
            let vel = evasion.vel_world;
            let way = |time: f64| aside(&config, start, evasion, time);
            approach.as_ref().map_or(0.0, |target| target.meets(&way) + target.backs(&vel))
                + ASIDE * (way(SOON) - soon).norm()
                + BESIDE * beside(scene.movers, &way(HORIZON))
                + evasion.height.map_or(0.0, |_| UPWARD)
                + last.map_or(0.0, |last| RESTLESS * (vel - last.vel_world).norm())
        };
        let risk = |evasion: &Evasion| {
            let way = |time: f64| aside(&config, start, evasion, time);
            let unwatched = if met > 0.0 { 0.0 } else { UNWATCHED };
            let unseen = |at: Vec3| {
                let (known, watched) = (scene.obstacles.is_known(&at), scene.obstacles.is_watched(&at));
                UNKNOWN * f64::from(u8::from(!known)) + unwatched * f64::from(u8::from(!watched))
            };
            let unseen: f64 = KNOWN_AT.iter().map(|time| unseen(way(*time))).sum();
            scene.danger(&way, HORIZON) + unseen / KNOWN_AT.len() as f64
        };
        let all = std::iter::once(Vec3::zeros()).chain(around).chain(turned).map(on);
        let out = coming.filter(|_| met > 0.0).into_iter().flat_map(|coming| outward(&config, coming));
        let mut best = None;
        for way in all.chain(out) {
            let cheaper = |cost: f64| cost.is_finite() && best.is_none_or(|(_, least)| cost < least);
            let effort = effort(&way);
            if cheaper(effort) {
                let cost = effort + risk(&way);
                best = if cheaper(cost) { Some((way, cost)) } else { best };
            }
        }
        let (way, cost) = best?;
        let better = if last.is_some() { 0.0 } else { BETTER };
        (cost + better < least).then(|| *self.last.insert(Evasion { from_target: met > 0.0, ..way }))
    }
}

fn heading(k: u32) -> Vec3 {
    let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(HEADINGS)).sin_cos();
    Vec3::new(cos, sin, 0.0)
}

/// Out of a target's way: fast, and over it.
fn outward(config: &EvasionConfig, coming: &Approach) -> impl Iterator<Item = Evasion> + use<> {
    let over = Some(coming.pos_world.z + coming.keep_off);
    let ([slow, swift], fast) = (config.speeds_mps, config.from_target_mps);
    let level = (0..HEADINGS).flat_map(move |k| [slow, swift, fast].map(|speed| heading(k) * speed));
    let way = |height| move |vel_world| Evasion { vel_world, height, from_target: true };
    (0..HEADINGS).map(move |k| heading(k) * fast).map(way(None)).chain(level.chain([Vec3::zeros()]).map(way(over)))
}

/// Where one is after `time` s on the way.
fn aside(config: &EvasionConfig, start: &FlatState, evasion: &Evasion, time: f64) -> Vec3 {
    let lag = time.min(config.begins_after_s);
    let (pos, from) = (start.pos + start.vel * lag + start.acc * (0.5 * lag * lag), start.vel + start.acc * lag);
    let change = (evasion.vel_world - from).xy().push(0.0);
    let (left, turning) = (time - lag, change.norm() / config.acc_mps2);
    let turned = left.min(turning);
    let level =
        from * turned + change * (0.5 * turned * turned / turning.max(1e-9)) + evasion.vel_world * (left - turned);
    let rise = evasion.height.map_or(0.0, |end| {
        let (acc, fastest) = (config.climb_acc_mps2, config.climb_mps);
        let rising = left.min(((fastest - start.vel.z) / acc).max(0.0));
        let free = (start.vel.z + 0.5 * acc * rising) * rising + fastest * (left - rising);
        free.min((end - start.pos.z).max(0.0))
    });
    Vec3::new(pos.x + level.x, pos.y + level.y, start.pos.z + rise)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::movers::MOST;
    use crate::planning::nearest::{COLUMNS, ROWS};
    use crate::shipped;

    const STAMP: Time = Time(1_000_000_000);

    fn config() -> EvasionConfig {
        shipped::tuning().planner.evasion
    }

    /// One looks at a wall 9 m ahead.
    fn open_space() -> Obstacles {
        before_wall(9000)
    }

    /// Or nearer, mm.
    fn before_wall(mm: u16) -> Obstacles {
        let how = shipped::tuning().planner;
        let (hfov, vfov) = (90_f64.to_radians(), 62_f64.to_radians());
        let mut obstacles = Obstacles::new(hfov, vfov, 6.0, &how.obstacles, how.movers);
        for _ in 0..4 {
            obstacles.see(STAMP, (&Vec3::zeros(), &Rot::identity()), &[mm; COLUMNS * ROWS], None);
        }
        obstacles
    }

    fn mover(pos_world: Vec3, vel_world: Vec3) -> Movers {
        let mut movers = [None; MOST];
        movers[0] = Some(Mover { stamp: STAMP, pos_world, vel_world, radius: 0.3, pos_doubt: 0.0 });
        movers
    }

    fn step(start: &FlatState, movers: &Movers) -> Option<Evasion> {
        step_before(start, movers, None)
    }

    fn step_before(start: &FlatState, movers: &Movers, threat: Option<Threat>) -> Option<Evasion> {
        step_among(&open_space(), threat.is_some(), start, movers, threat)
    }

    fn step_among(
        obstacles: &Obstacles,
        chases: bool,
        start: &FlatState,
        movers: &Movers,
        threat: Option<Threat>,
    ) -> Option<Evasion> {
        let ahead = FlatState { pos: start.pos + start.vel * 2.0, ..*start };
        let flown = Quintic::new(start, &ahead, 2.0);
        let scene = Scene {
            stamp: STAMP,
            obstacles,
            movers,
            clearance: 0.5,
            ignored: None,
            chases,
            threat,
            keep_off: 2.0,
            target_acc: 8.0,
        };
        Evading::new(config()).step(start, Some(&flown), &scene)
    }

    #[test]
    fn a_mover_on_the_way_is_evaded_by_its_back_or_by_a_stop_and_one_that_passes_is_not() {
        let start = FlatState { vel: Vec3::x() * 2.0, ..FlatState::default() };
        let crossing = mover(Vec3::new(2.2, -1.2, 0.0), Vec3::y() * 1.2);
        let evasion = step(&start, &crossing).expect("they would meet");
        let gap = (1..=20).map(|k| f64::from(k) * 0.09).map(|time| {
            let it = crossing[0].unwrap();
            (aside(&config(), &start, &evasion, time) - it.pos_world - it.vel_world * time).xy().norm()
        });
        let least = gap.fold(f64::INFINITY, f64::min);
        assert!(least > 0.6, "{least} {evasion:?}");
        assert_eq!(step(&start, &mover(Vec3::new(2.2, -1.2, 0.0), Vec3::y() * -1.2)), None);
        assert_eq!(step(&start, &[None; MOST]), None);
    }

    #[test]
    fn a_chase_steps_out_of_the_way_of_who_comes_at_it_and_not_of_who_passes() {
        let start = FlatState { vel: Vec3::new(0.5, 0.5, 0.0), ..FlatState::default() };
        let comes = |at: Vec3, vel: Vec3| step_among(&open_space(), true, &start, &mover(at, vel), None);
        let (at, vel) = (Vec3::new(2.6, 0.4, 0.0), Vec3::new(-1.6, 0.0, 0.0));
        let evasion = comes(at, vel).expect("it would be hit");
        let gap = (1..=24)
            .map(|k| f64::from(k) * 0.05)
            .map(|time| (aside(&config(), &start, &evasion, time) - at - vel * time).xy().norm());
        let least = gap.fold(f64::INFINITY, f64::min);
        assert!(least > 0.6, "{least} {evasion:?}");
        assert_eq!(comes(at + Vec3::y() * 2.2, vel), None);
    }

    #[test]
    fn what_stands_so_near_that_all_trajectories_meet_it_is_evaded_and_what_stands_farther_is_left_to_them() {
        let start = FlatState { vel: Vec3::x() * 2.0, ..FlatState::default() };
        for chases in [false, true] {
            let before = |mm: u16| step_among(&before_wall(mm), chases, &start, &[None; MOST], None);
            let evasion = before(1600).expect("it would be met");
            let nearest = (1..=20).map(|k| aside(&config(), &start, &evasion, f64::from(k) * 0.06).x);
            assert!(nearest.fold(0.0, f64::max) < 1.4, "{evasion:?}");
            assert_eq!(before(4000), None);
        }
    }

    #[test]
    fn who_steps_out_of_a_movers_way_leaves_it_behind() {
        let start = FlatState { vel: Vec3::x() * 2.0, ..FlatState::default() };
        for side in [-1.0, 1.0] {
            let crossing = mover(Vec3::new(2.0, 1.2 * side, 0.0), Vec3::y() * (-1.2 * side));
            let evasion = step(&start, &crossing).expect("they would meet");
            let end = aside(&config(), &start, &evasion, HORIZON);
            let stop = aside(&config(), &start, &Evasion { vel_world: Vec3::zeros(), ..evasion }, HORIZON);
            let beside = |end: &Vec3| beside(&crossing, end);
            assert!(beside(&end) < 0.8 * beside(&stop), "{} {} {evasion:?}", beside(&end), beside(&stop));
        }
    }

    #[test]
    fn who_hovers_nearer_to_a_mover_than_the_clearance_leaves_before_it_comes() {
        let start = FlatState::default();
        let comes = mover(Vec3::x() * 0.65, Vec3::x() * -0.8);
        let evasion = step_among(&open_space(), true, &start, &comes, None).expect("it would be hit");
        let gap = |time: f64| (aside(&config(), &start, &evasion, time) - Vec3::x() * (0.65 - 0.8 * time)).norm() - 0.3;
        let least = (1..=20).map(|k| gap(f64::from(k) * 0.05)).fold(f64::INFINITY, f64::min);
        assert!(least > 0.2, "{least} {evasion:?}");
    }

    fn target(pos_world: Vec3, vel_world: Vec3) -> Option<Threat> {
        Some(Threat { pos_world, vel_world, pos_doubt: 0.0, vel_doubt: 0.0, hidden_for: 0.0 })
    }

    #[test]
    fn a_target_that_comes_is_stepped_out_of_its_way_by_the_distance_and_not_backed_before() {
        let (start, comes) = (FlatState::default(), target(Vec3::x() * 5.0, Vec3::x() * -5.0));
        let evasion = step_before(&start, &[None; MOST], comes).expect("it would be run over");
        let gap = |time: f64| (aside(&config(), &start, &evasion, time) - Vec3::x() * (5.0 - 5.0 * time)).norm();
        let least = (1..=20).map(|k| gap(f64::from(k) * 0.1)).fold(f64::INFINITY, f64::min);
        assert!(least > 1.9 && evasion.vel_world.x > -2.0, "{least} {evasion:?}");
        let leaves = target(Vec3::x() * 5.0, Vec3::x() * 5.0);
        assert_eq!(step_before(&start, &[None; MOST], leaves), None);
        let passes = target(Vec3::new(5.0, 5.0, 0.0), Vec3::y() * 5.0);
        assert_eq!(step_before(&start, &[None; MOST], passes), None);
    }

    #[test]
    fn one_that_may_as_well_stand_is_not_stepped_out_of_the_way_of() {
        let seen = |vel_doubt: f64| Some(Threat { vel_doubt, ..target(Vec3::x() * 3.5, Vec3::x() * -1.0).unwrap() });
        assert_eq!(step_before(&FlatState::default(), &[None; MOST], seen(0.8)), None);
        let evasion = step_before(&FlatState::default(), &[None; MOST], seen(0.2)).expect("it comes");
        assert!(evasion.from_target);
    }

    #[test]
    fn one_that_is_too_near_to_step_aside_is_stepped_over() {
        let near = target(Vec3::new(2.2, 0.0, -0.4), Vec3::x() * -4.0);
        let evasion = step_before(&FlatState::default(), &[None; MOST], near).expect("it would be run over");
        assert_eq!(evasion.height, Some(1.6), "the least distance above it");
        assert!(evasion.acc(&config(), 0.0, Vec3::zeros()).z > 5.0);
        assert_eq!(evasion.acc(&config(), 9.0, Vec3::zeros()).z, 0.0, "nobody comes down on it");
    }

    #[test]
    fn whatever_is_not_finite_is_not_flown() {
        let start = FlatState { vel: Vec3::x() * f64::NAN, ..FlatState::default() };
        assert_eq!(step(&start, &mover(Vec3::x(), Vec3::x() * -2.0)), None);
    }
}
