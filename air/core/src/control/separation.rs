//! The least distance to the target (beyond the paper): whatever is flown, the vehicle can still stop short of it.
//!
//! Two rules bend a commanded acceleration. The first bounds the speed at which the vehicle closes in: at each distance
//! to what it could brake away before the least distance, if the target were to turn on it with its greatest
//! acceleration. Below the least distance it backs away. The second steps aside, if a target that comes nearer would
//! pass too close: to the side on which it would pass anyway, or to the other if there is more room. Both take the
//! target where the filter's covariance puts it at its worst.

use crate::gaze::threat::{Pace, Threat};
use crate::planning::room::{Room, toward};
use crate::values::types::{Flat, Vec3};
use schemars::JsonSchema;
use serde::Deserialize;

/// How the least distance to the target is kept.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SeparationTuning {
    /// From the target's move to the vehicle's, s: camera, network, filter, attitude loop.
    #[schemars(range(min = 0.05, max = 1.0), extend("x-why" = "no vehicle answers sooner, and one that answers later could not chase", "x-source" = "chosen by eye"))]
    pub reaction_s: f64,
    /// What is aimed at beyond the least distance when stepping aside, m.
    #[schemars(range(min = 0.0, max = 3.0), extend("x-why" = "with more it steps aside from whoever passes", "x-source" = "chosen by eye"))]
    pub aside_margin_m: f64,
    /// Largest acceleration when stepping aside, m/s².
    #[schemars(range(min = 0.5, max = 20.0), extend("x-why" = "less is too slow to get out of the way, and two g is all that tilt gives", "x-source" = "chosen by eye"))]
    pub aside_acc_mps2: f64,
    /// Largest speed when backing away, m/s.
    #[schemars(range(min = 0.1, max = 10.0), extend("x-why" = "with less a walker overtakes it, and the camera does not look back", "x-source" = "chosen by eye"))]
    pub retreat_mps: f64,
}

/// How far to keep, and what both can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeparationConfig {
    /// Least distance from the vehicle's centre to the target's, m (2).
    pub min_distance: f64,
    /// The target's greatest acceleration, m/s² (8),
    pub target_acc: f64,
    /// and what the vehicle may spend on keeping away from it, m/s² (10).
    pub max_acc: f64,
    /// How to keep it.
    pub tuning: SeparationTuning,
}

/// Faster than this nothing is flown, m/s: the most that `limits.max_speed_mps` may be.
const MOST_APPROACH: f64 = 30.0;
/// Steps of Newton's method, at most; they end before at a millimetre. Chosen by eye.
const NEWTON: u32 = 12;
/// Gain on a closing speed that is too high, 1/s. Chosen by eye.
const KV: f64 = 4.0;
/// Nearer than the least distance the vehicle backs away with so much of what is missing, 1/s. Chosen by eye.
const OPENING: f64 = 1.5;
/// A target comes that is faster toward the vehicle than this, m/s. Chosen by eye.
const COMING: f64 = 0.5;
/// The vehicle steps aside from one that would pass within this, s. Chosen by eye.
const FORESEEN: f64 = 1.5;
/// The soonest that stepping aside can be of use, s. Chosen by eye.
const SOONEST: f64 = 0.35;
/// A trajectory backward or aside ends so far before what was seen there, m, braking like this, m/s². Chosen by eye.
const SHORT: (f64, f64) = (0.3, 4.0);
/// A target runs ahead that gets away with more than this at its worst, m/s. Tried: the notebook, "Held back, and let
/// go".
const AHEAD: f64 = 1.0;
/// A push brakes that points so far against the vehicle's own way, as the cosine between them. Tried: there, too.
const BRAKES: f64 = -0.5;
/// A slower vehicle goes nowhere, m/s. Chosen by eye.
const CREEPS: f64 = 0.3;
/// Who is so much higher than a target's centre, m, is above it: over a person's head. Chosen by eye.
const ABOVE: f64 = 1.2;
/// Unseen below the vehicle, the target strolls off, m/s: a walker's pace.
const STROLLS: f64 = 1.5;

/// Keeps the distance.
#[derive(Clone, Copy, Debug, Default)]
pub struct Separation {
    /// The side of the relative velocity to which the vehicle steps aside, +1 left, -1 right; 0: it does not.
    side: f64,
    pace: Pace,
}

impl SeparationConfig {
    /// The greatest speed (m/s) at which to fly at a target that may come `gap` m nearer, comes at `comes` m/s and gets no
    /// faster than `fastest`, and by how much it falls with the gap, 1/s. Negative: back away.
    #[must_use]
    pub fn approach(&self, gap: f64, comes: f64, fastest: f64) -> (f64, f64) {
        let (mut speed, mut slope) = (MOST_APPROACH, 0.0);
        // What is lost is convex in the speed, and falls with it by the time that it takes: Newton's steps never pass it.
        for _ in 0..NEWTON {
            let (lost, time) = self.lost(speed, comes, fastest);
            let excess = lost - gap.max(0.0);
            if excess <= 1e-3 || time <= 1e-3 {
                break;
            }
            slope = 1.0 / time.max(self.tuning.reaction_s);
            speed -= excess / time;
        }
        let opening = (OPENING * gap).min(0.0);
        ((speed + opening).max(-self.tuning.retreat_mps), slope)
    }

    /// How much nearer a target comes that is flown at with `speed` until both part, m, and how long that takes, s: it
    /// speeds up at once, from `comes` to `fastest`, and the vehicle brakes when it has reacted.
    fn lost(&self, speed: f64, comes: f64, fastest: f64) -> (f64, f64) {
        let full = (fastest - comes).max(0.0) / self.target_acc;
        let reaction = self.tuning.reaction_s;
        let (mut closing, mut lost, mut time) = (speed + comes, 0.0, 0.0);
        for end in [full.min(reaction), full.max(reaction), f64::INFINITY] {
            let runs = if time < full { self.target_acc } else { 0.0 };
            let brakes = if time < reaction { 0.0 } else { self.max_acc };
            let acc = runs - brakes;
            let parts = if acc < 0.0 { (closing / -acc).max(0.0) } else { f64::INFINITY };
            let lasts = (end - time).min(parts);
            if !lasts.is_finite() {
                return (f64::INFINITY, f64::INFINITY);
            }
            lost += (closing + 0.5 * acc * lasts) * lasts;
            closing += acc * lasts;
            time += lasts;
            if time < end {
                break;
            }
        }
        (lost, time)
    }

    /// `acc_world` (m/s²) of a vehicle at `pos_world` with `vel_world`: above a target, whom the camera does not see
    /// there, it comes down no nearer than the least distance.
    #[must_use]
    pub fn stay_above(&self, acc_world: Vec3, [pos_world, vel_world]: [Vec3; 2], threat: &Threat) -> Vec3 {
        let (between, least) = (pos_world - threat.pos_world, self.min_distance + threat.pos_doubt);
        if between.z < ABOVE || between.xy().norm() > least + STROLLS * threat.hidden_for {
            return acc_world;
        }
        let sinks = (OPENING * (between.z - least)).max(0.0);
        Vec3::new(acc_world.x, acc_world.y, acc_world.z.max(KV * (-sinks - vel_world.z)))
    }

    /// The least level distance between two that are `rise` m apart in height, m. The doubt is level, since nobody runs up,
    /// and counts for nothing from the least distance on.
    fn level(&self, doubt: f64, rise: f64) -> f64 {
        let share = 1.0 - (rise / self.min_distance).powi(2);
        (self.min_distance + doubt) * share.max(0.0).sqrt()
    }
}

impl Separation {
    /// `acc_world` (m/s²) of a vehicle at `pos_world` with `vel_world`, bent as far as the threat asks for. Level only;
    /// not finite in any part: as it was.
    #[must_use]
    pub fn keep(
        &mut self,
        config: &SeparationConfig,
        dt: f64,
        acc_world: Vec3,
        [pos_world, vel_world]: [Vec3; 2],
        threat: &Threat,
        room: Option<&Room>,
    ) -> Vec3 {
        let between = pos_world - threat.pos_world;
        let line: Flat = between.xy();
        let distance = line.norm();
        let Some(away) = line.try_normalize(1e-3) else { return acc_world };
        let least = config.level(threat.pos_doubt, between.z);
        if least == 0.0 {
            return acc_world;
        }
        self.pace.step(dt, threat);
        let target = self.pace.worst(threat, config.target_acc, &away);
        let relative: Flat = vel_world.xy() - target;
        let flat: Flat = acc_world.xy();
        let backed = back(config, flat, (away, distance, least), [relative, target], self.pace.fastest());
        let coming = target.dot(&away) > COMING;
        let aside = if coming { self.aside(&config.tuning, least, line, relative, room) } else { None };
        self.side = aside.map_or(0.0, |(side, _)| side);
        let bent = match aside {
            Some((_, push)) => {
                let toward = push.normalize();
                backed + toward * (push.norm() - backed.dot(&toward)).max(0.0)
            }
            None => backed,
        };
        let held = target.dot(&away) < -AHEAD;
        let within = if bent == flat { flat } else { within_room(bent, flat, vel_world.xy(), room, held) };
        // What was commanded may be more than this rule may spend.
        let most = config.max_acc.max(flat.norm());
        let within = within * (most / within.norm().max(most));
        if within.iter().all(|x| x.is_finite()) { Vec3::new(within.x, within.y, acc_world.z) } else { acc_world }
    }

    /// The side and the acceleration that let a target pass at the least distance; none: it will.
    fn aside(
        &self,
        tuning: &SeparationTuning,
        least: f64,
        line: Flat,
        relative: Flat,
        room: Option<&Room>,
    ) -> Option<(f64, Flat)> {
        let speed = relative.norm();
        let soon = -line.dot(&relative) / relative.norm_squared();
        if !(soon > 0.0 && soon < FORESEEN) {
            return None;
        }
        let left = Flat::new(-relative.y, relative.x) / speed;
        let offset = (line + relative * soon).dot(&left);
        let passes = least + tuning.aside_margin_m;
        if offset.abs() >= passes {
            return None;
        }
        let side = if self.side == 0.0 { chosen_side(offset, passes, left, room) } else { self.side };
        let missing = passes - side * offset;
        let push = (2.0 * missing / soon.max(SOONEST).powi(2)).min(tuning.aside_acc_mps2);
        Some((side, left * (side * push)))
    }
}

/// Closes in no faster than can be braked; too near, opens.
fn back(
    config: &SeparationConfig,
    flat: Flat,
    (away, distance, least): (Flat, f64, f64),
    [relative, target]: [Flat; 2],
    fastest: f64,
) -> Flat {
    let closing = -relative.dot(&away);
    let comes = target.dot(&away);
    let (allowed, slope) = config.approach(distance - least, comes, fastest);
    // Along the bound itself, the speed falls as the distance does.
    let along_bound = slope * closing.max(0.0);
    // Who passes by opens without braking.
    let passing = (relative + away * closing).norm_squared() / distance.max(0.5 * least).max(0.1);
    let wanted = KV * (closing - comes - allowed) + along_bound - passing;
    flat + away * (wanted - flat.dot(&away)).max(0.0)
}

/// Left (+1) or right (-1) of the relative velocity: the nearer way out, unless something stands in it and there is more
/// room on the other side.
fn chosen_side(offset: f64, passes: f64, left: Flat, room: Option<&Room>) -> f64 {
    let natural = if offset < 0.0 { -1.0 } else { 1.0 };
    let Some(room) = room else { return natural };
    let missing = |side: f64| (passes - side * offset) - toward(room, &(left * side));
    if missing(natural) > 0.0 && missing(-natural) < missing(natural) { -natural } else { natural }
}

/// What a push adds to the commanded acceleration `flat` must not fly into something, nor keep the vehicle from flying
/// around it: along the push, and along its own way, the vehicle gets no faster than it can brake in the room that is
/// left. A push that brakes behind who runs ahead (`held`) needs none.
fn within_room(bent: Flat, flat: Flat, vel: Flat, room: Option<&Room>, held: bool) -> Flat {
    let (Some(room), Some(push)) = (room, (bent - flat).try_normalize(1e-6)) else { return bent };
    let most = |way: &Flat| {
        let left = (toward(room, way) - SHORT.0).max(0.0);
        KV * ((2.0 * SHORT.1 * left).sqrt() - vel.dot(way))
    };
    let slowed = bent - push * (bent.dot(&push) - most(&push).max(flat.dot(&push))).max(0.0);
    let brakes = |ahead: &Flat| held && push.dot(ahead) < BRAKES;
    let Some(ahead) = vel.try_normalize(CREEPS).filter(|ahead| !brakes(ahead)) else { return slowed };
    slowed - ahead * (slowed.dot(&ahead) - most(&ahead)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::room::{FARTHEST_ROOM, HEADINGS};
    use crate::shipped;
    use proptest::prelude::*;

    fn config() -> SeparationConfig {
        let tuning = shipped::tuning().separation;
        SeparationConfig { min_distance: 2.0, target_acc: 8.0, max_acc: 10.0, tuning }
    }

    fn threat(pos_world: Vec3, vel_world: Vec3) -> Threat {
        Threat { pos_world, vel_world, pos_doubt: 0.0, vel_doubt: 0.0, hidden_for: 0.0 }
    }

    /// One step of a fresh rule for a vehicle in the origin.
    fn keep(acc: Vec3, vel: Vec3, threat: &Threat, room: Option<&Room>) -> Vec3 {
        Separation::default().keep(&config(), 0.005, acc, [Vec3::zeros(), vel], threat, room)
    }

    /// The least distance of a vehicle that would fly at the target with all it has, from 8 m behind it. `flee` gives
    /// the target's acceleration along the line, m/s²; it runs at 5 m/s at most.
    fn least_distance(flee: impl Fn(f64) -> f64) -> f64 {
        let (mut rule, dt) = (Separation::default(), 0.005);
        let (mut pos, mut vel, mut acc) = (Vec3::zeros(), Vec3::x() * 5.0, Vec3::zeros());
        let mut target = threat(Vec3::x() * 8.0, Vec3::x() * 5.0);
        let mut least = f64::INFINITY;
        for step in 0..1600 {
            let wanted = rule.keep(&config(), dt, (Vec3::x() * 9.0 - vel) * 2.0, [pos, vel], &target, None);
            acc += (wanted - acc) * (dt / 0.08);
            vel += acc * dt;
            pos += vel * dt;
            target.vel_world.x = (target.vel_world.x + flee(f64::from(step) * dt) * dt).clamp(-5.0, 5.0);
            target.pos_world += target.vel_world * dt;
            least = least.min((pos - target.pos_world).norm());
        }
        least
    }

    #[test]
    fn a_target_that_runs_stops_or_turns_back_is_never_touched() {
        let runs = least_distance(|_| 0.0);
        let stops = least_distance(|t| if (2.0..3.0).contains(&t) { -5.0 } else { 0.0 });
        let turns = least_distance(|t| if t < 2.0 { 0.0 } else { -5.0 });
        assert!(runs > 2.0 && stops > 2.0 && turns > 1.5, "{runs} {stops} {turns}");
    }

    #[test]
    fn the_speed_at_which_it_may_be_approached_is_what_reaction_and_braking_leave() {
        let speed = |gap: f64, comes: f64, fastest: f64| config().approach(gap, comes, fastest).0;
        // It stands and stays: v * 0.25 s + v² / 20 is the gap.
        assert!((speed(3.0, 0.0, 0.0) - 5.6394).abs() < 0.01, "{}", speed(3.0, 0.0, 0.0));
        // It comes as fast as it can: the same, counted from its own speed.
        assert!((speed(3.0, 4.0, 4.0) - 1.6394).abs() < 0.01);
        assert!(speed(3.0, 0.0, 4.0) < speed(3.0, 0.0, 0.0), "it may begin to come");
        assert!(speed(3.0, -4.0, 4.0) > speed(3.0, 0.0, 4.0), "it must turn first");
        assert!(speed(0.0, 3.0, 3.0) < -2.9 && speed(-1.0, 0.0, 2.0) < -1.0);
        // What the speed loses with the gap is what the two speeds say.
        let (at, slope) = config().approach(3.0, 0.0, 4.0);
        assert!((speed(3.01, 0.0, 4.0) - at - 0.01 * slope).abs() < 2e-3, "{slope}");
    }

    #[test]
    fn far_off_nothing_changes_and_too_near_the_vehicle_backs_away() {
        let acc = Vec3::new(3.0, 1.0, 0.5);
        assert_eq!(keep(acc, Vec3::x() * 3.0, &threat(Vec3::x() * 30.0, Vec3::zeros()), None), acc);
        let backs = keep(acc, Vec3::zeros(), &threat(Vec3::x() * 1.5, Vec3::zeros()), None);
        assert!(backs.x < 0.0 && backs.y == acc.y && backs.z == acc.z, "{backs}");
        let doubtful = Threat { pos_doubt: 0.8, ..threat(Vec3::x() * 2.5, Vec3::zeros()) };
        assert!(keep(Vec3::zeros(), Vec3::zeros(), &doubtful, None).x < 0.0, "it may be nearer");
    }

    #[test]
    fn it_steps_out_of_the_way_of_who_comes_to_the_side_where_there_is_room() {
        let comes = threat(Vec3::new(4.0, -0.2, 0.0), Vec3::x() * -5.0);
        assert!(keep(Vec3::zeros(), Vec3::zeros(), &comes, None).y > 1.0, "the nearer way out");
        let mut room = [FARTHEST_ROOM; HEADINGS];
        room[HEADINGS / 4] = 0.5;
        assert!(keep(Vec3::zeros(), Vec3::zeros(), &comes, Some(&room)).y < -1.0, "something stands there");
    }

    #[test]
    fn who_is_held_back_needs_no_room_ahead_and_who_steps_aside_does() {
        let mut room = [FARTHEST_ROOM; HEADINGS];
        room[0] = 1.5;
        let swift = Vec3::x() * 6.0;
        let held = |room| keep(Vec3::x() * 5.0, swift, &threat(Vec3::x() * 6.5, Vec3::x() * 6.0), room);
        assert!(held(None).x < 4.0 && held(None).x > -9.0, "it may come no nearer: {}", held(None));
        assert_eq!(held(Some(&room)), held(None));
        let aside = |room| keep(Vec3::zeros(), swift, &threat(Vec3::new(9.0, -0.2, 0.0), Vec3::x() * -1.0), room);
        assert!(
            aside(None).y > 0.5 && aside(Some(&room)).x < aside(None).x - 1.0,
            "{} {}",
            aside(None),
            aside(Some(&room))
        );
    }

    #[test]
    fn nobody_comes_down_on_a_target_nor_on_where_it_may_have_gone_unseen() {
        let sinking = [Vec3::new(0.0, 0.0, 3.0), -Vec3::z()];
        let stay = |threat: &Threat| config().stay_above(-Vec3::z(), sinking, threat).z;
        let below = threat(Vec3::new(1.0, 0.0, 1.2), Vec3::zeros());
        assert!(stay(&below) > 3.0, "it is less than the least distance above it");
        assert_eq!(stay(&threat(Vec3::new(1.0, 0.0, 0.0), Vec3::zeros())), -1.0, "it may come down to that");
        let beside = threat(Vec3::new(5.0, 0.0, 1.2), Vec3::zeros());
        assert_eq!(stay(&beside), -1.0);
        assert!(stay(&Threat { hidden_for: 3.0, ..beside }) > 3.0);
        assert_eq!(stay(&threat(Vec3::new(1.0, 0.0, 2.5), Vec3::zeros())), -1.0, "the two are level");
    }

    #[test]
    fn who_flies_above_the_target_is_free() {
        let below = Threat { pos_doubt: 0.8, ..threat(Vec3::new(0.5, 0.0, -2.1), Vec3::zeros()) };
        assert_eq!(keep(Vec3::x(), Vec3::zeros(), &below, None), Vec3::x());
        let beside = Threat { pos_world: Vec3::new(0.5, 0.0, -1.0), ..below };
        assert!(keep(Vec3::x(), Vec3::zeros(), &beside, None).x < -4.0);
    }

    proptest! {
        #[test]
        fn it_asks_for_what_can_be_flown_and_never_vertically(
            acc in prop::array::uniform3(-15.0..15.0f64), vel in prop::array::uniform3(-15.0..15.0f64),
            at in prop::array::uniform3(-9.0..9.0f64), of in prop::array::uniform3(-9.0..9.0f64),
        ) {
            let acc = Vec3::from(acc);
            let kept = keep(acc, Vec3::from(vel), &threat(Vec3::from(at), Vec3::from(of)), None);
            prop_assert_eq!(kept.z, acc.z);
            prop_assert!(kept.xy().norm() <= acc.xy().norm().max(config().max_acc) + 1e-9);
        }

        #[test]
        fn any_input_gives_a_finite_answer_or_what_was_asked(bits in prop::array::uniform12(any::<u64>())) {
            let v = |k: usize| Vec3::from_fn(|i, _| f64::from_bits(bits[k + i]));
            let kept = Separation::default().keep(&config(), 0.005, v(0), [v(3), v(6)], &threat(v(9), v(6)), None);
            let above = config().stay_above(v(0), [v(3), v(6)], &threat(v(9), v(6)));
            prop_assert!(above.z >= v(0).z || v(0).z.is_nan());
            prop_assert!(kept.xy().iter().all(|x| x.is_finite()) || kept == v(0) || v(0).iter().any(|x| x.is_nan()));
        }
    }
}
