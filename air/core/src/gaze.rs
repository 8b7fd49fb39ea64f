//! Where the camera looks, and what is believed of a target that it does not see (beyond the paper).
//!
//! For how long a target has been hidden, and what that changes, stands in [`hidden`]. From the filter's estimate the
//! planner makes an [`expected::Expected`] to chase, and both planner and controller a [`threat::Threat`] to keep away
//! from. [`Gaze`] is the controller's: it holds the newest estimate, turns the camera, and looks for a target that hides.

pub mod doubt;
pub mod expected;
pub mod hidden;
pub mod threat;
pub mod view;
pub mod yaw;

use crate::gaze::expected::carried;
use crate::gaze::hidden::hidden_for;
use crate::gaze::threat::Threat;
use crate::gaze::view::ViewConfig;
use crate::gaze::yaw::{YawConfig, YawGoal, YawPlanner, along, toward};
use crate::values::jump::Jump;
use crate::values::types::{Candidate, FlatState, Odometry, TargetEstimate, Time, Vec3};

/// What may be the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GazeConfig {
    /// Its least objectness, 0..=1: `planner.target.confirm_objectness`, which the target filter checks.
    pub objectness: f64,
}

/// What the camera is to look for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Look {
    /// Nothing: it keeps its heading.
    Keep,
    /// The target that is chased.
    Chase,
    /// The target beside which the vehicle holds.
    Hold,
    /// The target that is lost: where it was lost, or all around.
    Search {
        /// It has been looked for long enough where it was lost.
        around: bool,
    },
    /// The way to this place, world frame, m.
    Way(Vec3),
}

/// Who is farther than this from where the target should be, m, is not the target as it is believed. Chosen by eye.
const APART: f64 = 1.5;
/// Who is seen for so long looks like the target for sure, s: three frames. Chosen by eye.
const LOOKALIKE_SHOWS: f64 = 0.06;
/// Not seen for so long it is forgotten, s. Chosen by eye.
const LOOKALIKE_LASTS: f64 = 0.3;
/// It steps no farther from one look to the next, m. Chosen by eye.
const LOOKALIKE_STEP: f64 = 1.0;
/// It may be nearer by so much, m. Chosen by eye, as the target's after a few looks.
const LOOKALIKE_DOUBT: f64 = 0.3;

/// Somebody who looks like the target, and is not where that is believed to be.
#[derive(Clone, Copy, Debug)]
struct Lookalike {
    /// Seen since then,
    since: Time,
    /// and until then,
    stamp: Time,
    /// there, m.
    pos_world: Vec3,
}

/// The camera's heading, and what is believed of the target.
#[derive(Clone, Copy, Debug)]
pub struct Gaze {
    config: GazeConfig,
    view: ViewConfig,
    yaw: YawPlanner,
    target: Option<TargetEstimate>,
    lookalike: Option<Lookalike>,
    /// The side to which the target would leave the image; its sign counts, positive to the left.
    side: f64,
}

impl Gaze {
    /// At rest at yaw 0, with nothing seen.
    #[must_use]
    pub fn new(config: GazeConfig, yaw: YawConfig, view: ViewConfig) -> Self {
        Self { config, view, yaw: YawPlanner::new(yaw), target: None, lookalike: None, side: 1.0 }
    }

    /// A flight begins: what was seen before it is of another one.
    pub fn forget(&mut self) {
        (self.target, self.lookalike) = (None, None);
    }

    /// What a frame of `stamp` shows: the filter's estimate, and what its cells hold.
    pub fn take(&mut self, stamp: Time, target: Option<TargetEstimate>, candidates: &[Candidate]) {
        self.target = target.filter(|t| finite(&t.pos_world) && finite(&t.vel_world));
        self.lookalike = self.beside(stamp, candidates).or(self.lookalike);
    }

    /// Who looks most like the target where that is not believed to be.
    fn beside(&self, stamp: Time, candidates: &[Candidate]) -> Option<Lookalike> {
        let believed = self.target_at(stamp)?.pos;
        let apart = |candidate: &&Candidate| {
            candidate.objectness >= self.config.objectness
                && candidate.target_world.is_some_and(|at| finite(&at) && (at - believed).norm() > APART)
        };
        let seen = candidates.iter().filter(apart).max_by(|a, b| a.objectness.total_cmp(&b.objectness))?;
        let pos_world = seen.target_world?;
        let same = |last: &Lookalike| {
            stamp.since(last.stamp) < LOOKALIKE_LASTS && (pos_world - last.pos_world).norm() < LOOKALIKE_STEP
        };
        let since = self.lookalike.filter(same).map_or(stamp, |last| last.since);
        Some(Lookalike { since, stamp, pos_world })
    }

    /// Moves what is known along: the odometry's frame jumped, the vehicle and the target did not.
    pub fn shift(&mut self, jump: &Jump) {
        if let Some(target) = &mut self.target {
            target.pos_world = jump.seen(&target.pos_world);
            target.vel_world = jump.turned(&target.vel_world);
        }
        if let Some(lookalike) = &mut self.lookalike {
            lookalike.pos_world = jump.seen(&lookalike.pos_world);
        }
        self.yaw.shift(jump.yaw);
    }

    /// The newest target estimate.
    #[must_use]
    pub fn target(&self) -> Option<&TargetEstimate> {
        self.target.as_ref()
    }

    /// The target at `now`, carried on at its velocity; velocity 0 once it is not believed.
    #[must_use]
    pub fn target_at(&self, now: Time) -> Option<FlatState> {
        self.target.map(|t| {
            let vel = if t.confirmed { t.vel_world } else { Vec3::zeros() };
            FlatState { pos: carried(&t, now), vel, acc: Vec3::zeros() }
        })
    }

    /// The target as it may be at its worst.
    #[must_use]
    pub fn threat(&self, now: Time) -> Option<Threat> {
        self.target.as_ref().and_then(|target| Threat::of(target, now))
    }

    /// Who surely looks like the target where that is not believed to be, at its worst: it may be the target, or somebody
    /// else, and neither is flown into.
    #[must_use]
    pub fn lookalike(&self, now: Time) -> Option<Threat> {
        let lookalike = self.lookalike.filter(|s| s.stamp.since(s.since) >= LOOKALIKE_SHOWS)?;
        let hidden_for = now.since(lookalike.stamp).max(0.0);
        (hidden_for < LOOKALIKE_LASTS).then_some(Threat {
            pos_world: lookalike.pos_world,
            vel_world: Vec3::zeros(),
            pos_doubt: LOOKALIKE_DOUBT,
            vel_doubt: 0.0,
            hidden_for,
        })
    }

    /// For how long the target has been hidden, s; none: there is none.
    #[must_use]
    pub fn hidden_for(&self, now: Time) -> Option<f64> {
        self.target.map(|target| hidden_for(target.last_seen, now))
    }

    /// `acc_world` (m/s²) of a vehicle at `pos_world` with as much less of it as keeps the target in the image.
    #[must_use]
    pub fn keeping_in_view(&self, now: Time, acc_world: Vec3, acc_disturbance_world: Vec3, pos_world: Vec3) -> Vec3 {
        self.target_at(now)
            .map_or(acc_world, |target| self.view.keeping(acc_world, acc_disturbance_world, target.pos - pos_world))
    }

    /// The yaw plan, rad.
    #[must_use]
    pub fn yaw(&self) -> f64 {
        self.yaw.yaw()
    }

    /// On the ground the plan follows the vehicle, whose yaw this is, rad.
    pub fn rest(&mut self, yaw: f64) {
        self.yaw.reset(yaw);
    }

    /// `dt` s later, without odometry: the yaw to command, rad.
    pub fn keep(&mut self, dt: f64) -> f64 {
        self.yaw.step(dt, YawGoal::Keep)
    }

    /// `dt` s later: the yaw to command, rad.
    pub fn look(&mut self, now: Time, dt: f64, look: Look, odometry: &Odometry) -> f64 {
        if let Some(target) = self.target.filter(|_| self.hidden_for(now) < Some(hidden::SIDE)) {
            self.side = leaves_to(&target, odometry);
        }
        let goal = self.goal(now, look, odometry);
        self.yaw.step(dt, goal)
    }

    fn goal(&self, now: Time, look: Look, odometry: &Odometry) -> YawGoal {
        let (pos, vel) = (odometry.pos_world, odometry.vel_world);
        match look {
            Look::Keep => YawGoal::Keep,
            Look::Way(place) => along(self.yaw.config(), place - pos, vel),
            Look::Search { around: true } => YawGoal::Sweep(self.side),
            Look::Chase | Look::Hold | Look::Search { .. } => {
                self.target_at(now).map_or(YawGoal::Keep, |target| toward(target.pos - pos, target.vel - vel))
            }
        }
    }
}

/// Where the target is heading, seen from us; else the side where it is.
fn leaves_to(target: &TargetEstimate, odometry: &Odometry) -> f64 {
    let line = target.pos_world - odometry.pos_world;
    let crossing = line.x * target.vel_world.y - line.y * target.vel_world.x;
    let side = (odometry.world_from_body.inverse() * line).y;
    if crossing.abs() > 0.5 * line.xy().norm() { crossing } else { side }
}

fn finite(v: &Vec3) -> bool {
    v.iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::values::types::{Added, Rejection, Rot};

    const YAW: YawConfig = YawConfig {
        max_rate_radps: 2.5,
        max_acc_radps2: 10.0,
        lag_s: 0.0,
        search_rate_radps: 1.0,
        search_delay_s: 1.5,
        along_velocity_speed_mps: 1.0,
    };

    fn target(x: f64) -> TargetEstimate {
        TargetEstimate {
            stamp: Time::from_secs(1.0),
            pos_world: Vec3::new(x, 0.0, 1.0),
            vel_world: Vec3::zeros(),
            covariance: nalgebra::Matrix6::identity(),
            confirmed: true,
            last_seen: Time::from_secs(1.0),
        }
    }

    fn gaze() -> Gaze {
        Gaze::new(GazeConfig { objectness: 0.9 }, YAW, ViewConfig { top: 0.63 })
    }

    fn odometry() -> Odometry {
        Odometry {
            stamp: Time::from_secs(1.0),
            pos_world: Vec3::new(0.0, 0.0, 1.0),
            vel_world: Vec3::zeros(),
            world_from_body: Rot::identity(),
            ang_vel_body: Vec3::zeros(),
            reset_counter: 0,
        }
    }

    fn candidate(objectness: f64, target_world: Vec3) -> Candidate {
        Candidate {
            end: FlatState::default(),
            cost: 0.0,
            added: Added::default(),
            objectness,
            target_world: Some(target_world),
            rejection: Some(Rejection::Cost),
        }
    }

    /// Who is kept away from besides the target after so many frames, `apart` m from it, `later` s after the last.
    fn lookalike(objectness: f64, apart: f64, frames: u32, later: f64) -> Option<Threat> {
        let mut gaze = gaze();
        let mut stamp = Time::from_secs(1.0);
        for frame in 0..frames {
            stamp = Time::from_secs(1.0 + f64::from(frame) / 30.0);
            gaze.take(stamp, Some(target(5.0)), &[candidate(objectness, Vec3::new(5.0, apart, 1.0))]);
        }
        gaze.lookalike(stamp.plus(later))
    }

    #[test]
    fn who_looks_like_the_target_for_some_frames_where_that_is_not_is_kept_away_from_too() {
        let seen = lookalike(0.95, 2.0, 4, 0.1).expect("somebody");
        assert_eq!(seen.pos_world, Vec3::new(5.0, 2.0, 1.0));
        for (objectness, apart, frames, later) in [
            (0.85, 2.0, 4, 0.1),
            (0.95, 1.0, 4, 0.1),
            (0.95, 2.0, 1, 0.0),
            (0.95, 2.0, 4, 0.4),
            (0.95, f64::NAN, 4, 0.1),
        ] {
            assert_eq!(lookalike(objectness, apart, frames, later), None, "{objectness} {apart} {frames} {later}");
        }
        let mut gaze = gaze();
        for (frame, apart) in [2.0, -2.0, 2.0, -2.0].into_iter().enumerate() {
            let stamp = Time::from_secs(1.0 + frame as f64 / 30.0);
            gaze.take(stamp, Some(target(5.0)), &[candidate(0.95, Vec3::new(5.0, apart, 1.0))]);
            assert_eq!(gaze.lookalike(stamp), None, "nobody jumps");
        }
    }

    #[test]
    fn a_hidden_target_is_looked_for_where_it_should_be_and_then_from_the_side_for_which_it_was_heading() {
        let crossing = TargetEstimate { vel_world: Vec3::new(0.0, -3.0, 0.0), ..target(9.0) };
        let mut gaze = gaze();
        gaze.take(crossing.stamp, Some(crossing), &[]);
        gaze.look(crossing.stamp, 0.005, Look::Chase, &odometry());
        assert!(gaze.side < 0.0, "it runs to the right");
        let heading = |hidden: f64, look: Look| gaze.goal(Time::from_secs(1.0 + hidden), look, &odometry());
        let bearing = |hidden: f64| toward(Vec3::new(9.0, -3.0 * hidden, 0.0), crossing.vel_world);
        assert_eq!(heading(0.8, Look::Chase), bearing(0.8));
        assert_eq!(heading(0.8, Look::Search { around: false }), bearing(0.8));
        assert_eq!(heading(3.0, Look::Search { around: true }), YawGoal::Sweep(gaze.side));
    }

    #[test]
    fn how_long_a_target_is_hidden_is_never_negative_and_a_new_flight_knows_of_none() {
        let mut gaze = gaze();
        gaze.take(Time::from_secs(1.0), Some(target(5.0)), &[]);
        assert_eq!(gaze.hidden_for(Time::from_secs(0.5)), Some(0.0));
        assert_eq!(gaze.hidden_for(Time::from_secs(3.0)), Some(2.0));
        gaze.forget();
        assert_eq!((gaze.hidden_for(Time::from_secs(3.0)), gaze.target_at(Time::from_secs(3.0))), (None, None));
    }
}
