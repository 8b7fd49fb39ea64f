//! What stands or moves apart: followed from as far as the camera tells one thing from the next.
//!
//! A post that comes at the vehicle fills the place that it leaves, so little of what it does is new. But its middle is
//! seen, to some centimetres across, in each image. What stands is followed, too. What went on steadily moves, if it is
//! where one had looked through, or one looks through the place that it left.

use crate::planning::movers::scan::Thing;
use crate::planning::movers::track::{Track, advance, nearest};
use crate::planning::movers::{Mover, MoversConfig};
use crate::values::types::{Flat, Time, Vec3};
use nalgebra::Matrix2;

/// Followed at once, those that stand included. Chosen by eye.
const FOLLOWED: usize = 48;
/// White noise of a mover's acceleration, m²/s³. Tried: the notebook, "Seen from afar".
const RESTLESS: f64 = 0.7;
/// A thing belongs to what should be within this, m. Chosen by eye.
const GATE: f64 = 0.45;
/// Half a width that differs by more is of something else, or of a part, m. Chosen by eye.
const LIKE: f64 = 0.15;
/// From the middle of what is seen, its surface, to the axis, of half its width. Chosen by eye.
const BEHIND: f64 = 0.5;
/// Standard deviation of a thing's middle along the line of sight, m, and of it for each m², 1/m: the depth's. Chosen by
/// eye.
const ALONG: (f64, f64) = (0.08, 0.004);
/// And across it, m, and for each m: half a beam. Chosen by eye.
const ACROSS: (f64, f64) = (0.04, 0.006);
/// And of one of which a part is hidden, m. Chosen by eye.
const PARTLY: f64 = 0.4;
/// Way and velocity are believed that differ from none by so many standard deviations, squared: three. Tried: the
/// notebook, "Seen from afar".
const SURE: f64 = 9.0;
/// It was in so many frames where one had looked through, or one looked through the place that it left: neither is so
/// of what stands. Tried: the notebook, "Seen from afar".
const NEWS: u32 = 3;
/// Nearer than this, m, its way is believed without, if it is far enough. Tried: the notebook, "What it left".
const NEAR: f64 = 8.5;
/// So far, m, and so much farther for each m that it is away. Tried: there, too.
const FAR: (f64, f64) = (0.15, 0.03);
/// What half its width is less than, m, is a twig. Tried: the notebook, "What it left".
const NARROWEST: f64 = 0.09;
/// How far it went is asked from when it was seen between one and two of this ago, s: a vehicle that passes sees other
/// sides of what stands. Chosen by eye.
const ASKED: f64 = 0.5;

/// Follows things.
#[derive(Clone, Debug)]
pub(crate) struct Apart {
    config: MoversConfig,
    tracks: [Option<Track>; FOLLOWED],
    /// In this frame.
    taken: [bool; FOLLOWED],
}

impl Apart {
    pub(crate) fn new(config: MoversConfig) -> Self {
        Self { config, tracks: [None; FOLLOWED], taken: [false; FOLLOWED] }
    }

    /// The same tracks, from here on by other rules.
    pub(crate) fn with(self, config: MoversConfig) -> Self {
        Self { config, ..self }
    }

    pub(crate) fn reset(&mut self) {
        self.tracks = [None; FOLLOWED];
    }

    /// To the next frame. `through`: one looks through a place.
    pub(crate) fn advance(&mut self, stamp: Time, through: &impl Fn(&Flat) -> bool) {
        advance(&mut self.tracks, stamp, RESTLESS, through);
        self.taken = [false; FOLLOWED];
    }

    /// A thing of this frame belongs to the nearest track, or begins one. `known`: the place was looked through once.
    /// `through`: it is looked through now.
    pub(crate) fn see(
        &mut self,
        stamp: Time,
        cam: &Flat,
        thing: &Thing,
        known: impl Fn(&Flat) -> bool,
        through: impl Fn(&Flat) -> bool,
    ) {
        let away = (thing.surface - cam).try_normalize(1e-3).unwrap_or_default();
        let [least, most] = self.config.radius_m;
        let (middle, radius) = (thing.surface + away * (BEHIND * thing.half), thing.half.clamp(least, most));
        let noise = noise(thing, (middle - cam).norm(), &away);
        let Some((slot, within)) = nearest(&self.tracks, &self.taken, &middle, GATE) else { return };
        if within && let Some(track) = &mut self.tracks[slot] {
            track.correct(middle, &noise);
            self.taken[slot] = true;
            if thing.whole && (track.radius - radius).abs() < LIKE {
                track.show(radius);
                let new = known(&middle);
                let left = track.note(new, &through);
                track.moves |= moves(&self.config, track, thing, (middle - cam).norm(), (new, left), &noise);
                track.ask_anew(ASKED);
            }
        } else if thing.whole
            && let Some(slot) = self.tracks.iter().position(Option::is_none)
        {
            self.tracks[slot] = Some(Track::new(stamp, middle, radius, &noise));
            self.taken[slot] = true;
        }
    }

    pub(crate) fn covers(&self, at_world: &Vec3) -> bool {
        self.tracks.iter().flatten().any(|track| track.covers(at_world))
    }

    /// Those that move, at the height `z` (m).
    pub(crate) fn movers(&self, z: f64) -> impl Iterator<Item = Mover> {
        self.tracks.iter().flatten().filter_map(move |track| track.mover(z))
    }
}

/// The covariance of a thing's middle, which is `range` m `away`.
fn noise(thing: &Thing, range: f64, away: &Flat) -> Matrix2<f64> {
    if !thing.whole {
        return Matrix2::from_diagonal_element(PARTLY * PARTLY);
    }
    let [along, across] = [ALONG.0 + ALONG.1 * range * range, ACROSS.0 + ACROSS.1 * range];
    let sight = away * away.transpose();
    sight * (along * along) + (Matrix2::identity() - sight) * (across * across)
}

/// A thing `range` m away moves: it went on steadily, and it is where one had looked through (`new`), or one looks through
/// the place that it left (`left`).
fn moves(
    config: &MoversConfig,
    track: &Track,
    thing: &Thing,
    range: f64,
    (new, left): (bool, bool),
    noise: &Matrix2<f64>,
) -> bool {
    let went = thing.half > NARROWEST && track.has_gone(config.min_speed_mps) && track.is_steady();
    let far = range < NEAR && track.went().norm() > FAR.0 + FAR.1 * range;
    let [news, leaves] = [track.since[0].new, track.since[0].left].map(|frames| frames >= NEWS);
    went && (new && news && (far || is_sure(track, noise)) || left && leaves && far)
}

fn is_sure(track: &Track, noise: &Matrix2<f64>) -> bool {
    let sure = |x: Flat, var: Matrix2<f64>| var.try_inverse().is_some_and(|inverse| x.dot(&(inverse * x)) > SURE);
    sure(track.vel(), track.var.fixed_view::<2, 2>(2, 2).into_owned())
        && sure(track.went(), track.var.fixed_view::<2, 2>(0, 0) + noise)
}
