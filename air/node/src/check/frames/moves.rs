//! Which way the vehicle was moved by hand, as its odometry tells it, and whether that is what was asked for.

use goshawk_core::{Odometry, Rot, Vec3};

/// It lies still when for so long, s, it stays where it is. Chosen by eye.
const STILL_S: f64 = 0.5;
/// Less than this is staying, rad and m. Chosen by eye.
const STILL: (f64, f64) = (0.04, 0.05);
/// A move begins where it is as level as this, rad: 10°. Chosen by eye.
const LEVEL: f64 = 0.17;
/// Less than this is no move yet, rad and m. Chosen by eye.
const MOVED: (f64, f64) = (0.2, 0.4);
/// A move is the one that was asked for if its direction is as near as this, rad: 35°. Chosen by eye.
const ALIKE: f64 = 0.6;
/// Velocity and rates, added up over a move, may differ from it by so much of it. Chosen by eye.
const ADDED_UP: f64 = 0.5;

/// What a person is asked to do, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Move {
    /// Lie level.
    Level,
    /// Turn about the left axis.
    NoseUp,
    /// Turn about the forward axis.
    RollRight,
    /// Turn about the vertical.
    TurnLeft,
    /// Up.
    Lift,
    /// Where it looks.
    Forward,
    /// To its left.
    Left,
}

/// What is known of a move so far.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Nothing yet.
    Waiting,
    /// It was what was asked for.
    Right(String),
    /// It was something else, by what the odometry says.
    Wrong(String),
}

impl Move {
    /// All, in order.
    pub(super) const ALL: [Move; 7] =
        [Move::Level, Move::NoseUp, Move::RollRight, Move::TurnLeft, Move::Lift, Move::Forward, Move::Left];

    /// In one word or two.
    #[must_use]
    pub(super) fn name(self) -> &'static str {
        match self {
            Move::Level => "level",
            Move::NoseUp => "nose up",
            Move::RollRight => "roll right",
            Move::TurnLeft => "turn left",
            Move::Lift => "lift",
            Move::Forward => "forward",
            Move::Left => "left",
        }
    }

    /// What to do.
    #[must_use]
    pub(super) fn instruction(self) -> &'static str {
        match self {
            Move::Level => "set it down level, and let it lie still",
            Move::NoseUp => "lift its nose by 20°, and hold it there",
            Move::RollRight => "level again; then lower its right side by 20°, and hold it there",
            Move::TurnLeft => "level again; then turn it to the left by 90°, seen from above, and let it lie",
            Move::Lift => "lift it by half a metre or more, level, and hold it there",
            Move::Forward => "carry it forward, where it looks, by half a metre or more, and let it lie",
            Move::Left => "carry it to its left by half a metre or more, and let it lie",
        }
    }

    /// It is a turn: then pictures of before and after tell of the camera.
    #[must_use]
    pub(super) fn is_turn(self) -> bool {
        matches!(self, Move::NoseUp | Move::RollRight | Move::TurnLeft)
    }

    /// The direction of the turn's axis (body) or of the way (body with the heading's yaw alone), and how much of it is
    /// wanted, rad or m.
    fn wanted(self) -> (Vec3, f64) {
        let enough = if self.is_turn() { MOVED.0 } else { MOVED.1 };
        match self {
            Move::Level => (Vec3::z(), 0.0),
            Move::NoseUp => (-Vec3::y(), enough),
            Move::RollRight | Move::Forward => (Vec3::x(), enough),
            Move::TurnLeft => (Vec3::z(), 0.8),
            Move::Lift => (Vec3::z(), enough),
            Move::Left => (Vec3::y(), enough),
        }
    }
}

/// Watches one move.
#[derive(Clone, Debug)]
pub(super) struct Watch {
    asked: Move,
    /// Where it began.
    pub(super) base: Option<Odometry>,
    /// Since when it has been about here.
    here: Option<Odometry>,
    last: Option<Odometry>,
    /// The move as the rates add up to it, about the body's axes, rad,
    turn: Vec3,
    /// and as the velocities do, world frame, m.
    way: Vec3,
}

impl Watch {
    /// Waits for the vehicle to lie still and level first.
    #[must_use]
    pub(super) fn new(asked: Move) -> Self {
        Self { asked, base: None, here: None, last: None, turn: Vec3::zeros(), way: Vec3::zeros() }
    }

    /// Takes a sample.
    pub(super) fn take(&mut self, new: &Odometry) -> Verdict {
        self.add_up(new);
        if !self.still(new) {
            return Verdict::Waiting;
        }
        let tilt = tilt(&new.world_from_body);
        let Some(base) = &self.base else {
            if self.asked == Move::Level {
                return match tilt {
                    tilt if tilt < LEVEL => Verdict::Right(format!("{:.0}° off the vertical", tilt.to_degrees())),
                    tilt => Verdict::Wrong(format!("it says {:.0}° off the vertical", tilt.to_degrees())),
                };
            }
            self.base = Some(*new).filter(|_| tilt < LEVEL);
            return Verdict::Waiting;
        };
        let moved = if self.asked.is_turn() { turned(base, new) } else { carried(base, new) };
        let (direction, enough) = self.asked.wanted();
        let (far, alike) = (moved.norm(), moved.norm() > 0.0 && moved.angle(&direction) < ALIKE);
        let least = if self.asked.is_turn() { MOVED.0 } else { MOVED.1 };
        match (far, alike) {
            (far, _) if far < least => Verdict::Waiting,
            (far, true) if far < enough => Verdict::Waiting,
            (_, true) => self.agrees(base, &moved),
            (_, false) => Verdict::Wrong(format!("it says {}", words(self.asked, &moved))),
        }
    }

    /// Adds velocity and rates up since the vehicle left where it lay: at rest they would add up to their errors.
    fn add_up(&mut self, new: &Odometry) {
        let last = self.last.replace(*new).unwrap_or(*new);
        if self.base.is_none_or(|base| near(&base, new)) {
            (self.turn, self.way) = (Vec3::zeros(), Vec3::zeros());
            return;
        }
        let dt = new.stamp.since(last.stamp);
        self.turn += 0.5 * dt * (last.ang_vel_body + new.ang_vel_body);
        self.way += 0.5 * dt * (last.vel_world + new.vel_world);
    }

    /// The controller flies by velocity and rates as well: a move that was right must be one by them, too.
    fn agrees(&self, base: &Odometry, moved: &Vec3) -> Verdict {
        let (by, added) =
            if self.asked.is_turn() { ("rates", self.turn) } else { ("velocity", of_heading(base, self.way)) };
        let seen = words(self.asked, moved);
        if (added - moved).norm() < ADDED_UP * moved.norm() {
            return Verdict::Right(seen);
        }
        Verdict::Wrong(format!("it says {seen}, and its {by} {}", words(self.asked, &added)))
    }

    fn still(&mut self, new: &Odometry) -> bool {
        let here = self.here.filter(|here| near(here, new)).unwrap_or(*new);
        self.here = Some(here);
        new.stamp.since(here.stamp) >= STILL_S
    }
}

/// It is about where it was.
fn near(here: &Odometry, new: &Odometry) -> bool {
    turned(here, new).norm() < STILL.0 && (new.pos_world - here.pos_world).norm() < STILL.1
}

/// Off the vertical, rad.
#[must_use]
pub(super) fn tilt(world_from_body: &Rot) -> f64 {
    (world_from_body * Vec3::z()).angle(&Vec3::z())
}

/// The turn, as axis times angle in the body frame of before, rad.
#[must_use]
pub(super) fn turned(before: &Odometry, after: &Odometry) -> Vec3 {
    (before.world_from_body.inverse() * after.world_from_body).scaled_axis()
}

/// The way, forward, left and up of the heading of before, m.
fn carried(before: &Odometry, after: &Odometry) -> Vec3 {
    of_heading(before, after.pos_world - before.pos_world)
}

/// A way in the world, forward, left and up of the heading of `before`, m.
fn of_heading(before: &Odometry, way_world: Vec3) -> Vec3 {
    let yaw = before.world_from_body.euler_angles().2;
    Rot::from_axis_angle(&Vec3::z_axis(), -yaw) * way_world
}

/// What the largest part of a move is called.
fn words(asked: Move, moved: &Vec3) -> String {
    let axis = moved.iamax();
    let forth = moved[axis] > 0.0;
    let what = match (asked.is_turn(), axis, forth) {
        (true, 0, true) => "rolled to the right",
        (true, 0, false) => "rolled to the left",
        (true, 1, true) => "nose down",
        (true, 1, false) => "nose up",
        (true, _, true) => "turned to the left",
        (true, _, false) => "turned to the right",
        (false, 0, true) => "forward",
        (false, 0, false) => "backward",
        (false, 1, true) => "to the left",
        (false, 1, false) => "to the right",
        (false, _, true) => "up",
        (false, _, false) => "down",
    };
    if asked.is_turn() {
        format!("{:.0}° {what}", moved.norm().to_degrees())
    } else {
        format!("{:.2} m {what}", moved.norm())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use goshawk_core::Time;

    fn at(s: f64, pos_world: Vec3, world_from_body: Rot) -> Odometry {
        Odometry {
            stamp: Time::from_secs(s),
            pos_world,
            vel_world: Vec3::zeros(),
            world_from_body,
            ang_vel_body: Vec3::zeros(),
            reset_counter: 0,
        }
    }

    /// What is said of a move of a second, after and before a second of rest; heading 130°.
    fn said(asked: Move, turn_body: Vec3, way_heading: Vec3) -> Verdict {
        said_by(asked, turn_body, way_heading, |_| {})
    }

    /// The same of an odometry that `tells` something else.
    fn said_by(asked: Move, turn_body: Vec3, way_heading: Vec3, tells: fn(&mut Odometry)) -> Verdict {
        let heading = Rot::from_euler_angles(0.0, 0.0, 2.27);
        let mut watch = Watch::new(asked);
        for step in 0..300 {
            let part = (f64::from(step) * 0.01 - 1.0).clamp(0.0, 1.0);
            let moves = f64::from(u8::from((100..200).contains(&step)));
            let pose = heading * Rot::from_scaled_axis(turn_body * part);
            let mut told = at(f64::from(step) * 0.01, Vec3::x() + heading * way_heading * part, pose);
            (told.vel_world, told.ang_vel_body) = (heading * way_heading * moves, turn_body * moves);
            tells(&mut told);
            let verdict = watch.take(&told);
            if verdict != Verdict::Waiting {
                return verdict;
            }
        }
        Verdict::Waiting
    }

    fn right(verdict: &Verdict) -> bool {
        matches!(verdict, Verdict::Right(_))
    }

    #[test]
    fn each_move_is_known_and_its_opposite_is_wrong_and_named() {
        let deg = |x: f64, y: f64, z: f64| Vec3::new(x, y, z) * std::f64::consts::PI / 180.0;
        let none = Vec3::zeros();
        let moves = [
            (Move::NoseUp, deg(3.0, -20.0, 2.0), none, "nose down"),
            (Move::RollRight, deg(22.0, -4.0, -5.0), none, "rolled to the left"),
            (Move::TurnLeft, deg(2.0, 3.0, 88.0), none, "turned to the right"),
            (Move::Lift, none, Vec3::new(0.1, 0.1, 0.7), "down"),
            (Move::Forward, none, Vec3::new(0.8, 0.1, -0.1), "backward"),
            (Move::Left, none, Vec3::new(-0.1, 0.6, 0.1), "to the right"),
        ];
        for (asked, turn, way, opposite) in moves {
            assert!(right(&said(asked, turn, way)), "{asked:?}: {:?}", said(asked, turn, way));
            let Verdict::Wrong(text) = said(asked, -turn, -way) else { panic!("{asked:?} the other way") };
            assert!(text.contains(opposite), "{asked:?}: {text}");
            assert_eq!(said(asked, turn * 0.1, way * 0.1), Verdict::Waiting, "hardly moved");
        }
        assert!(right(&said(Move::Level, none, none)));
    }

    #[test]
    fn velocity_and_rates_that_tell_another_move_are_wrong_and_named() {
        let of = |verdict: Verdict, what: &str| {
            let Verdict::Wrong(text) = verdict else { panic!("{what}") };
            assert!(text.contains(what), "{text}");
        };
        let (way, turn) = (Vec3::new(0.7, 0.0, 0.0), Vec3::new(0.0, 0.0, 1.5));
        of(said_by(Move::Forward, Vec3::zeros(), way, |told| told.vel_world *= -1.0), "its velocity 0.6");
        of(said_by(Move::Forward, Vec3::zeros(), way, |told| told.vel_world = told.vel_world.yxz()), "its velocity");
        of(said_by(Move::Lift, Vec3::zeros(), Vec3::z(), |told| told.vel_world.z = 0.0), "its velocity 0.00 m");
        of(said_by(Move::TurnLeft, turn, Vec3::zeros(), |told| told.ang_vel_body *= -1.0), "turned to the right");
        of(said_by(Move::TurnLeft, turn, Vec3::zeros(), |told| told.ang_vel_body *= 57.3), "its rates");
        let rests = |told: &mut Odometry| told.vel_world.x += 0.03;
        assert!(right(&said_by(Move::Forward, Vec3::zeros(), way, rests)), "an error of the estimate");
    }

    #[test]
    fn a_roll_that_shows_as_pitch_is_wrong() {
        assert!(matches!(said(Move::RollRight, Vec3::new(0.0, 0.35, 0.0), Vec3::zeros()), Verdict::Wrong(_)));
        assert!(matches!(said(Move::Forward, Vec3::zeros(), Vec3::new(0.0, -0.7, 0.0)), Verdict::Wrong(_)));
    }

    #[test]
    fn nothing_is_judged_while_it_moves_or_before_it_lay_level() {
        let mut watch = Watch::new(Move::NoseUp);
        for step in 0..300 {
            let turning = Rot::from_euler_angles(0.0, -0.002 * f64::from(step), 0.0);
            assert_eq!(watch.take(&at(f64::from(step) * 0.01, Vec3::zeros(), turning)), Verdict::Waiting);
        }
        let mut watch = Watch::new(Move::NoseUp);
        for step in 0..300 {
            let tilted = Rot::from_euler_angles(0.0, -0.4, 0.0);
            assert_eq!(watch.take(&at(f64::from(step) * 0.01, Vec3::zeros(), tilted)), Verdict::Waiting);
        }
        assert!(watch.base.is_none());
    }
}
