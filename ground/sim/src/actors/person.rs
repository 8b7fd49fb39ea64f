//! The target: a running person of limbs and a head, and how one is dressed.

use crate::world::RoundCone;
use goshawk_core::Vec3;
use rand::{Rng, RngExt};

/// Height of the tracked centre above the ground under the person, m.
pub const CENTRE_M: f64 = 0.95;

/// Height of a person of scale 1, m.
pub const HEIGHT_M: f64 = 1.75;

/// Number of body parts.
pub const BODY_PARTS: usize = 20;

/// Size and clothes; colours in linear light, 0..1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PersonLook {
    /// Of the 1.75 m body, 0.9..1.1.
    pub scale: f64,
    /// Thickness of limbs and torso against the usual, 0.85..1.2.
    pub girth: f64,
    /// Jacket or shirt.
    pub shirt: [f32; 3],
    /// Trousers.
    pub trousers: [f32; 3],
    /// Bare skin.
    pub skin: [f32; 3],
    /// Hair or cap.
    pub hair: [f32; 3],
    /// Shoes.
    pub shoes: [f32; 3],
    /// Forearms bare.
    pub short_sleeves: bool,
    /// Shins bare.
    pub shorts: bool,
}

impl PersonLook {
    /// Draws a person.
    pub fn random<R: Rng>(rng: &mut R) -> Self {
        let skins = [[0.62, 0.42, 0.32], [0.50, 0.32, 0.22], [0.36, 0.21, 0.13], [0.16, 0.09, 0.06]];
        let hairs = [[0.03, 0.02, 0.02], [0.10, 0.06, 0.03], [0.30, 0.22, 0.10], [0.35, 0.34, 0.33], [0.4, 0.06, 0.05]];
        Self {
            scale: rng.random_range(0.9..1.1),
            girth: rng.random_range(0.85..1.2),
            shirt: cloth(0.75, rng),
            trousers: cloth(0.35, rng),
            skin: skins[rng.random_range(0..skins.len())],
            hair: hairs[rng.random_range(0..hairs.len())],
            shoes: cloth(0.3, rng),
            short_sleeves: rng.random_bool(0.45),
            shorts: rng.random_bool(0.3),
        }
    }
}

/// A dye: vivid with probability `vivid`, otherwise grey, black, white or earthen.
fn cloth<R: Rng>(vivid: f64, rng: &mut R) -> [f32; 3] {
    if !rng.random_bool(vivid) {
        let grey = rng.random_range(0.12f32..0.85).powi(2);
        return [grey * rng.random_range(0.85..1.15), grey, grey * rng.random_range(0.8..1.25)];
    }
    let hue = rng.random_range(0.0f32..6.0);
    let value = rng.random_range(0.2f32..0.85);
    let pale = rng.random_range(0.02f32..0.35);
    let ramp = |shift: f32| {
        let h = (hue + shift) % 6.0;
        let pure = ((h - 3.0).abs() - 1.0).clamp(0.0, 1.0);
        value * (pale + (1.0 - pale) * pure)
    };
    [ramp(0.0), ramp(4.0), ramp(2.0)]
}

/// Where a person is and what the limbs do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PersonPose {
    /// The ground point below the centre, world frame.
    pub foot_world: Vec3,
    /// Heading, from east to north, rad.
    pub heading_rad: f64,
    /// Gait phase, rad; a full stride (two steps) is one turn.
    pub phase_rad: f64,
    /// 0 stands, 1 runs.
    pub stride: f64,
}

impl PersonPose {
    /// The tracked centre, world frame.
    #[must_use]
    pub fn centre_world(&self) -> Vec3 {
        self.foot_world + Vec3::new(0.0, 0.0, CENTRE_M)
    }
}

/// A person to be drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Person {
    /// Size and clothes.
    pub look: PersonLook,
    /// Place and posture.
    pub pose: PersonPose,
}

/// One limb.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyPart {
    /// World frame.
    pub cone: RoundCone,
    /// Base colour, linear light.
    pub tint: [f32; 3],
}

impl Person {
    /// The body as round cones, world frame. Feet are never below `foot_world`.
    #[must_use]
    pub fn body(&self) -> [BodyPart; BODY_PARTS] {
        let (look, pose) = (&self.look, &self.pose);
        let run = pose.stride;
        // Body coordinates: forward, left, up from the ground under the hips; metres of a 1.75 m person.
        let left_leg = leg(pose.phase_rad, run);
        let right_leg = leg(pose.phase_rad + std::f64::consts::PI, run);
        let lowest = left_leg.map(|j| j[1]).into_iter().chain(right_leg.map(|j| j[1])).fold(f64::INFINITY, f64::min);
        let hip = -lowest + 0.045;
        let lean = 0.16 * run;
        let up = |h: f64, side: f64, forward: f64| [lean.sin() * h + forward, side, hip + lean.cos() * h];
        let mut body = BodyBuilder { look, pose, parts: [None; BODY_PARTS], count: 0 };

        for (side, joints) in [(0.095, left_leg), (-0.095, right_leg)] {
            let place = |j: [f64; 2]| [j[0], side, hip + j[1]];
            let shin = if look.shorts { look.skin } else { look.trousers };
            body.limb([0.0, side, hip], place(joints[0]), 0.085, 0.06, look.trousers);
            body.limb(place(joints[0]), place(joints[1]), 0.057, 0.042, shin);
            body.limb(place(joints[1]), place(joints[2]), 0.045, 0.04, look.shoes);
        }
        body.limb(up(0.0, 0.06, 0.0), up(0.0, -0.06, 0.0), 0.125, 0.126, look.trousers);
        body.limb(up(0.08, 0.05, 0.0), up(0.40, 0.085, 0.0), 0.11, 0.105, look.shirt);
        body.limb(up(0.08, -0.05, 0.0), up(0.40, -0.085, 0.0), 0.11, 0.105, look.shirt);
        body.limb(up(0.47, 0.145, 0.0), up(0.47, -0.145, 0.0), 0.07, 0.071, look.shirt);
        for (side, phase) in [(1.0, pose.phase_rad + std::f64::consts::PI), (-1.0, pose.phase_rad)] {
            let swing = 0.85 * run * phase.sin() - 0.1 * run;
            let bend = swing + 0.15 + 1.35 * run;
            let shoulder = up(0.47, 0.185 * side, 0.0);
            let elbow = [shoulder[0] + 0.28 * swing.sin(), 0.215 * side, shoulder[2] - 0.28 * swing.cos()];
            let wrist = [elbow[0] + 0.24 * bend.sin(), 0.185 * side, elbow[2] - 0.24 * bend.cos()];
            let hand = [wrist[0] + 0.06 * bend.sin(), 0.18 * side, wrist[2] - 0.06 * bend.cos()];
            body.limb(shoulder, elbow, 0.055, 0.043, look.shirt);
            body.limb(elbow, wrist, 0.042, 0.032, if look.short_sleeves { look.skin } else { look.shirt });
            body.limb(wrist, hand, 0.036, 0.038, look.skin);
        }
        body.limb(up(0.50, 0.0, 0.0), up(0.62, 0.0, 0.015), 0.055, 0.055, look.skin);
        body.limb(up(0.655, 0.0, 0.03), up(0.72, 0.0, 0.025), 0.085, 0.095, look.skin);
        body.limb(up(0.70, 0.0, -0.02), up(0.735, 0.0, -0.005), 0.098, 0.1, look.hair);
        body.limb(up(0.16, 0.0, 0.05), up(0.36, 0.0, 0.055), 0.08, 0.085, look.shirt);
        body.parts.map(|part| part.expect("the body has BODY_PARTS parts"))
    }
}

/// Knee, ankle and toe of one leg, (forward, up) from the hip.
fn leg(phase: f64, run: f64) -> [[f64; 2]; 3] {
    let thigh = run * (0.18 + 0.72 * phase.sin());
    // The knee folds while the thigh swings forward.
    let fold = run * (0.25 + 1.25 * phase.cos().max(0.0));
    let shin = thigh - fold;
    let knee = [0.43 * thigh.sin(), -0.43 * thigh.cos()];
    let ankle = [knee[0] + 0.42 * shin.sin(), knee[1] - 0.42 * shin.cos()];
    let toe = shin + std::f64::consts::FRAC_PI_2 - 0.1;
    [knee, ankle, [ankle[0] + 0.15 * toe.sin(), ankle[1] - 0.15 * toe.cos()]]
}

struct BodyBuilder<'a> {
    look: &'a PersonLook,
    pose: &'a PersonPose,
    parts: [Option<BodyPart>; BODY_PARTS],
    count: usize,
}

impl BodyBuilder<'_> {
    fn limb(&mut self, a: [f64; 3], b: [f64; 3], radius_a: f64, radius_b: f64, tint: [f32; 3]) {
        let (sin, cos) = self.pose.heading_rad.sin_cos();
        let scale = self.look.scale;
        let world = |p: [f64; 3]| {
            self.pose.foot_world + Vec3::new(cos * p[0] - sin * p[1], sin * p[0] + cos * p[1], p[2]) * scale
        };
        let thick = scale * self.look.girth;
        let cone = RoundCone { a: world(a), b: world(b), radius_a: radius_a * thick, radius_b: radius_b * thick };
        self.parts[self.count] = Some(BodyPart { cone, tint });
        self.count += 1;
    }
}
