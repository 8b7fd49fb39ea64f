//! Who is chased in real time. It runs while the vehicle follows, waits for one that has fallen behind, and comes back to
//! one that does not come. Near a vehicle that has landed it stands anew, for another run.

use std::f64::consts::{FRAC_PI_4, PI};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use goshawk_core::{Time, Vec3};

use crate::actors::evader::{Course, Evader, EvaderConfig, EvaderState};
use crate::actors::person::Person;
use crate::sense::rgbd::mix;
use crate::trial::Scene;
use crate::trial::rule::FAR_M;
use crate::vehicle::quadrotor::QuadrotorState;

/// Who stands still does not follow, m/s. Chosen by eye.
const FOLLOWS_MPS: f64 = 1.0;
/// It waits for so long before it comes back, s. Chosen by eye.
const PATIENCE_S: f64 = 5.0;
/// It comes back to within this, in sight of the vehicle, m. Chosen by eye.
const NEAR_M: f64 = 8.0;
/// It comes back at this share of its speed. Chosen by eye.
const BACK: f64 = -0.5;
/// A vehicle that has stood on the ground for so long has landed, s.
const LANDED_S: f64 = 1.0;
/// Another run leads where the vehicle looks, else ever more to its sides, rad …
const BEARINGS_RAD: [f64; 8] =
    [0.0, FRAC_PI_4, -FRAC_PI_4, 2.0 * FRAC_PI_4, -2.0 * FRAC_PI_4, 3.0 * FRAC_PI_4, -3.0 * FRAC_PI_4, PI];
/// … and where the world has no room for it, it is this share of the first one's length.
const SHARES: [f64; 3] = [1.0, 0.7, 0.4];

/// What it is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Doing {
    /// It has not begun to run.
    Stands,
    Runs,
    /// For the vehicle, since then.
    Waits(Time),
    ComesBack,
}

/// Another run, from where the vehicle has landed.
enum Another {
    NotWanted,
    /// In a thread of its own: it takes longer than a step of physics.
    Planned(JoinHandle<Option<Evader>>),
    /// There is no room for one here.
    None,
}

/// The target of one simulation.
pub(super) struct Target {
    scene: Arc<Scene>,
    config: EvaderConfig,
    seed: u64,
    evader: Option<Evader>,
    doing: Doing,
    /// Where in its timetable it is, s.
    at_s: f64,
    /// So fast it goes through it: 1 runs, 0 stands, less goes back.
    pace: f64,
    before: Time,
    grounded: Option<Time>,
    another: Another,
    runs: u64,
}

impl Target {
    /// The scene's own, if it has one, that runs `distance_m` at `speed_mps`.
    pub(super) fn new(
        scene: Arc<Scene>,
        course: Course,
        distance_m: f64,
        speed_mps: f64,
        seed: u64,
        now: Time,
    ) -> Self {
        Self {
            config: EvaderConfig { course, goal_m: distance_m, ..EvaderConfig::at_speed(speed_mps) },
            seed,
            evader: scene.evader.clone(),
            scene,
            doing: Doing::Stands,
            at_s: 0.0,
            pace: 0.0,
            before: now,
            grounded: None,
            another: Another::NotWanted,
            runs: 0,
        }
    }

    /// It may begin to run.
    pub(super) fn release(&mut self) {
        if self.doing == Doing::Stands {
            (self.doing, self.pace) = (Doing::Runs, 1.0);
        }
    }

    /// It has begun to run, and stands for no other run yet.
    pub(super) fn has_begun(&self) -> bool {
        self.doing != Doing::Stands
    }

    /// Lets time go in which nothing moves, ns.
    pub(super) fn skip(&mut self, skipped_ns: u64) {
        let later = |at: Time| Time(at.0 + skipped_ns);
        (self.before, self.grounded) = (later(self.before), self.grounded.map(later));
        if let Doing::Waits(since) = self.doing {
            self.doing = Doing::Waits(later(since));
        }
    }

    /// Moves it on to `now`.
    pub(super) fn advance(&mut self, now: Time) {
        let dt_s = now.since(self.before);
        self.before = now;
        let Some(evader) = &self.evader else { return };
        let wanted = match self.doing {
            Doing::Runs => 1.0,
            Doing::Stands | Doing::Waits(_) => 0.0,
            Doing::ComesBack => BACK,
        };
        let most = self.config.acc_mps2 / self.config.speed_mps * dt_s;
        self.pace += (wanted - self.pace).clamp(-most, most);
        self.at_s = (self.at_s + self.pace * dt_s).clamp(0.0, evader.duration_s());
    }

    /// So fast time goes for what moves beside it. Its first run was planned among them: they wait with it, so that they
    /// never meet.
    pub(super) fn pace_of_movers(&self) -> f64 {
        let among_them = |evader: &&Evader| self.runs == 0 && self.at_s < evader.duration_s();
        self.evader.as_ref().filter(among_them).map_or(1.0, |_| self.pace)
    }

    /// Looks where the vehicle is, and chooses what to do.
    pub(super) fn decide(&mut self, now: Time, vehicle: &QuadrotorState) {
        let Some(state) = self.state() else { return };
        let centre = state.centre_world();
        let away_m = (centre - vehicle.pos_world).norm();
        let hidden = || self.scene.world.occluded(&vehicle.pos_world, &centre);
        self.doing = match self.doing {
            Doing::Runs if away_m > FAR_M => Doing::Waits(now),
            Doing::Waits(_) if away_m < FAR_M && vehicle.vel_world.norm() > FOLLOWS_MPS => Doing::Runs,
            Doing::Waits(since) if now.since(since) > PATIENCE_S && (away_m > NEAR_M || hidden()) => Doing::ComesBack,
            Doing::ComesBack if away_m < NEAR_M && !hidden() || self.at_s <= 0.0 => Doing::Waits(now),
            doing => doing,
        };
        self.begin_anew(now, vehicle);
    }

    /// Near a vehicle that has landed it stands anew.
    fn begin_anew(&mut self, now: Time, vehicle: &QuadrotorState) {
        self.grounded = vehicle.on_ground.then(|| self.grounded.unwrap_or(now));
        let landed = self.grounded.is_some_and(|since| now.since(since) >= LANDED_S);
        match std::mem::replace(&mut self.another, Another::NotWanted) {
            Another::Planned(thread) if thread.is_finished() => {
                if let Ok(Some(evader)) = thread.join() {
                    (self.evader, self.doing, self.at_s, self.pace) = (Some(evader), Doing::Stands, 0.0, 0.0);
                    super::say("the target stands near the vehicle, for another run");
                } else {
                    self.another = Another::None;
                    super::say("the target stays: no way leads on from where the vehicle has landed");
                }
            }
            Another::NotWanted if landed && self.doing != Doing::Stands => {
                self.runs += 1;
                self.another = self.plan(*vehicle);
            }
            Another::None if !landed => {}
            another => self.another = another,
        }
    }

    fn plan(&self, vehicle: QuadrotorState) -> Another {
        let (scene, config, seed) = (Arc::clone(&self.scene), self.config.clone(), mix(self.seed, 20 + self.runs));
        let planned = thread::Builder::new().name("target".to_owned()).spawn(move || {
            let world = &scene.world;
            let (at, (_, _, heading_rad)) = (vehicle.pos_world, vehicle.world_from_body.euler_angles());
            let foot_world = Vec3::new(at.x, at.y, world.ground_height(at.x, at.y));
            SHARES.iter().find_map(|share| {
                let config = EvaderConfig { goal_m: share * config.goal_m, ..config.clone() };
                let toward = |bearing| Evader::plan(world, &config, foot_world, heading_rad + bearing, seed).ok();
                BEARINGS_RAD.into_iter().find_map(toward)
            })
        });
        planned.map_or(Another::None, Another::Planned)
    }

    /// Where it is; none: nobody runs.
    pub(super) fn state(&self) -> Option<EvaderState> {
        let evader = self.evader.as_ref()?;
        let begun = self.doing != Doing::Stands;
        let mut state = evader.at(&self.scene.world, if begun { self.at_s } else { -1.0 });
        state.vel_world *= self.pace;
        state.pose.stride = (state.vel_world.norm() / 2.5).min(1.0);
        if self.pace < 0.0 {
            state.pose.heading_rad += PI;
        }
        Some(state)
    }

    /// The person to draw.
    pub(super) fn person(&self) -> Option<Person> {
        let look = *self.evader.as_ref()?.look();
        self.state().map(|state| Person { look, pose: state.pose })
    }
}

#[cfg(test)]
mod tests {
    use goshawk_core::Rot;

    use super::*;
    use crate::actors::moving::clearance;
    use crate::trial::{SceneConfig, WorldSource};

    const TICK_S: f64 = 0.01;

    struct Stage {
        target: Target,
        now: Time,
        vehicle: QuadrotorState,
    }

    /// A target that runs, and a vehicle behind it.
    fn stage() -> Stage {
        stage_among(0)
    }

    /// The same among so many that move.
    fn stage_among(moving: usize) -> Stage {
        let config = SceneConfig {
            seed: 3,
            world: WorldSource::Forest { spacing_m: 5.0 },
            distance_m: 60.0,
            evader: Some((Course::Goal, 3.0)),
            moving,
        };
        let scene = Arc::new(Scene::new(&config).unwrap());
        let vehicle = QuadrotorState {
            pos_world: scene.world.start_world() + Vec3::new(0.0, 0.0, 1.5),
            vel_world: Vec3::new(3.0, 0.0, 0.0),
            acc_world: Vec3::zeros(),
            world_from_body: Rot::identity(),
            ang_vel_body: Vec3::zeros(),
            on_ground: false,
        };
        let mut target = Target::new(scene, Course::Goal, 60.0, 3.0, 3, Time(0));
        target.release();
        Stage { target, now: Time(0), vehicle }
    }

    impl Stage {
        /// Goes on for so long; the vehicle flies `gap_m` behind the target, or stands where it is.
        fn run(&mut self, seconds: f64, gap_m: Option<f64>) -> EvaderState {
            for _ in 0..(seconds / TICK_S) as usize {
                self.now = self.now.plus(TICK_S);
                self.target.advance(self.now);
                if let Some(gap_m) = gap_m {
                    let state = self.target.state().unwrap();
                    let back = Vec3::new(state.pose.heading_rad.cos(), state.pose.heading_rad.sin(), 0.0) * gap_m;
                    self.vehicle.pos_world = state.centre_world() - back;
                }
                self.target.decide(self.now, &self.vehicle);
            }
            self.target.state().unwrap()
        }

        fn away_m(&self) -> f64 {
            (self.target.state().unwrap().centre_world() - self.vehicle.pos_world).norm()
        }
    }

    #[test]
    fn it_waits_for_a_vehicle_that_stays_behind_comes_back_into_its_sight_and_runs_on_with_it() {
        let mut stage = stage();
        assert!(stage.run(5.0, Some(6.0)).path_m > 10.0, "it runs with who follows");
        stage.vehicle.vel_world = Vec3::zeros();
        let waits = stage.run(5.0, None);
        assert!(waits.vel_world.norm() < 1e-9 && (FAR_M..FAR_M + 3.0).contains(&stage.away_m()), "{}", stage.away_m());
        let back = stage.run(30.0, None);
        let seen = !stage.target.scene.world.occluded(&stage.vehicle.pos_world, &back.centre_world());
        assert!(back.path_m < waits.path_m && stage.away_m() < NEAR_M && seen && back.vel_world.norm() < 1e-9);
        stage.vehicle.vel_world = Vec3::new(3.0, 0.0, 0.0);
        assert!(stage.run(30.0, Some(6.0)).arrived);
    }

    #[test]
    fn who_waits_and_comes_back_among_what_moves_never_meets_it() {
        let mut stage = stage_among(12);
        let (mut moved_s, mut nearest_m, mut in_step) = (0.0, [f64::INFINITY; 2], true);
        for tick in 0..40_000 {
            let follows = tick / 1_000 % 3 == 0;
            stage.vehicle.vel_world = Vec3::new(if follows { 3.0 } else { 0.0 }, 0.0, 0.0);
            let now = stage.run(TICK_S, follows.then_some(6.0));
            moved_s += stage.target.pace_of_movers() * TICK_S;
            for (of, since_s) in [moved_s, stage.now.0 as f64 * 1e-9].into_iter().enumerate() {
                let parts = stage.target.scene.moving_at(since_s);
                nearest_m[of] = nearest_m[of].min(clearance(&parts, &now.centre_world()));
            }
            in_step &= now.arrived || (moved_s - stage.target.at_s).abs() < 1e-6;
        }
        assert!(in_step && nearest_m[0] > 0.5, "{nearest_m:?}");
        assert!(nearest_m[1] < 0.3, "they would have met, had they moved on: {nearest_m:?}");
    }

    #[test]
    fn before_a_vehicle_that_has_landed_it_stands_anew_and_runs_again() {
        let mut stage = stage();
        assert!(stage.run(40.0, Some(5.0)).arrived);
        stage.vehicle.on_ground = true;
        while stage.target.doing != Doing::Stands && !matches!(stage.target.another, Another::None) {
            stage.run(0.1, None);
        }
        let stands = stage.target.state().unwrap();
        assert_eq!(stage.target.doing, Doing::Stands);
        assert!(stands.path_m == 0.0 && !stands.arrived && stage.away_m() < 7.0, "{stands:?}");
        stage.vehicle.on_ground = false;
        stage.target.release();
        assert!(stage.run(90.0, Some(5.0)).arrived);
    }
}
