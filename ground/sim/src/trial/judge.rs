//! What happened in a flight: contacts, clearance, how well the target was seen and located.

use goshawk_core::{Plan, TargetEstimate, Time, Vec3};
use serde::{Deserialize, Serialize};

use super::airframe::BODY_RADIUS_M;
use super::rule::FAR_M;
use crate::actors::evader::EvaderState;
use crate::actors::moving;
use crate::render::Frame;
use crate::sense::rgbd::Sensor;
use crate::vehicle::quadrotor::QuadrotorState;
use crate::world::{Kind, Part, World};

/// What the vehicle hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Contact {
    /// A tree's stem.
    Trunk,
    /// A thin limb.
    Branch,
    /// Leaves.
    Foliage,
    /// A wall, a ceiling, furniture.
    Building,
    /// A scanned surface.
    Scan,
    /// A moving obstacle.
    Moving,
    /// The ground, in flight.
    Ground,
    /// The target itself.
    Person,
}

/// A person's body for contacts: an upright capsule about the centre line, m.
const PERSON_RADIUS_M: f64 = 0.25;
const PERSON_LOW_M: f64 = 0.25;
const PERSON_HIGH_M: f64 = 1.5;

/// An estimate farther from the truth than this is not the target, m.
const SAME_TARGET_M: f64 = 2.0;

/// The target counts as in view if this many pixels and this fraction of them are unhidden.
const VIEW_PIXELS: u32 = 6;
const VIEW_FRACTION: f64 = 0.2;

/// Acceleration is averaged over this many physics steps before it is differentiated.
const JERK_STEPS: u32 = 20;

/// Measured over one flight, from the task's beginning where nothing else is said.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// How long the task was flown, s.
    pub task_s: f64,
    /// Least distance from the vehicle's sphere to an obstacle (not the ground), from the Start on, m; none: not flown.
    pub clearance_m: Option<f64>,
    /// Least distance from the vehicle's centre to the target's while both were about, from the take-off's end on, m.
    pub target_distance_min_m: Option<f64>,
    /// Frames, and those in which the target was truly in view.
    pub frames: u64,
    /// See `frames`.
    pub frames_in_view: u64,
    /// Distance to the target, m: sum over frames and largest.
    pub distance_sum_m: f64,
    /// See `distance_sum_m`.
    pub distance_max_m: f64,
    /// Errors of the target's estimate across the line of sight, horizontal, one a frame with an estimate, m.
    pub lateral_m: Vec<f64>,
    /// Along the line of sight, m.
    pub longitudinal_m: Vec<f64>,
    /// Where the target was while it was in view, one a frame: forward and left of the vehicle, by its heading, m.
    pub target_plane_m: Vec<[f64; 2]>,
    /// ∫ jerk² dt, m²/s⁵, of the true motion's 20 ms means.
    pub jerk_integral: f64,
    /// Way flown, m.
    pub way_m: f64,
    /// Of it, that between the ends of the course ([`super::rule::cruise_between`]), m, and the time there, s.
    pub cruise_way_m: f64,
    /// See `cruise_way_m`.
    pub cruise_s: f64,
    /// The longest stretch farther from the target than [`FAR_M`], s.
    pub far_s: f64,
    /// Highest speed, m/s.
    pub speed_max_mps: f64,
}

impl Metrics {
    /// Way over time between the ends of the course, m/s; none: the flight ended before.
    #[must_use]
    pub fn cruise_mps(&self) -> Option<f64> {
        (self.cruise_s > 0.0).then(|| self.cruise_way_m / self.cruise_s)
    }
}

/// Watches a flight.
#[derive(Clone, Debug, Default)]
pub(super) struct Judge {
    pub(super) metrics: Metrics,
    /// When the vehicle last detected the true target.
    last_seen: Option<Time>,
    acc_sum: Vec3,
    acc_count: u32,
    acc_last: Option<Vec3>,
    /// The cruise is over.
    cruised: bool,
    /// Farther from the target than [`FAR_M`] for so long now, s.
    far_s: f64,
}

/// True places at a frame's exposure.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exposure {
    pub(super) vehicle_world: Vec3,
    pub(super) heading_rad: f64,
    pub(super) target_world: Option<Vec3>,
}

/// Distance from a point to the person's capsule, m.
fn person_distance(at: &Vec3, person: &EvaderState) -> f64 {
    let foot = person.pose.foot_world;
    let height = (at.z - foot.z).clamp(PERSON_LOW_M, PERSON_HIGH_M);
    (at - (foot + Vec3::new(0.0, 0.0, height))).norm() - PERSON_RADIUS_M
}

/// From the vehicle's sphere to the nearest obstacle (not the ground), `moving` ones among them, m.
#[must_use]
pub fn clearance(world: &World, moving: &[Part], at: &Vec3) -> f64 {
    world.clearance(at).min(moving::clearance(moving, at)) - BODY_RADIUS_M
}

/// Follows the clearance of a vehicle's sphere in the fixed world, and measures it only where it may have come near.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Follower {
    at: Vec3,
    clearance_m: f64,
}

impl Default for Follower {
    /// Nothing is known yet.
    fn default() -> Self {
        Self { at: Vec3::zeros(), clearance_m: f64::NEG_INFINITY }
    }
}

impl Follower {
    /// The clearance at `at`, m, from the world and from `moving` obstacles. If it is above both 0 and `matters_m` it may
    /// be understated, but not to below them.
    pub(crate) fn clearance(&mut self, world: &World, moving: &[Part], at: &Vec3, matters_m: f64) -> f64 {
        // A distance changes by no more than the way; the last digits are rounding's.
        let at_least = self.clearance_m - (at - self.at).norm() - 1e-9;
        let fixed_m = if at_least > matters_m.max(0.0) {
            at_least
        } else {
            *self = Self { at: *at, clearance_m: clearance(world, &[], at) };
            self.clearance_m
        };
        fixed_m.min(moving::clearance(moving, at) - BODY_RADIUS_M)
    }
}

/// What the vehicle's sphere, `clearance_m` from the nearest obstacle, touches; the ground only if it is `airborne`.
#[must_use]
pub fn contact(
    world: &World,
    moving: &[Part],
    at: &Vec3,
    clearance_m: f64,
    person: Option<&EvaderState>,
    airborne: bool,
) -> Option<Contact> {
    if clearance_m < 0.0 {
        let nearest = world
            .parts()
            .iter()
            .chain(moving)
            .min_by(|a, b| a.shape.signed_distance(at).total_cmp(&b.shape.signed_distance(at)))
            .map(|part| part.kind);
        return Some(match nearest {
            Some(Kind::Branch) => Contact::Branch,
            Some(Kind::Foliage) => Contact::Foliage,
            Some(Kind::Building) => Contact::Building,
            Some(Kind::Scan) => Contact::Scan,
            Some(Kind::Moving) => Contact::Moving,
            Some(Kind::Trunk) | None => Contact::Trunk,
        });
    }
    if person.is_some_and(|p| person_distance(at, p) < BODY_RADIUS_M) {
        return Some(Contact::Person);
    }
    // On the ground the sphere would stand in it: it counts only in flight.
    (airborne && at.z - world.ground_height(at.x, at.y) < BODY_RADIUS_M).then_some(Contact::Ground)
}

/// Whether the frame shows the target well enough to count as seen, as far as the sensor's colour lens sees it.
#[must_use]
pub fn in_view(frame: &Frame, sensor: &Sensor) -> bool {
    let pixels = frame.person_pixels_visible.saturating_sub(sensor.person_pixels_unseen(frame));
    pixels >= VIEW_PIXELS && f64::from(pixels) / f64::from(frame.person_pixels) >= VIEW_FRACTION
}

impl Judge {
    /// One physics step of the task.
    pub(super) fn physics(&mut self, dt_s: f64, state: &QuadrotorState) {
        let m = &mut self.metrics;
        m.task_s += dt_s;
        let speed = state.vel_world.norm();
        m.way_m += speed * dt_s;
        m.speed_max_mps = m.speed_max_mps.max(speed);
        self.acc_sum += state.acc_world;
        self.acc_count += 1;
        if self.acc_count == JERK_STEPS {
            let mean = self.acc_sum / f64::from(JERK_STEPS);
            let span = f64::from(JERK_STEPS) * dt_s;
            if let Some(last) = self.acc_last {
                m.jerk_integral += ((mean - last) / span).norm_squared() * span;
            }
            (self.acc_last, self.acc_sum, self.acc_count) = (Some(mean), Vec3::zeros(), 0);
        }
    }

    /// The clearance now.
    pub(crate) fn clearance(&mut self, clearance_m: f64) {
        let least = self.metrics.clearance_m.get_or_insert(clearance_m);
        *least = least.min(clearance_m);
    }

    /// How far the target is now, m.
    pub(super) fn target_distance(&mut self, distance_m: f64) {
        let least = self.metrics.target_distance_min_m.get_or_insert(distance_m);
        *least = least.min(distance_m);
    }

    /// How far the target is in the task, m, for another `dt_s`.
    pub(super) fn pursuit(&mut self, dt_s: f64, distance_m: f64) {
        self.far_s = if distance_m > FAR_M { self.far_s + dt_s } else { 0.0 };
        self.metrics.far_s = self.metrics.far_s.max(self.far_s);
    }

    /// One physics step of the task, `along_m` along the course that is to be cruised from one place to another.
    pub(super) fn cruise(&mut self, dt_s: f64, speed_mps: f64, along_m: f64, [from_m, to_m]: [f64; 2]) {
        self.cruised |= along_m >= to_m;
        // Once it has begun it goes on, also where the vehicle turns back.
        if !self.cruised && (along_m >= from_m || self.metrics.cruise_s > 0.0) {
            self.metrics.cruise_way_m += speed_mps * dt_s;
            self.metrics.cruise_s += dt_s;
        }
    }

    /// A frame was exposed during the task, and showed the target or not.
    pub(super) fn frame(&mut self, in_view: bool, exposure: &Exposure) {
        let m = &mut self.metrics;
        m.frames += 1;
        if let Some(target) = exposure.target_world {
            let line = target - exposure.vehicle_world;
            if in_view {
                m.frames_in_view += 1;
                let (sin, cos) = exposure.heading_rad.sin_cos();
                m.target_plane_m.push([cos * line.x + sin * line.y, cos * line.y - sin * line.x]);
            }
            let distance = line.norm();
            m.distance_sum_m += distance;
            m.distance_max_m = m.distance_max_m.max(distance);
        }
    }

    /// A plan was made from the frame that was exposed at `exposure`.
    pub(super) fn plan(&mut self, plan: &Plan, exposure: &Exposure, in_task: bool) {
        let (Some(target), Some(estimate)) = (exposure.target_world, &plan.target) else { return };
        let true_line = target - exposure.vehicle_world;
        let error = (estimate.pos_world - plan.start.pos) - true_line;
        if error.norm() < SAME_TARGET_M && estimate.confirmed {
            self.last_seen = self.last_seen.max(Some(estimate.last_seen));
        }
        if in_task && believed(estimate) {
            let along = Vec3::new(true_line.x, true_line.y, 0.0).try_normalize(1e-6).unwrap_or(Vec3::x());
            let across = Vec3::new(-along.y, along.x, 0.0);
            self.metrics.lateral_m.push(error.dot(&across));
            self.metrics.longitudinal_m.push(error.dot(&along));
        }
    }

    /// Seconds since the vehicle last detected the true target; none: it never has.
    pub(super) fn unseen_s(&self, now: Time) -> Option<f64> {
        self.last_seen.map(|seen| now.since(seen))
    }

    /// The vehicle has detected the true target within `within_s` before `now`.
    pub(super) fn seen(&self, now: Time, within_s: f64) -> bool {
        self.last_seen.is_some_and(|seen| now.since(seen) <= within_s)
    }
}

/// Confirmed, and updated by the newest frame.
fn believed(estimate: &TargetEstimate) -> bool {
    estimate.confirmed && estimate.stamp == estimate.last_seen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::forest::{ForestConfig, forest};

    /// Steps of 10 ms: m along the course, and the speed there.
    fn cruised(steps: impl Iterator<Item = (f64, f64)>) -> Metrics {
        let mut judge = Judge::default();
        steps.for_each(|(along_m, speed_mps)| judge.cruise(0.01, speed_mps, along_m, [15.0, 25.0]));
        judge.metrics
    }

    #[test]
    fn cruise_speed_is_that_between_the_ends_of_the_course() {
        let flown = cruised((0..1000).map(|i| 0.04 * f64::from(i)).map(|along| {
            let between = (15.0..25.0).contains(&along);
            (along, if between { 4.0 } else { 9.0 })
        }));
        assert!((flown.cruise_mps().unwrap() - 4.0).abs() < 1e-9 && (flown.cruise_way_m - 10.0).abs() < 0.1);
        assert_eq!(cruised([(0.0, 4.0), (14.9, 4.0)].into_iter()).cruise_mps(), None);
    }

    #[test]
    fn who_turns_back_on_the_course_cruises_on_and_who_returns_from_its_end_does_not() {
        let flown = cruised([16.0, 14.0, 12.0, 16.0, 24.0, 26.0, 20.0].into_iter().map(|along| (along, 2.0)));
        assert!((flown.cruise_s - 0.05).abs() < 1e-12, "{flown:?}");
    }

    #[test]
    fn only_a_stretch_farther_away_counts_and_the_longest_of_them() {
        let mut judge = Judge::default();
        for distance_m in [13.0, 13.0, 11.0, 13.0, 12.0] {
            judge.pursuit(0.5, distance_m);
        }
        assert_eq!(judge.metrics.far_s, 1.0);
    }

    #[test]
    fn following_the_clearance_finds_every_contact_and_the_least_distance() {
        let world = forest(&ForestConfig::default(), 5).unwrap();
        let (mut follower, mut measured) = (Follower::default(), 0);
        let (mut least, mut followed) = (f64::INFINITY, f64::INFINITY);
        for step in 0..20_000 {
            let way = 0.003 * f64::from(step);
            let at = Vec3::new(5.0 + way, 8.0 * (0.11 * way).sin(), 1.5);
            let (truth, before) = (clearance(&world, &[], &at), follower.at);
            let found = follower.clearance(&world, &[], &at, followed);
            measured += u32::from(follower.at != before);
            assert_eq!(found < 0.0, truth < 0.0, "at {way} m");
            (least, followed) = (least.min(truth), followed.min(found));
            assert_eq!(least, followed, "at {way} m");
        }
        assert!(least < 0.0, "the way meets a tree");
        assert!(measured < 2000, "{measured} measurements");
    }
}
