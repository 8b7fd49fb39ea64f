//! One thing that is followed, seen from above: a filter of constant velocity.

use crate::planning::movers::Mover;
use crate::values::types::{Flat, Time, Vec3};
use nalgebra::{Matrix2, Matrix4, Vector4};

/// What comes so near before one that is followed is it, m. Chosen by eye.
const AHEAD: f64 = 0.3;
/// Variance of the velocity of what is new, m²/s²: a walker's pace. Chosen by eye.
const ANY_SPEED: f64 = 2.0;
/// What does not yet move, and what does, is forgotten when it was not seen for so long, s. Chosen by eye.
const FORGOTTEN: (f64, f64) = (0.2, 3.0);
/// What should be seen and is not, since something behind it is, is gone after this, s. Chosen by eye.
const GONE: f64 = 0.2;
/// Out of sight its velocity fades with this time constant, s. Chosen by eye.
const FADES: f64 = 0.8;
/// Out of sight its place is in doubt by so much more, m/s, up to this, m. Chosen by eye.
const STRAYS: (f64, f64) = (0.5, 1.0);
/// It moves once it was seen for so long, s, in so many frames, and went so far, m. Chosen by eye.
const PROVEN: (f64, u32, f64) = (0.2, 5, 0.25);
/// Way and velocity differ by no more: the cosine between them, and how often the one pace goes into the other. Tried: the
/// notebook, "What it left".
const STEADY: (f64, f64) = (0.9, 2.0);

/// A place where it was.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Since {
    pub(crate) stamp: Time,
    pub(crate) at: Flat,
    /// In how many frames after that it was where one had looked through.
    pub(crate) new: u32,
    /// And in how many one looked through the place that it left.
    pub(crate) left: u32,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Track {
    pub(crate) stamp: Time,
    /// From where on it is asked how far it went, and from where next.
    pub(crate) since: [Since; 2],
    /// When last, and how often.
    pub(crate) seen: (Time, u32),
    /// Position and velocity.
    state: Vector4<f64>,
    /// Their covariance.
    pub(crate) var: Matrix4<f64>,
    pub(crate) radius: f64,
    pub(crate) moves: bool,
    /// For how long one has looked through where it should be, s.
    gone: f64,
}

impl Track {
    /// `noise`: the covariance of its middle.
    pub(crate) fn new(stamp: Time, middle: Flat, radius: f64, noise: &Matrix2<f64>) -> Self {
        let mut var = Matrix4::from_diagonal_element(ANY_SPEED);
        var.fixed_view_mut::<2, 2>(0, 0).copy_from(noise);
        let state = Vector4::new(middle.x, middle.y, 0.0, 0.0);
        let since = [Since { stamp, at: middle, new: 0, left: 0 }; 2];
        Self { stamp, since, seen: (stamp, 1), state, var, radius, moves: false, gone: 0.0 }
    }

    pub(crate) fn pos(&self) -> Flat {
        self.state.xy()
    }

    pub(crate) fn vel(&self) -> Flat {
        Flat::new(self.state.z, self.state.w)
    }

    fn predict(&mut self, now: Time, restless: f64) {
        let dt = now.since(self.stamp).clamp(0.0, 1.0);
        self.stamp = now;
        let mut step = Matrix4::identity();
        (step[(0, 2)], step[(1, 3)]) = (dt, dt);
        self.state = step * self.state;
        if self.unmatched() > FORGOTTEN.0 {
            let fade = (-dt / FADES).exp();
            (self.state.z, self.state.w) = (self.state.z * fade, self.state.w * fade);
        }
        self.var = step * self.var * step.transpose();
        let (dt2, dt3) = (dt * dt, dt * dt * dt);
        for k in 0..2 {
            self.var[(k, k)] += restless * dt3 / 3.0;
            self.var[(k, k + 2)] += restless * dt2 / 2.0;
            self.var[(k + 2, k)] += restless * dt2 / 2.0;
            self.var[(k + 2, k + 2)] += restless * dt;
        }
    }

    /// Its middle is seen.
    pub(crate) fn correct(&mut self, middle: Flat, noise: &Matrix2<f64>) {
        let sum = self.var.fixed_view::<2, 2>(0, 0) + noise;
        let Some(inverse) = sum.try_inverse() else { return };
        let gain = self.var.fixed_view::<4, 2>(0, 0) * inverse;
        self.state += gain * (middle - self.pos());
        self.var -= gain * sum * gain.transpose();
        self.seen.0 = self.stamp;
        self.gone = 0.0;
    }

    /// What it looks like, in a frame in which all of it is seen.
    pub(crate) fn show(&mut self, radius: f64) {
        self.radius += 0.2 * (radius - self.radius);
        self.seen.1 += 1;
    }

    /// It was seen for long enough to say, and went a way, faster than `min_speed` (m/s).
    pub(crate) fn has_gone(&self, min_speed: f64) -> bool {
        let (time, count, way) = PROVEN;
        let long = self.stamp.since(self.since[0].stamp) >= time && self.seen.1 >= count;
        long && self.went().norm() >= way && self.vel().norm() >= min_speed
    }

    /// How far it went, m.
    pub(crate) fn went(&self) -> Flat {
        self.pos() - self.since[0].at
    }

    /// It went where its velocity leads, about as fast as that says.
    pub(crate) fn is_steady(&self) -> bool {
        let (went, vel) = (self.went(), self.vel());
        let (way, speed) = (went.norm(), vel.norm());
        let pace = way / self.stamp.since(self.since[0].stamp) / speed;
        went.dot(&vel) > STEADY.0 * way * speed && (1.0 / STEADY.1..STEADY.1).contains(&pace)
    }

    /// It is where one had looked through, if `new`. `through`: one looks through a place. Says whether one looks through
    /// the place that it left.
    pub(crate) fn note(&mut self, new: bool, through: impl Fn(&Flat) -> bool) -> bool {
        let left = self.since.map(|since| through(&since.at));
        for (since, left) in self.since.iter_mut().zip(left) {
            since.new += u32::from(new);
            since.left += u32::from(left);
        }
        left[0]
    }

    /// After each `span` (s) it is asked from a later place on how far it went.
    pub(crate) fn ask_anew(&mut self, span: f64) {
        if self.stamp.since(self.since[1].stamp) > span {
            self.since = [self.since[1], Since { stamp: self.stamp, at: self.pos(), new: 0, left: 0 }];
        }
    }

    fn unmatched(&self) -> f64 {
        self.stamp.since(self.seen.0)
    }

    fn is_forgotten(&self) -> bool {
        self.gone > GONE || self.unmatched() > if self.moves { FORGOTTEN.1 } else { FORGOTTEN.0 }
    }

    /// It moves, and the point is where it was in the last frame, or about to be.
    pub(crate) fn covers(&self, at_world: &Vec3) -> bool {
        self.moves && (self.pos() - at_world.xy()).norm() < self.radius + AHEAD
    }

    /// What it is to those who keep away from it, at the height `z` (m); none: it stands.
    pub(crate) fn mover(&self, z: f64) -> Option<Mover> {
        self.moves.then_some(Mover {
            stamp: self.stamp,
            pos_world: Vec3::new(self.state.x, self.state.y, z),
            vel_world: Vec3::new(self.state.z, self.state.w, 0.0),
            radius: self.radius,
            pos_doubt: (STRAYS.0 * self.unmatched()).min(STRAYS.1),
        })
    }
}

/// All of them to `stamp`, with this white noise of the acceleration, m²/s³; those that are gone leave. `through`: one
/// looks through a place.
pub(crate) fn advance(tracks: &mut [Option<Track>], stamp: Time, restless: f64, through: &impl Fn(&Flat) -> bool) {
    for slot in tracks {
        if let Some(track) = slot {
            let dt = stamp.since(track.stamp).clamp(0.0, 1.0);
            track.predict(stamp, restless);
            track.gone = if through(&track.pos()) { track.gone + dt } else { 0.0 };
        }
        *slot = slot.filter(|track| !track.is_forgotten() && track.state.iter().all(|x| x.is_finite()));
    }
}

/// The track to which a middle belongs, none of those that are `taken`, and whether it is within `gate` (m) of it; none:
/// all are taken.
pub(crate) fn nearest(tracks: &[Option<Track>], taken: &[bool], middle: &Flat, gate: f64) -> Option<(usize, bool)> {
    let distance = |k: usize| tracks[k].map_or(f64::INFINITY, |track| (track.pos() - middle).norm());
    let nearest = (0..tracks.len()).filter(|k| !taken[*k]).min_by(|a, b| distance(*a).total_cmp(&distance(*b)))?;
    Some((nearest, distance(nearest) < gate))
}
